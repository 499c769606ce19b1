"""What in a record at rest is no noise: a reading that settles, as while warming up, or jumps.

The noises of an Allan variance have stationary increments: what happens, happens at any time. One
event, a decay ``c exp(-t / tau)`` from the first sample or a step ``c [t >= t_1]``, makes slow
noises (a random walk, a bias instability) that are not there. It is sought in the differences z of
the means of `BLOCKS` blocks, whose covariance is that of white noise, flicker and random walk::

    z = r 1 + c b + e,    e ~ N(0, s^2 C_k),    b: differences of the means of the event

The ramp r is a noise of its own. With s^2 at its likeliest, ``-2 log L = n log(e' C_k^-1 e) +
log det C_k``; mixtures C_k of the three noises are tried on a lattice, with the event and without.
Twice the logarithm of the likelihood that the best event gains is held against `LIMIT`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.allan_fit import covariance_of_differences

BLOCKS = 64  # Parts of a record whose means are compared [1].
LIMIT = 24.0  # Of noise alone that much is gained in one of 500 records or fewer [1].
MOST = 3  # Events that are taken off one channel, at most [1].
_TIMES = np.geomspace(1 / 64, 1 / 2, 16)  # of decays, over the length of the record
_SHARES = np.concatenate([[0.0], 10.0 ** np.arange(-3, 2.1, 0.5)])  # of a noise beside white


@dataclass(frozen=True)
class Event:
    """One event of a record."""

    kind: str  # ``settles`` or ``jumps``
    change: float  # how far the reading ends from where it began, but for its ramp [unit]
    time: float  # time constant, or when it jumps after the first sample [samples]

    def shape(self, n: int) -> FloatArray:
        """Return what to take off `n` samples, shape (n,) [unit]."""
        k = np.arange(n, dtype=float)
        if self.kind == "settles":
            return np.asarray(-self.change * np.exp(-k / self.time))
        return np.asarray(self.change * (k >= self.time))


def calmed(rate: FloatArray) -> tuple[FloatArray, list[Event]]:
    """Return readings `rate` (n,) [unit] less the events that they show, and these."""
    events: list[Event] = []
    while len(events) < MOST and (event := _event(rate)) is not None:
        rate = rate - event.shape(len(rate))
        events.append(event)
    return rate, events


def _event(rate: FloatArray) -> Event | None:
    m = len(rate) // BLOCKS
    z = np.diff(rate[: m * BLOCKS].reshape(BLOCKS, m).mean(axis=1))
    gain, best, change = _likeliest(z) if z.any() else (0.0, 0, 0.0)
    if gain < LIMIT:
        return None
    if best < len(_TIMES):
        return Event("settles", -change, float(_TIMES[best] * m * BLOCKS))
    start = (best - len(_TIMES)) * m  # it jumps within two blocks
    around = rate[start : start + 2 * m]
    jump = np.argmax(np.abs(np.cumsum(around - around.mean()))[:-1])
    return Event("jumps", change, start + 1.0 + int(jump))


def _likeliest(z: FloatArray) -> tuple[float, int, float]:
    """Return what the best event gains in 2 log likelihood [1], which it is, and its c [unit]."""
    whiten, shapes, log_det = _lattice()
    e = whiten @ z  # (k, BLOCKS - 1)
    along = np.einsum("kij,ki->kj", shapes, e)  # shapes have unit length
    square = (e**2).sum(axis=1)
    n = len(z)
    without = n * np.log(square) + log_det
    left = np.maximum(square[:, None] - along**2, 1e-12 * square[:, None])
    cost = n * np.log(left) + log_det[:, None]
    k, best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    size = np.linalg.norm(whiten[k] @ _shapes()[:, best])
    return float(without.min() - cost[k, best]), int(best), float(along[k, best] / size)


@lru_cache(maxsize=1)
def _shapes() -> FloatArray:
    """Return differences of block means of every decay, then of every step, (BLOCKS - 1, j) [1]."""
    edges = np.arange(BLOCKS + 1)[:, None] / BLOCKS
    means = BLOCKS * _TIMES * (np.exp(-edges[:-1] / _TIMES) - np.exp(-edges[1:] / _TIMES))
    return np.column_stack([np.diff(means, axis=0), np.eye(BLOCKS - 1)])


@lru_cache(maxsize=1)
def _lattice() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return of every mixture what whitens z and takes off its ramp, shapes, and log det C.

    (k, BLOCKS - 1, BLOCKS - 1), (k, BLOCKS - 1, j) of unit length, (k,).
    """
    from scipy.linalg import toeplitz

    white, flicker, walk = (toeplitz(row / row[0]) for row in covariance_of_differences(BLOCKS - 1))
    mixtures = np.array([white + b * flicker + k * walk for b in _SHARES for k in _SHARES])
    root = np.linalg.cholesky(mixtures)
    whiten = np.linalg.inv(root)
    ramp = whiten.sum(axis=2, keepdims=True)
    ramp /= np.linalg.norm(ramp, axis=1, keepdims=True)
    whiten = whiten - ramp @ (ramp.transpose(0, 2, 1) @ whiten)
    shapes = whiten @ _shapes()
    shapes /= np.linalg.norm(shapes, axis=1, keepdims=True)
    return whiten, shapes, 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
