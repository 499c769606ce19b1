"""What the data can tell: Fisher information, Cramer-Rao bound, weakest combinations.

For white residuals with Jacobian J the Fisher information of all parameters is ``J' J``. With
the nuisance parameters eliminated it is ``F = R22' R22`` (see `estimate.gauss_newton`), and no
unbiased estimator has a covariance smaller than ``inv(F)``. Any procedure that can linearise its
problem gets all of this.

References
----------
.. [1] S. M. Kay, *Fundamentals of Statistical Signal Processing: Estimation Theory*, 1993,
   chapter 3.
.. [2] D. A. Belsley, E. Kuh, R. E. Welsch, *Regression Diagnostics*, Wiley, 1980, chapter 3
   (condition indices of the scaled problem).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector, Layout
from foucault.estimate import gauss_newton
from foucault.result import Linearised

FloatArray = npt.NDArray[np.float64]

INVISIBLE = 1e-9
"""A scaled singular value below this is zero: the combination is not seen at all [1]."""


@dataclass(frozen=True)
class Combination:
    """A direction in the space of the coefficients, and how badly it is seen.

    Attributes
    ----------
    factor : float
        How many times less certain the combination is than if each coefficient were alone;
        infinite where it is not seen at all [1].
    shares : dict of str to float
        Coefficient -> share in the direction, each in units of its certainty alone [1].
    """

    factor: float
    shares: dict[str, float]

    @property
    def words(self) -> str:
        """The combination in words."""
        terms = " ".join(f"{share:+.2f} {name}" for name, share in self.shares.items())
        if not np.isfinite(self.factor):
            return f"{terms}: not seen at all"
        return f"{terms}: {self.factor:.1f} times less certain together than each alone"


@dataclass(frozen=True)
class Information:
    """Fisher information of named coefficients, nuisance parameters eliminated.

    Attributes
    ----------
    layout : Layout
        The coefficients.
    root : ndarray, shape (n, n)
        Square root R of the information: ``R.T @ R`` [1 / unit].
    """

    layout: Layout
    root: FloatArray

    @cached_property
    def matrix(self) -> FloatArray:
        """Fisher information, shape (n, n) [1 / unit^2]."""
        return np.asarray(self.root.T @ self.root)

    @cached_property
    def _scale(self) -> FloatArray:
        """Norm of each column: the certainty of a coefficient if all others were known."""
        alone = np.linalg.norm(self.root, axis=0)
        return np.where(alone > 0, alone, 1.0)

    @cached_property
    def _svd(self) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        _, s, Vt = np.linalg.svd(self.root / self._scale)
        return s, Vt, s > INVISIBLE * max(float(s[0]), 1e-300)

    @property
    def rank(self) -> int:
        """Number of combinations that are seen."""
        return int(np.sum(self._svd[2]))

    @cached_property
    def cov(self) -> FloatArray:
        """Cramer-Rao bound, shape (n, n) [unit^2]; infinite where nothing is seen."""
        s, Vt, seen = self._svd
        half = Vt[seen] / s[seen, None] / self._scale
        out = np.asarray(half.T @ half)
        blind = np.flatnonzero((np.abs(Vt[~seen]) > 1e-6).any(axis=0))
        out[blind, :] = out[:, blind] = 0.0
        out[blind, blind] = np.inf
        return out

    @property
    def sd(self) -> FloatArray:
        """Smallest standard deviation of any unbiased estimate, shape (n,) [unit]."""
        return np.sqrt(np.diag(self.cov))

    def correlation(self) -> FloatArray:
        """Return the correlation of the errors at the bound, shape (n, n) [1]."""
        sd = self.sd
        with np.errstate(invalid="ignore"):
            return np.asarray(np.nan_to_num(self.cov / np.outer(sd, sd)))

    def weakest(self, most: int = 3, worth: float = 2.0) -> tuple[Combination, ...]:
        """Return the combinations of coefficients that are seen worst, worst first.

        Parameters
        ----------
        most : int, shape ()
            Largest number of combinations [1].
        worth : float
            Leave out those that are less than this many times worse than alone [1].
        """
        out: list[Combination] = []
        for value, direction, seen in zip(*(part[::-1] for part in self._svd), strict=True):
            factor = 1.0 / float(value) if seen else float("inf")
            if len(out) == most or factor < worth:
                break
            largest = np.argsort(-np.abs(direction))[:4].tolist()
            lead = float(np.sign(direction[largest[0]]))
            shares = {
                self.layout.names[i]: lead * float(direction[i])
                for i in largest
                if abs(direction[i]) > 0.2
            }
            out.append(Combination(factor, shares))
        return tuple(out)

    def distance(self, estimate: CoefficientVector) -> FloatArray:
        """Return the standard deviation of an estimate over the bound, shape (n,) [1].

        Parameters
        ----------
        estimate : CoefficientVector
            With covariance; the same coefficients in the same order.
        """
        return np.asarray(estimate.sd / self.sd)


def information(at: Linearised, layout: Layout) -> Information:
    """Return the information that a linearised problem has about its coefficients.

    Parameters
    ----------
    at : Linearised
        White residuals and Jacobian; the coefficients are the first columns.
    layout : Layout
        The coefficients.
    """
    root = gauss_newton.eliminate(at, len(layout))
    # Fewer observations than coefficients leave fewer rows.
    return Information(layout, np.pad(root, ((0, len(layout) - len(root)), (0, 0))))
