"""Gauss-Newton over a tumble: the linearised filter, repeated about its own estimate.

A pass of `kernels.cluster_information` about the trajectory of the present estimate gives the
information of attitude at the start, constants and delay, whatever gyro noise does to the attitude
on the way. With the prior, kept at its own mean, the step x solves

    (N + G) x = g + n,       N, n: information and gradient of the prior

and the next pass starts from there. All is in units of the prior's sd. The attitude is a rotation
matrix, the step of it a rotation vector: no attitude is singular.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015 (the measurement and its single-pass filter).
.. [2] B. M. Bell, F. W. Cathey, "The iterated Kalman filter update as a Gauss-Newton method",
   IEEE Trans. Automatic Control 38(2), 1993.
.. [3] B. Friedland, "Treatment of bias in recursive filtering", IEEE Trans. Automatic Control
   14(4), 1969 (the two stages).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Status
from foucault.estimate.tumble.one_pass import NO_MOMENTS, Pass, look, solve_step
from foucault.estimate.tumble.path import attitudes, beginning, levelled, sensitivities
from foucault.estimate.tumble.state import DELAY_UNIT, STATES, Prior, State, Tumble
from foucault.kernels.cluster_information import RESIDUAL
from foucault.models.rotation import exp

__all__ = [
    "STATES", "Fit", "History", "Prior", "State", "Tumble", "attitudes", "beginning", "bound",
    "levelled", "linearised", "sensitivities", "solve",
]  # fmt: skip

SETTLED = 0.05
"""A step shorter than this, in units of its standard deviation, is the last [1]."""

ROUGH = 100.0
"""Passes over long averages end with a step shorter than this, in units of its sd [1]."""

ABSURD = 1e3
"""Where a run that did not settle came so far from the prior, in its sd, nothing was learnt [1]."""

FAR = np.radians(3.0)
"""Most that the cluster may turn in one of these averages [rad]."""


@dataclass(frozen=True)
class History:
    """The estimate as it was after part of the log, linearised about the final trajectory."""

    time: FloatArray  # (c,) since the start [s]
    # (c, 46) attitude then (rotation vector in p, truth ahead of `C_np`) [rad], constants minus the
    # final ones [packed], delay minus the final one [s]
    step: FloatArray
    sd: FloatArray  # (c, 46) standard deviations of the same
    C_np: FloatArray  # (c, 3, 3) attitude of the final trajectory [1]


@dataclass(frozen=True)
class Fit:
    """A tumble solved."""

    start: State  # estimate: attitude at the start, constants, delay
    C_np: FloatArray  # (3, 3) attitude at the end [1]
    # (46, 46) covariance of attitude at the end (rotation vector in p) [rad], constants [packed],
    # delay
    cov: FloatArray
    start_cov: FloatArray  # (46, 46) the same with the attitude at the start (rotation vector in n)
    status: Status
    passes: int  # passes over the log [1]
    chi_square: float  # sum of squares of the white residuals, the prior's not counted [1]
    residuals: int  # number of white residuals, the prior's not counted [1]
    # (46, 46) of the data alone about `start`, in units of 1 / sd of the prior [1]
    information: FloatArray
    orthogonal: bool  # whether the condition made reflections necessary
    # where the delay is held: what it should be more, and the sd of that [s]
    late: tuple[float, float] = (0.0, 0.0)
    history: History | None = None  # the estimate in the course of time
    # (blocks, 3, 47) or (0, 3, 47) white rows at the last pass: sensitivities by x / sd of the
    # prior, then the residual
    rows: FloatArray = field(default_factory=lambda: np.zeros((0, 3, STATES + 1)))
    # (blocks,) time of these rows since the start [s]
    time: FloatArray = field(default_factory=lambda: np.zeros(0))


def solve(
    tumble: Tumble,
    prior: Prior,
    start: State | None = None,
    *,
    passes: int = 20,
) -> Fit:
    """Find attitude, constants and delay of a tumble.

    `start`: where to begin, None: where `levelled` says; `passes`: at most so many passes over
    the log [1].
    """
    at, used = start or levelled(tumble, prior), 0
    rough = rougher(tumble)
    if rough is not None and passes > 2:
        best, used = _descend(rough, prior, at, passes - 2, ROUGH)
        if best.finite:
            at = best.at.moved(_stepped(prior, best.x))
    best, more = _descend(tumble, prior, at, passes - used, SETTLED)
    settled = best.length < SETTLED * best.scatter
    status = Status.CONVERGED if settled else Status.NOT_CONVERGED
    if not best.finite:
        return _lost(tumble, prior, used + more, Status.NOT_FINITE)
    if status is Status.NOT_CONVERGED:
        away = (best.at.constants - prior.mean.constants) / prior.unit[3:45]
        if np.abs(away).max() > ABSURD:
            return _lost(tumble, prior, used + more, status)
        best = replace(best, x=np.zeros(STATES))  # where the next step leads nobody has seen
    return _fit(tumble, prior, best, status, used + more)


def _descend(t: Tumble, prior: Prior, at: State, passes: int, enough: float) -> tuple[Pass, int]:
    """Repeat passes, steps shortened where they lead uphill, until one is short `enough`."""
    final = enough <= SETTLED
    best = look(t, prior, at, rows=final)
    used, share = 1, 1.0
    while best.finite and best.length >= enough * (best.scatter if final else 1.0):
        if used >= passes or share < 0.01:
            break
        there = best.at.moved(_stepped(prior, share * best.x))
        new = look(t, prior, there, rows=final)
        used += 1
        if new.finite and new.cost <= best.cost * (1 + 1e-9) + 1e-6:
            best, share = new, 1.0
        else:
            share *= 0.4
    return best, used


def rougher(t: Tumble) -> Tumble | None:
    """Return the log with longer averages, which costs less and leads as near; None if it cannot.

    `t`: the log. Slopes are taken at the middle of an average, in which it must not turn far.
    """
    turn = float(np.linalg.norm(t.command, axis=1).max() * np.median(t.dt))
    block = min(10 * t.block, int(FAR / max(turn, 1e-12)), len(t.dt) // 200)
    if block < 2 * t.block:
        return None
    return _merged(replace(t, block=block, shared=0.0))


def _merged(t: Tumble) -> Tumble:
    """Put intervals of one command together: few intervals, their readings one mean."""
    change = np.flatnonzero((np.diff(t.command, axis=0) != 0).any(axis=1))
    m = min(int(change[0]) + 1 if len(change) else 1, t.block)
    n, h = len(t.dt) // max(m, 1), float(t.dt[0])
    command = t.command[: n * m].reshape(n, m, 3)
    even = bool(np.abs(t.dt - h).max() < 1e-6 * h)
    if m < 2 or not even or (command != command[:, :1]).any():
        return t
    used: npt.NDArray[np.bool_] = np.asarray(t.used[: n * m].reshape(n, m).all(axis=1))
    # Readings at the ends of m intervals are on the average half of one younger than a mean.
    late = t.late if t.mean else t.late - 0.5 * h
    return replace(
        t, dt=np.full(n, m * h), command=np.ascontiguousarray(command[:, 0]), used=used,
        reading=t.reading[: n * m].reshape(n, m, 3).mean(axis=1), mean=True, late=late,
        accel_variance=t.accel_variance / m, block=max(1, t.block // m),
    )  # fmt: skip


def linearised(tumble: Tumble, prior: Prior, fit: Fit, *, moments: int = 0) -> Fit:
    """Return a solution linearised once more about itself, with its course in time.

    `moments`: in how many moments the estimate is kept for its history [1].
    """
    best = look(tumble, prior, fit.start, _moments(tumble, moments), True)
    if not best.finite:
        return fit
    if fit.status is not Status.CONVERGED:
        best = replace(best, x=np.zeros(STATES))
    return _fit(tumble, prior, best, fit.status, fit.passes)


def bound(
    tumble: Tumble, prior: Prior, truth: State, *, moments: int = 0, rows: bool = False
) -> Fit:
    """Return the Cramer-Rao bound: what a log tells about its unknowns, linearised at the truth.

    `truth`: what is true, or as good as that; `moments`: in how many moments it is kept for its
    course in time [1].
    """
    best = look(tumble, prior, truth, _moments(tumble, moments), rows)
    best = replace(best, x=np.zeros(STATES))
    return _fit(tumble, prior, best, Status.CONVERGED, 1)


def _stepped(prior: Prior, x: FloatArray) -> FloatArray:
    return np.asarray(x * prior.sd)


def _moments(t: Tumble, n: int) -> IntArray:
    """Return samples, early ones closer together, after which the estimate is kept."""
    if n == 0:
        return NO_MOMENTS
    N = len(t.dt)
    return np.unique((np.linspace(0.02, 1, n) ** 1.5 * (N - 1)).astype(np.int64))


def _ahead(Y: FloatArray, P: FloatArray, x: FloatArray, cov: FloatArray) -> tuple[FloatArray, ...]:
    """Return the attitude step in i, shape (3,), and the covariance with it for the start's."""
    psi = Y[:, :STATES] @ x - Y[:, RESIDUAL]
    map_ = np.eye(STATES)
    map_[:3] = Y[:, :STATES]
    joint = map_ @ cov @ map_.T
    joint[:3, :3] += P
    return psi, joint


def _fit(t: Tumble, prior: Prior, best: Pass, status: Status, used: int) -> Fit:
    Y, P, C_ip = (best.out[k][0] for k in (1, 2, 3))
    psi, joint = _ahead(Y, P, best.x, best.cov)
    C_in = exp(t.w_ie_n * t.dt.sum())
    C_np = C_in.T @ exp(psi) @ C_ip
    scale = prior.sd.copy()
    resolved = np.diag(scale)
    resolved[:3, :3] = (C_in @ C_np).T
    square = best.gram[RESIDUAL, RESIDUAL] - 2 * best.gram[:STATES, RESIDUAL] @ best.x
    square += best.x @ best.gram[:STATES, :STATES] @ best.x
    start = best.at.moved(_stepped(prior, best.x))
    _, slope = prior.rows(start)
    return Fit(
        start=start,
        C_np=C_np,
        cov=resolved @ joint @ resolved.T,
        start_cov=best.cov * np.outer(scale, scale),
        status=status,
        passes=used,
        chi_square=float(square),
        residuals=3 * len(best.out[9]),
        information=best.gram[:STATES, :STATES],
        orthogonal=best.orthogonal,
        late=_late(best, slope) if prior.sd[-1] == 0 else (0.0, 0.0),
        history=_history(t, prior, best) if len(best.out[4]) else None,
        rows=_at_solution(best),
        time=best.out[9],
    )


def _at_solution(best: Pass) -> FloatArray:
    """Return the white rows with the residuals that the last step leaves."""
    slopes = best.rows[..., :STATES]
    left = best.rows[..., RESIDUAL] - slopes @ best.x
    return np.concatenate([slopes, left[..., None]], axis=-1)


def _late(best: Pass, slope: FloatArray) -> tuple[float, float]:
    """Test a delay that is held: its estimate, were it free, and sd (a score test)."""
    row = best.gram[STATES - 1, : STATES - 1]
    left = best.gram[STATES - 1, RESIDUAL] - row @ best.x[:-1]
    own = best.gram[STATES - 1, STATES - 1] - row @ best.cov[:-1, :-1] @ row
    if not own > 0:
        return 0.0, float("inf")
    return DELAY_UNIT * float(left / own), DELAY_UNIT / float(np.sqrt(own))


def _lost(t: Tumble, prior: Prior, used: int, status: Status) -> Fit:
    """Return the prior where the log led to no numbers, or absurd ones: nothing was learnt."""
    sd, at = np.diag(prior.sd**2), prior.mean
    return Fit(
        at, at.C_np, sd, sd, status, used, 0.0, 3 * int(t.used.sum()),
        np.zeros((STATES, STATES)), False,
    )  # fmt: skip


def _history(t: Tumble, prior: Prior, best: Pass) -> History:
    time, grams, wide, P, C_ip = best.out[4:9]
    miss, slope = prior.rows(best.at)
    step, sd = np.empty((len(time), STATES)), np.empty((len(time), STATES))
    C_np = np.empty((len(time), 3, 3))
    for k in range(len(time)):
        gram = np.triu(grams[k]) + np.triu(grams[k], 1).T
        x, cov, _ = solve_step(gram, miss, slope, prior.sought)
        psi, joint = _ahead(wide[k], P[k], x, cov)
        C_pi = C_ip[k].T
        C_np[k] = exp(t.w_ie_n * time[k]).T @ C_ip[k]
        step[k, :3], step[k, 3:] = C_pi @ psi, (x - best.x)[3:] * prior.sd[3:]
        sd[k, :3] = np.sqrt(np.diag(C_pi @ joint[:3, :3] @ C_pi.T))
        sd[k, 3:] = np.sqrt(np.diag(cov))[3:] * prior.sd[3:]
    return History(time, step, sd, C_np)
