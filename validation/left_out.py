"""Terms that are not estimated: are the uncertainties right with them, and is the right one named?

Sessions of consumer MEMS, simulated without such terms; then one group of terms, or all at their
sizes, is put into the samples by its formula, which shares nothing with what the estimator makes
its columns of. Each is calibrated without sizes and with them. With all terms drawn at their sizes
the mean NEES must lie inside two-sided chi-square limits, and nothing may be named but by chance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from common import limits, word
from scipy.stats import binom

from foucault.diagnose.study import nees
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import sizes_of
from foucault.models.noise import grade
from foucault.procedures import ferraris, hand_rotated, rate_table
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import Log

SITE = Site.at(np.radians(48.8462), 60.0)
SIZES = sizes_of("consumer MEMS")
SQUARE = ferraris.Settings(placement_sd=np.radians(0.05), angle_sd=np.radians(0.2))
FACES = ferraris.Session(
    rest_time=10.0, turn_time=5.0, placement_sd=np.radians(0.05), angle_sd=np.radians(0.2)
)
TABLE = rate_table.Settings(table_rate_sd=5e-6, fixture_sd=np.radians(1 / 60))
RATES = rate_table.Session(
    rates=[f"{sign}{rate} deg/s" for rate in (20, 40, 70, 100) for sign in ("", "-")],
    step_time=18.0,
)
PROCEDURES = {
    "hand_rotated": (hand_rotated.PROCEDURE, hand_rotated.Settings(), hand_rotated.Session()),
    "ferraris": (ferraris.PROCEDURE, SQUARE, FACES),
    "rate_table": (rate_table.PROCEDURE, TABLE, RATES),
}
COUNT = {
    "accel.quadratic": 3, "accel.cross": 15, "accel.asymmetry": 3, "gyro.g_sensitivity": 9,
    "gyro.asymmetry": 3, "gyro.cubic": 3, "gyro.deflection": 18, "accel.bias drift": 3,
    "gyro.bias drift": 3, "accel.scale drift": 3, "gyro.scale drift": 3,
}  # fmt: skip
CASES = {
    "nothing": {}, "all at their sizes": dict.fromkeys(COUNT, 1.0),
    "quadratic x 5": {"accel.quadratic": 5.0}, "products of axes x 5": {"accel.cross": 5.0},
    "g-sensitivity x 5": {"gyro.g_sensitivity": 5.0}, "cubic x 5": {"gyro.cubic": 5.0},
    "asymmetry of gyros x 10": {"gyro.asymmetry": 10.0},
    "drift of accelerometer biases x 5": {"accel.bias drift": 5.0},
    "drift of gyro biases x 5": {"gyro.bias drift": 5.0},
    "drift of gyro scale factors x 10": {"gyro.scale drift": 10.0},
    "gravity 1 mm/s^2 off": {"gravity": 2.5},
}  # fmt: skip
"""Case -> group and how many of its sizes."""


def put(log: Log, model: ImuModel, amounts: dict[str, np.ndarray]) -> Log:
    """Add terms [SI] to the samples of an instrument without them."""
    f, w = model.compensate(log.accel, log.gyro)
    assert f is not None
    assert w is not None
    a, g = np.zeros_like(f), np.zeros_like(w)
    ramp = ((log.time - log.time[0]) / (log.time[-1] - log.time[0]) - 0.5)[:, None]
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    crossed = [(o, i, j) for o in range(3) for i, j in pairs if not o == i == j]
    bent = [(o, i, k) for o in range(3) for i in range(3) if i != o for k in range(3)]
    simple: dict[str, Callable[[np.ndarray], Any]] = {
        "accel.quadratic": lambda x: (x * f**2, 0.0),
        "accel.asymmetry": lambda x: (x * np.abs(f), 0.0),
        "gyro.g_sensitivity": lambda x: (0.0, f @ x.reshape(3, 3).T),
        "gyro.asymmetry": lambda x: (0.0, x * np.abs(w)),
        "gyro.cubic": lambda x: (0.0, x * w**3),
        "accel.bias drift": lambda x: (x * ramp, 0.0),
        "gyro.bias drift": lambda x: (0.0, x * ramp),
        "accel.scale drift": lambda x: (x * ramp * f, 0.0),
        "gyro.scale drift": lambda x: (0.0, x * ramp * w),
    }
    for group, x in amounts.items():
        if group == "accel.cross":
            for value, (o, i, j) in zip(x, crossed, strict=True):
                a[:, o] += value * f[:, i] * f[:, j]
        elif group == "gyro.deflection":
            for value, (o, i, k) in zip(x, bent, strict=True):
                g[:, o] += value * f[:, k] * w[:, i]
        else:
            more = simple[group](x)
            a, g = a + more[0], g + more[1]
    assert log.accel is not None
    assert log.gyro is not None
    return replace(log, accel=log.accel + a, gyro=log.gyro + g)


def left(which: str, case: str) -> dict[str, float]:
    """Return what a case puts in that matters to a procedure and is not estimated by it."""
    procedure, settings, session = PROCEDURES[which]
    names = procedure.names(settings, session)
    known = {name.rpartition(".")[0] for name in names}
    triads = {name.partition(".")[0] for name in names} | {"gravity"}
    return {
        group: times for group, times in CASES[case].items()
        if group not in known and group.partition(".")[0] in triads
    }  # fmt: skip


def one(which: str, case: str, seed: int) -> tuple[float, float, float, float, list[str]]:
    """Return NEES per coefficient without sizes and with, growth of sd, count, who is named."""
    procedure, settings, session = PROCEDURES[which]
    rng = np.random.default_rng([seed, 77])
    all_of_them = case == "all at their sizes"
    amounts = {}
    for group, times in left(which, case).items():
        if group != "gravity":
            draw = rng.standard_normal if all_of_them else lambda n: rng.choice([-1.0, 1.0], n)
            amounts[group] = times * SIZES[group][0] * draw(COUNT[group])
    off = CASES[case].get("gravity", float(rng.standard_normal()) * all_of_them) * SITE.gravity_sd
    sim = procedure.simulate(
        session, settings=settings, model=draw_errors("mems", 10_000 + seed),
        noise=grade("mems").noise, site=replace(SITE, gravity=SITE.gravity + off), seed=seed,
    )  # fmt: skip
    log, out = put(sim.log, sim.model, amounts), []
    for sizes in (None, SIZES):
        found = procedure.trial(log, site=SITE, settings=settings, sizes=sizes)
        c = found.coefficients
        assert c.cov is not None
        errors = c.values - sim.model.coefficients(c.names).values
        out += [float(nees(errors[None], c.cov[None])[0]) / len(errors), float(np.median(c.sd))]
    named = [next(iter(causes)) for causes in found.diagnostics["named"]]
    return out[0], out[2], out[3] / out[1], float(len(errors)), named


def main(sessions: int = 20) -> tuple[bool, dict[str, object]]:
    shown, good = [], True
    for which in PROCEDURES:
        for case in (c for c in CASES if left(which, c) or not CASES[c]):
            runs = [one(which, case, seed) for seed in range(sessions)]
            before, after, _, n = np.array([run[:4] for run in runs]).mean(axis=0)
            said = Counter(name for run in runs for name in set(run[4]))
            low, high = limits(int(n) * sessions, tests=2)
            wrong = sum(bool(run[4]) for run in runs)
            by_chance = binom.isf(0.005, sessions, 0.01)
            if case == "all at their sizes":
                good &= low <= after <= high and wrong <= by_chance
            if case == "nothing":
                good &= after <= high and wrong <= by_chance
            words = ", ".join(f"{name} {count}" for name, count in said.most_common(3))
            shown.append(
                f"| {which} | {case} | {before:.3g} | {after:.3g} | {word(after <= high)} | "
                f"{words or 'nothing'} |"
            )
    return good, {"sessions": sessions, "shown": shown}
