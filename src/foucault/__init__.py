"""Foucault: calibrate, align and navigate inertial instruments against gravity and the Earth.

This page is the glossary. Every module uses these words, signs and units and no others.

Units
-----
SI and radians everywhere inside: arguments, arrays, tables, saved files. Text with a unit
(``"0.01 deg/h"``) appears only where people write or read it; `foucault.units` is the only
module that knows such units. There, ``g`` is 9.80665 m/s^2, ``ug`` is micro-g, ``h`` the hour.

Frames
------
==  =============================================================================
i   inertial
e   Earth-fixed
n   local level: East, North, Up
l   level, starts as n and is carried along without turning about up
b   body: right, forward, up. Gauge: x_b is the input axis of the x accelerometer, y_b lies
    in the plane of the x and y accelerometers
s   sensitive axes of the sensors, not orthogonal
p   torqued cluster (platform)
k   case of the instrument on a table
==  =============================================================================

Heading is clockwise from North, pitch is nose up, roll is right side down: those of y_b, the
forward axis. Latitude is geodetic, height above the WGS-84 ellipsoid.

Symbols
-------
``C_ab`` maps components: ``x_a = C_ab @ x_b``; inner letters cancel, ``C_nk = C_nt @ C_tk``.
``f_b`` is specific force in b, +1 g up at rest; ``w_ib_b`` is the rate of b relative to i,
resolved in b: the resolving frame comes last. ``w_ie_n`` is the Earth's rate, ``g_n`` gravity.
``_err`` is estimate minus truth, ``_sd`` a standard deviation, ``_cov`` a covariance. The prefix
``d`` marks increments (``dtheta_b``, ``dvel_b``, ``dt``). Filters write ``x, P, Phi, Q, H, R, z,
S, K``. The attitude error phi is defined by ``C_nb_est = (I - [phi x]) C_nb_true``; psi is the same
against the Earth instead of the place. A lever arm
points from master to slave, from the origin of the body to the sensor.

Coefficients
------------
A bias is measured minus true; a positive scale factor error reads too much; a misalignment is
named output axis, then input axis. Names are dotted words generated from the model:
``gyro.bias.x``, ``gyro.scale.z``, ``accel.misalignment.yx``, ``accel.quadratic.x``,
``gyro.g_sensitivity.xy``. See `foucault.models.imu` for the equation.

Tables
------
`Log` holds time [s], gyro (n, 3) [rad/s], accel (n, 3) [m/s^2] and, where logged, temperature
[K]. Rests and turns have one row each; `foucault.tables` lists every column with its unit.
`Increments` are a log as navigation adds it up; a `State` is position, velocity and attitude.

The names below load when first used, so that ``import foucault`` costs little.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from foucault.campaign import Campaign as Campaign
    from foucault.campaign import calibrate as calibrate
    from foucault.campaign import load as load_campaign
    from foucault.campaign import simulate as simulate_campaign
    from foucault.coefficients import CoefficientVector as CoefficientVector
    from foucault.coefficients import Layout as Layout
    from foucault.errors import Finding as Finding
    from foucault.errors import FoucaultError as FoucaultError
    from foucault.errors import Status as Status
    from foucault.logs import read as read_log
    from foucault.logs import write as write_log
    from foucault.logs.description import LogDescription as LogDescription
    from foucault.models.earth import Site as Site
    from foucault.models.imu import ImuModel as ImuModel
    from foucault.models.noise import ImuNoise as ImuNoise
    from foucault.models.noise import grade as grade
    from foucault.navigate.increments import increments_of as increments_of
    from foucault.navigate.strapdown import State as State
    from foucault.procedures.alignment import align_log as align_log
    from foucault.procedures.navigation import navigate_log as navigate_log
    from foucault.result import Check as Check
    from foucault.result import Level as Level
    from foucault.result import Result as Result
    from foucault.result import Verdict as Verdict
    from foucault.run_folder import load_result as load_result
    from foucault.run_folder import save as save_result
    from foucault.simulate.motion import simulate_motion as simulate_motion
    from foucault.tables import Log as Log
    from foucault.units import convert as convert_unit
    from foucault.units import parse as parse_unit

_HOMES = {
    "Campaign": "campaign",
    "Check": "result",
    "CoefficientVector": "coefficients",
    "Finding": "errors",
    "FoucaultError": "errors",
    "ImuModel": "models.imu",
    "ImuNoise": "models.noise",
    "Layout": "coefficients",
    "Level": "result",
    "Log": "tables",
    "LogDescription": "logs.description",
    "Result": "result",
    "Site": "models.earth",
    "State": "navigate.strapdown",
    "Status": "errors",
    "Verdict": "result",
    "align_log": "procedures.alignment",
    "calibrate": "campaign",
    "convert_unit": "units:convert",
    "grade": "models.noise",
    "increments_of": "navigate.increments",
    "load_campaign": "campaign:load",
    "load_result": "run_folder",
    "navigate_log": "procedures.navigation",
    "parse_unit": "units:parse",
    "read_log": "logs:read",
    "save_result": "run_folder:save",
    "simulate_campaign": "campaign:simulate",
    "simulate_motion": "simulate.motion",
    "write_log": "logs:write",
}

__version__ = "2.0.0"
__all__ = [
    "Campaign",
    "Check",
    "CoefficientVector",
    "Finding",
    "FoucaultError",
    "ImuModel",
    "ImuNoise",
    "Layout",
    "Level",
    "Log",
    "LogDescription",
    "Result",
    "Site",
    "State",
    "Status",
    "Verdict",
    "align_log",
    "calibrate",
    "convert_unit",
    "grade",
    "increments_of",
    "load_campaign",
    "load_result",
    "navigate_log",
    "parse_unit",
    "read_log",
    "save_result",
    "simulate_campaign",
    "simulate_motion",
    "write_log",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'foucault' has no attribute '{name}'")
    module, _, attribute = _HOMES[name].partition(":")
    value = getattr(import_module(f"foucault.{module}"), attribute or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
