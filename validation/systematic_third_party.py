"""The nineteen positions of another program: every coefficient beside its author's truth.

The file is not part of this project; see the page for what it holds. Skipped where it is missing.
"""

from __future__ import annotations

from itertools import pairwise
from time import process_time

import numpy as np
from common import DATA, word
from systematic_setting import DEG, UNITS, G

from foucault.logs import LogDescription, read
from foucault.models.earth import Site
from foucault.procedures import systematic
from foucault.procedures.systematic.problem import SystematicProblem, problem_of
from foucault.procedures.systematic.settings import Settings
from foucault.result import Result
from foucault.tables import Log

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
    lines = []
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


def main() -> tuple[bool, dict[str, object]]:
    if not FOLDER.is_dir():
        print(f"skipped: the file of another program is not here; set FOUCAULT_DATA ({FOLDER})")
        return None
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
    real = (np.abs(sums + 20 * THREE) < 4).all() and all(abs(v + 1) < 0.1 for v in late.values())
    return inside and free_inside and close and real, {
        "accel_noise": white["accel"],
        "gyro_noise": white["gyro"],
        "states": states,
        "each": each,
        "gravity": GRAVITY,
        "missed": errors(result)["accel.scale"][1].mean(),
        "groups": groups,
        "free_inside": word(free_inside),
        "seconds": seconds,
        "first": sums[0],
        "second": sums[1],
        "third": sums[2],
        "delays": ", ".join((f"{v:.3f} ms ({k})" for k, v in late.items())),
    }
