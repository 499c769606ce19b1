"""Solve a transfer alignment: passes of the Kalman filter, the H-infinity filter, the hand-over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.transfer.causes import BENDS
from foucault.diagnose.transfer.checks import Evidence
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.transfer.hand_over import HandOver, after_outage, hand_over
from foucault.estimate.transfer.likeliest import DelayFit, likeliest_delay, likeliest_flexure
from foucault.estimate.transfer.model import TransferFit
from foucault.infer import filtered
from foucault.infer.h_infinity import by_prior, h_infinity, least_gamma
from foucault.infer.linear_filter import LinearSmoothed, kalman, smoothed
from foucault.navigate.state import State
from foucault.procedures.transfer_alignment.input import stamp
from foucault.procedures.transfer_alignment.problem import TransferProblem, place_of
from foucault.procedures.transfer_alignment.settings import LEFT_OUT
from foucault.units import plain

SETTLED = 0.5
"""Passes have settled if the last moved nothing by more than this of its uncertainty [1]."""

STILL = 0.1
"""No further pass is made if the last moved nothing by more [1]."""


@dataclass(frozen=True)
class Solution(Evidence):
    """What was found."""

    problem: TransferProblem  # what was solved, the delay that it started from included
    # the fit of a Kalman filter: its covariance is the posterior Cramer-Rao bound
    kalman: TransferFit
    # gamma, least: bound of the H-infinity filter, and the least there is; infinite for a Kalman
    # filter [1]
    gamma: float
    least: float
    backward: LinearSmoothed | None  # the Kalman run as seen from its end, where wanted
    findings: list[Finding]  # what the user should know of how the passes ended


def solved(p: TransferProblem, *, history: bool) -> Solution:
    """Find the delay to start from, filter, and bound the filter where that is chosen."""
    settings = p.settings
    p, likeliest = _started(p)
    fit = filtered.fit(p.model, passes=settings.passes, settled=STILL)
    backward = None
    if history:
        kept = kalman(fit.system, keep=True)
        backward = smoothed(fit.system, kept)
    status, told = _settled(p, fit)
    chosen, gamma, least = _bounded(p, fit)
    return Solution(
        model=p.model, fit=chosen, prior=p.prior, status=status, delay=p.delay,
        longest=settings.longest_delay, likeliest=likeliest, aside=LEFT_OUT, problem=p, kalman=fit,
        gamma=gamma, least=least, backward=backward, findings=told,
    )  # fmt: skip


def ignoring_delay(s: Solution) -> Evidence:
    """Return the same, had the delay been ignored."""
    settings = s.problem.settings.model_copy(update={"gamma": None})
    p = replace(s.problem, settings=settings).with_delay(0.0)
    p = replace(p, model=p.model.without_delay())
    fit = filtered.fit(p.model, passes=settings.passes, settled=STILL)
    return replace(s, model=p.model, fit=_bounded(p, fit)[0])


def bent(p: TransferProblem) -> TransferProblem:
    """Return the problem with the bending that makes the innovations likeliest, if there is one."""
    if p.settings.matching == "velocity":
        return p
    s = solved(p, history=False)
    if s.status is not Status.CONVERGED:
        return p
    fit = likeliest_flexure(s.model, s.fit.point, s.fit.run.log_likelihood)
    if fit.gain < BENDS:
        return p
    return p.with_settings(p.settings.model_copy(update={
        "flexure_sd": fit.sd, "flexure_time": fit.time, "attitude_sd": fit.attitude_sd,
    }))  # fmt: skip


def gravity_error(s: Solution) -> FloatArray:
    """Return what one standard deviation of local gravity makes of `Solution.states`, shape (n,).

    A slave feels its weight and its bias alike: gravity believed too large is a bias too small.

    `s`: a transfer alignment solved [SI].
    """
    sd = s.problem.site.gravity_sd
    if not sd:
        return np.zeros(len(s.prior))
    names = s.model.names[s.model.first :]
    response = filtered.response(s.kalman, s.model.heavier(sd))
    return response[[names.index(name) for name in s.prior.names]]


def handed_over(s: Solution) -> HandOver:
    """Hand over where the master said that it was, the slave's lever arm away."""
    last = int(np.flatnonzero(s.fit.system.used)[-1])
    here = place_of(s.problem.table, last, s.model.mount.lever_m)
    position = State(*here, np.zeros(3), np.eye(3))
    return hand_over(s.model.slave, s.fit, s.problem.hand_over, position=position)


def _started(p: TransferProblem) -> tuple[TransferProblem, DelayFit | None]:
    """Start from the likeliest delay of the bracket, or from what a filter finds from its middle.

    Rate matching has found what it starts from otherwise.
    """
    s = p.settings
    if not s.estimates_delay or s.delay_method == "rate matching":
        return p, None
    if s.delay_method == "likelihood":
        early = p.with_delay(s.longest_delay).model.loose(s.longest_delay)
        likeliest = likeliest_delay(early.without_delay(), (0.0, s.longest_delay))
        return p.with_delay(likeliest.delay), likeliest
    far = p.model.loose(float(p.prior["master.delay"].prior_sd[0]))
    return p.with_delay(filtered.fit(far).values[far.names.index("master.delay") - far.first]), None


def _settled(p: TransferProblem, fit: TransferFit) -> tuple[Status, list[Finding]]:
    """Tell whether the last pass still moved something; what one pass has found, a second tells."""
    if not np.isfinite(fit.run.states).all():
        return Status.NOT_FINITE, []
    s, passes = p.settings, fit.passes
    if len(passes) < 2:
        passes = filtered.fit(p.model).passes
    if len(passes) < 2:  # the second went astray
        passes = (p.model.values(fit.point), *passes)
    moved = replace(fit, passes=passes).moved
    if float(moved.max()) < SETTLED:
        return Status.CONVERGED, []
    name = p.model.names[p.model.first + int(np.argmax(moved))]
    told = finding("transfer.unsettled", before=len(passes) - 1, after=len(passes), name=name,
                   moved=plain(float(moved.max()), 2), more=min(len(passes) + 3, 10),
                   passes="1 pass was" if s.passes == 1 else f"{s.passes} passes were")  # fmt: skip
    return Status.NOT_CONVERGED, [told]


def _bounded(p: TransferProblem, fit: TransferFit) -> tuple[TransferFit, float, float]:
    """Filter the last system again with a bound, where that is chosen; gamma and the least."""
    system, settings, layout = fit.system, p.settings, p.model.layout
    if settings.filter == "kalman":
        return fit, np.inf, np.inf
    if settings.wanted == "prior":
        # A free run's position is never measured, its vertical velocity only where that is matched:
        # bounding what grows without a bound would leave nothing of the bound for the others.
        unseen = (6, 7, 8) if p.model.matching.vertical else (5, 6, 7, 8)
        # Nor is anything wanted of what is only counted with.
        aside = [layout.index(n) for n in p.prior.names if n not in settings.reported]
        L = np.delete(by_prior(system), (*unseen, *aside), axis=0)
    else:
        L = after_outage(system, settings.sensors, settings.outage)
    least = least_gamma(system, L)
    gamma = settings.gamma_factor * least if settings.gamma is None else settings.gamma
    run = h_infinity(system, L, gamma)
    if run.stopped is not None:
        raise error("transfer.gamma", given=plain(gamma, 4), least=plain(least, 4),
                    time=stamp(float(system.time[run.stopped])))  # fmt: skip
    return replace(fit, run=run), gamma, least
