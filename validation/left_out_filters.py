"""The same of what navigates and of a tumble: right uncertainties, price, false names and power.

Sessions of a slave of tactical grade beside its master, of nineteen positions and of a tumble of
navigation grade, with all terms at their sizes put into the samples, and local gravity, lever arms,
delays, clocks and mount drawn by the simulators. A drift of the accelerometers' biases of seven
sizes has to be named, and one of its size as a report says that it has to be for nine of ten
sessions in so many.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from common import each, limits, must, word
from left_out import COUNT, put
from left_out_price import DEAR, SHEET, SURVEYED, most, shares
from scipy.stats import binom

from foucault import campaign, procedures
from foucault.campaign.running import Session
from foucault.diagnose.study import nees
from foucault.infer import left_out_states
from foucault.models.imu import ImuModel
from foucault.models.layouts import model_of
from foucault.models.left_out import Sizes, sizes_of, terms
from foucault.models.noise import grade
from foucault.result import Level

DRIFT, TIMES = "accel.bias drift", 7.0


class Kind(NamedTuple):
    """A procedure, and what of all is among what it estimates."""

    grade: str
    estimated: tuple[str, ...]
    shorter: dict[str, Any]  # of [simulate]


KINDS = {
    "transfer_alignment": Kind("tactical MEMS", (), {}),
    "systematic": Kind("navigation RLG", ("accel.asymmetry",), {"rate": 25.0, "rest_time": 60.0}),
    "platform_tumble": Kind("navigation RLG", ("accel.quadratic", "gyro.g_sensitivity"), {}),
}
NOTHING, ALL, SEVEN, POWER = (
    "nothing", "all at their sizes", "drift of accelerometer biases x 7", "as large as needed",
)  # fmt: skip
CASES = (NOTHING, ALL, SEVEN)


def amounts(case: str, kind: Kind, sizes: Sizes, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return what a case puts into the samples [SI]."""
    if case == SEVEN:
        return {DRIFT: TIMES * sizes[DRIFT][0] * rng.choice([-1.0, 1.0], 3)}
    some = COUNT if case == ALL else {}
    return {
        g: sizes[g][0] * rng.standard_normal(n) for g, n in some.items() if g not in kind.estimated
    }


@dataclass(frozen=True)
class Run:
    """What came of one session."""

    before: float  # NEES over n without sizes [1]
    after: float  # and with [1]
    count: int  # coefficients
    passed: bool  # with sizes
    failed: tuple[str, ...]  # checks that did not pass with sizes
    named: tuple[str, ...]  # sets of causes
    # median sd over that without sizes: with all, with each declaration, with both [1]
    price: tuple[float, ...] = ()
    # of each group in a variance: with all, and with both declarations [1]
    share: Mapping[str, float] | None = None
    dear: Mapping[str, float] | None = None


def one(job: tuple[str, str, int, bool]) -> Run:
    """Calibrate one session of a case; the last of `job`: whether its price is asked for too."""
    which, case, seed, asked = job
    kind, procedure = KINDS[which], procedures.load(which)
    c = campaign.parse(campaign.template(which))
    rng, sizes = np.random.default_rng([seed, 77]), sizes_of(kind.grade)
    noise = c.noise or procedure.noise or grade(procedure.grade).noise
    session, settings = c.session.model_copy(update=kind.shorter), c.settings
    model = procedure.draw_errors(procedure.grade, seed)
    if case == ALL:
        assert procedure.drawn is not None
        more = {g: s for g, s in procedure.always(settings).items() if g not in sizes}
        usual = {t.name: t.size * rng.standard_normal() for t in terms((), c.site, more)}
        model = model_of(model.coefficients().with_values(usual))
        session, settings, model = procedure.drawn(session, settings, model, rng)
    sim = procedure.simulate(
        session, settings=settings, model=model, noise=noise, site=c.site, seed=seed
    )
    log, site = put(sim.log, ImuModel(), amounts(case, kind, sizes, rng)), c.site
    if case == ALL:
        off = site.gravity_sd * float(rng.standard_normal())
        site = replace(site, gravity=site.gravity + off)
    known = Session(None, sim, seed).truth  # type: ignore[arg-type]

    def trial(given: Sizes | None, sd: float = site.gravity_sd) -> Any:
        return procedure.trial(
            log, site=replace(site, gravity_sd=sd), settings=c.settings, noise=noise,
            prior=c.prior, sizes=given,
        )  # fmt: skip

    def off_by(result: Any) -> float:
        found = result.coefficients
        err = found.values - known.chosen(found.names).values
        assert found.cov is not None
        return float(nees(err[None], found.cov[None])[0]) / len(err)

    if case == POWER:
        most: list[np.ndarray] = []
        tested = left_out_states.tested
        left_out_states.tested = lambda *given: most.append(  # type: ignore[assignment]
            np.diag((seen := tested(*given))[DRIFT].V)) or seen  # fmt: skip
        try:
            needed = trial(sizes).diagnostics["left_out"][DRIFT]["needed"]
        finally:
            left_out_states.tested = tested
        x = np.zeros(3)
        x[int(np.argmax(most[0]))] = needed * sizes[DRIFT][0]
        log = put(sim.log, ImuModel(), {DRIFT: x})
    plain, found = trial(None), trial(sizes)
    price, dear = tuple[float, ...](), None
    if asked:
        sheet = {g: (s * SHEET.get(g, 1.0), b) for g, (s, b) in sizes.items()}
        others = ((sizes, SURVEYED), (sheet, site.gravity_sd), (sheet, SURVEYED))
        every = [found, *(trial(some, sd) for some, sd in others)]
        price = tuple(float(np.median(r.coefficients.sd / plain.coefficients.sd)) for r in every)
        dear = shares(every[-1])
    return Run(
        off_by(plain), off_by(found), len(found.coefficients),
        found.verdict.level is Level.PASS,
        tuple(check.name for check in found.checks if not check.passed),
        tuple(" = ".join(causes) for causes in found.diagnostics["named"]), price,
        shares(found), dear,
    )  # fmt: skip


def words(said: Counter[str]) -> str:
    """Return what was said most often, and how often."""
    return ", ".join(f"{name} {count}" for name, count in said.most_common(3)) or "nothing"


def row(which: str, case: str, runs: list[Run]) -> tuple[str, bool]:
    """Return the line of a case, and whether it is as it must be."""
    sessions, n = len(runs), runs[0].count
    before, after = np.mean([(run.before, run.after) for run in runs], axis=0)
    low, high = limits(n * sessions, tests=2)
    passed = np.mean([run.passed for run in runs])
    said = Counter(name for run in runs for name in run.named)
    by_chance = sum(bool(run.named) for run in runs) <= binom.isf(0.005, sessions, 0.01)
    if case == ALL:
        good = low <= after <= high and by_chance and passed >= 0.9
    elif case == NOTHING:
        good = after <= high and by_chance
    else:
        good = said[DRIFT] == sessions
    failed = Counter(name for run in runs for name in run.failed)
    return (
        f"| {which} | {case} | {before:.3g} | {after:.3g} | {word(after <= high)} | "
        f"{100 * passed:.0f} % | {words(failed)} | {words(said)} | {must(bool(good))} |"
    ), bool(good)


def main(sessions: int = 20, price: int = 4, power: int = 30) -> tuple[bool, dict[str, object]]:
    jobs = [(w, c, k, c == NOTHING and k < price) for w in KINDS for c in CASES
            for k in range(sessions)]  # fmt: skip
    powers = [(w, POWER, k, False) for w in KINDS for k in range(power)]
    found = dict(zip([*jobs, *powers], each(one, [*jobs, *powers]), strict=True))
    shown, prices, named, good = [], [], [], True
    for which in KINDS:
        for case in CASES:
            line, fine = row(which, case, [found[j] for j in jobs if j[:2] == (which, case)])
            shown.append(line)
            good &= fine
        asked = [run for j, run in found.items() if j[0] == which and run.price]
        ratios = np.median([run.price for run in asked], axis=0)
        dear = most([run.dear for run in asked]) if ratios[-1] > DEAR else ""
        cells = " | ".join(f"{r:.2f}" for r in ratios)
        makers = most([run.share for run in asked])
        prices.append(f"| {which} | {KINDS[which].grade} | {cells} | {makers} | {dear} |")
        right = sum(any(DRIFT in name for name in found[j].named) for j in powers if j[0] == which)
        low, high = binom.ppf(0.005 / 3, power, 0.9), binom.isf(0.005 / 3, power, 0.9)
        good &= low <= right
        named.append(f"| {which} | {DRIFT} | {right} of {power} | {low:.0f} to {high:.0f} |")
    return good, {"sessions": sessions, "shown": shown, "prices": prices, "powers": named,
                  "priced": price}  # fmt: skip
