"""Make increments of an instrument that rests, sways, turns or moves; read the real logs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from foucault.logs import LogDescription, read
from foucault.models.earth import Site, earth_rate_n
from foucault.models.rotation import matrix_of
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.inertial_frame import SensorErrors
from foucault.plans.manoeuvres import Start
from foucault.simulate.motion import TrueTrajectory, simulate_motion
from foucault.tables import Log

REAL = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[2] / "shared" / "data"))
RING = {
    "file": "lasergyro_0-900s.imu.gz",
    "header": 14,
    "rate": "100 Hz",
    "gyro": {"columns": [0, 1, 2], "unit": "0.1 arcsec", "kind": "increment"},
    # 125 ug*s, where g is 9.780327 m/s^2
    "accel": {"columns": [3, 4, 5], "unit": "0.001222540875 m/s", "kind": "increment"},
}
RING_SITE = Site.at(np.radians(34.246048), 380.0)
LN100 = {
    "file": "x_LN100_up.ins",
    "record": {"type": "float64", "columns": 7},
    # The unit puts out increments; the file has them divided by the usual interval. Its time
    # column has the jitter of the recorder.
    "rate": "64.055 Hz",
    "gyro": {"columns": [1, 2, 3], "unit": "0.0156115837952 deg", "kind": "increment"},
    "accel": {"columns": [4, 5, 6], "unit": "0.0156115837952 m/s", "kind": "increment"},
}
LN100_SITE = Site.at(np.radians(51.08), 1000.0)
DPH = np.pi / 648000


def real(folder: str, description: dict) -> Log:
    """Read a real log, or skip."""
    if not (REAL / folder).is_dir():
        pytest.skip(f"real logs are not here: set FOUCAULT_DATA ({REAL / folder})")
    return read(LogDescription.model_validate(description), REAL / folder)


def ring_log() -> Log:
    """900 s of a ring laser unit in a standing vehicle, people moving in the first 600 s."""
    return real("ring_laser_in_vehicle", RING)


def ln100_log() -> Log:
    """300 s of an LN-100 that stands with its x axis up."""
    return real("ln100_static", LN100)


def moving(plan, site, rate=100.0, **start) -> tuple[Increments, TrueTrajectory]:
    """Exact increments of a plan that begins at a site, and the true trajectory."""
    made = simulate_motion(plan, Start(site.latitude, 0.1, site.height, **start), rate=rate)
    return increments_of(made.log), made.truth


def resting(site, duration, dt, heading, pitch=0.0, roll=0.0) -> tuple[Increments, np.ndarray]:
    """Exact increments at rest, and C_nb."""
    C_nb = matrix_of(heading, pitch, roll)
    n = round(duration / dt)
    rows = np.ones((n, 1)) * dt
    out = Increments.of(
        dt * np.arange(1, n + 1),
        rows * (C_nb.T @ earth_rate_n(site.latitude)),
        rows * (site.gravity * C_nb[2]),
    )
    return out, C_nb


def drawn_biases(sensors: SensorErrors, rng) -> np.ndarray:
    """Draw the biases of gyros and accelerometers, (2, 3)."""
    return rng.normal(size=(2, 3)) * [[sensors.gyro_bias_sd], [sensors.accel_bias_sd]]


def with_errors(increments, sensors: SensorErrors, rng, biases=None) -> Increments:
    """Add white noise and constant biases (2, 3), drawn where they are not given."""
    biases = drawn_biases(sensors, rng) if biases is None else biases
    dt = increments.dt[:, None]
    out = []
    for x, psd, bias in (
        (increments.dtheta_b, sensors.gyro_psd, biases[0]),
        (increments.dvel_b, sensors.accel_psd, biases[1]),
    ):
        out.append(x + rng.normal(size=x.shape) * np.sqrt(psd * dt) + bias * dt)
    return Increments.of(increments.time, *out)


def attitude_error(C_est: np.ndarray, C_true: np.ndarray) -> np.ndarray:
    """phi (E, N, U) of C_est = (I - [phi x]) C_true, small."""
    E = C_est @ C_true.T
    return np.array([E[1, 2] - E[2, 1], E[2, 0] - E[0, 2], E[0, 1] - E[1, 0]]) / 2
