"""The nineteen positions of another program: every coefficient beside its author's truth.

The file is not part of this project; see the page for what it holds. Skipped where it is missing.

Run from the repository root: python validation/systematic_third_party.py
"""

from __future__ import annotations

import os
import sys
from itertools import pairwise
from pathlib import Path
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from systematic_setting import DEG, UNITS, G, word, write

from foucault.logs import LogDescription, read
from foucault.models.earth import Site
from foucault.procedures import systematic
from foucault.procedures.systematic.problem import SystematicProblem, problem_of
from foucault.procedures.systematic.settings import Settings
from foucault.result import Result
from foucault.tables import Log

DATA = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[2] / "shared" / "data"))
FOLDER = DATA / "systematic_19_positions"
DESCRIPTION = LogDescription.model_validate({
    "file": "imusysclbt.bin",
    "record": {"type": "float32", "columns": 7},
    "rate": "100 Hz",  # the seventh column is time, in steps that float32 rounds
    "gyro": {"columns": [0, 1, 2], "unit": "rad", "kind": "increment"},
    "accel": {"columns": [3, 4, 5], "unit": "m/s", "kind": "increment"},
})  # fmt: skip
SITE = Site.at(34 * DEG)
SETTINGS = Settings(accel_quadratic=True, lever_arms=True, delay=True, passes=5)
SYMMETRIC = SETTINGS.model_copy(update={"accel_asymmetry": False})
"""His accelerometers scale alike in both senses, and his filter takes that for granted."""

THREE = np.array([1.0, 2.0, 3.0])
TRUTH = {
    "gyro.bias": -0.1 * THREE, "gyro.scale": -10 * THREE,
    "gyro.misalignment": 10 * np.arange(1.0, 7.0), "accel.bias": -10 * THREE,
    "accel.scale": -10 * THREE, "accel.misalignment": 10 * THREE, "accel.quadratic": -10 * THREE,
    "accel.lever": -10 * np.arange(1.0, 7.0), "accel.delay": np.array([-1.0]),
}  # fmt: skip
"""In the units of the page, measured minus true."""

PSINS = {"gyro.bias": 0.0018, "accel.bias": 0.4, "accel.quadratic": 0.50, "accel.lever": 0.6,
         "accel.delay": 0.005}  # fmt: skip
"""Largest error of each group that is reported of its 43-state filter, five passes."""

GRAVITY = 0.142
"""By so much two formulas of normal gravity differ that versions of his program could have used
(GRS80 as printed, and the WGS84 of this library); all scale factors move together [ppm]."""


def errors(result: Result) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return value, error and sd of each group, in the units of the page."""
    out = {}
    for group, truth in TRUTH.items():
        x, unit = result.coefficients[group], UNITS[group][0]
        out[group] = (x.values / unit, x.values / unit - truth, x.sd / unit)
    return out


def table(result: Result) -> tuple[list[str], bool]:
    """Every coefficient beside the truth."""
    lines = [
        "| coefficient | truth | found | error | sd | error / sd | inside 3 |",
        "|---|--:|--:|--:|--:|--:|---|",
    ]
    good = True
    for group, (values, err, sd) in errors(result).items():
        told = np.hypot(sd, GRAVITY) if group == "accel.scale" else sd
        names = [n for n in result.coefficients.names if n.startswith(group)]
        unit = UNITS[group][1]
        for k, name in enumerate(names):
            z = err[k] / told[k]
            good &= bool(abs(z) < 3)
            lines.append(
                f"| {name} | {TRUTH[group][k]:g} {unit} | {values[k]:.5g} | {err[k]:.2g} | "
                f"{told[k]:.2g} | {z:.2f} | {word(abs(z) < 3)} |"
            )
    return lines, good


def beside(result: Result, free: Result) -> tuple[list[str], bool]:
    """Largest error of each group beside the other program's."""
    lines = [
        "| group | largest error | PSINS, 43 states | as close | asymmetry estimated too | sd |",
        "|---|--:|--:|---|--:|--:|",
    ]
    good, more = True, errors(free)
    for group, (_, err, _) in errors(result).items():
        own, other = float(np.abs(err).max()), PSINS.get(group)
        good &= other is None or own <= other
        lines.append(
            f"| {group} | {own:.2g} {UNITS[group][1]} | {'' if other is None else f'{other:g}'} | "
            f"{'' if other is None else word(own <= other)} | {np.abs(more[group][1]).max():.2g} | "
            f"{more[group][2].max():.2g} |"
        )
    return lines, good


# -- what the file holds, without a filter -----------------------------------------------------


def half_sums(log: Log, problem: SystematicProblem) -> np.ndarray:
    """Bias and quadratic term together: half the sum of readings up and down [ug]."""
    means = np.array([log.accel[a : b + 1].mean(axis=0) for a, b in problem.rests])
    return np.array([(x[x > 9].mean() + x[x < -9].mean()) / 2 for x in means.T]) / (1e-6 * G)


def lag(log: Log, problem: SystematicProblem) -> dict[str, float]:
    """How much later accelerometers read than gyros, from turns there and back again [ms].

    At the same angle both ways a late accelerometer reads what was true a little before: the
    difference of the readings is ``2 tau w df/dangle``. Sizes of lever arms do the same both ways.
    """
    step, moves, out = log.interval, problem.found.moves, {}
    for one, two in pairwise(moves):
        if one.axis_b @ two.axis_b > -0.99:
            continue
        i = int(np.abs(one.axis_b).argmax())
        rest = log.gyro[one.last + 50 : two.first - 50, i].mean()  # the Earth and the bias
        there, back = (
            np.abs(np.cumsum(x) - x / 2) * step
            for x in (log.gyro[one.first : one.last, i][::-1] - rest,
                      log.gyro[two.first : two.last, i] - rest)
        )  # fmt: skip
        angle = np.linspace(15, 75, 61) * DEG
        forth, home = (
            np.array([np.interp(angle, a, x) for x in f.T]).T
            for a, f in ((there, log.accel[one.first : one.last][::-1]),
                         (back, log.accel[two.first : two.last]))
        )  # fmt: skip
        slope = np.gradient((forth + home) / 2, angle, axis=0)
        tau = np.sum((forth - home) * slope) / np.sum(slope**2) / (2 * one.peak)
        out["xyz"[i]] = float(1e3 * tau)
    return out


def five_passes(problem: SystematicProblem) -> float:
    """CPU time of five passes with 43 states, compiled [s]."""
    model, starts, prior = problem.model, problem.starts(problem.begun), problem.prior
    times = []
    for _ in range(3):
        begin = process_time()
        for _ in range(5):
            model.filtered(starts, prior.values, prior.prior_sd, keep=True)
        times.append(process_time() - begin)
    return min(times)


def main() -> int:
    if not FOLDER.is_dir():
        print(f"skipped: the file of another program is not here; set FOUCAULT_DATA ({FOLDER})")
        return 0
    log = read(DESCRIPTION, FOLDER)
    free = systematic.trial(log, site=SITE, settings=SETTINGS)
    result = systematic.trial(log, site=SITE, settings=SYMMETRIC)
    problem = problem_of(log, SITE, SETTINGS, None, {})
    each, inside = table(result)
    groups, close = beside(result, free)
    _, free_inside = table(free)
    sums, late = half_sums(log, problem), lag(log, problem)
    white = result.diagnostics["noise"]
    seconds = five_passes(problem)
    states = 9 + len(problem.sensors)
    write("systematic_third_party", [
        "# Systematic calibration: another program's nineteen positions", "",
        "Written by `python validation/systematic_third_party.py` where the file is at hand: "
        "`imusysclbt.bin` of PSINS (Yan Gongmin, BSD-2), 98,200 rows at 100 Hz, simulated by its "
        "author without noise and kept as float32. Increments; dt is taken from the row, for the "
        "time column is rounded.", "",
        f"Noise as measured in the rests, which is rounding: {white['accel']:.1e} m/s/sqrt(s) and "
        f"{white['gyro']:.1e} rad/sqrt(s). At rest rounding does not scatter, so that the sd is "
        "made by what is said of the rests, 0.1 mm/s and 1 cm. "
        f"Latitude 34 deg, height 0; {states} states, of which the asymmetry of the accelerometers "
        "is known to be zero.", "",
        *each, "",
        "Values are measured minus true. The scale factors of the accelerometers are no better "
        "known "
        f"than his gravity: {GRAVITY} ppm is in their sd. They miss the truth by about the same, "
        f"{errors(result)['accel.scale'][1].mean():.3f} ppm; half a step of float32 is 0.04 "
        "ppm.", "",
        "## Beside the program of the author", "", *groups, "",
        "The last two columns have the default, where the asymmetry is estimated too. All rests "
        "are within 1.4 deg of a direction of the axes, where an asymmetry and a quadratic term "
        "with "
        "a bias are the same: only their sum is seen, and the sd says so. To tell them apart takes "
        "rests in between. "
        f"Every coefficient inside 3 sd there, too: {word(free_inside)}.", "",
        f"CPU time of five passes with {states} states, compiled: {seconds:.2f} s (wanted: at most "
        "1 s; the program of the author takes about 10 min).", "",
        "## What is in the file", "",
        "A description that goes with the file gives accelerometer biases of 100, 200, 300 ug and "
        "a "
        "delay of 5 ms. The file has other ones, as two looks without a filter show:", "",
        "* Half the sum of the readings of an axis up and down is bias plus quadratic term: "
        f"{sums[0]:.1f}, {sums[1]:.1f}, {sums[2]:.1f} ug (misalignments add up to 4 ug). With "
        "quadratic terms of 10, 20, 30 ug/g^2 that is 10, 20, 30 ug of bias; 100, 200, 300 ug "
        "would "
        "make 110, 220, 330 or 90, 180, 270.",
        "* At the same angle of a turn there and the turn back, accelerometers that read late "
        "differ "
        "by 2 tau w df/dangle: tau = "
        + ", ".join(f"{v:.3f} ms ({k})" for k, v in late.items())
        + ". Not 5 ms.", "",
        "The script that made it says the same: `base/imu/imuclbt.m` of PSINS (06a10fcf) has "
        "`clbt.db = [10; 20; 30]*glv.ug` and `clbt.tGA = 0.001`. So the results that are quoted of "
        "PSINS, near 100, 200, 300 ug and 5 ms, are of another session than this file; its errors "
        "are compared, not its values. Lever arms and delay have the sign opposite to the one of "
        "that script, too: they are -1 to -6 cm and -1 ms (accelerometers read early).",
    ])  # fmt: skip
    real = (np.abs(sums + 20 * THREE) < 4).all() and all(abs(v + 1) < 0.1 for v in late.values())
    print(inside, free_inside, close, real)
    return 0 if inside and free_inside and close and real else 1


if __name__ == "__main__":
    sys.exit(main())
