"""How many rests does a guided session take, and are its uncertainties right?

The uncertainty that is asked for is what 9 of 10 sessions of 24 fixed rests of 4 s reach, in the
worst coefficient of every group (and, for comparison, what half of them reach). Simulated
instruments are turned by somebody who obeys the guide, by somebody who often does not, and at
random, until every coefficient is known so well.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from common import each, limits, must

from foucault import campaign
from foucault.capture import ways
from foucault.capture.guide import Guide
from foucault.diagnose.study import nees
from foucault.logs.description import LogDescription
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import grade
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors
from make_guided import Operator, session

GRADE = "mems"
N = len(LINEAR_LOWER)
FIXED = 24
MOST = 90
USED = LogDescription.model_validate({
    "file": "live", "time": {"column": 0, "unit": "s"},
    "gyro": {"columns": [1, 2, 3], "unit": "rad/s"},
    "accel": {"columns": [4, 5, 6], "unit": "m/s^2"},
})  # fmt: skip

# name -> time to rest, how often something else is done, how often it is taken up early
ARMS = {
    "obeys, 7 s": (7.0, 0.0, 0.0), "obeys, 4 s": (4.0, 0.0, 0.0),
    "obeys badly, 7 s": (7.0, 0.35, 0.2), "random, 4 s": (4.0, 1.0, 0.0),
}  # fmt: skip


def asked() -> campaign.Campaign:
    """The campaign: noise declared, nothing left out, for the simulated instrument has nothing."""
    told = campaign.parse(campaign.template("hand_rotated"), "guided.toml")
    site = replace(told.site, gravity_sd=0.0)
    return replace(told, noise=grade(GRADE).noise, sizes=None, site=site)


class Unguided(Guide):
    """The same without a choice: what it asks for is not done anyway."""

    def _choose(self) -> None:
        if self.step is not None:
            self.step = replace(self.step, seconds=self.way.hold)


def fixed(seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """A session of 24 fixed rests: errors, covariance, duration."""
    told, model = asked(), draw_errors(GRADE, seed)
    made = hand_rotated.simulate(hand_rotated.Session(), model=model, noise=told.noise,
                                 site=told.site, seed=seed)  # fmt: skip
    found = ways.judge_of(hand_rotated.PROCEDURE, told)(made.log).coefficients
    error = found.values - model.coefficients(LINEAR_LOWER).values
    return error, found.cov, float(made.log.time[-1])


def guided(job: tuple[str, int, tuple[float, ...]]) -> tuple[Any, ...]:
    """A session until it is enough: rests, duration, errors, covariance, how it stopped."""
    name, seed, wanted = job
    hold, disobeys, hasty = ARMS[name]
    told, model = asked(), draw_errors(GRADE, seed)
    guide = ways.guide_of(ways.Asked(told, hold), USED)
    if disobeys == 1.0:
        guide.__class__ = Unguided
    guide.way.wanted.sd[:] = wanted
    operator = Operator(model, told.noise, told.site, np.random.default_rng([seed, 7]),
                        disobeys=disobeys, hasty=hasty)  # fmt: skip
    operator.sloppy = np.radians(12.0 if hasty else 4.0)
    moves = session(guide, operator, MOST)
    if guide.result is None:
        return moves, operator.time, None, None, "never"
    found = guide.result.coefficients
    error = found.values - model.coefficients(LINEAR_LOWER).values
    return moves, operator.time, error, found.cov, guide.stopped


def main(draws: int = 200, same: int = 200, others: int = 200) -> tuple[bool, dict[str, object]]:
    done = [*each(fixed, range(draws))]
    cov = np.array([d[1] for d in done])
    sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    groups = [n.rpartition(".")[0] for n in LINEAR_LOWER]
    half = np.empty(N)
    for group in set(groups):
        mine = [k for k, g in enumerate(groups) if g == group]
        half[mine] = np.median(sd[:, mine].max(axis=1))
    ratio = (sd / half).max(axis=1)
    wanted = {"9 of 10": half * np.quantile(ratio, 0.9), "half": half * np.median(ratio)}
    tests = len(ARMS) + 2
    good, shown, counts = True, list[str](), dict[tuple[str, str], float]()

    def row(name: str, level: str, rests: np.ndarray, time: float, rows: list) -> None:
        nonlocal good
        n = len(rows)
        low, high = limits(N * n, tests=tests)
        mean = float(nees(*(np.array(x) for x in zip(*rows, strict=True))).mean() / N)
        right = low <= mean <= high
        good &= right and n == len(rests)
        counts[name, level] = float(rests.mean())
        least, most = np.quantile(rests, [0.05, 0.95])
        shown.append(
            f"| {name} | {level} | {n} | {rests.mean():.1f} | {least:.0f} to {most:.0f} | "
            f"{time:.0f} s | {mean:.3f} ({low:.3f} to {high:.3f}) | {must(right)} |"
        )

    row(f"{FIXED} fixed, 4 s", "9 of 10", np.full(draws, FIXED),
        float(np.mean([d[2] for d in done])), [d[:2] for d in done])  # fmt: skip
    many = {"obeys, 7 s": draws, "obeys, 4 s": same}
    arms = [(name, "9 of 10", many.get(name, others)) for name in ARMS]
    arms.append(("obeys, 7 s", "half", others))
    jobs = [(name, 10_000 + k, tuple(wanted[level])) for name, level, n in arms for k in range(n)]
    found = iter([*each(guided, jobs)])
    for name, level, n in arms:
        rows = [next(found) for _ in range(n)]
        row(name, level, np.array([r[0] for r in rows]), float(np.mean([r[1] for r in rows])),
            [(r[2], r[3]) for r in rows if r[2] is not None])  # fmt: skip
    fewer = 1 - counts["obeys, 7 s", "9 of 10"] / FIXED
    good &= fewer >= 1 / 3
    return good, {
        "shown": shown, "fewer": 100 * fewer,
        "same": 100 * (1 - counts["obeys, 4 s", "9 of 10"] / FIXED),
        "random": counts["random, 4 s", "9 of 10"], "enough": must(fewer >= 1 / 3),
        "badly": counts["obeys badly, 7 s", "9 of 10"],
        "half": counts["obeys, 7 s", "half"],
    }  # fmt: skip
