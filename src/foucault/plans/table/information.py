"""What positions on a table tell of the coefficients, added up position by position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.plans.table.periodic import Periodic
from foucault.plans.table.reach import Position

SEEN = 1e-7
"""A pivot of the scaled information below this is rounding: nothing is seen along it [1]."""

FAINT = 1e-13
"""Information added for unknowns that do not count, relative to what there is of each [1]."""


def without(F: FloatArray, kept: int) -> FloatArray:
    """Return the information of the first unknowns, the others eliminated.

    `F` (n, n): information of all; `kept`: number of those kept [1].
    """
    if kept == len(F):
        return F
    across = F[kept:, :kept]
    return np.asarray(F[:kept, :kept] - across.T @ np.linalg.solve(F[kept:, kept:], across))


@dataclass(frozen=True)
class Parts:
    """What one position tells of the coefficients and of all else that positions share."""

    table: Periodic  # information of a position; what it has to itself comes last
    kept: int  # unknowns that positions share, coefficients first [1]

    def __call__(self, position: Position) -> FloatArray:
        """Return the information of a `position` [rad] for what is shared, shape (kept, kept)."""
        return without(self.table(position), self.kept)

    @property
    def usual(self) -> FloatArray:
        """Information that a position has of each on average, were all else known, (kept,)."""
        return np.diag(self.table.mean)[: self.kept]

    def slope(self, position: Position, M: FloatArray) -> FloatArray:
        """Return the derivatives of ``sum(M * F)`` by the angles, shape (3,).

        `position` (3,): the angles [rad]; `M` (kept, kept): a symmetric matrix.
        """
        if self.kept == self.table.size:
            return self.table.slope(position, M)
        F, k = self.table(position), self.kept
        K = np.vstack([np.eye(k), -np.linalg.solve(F[k:, k:], F[k:, :k])])
        return self.table.slope(position, K @ M @ K.T)


def half_covariance(
    F: FloatArray, used: npt.NDArray[np.intp], scale: FloatArray
) -> FloatArray | None:
    """Return H with covariance ``H' H``; None where something of the `used` is not seen.

    `F` (u, u): information of all unknowns; `used` (k,): those of interest [1]; `scale` (u,):
    root of the information that is usual of each.
    """
    scaled = F / np.outer(scale, scale)
    others = np.ones(len(F), bool)
    others[used] = False
    # Those that do not count may be unseen: a faint prior keeps them out of the way.
    scaled[others, others] += FAINT
    try:
        root = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return None
    if root.diagonal().min() < SEEN:
        return None
    return np.asarray(np.linalg.inv(root) / scale)
