"""Which observation is wrong, and could it have been seen: data snooping and reliability.

With white residuals r = R e, ``R = I - J P J'`` the redundancy matrix and e the errors, an error
of observation j alone is tested by ``T_j = r_j' R_jj^-1 r_j``, chi-square with the rank of R_jj
degrees of freedom. What it must be to be noticed, and whether two observations would show the
same residuals, follow from R before anything has gone wrong.

References
----------
.. [1] W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
   Commission, Publications on Geodesy 2(5), 1968.
.. [2] W. Förstner, "Reliability and discernability of extended Gauss-Markov models", Deutsche
   Geodätische Kommission A98, 1983.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.infer.mixed import Fit
from foucault.result import Linearised

SEEN = 0.01
"""An observation of which a smaller share than this is redundant is not controlled at all [1]."""

POWER = 4.13
"""An error of this many sd, over the root of its redundancy, is found in 80 % of all cases by a
test that is wrong in 0.1 % [1]; ref. [1]."""

ALIKE = 0.95  # Two observations whose tests are correlated more than this cannot be told apart [1].


LOCAL, PLACES, NEAR = 0.3, 3, 0.02
"""What is wrong in more than the first as a share of a log, or in more than the second of places
that are farther apart than the third as a share of it, is no mishap [1]."""

FAR = 0.25  # Rows beyond this share of the worst one's square are left out with it [1].

UNEVEN = 1.2
"""Mean square over that of noise of the same median: of 300 rows white noise is beyond in one of
10,000 logs [1]."""


@dataclass(frozen=True)
class Snooping:
    """The tests of all observations, k of them."""

    blocks: IntArray  # (k,) number of each observation
    test: FloatArray  # (k,) T_j [1]
    dof: FloatArray  # (k,) its degrees of freedom; 0 where nothing controls the observation [1]
    # (k,) share of the best controlled direction of the observation that is redundant, 0 to 1 [1]
    redundancy: FloatArray
    direction: FloatArray  # (k, rows) that direction, in white residuals [1]
    # (k, k) correlation of the tests, without sign: 1 for observations that look alike [1]
    correlation: FloatArray

    @property
    def detectable(self) -> FloatArray:
        """Smallest error that would be noticed, shape (k,) [sd of the observation]."""
        with np.errstate(divide="ignore"):
            return np.where(self.dof > 0, POWER / np.sqrt(self.redundancy), np.inf)

    def alike(self, j: int) -> IntArray:
        """Return the observations that would show the same residuals as row `j` [1]."""
        same = np.flatnonzero(self.correlation[j] > ALIKE)
        return np.asarray(self.blocks[same[same != j]])


def snoop(at: Linearised, state_cov: FloatArray, rows: int = 3) -> Snooping:
    """Test every observation of a problem at its solution.

    `state_cov` (n, n): covariance of everything estimated there; `rows`: rows of each
    observation, one after the other [1].
    """
    used = at.blocks >= 0
    J, blocks = at.jacobian[used], at.blocks[used].reshape(-1, rows)[:, 0]
    R = np.eye(len(J)) - J @ state_cov @ J.T
    return _snooped(R, at.residuals[used].reshape(-1, rows), blocks)


def snoop_fit(fit: Fit) -> Snooping:
    """Test every reading of a mixed model; its direction is over what each has for itself.

    Where sources tie readings together, with their covariance C and L L' what each has for itself,
    ``R = L' (C^-1 - C^-1 J P J' C^-1) L`` and ``r = L' C^-1 e``.
    """
    (n, d), at = fit.at.residuals.shape, fit.white
    if not fit.covariance.shared.size:
        return snoop(at, fit.estimate.state_cov, d)
    roots = np.linalg.cholesky(fit.covariance.own)
    wide = np.zeros((n, d, n, d))
    wide[np.arange(n), :, np.arange(n), :] = roots
    E = fit.covariance.whiten(wide.reshape(n, d, n * d))
    J = E.T @ at.jacobian[: n * d]
    R = E.T @ E - J @ fit.estimate.state_cov @ J.T
    return _snooped(R, (E.T @ at.residuals[: n * d]).reshape(n, d), np.arange(n))


def _snooped(R: FloatArray, r: FloatArray, blocks: IntArray) -> Snooping:
    k, rows = r.shape
    own = R.reshape(k, rows, k, rows)[np.arange(k), :, np.arange(k), :]
    values, vectors = np.linalg.eigh((own + np.swapaxes(own, 1, 2)) / 2)
    seen = values > SEEN
    along = np.einsum("kij,ki->kj", vectors, r)
    test = np.sum(np.where(seen, along**2 / np.where(seen, values, 1.0), 0.0), axis=1)
    direction = vectors[:, :, -1]
    cross = np.einsum("ki,kilj,lj->kl", direction, R.reshape(k, rows, k, rows), direction)
    size = np.sqrt(np.maximum(np.diag(cross), SEEN))
    return Snooping(
        blocks=blocks,
        test=test,
        dof=seen.sum(axis=1).astype(float),
        redundancy=np.clip(values[:, -1], 0.0, 1.0),
        direction=direction,
        correlation=np.abs(cross / np.outer(size, size)),
    )


def uneven(square: FloatArray, q: int) -> tuple[bool, float]:
    """Tell whether sums of `square` (b,) of `q` white residuals each are not of noise alone [1].

    Returns also beyond which of them none is by chance [1].
    """
    from scipy.special import chdtri

    noise = np.median(square) / chdtri(q, 0.5)
    limit = float(noise * chdtri(q, FALSE_ALARM / len(square)))
    return bool(square.mean() > UNEVEN * q * noise), limit


def mishaps(
    residuals: FloatArray, slopes: FloatArray, information: FloatArray, gradient: FloatArray
) -> IntArray:
    """Return the rows of a long log from which on it does not belong to the others for a while.

    None where it does so too long or too often, or where all is even. What the whitening carries on
    from a row that is wrong makes others wrong after it.

    `residuals` (b, q), `slopes` (b, q, n): white rows in the order of time [1]; `information`
    (n, n), `gradient` (n,): of what was known beforehand [1].
    """
    b, q, _ = slopes.shape
    out, numbers = np.zeros(b, bool), np.arange(b)
    N = information + np.einsum("bqi,bqj->ij", slopes, slopes, optimize=True)
    g = gradient + np.einsum("bqi,bq->i", slopes, residuals, optimize=True)
    while out.sum() <= LOCAL * b:
        square = np.sum((residuals - slopes @ np.linalg.solve(N, g)) ** 2, axis=1)
        spoilt, limit = uneven(square[~out], q)
        if not spoilt:
            at = numbers[out & (square > limit)]
            first = at[np.diff(at, prepend=-b) > NEAR * b]
            return np.asarray(first if len(first) <= PLACES else first[:0])
        new = ~out & (square > FAR * square[~out].max())
        out |= new
        N = N - np.einsum("bqi,bqj->ij", slopes[new], slopes[new])
        g = g - np.einsum("bqi,bq->i", slopes[new], residuals[new])
    return numbers[:0]
