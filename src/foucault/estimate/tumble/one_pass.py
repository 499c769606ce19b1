"""One pass over a tumble: linearise it about a state, and solve for the step from there.

The sum N + G of `estimate.tumble.fit` has a Cholesky factor as long as rounding leaves it one.
Where its condition is too poor for that, the same rows are triangularised by Householder
reflections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.estimate.tumble.state import STATES, IntArray, Prior, State, Tumble
from foucault.kernels.cluster_information import COLUMNS, RESIDUAL, information_pass

FloatArray = npt.NDArray[np.float64]

POOR = 1e13
"""Condition, of the information scaled to a unit diagonal, beyond which it is not summed [1]."""

NO_MOMENTS: IntArray = np.zeros(0, np.int64)
"""No history is kept."""


@dataclass(frozen=True)
class Pass:
    """One pass over the log, and the step that follows from it.

    Attributes
    ----------
    at : State
        About which it is linearised.
    out : tuple of ndarray
        What `kernels.cluster_information.information_pass` returns.
    gram : ndarray, shape (48, 48)
        Information of the log, whole and symmetric, in units of the prior's sd [1].
    x : ndarray, shape (46,)
        The step, in units of the prior's sd [1].
    cov : ndarray, shape (46, 46)
        Its covariance in the same units; zero where a value is held [1].
    cost : float
        Sum of squares of residuals and prior at `at` [1].
    finite : bool
        Whether all of it are numbers; if not, the step is zero.
    orthogonal : bool
        Whether reflections were necessary.
    rows : ndarray, shape (blocks, 3, 48) or (0, 3, 48)
        White rows, where wanted [1].
    """

    at: State
    out: Any
    gram: FloatArray
    x: FloatArray
    cov: FloatArray
    cost: float
    finite: bool
    orthogonal: bool
    rows: FloatArray

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

    Parameters
    ----------
    t : Tumble
        The log.
    at : State
        About which to linearise.
    scale : ndarray, shape (46,)
        What one unit of each column is [rad, packed, s].
    checkpoints : ndarray of int, shape (c,)
        Intervals, ascending, after which the state is kept [1].
    rows : bool
        Whether the white rows are wanted.
    """
    store = np.zeros((len(t.dt) // t.block + 1 if rows else 0, 3, COLUMNS))
    out = information_pass(
        t.dt, t.command, t.reading, t.used, at.constants, scale,
        np.ascontiguousarray(at.C_np),  # one layout, one compilation
        t.w_ie_n, t.gyro_psd, t.accel_variance, t.arms, t.gravity, t.mean, t.block, store,
        checkpoints, at.delay + t.late,
    )  # fmt: skip
    return out, store[: len(out[9])]


def look(
    t: Tumble, prior: Prior, at: State, checkpoints: IntArray = NO_MOMENTS, rows: bool = False
) -> Pass:
    """Linearise a log about a state, and find the step from there.

    Parameters
    ----------
    t : Tumble
        The log.
    prior : Prior
        What is known beforehand.
    at : State
        About which to linearise.
    checkpoints : ndarray of int, shape (c,)
        Intervals, ascending, after which the state is kept [1].
    rows : bool
        Whether the white rows are wanted.
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

    Parameters
    ----------
    gram : ndarray, shape (48, 48)
        Information of the log [1].
    miss : ndarray, shape (46,)
        White residuals of the prior [1].
    slope : ndarray, shape (46, 46)
        Their slopes [1].
    sought : ndarray of int, shape (k,)
        Entries that are estimated [1].

    Returns
    -------
    x : ndarray, shape (46,)
        The step [1].
    cov : ndarray, shape (46, 46)
        Its covariance [1].
    poor : bool
        Whether rounding may spoil both.
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
