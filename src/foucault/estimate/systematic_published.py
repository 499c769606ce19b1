"""The two steps of the source: first without the deflection, then with it.

The first part of the session is filtered with the errors of the instrument alone (33 states). Its
coefficients start a second filter with those of the deflection (39 states) over the rest, with
uncertainties that are set anew: carried over they would be too small, for the first filter took
deflection for misalignment.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", *Navigation and Control* 2023(5), eqs. (17)-(19).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from foucault.estimate.ins_filter import run, start_cov
from foucault.estimate.systematic import AtRest, SystematicRun, solve
from foucault.models.earth import Site, gravity
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments

FloatArray = npt.NDArray[np.float64]

RESET = {
    "gyro.bias": np.radians(0.003) / 3600.0,
    "gyro.scale": 5e-6,
    "gyro.misalignment": np.radians(5.0 / 3600.0),
    "accel.bias": 10e-6 * 9.80665,
    "accel.scale": 5e-6,
    "accel.misalignment": np.radians(5.0 / 3600.0),
    "accel.asymmetry": 5e-6,
}
"""Standard deviations that the second step starts with; others keep those they had [SI]."""


def solve_published(
    increments: Increments,
    C_nb: FloatArray,
    site: Site,
    sensors: tuple[Sensors, Sensors],
    rests: Sequence[tuple[int, int]],
    first_part: int,
    P0: FloatArray,
    noise: ImuNoise,
    *,
    at_rest: AtRest | None = None,
    estimate: FloatArray | None = None,
) -> SystematicRun:
    """Estimate in two steps, one pass each.

    Parameters
    ----------
    increments : Increments
        The session as measured.
    C_nb : ndarray, shape (3, 3)
        Attitude in the first rest [1].
    site : Site
        Where it stands; the latitude must be known.
    sensors : (Sensors, Sensors)
        Coefficients of the first and of the second step; the second has all of the first.
    rests : sequence of (int, int)
        First and last row of each rest, in order [1].
    first_part : int, shape ()
        So many rests belong to the first step [1].
    P0 : ndarray, shape (9 + p, 9 + p)
        Covariance at the start, of the states of the second step [SI].
    noise : ImuNoise
        White noise of the sensors [SI].
    at_rest : AtRest or None
        What is known at rest; None takes the defaults.
    estimate : ndarray, shape (p,), or None
        Coefficients of the second step at the start, zero by default [SI].
    """
    assert site.latitude is not None
    at_rest = at_rest or AtRest()
    few, all_ = sensors
    keep = np.array([all_.layout.index(name) for name in few.layout.names])
    values = np.zeros(len(all_)) if estimate is None else np.array(estimate, float)
    states = np.r_[np.arange(9), 9 + keep]
    one = solve(
        increments, C_nb, site, few, rests[:first_part], P0[np.ix_(states, states)], noise,
        at_rest=at_rest, first=rests[0][0], estimate=values[keep],
    )  # fmt: skip
    values[keep] = one.estimate.values
    sd = np.sqrt(np.diag(P0)[9:])
    for group, reset in RESET.items():
        sd[all_.layout.group(group)] = reset
    last = increments.row_at(float(one.run.time[-1]))
    P = start_cov(one.run.attitude_cov, at_rest.velocity_sd, at_rest.position_sd, sd)
    two = run(
        increments, one.run.trajectory.state(-1), all_,
        at_rest.updates(increments, rests, site, last), P, noise, first=last, estimate=values,
        gravity_offset=site.gravity - float(gravity(site.latitude, site.height)),
        keep=True,
    )  # fmt: skip
    return SystematicRun(two, two.estimate, (values, two.coefficients[-1]))
