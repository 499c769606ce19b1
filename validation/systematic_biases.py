"""What the sessions of systematic calibration do not forgive, and the cures.

Sessions without noise, so that what remains is bias: lever arms of 3 cm that nobody told the
filter, a table that misses its angles, accelerometers with quadratic terms. Each with the cure.
"""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, replace

import numpy as np
from common import rms, word
from systematic_setting import (
    ARCSEC,
    BEND,
    DEG,
    FULL,
    INSTRUMENT,
    MODEL,
    RATE,
    SITE,
    UG,
    G,
    Session,
    both_steps,
    groups,
    instrument,
    spread_of,
)

from foucault.estimate.systematic import AtRest
from foucault.models.ins_errors import Sensors
from foucault.models.size_effect import with_size_effect
from foucault.simulate.systematic import TableErrors, simulate_systematic

DRAWS = 24
PASSES = 2
SD = spread_of(FULL)
BENT = groups(FULL)["deflection"]
QUADRATIC = 12 * UG / G**2
ARM = 0.03


@dataclass(frozen=True)
class Case:
    """One disturbance and one filter; what an earlier study found of the deflections [arcsec/g]."""

    name: str
    filter: str
    sensors: Sensors = FULL
    spin_rate: float = 18.0
    arm: float = 0.0
    table: float = 0.0
    quadratic: float = 0.0
    decorrelate: bool = False
    cured: bool = False
    known: str = ""


LEVERS = with_size_effect(FULL, delay=False)
SQUARES = Sensors.of((*INSTRUMENT, "accel.quadratic")).with_deflection(MODEL)
SLOW, FAST = "lever arms of 3 cm, spins at 18 deg/s", "lever arms of 3 cm, spins at 90 deg/s"
CASES = (
    Case("none", "joint", cured=True),
    Case("none, spins at 90 deg/s", "joint", spin_rate=90.0, cured=True),
    Case(SLOW, "joint", arm=ARM, known="0.45"),
    Case(SLOW, "decorrelated", arm=ARM, decorrelate=True, cured=True, known="1e-4"),
    Case(SLOW, "lever arms estimated", LEVERS, arm=ARM, cured=True),
    Case(FAST, "joint", spin_rate=90.0, arm=ARM, known="12"),
    Case(FAST, "decorrelated", spin_rate=90.0, arm=ARM, decorrelate=True, cured=True, known="1e-4"),
    Case(FAST, "lever arms estimated", LEVERS, spin_rate=90.0, arm=ARM, cured=True),
    Case("table misses by 60 arcsec a turn", "joint", table=60.0, cured=True, known="5e-4"),
    Case("table misses by 600 arcsec a turn", "joint", table=600.0, cured=True, known="5e-4"),
    Case("quadratic terms of 12 ug/g^2", "joint", quadratic=QUADRATIC, known="0.023"),
    Case("quadratic terms of 12 ug/g^2", "quadratic terms estimated", SQUARES, quadratic=QUADRATIC,
         cured=True),
)  # fmt: skip


def one(job: tuple[Case, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of all 30 coefficients of a session without noise, and their sds."""
    case, seed = job
    rng = np.random.default_rng([seed, 3])
    truth = SD * rng.standard_normal(len(SD))
    direction = rng.standard_normal((2, 3))
    arms = np.zeros((3, 3))
    arms[:2] = case.arm * direction / np.linalg.norm(direction, axis=1)[:, None]
    signs = rng.choice([-1.0, 1.0], 3)
    model = instrument(FULL, truth)
    K = model.accel_quadratic.copy()
    K[np.arange(3), np.arange(3)] = case.quadratic * signs
    plan, _ = both_steps(spin_rate=case.spin_rate * DEG)
    made = simulate_systematic(
        plan, site=SITE, model=replace(model, accel_quadratic=K), rate=RATE, seed=seed,
        table=TableErrors(case.table * ARCSEC), arms=arms,
    )  # fmt: skip
    session = Session(made)
    found = session.solve(
        case.sensors, at_rest=AtRest(decorrelate=case.decorrelate), passes=PASSES
    ).estimate
    at = [case.sensors.layout.index(name) for name in FULL.layout.names]
    return found.values[at] - truth, found.sd[at]


def main(draws: int = DRAWS) -> tuple[bool, dict[str, object]]:
    lines = [
        "| disturbance | filter | bias, rms | largest | earlier study | sd | bias / sd | below 0.1 "
        "| worst of the others, bias / sd |", "|---|---|--:|--:|--:|--:|--:|---|---|",
    ]  # fmt: skip
    good = True
    others = np.setdiff1d(np.arange(len(SD)), BENT)
    with multiprocessing.Pool() as pool:
        for case in CASES:
            jobs = [(case, k) for k in range(draws)]
            err, sd = (np.array(x) for x in zip(*pool.map(one, jobs), strict=True))
            bias, told = err[:, BENT] / BEND, rms(sd[:, BENT]) / BEND
            share = rms(bias) / told
            good &= not case.cured or share < 0.1
            z = np.sqrt(np.mean((err / sd)[:, others] ** 2, axis=0))
            k = int(z.argmax())
            lines.append(
                f"| {case.name} | {case.filter} | {rms(bias):.2g} | {np.abs(bias).max():.2g} | "
                f"{case.known} | {told:.4f} | {share:.2g} | "
                f"{word(share < 0.1) if case.cured else ''} | "
                f"{FULL.layout.names[others[k]]}, {z[k]:.2g} |"
            )
            print(lines[-1], flush=True)
    return good, {"draws": draws, "rate": RATE, "passes": PASSES, "lines": lines}
