"""An IMU beside poses by another simulator: accuracy, NEES and starts of what a hand does.

The trajectory is a spline of its own and readings and poses are its derivatives and places
(tests/make_pose.py). Where the estimator models all that there is, the mean NEES must lie inside
two-sided limits at 1 % for these cases together. `python validation/run.py imu_pose 100` is the
whole of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import Trial, accuracy
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import make_pose
from foucault.errors import FoucaultError
from foucault.estimate.imu_pose import NAMES
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.pose import PoseTable
from foucault.procedures import imu_pose
from foucault.procedures.imu_pose import PoseLog
from foucault.tables import Log

SITE = replace(Site.at(np.radians(48.0)), gravity=9.80665, gravity_sd=0.0)
NOISE = ImuNoise(TriadNoise(white=2e-3), TriadNoise(white=1.6e-4))
SOME = {"duration": 30.0}
CASES = {
    "60 s, normal": {"duration": 60.0},
    "15 s": {"duration": 15.0},
    "30 s, gentle": SOME | {"vigour": 0.35},
    "30 s, strong": SOME | {"vigour": 1.4},
    "30 s, tags: 30 Hz, 3 mm, 0.3 deg": SOME | {"pose_rate": 30.0, "sd": (5.2e-3, 3e-3)},
    "60 s, positions alone": {"duration": 60.0, "vigour": 0.6, "alone": True},
    "30 s, 2 % of poses 5 cm and 6 deg off": SOME | {"wild": 0.02},
    "30 s, accelerometers 1.5 ms later than gyros": SOME | {"late": 1.5e-3},
    "30 s, errors of poses correlated by 0.9": SOME | {"rho": 0.9},
}
UNITS = {
    "pose.rotation": np.radians(1 / 60), "pose.lever": 1e-3, "pose.delay": 1e-6,
    "pose.clock": 1e-6, "pose.level": np.radians(1 / 60), "gyro.bias": 1e-5, "gyro.scale": 1e-6,
    "accel.bias": 1e-3, "accel.scale": 1e-6,
}  # fmt: skip


def one(job: tuple[str, int]) -> Trial | None:
    """Return what came of a session; None where it is refused."""
    how = {"vigour": 1.0} | CASES[job[0]]
    alone, wild, rho = (how.pop(key, 0.0) for key in ("alone", "wild", "rho"))
    if rho:
        how["sd"] = (1e-6, 1e-7)
    rng = np.random.default_rng([job[1], 6])
    imu, (t, p, C), truth = make_pose.session(job[1], **how)
    turn, move = np.zeros((2, len(t), 3))
    if wild:
        off = (rng.uniform(size=len(t)) < wild)[:, None] * rng.standard_normal((2, len(t), 3))
        turn, move = np.radians(6.0) * off[0], 0.05 * off[1]
    if rho:
        white = rng.standard_normal((2, len(t) + 500, 3))
        slow = np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], white, axis=1)[:, 500:]
        turn, move = 1.745e-3 * slow[0], 5e-4 * slow[1]
    q = make_pose.quaternion(C @ Rotation.from_rotvec(turn).as_matrix())
    table = PoseTable(t, p + move, None if alone else q)
    try:
        found = imu_pose.calibrate(PoseLog.of(Log(*imu), table), site=SITE, noise=NOISE)
    except FoucaultError:
        return None
    return Trial.of(found, dict(zip(NAMES, make_pose.values(truth), strict=True)))


def main(sessions: int = 12, workers: int = 0) -> tuple[bool, dict[str, object]]:
    return accuracy(one, tuple(CASES), UNITS, sessions, workers)
