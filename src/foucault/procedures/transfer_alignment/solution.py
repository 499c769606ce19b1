"""Solve a transfer alignment: passes of the Kalman filter, the H-infinity filter, the hand-over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.transfer.causes import BENDS
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.h_infinity import by_prior, h_infinity, least_gamma
from foucault.estimate.linear_filter import LinearSmoothed, kalman, smoothed
from foucault.estimate.transfer.fit import (
    DelayFit,
    HandOver,
    Transfer,
    hand_over,
    likeliest_delay,
    solve,
)
from foucault.estimate.transfer.flexure import likeliest_flexure
from foucault.estimate.transfer.outage import after_outage
from foucault.estimate.transfer.system import free_run
from foucault.models.transfer import states_of_transfer
from foucault.navigate.state import State
from foucault.procedures.transfer_alignment.input import stamp
from foucault.procedures.transfer_alignment.problem import TransferProblem, place_of
from foucault.procedures.transfer_alignment.settings import Settings
from foucault.units import plain

SETTLED = 0.5
"""Passes have settled if the last moved nothing by more than this of its uncertainty [1]."""

STILL = 0.1
"""No further pass is made if the last moved nothing by more [1]."""


@dataclass(frozen=True)
class Solution:
    """What was found."""

    problem: TransferProblem  # what was solved, the delay that it started from included
    found: Transfer  # the last pass; the filter that was chosen
    # coefficients and what is found besides, at the last message, with covariance [SI]
    states: CoefficientVector
    # `states` by a Kalman filter: the posterior Cramer-Rao bound of a linear system is its
    # covariance [SI]
    kalman: CoefficientVector
    handed: HandOver  # the slave as it goes on alone
    fit: DelayFit | None  # the likeliest delay, where it was looked for
    # gamma, least: bound of the H-infinity filter, and the least there is; infinite for a Kalman
    # filter [1]
    gamma: float
    least: float
    backward: LinearSmoothed | None  # the Kalman run as seen from its end, where wanted
    status: Status  # how the passes ended
    findings: list[Finding]  # what the user should know of that

    @property
    def nominal(self) -> bool:
        """Whether the filter is a Kalman filter, whose covariance is that of its error."""
        return not np.isfinite(self.gamma)


def solved(p: TransferProblem, *, history: bool) -> Solution:
    """Find the delay to start from, filter, and hand over."""
    settings, fit = p.settings, None
    if settings.estimates_delay and settings.delay_method == "likelihood":
        p, fit = _likeliest(p)
    elif settings.estimates_delay and settings.delay_method == "state":
        p = _as_state(p)
    found = solve(p.slave, p.master, settings.mount, settings.matched, p.prior, p.sd,
                  passes=settings.passes, settled=STILL)  # fmt: skip
    backward = None
    if history:
        kept = kalman(found.free.system, keep=True)
        backward = smoothed(found.free.system, kept)
        found = replace(found, run=replace(kept, before=kept.before[:0]))
    status, told = _settled(p, found)
    by_kalman, gamma, least = _states(p, found), np.inf, np.inf
    if settings.filter == "h_infinity":
        found, gamma, least = _bounded(p, found, settings)
    states = _states(p, found)
    return Solution(p, found, states, by_kalman, _handed(p, found), fit, gamma, least, backward,
                    status, told)  # fmt: skip


def bent(s: Solution, settings: Settings) -> Settings:
    """Return the settings with the bending that makes the innovations likeliest, if there is one.

    `s`: a transfer alignment solved [SI].
    """
    p, found = s.problem, s.found
    if settings.matching == "velocity" or s.status is not Status.CONVERGED:
        return settings
    fit = likeliest_flexure(p.slave, p.master, settings.mount, settings.matched, found.at, p.prior,
                            p.sd, found.free.layout, s.found.run.log_likelihood)  # fmt: skip
    if fit.gain < BENDS:
        return settings
    return settings.model_copy(update={
        "flexure_sd": fit.sd, "flexure_time": fit.time, "attitude_sd": fit.attitude_sd,
    })  # fmt: skip


def gravity_error(s: Solution) -> FloatArray:
    """Return what one standard deviation of local gravity makes of `Solution.states`, shape (n,).

    A slave feels its weight and its bias alike: gravity believed too large is a bias too small.

    `s`: a transfer alignment solved [SI].
    """
    p, settings = s.problem, s.problem.settings
    sd = p.site.gravity_sd
    if not sd:
        return np.zeros(len(s.states))
    heavier = replace(p.slave, gravity_offset=p.slave.gravity_offset + sd)
    at = s.found.at
    free = free_run(heavier, p.master, settings.mount, settings.matched, at, p.prior, p.sd)
    other = replace(s.found, free=free, run=kalman(free.system))
    return _states(p, other).values - s.kalman.values


def _likeliest(p: TransferProblem) -> tuple[TransferProblem, DelayFit]:
    """Start from the likeliest delay of the bracket."""
    s = p.settings
    fixed = replace(s.matched, delay=False)
    layout = states_of_transfer(s.sensors, s.mount, s.matched, p.slave.noise)
    early = p.with_delay(s.longest_delay)
    sd = np.delete(early.loose(s.longest_delay), layout.index("master.delay"))
    fit = likeliest_delay(early.slave, p.master, s.mount, fixed, early.prior, sd,
                          (0.0, s.longest_delay))  # fmt: skip
    return p.with_delay(fit.delay), fit


def _as_state(p: TransferProblem) -> TransferProblem:
    """Start from the delay that a filter finds from the middle of the bracket."""
    s = p.settings
    at = p.vector.layout.index("master.delay")
    far = p.loose(float(p.vector.prior_sd[at]))
    found = solve(p.slave, p.master, s.mount, s.matched, p.prior, far, passes=2)
    return p.with_delay(float(found.estimate["master.delay"].values[0]))


def _settled(p: TransferProblem, found: Transfer) -> tuple[Status, list[Finding]]:
    """Tell whether the last pass still moved something; what one pass has found, a second tells."""
    if not np.isfinite(found.run.states).all():
        return Status.NOT_FINITE, []
    s, passes = p.settings, found.passes
    if len(passes) < 2:
        passes = solve(p.slave, p.master, s.mount, s.matched, p.prior, p.sd, passes=2).passes
    if len(passes) < 2:  # the second went astray
        passes = (found.point, *passes)
    moved = np.abs(passes[-1] - passes[-2]) / found.run.sd[-1, 9:]
    if float(moved.max()) < SETTLED:
        return Status.CONVERGED, []
    name = found.free.layout.names[9 + int(np.argmax(moved))]
    told = finding("transfer.unsettled", before=len(passes) - 1, after=len(passes), name=name,
                   moved=plain(float(moved.max()), 2), more=min(len(passes) + 3, 10),
                   passes="1 pass was" if s.passes == 1 else f"{s.passes} passes were")  # fmt: skip
    return Status.NOT_CONVERGED, [told]


def _bounded(
    p: TransferProblem, found: Transfer, settings: Settings
) -> tuple[Transfer, float, float]:
    """Filter the last system again, with a bound."""
    system = found.free.system
    if settings.wanted == "prior":
        # A free run's position is never measured, its vertical velocity only where that is matched:
        # bounding what grows without a bound would leave nothing of the bound for the others.
        unseen = (6, 7, 8) if settings.matched.vertical else (5, 6, 7, 8)
        # Nor is anything wanted of what is only counted with.
        layout = found.free.layout
        aside = [layout.index(n) for n in p.vector.names if n not in settings.reported]
        L = np.delete(by_prior(system), (*unseen, *aside), axis=0)
    else:
        L = after_outage(found.free, settings.sensors, settings.outage)
    least = least_gamma(system, L)
    gamma = settings.gamma_factor * least if settings.gamma is None else settings.gamma
    run = h_infinity(system, L, gamma)
    if run.stopped is not None:
        raise error("transfer.gamma", given=plain(gamma, 4), least=plain(least, 4),
                    time=stamp(float(found.free.time[run.stopped])))  # fmt: skip
    return replace(found, run=run), gamma, least


def _states(p: TransferProblem, found: Transfer) -> CoefficientVector:
    """Return what was found of `p.vector`: a bending that comes and goes is not part of it."""
    made = found.estimate.chosen(p.vector.names)
    return replace(made, prior_sd=p.vector.prior_sd)


def _handed(p: TransferProblem, found: Transfer) -> HandOver:
    """Hand over where the master said that it was, the slave's lever arm away."""
    last = int(np.flatnonzero(found.free.used)[-1])
    here = place_of(p.table, last, p.settings.mount.lever_m)
    position = State(*here, np.zeros(3), np.eye(3))
    return hand_over(p.slave, found, p.hand_over, position=position)
