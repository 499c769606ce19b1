"""The price of counting terms that are not estimated, names given by mistake, and power.

Clean sessions hold none of them. Their sd with sizes over that without is the price, the terms
that make it are those of the budget, and a size that is declared buys some of it back. In clean
sessions nothing may be named but in 1 %. A term of the size that a report says would be named in
nine of ten sessions is put into the samples by its formula and has to be.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from common import each
from left_out import COUNT
from scipy.stats import binom
from violations import CASES, DECLARED, Session, amounts
from violations import GRADE as GRADES_OF

from foucault.models.left_out import sizes_of
from foucault.models.noise import grade
from sessions import SITE, Case, made

PROCEDURES = ("hand_rotated", "six_position", "ferraris", "rate_table", "north_seeking")
FEWER = {"platform_tumble": 8, "norm_observation": 20, "multi_position": 20, "turntable": 20,
         "systematic": 40, "transfer_alignment": 40}  # fmt: skip
"""Procedures whose sessions take longer: of the clean ones one in so many [1]."""

CLASSES = {"consumer MEMS": "mems", "tactical MEMS": "tactical", "tactical FOG": "navigation"}
"""Grade of the sizes -> class of the simulated instrument's noise and errors."""

TABLES = ("norm_observation", "multi_position", "turntable")
SESSIONS = CASES | {
    f"{w}, both senses": replace(CASES[w], settings={"both_senses": True}) for w in TABLES
}
"""Spins in one sense leave a g-sensitivity in the gyros' matrix: in both they cost less."""

CELLS = [
    *((w, n) for w in PROCEDURES[:-1] for n in CLASSES), ("north_seeking", "tactical FOG"),
    *((w, "tactical MEMS") for table in TABLES for w in (table, f"{table}, both senses")),
]  # fmt: skip
"""Session and grade; gyros of the other grades find no north, and are not put on such tables."""

SURVEYED = 2e-5  # m/s^2: gravity as a gravimeter tells it
SHEET = {"accel.quadratic": 0.1, "accel.cross": 0.1, "accel.asymmetry": 0.1, "gyro.cubic": 0.1,
         "gyro.asymmetry": 0.1, "gyro.g_sensitivity": 0.1}  # fmt: skip
"""What a test of the part says: these sizes are a tenth of the typical ones."""

PLACE = ("local gravity", "latitude", "common error of the headings")
"""What else makes the price, of place and rig."""

DEAR = 1.3
"""What a sheet, gravity and clock that are declared have to leave of a price, at most [1]."""

POWER = {
    "hand_rotated": "accel.quadratic", "ferraris": "gyro.g_sensitivity",
    "rate_table": "gyro.bias drift", "north_seeking": "gyro.g_sensitivity",
}  # fmt: skip
"""A group of three terms or nine, each of which this plan can show."""


def trial(case: Case, log: Any, sizes: Any, gravity_sd: float = 4e-4) -> Any:
    noise = case.sensors if case.procedure in DECLARED else None
    site = replace(SITE, gravity_sd=gravity_sd)
    return case.record.trial(log, site=site, settings=case.stated, sizes=sizes, noise=noise)


def shares(found: Any) -> dict[str, float]:
    """Return the largest share of each group in a variance."""
    table = found.tables["left_out"]
    return dict(zip(table["group"].tolist(), table["share"].tolist(), strict=True))


def most(runs: Sequence[Mapping[str, float]]) -> str:
    """Return the three groups that make most, and their mean share."""
    total = Counter[str]()
    for run in runs:
        total.update(run)
    return ", ".join(f"{group} {share / len(runs):.2f}" for group, share in total.most_common(3))


def priced(job: tuple[str, str, int]) -> tuple[list[float], dict[str, float], dict[str, float]]:
    """Return the median sd over that without sizes: with all, with each declaration, with both.

    Then what makes the first, and what makes the last.
    """
    which, name, seed = job
    case = replace(SESSIONS[which], grade=CLASSES[name], noise=grade(CLASSES[name]).noise)
    log, sizes = made(case, 40_000 + seed).log, sizes_of(name)
    sheet = {g: (s * SHEET.get(g, 1.0), b) for g, (s, b) in sizes.items()}
    plain = trial(case, log, None).coefficients.sd
    with_all = trial(case, log, sizes)
    declared = [
        trial(case, log, some, sd)
        for some, sd in ((sizes, SURVEYED), (sheet, 4e-4), (sheet, SURVEYED))
    ]
    out = [float(np.median(r.coefficients.sd / plain)) for r in (with_all, *declared)]
    budget = with_all.diagnostics["budget"]
    total = np.sum([np.array(v) for v in budget.values()], axis=0)
    largest = {n: float(np.max(np.array(v) / total)) for n, v in budget.items() if n in COUNT or
               n in PLACE}  # fmt: skip
    return out, largest, shares(declared[-1])


def named(job: tuple[str, str, int]) -> list[str]:
    """Return who is named in a clean session, or in one that holds a term as large as needed."""
    which, what, seed = job
    case, sizes = CASES[which], sizes_of(GRADES_OF[which])
    simulation = made(case, 50_000 + seed)
    log = simulation.log
    if what:
        needed = trial(case, log, sizes).diagnostics["left_out"][what]
        x = np.zeros(COUNT[what])
        # The most visible term of a group is the one that `needed` is about.
        x[int(np.argmax(visible(case, log, sizes, what)))] = needed["needed"] * sizes[what][0]
        held = Session(case, simulation, log, np.random.default_rng(0))
        amounts(held, {what: x})
        log = held.log
    return [n for causes in trial(case, log, sizes).diagnostics["named"] for n in causes]


def visible(case: Case, log: Any, sizes: Any, group: str) -> np.ndarray:
    """Return the share of each term of a group that the readings see."""
    from foucault.infer import left_out

    seen = []
    tested = left_out.tested
    left_out.tested = lambda at: seen.append(tested(at)) or seen[-1]
    try:
        trial(case, log, sizes)
    finally:
        left_out.tested = tested
    return np.diag(seen[0][group].V)


def main(
    clean: int = 1000, power: int = 200, price: int = 10, *only: str
) -> tuple[bool, dict[str, object]]:
    good, prices, names, powers = True, [], [], []
    wanted = [w for w in PROCEDURES if not only or w in only]
    cells = [cell for cell in CELLS if not only or cell[0] in only]
    tried = {w: g for w, g in POWER.items() if w in wanted}
    runs = list(each(priced, [(w, n, k) for w, n in cells for k in range(price)]))
    for k, (which, name) in enumerate(cells):
        mine = runs[k * price : (k + 1) * price]
        ratios = np.median([r[0] for r in mine], axis=0)
        dear = most([r[2] for r in mine]) if ratios[-1] > DEAR else ""
        prices.append(f"| {which} | {name} | " + " | ".join(f"{r:.2f}" for r in ratios)
                      + f" | {most([r[1] for r in mine])} | {dear} |")  # fmt: skip
    counts = dict.fromkeys(wanted, clean)
    counts |= {w: max(clean // k, 1) for w, k in FEWER.items() if not only or w in only}
    runs = list(each(named, [(w, "", k) for w, count in counts.items() for k in range(count)]))
    for which, count in counts.items():
        wrong, runs = [set(r) for r in runs[:count] if r], runs[count:]
        highest = binom.isf(0.005, count, 0.01)
        good &= len(wrong) <= highest
        said = Counter(n for r in wrong for n in r).most_common(3)
        words = ", ".join(f"{n} {c}" for n, c in said) or "nothing"
        names.append(f"| {which} | {count} | {len(wrong)} | {highest:.0f} | {words} |")
    runs = list(each(named, [(w, g, k) for w, g in tried.items() for k in range(power)]))
    for k, (which, group) in enumerate(tried.items()):
        right = sum(group in r for r in runs[k * power : (k + 1) * power])
        low, high = (f(0.005 / len(POWER), power, 0.9) for f in (binom.ppf, binom.isf))
        good &= low <= right
        powers.append(f"| {which} | {group} | {right} of {power} | {low:.0f} to {high:.0f} |")
    return good, {"prices": prices, "names": names, "powers": powers, "sessions": price}
