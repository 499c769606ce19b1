"""All offsets of two logs of turning at once: which of them fits, and with which mounting.

With s and m the turning of slave and master over intervals of one length, less their means, an
offset tau fits as well as the gain ``max over C of sum s(t - tau)' C' m(t)`` is large against the
sizes of both; C is a rotation (Wahba's problem) or known. Sums for all offsets are correlations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.estimate.delay.turned import Turns
from foucault.navigate.increments import Increments

FINER = 4
"""Offsets lie so many times closer than the intervals, over which all is averaged [1]."""

OVERLAP = 0.2
"""So much of the shorter log both must have in common [1]."""

LEAST = 20
"""And so many intervals [1]."""

PEAKS = 4
"""Peaks that are followed [1]."""

ROUNDING = 1e-12
"""Variances below this part of the mean squares are rounding [1]."""

NEARLY = 0.1
"""A peak whose correlation is lower than the best by more is not [1]."""


@dataclass(frozen=True)
class Offsets:
    """How well each offset fits."""

    tau: FloatArray  # (n,) offsets, rising [s]
    # (n,) correlation at each, with the best mounting or the known one; at most 1 [1]
    likeness: FloatArray
    products: FloatArray  # (n, 3, 3) sums of s m' [rad^2]
    ratio: FloatArray  # (n,) how many times as much the slave turns [1]

    @property
    def size(self) -> float:
        """How many times as much the slave turns, at the best offset [1]."""
        return float(self.ratio[np.argmax(self.likeness)])

    @property
    def low(self) -> float:
        """The lowest offset [s]."""
        return float(self.tau[0])

    @property
    def high(self) -> float:
        """The highest offset [s]."""
        return float(self.tau[-1])

    @property
    def peaks(self) -> FloatArray:
        """The best offsets, the very best first, shape (1..PEAKS,) [s]."""
        x = np.concatenate([[-np.inf], self.likeness, [-np.inf]])
        top = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:]))
        if not len(top):
            return self.tau[:1]
        order = top[np.argsort(-self.likeness[top])]
        best = self.likeness[order[0]]
        return np.array([self._top(i) for i in order[:PEAKS] if self.likeness[i] > best - NEARLY])

    def _top(self, i: int) -> float:
        """Return the top of the parabola through a peak and its neighbours."""
        if not 0 < i < len(self.tau) - 1:
            return float(self.tau[i])
        a, b, c = self.likeness[i - 1 : i + 2]
        bend = a - 2 * b + c
        shift = 0.5 * (a - c) / bend if bend < 0 else 0.0
        return float(self.tau[i] + shift * (self.tau[1] - self.tau[0]))

    def at_edge(self, tau: float) -> bool:
        """Tell whether an offset lies at an end.

        `tau`: the offset [s].
        """
        step = self.tau[1] - self.tau[0] if len(self.tau) > 1 else 0.0
        return bool(min(tau - self.low, self.high - tau) < step / 2)

    def mounting(self, tau: float) -> FloatArray:
        """Return the mounting C_ms that fits best at an offset, shape (3, 3).

        `tau`: the offset [s].
        """
        row = int(np.argmin(np.abs(self.tau - tau)))
        U, _, Vt = np.linalg.svd(self.products[row])
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
        return np.asarray((U @ sign @ Vt).T)  # C_sm fits, s = C_sm m


def scan(
    increments: Increments, turns: Turns, usable: BoolArray, C_ms: FloatArray | None,
    bracket: tuple[float, float] | None,
) -> Offsets | None:  # fmt: skip
    """Return how well each offset of a bracket fits.

    `increments`: the slave [SI]; `usable` (k,): which of its turns count; `C_ms` (3, 3) or None:
    the mounting, where it is known; `bracket`: where to look [s], None for as far as they
    overlap, more coarsely. Returns None where they have too little in common at every offset.
    """
    h, begin, end = turns.interval, float(turns.start[0]), float(turns.end[-1])
    first, last = float(increments.time[0]), float(increments.time[-1])
    least = max(LEAST, round(OVERLAP * min(end - begin, last - first) / h))
    finer = int(np.clip(np.ceil(h / np.median(increments.dt)), 1, FINER))
    if bracket is None:
        bracket, finer = (begin - last, end - first), min(finer, 2)
    step = h / finer
    master = _on_grid(begin, h, round((end - begin) / h), turns, usable)
    # Ends of the slave's intervals at `begin + i step`, i from `base`, one table for each remainder
    base = int(np.ceil((first - begin) / step))
    grid = begin + step * np.arange(base, int(np.floor((last - begin) / step)) + 1)
    angle = np.cumsum(increments.dtheta_b, axis=0)
    path = np.stack([np.interp(grid, increments.time, a) for a in angle.T], axis=1)
    turned = [np.diff(path[p::finer], axis=0) for p in range(finer)]
    tau, fits = [], []
    for lag in range(int(np.floor(bracket[0] / step)), int(np.ceil(bracket[1] / step)) + 1):
        skip, phase = divmod(-lag - base, finer)  # row k of the master, row k + skip of the slave
        s = turned[phase] if phase < len(turned) else path[:0]
        m = master[max(0, -skip) : max(0, len(s) - skip)]
        s = s[max(0, skip) :][: len(m)]
        if np.sum(m[:, 3]) < least:
            continue
        tau.append(lag * step)
        fits.append(_fit(s, m, C_ms))
    if not tau:
        return None
    products, likeness, ratio = (np.array(column) for column in zip(*fits, strict=True))
    return Offsets(np.array(tau), likeness, products, ratio)


def _on_grid(begin: float, h: float, rows: int, turns: Turns, usable: BoolArray) -> FloatArray:
    """Return turns over equal intervals, and whether each is known, shape (rows, 4)."""
    out = np.zeros((rows, 4))
    place = np.round((turns.start - begin) / h).astype(int)
    single = usable & (np.round(turns.dt / h) == 1) & (place < rows)
    out[place[single], :3] = turns.phi_m[single]
    out[place[single], 3] = 1.0
    return out


def _fit(s: FloatArray, m: FloatArray, C_ms: FloatArray | None) -> tuple[FloatArray, float, float]:
    """Return the sum of s m' less the means, the correlation and the ratio of the sizes."""
    n = m[:, 3].sum()
    both = s.T @ m
    s_mean, m_mean = both[:, 3] / n, m[:, :3].sum(axis=0) / n
    A = both[:, :3] - n * np.outer(s_mean, m_mean)
    squares = np.array([np.einsum("ka,ka,k->", s, s, m[:, 3]), np.sum(m[:, :3] ** 2)])
    means = n * np.array([s_mean @ s_mean, m_mean @ m_mean])
    if np.any(squares - means <= ROUNDING * squares):  # one does not turn, or at one rate only
        return A, 0.0, 1.0
    s_size, m_size = np.sqrt(squares - means)
    if C_ms is None:
        w = np.linalg.svd(A, compute_uv=False)
        gain = w[0] + w[1] + np.sign(np.linalg.det(A)) * w[2]
    else:
        gain = np.einsum("ij,ji->", A, C_ms)
    return A, float(gain / (s_size * m_size)), float(s_size / m_size)
