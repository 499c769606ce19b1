"""One pass over a tumble: linearise it about a state, and solve for the step from there.

The sum N + G of `estimate.tumble.fit` has a Cholesky factor as long as rounding leaves it one.
Where its condition is too poor for that, the same rows are triangularised by Householder
reflections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.estimate.tumble.state import STATES, Prior, State, Tumble
from foucault.kernels.cluster_information import COLUMNS, RESIDUAL, information_pass

POOR = 1e13
"""Condition, of the information scaled to a unit diagonal, beyond which it is not summed [1]."""

NO_MOMENTS: IntArray = np.zeros(0, np.int64)
"""No history is kept."""


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
    t: Tumble, at: State, scale: FloatArray, checkpoints: IntArray, rows: bool
) -> tuple[Any, FloatArray]:
    """Run the kernel: what it returns, and the white rows, shape (blocks, 3, 48), where wanted.

    `scale` (46,): what one unit of each column is [rad, packed, s]; `checkpoints` (c,):
    intervals, ascending, after which the state is kept [1].
    """
    store = np.zeros((len(t.dt) // t.block + 1 if rows or t.shared else 0, 3, COLUMNS))
    out = information_pass(
        t.dt, t.command, t.reading, t.used, at.constants, scale,
        np.ascontiguousarray(at.C_np),  # one layout, one compilation
        t.w_ie_n, t.gyro_psd, t.accel_variance, t.arms, t.gravity, t.mean, t.block, store,
        checkpoints, at.delay + t.late,
    )  # fmt: skip
    white = store[: len(out[9])]
    if t.shared and len(white):
        white = apart(white, out[9], t.shared)
        ends = np.searchsorted(out[9], out[4], side="right")
        gram, *some = (np.einsum("kai,kaj->ij", x, x) for x in (white, *(white[:k] for k in ends)))
        out = (gram[None], *out[1:5], np.array(some).reshape(out[5].shape), *out[6:])
    return out, white if rows else white[:0]


def apart(white: FloatArray, time: FloatArray, shared: float) -> FloatArray:
    """Return rows without what neighbours share: e_k = x_k - (r / s) e_k-1, divided by its sd.

    `white` (b, 3, 48): rows of unit variance [1]; `time` (b,): their times [s]; `shared`:
    correlation r of neighbours [1]. Across a gap nothing is shared.
    """
    out = np.empty_like(white)
    gap = np.diff(time, prepend=-np.inf) > 1.5 * float(np.median(np.diff(time)))
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
    t: Tumble, prior: Prior, at: State, checkpoints: IntArray = NO_MOMENTS, rows: bool = False
) -> Pass:
    """Linearise a log about a state, and find the step from there.

    `checkpoints` (c,): intervals, ascending, after which the state is kept [1].
    """
    out, white = run(t, at, prior.unit, checkpoints, rows)
    gram = np.triu(out[0][0]) + np.triu(out[0][0], 1).T
    miss, slope = prior.rows(at)
    finite = all(bool(np.isfinite(part).all()) for part in (gram, *out[1:4]))
    x, cov, orthogonal = np.zeros(STATES), np.eye(STATES), False
    if finite:
        x, cov, poor = solve_step(gram, miss, slope, prior.sought)
        if poor:
            _, white = run(t, at, prior.unit, NO_MOMENTS, True)
            x, cov = _reflected(white, miss, slope, prior.sought)
            orthogonal = True
        finite = bool(np.isfinite(x).all() and np.isfinite(cov).all())
    if not finite:
        x, cov = np.zeros(STATES), np.eye(STATES)
    cost = float(gram[RESIDUAL, RESIDUAL] + miss @ miss)
    return Pass(
        at, out, gram, x, cov, cost, finite, orthogonal,
        white if rows else white[:0],
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
