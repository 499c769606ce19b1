"""The Rauch-Tung-Striebel smoother of an error-state filter that feeds its errors back.

With F the transition from one epoch to the next, P- and P+ the covariances before and after each
update, X what the update fed back, and c what is still wrong with the states of the filter as seen
from the end (zero at the last epoch)::

    G_k = P+_k F' (P-_k+1)^-1
    c_k = G_k (c_k+1 + X_k+1),      P_k = P+_k + G_k (P_k+1 - P-_k+1) G_k'

because the filter expects no error once it has fed it back.

References
----------
.. [1] H. E. Rauch, F. Tung, C. T. Striebel, "Maximum likelihood estimates of linear dynamic
   systems", *AIAA Journal* 3 (1965) 1445-1450.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.ins_filter import FilterRun
from foucault.kernels.ins_filter import corrected
from foucault.navigate.strapdown import Trajectory


@dataclass(frozen=True)
class Smoothed:
    """A filter run as seen from its end."""

    trajectory: Trajectory  # states at the epochs
    coefficients: FloatArray  # (m, p) coefficients [SI]
    cov: FloatArray  # (m, 9 + p, 9 + p) covariances [SI]

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (m, 9 + p) [SI]."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))


def smooth(found: FilterRun) -> Smoothed:
    """Smooth a run of `estimate.ins_filter.run` made with ``keep=True``."""
    m, n = found.sd.shape
    if len(found.transitions) != m:
        raise ValueError("a run to be smoothed must be made with keep=True")
    c = np.zeros((m, n))
    cov = found.after.copy()
    kept = np.exp(-np.diff(found.time)[:, None] * found.decay)
    forgotten = np.ones(m)
    for begin in found.begins:
        kept[begin - 1], forgotten[begin] = found.decay == 0, 0.0
    size = np.sqrt(np.diagonal(found.before, axis1=1, axis2=2))
    A = np.empty((n, n))
    for k in range(m - 2, -1, -1):
        before = found.before[k + 1]
        # P+ F', of whose rows those of the coefficients are diagonal.
        A[:, :9] = forgotten[k + 1] * (found.after[k] @ found.transitions[k + 1].T)
        A[:, 9:] = found.after[k][:, 9:] * kept[k]
        G = _divided(A, before, size[k + 1])
        c[k] = G @ (c[k + 1] + found.corrections[k + 1])
        cov[k] += G @ (cov[k + 1] - before) @ G.T
    states = corrected(found.trajectory.history, c)
    return Smoothed(Trajectory(found.time, states), found.coefficients + c[:, 9:], cov)


def _divided(A: FloatArray, P: FloatArray, size: FloatArray) -> FloatArray:
    """Return A P^-1 for a covariance whose states have units of very different size."""
    from scipy.linalg import pinvh
    from scipy.linalg.lapack import dposv

    if not size.all():  # what is known exactly needs no correction
        seen = size > 0
        out = np.zeros_like(A)
        out[:, seen] = _divided(A[:, seen], P[np.ix_(seen, seen)], size[seen])
        return out
    R, rows = P / np.outer(size, size), A / size
    # Once for every epoch: LAPACK itself takes half of the time of `scipy.linalg.cho_solve`.
    _, x, info = dposv(R, rows.T, lower=1)
    if info != 0:  # without noise some combination is known to rounding
        x = pinvh(R, rtol=1e-12) @ rows.T
    return np.asarray(x.T / size)
