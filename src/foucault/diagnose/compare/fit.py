"""Results in time, and models of their values solved by weighted least squares.

Results x_i with covariances P_i obey ``x_i = sum_j A_ij beta_j + e_i``: one constant value, a
straight line in time, or a step. Errors of different results are independent but for what they
share, ``e_i = own_i + L_i g`` with g of unit variance, which is solved for beside beta.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from foucault.arrays import FloatArray

DAY = 86400.0
"""A slope over less says nothing of a year [s]."""


@dataclass(frozen=True)
class Series:
    """Results with the same coefficients, n of them, in order of time."""

    names: tuple[str, ...]  # (p,) coefficients
    time: FloatArray  # (n,) when each result holds, since 1970; NaN where unknown [s]
    values: FloatArray  # (n, p) coefficients [SI]
    cov: FloatArray  # (n, p, p) covariance of each result, what it shares with others included [SI]
    # (n, p, q) errors L that results share, per unit of each of their q sources [SI]
    shared: FloatArray

    def __len__(self) -> int:
        return len(self.values)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (n, p) [SI]."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))

    @property
    def dated(self) -> bool:
        """Whether a drift per year can be told: all times are known, and they span a day."""
        return bool(np.isfinite(self.time).all() and np.ptp(self.time) >= DAY)

    def at(self, rows: list[int]) -> Series:
        """Return some results, `rows` are their numbers, shape (m,) [1]."""
        return replace(
            self, time=self.time[rows], values=self.values[rows], cov=self.cov[rows],
            shared=self.shared[rows],
        )  # fmt: skip

    def only(self, columns: list[int]) -> Series:
        """Return some coefficients, `columns` are their numbers, shape (m,) [1]."""
        return replace(
            self,
            names=tuple(self.names[k] for k in columns),
            values=self.values[:, columns],
            cov=self.cov[:, columns][:, :, columns],
            shared=self.shared[:, columns],
        )

    def without(self, k: int) -> Series:
        """Return all coefficients but number `k`, shape () [1]."""
        return self.only([j for j in range(len(self.names)) if j != k])


@dataclass(frozen=True)
class Fit:
    """A model of the values in time, solved by weighted least squares."""

    # values, sd: (r, p) parameters and their standard deviations [SI, per unit of the design]
    values: FloatArray
    sd: FloatArray
    chi_square: float  # sum of squares left [1]
    dof: int  # its degrees of freedom [1]


def fit(series: Series, design: FloatArray) -> Fit:
    """Solve ``x_i = sum_j design_ij beta_j`` for the coefficients beta.

    `series`: the results [SI]; `design` (n, r): how much of each parameter is in each result, the
    first column is 1 [any].
    """
    (n, p), r, q = series.values.shape, design.shape[1], series.shared.shape[2]
    if p == 0:
        return Fit(np.zeros((r, 0)), np.zeros((r, 0)), 0.0, 0)
    scale = np.median(series.sd, axis=0)
    shared = series.shared / scale[:, None]
    own = series.cov / np.outer(scale, scale) - shared @ shared.swapaxes(1, 2)
    white = np.linalg.inv(np.linalg.cholesky(own))
    moved = (series.values - series.values[0]) / scale  # values are many sd: keep the digits
    J = np.zeros((n * p + q, r * p + q))
    J[: n * p, : r * p] = np.einsum("ij,iab->iajb", design, white).reshape(n * p, r * p)
    J[: n * p, r * p :] = (white @ shared).reshape(n * p, q)
    J[n * p :, r * p :] = np.eye(q)
    y = np.concatenate([np.einsum("iab,ib->ia", white, moved).ravel(), np.zeros(q)])
    Q, R = np.linalg.qr(J)
    beta = np.linalg.solve(R, Q.T @ y)
    left = y - J @ beta
    sd = np.linalg.norm(np.linalg.inv(R), axis=1)[: r * p].reshape(r, p) * scale
    values = beta[: r * p].reshape(r, p) * scale
    values[0] += series.values[0]
    return Fit(values, sd, float(left @ left), (n - r) * p)


def constant(series: Series) -> Fit:
    """Fit one value to all results of a `series`, shape (n,) [SI]."""
    return fit(series, np.ones((len(series), 1)))


def line(series: Series) -> Fit:
    """Fit a value in the middle of the time and a slope, both of `series`, shape (n,) [SI/s]."""
    return fit(series, np.stack([np.ones(len(series)), _from_middle(series.time)], axis=1))


def _from_middle(time: FloatArray) -> FloatArray:
    return cast(FloatArray, time - time.mean())


def step(series: Series) -> tuple[int, Fit]:
    """Fit a step after one of the results of a `series`, shape (n,): which, and the fit [SI]."""
    n = len(series)
    fits = {
        after: fit(series, np.stack([np.ones(n), np.arange(n) > after], axis=1))
        for after in range(n - 1)
    }
    best = min(fits, key=lambda after: fits[after].chi_square)
    return best, fits[best]
