"""What the data can tell: Fisher information, Cramer-Rao bound, weakest combinations.

For white residuals with Jacobian J the Fisher information of all parameters is ``J' J``. With
the nuisance parameters eliminated it is ``F = R22' R22`` (see `infer.gauss_newton`), and no
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
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, settled
from foucault.coefficients import Layout
from foucault.errors import error
from foucault.infer import gauss_newton
from foucault.result import Linearised, Problem

INVISIBLE = 1e-9
"""A scaled singular value below this is zero: the combination is not seen at all [1]."""

BLURRED = 1000.0
"""Coefficients this many times less certain together than each alone are not separated [1]."""

UNTOUCHED = 1e-11
"""A share in the unseen directions below this times the standard deviation in the seen ones, of the
scaled problem, is rounding: the coefficient is seen [1]. Rounding turns a direction that is seen
with singular value s into the unseen ones by about ``eps / s``, so the share of a coefficient by
some ``eps`` times its standard deviation; what is truly shared is far more."""


def untouched(s: FloatArray, Vt: FloatArray, seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Tell which coefficients have no share in the directions that are not seen, shape (n,).

    `s` (n,): singular values of the scaled problem, the largest first [1]; `Vt` (n, n): a row for
    each: its direction [1]; `seen` (n,): which of them are seen.
    """
    sd = s[0] * np.linalg.norm(Vt[seen] / s[seen, None], axis=0)
    return np.asarray(np.linalg.norm(Vt[~seen], axis=0) <= UNTOUCHED * sd)


def largest_shares(layout: Layout, direction: FloatArray, most: int = 4) -> dict[str, float]:
    """Return the `most` largest shares [1] of a unit `direction` (n,) by name."""
    # Shares that are alike but for rounding stand in the order of the layout.
    largest = np.argsort(-np.abs(direction).round(9), kind="stable")[:most].tolist()
    lead = float(np.sign(direction[largest[0]]))
    return {layout.names[i]: lead * float(direction[i]) for i in largest if abs(direction[i]) > 0.2}


def terms(shares: dict[str, float], *, dots: bool = False) -> str:
    """Write `shares` [1] as ``+0.71 a -0.71 b``; `dots` stand for what is left out."""
    words = [f"{share:+.2f} {name}" for name, share in shares.items()]
    # What is left of the length 1; a thousandth of a prior is not worth a mark.
    rest = 1.0 - sum(share**2 for share in shares.values())
    return " ".join([*words, "..."] if dots and rest > 1e-3**2 else words)


@dataclass(frozen=True)
class Combination:
    """A direction in the space of the coefficients, and how badly it is seen."""

    # how many times less certain the combination is than if each coefficient were alone; infinite
    # where it is not seen at all [1]
    factor: float
    # coefficient -> share in the direction, each in units of its certainty alone [1]
    shares: dict[str, float]

    @property
    def words(self) -> str:
        """The combination in words."""
        if not np.isfinite(self.factor):
            return f"{terms(self.shares, dots=True)}: not seen at all"
        return (
            f"{terms(self.shares)}: {self.factor:.1f} times less certain together than each alone"
        )


@dataclass(frozen=True)
class Remaining:
    """A direction in the space of the coefficients, and how uncertain it remains."""

    ratio: float  # standard deviation along it after the data over that before, 0 to 1 [1]
    # coefficient -> share in the direction, each in units of its prior [1]
    shares: dict[str, float]

    @property
    def words(self) -> str:
        """The direction in words."""
        return f"{terms(self.shares)}: known to {self.ratio:.2g} of the prior"


@dataclass(frozen=True)
class Information:
    """Fisher information of named coefficients, nuisance parameters eliminated."""

    layout: Layout
    root: FloatArray  # (n, n) square root R of the information: ``R.T @ R`` [1 / unit]

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
        blind = np.flatnonzero(~untouched(s, Vt, seen))
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
        """Return the `most` combinations seen worst, `worth` times worse than alone [1]."""
        out: list[Combination] = []
        s, Vt, seen_all = self._svd
        worst_first = (s[::-1], settled(s[::-1], Vt[::-1]), seen_all[::-1])
        for value, direction, seen in zip(*worst_first, strict=True):
            factor = 1.0 / float(value) if seen else float("inf")
            if len(out) == most or factor < worth:
                break
            out.append(Combination(factor, largest_shares(self.layout, direction)))
        return tuple(out)

    def with_prior(self, prior_sd: FloatArray) -> Information:
        """Return it with a prior of `prior_sd` (n,), infinite where there is none [unit]."""
        sd = proper_prior(self.layout, prior_sd, finite=False)
        rows = np.vstack([self.root, np.diag(1.0 / sd)])
        return Information(self.layout, np.asarray(np.linalg.qr(rows, mode="r")))

    def remaining(self, prior_sd: FloatArray, most: int = 3) -> tuple[Remaining, ...]:
        """Return the directions that remain most uncertain after data and prior, worst first.

        With the prior as unit the covariance after the data is ``(I + S' S)^-1``, S the scaled
        root: along a right singular vector the standard deviation is ``1 / sqrt(1 + s^2)``.

        `prior_sd` (n,): standard deviation of the prior, finite [unit]; `most`: largest number of
        directions [1].
        """
        sd = proper_prior(self.layout, prior_sd)
        _, s, Vt = np.linalg.svd(self.root * sd)
        ways = settled(s, Vt)
        return tuple(
            Remaining(float(1 / np.hypot(1.0, s[k])), largest_shares(self.layout, ways[k]))
            for k in range(len(s) - 1, max(len(s) - 1 - most, -1), -1)
        )

    def correlated(self, limit: float = 0.9) -> tuple[tuple[str, str, float], ...]:
        """Return the pairs whose errors are correlated beyond `limit` [1], strongest first."""
        return correlated(self.layout.names, self.correlation(), limit)

    def shown(self) -> dict[str, Any]:
        """Return what a plan shows: number and rank of unknowns, what is seen badly or not.

        What is known beforehand counts, where it is `with_prior`.
        """
        every = self.weakest(len(self.layout), np.inf)
        return {
            "states": len(self.layout),
            "rank": self.rank,
            "unseen": tuple(c.words for c in every),
            "weakest": tuple(c.words for c in self.weakest() if np.isfinite(c.factor)),
            "correlated": self.correlated(),
        }


def proper_prior(layout: Layout, prior_sd: FloatArray, *, finite: bool = True) -> FloatArray:
    """Return the standard deviations of a prior, or refuse them.

    `prior_sd` (n,): standard deviation of each before any data [SI unit]; `finite`: whether they
    are to serve as units: infinite ones are refused too. Raises one is missing, zero, negative or
    not finite.
    """
    sd = np.atleast_1d(np.asarray(prior_sd, float))
    if sd.shape != (len(layout),):
        raise error("observability.prior", names=f"{len(layout)} states", given=f"{sd.size} given")
    wrong = np.flatnonzero(~((sd > 0) & (np.isfinite(sd) | (not finite))))
    if len(wrong):
        raise error(
            "observability.prior",
            names=", ".join(layout.names[i] for i in wrong),
            given=", ".join(f"{sd[i]:g}" for i in wrong),
        )
    return sd


def information(at: Linearised, layout: Layout) -> Information:
    """Return the information that a linearised problem has about its coefficients.

    `at`: white residuals and Jacobian, the coefficients are the first columns.
    """
    root = gauss_newton.eliminate(at, len(layout))
    # What nuisance parameters take the whole of leaves rounding: it must not look like a signal.
    whole = np.linalg.norm(at.jacobian[:, : len(layout)], axis=0)
    root = np.where(np.linalg.norm(root, axis=0) > INVISIBLE * whole, root, 0.0)
    # Fewer observations than coefficients leave fewer rows.
    return Information(layout, np.pad(root, ((0, len(layout) - len(root)), (0, 0))))


def bound(problem: Problem, state: Any) -> dict[str, Any]:
    """Return the Cramer-Rao bound of a problem, and what is seen worst, for result.json.

    A prior counts in the bound, since it does in what is compared with it; what is seen worst is
    that of the readings.

    `problem`: with what is to count: most often the noise of the sensors and the prior alone.
    """
    info = information(problem.linearise(state, np.ones(problem.n_blocks)), problem.layout)
    whole = info if problem.prior is None else info.with_prior(problem.prior.prior_sd)
    return {"bound": whole.sd.tolist(), "weakest": [c.words for c in info.weakest()]}


def correlated(
    names: tuple[str, ...], rho: FloatArray, limit: float
) -> tuple[tuple[str, str, float], ...]:
    """Return the pairs whose `rho` (n, n) is beyond `limit` [1], strongest first."""
    first, second = np.triu_indices(len(names), 1)
    strong = np.argsort(-np.abs(rho[first, second]).round(9), kind="stable")
    return tuple(
        (names[i], names[j], float(rho[i, j]))
        for i, j in zip(first[strong].tolist(), second[strong].tolist(), strict=True)
        if abs(rho[i, j]) >= limit
    )
