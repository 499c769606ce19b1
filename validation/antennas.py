"""An IMU beside two antennas by another simulator: accuracy, NEES and starts.

The sessions are those of `imu_pose`; the second antenna is another place on the body. The mean NEES
must lie inside two-sided limits at 1 % for these cases together. `python validation/run.py antennas
100` is the whole of it.
"""

from __future__ import annotations

import numpy as np
from common import Trial, accuracy
from imu_pose import NOISE, SITE, UNITS

import make_pose
from foucault.errors import FoucaultError
from foucault.estimate.imu_pose import OF_ANTENNAS
from foucault.models.pose import PoseTable, Second
from foucault.procedures import imu_pose
from foucault.procedures.imu_pose import PoseLog, Settings
from foucault.tables import Log

BASE = np.array([0.1, 0.79, -0.05])
RTK = {"duration": 60.0, "vigour": 0.6, "pose_rate": 10.0, "sd": (1e-3, 8e-3)}
CASES = {
    "prisms: 60 s, 120 Hz, 0.5 mm": {"duration": 60.0, "vigour": 0.6},
    "RTK: 60 s, 10 Hz, 8 mm": RTK,
    "RTK, the length of the base known to 1 mm": RTK | {"known": 1e-3},
    "RTK, the base measured by itself": RTK | {"told": "base"},
    "RTK, heading and pitch, length known to 2 mm": RTK | {"told": "direction", "known": 2e-3},
    "RTK, each antenna lost for a fifth of the time": RTK | {"lost": 0.2},
}
SHOWN = {"pose.base": 1e-3} | {k: v for k, v in UNITS.items() if k != "pose.rotation"}


def one(job: tuple[str, int]) -> Trial | None:
    """Return what came of a session; None where it is refused."""
    how = dict(CASES[job[0]])
    told, known, lost = (
        how.pop(k, d) for k, d in (("told", "position"), ("known", 0), ("lost", 0))
    )
    rng = np.random.default_rng([job[1], 9])
    length = float(np.linalg.norm(BASE)) + known * rng.standard_normal()
    imu, (t, p, _), truth = make_pose.session(job[1], base=BASE, **how)
    measured = truth["measured"]
    place = {"position": truth["second"], "base": measured,
             "direction": measured / np.linalg.norm(measured, axis=1)[:, None]}[told]  # fmt: skip
    for x in (p, place):
        seconds = rng.uniform(size=100) < lost
        x[seconds[(t - t[0]).astype(int)]] = np.nan
    kept = np.isfinite(p[:, 0]) | np.isfinite(place[:, 0])
    table = PoseTable(t[kept], p[kept], second=Second(place[kept], told))
    settings = Settings(base_length=length, base_length_sd=known) if known else Settings()
    try:
        found = imu_pose.calibrate(
            PoseLog.of(Log(*imu), table), site=SITE, settings=settings, noise=NOISE
        )
    except FoucaultError:
        return None
    return Trial.of(found, dict(zip(OF_ANTENNAS, make_pose.values(truth), strict=True)))


def main(sessions: int = 12, workers: int = 0) -> tuple[bool, dict[str, object]]:
    return accuracy(one, tuple(CASES), SHOWN, sessions, workers)
