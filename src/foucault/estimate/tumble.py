"""A torqued cluster in continuous rotation: calibrated and aligned at once.

Gauss-Newton over a tumble: the linearised filter, repeated about its own estimate.

A pass of `kernels.cluster_information` about the trajectory of the present estimate gives the
information of attitude at the start, constants and delay, whatever gyro noise does to the attitude
on the way. With the prior, kept at its own mean, the step x solves

    (N + G) x = g + n,       N, n: information and gradient of the prior

and the next pass starts from there. All is in units of the prior's sd. The attitude is a rotation
matrix, the step of it a rotation vector: no attitude is singular. Local gravity is 1 in all of it,
and n is East-North-Up. N + G has a Cholesky factor as long as rounding leaves it one; where its
condition is too poor for that, the same rows are triangularised by Householder reflections.

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
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Status
from foucault.kernels.cluster_information import COLUMNS, RESIDUAL, information_pass
from foucault.models.rotation import aligning, exp, log, right_jacobian_inverse
from foucault.tables import gaps

STATES = 46  # Attitude at the start 3, constants 42, delay 1.
DELAY_UNIT = 0.01  # A delay that is not estimated is tested in units of this [s].


@dataclass(frozen=True)
class Tumble:
    """A log of a torqued cluster, ready for the kernels: local gravity is 1."""

    dt: FloatArray  # (n,) length of the intervals [s]
    command: FloatArray  # (n, 3) rate commanded during each [rad/s]
    # (n, 3) of the accelerometers, at the end of each or its mean over each [local g]
    reading: FloatArray
    used: npt.NDArray[np.bool_]  # (n,) which readings count
    w_ie_n: FloatArray  # (3,) the Earth's rate in n [rad/s]
    gravity: float  # local gravity [m/s^2]
    gyro_psd: float  # white noise of the gyros [rad^2/s]
    accel_variance: float  # variance of one reading [local g^2]
    # (3, 3) positions of the accelerometers in its rows, frame p [m]
    arms: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    mean: bool = False  # whether readings are means over the interval
    block: int = 1  # so many readings are averaged to one residual [1]
    # correlation of the noise of neighbouring averages, from -0.5 where it is rounding alone that
    # is carried to the next reading to 0 [1]
    shared: float = 0.0
    # by how much all readings are older than that, whatever delay is estimated besides [s]
    late: float = 0.0

    @property
    def time(self) -> FloatArray:
        """Times of the readings since the start, shape (n,) [s]."""
        return np.cumsum(self.dt) - (0.5 * self.dt if self.mean else 0.0)


@dataclass(frozen=True)
class State:
    """What is wanted of a tumble."""

    C_np: FloatArray  # (3, 3) attitude at the start [1]
    # (42,) in the order of `models.cluster.CONSTANTS` and packed: local gravity is 1
    constants: FloatArray
    delay: float = 0.0  # of the readings against the command [s]

    def moved(self, x: FloatArray) -> State:
        """Return the state after `x` (46,): rotation in n [rad], constants [packed], delay [s]."""
        return State(exp(x[:3]) @ self.C_np, self.constants + x[3:45], self.delay + float(x[45]))


@dataclass(frozen=True)
class Prior:
    """What is known of it beforehand."""

    mean: State
    # (46,) standard deviations: of the attitude at the start about East, North, Up [rad], of the
    # constants [packed], of the delay [s]; zero holds a value
    sd: FloatArray

    @property
    def unit(self) -> FloatArray:
        """What the entries of a step are in units of, shape (46,)."""
        return np.where(self.sd > 0, self.sd, DELAY_UNIT)

    @property
    def sought(self) -> IntArray:
        """Entries that are estimated."""
        return np.flatnonzero(self.sd > 0)

    def rows(self, at: State) -> tuple[FloatArray, FloatArray]:
        """Return the white residuals, shape (46,), and their slopes by x / sd, shape (46, 46)."""
        safe = np.where(self.sd > 0, self.sd, 1.0)
        phi = log(at.C_np @ self.mean.C_np.T)
        slope = np.eye(STATES)
        left = right_jacobian_inverse(phi).T  # Log(Exp(x) Exp(phi)) = phi + left x
        slope[:3, :3] = left * self.sd[:3] / safe[:3, None]
        ahead = np.concatenate(
            [phi, at.constants - self.mean.constants, [at.delay - self.mean.delay]]
        )
        return np.where(self.sd > 0, -ahead / safe, 0.0), slope


POOR = 1e13
"""Condition, of the information scaled to a unit diagonal, beyond which it is not summed [1]."""

NO_MOMENTS: IntArray = np.zeros(0, np.int64)  # No history is kept.


@dataclass(frozen=True)
class Pass:
    """One pass over the log, and the step that follows from it."""

    at: State  # about which it is linearised
    out: Any  # what `kernels.cluster_information.information_pass` returns
    # (48, 48) information of the log, whole and symmetric, in units of the prior's sd [1]
    gram: FloatArray
    x: FloatArray  # (46,) the step, in units of the prior's sd [1]
    cov: FloatArray  # (46, 46) its covariance in the same units; zero where a value is held [1]
    cost: float  # sum of squares of residuals and prior at `at` [1]
    finite: bool  # whether all of it are numbers; if not, the step is zero
    orthogonal: bool  # whether reflections were necessary
    rows: FloatArray  # (blocks, 3, 48) or (0, 3, 48) white rows, where wanted [1]
    # (steps, 5, 3, 3) or (0, 5, 3, 3), where wanted: for `kernels.cluster_information.answer`
    gains: FloatArray

    @property
    def scatter(self) -> float:
        """How many times the residuals are as large as their noise, 1 at least: so much rougher is
        what a step can settle to."""
        return max(1.0, float(np.sqrt(self.cost / max(3 * len(self.out[9]), 1))))

    @property
    def length(self) -> float:
        """Length of the step in units of its standard deviation."""
        on = np.flatnonzero(np.diag(self.cov) > 0)
        x, cov = self.x[on], self.cov[np.ix_(on, on)]
        return float(np.sqrt(max(float(x @ np.linalg.solve(cov, x)), 0.0)))


def run(
    t: Tumble, at: State, scale: FloatArray, checkpoints: IntArray, rows: bool, gains: bool = False
) -> tuple[Any, FloatArray, FloatArray]:
    """Run the kernel: what it returns, and where wanted white rows, shape (blocks, 3, 48), and
    gains, shape (steps, 5, 3, 3).

    `scale` (46,): what one unit of each column is [rad, packed, s]; `checkpoints` (c,):
    intervals, ascending, after which the state is kept [1].
    """
    store = np.zeros((len(t.dt) // t.block + 1 if rows or t.shared else 0, 3, COLUMNS))
    kept = np.zeros((len(t.dt) // t.block + 2 if gains else 0, 5, 3, 3))
    out = information_pass(
        t.dt, t.command, t.reading, t.used, at.constants, scale,
        np.ascontiguousarray(at.C_np),  # one layout, one compilation
        t.w_ie_n, t.gyro_psd, t.accel_variance, t.arms, t.gravity, t.mean, t.block, store,
        checkpoints, at.delay + t.late, kept,
    )  # fmt: skip
    white = store[: len(out[9])]
    if t.shared and len(white):
        white = apart(white, out[9], t.shared)
        ends = np.searchsorted(out[9], out[4], side="right")
        gram, *some = (np.einsum("kai,kaj->ij", x, x) for x in (white, *(white[:k] for k in ends)))
        out = (gram[None], *out[1:5], np.array(some).reshape(out[5].shape), *out[6:])
    return out, white if rows else white[:0], kept[: len(out[10])]


def apart(white: FloatArray, time: FloatArray, shared: float) -> FloatArray:
    """Return rows without what neighbours share: e_k = x_k - (r / s) e_k-1, divided by its sd.

    `white` (b, 3, 48): rows of unit variance [1]; `time` (b,): their times [s]; `shared`:
    correlation r of neighbours [1]. Across a gap nothing is shared.
    """
    out = np.empty_like(white)
    gap = np.concatenate([[True], gaps(np.diff(time))])
    left = 1.0
    for k, x in enumerate(white):
        if gap[k]:
            left, out[k] = 1.0, x
        else:
            weight = shared / np.sqrt(left)
            left = 1.0 - shared**2 / left
            out[k] = (x - weight * out[k - 1]) / np.sqrt(left)
    return out


def look(
    t: Tumble, prior: Prior, at: State, checkpoints: IntArray = NO_MOMENTS, rows: bool = False,
    gains: bool = False,
) -> Pass:  # fmt: skip
    """Linearise about a state, which is kept after intervals `checkpoints` (c,) [1], and step."""
    out, white, kept = run(t, at, prior.unit, checkpoints, rows, gains)
    gram = np.triu(out[0][0]) + np.triu(out[0][0], 1).T
    miss, slope = prior.rows(at)
    finite = all(bool(np.isfinite(part).all()) for part in (gram, *out[1:4]))
    x, cov, orthogonal = np.zeros(STATES), np.eye(STATES), False
    if finite:
        x, cov, poor = solve_step(gram, miss, slope, prior.sought)
        if poor:
            white = run(t, at, prior.unit, NO_MOMENTS, True)[1]
            x, cov = _reflected(white, miss, slope, prior.sought)
            orthogonal = True
        finite = bool(np.isfinite(x).all() and np.isfinite(cov).all())
    if not finite:
        x, cov = np.zeros(STATES), np.eye(STATES)
    cost = float(gram[RESIDUAL, RESIDUAL] + miss @ miss)
    return Pass(
        at, out, gram, x, cov, cost, finite, orthogonal,
        white if rows else white[:0], kept,
    )  # fmt: skip


def solve_step(
    gram: FloatArray, miss: FloatArray, slope: FloatArray, sought: IntArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Solve the normal equations, scaled to a unit diagonal; say whether they are too poor.

    `gram` (48, 48): information of the log [1]; `miss` (46,): white residuals of the prior [1];
    `slope` (46, 46): their slopes [1]; `sought` (k,): entries that are estimated [1]. Returns `x`
    (46,): the step [1]; `cov` (46, 46): its covariance [1].
    """
    x, cov = np.zeros(STATES), np.zeros((STATES, STATES))
    N = (gram[:STATES, :STATES] + slope.T @ slope)[np.ix_(sought, sought)]
    rhs = (gram[:STATES, RESIDUAL] + slope.T @ miss)[sought]
    d = 1 / np.sqrt(np.diag(N))
    unit = N * np.outer(d, d)
    try:
        root = np.linalg.cholesky(unit)
    except np.linalg.LinAlgError:
        return x, cov, True
    half = np.linalg.inv(root)
    spread = np.linalg.norm(unit) * np.linalg.norm(half) ** 2
    half = half * d
    x[sought] = half.T @ (half @ rhs)
    cov[np.ix_(sought, sought)] = half.T @ half
    return x, cov, bool(spread > POOR)


def _reflected(
    white: FloatArray, miss: FloatArray, slope: FloatArray, sought: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Solve the same by the QR factors of all rows: nothing is squared."""
    columns = np.append(sought, RESIDUAL)
    above = np.column_stack([slope[np.ix_(sought, sought)], miss[sought]])
    full = np.concatenate([above, white[..., columns].reshape(-1, len(columns))])
    R = np.asarray(np.linalg.qr(full, mode="r"))
    inverse = np.linalg.inv(R[:-1, :-1][: len(sought)])
    x, cov = np.zeros(STATES), np.zeros((STATES, STATES))
    x[sought] = inverse @ R[: len(sought), -1]
    cov[np.ix_(sought, sought)] = inverse @ inverse.T
    return x, cov


def levelled(tumble: Tumble, prior: Prior, seconds: float = 1.0) -> State:
    """Return the prior's mean, turned the shortest way to first readings, of `seconds` [s], up."""
    first = np.flatnonzero(tumble.used)
    within = np.cumsum(tumble.dt)[first] <= np.cumsum(tumble.dt)[first[:1]] + seconds
    mean = tumble.reading[first[within]].mean(axis=0)
    C_np = prior.mean.C_np
    up_n = C_np @ (mean / np.linalg.norm(mean))
    return replace(prior.mean, C_np=aligning(up_n, np.array([0.0, 0.0, 1.0])) @ C_np)


def beginning(tumble: Tumble, prior: Prior, constants: FloatArray, C_np: FloatArray) -> State:
    """Return the start that ends in `C_np` (3, 3) [1] with packed `constants` (42,)."""
    at = replace(levelled(tumble, prior), constants=constants)
    last = np.array([len(tumble.dt)])
    C_in = exp(tumble.w_ie_n * tumble.dt.sum())
    for _ in range(4):  # drift depends on attitude, by a part in a thousand
        C_ip = C_in @ attitudes(tumble, at, last)[0].T
        at = replace(at, C_np=C_in @ C_np @ C_ip.T @ at.C_np)
    return at


def attitudes(tumble: Tumble, at: State, rows: IntArray) -> FloatArray:
    """Return C_pn, (k, 3, 3), at ascending `rows` (k,), 0 the start, n the end [1]."""
    blind = replace(tumble, used=np.zeros(len(tumble.dt), bool))
    later = rows[rows > 0]
    out = run(blind, at, np.ones(STATES), later - 1, False)[0]
    C_ip = np.concatenate([np.repeat(at.C_np[None], len(rows) - len(later), axis=0), out[8]])
    time = np.concatenate([np.zeros(len(rows) - len(later)), out[4]])
    return np.swapaxes(C_ip, -1, -2) @ exp(time[:, None] * tumble.w_ie_n)


def sensitivities(tumble: Tumble, at: State, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return time (b,) [s] and d reading / d state times `scale` (46,), (b, 3, 46)."""
    # No noise: the gain is zero.
    still = replace(tumble, gyro_psd=0.0, accel_variance=1.0, shared=0.0)
    out, rows, _ = run(still, at, scale, NO_MOMENTS, True)
    block = tumble.block
    total = np.concatenate([[0], np.cumsum(tumble.used)])
    count = np.diff(np.append(total[:-1:block], total[-1]))
    white = np.sqrt(count[count > 0])
    return out[9], rows[:, :, :STATES] / white[:, None, None]


SETTLED = 0.05  # A step shorter than this, in units of its standard deviation, is the last [1].

ROUGH = 100.0
"""Passes over long averages end with a step shorter than this, in units of its sd [1]."""

ABSURD = 1e3
"""Where a run that did not settle came so far from the prior, in its sd, nothing was learnt [1]."""

FAR = np.radians(3.0)  # Most that the cluster may turn in one of these averages [rad].


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
    """Find attitude, constants and delay from `start`, else `levelled`, in `passes` at most [1]."""
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
    """Return a solution linearised about itself, its history at so many `moments` [1]."""
    best = look(tumble, prior, fit.start, _moments(tumble, moments), True)
    if not best.finite:
        return fit
    if fit.status is not Status.CONVERGED:
        best = replace(best, x=np.zeros(STATES))
    return _fit(tumble, prior, best, fit.status, fit.passes)


def bound(
    tumble: Tumble, prior: Prior, truth: State, *, moments: int = 0, rows: bool = False
) -> Fit:
    """Return the Cramer-Rao bound at `truth`, and its course at so many `moments` [1]."""
    best = look(tumble, prior, truth, _moments(tumble, moments), rows)
    best = replace(best, x=np.zeros(STATES))
    return _fit(tumble, prior, best, Status.CONVERGED, 1)


APART = 0.05
"""Change of a variance by which the slope of a covariance is found, as a share of it [1]."""


def by_source(tumble: Tumble, prior: Prior, fit: Fit) -> dict[str, FloatArray]:
    """Return the covariance of a solution by source, shape (46, 46) each as `Fit.cov`; they add up.

    The gains G are the best ones: to first order the covariance changes with the variance of a
    source as if they were held, so that a source adds ``G S_s G' = s dcov / ds``.
    """

    def solved(share: float) -> tuple[FloatArray, Pass]:
        one = look(replace(tumble, gyro_psd=share * tumble.gyro_psd), prior, fit.start)
        return _ahead(one.out[1][0], one.out[2][0], one.x, one.cov)[1], one

    turn = np.diag(prior.sd)
    turn[:3, :3] = (exp(tumble.w_ie_n * tumble.dt.sum()) @ fit.C_np).T
    one = solved(1.0)[1]
    ahead = np.eye(STATES)
    ahead[:3] = one.out[1][0][:, :STATES]
    known = ahead @ one.cov @ prior.rows(fit.start)[1].T
    out = {"prior": turn @ known @ known.T @ turn.T}
    if tumble.gyro_psd > 0:
        slope = (solved(1 + APART)[0] - solved(1 - APART)[0]) / (2 * APART)
        out["white noise of gyros"] = turn @ slope @ turn.T
    return {"white noise of accelerometers": fit.cov - np.sum(list(out.values()), axis=0)} | out


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
    slopes = best.rows[..., :STATES]
    left = best.rows[..., RESIDUAL] - slopes @ best.x
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
        late=_late(best) if prior.sd[-1] == 0 else (0.0, 0.0),
        history=_history(t, prior, best) if len(best.out[4]) else None,
        rows=np.concatenate([slopes, left[..., None]], axis=-1),
        time=best.out[9],
    )


def _late(best: Pass) -> tuple[float, float]:
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
