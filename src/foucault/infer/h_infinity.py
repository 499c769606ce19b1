"""The a-posteriori H-infinity filter of any linear system.

Whatever the noise does, as long as the filter exists the energy of its error of ``L x`` stays below
``gamma^2`` times that of start error, process and measurement noise, each counted by the inverse of
the covariance it was given::

    sum |L (x - x_est)|^2  <  gamma^2 (|x0 - x0_est|^2_P0^-1 + sum |w|^2_Q^-1 + sum |v|^2_R^-1)

It is a Kalman filter whose covariance is made larger along L after every update, by as much as
gamma demands (as measurements of negative variance: design/README.md); with gamma infinite it is
the Kalman filter. There is a least gamma, below which it
does not exist; it depends on the system, its covariances and L, and is found by trying.

What it is worth: insurance against covariances that are somewhat too small, at the cost of a little
noise. It does not rescue a wrong model, and its covariance is not that of its error.

References
----------
.. [1] B. Hassibi, A. H. Sayed, T. Kailath, "Linear estimation in Krein spaces, part II:
   applications", *IEEE Transactions on Automatic Control* 41 (1996) 34-49, theorem 1.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.infer.linear_filter import LinearRun, LinearSystem, bounded

WIDEST = 1e12
"""A gamma beyond which no filter is looked for [1]."""


def by_prior(system: LinearSystem) -> FloatArray:
    """Return the L that wants every state, in units of its uncertainty at the start, (n, n).

    `system`: the system, states that are known exactly at the start are not wanted.
    """
    sd = np.sqrt(np.diag(system.P0))
    return np.diag(1.0 / sd[sd > 0]) if (sd > 0).all() else np.diag(1.0 / sd)[sd > 0]


def h_infinity(system: LinearSystem, L: FloatArray, gamma: float) -> LinearRun:
    """Run the H-infinity filter.

    `L` (r, n): what is wanted, each row in units in which errors shall be compared [SI]; `gamma`:
    bound of the error, infinite for a Kalman filter [1]. Returns where the filter ceased to exist
    `stopped` is the epoch, and nothing is known from there on. Raises A gamma that is not
    positive, or an L that does not fit the states.
    """
    if not gamma > 0:
        raise error("h_infinity.gamma", given=f"{gamma:g}")
    if L.ndim != 2 or L.shape[1] != len(system.x0):
        raise error("h_infinity.wanted", shape=L.shape, states=len(system.x0))
    return bounded(system, L, gamma**2)


def least_gamma(system: LinearSystem, L: FloatArray, *, within: float = 0.01) -> float:
    """Return the least gamma, to so much of itself, for which the filter exists to the end.

    `L` (r, n): what is wanted [SI]; `within`: relative tolerance, what is returned exists [1].
    """

    def exists(gamma: float) -> bool:
        return h_infinity(system, L, gamma).stopped is None

    high = 1.0
    while not exists(high):
        high *= 4.0
        if high > WIDEST:
            raise error("h_infinity.none", tried=f"{WIDEST:g}")
    low = high / 4.0
    while exists(low):
        low, high = low / 4.0, low
        if low < 1.0 / WIDEST:  # nothing is wanted
            return high
    while high > low * (1.0 + within):
        middle = float(np.sqrt(low * high))
        if exists(middle):
            high = middle
        else:
            low = middle
    return high
