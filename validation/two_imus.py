"""IMUs on one plate by another simulator: accuracy, NEES and starts of what hands do with a plate.

The trajectory is a spline of its own and the readings are its derivatives (tests/make_two.py).
Where the estimator models all that there is, the mean NEES must lie inside two-sided limits at 1 %
for these cases together. `python validation/run.py two_imus 100` is the whole of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import Trial, accuracy

import make_two
from foucault.errors import FoucaultError
from foucault.models.earth import Site
from foucault.models.two_imus import layout_of
from foucault.procedures import two_imus
from foucault.procedures.two_imus import ImuLogs
from foucault.tables import Log

SITE = replace(Site.at(np.radians(48.0)), gravity=9.80665, gravity_sd=0.0)
CASES = {
    "60 s, normal": {"duration": 60.0},
    "15 s, normal": {"duration": 15.0},
    "60 s, gentle": {"duration": 60.0, "vigour": 0.2},
    "30 s, strong": {"duration": 30.0, "vigour": 1.4},
    "30 s, first no better than the second": {"duration": 30.0, "master": (1.6e-4, 2e-3)},
    "30 s, three of them": {"duration": 30.0, "slaves": 2},
    "30 s, accelerometers 1.5 ms later than gyros": {"duration": 30.0, "late": 1.5e-3},
}
UNITS = {
    "second.rotation": np.radians(1 / 60), "second.lever": 1e-3, "second.delay": 1e-6,
    "second.clock": 1e-6,
    "gyro.scale": 1e-6, "gyro.bias": 1e-5, "accel.scale": 1e-6, "accel.bias": 1e-3,
}  # fmt: skip


def one(job: tuple[str, int]) -> Trial | None:
    """Return what came of a session; None where it is refused."""
    made, truths = make_two.session(job[1], **{"vigour": 1.0} | CASES[job[0]])
    master, *slaves = (Log(*log) for log in made)
    try:
        found = two_imus.calibrate(ImuLogs.of(slaves[0], master, slaves[1:]), site=SITE)
    except FoucaultError:
        return None
    names = layout_of(len(truths)).names
    true = dict(zip(names, np.concatenate([make_two.values(t) for t in truths]), strict=True))
    return Trial.of(found, true, [n for n in names if not n.startswith("third.")])


def main(sessions: int = 12, workers: int = 0) -> tuple[bool, dict[str, object]]:
    return accuracy(one, tuple(CASES), UNITS, sessions, workers)
