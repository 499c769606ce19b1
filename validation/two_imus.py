"""IMUs on one plate by another simulator: accuracy, NEES and starts of what hands do with a plate.

The trajectory is a spline of its own and the readings are its derivatives (tests/make_two.py).
Where the estimator models all that there is, the mean NEES must lie inside two-sided limits at 1 %
for these cases together. `python validation/run.py two_imus 100` is the whole of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import each, limits, must, rms

import make_two
from foucault.errors import FoucaultError, Status
from foucault.models.earth import Site
from foucault.models.two_imus import layout_of
from foucault.procedures import two_imus
from foucault.procedures.two_imus import ImuLogs
from foucault.result import Level
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
    "rotation": np.radians(1 / 60), "lever": 1e-3, "delay": 1e-6, "clock": 1e-6,
    "gyro.scale": 1e-6, "gyro.bias": 1e-5, "accel.scale": 1e-6, "accel.bias": 1e-3,
}  # fmt: skip


def one(job: tuple[str, int]) -> tuple[np.ndarray, np.ndarray, float, str, bool] | None:
    """Return errors, bounds, NEES, verdict and convergence; None where refused."""
    how = {"vigour": 1.0} | CASES[job[0]]
    made, truths = make_two.session(job[1], **how)
    master, *slaves = (Log(*log) for log in made)
    try:
        found = two_imus.calibrate(ImuLogs.of(slaves[0], master, slaves[1:]), site=SITE)
    except FoucaultError:
        return None
    names = layout_of(len(truths)).names
    true = dict(zip(names, np.concatenate([make_two.values(t) for t in truths]), strict=True))
    c = found.coefficients
    e = c.values - [true[n] for n in c.names]
    first = np.array([not n.startswith("third.") for n in c.names])  # the same for every case
    bound = np.array(found.diagnostics["bound"])
    nees = float(e @ np.linalg.solve(c.cov, e)) / len(e)
    return (
        np.array([*zip(c.names, e, strict=True)], object)[first], (e / bound)[first], nees,
        found.verdict.level.value, found.status is Status.CONVERGED,
    )  # fmt: skip


def main(sessions: int = 12, workers: int = 0) -> tuple[bool, dict[str, object]]:
    jobs = [(case, seed) for case in CASES for seed in range(sessions)]
    done = list(each(one, jobs, workers or None))
    shown, good, settled = [], True, 0
    for k, case in enumerate(CASES):
        kept = [x for x in done[k * sessions : (k + 1) * sessions] if x is not None]
        settled += sum(x[4] for x in kept)
        n = len(kept[0][0]) * CASES[case].get("slaves", 1)
        low, high = limits(n * len(kept), tests=len(CASES))
        ratio = float(np.mean([x[2] for x in kept]))
        fine = low <= ratio <= high
        good &= fine
        names = [name.removeprefix("second.") for name in kept[0][0][:, 0]]
        e = np.array([x[0][:, 1] for x in kept], float)
        over = float(np.median(np.sqrt(np.mean(np.square([x[1] for x in kept]), axis=0))))
        cells = [
            f"{float(f'{size / unit:.2g}'):g}"
            for group, unit in UNITS.items()
            for size in [rms(e[:, [group in (a, a.rpartition(".")[0]) for a in names]])]
        ]
        passed = sum(x[3] == Level.PASS.value for x in kept)
        inside = f"{low:.3f} to {high:.3f} | {must(fine)}"
        shown.append(f"| {case} | {ratio:.3f} | {inside} | {over:.2f} | {' | '.join(cells)} | "
                     f"{passed} of {len(kept)} |")  # fmt: skip
    converged = settled / len(jobs)
    good &= converged >= 0.99
    return bool(good), {
        "sessions": sessions, "shown": shown, "converged": f"{settled} of {len(jobs)}",
        "enough": must(converged >= 0.99),
    }  # fmt: skip
