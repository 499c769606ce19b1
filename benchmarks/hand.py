"""The benchmarks of what a hand or a drill moves, as code for processes of their own; see `run`.

Each session is simulated at its length and at twice that, so that growth shows.
"""

from __future__ import annotations

CASES = {
    "two_imus": ("two IMUs on a plate, 60 s at 200 Hz", "time", 60.0, 0.5),
    "imu_pose": ("an IMU beside poses at 100 Hz, 60 s at 200 Hz", "time", 60.0, 0.5),
    "magnetometer": ("a magnetometer, 3,200 epochs at 50 Hz", "time", 60.0, 0.3),
    "continuous_spin": ("nine spins, 9,900 samples at 100 Hz", "spin_time", 9.0, 0.3),
}
"""Procedure -> words, what is doubled in its session, how long it is [s], and the target [s]."""

SESSION = """
import json, time
from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.procedures import load
p, out = load(PROCEDURE), []
more = {"rate": 50.0} if PROCEDURE == "magnetometer" else {}
site, noise, settings = Site.at(0.84), grade("mems").noise, p.Settings()
for times in (1, 2):
    session = p.Session(**{LENGTH: times * LONG}, **more)
    model = p.draw_errors("mems", 1)
    made = p.simulation(session, settings=settings, model=model, noise=noise, site=site, seed=1)
    p.calibrate(made.log, site=site, settings=settings, noise=noise)
    best = 1e9
    for _ in range(5):
        start = time.process_time()
        p.calibrate(made.log, site=site, settings=settings, noise=noise)
        best = min(best, time.process_time() - start)
    out.append(best)
print(json.dumps(out))
"""


def code(procedure: str) -> str:
    """Return what is run of a procedure; it prints the seconds of its session and of a long one."""
    _, length, long, _ = CASES[procedure]
    named = SESSION.replace("PROCEDURE", repr(procedure)).replace("LENGTH", repr(length))
    return named.replace("LONG", repr(long))
