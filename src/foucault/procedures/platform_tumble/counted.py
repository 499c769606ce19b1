"""What a tumble does not estimate and counts with: two stages of a filter, `procedures.counted`.

One size of a term put into the log changes the white residuals and the solution, linearly near it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.foresight import Extra
from foucault.errors import Status
from foucault.estimate import tumble as estimation
from foucault.estimate.tumble import STATES, Tumble
from foucault.estimate.tumble_answers import Change, Linear
from foucault.estimate.tumble_solution import Solution
from foucault.estimate.two_bodies import Answers
from foucault.infer.left_out import Judgement
from foucault.infer.left_out_states import Group, fit, noted, planned
from foucault.models.cluster import CONSTANTS, normalised
from foucault.models.imu import ImuModel
from foucault.models.left_out import GRAVITY, LATITUDE, Motion, Sizes, changes, terms
from foucault.procedures.counted import Stages
from foucault.procedures.left_out import declared_states
from foucault.procedures.platform_tumble.settings import OTHERWISE, SIZE_EFFECT
from foucault.tables import AXES

ROUNDS = 3  # Terms are found again so often at most [1].
SETTLED = 0.1  # What twice the log-likelihood of terms gains where they are found [1].

LEVER, DELAY = SIZE_EFFECT  # Groups of where accelerometers are, and how late.


@dataclass(frozen=True)
class Term(Change):
    """One size of a term, as a change of the log."""

    name: str = ""
    group: str = ""


def terms_of(t: Tumble, s: Solution, sizes: Sizes) -> Iterator[Term]:
    """Yield one size of all that is not estimated, at the readings of a log."""
    time = np.cumsum(t.dt)
    motion = Motion(time, t.reading * t.gravity, t.command, 0.0, float(time[-1]))
    some = {g: size for g, size in sizes.items() if g not in (*OTHERWISE, *SIZE_EFFECT)}
    weight = t.used[:, None] / t.gravity
    every = (terms(CONSTANTS.names, s.site, {g: size}) for g, size in some.items())
    # Six at a time: what they have in common is computed once, and little is held.
    for few in (mine[k : k + 6] for mine in every for k in range(0, len(mine), 6)):
        for term, by in zip(few, changes(few, ImuModel(), motion), strict=True):
            reading = None if by.accel is None else by.accel * weight
            yield Term(reading, by.gyro, name=term.name, group=term.group)
    w = t.command
    for i, k in np.ndindex(3, 3):
        # At the arm r [m] there is w x (w x r) more; these arms are where it is counted already.
        reading = np.zeros_like(t.reading)
        reading[:, i] = -(w[:, i] * w[:, k] - (i == k) * (w * w).sum(axis=1))
        reading *= sizes[LEVER][0] * weight
        yield Term(reading, name=f"{LEVER}.{AXES[i]}{AXES[k]}", group=LEVER)
    if not s.prior.sd[-1] > 0:
        yield Term(late=sizes[DELAY][0], name=DELAY, group=DELAY)


def stages_of(s: Solution, sizes: Sizes) -> tuple[Stages, FloatArray, FloatArray]:
    """Join what was found with what the log says of all that was not sought; return E and A too.

    One size of each term adds E (r, c) to the white residuals [1] and A (46, c) to the solution,
    in the order of `Fit.cov`.
    """
    t = s.tumble  # over longer averages slopes are too rough for what is left of a term
    some = list(terms_of(t, s, sizes))
    linear = Linear(t, s.prior, s.fit.start)
    e, (E, A) = linear.residuals, linear.answers(some)
    units = 1 / normalised(s.site.gravity)
    found = CoefficientVector(
        CONSTANTS, s.fit.start.constants * units,
        s.fit.cov[3:45, 3:45] * np.outer(units, units), prior_sd=s.prior.sd[3:45] * units,
    )  # fmt: skip
    told = Answers(float(e @ e), E.T @ e, E.T @ E, A[3:45] * units[:, None], len(e))
    mean = s.prior.mean.constants * units
    return Stages.of(found, some, sizes, told, np.zeros(1), mean), E, A


def counted(
    s: Solution, sizes: Sizes, *, measured: bool, moments: int
) -> tuple[Solution, Judgement] | None:
    """Count with what is not estimated, and enlarge what the readings contradict.

    `measured`: the noise of the accelerometers was measured: what is left without the terms says it
    better; `moments`: in how many moments the estimate is kept for its course in time [1]. Returns
    the solution of the log without what was found of the terms, and what was made of them; None
    where there is no solution, or one by a published filter, whose gains are its own.
    """
    if s.fit.status is not Status.CONVERGED or s.least is not None:
        return None
    sizes, p = {**SIZE_EFFECT, **sizes}, len(CONSTANTS)
    both, E, _ = stages_of(s, sizes)
    last, judged = fit(both.solved, both.posterior, both.groups, CONSTANTS.names)
    # An enlarged term or prior takes up what another Earth's rate would explain better.
    most = max((judged.seen[g].gain for some in judged.named for g in some), default=0.0)
    earth = s.earth_beside(E)
    asked = earth if earth is not None and earth.square > most else None
    changed = s.shift if judged.named else None
    if changed is not None and not (
        changed.seen and changed.found.square > most and None not in changed.kinds.values()
    ):
        changed = None  # what grows slowly is counted with
    assert last.cov is not None
    sd, known = s.prior.sd.copy(), last.prior_sd[p:] ** -2.0
    sd[3:45] *= last.prior_sd[:p] / both.states.prior_sd[:p]
    prior, start, times = replace(s.prior, sd=sd), s.fit.start, last.values[p:]
    # Without what was found of the terms residuals and checks are those of what was sought. Little
    # is left of what looks much like a term: they are found once more where that leads.
    tumble, found = s.tumble, s.fit
    for k in range(ROUNDS):
        less = s.tumble
        for one, many in zip(terms_of(s.tumble, s, sizes), times, strict=True):
            less = one.put(less, -float(many))
        again = estimation.solve(less, prior, start)
        if k and again.status is not Status.CONVERGED:
            break  # what was found before stands
        tumble, found = less, again
        linear = Linear(tumble, prior, found.start)
        E, A = linear.answers([*terms_of(tumble, s, sizes)])
        information = E.T @ E + np.diag(known)
        step = np.linalg.solve(information, E.T @ linear.residuals - known * times)
        if not float(step @ information @ step) >= SETTLED:
            break
        times, start = times + step, found.start
    # What of the readings the terms took up, they leave less of.
    absorbed = np.linalg.solve(np.linalg.cholesky(information), E[:-STATES].T).T
    if measured and found.status is Status.CONVERGED:
        scale = found.chi_square / max(found.residuals - p - float(np.sum(absorbed**2)), 1.0)
        absorbed = absorbed / np.sqrt(scale)
        tumble = replace(tumble, accel_variance=tumble.accel_variance * scale)
    found = estimation.linearised(tumble, prior, found, moments=moments)
    beside = A @ np.linalg.solve(information, A.T)
    blocks, width = found.rows.shape[:2]
    alike = blocks * width == len(absorbed)  # else the rows were averaged otherwise
    out = replace(
        s, tumble=tumble, prior=prior, fit=found, more={NOT_ESTIMATED: beside},
        asked=asked, changed=changed,
        absorbed=absorbed.reshape(blocks, width, -1) if alike else None,
    )  # fmt: skip
    return out, _with_references(judged, out)


def beforehand(s: Solution, sizes: Sizes) -> tuple[Solution, Judgement, tuple[Extra, ...]]:
    """Count with what is not estimated in a tumble that is only planned; `sizes`: of it [SI].

    Returns the solution with it, what is made of it, and what it would buy to know it better.
    """
    sizes = {**SIZE_EFFECT, **sizes}
    both, _, A = stages_of(s, sizes)
    at = both.posterior(both.states)
    judged = planned(at, both.groups, CONSTANTS.names)
    bought = declared_states(at, both.groups, judged, CONSTANTS.names)
    assert both.states.cov is not None
    C = both.states.cov[len(CONSTANTS) :, len(CONSTANTS) :]
    out = replace(s, more={NOT_ESTIMATED: A @ C @ A.T})
    return out, _with_references(judged, out), bought


def _with_references(judged: Judgement, s: Solution) -> Judgement:
    """Note what is known of the place, which has parts of its own in the budget."""
    total = s.coefficients.sd**2
    for name, size, basis in (
        (LATITUDE, s.latitude_sd, "latitude_sd"),
        (GRAVITY, s.site.gravity_sd, "standard uncertainty of local gravity"),
    ):
        if name in s.parts:
            share = float((np.diag(s.parts[name]) / total).max())
            judged = noted(judged, name, Group("source", (), size, basis), share)
    return judged


NOT_ESTIMATED = "what is not estimated"  # Their source in the budget.
