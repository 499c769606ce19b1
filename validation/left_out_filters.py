"""The same of what navigates and of a tumble: are uncertainties right with what is left out?

Sessions of a slave of tactical grade beside its master, of nineteen positions and of a tumble of
navigation grade, with all terms at their sizes put into the samples and local gravity and lever arm
drawn. The drift of the accelerometers' biases at seven sizes has to be named.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from common import limits, word
from left_out import put

from foucault import campaign, procedures
from foucault.campaign.running import Session
from foucault.diagnose.study import nees
from foucault.models.imu import ImuModel
from foucault.models.left_out import Sizes, sizes_of
from foucault.models.noise import grade

DRIFT, TIMES = "accel.bias drift", 7.0
COUNT = {
    "accel.quadratic": 3, "accel.cross": 15, "accel.asymmetry": 3, "gyro.g_sensitivity": 9,
    "gyro.asymmetry": 3, "gyro.cubic": 3, "gyro.deflection": 18, DRIFT: 3, "gyro.bias drift": 3,
    "accel.scale drift": 3, "gyro.scale drift": 3,
}  # fmt: skip


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
CASES = ("nothing", "all at their sizes", "drift of accelerometer biases x 7")


def amounts(case: str, kind: Kind, sizes: Sizes, rng: np.random.Generator) -> dict[str, Any]:
    """Return what a case puts into the samples [SI]."""
    if case == CASES[2]:
        return {DRIFT: TIMES * sizes[DRIFT][0] * rng.choice([-1.0, 1.0], 3)}
    some = COUNT if case == CASES[1] else {}
    return {
        g: sizes[g][0] * rng.standard_normal(n) for g, n in some.items() if g not in kind.estimated
    }


def one(which: str, case: str, seed: int) -> tuple[float, float, float, str]:
    """Return NEES per coefficient without sizes and with, their number, and who is named."""
    kind, procedure = KINDS[which], procedures.load(which)
    c = campaign.parse(campaign.template(which))
    session = c.session.model_copy(update=kind.shorter)
    rng, sizes = np.random.default_rng([seed, 77]), sizes_of(kind.grade)
    noise = c.noise or procedure.noise or grade(procedure.grade).noise
    site = c.site
    model = procedure.draw_errors(procedure.grade, seed)
    sim = procedure.simulate(
        session, settings=c.settings, model=model, noise=noise, site=site, seed=seed
    )  # fmt: skip
    log = put(sim.log, ImuModel(), amounts(case, kind, sizes, rng))
    if case == CASES[1]:
        off = site.gravity_sd * float(rng.standard_normal())
        site = replace(site, gravity=site.gravity + off)
    known = Session(None, sim, seed).truth  # type: ignore[arg-type]
    out: list[float] = []
    for given in (None, sizes):
        found = procedure.trial(
            log, site=site, settings=c.settings, noise=noise, prior=c.prior, sizes=given
        )
        err = found.coefficients.values - known.chosen(found.coefficients.names).values
        cov = found.coefficients.cov
        assert cov is not None
        out.append(float(nees(err[None], cov[None])[0]) / len(err))
    named = [next(iter(causes)) for causes in found.diagnostics["named"]]
    return out[0], out[1], float(len(err)), " and ".join(named)


def main(sessions: int = 10) -> tuple[bool, dict[str, object]]:
    shown, good = [], True
    for which in KINDS:
        for case in CASES:
            runs = [one(which, case, seed) for seed in range(sessions)]
            before, after, n = np.array([run[:3] for run in runs]).mean(axis=0)
            low, high = limits(int(n) * sessions, tests=2)
            said = Counter(run[3] for run in runs if run[3])
            if case == CASES[1]:
                good &= low <= after <= high and not said
            elif case == CASES[0]:
                good &= after <= high and not said
            else:
                good &= said[DRIFT] == sessions
            words = ", ".join(f"{name} {count}" for name, count in said.most_common(3))
            shown.append(
                f"| {which} | {case} | {before:.3g} | {after:.3g} | {word(after <= high)} | "
                f"{words or 'nothing'} |"
            )
    return good, {"sessions": sessions, "shown": shown}
