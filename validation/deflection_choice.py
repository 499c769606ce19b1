"""Do gyros bend, and by which model? How often the answer is wrong, over simulated sessions."""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from common import word
from scipy.stats import binom, kstest

from foucault.diagnose import deflection
from foucault.diagnose.deflection import UNIT, Choice, Told
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models.deflection import deflection_model
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures.systematic import choice as systematic_choice
from foucault.procedures.systematic import simulate
from foucault.procedures.systematic.problem import problem_of
from foucault.procedures.systematic.settings import PRIOR, Session, Settings, draw_errors

NULLS, FEW, RUNS, DRAWS = 500, 30, 100, 400
REST = 60.0
UG = 9.80665e-6
SITE = Site.at(np.radians(40), 100.0)
NOISE = ImuNoise(TriadNoise(white=5 * UG), TriadNoise(white=np.radians(0.0007) / 60))
SIMPLE = ("19 positions", "spins, simple 6")
BOTH = (*SIMPLE, "spins, icosahedral 6")
RIGID = np.full((3, 3, 3), 1e-30)  # no deflection, said so that none is drawn


@dataclass(frozen=True)
class Case:
    """One kind of session: how the gyros bend, what else is wrong, what the filter is told."""

    words: str
    truth: str = ""
    chirality: int = -1
    sequence: tuple[str, ...] = SIMPLE
    velocity_sd: float = 1e-4
    quadratic: float = 0.0
    arms: float = 0.0
    start: int = 0

    @property
    def label(self) -> str:
        """The right model, as the choice calls it."""
        model = deflection_model(self.truth, self.chirality)
        return (
            f"{self.truth}, chirality {self.chirality}" if self.truth == "coupled6" else model.name
        )


CONDITIONS = (
    Case("velocity_sd = 0.01 mm/s", velocity_sd=1e-5, start=10_000),
    Case("velocity_sd = 1 mm/s", velocity_sd=1e-3, start=10_000),
    Case("accelerometer quadratic of 12 ug/g^2, not estimated", quadratic=12.0, start=20_000),
    Case("accelerometers 3 cm apart, not estimated", arms=0.03, start=30_000),
)
TRUTHS = tuple(
    Case(f"{truth}{c:+d}", truth, c, sequence, start=40_000 + 1000 * k)
    for k, (sequence, truth, c) in enumerate((
        (SIMPLE, "coupled6", -1), (SIMPLE, "coupled6", 1), (SIMPLE, "direct6", -1),
        (BOTH, "coupled6", -1), (BOTH, "coupled6", 1), (BOTH, "direct6", -1),
    ))
)  # fmt: skip


def sizes(rng: np.random.Generator, n: int) -> np.ndarray:
    """Draw parameters of 1 to 3 arcsec/g of either sign."""
    return rng.uniform(1.0, 3.0, n) * rng.choice([-1.0, 1.0], n) * UNIT


def session(case: Case, seed: int):
    """Simulate one session of a case."""
    settings = Settings(sequence=case.sequence, deflection="choose", velocity_sd=case.velocity_sd)
    model = replace(draw_errors("navigation", seed), deflection=RIGID)
    if case.truth:
        bent = deflection_model(case.truth, case.chirality)
        theta = sizes(np.random.default_rng([seed, 1]), len(bent))
        model = replace(model, deflection=bent.tensor(theta))
    if case.quadratic:
        square = np.array([1.0, -1.0, 1.0]) * case.quadratic * UG / 9.80665**2
        model.accel_quadratic[range(3), range(3)] = square
    plan = Session(rest_time=REST, arms=case.arms)
    made = simulate(plan, settings=settings, model=model, noise=NOISE, site=SITE, seed=seed)
    return settings, made.log


def one(case: Case, k: int) -> Choice:
    """Choose a model for session number k of a case."""
    settings, log = session(case, case.start + k)
    problem = problem_of(log, SITE, settings, NOISE, {})
    return systematic_choice.choice_of(problem, settings, {})[0]


def information(case: Case) -> np.ndarray:
    """Return what the first session of a case says of all bendings, shape (18, 18)."""
    settings, log = session(case, case.start)
    problem = problem_of(log, SITE, settings, NOISE, {})
    _, begun, first, base = systematic_choice.choice_of(problem, settings, {})
    return systematic_choice.told(begun, first, base, {}).information


def linear(case: Case, J: np.ndarray, size: float | None = None) -> list[Choice]:
    """Choose over linear and Gaussian draws; parameters of `size`, or as in `sizes`."""
    values, vectors = np.linalg.eigh(J)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    B = deflection.in_general(deflection_model(case.truth, case.chirality))
    rng, out = np.random.default_rng(0), []
    for _ in range(DRAWS):
        theta = sizes(rng, B.shape[1])
        if size is not None:
            theta = size * UNIT * rng.standard_normal(B.shape[1])
        told = Told(J, J @ (B @ theta) + root @ rng.standard_normal(18))
        choice = deflection.judged(told, {"deflection": PRIOR["deflection"]})
        out.append(replace(choice, used=deflection.chosen(choice)))
    return out


def label_of(choice: Choice) -> str:
    """Return the model that is used."""
    return "none" if choice.used is None else choice.used.label


def sure(choice: Choice) -> bool:
    """Return whether one model is used and no other is at all likely."""
    return choice.used is not None and choice.shares[choice.used.label] > 1 - FALSE_ALARM


def many(pool, case: Case, n: int) -> list[Choice]:
    """Run many sessions of a case."""
    out = []
    for done, choice in enumerate(pool.imap(partial(one, case), range(n)), 1):
        out.append(choice)
        print(f"\r{case.words}: {done} of {n}   ", end="", flush=True)
    print()
    return out


def nulls(some: list[Choice]) -> tuple[list[str], bool]:
    """Write how often something is seen where nothing is."""
    n = len(some)
    alarms, limit = sum(c.bends for c in some), int(binom.ppf(0.99, n, FALSE_ALARM))
    chosen = sum(c.used is not None for c in some)
    fine = alarms <= limit
    lines = [
        f"## {n} sessions without deflection", "",
        f"Deflection was seen in {alarms} ({100 * alarms / n:.1f} %), at a stated rate of at most "
        f"{100 * FALSE_ALARM:g} % ({limit} or fewer, at 1 %); a model was used in {chosen}. Twice "
        "the gain in log-likelihood by each model, over its degrees of freedom; the limits hold "
        "for its mean (two-sided, 1 %), p is of the test of Kolmogorov and Smirnov that it is "
        "chi-square.", "",
        "| model | seen | mean | limits | beyond its own 1 % | p |", "|---|--:|--:|---|--:|--:|",
    ]  # fmt: skip
    for k, c in enumerate(some[0].candidates):
        rank = np.array([s.candidates[k].rank for s in some])
        square = np.array([s.candidates[k].square for s in some])
        chance = np.array([s.candidates[k].chance for s in some])
        low, high = np.array(chi_square_limits(rank.sum(), FALSE_ALARM)) / rank.sum()
        fine &= square.sum() / rank.sum() < high
        seen = f"{rank.mean():.1f} of {len(c.model)}"
        cells = (c.label, seen, f"{square.sum() / rank.sum():.3f}", f"{low:.3f} to {high:.3f}",
                 f"{100 * np.mean(chance < FALSE_ALARM):.1f} %",
                 f"{kstest(chance, 'uniform').pvalue:.2f}")  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    bound = [min(c.bound for c in s.candidates) / UNIT for s in some]
    failed = sum(replace(s, used=s.candidates[0]).beaten for s in some)
    fine &= failed <= limit
    lines += [
        "", "No coefficient of the best seen model is above "
        f"{np.median(bound):.2f} arcsec/g at 95 %, as the median session says. "
        'Had deflection = "coupled6" been named, the check '
        f"`deflection` would have failed in {failed}.",
    ]  # fmt: skip
    return lines, fine


def conditions(runs: dict[Case, list[Choice]]) -> list[str]:
    """Write what other settings and errors that are not estimated do to the test."""
    lines = []
    for case, some in runs.items():
        first = [s.candidates[0] for s in some]
        mean = sum(c.square for c in first) / sum(c.rank for c in first)
        seen = sum(s.bends for s in some)
        lines.append(f"| {case.words} | {len(some)} | {seen} | {mean:.3f} |")
    return lines


def between(
    runs: dict[Case, list[Choice]], told: dict[Case, list[Choice]]
) -> tuple[list[str], bool]:
    """Write how often the right model is chosen."""
    lines = []
    fine = True
    for case, some in runs.items():
        wrong = [s for s in some if label_of(s) != case.label]
        both = sum(sure(s) and not s.beaten for s in wrong)
        failed = sum(s.used is not None and s.beaten for s in some)
        said = np.mean([s.shares[case.label] for s in some])
        whole = next(c.whole for c in some[0].candidates if c.label == case.label)
        missed = np.mean([label_of(s) != case.label for s in told[case]])
        cells = ("simple" if case.sequence == SIMPLE else "both", case.label,
                 word(whole), str(len(some)), str(len(some) - len(wrong)),
                 str(len(wrong)), str(sum(map(sure, some))), str(both), str(failed),
                 f"{100 * said:.0f} %", f"{100 * missed:.1f} %")  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
        fine &= both <= binom.ppf(0.99, len(some), FALSE_ALARM)
        if case.sequence == BOTH:
            fine &= len(wrong) <= binom.ppf(0.99, len(some), FALSE_ALARM)
    return lines, fine


def small(cases: list[tuple[Case, np.ndarray]]) -> list[str]:
    """Write what becomes of small deflections, over draws."""
    lines = []
    for case, J in cases:
        for size in (0.0, 0.1, 0.3, 1.0, 3.0):
            some = linear(case, J, size)
            wrong = [s for s in some if label_of(s) != case.label]
            counts = (
                sum(s.bends for s in some), len(some) - len(wrong),
                sum(sure(s) and not s.beaten for s in wrong),
                sum(s.used is not None and s.beaten for s in some),
            )  # fmt: skip
            cells = ("simple" if case.sequence == SIMPLE else "both", case.label, f"{size:g}",
                     *(f"{100 * n / DRAWS:.1f} %" for n in counts))  # fmt: skip
            if size == 0.0:
                cells = (*cells[:4], "", *cells[5:])
            lines.append(f"| {' | '.join(cells)} |")
    return lines


def main(share: float = 1.0) -> tuple[bool, dict[str, object]]:
    with multiprocessing.Pool(2) as pool:
        rigid = many(pool, Case("no deflection"), max(2, round(share * NULLS)))
        other = {c: many(pool, c, max(2, round(share * FEW))) for c in CONDITIONS}
        bent = {c: many(pool, c, max(2, round(share * RUNS))) for c in TRUTHS}
        J = dict(zip(TRUTHS, pool.map(information, TRUTHS), strict=True))
    minutes = {s: session(Case("", sequence=s), 0)[1].time[-1] / 60 for s in (SIMPLE, BOTH)}
    first, kept = nulls(rigid)
    chosen, right = between(bent, {c: linear(c, J[c]) for c in TRUTHS})
    return kept and right, {
        "rest": REST,
        "simple": minutes[SIMPLE],
        "both": minutes[BOTH],
        "first": first,
        "conditions": conditions(other),
        "draws": DRAWS,
        "chosen": chosen,
        "small": small([(c, J[c]) for c in TRUTHS if c.chirality == -1]),
    }
