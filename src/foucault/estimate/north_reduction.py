"""From the readings of a set-up to the four numbers that say everything of its attitude.

Each reading is linear in the rates c, s along y_b and x_b, and in what is of no interest::

    gyro_k = c cos a_k + s sin a_k + offset + drift (t_k - t_mid) + noise

Generalised least squares with the full covariance of the noise (white, bias instability and random
walk, exactly averaged over each dwell) gives (s, c); accelerometers likewise. Nothing is lost: for
Gaussian noise the four numbers with their covariance carry all the information of the readings.
The covariance is kept apart by source, because the weights are known: ``sum_s W Sigma_s W'``.

Set-ups with as many stops are reduced at once; where these are the same at the same times, they
share their weights.

Every solution that a set-up has, and which of them is taken.

Two components of the Earth's rate leave two signs of the third, and with stops that show one
direction only a circle of headings. Maximum likelihood is started from all of them; what fits alike
is told apart by what is known of hemisphere and rough heading, and the next best is kept
(design/README.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray, transposed
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise, mean_variance, window_covariance
from foucault.models.north_seeker import Compensation, Dwells
from foucault.models.rotation import turned

UNSEEN = 1e4
"""Variance, in squares of the Earth's rate or of g, of a component that no reading shows; larger,
and rounding would lose what is seen of the component across it [1]."""

GRAVITY = 9.8
"""Scale of specific force, for `UNSEEN` only [m/s^2]."""

GYRO_NOISE, GYRO_DRIFT, GYRO_OFFSET = "gyro noise", "gyro drift", "gyro offset"
TILT_NOISE, TILT_DRIFT, INDEXING = "tilt: noise", "tilt: drift", "indexing"

NEARLY_FREE = 1.1
"""A drift is estimated by itself where it makes no rate less certain than by this factor [1]."""


@dataclass(frozen=True)
class Nuisance:
    """What is known of offset, drift and index angles beforehand."""

    # offset, offset_sd: the gyro's constant offset and its standard deviation, infinite where
    # nothing is known [rad/s]
    offset: float = 0.0
    offset_sd: float = np.inf
    # of its linear drift; 0 for none, infinite where it is estimated freely [rad/s^2]
    drift_sd: float = 0.0
    index_sd: float = 0.0  # of every index angle [rad]
    # of the time between the index angle and the middle of the gyro's reading, which matters where
    # the base turns [s]
    lag_sd: float = 0.0


class Roots(NamedTuple):
    """Roots of the covariances of sources, side by side: they are read where they were made."""

    each: FloatArray  # (m, 4, c) [SI]
    names: tuple[str, ...]  # of g sources, empty of one that does nothing
    first: IntArray  # (g + 1,) where each begins, and the last ends [1]

    @classmethod
    def none(cls, m: int, *names: str) -> Roots:
        """Return no root, of `m` set-ups [1]; `names`: of what has none."""
        return cls(np.zeros((m, 4, 0)), names, np.zeros(1, np.int64))

    @property
    def parts(self) -> list[FloatArray]:
        """Those of each source, (m, 4, c) [SI]."""
        return [self.each[:, :, slice(*at)] for at in pairwise(self.first.tolist())]

    def turned(self, T: FloatArray) -> Roots:
        """Return how much of them is in other numbers, by `T` (m, 4, 4) [1]."""
        turned = [self.each[:, :, :0], *(T @ B for B in self.parts)]
        return self._replace(each=np.concatenate(turned, axis=2))

    @property
    def felt(self) -> Roots:
        """The same without the names of those that do nothing."""
        felt = (B[:1].any() or B.any() for B in self.parts)
        names = (n if some else "" for n, some in zip(self.names, felt, strict=True))
        return self._replace(names=tuple(names))


@dataclass(frozen=True)
class Pairs:
    """The four numbers of m set-ups, in the order gyro x, gyro y, accelerometer x, y."""

    # (m, 4) rate along x_b and y_b [rad/s], specific force along them [m/s^2], as measured
    values: FloatArray
    sources: dict[str, FloatArray]  # (m, 4, 4) covariance by source [SI]
    # offset, drift: (m,) of the gyro [rad/s], [rad/s^2]
    offset: FloatArray
    drift: FloatArray
    # (m, 4) what a linear drift of 1 rad/s^2 that is not estimated does to the four numbers [s]
    drift_slope: FloatArray
    fit: FloatArray  # (n,) of every gyro reading [rad/s]
    # residuals, accel_residuals: (n,) of every reading over its standard deviation, NaN where
    # nothing controls it [1]
    residuals: FloatArray
    accel_residuals: FloatArray
    # chi_square, dof: (m, 2) sum of squares of the white residuals of gyro and accelerometers [1]
    chi_square: FloatArray
    dof: IntArray
    # (n, q) white residuals of the q accelerometers, independent but for what the fit took [1]
    accel_white: FloatArray = field(default_factory=lambda: np.zeros((0, 1)))
    # gyro_weights, accel_weights: (n, 2), (n, q, 2) what a reading adds to its set-up's rates, and
    # to its specific forces, along x_b and y_b [1]
    gyro_weights: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    accel_weights: FloatArray = field(default_factory=lambda: np.zeros((0, 1, 2)))
    roots: tuple[Roots, ...] = ()  # more sources
    # (g, k) rows [1] of alike set-ups, and how their accelerometers were fitted; None: no readings
    accel_fits: list[tuple[IntArray, Any]] | None = None

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def cov(self) -> FloatArray:
        """Covariance of all sources together, shape (m, 4, 4) [SI]."""
        from foucault.kernels.north_seeking import together_batch

        out = np.zeros((len(self), 4, 4))
        for S in self.sources.values():
            out += S
        for roots in self.roots or (Roots.none(len(self)),):  # which makes it symmetric to the bit
            together_batch(out[None], roots.each, out)
        return out

    def shares(self, gain: FloatArray) -> dict[str, FloatArray]:
        """Return the variances (m, a) of angles by source, by their `gain` (m, a, 5) [rad^2]."""
        from foucault.kernels.north_seeking import shares_batch

        m, found = len(self), dict[str, FloatArray]()
        parts = [(Roots.none(m, name), S[None]) for name, S in self.sources.items()]
        parts += [(roots, np.zeros((0, m, 4, 4))) for roots in self.roots]
        for roots, S in parts:
            out = np.empty((len(roots.names), *gain.shape[:2]))
            shares_batch(gain, S, roots.each, roots.first, out)
            found |= {name: v for name, v in zip(roots.names, out, strict=True) if name}
        return found

    def together(self, some: IntArray) -> Pairs:
        """Return set-ups `some` (k,) [1] with all sources as one, for their solutions alone."""
        return replace(self, values=self.values[some], sources={"": self.cov[some]}, roots=())

    @property
    def noise_alone(self) -> Pairs:
        """The same with the white noise alone, for a bound."""
        kept = {k: v for k, v in self.sources.items() if k in (GYRO_NOISE, TILT_NOISE)}
        return replace(self, sources=kept, roots=())

    @property
    def results(self) -> Pairs:
        """The same without its readings, and what only its solution needs."""
        none, gyro, accel = np.zeros(0), np.zeros((0, 2)), np.zeros((0, 1, 2))
        return replace(self, sources={}, roots=(), drift_slope=np.zeros((0, 4)),
                       accel_white=np.zeros((0, 1)), fit=none,
                       residuals=none, accel_residuals=none,
                       gyro_weights=gyro, accel_weights=accel, accel_fits=None)  # fmt: skip

    def worst(self, first: IntArray) -> tuple[FloatArray, IntArray]:
        """Return how far the gyro's worst reading of every set-up is off [sd], and which it is [1].

        `first` (m + 1,): number of the first reading of each [1].
        """
        size = np.abs(np.nan_to_num(self.residuals))
        most = np.maximum.reduceat(size, first[:-1])
        at = np.flatnonzero(size == np.repeat(most, np.diff(first)))
        return most, at[np.searchsorted(at, first[:-1])] - first[:-1]


@dataclass
class _Fit:
    """One linear fit of g set-ups with k stops each; what they share has one row."""

    weights: FloatArray  # (g, p, k) of p unknowns from k readings
    design: FloatArray  # (g, k, p) readings from unknowns
    # (g, k, k) of the covariance of the readings, one over its diagonal there
    root: FloatArray
    white: FloatArray  # (g, k) its white part
    slow: FloatArray  # (g, k, k) what wanders
    redundancy: FloatArray  # (g, k) of each reading [1]
    dof: IntArray  # (g,) readings that are not spent [1]
    unseen: FloatArray  # (g,) of the first two unknowns, as of `kernels.means` [1]


@dataclass
class _Seen:
    """What g set-ups with k stops each say by a fit, and what that leaves."""

    unknowns: FloatArray  # (g, p) [SI]
    expected: FloatArray  # (g, k) readings [SI]
    residuals: FloatArray  # (g, k) over their standard deviations, NaN where nothing controls them
    white: FloatArray  # (g, k) white residuals [1]
    square: FloatArray  # (g,) sum of their squares [1]


def reduce(dwells: Dwells, noise: ImuNoise, nuisance: Nuisance | None = None) -> Pairs:
    """Reduce set-ups to their four numbers, by noise and what is known of the rest [SI]."""
    from foucault.kernels.means import carried_batch

    nuisance = nuisance or Nuisance()
    n, m = len(dwells), len(dwells.names)
    values, slope = np.zeros((m, 4)), np.zeros((m, 4))
    wander, lean = (x.bias_instability or x.random_walk for x in (noise.gyro, noise.accel))
    drifts, known = 0 < nuisance.drift_sd < np.inf, np.isfinite(nuisance.offset_sd)
    there = {GYRO_NOISE: True, GYRO_DRIFT: wander or drifts, GYRO_OFFSET: known, TILT_NOISE: True,
             TILT_DRIFT: lean, INDEXING: nuisance.index_sd or nuisance.lag_sd}  # fmt: skip
    parts = {name: np.zeros((m if some else 0, 4, 4)) for name, some in there.items()}
    offset, drift = np.zeros(m), np.zeros(m)
    fit, residuals = np.zeros(n), np.full((2, n), np.nan)
    chi_square, dof = np.zeros((m, 2)), np.zeros((m, 2), np.int64)
    accel_white: FloatArray = np.zeros((n, 1) if dwells.accel is None else dwells.accel.shape)
    gyro_weights, accel_weights = np.zeros((n, 2)), np.zeros((*accel_white.shape, 2))
    fits = list[tuple[IntArray, Any]]()
    for setups, rows, first, (gyro, said), force in _looked(dwells, noise, nuisance):
        k, unknowns = rows.shape[1], said.unknowns
        values[setups, :2], offset[setups] = unknowns[:, :2], unknowns[:, 2] + nuisance.offset
        drift[setups] = unknowns[:, 3] if unknowns.shape[1] > 3 else 0.0
        fit[rows], residuals[0, rows] = said.expected + nuisance.offset, said.residuals
        chi_square[setups, 0], dof[setups, 0] = said.square, gyro.dof
        W = gyro.weights[:, :2]
        gyro_weights[rows] = transposed(W)
        carried_batch(np.ascontiguousarray(W), gyro.white, gyro.slow, setups, 0, parts[GYRO_NOISE],
                      parts[GYRO_DRIFT])  # fmt: skip
        _unseen(gyro, EARTH_RATE, parts[GYRO_NOISE][:, :2, :2], setups)
        slope[setups, :2] = moved = np.einsum("gpk,gk->gp", W, _drifting(first))
        if drifts:  # what the prior leaves of it, at its full size
            parts[GYRO_DRIFT][setups, :2, :2] += nuisance.drift_sd**2 * _square(moved)
        if known:
            moved = W.sum(axis=2)
            parts[GYRO_OFFSET][setups, :2, :2] = nuisance.offset_sd**2 * _square(moved)
        V = np.zeros((1, 2, k))  # of two accelerometers on the case no index angle is wrong
        if force is not None:
            accel, said = force
            fits.append((rows, accel))
            values[setups, 2:] = said.unknowns[:, :2]
            chi_square[setups, 1], dof[setups, 1] = said.square, accel.dof
            U = np.ascontiguousarray(accel.weights[:, :2])
            if accel_white.shape[1] == 1:
                V = accel.weights[:, :2]
                residuals[1, rows], accel_white[rows, 0] = said.residuals, said.white
                accel_weights[rows, 0] = transposed(V)
            else:
                accel_white[rows] = said.white
                accel_weights[rows] = transposed(accel.weights).reshape(-1, k, 2, 2)
            carried_batch(U, accel.white, accel.slow, setups, 2, parts[TILT_NOISE],
                          parts[TILT_DRIFT])  # fmt: skip
            _unseen(accel, GRAVITY, parts[TILT_NOISE][:, 2:, 2:], setups)
        else:
            parts[TILT_NOISE][setups, 2:, 2:] = UNSEEN * GRAVITY**2 * np.eye(2)
        if there[INDEXING]:
            parts[INDEXING][setups] = _indexing(first, W, V, values[setups], nuisance)
    used = {k: v for k, v in parts.items() if v[:1].any() or v.any()}
    return Pairs(values, used, offset, drift, slope, fit, residuals[0], residuals[1],
                 chi_square, dof, accel_white, gyro_weights, accel_weights,
                 accel_fits=fits)  # fmt: skip


@dataclass(frozen=True)
class Squares:
    """What the fits of m set-ups leave, without all else."""

    chi_square: FloatArray  # (m, 2) as of `Pairs` [1]
    dof: IntArray  # (m, 2) as of `Pairs` [1]

    @classmethod
    def of(cls, dwells: Dwells, noise: ImuNoise, nuisance: Nuisance) -> Squares:
        """Look at set-ups as `reduce` does."""
        shape = len(dwells.names), 2
        out = cls(np.zeros(shape), np.zeros(shape, np.int64))
        for setups, _, _, *seen in _looked(dwells, noise, nuisance):
            for k, one in enumerate(seen):
                if one is not None:
                    out.chi_square[setups, k], out.dof[setups, k] = one[1].square, one[0].dof
        return out


def _looked(
    dwells: Dwells, noise: ImuNoise, nuisance: Nuisance
) -> Iterator[tuple[IntArray, IntArray, Dwells, tuple[_Fit, _Seen], tuple[_Fit, _Seen] | None]]:
    """Yield what `_alike` does, and what the gyro and the accelerometers say by their fits."""
    for setups, rows, first in _alike(dwells):
        index_sd = 0.0 if first.rotates else nuisance.index_sd  # of one error nothing is left
        x = dwells.gyro[rows] - nuisance.offset
        gyro = _seen(*_of_gyro(first, nuisance), first, noise.gyro, EARTH_RATE, x, index_sd)
        accel = None
        if dwells.accel is not None and dwells.accel.shape[1] == 1:
            x = dwells.accel[rows, 0]
            accel = _seen(*_of_accel(first), first, noise.accel, GRAVITY, x, index_sd)
        elif dwells.accel is not None:
            fit = _two_fit(first, noise.accel)
            A = dwells.accel[rows].reshape(len(rows), -1)
            found = _times(fit.weights, A)
            expected = _times(fit.design, found)
            white = _whitened(fit.root, (A - expected).reshape(*rows.shape, -1))
            square = np.sum(white**2, axis=(1, 2))
            # dof: of the scatter alone
            accel = replace(fit, dof=2 * fit.dof), _Seen(found, expected, white, white, square)
        yield setups, rows, first, gyro, accel


def rates_of(
    dwells: Dwells, noise: ImuNoise, nuisances: Sequence[Nuisance]
) -> Iterator[list[tuple[FloatArray, IntArray]]]:
    """Yield the covariance (g, 2, 2) of the two rates and the redundant readings (g,) of groups.

    Of each of `nuisances`, by stops and noise alone, whatever was read there: set-ups with the same
    stops have one row.

    `dwells`: the stops [SI]; `noise`, `nuisances`: [SI]. Yields [rad^2/s^2], [1].
    """
    for _, _, d in _alike(dwells):
        out = []
        for nuisance in nuisances:
            fit = _fit(*_of_gyro(d, nuisance), d, noise.gyro, EARTH_RATE)
            W = fit.weights[:, :2]
            cov = (W * fit.white[:, None]) @ transposed(W) + W @ fit.slow @ transposed(W)
            _unseen(fit, EARTH_RATE, cov, np.arange(len(cov)))
            out.append((cov, fit.dof))
        yield out


def left_white(pairs: Pairs, more: FloatArray) -> FloatArray:
    """Return what the fits leave of something added to the accelerometers, as white residuals.

    `pairs`: set-ups with their readings [SI]; `more` (n, q, c): c columns of what is added to these
    [m/s^2]. Returns (n, q, c) [1].
    """
    out, c = np.zeros_like(more), more.shape[2]
    for rows, fit in pairs.accel_fits or ():
        g, k = rows.shape
        left = np.eye(fit.design.shape[1]) - fit.design @ fit.weights
        left = _whitened(fit.root, left.reshape(len(left), k, -1)).reshape(left.shape)
        x = more[rows].reshape(g, -1, c)
        if len(left) == 1:  # as one product: of many small ones each costs a call
            side = np.swapaxes(x, 0, 1).reshape(-1, g * c)
            x = np.swapaxes((left[0] @ side).reshape(-1, g, c), 0, 1)
        else:
            x = left @ x
        out[rows] = x.reshape(g, k, *more.shape[1:])
    return out


AT_ONCE = 1 << 16
"""Numbers that the covariances of set-ups fitted together may have: the cache holds them [1]."""


def _alike(dwells: Dwells) -> Iterator[tuple[IntArray, IntArray, Dwells]]:
    """Yield groups of set-ups with k stops: their numbers (g,), rows (g, k), and when and where.

    These have one row where all stops of the group are the same, else g [SI].
    """
    edges = dwells.first
    count = np.diff(edges)
    still = np.zeros(len(count), bool)
    if dwells.turning is not None and dwells.turning.any():
        still = np.bincount(dwells.setup, ~dwells.turning, len(count)) > 0
    kind = 2 * count + still
    for one in np.unique(kind).tolist():
        alike, k = np.flatnonzero(kind == one), one // 2
        most = max(AT_ONCE // k**2, 1)
        for setups in np.split(alike, np.arange(most, len(alike), most)):
            rows = edges[setups, None] + np.arange(k)
            d = dwells.rows(rows)
            shape = (d.cosine, d.sine, d.time, d.start - d.start[:, :1])
            same = all((x == x[0]).all() or not np.ptp(np.round(x, 9), axis=0).any() for x in shape)
            yield setups, rows, dwells.rows(rows[:1]) if same else d


def _times(weights: FloatArray, x: FloatArray) -> FloatArray:
    """Return what readings `x` (g, k) say of the unknowns, shape (g, p)."""
    if len(weights) == 1:
        return np.asarray(x @ weights[0].T)
    return np.asarray(np.einsum("gpk,gk->gp", weights, x))


def _square(x: FloatArray) -> FloatArray:
    """Return the product of each row of `x` (g, p) with itself, shape (g, p, p)."""
    return x[:, :, None] * x[:, None, :]


def _whitened(root: FloatArray, x: FloatArray) -> FloatArray:
    """Return readings `x` (g, k, q) of covariance `root` (g, k, k) or (1, k, k) as white ones."""
    from foucault.kernels.means import whiten_batch

    out = np.array(x, order="C")
    whiten_batch(root, out)
    return out


def _drifting(d: Dwells) -> FloatArray:
    """Return the times of the readings from their middle, shape (g, k) [s]."""
    mid = d.start + d.time / 2
    middle = np.sum(mid * d.time, axis=1, keepdims=True) / np.sum(d.time, axis=1, keepdims=True)
    return np.asarray(mid - middle)


def _of_gyro(d: Dwells, nuisance: Nuisance) -> tuple[FloatArray, FloatArray]:
    """Return what readings of the gyro are made of (g, k, p) [1], and its sd beforehand (p,)."""
    design, sds = [d.sine, d.cosine, np.ones_like(d.time)], [np.inf, np.inf, nuisance.offset_sd]
    if nuisance.drift_sd > 0:
        design.append(_drifting(d))
        sds.append(nuisance.drift_sd)
    return np.stack(design, 2), np.array(sds)


def _of_accel(d: Dwells) -> tuple[FloatArray, FloatArray]:
    """Return the same of an accelerometer that turns with the gyro."""
    return np.stack([d.sine, d.cosine, np.ones_like(d.time)], 2), np.full(3, np.inf)


def _two_fit(d: Dwells, noise: TriadNoise) -> _Fit:
    """Fit accelerometers that stay with the case: each is the mean of its rows, in their order."""
    design = np.ones((*d.time.shape, 1))
    mean = _fit(design, np.full(1, np.inf), d, noise, GRAVITY)
    weights, design, slow = (_twice(x) for x in (mean.weights, mean.design, mean.slow))
    white = np.repeat(mean.white, 2, axis=1)
    return _Fit(weights, design, mean.root, white, slow, mean.redundancy, mean.dof, mean.unseen)


def _twice(x: FloatArray) -> FloatArray:
    """Return matrices `x` (g, r, c) that act on each of two by itself, (g, 2 r, 2 c)."""
    both = np.einsum("grc,ab->gracb", x, np.eye(2))
    return np.asarray(both.reshape(len(x), 2 * x.shape[1], -1))


def _fit(design: FloatArray, sd: FloatArray, d: Dwells, noise: TriadNoise, size: float) -> _Fit:
    """Weigh readings for unknowns with prior standard deviations `sd`, by least squares.

    `d`: stops of all, or of each.
    """
    return _seen(design, sd, d, noise, size, np.zeros((0, d.time.shape[1])), 0.0)[0]


def _known(sd: FloatArray, size: float) -> FloatArray:
    """Return one over the variances that unknowns have beforehand, shape (p,) [1/SI].

    The first two get the widest prior that still counts as one: without it a component that no
    reading shows would have no variance at all.
    """
    known = np.where(np.isfinite(sd), 1.0 / np.maximum(sd, 1e-300) ** 2, 0.0)
    if len(sd) > 1:
        known[:2] += 1.0 / (UNSEEN * size**2)
    return known


def _seen(
    design: FloatArray, sd: FloatArray, d: Dwells, noise: TriadNoise, size: float, x: FloatArray,
    index_sd: float,
) -> tuple[_Fit, _Seen]:  # fmt: skip
    """Return the fit of readings `x` (g, k) [SI], and what they say by it.

    `index_sd`: of every index angle: it makes a reading less certain by what the rates are [rad].
    """
    from foucault.kernels.means import fit_batch

    many, k = x.shape
    white = mean_variance(replace(noise, bias_instability=0.0, random_walk=0.0), d.time, d.interval)
    begin = d.start - d.start.min(axis=1, keepdims=True)
    slow = np.zeros((1, k, k))
    if noise.bias_instability or noise.random_walk:
        slow = window_covariance(begin, begin + d.time, noise)
    white, design = np.ascontiguousarray(white), np.ascontiguousarray(design)
    g, p = max(len(white), len(design), len(slow), many if index_sd else 1), design.shape[2]
    weights, root, redundancy = np.empty((g, p, k)), np.empty((g, k, k)), np.empty((g, k))
    fit = _Fit(weights, design, root, white, slow, redundancy, np.empty(g, np.int64), np.empty(g))
    expected, residuals, left = np.empty((3, many, k))
    said = _Seen(np.empty((many, p)), expected, residuals, left, np.empty(many))
    fit_batch(
        design, white, slow, _known(sd, size), weights, root, redundancy, fit.dof, fit.unseen,
        np.ascontiguousarray(x), d.cosine, d.sine, index_sd, said.unknowns, expected, residuals,
        left, said.square,
    )  # fmt: skip
    return fit, said


def _unseen(fit: _Fit, size: float, out: FloatArray, setups: IntArray) -> None:
    """Add the variance of what the readings do not show of the first two unknowns to `out`.

    `out` (m, 2, 2): of all set-ups, of which `setups` (g,) are those of the fit.
    """
    some = fit.unseen > 0.25  # no direction, where it is smaller
    if some.any():
        # With its weights a visible component is returned in full, W X = I; the rest is unseen.
        W, X = (x[some] if len(x) > 1 else x for x in (fit.weights[:, :2], fit.design[:, :, :2]))
        U, s, _ = np.linalg.svd(np.eye(2) - W @ X)  # unseen or seen, rounding apart
        U = U * (s > 0.5)[:, None]
        those = setups[some] if len(some) > 1 else setups
        out[those] += UNSEEN * size**2 * U @ transposed(U)


def turn_rate(d: Dwells) -> FloatArray:
    """Return how fast the base turns, of one set-up or of each, shape () or (g,) [rad/s]."""
    turned = np.ptp(np.unwrap(d.index), axis=-1)
    return np.asarray(turned / np.maximum(np.ptp(d.start, axis=-1), 1e-9))


def _indexing(
    d: Dwells, gyro: FloatArray, accel: FloatArray, values: FloatArray, nuisance: Nuisance
) -> FloatArray:
    """Covariance of wrong index angles, shape (g, 4, 4), by weights `gyro`, `accel` (g or 1, 2, k).

    Stops are each off by themselves; a base that turns is off by the same angle all the time.
    """
    moved = np.empty((len(values), 4, gyro.shape[2]))
    for at, W in ((0, gyro), (2, accel)):  # d e / d a = (cos a, -sin a)
        slope = values[:, at, None] * d.cosine - values[:, at + 1, None] * d.sine
        np.multiply(W, slope[:, None], out=moved[:, at : at + 2])
    variance = np.full((1, 1, 1), nuisance.index_sd**2)
    if d.rotates:
        moved = moved.sum(axis=2, keepdims=True)
        variance = variance + (turn_rate(d)[:, None, None] * nuisance.lag_sd) ** 2
    return np.asarray(variance * moved @ transposed(moved))


Hemisphere = Literal["north", "south"]

ROUNDS = 60
"""Gauss-Newton steps at most [1]."""

EXACT = 1e-9
"""Standard deviation of a latitude that is known exactly [rad]."""

PLAUSIBLE = 25.0
"""Another solution is possible where its sum of squares is larger by less than this, five sd: where
the rate along z_b is small, errors of the latitude are far from Gaussian [1]."""

NEAR_SD = float(np.radians(10.0))
"""Standard deviation of a rough heading unless it is given, such as that of a compass [rad]."""

HARDLY = 0.1
"""A component of the rate with a larger sd, in horizontal Earth rates, is hardly seen [1]."""

LOST = 10.0
"""The rate along z_b is lost in the noise where its square is below this many sd of the horizontal
rate [1]: five sd of its own."""


@dataclass(frozen=True)
class Known:
    """What is known of the place and of the attitude before the readings."""

    gravity: float | FloatArray  # (m,) of all set-ups, or of each [m/s^2]
    # (m,) positive north, of all set-ups or of each [rad]; None where unknown
    latitude: float | FloatArray | None = None
    latitude_sd: float | FloatArray = 0.0  # (m,) its standard deviation [rad]
    hemisphere: Hemisphere = "north"  # decides between roots where the latitude is unknown
    # (m,) rough heading, good to `near_sd`, which decides between solutions that fit alike [rad]
    near: float | FloatArray | None = None
    near_sd: float = NEAR_SD  # standard deviation of that heading [rad]
    # how far from level the case may stand, about each axis; None where only the accelerometers
    # know [rad]
    level_sd: float | None = None

    def of(self, rows: npt.NDArray[np.int64]) -> Known:
        """Return what is known of the set-ups of numbers `rows` (k,) [1]."""
        names = ("gravity", "latitude", "latitude_sd", "near")
        each: dict[str, Any] = {name: getattr(self, name) for name in names}
        some: dict[str, Any] = {k: v[rows] for k, v in each.items() if isinstance(v, np.ndarray)}
        return replace(self, **some)


def compensated(
    values: FloatArray, gravity: float | FloatArray, compensation: Compensation
) -> FloatArray:
    """Return the four numbers without the errors of the instrument, shape (m, 4) [1].

    `values` (m, 4): as measured [SI]; `gravity` (m,): [m/s^2]; `compensation`: errors of the
    instrument, couplings of z are left in, as they need the attitude. Returns (m, 4): rates over
    the Earth's rate, specific forces over gravity, along x_b and y_b [1].
    """
    model = compensation.model
    inverse = np.zeros((4, 4))
    inverse[:2, :2] = np.linalg.inv(model.gyro_matrix[:2, :2]) / EARTH_RATE
    inverse[2:, 2:] = np.linalg.inv(model.accel_matrix[:2, :2])
    biases = np.concatenate([model.gyro_bias[:2], model.accel_bias[:2]])
    out: FloatArray = (values - biases) @ inverse.T
    out[:, 2:] /= np.reshape(gravity, (-1, 1))
    return out


def horizontal_of(pairs: Pairs, known: Known, compensation: Compensation) -> FloatArray:
    """Return the rate along x_b and y_b over the Earth's, 0 where it is hardly seen, (m,) [1].

    `pairs`: set-ups [SI].
    """
    N, M, _, _ = compensated(pairs.values, known.gravity, compensation).T
    cos = 1.0 if known.latitude is None else np.cos(known.latitude)
    xx, yy, xy = (pairs.cov[:, i, k] for i, k in ((0, 0), (1, 1), (0, 1)))
    largest = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
    return np.where(largest < (HARDLY * EARTH_RATE * cos) ** 2, np.hypot(N, M), 0.0)


def starts_of(pairs: Pairs, known: Known, compensation: Compensation) -> list[FloatArray]:
    """Return where to start from, (m, 4) each: heading, pitch, roll, latitude; the likeliest first.

    `pairs`: set-ups [SI]. Returns [rad].
    """
    N, M, x, s = compensated(pairs.values, known.gravity, compensation).T
    pitch, roll = tilt_of(x, s)
    starts = []
    square = np.sqrt(np.maximum(1 - M**2 - N**2, 1e-6))
    for sign in (1.0, -1.0) if known.hemisphere == "north" else (-1.0, 1.0):
        heading, latitude = _attitude_of(N, M, sign * square, pitch, roll)
        if known.latitude is not None:
            reach = 5 * known.latitude_sd
            latitude = np.clip(latitude, known.latitude - reach, known.latitude + reach)
        starts.append(np.stack([heading, pitch, roll, latitude], 1))
    # A direction that is hardly seen leaves more than the two roots.
    horizontal = horizontal_of(pairs, known, compensation)
    if known.latitude is not None and not horizontal.all():
        for heading in np.radians(np.arange(0.0, 360.0, 30.0)):
            same = np.ones_like(pitch)
            start = np.stack([heading * same, pitch, roll, known.latitude * same], 1)
            starts.append(np.where(horizontal[:, None] > 0, starts[0], start))
    return starts


def tilt_of(x: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pitch and roll [rad] of up along x_b, y_b, `x`, `s` (m,), at most 1 together."""
    shorter = np.maximum(np.hypot(s, x) / 0.99999, 1.0)
    s, x = s / shorter, x / shorter
    return np.arcsin(s), np.arctan2(-x, np.sqrt(np.maximum(1 - s**2 - x**2, 0.0)))


def _attitude_of(
    N: FloatArray, M: FloatArray, W: FloatArray, pitch: FloatArray, roll: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return heading and latitude of three components of the Earth's rate."""
    sg, cg, st, ct = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    X = cg * N + sg * W
    q = cg * W - sg * N
    Y = ct * M - st * q
    Z = st * M + ct * q
    return np.arctan2(-X, Y) % (2 * np.pi), np.arctan2(Z, np.hypot(X, Y))


@dataclass
class Best:
    """The best solution of each set-up, and the next best."""

    angles: FloatArray  # (m, 4) heading, pitch, roll, latitude [rad]
    cov: FloatArray  # (m, 4, 4) covariance [rad^2]
    # (m, 4, 5) slope of the angles against the four numbers [1/SI] and a latitude known before [1]
    gain: FloatArray
    square: FloatArray  # (m,) sum of squares [1]
    status: npt.NDArray[np.int8]  # (m,) see `kernels.north_seeking`
    rank: FloatArray  # (m,) the sum of squares, with what speaks against the solution [1]
    other: FloatArray  # (m, 4) the next best [rad]
    other_square: FloatArray  # (m,) its sum of squares, with what speaks against it [1]

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (m, 4) [rad]."""
        return np.asarray(np.sqrt(np.einsum("nii->ni", self.cov)))


def best_of(
    pairs: Pairs, covariance: FloatArray, known: Known, compensation: Compensation,
    starts: list[FloatArray],
) -> Best:  # fmt: skip
    """Solve from `starts` (m, 4) [rad] by `covariance` (m, 4, 4) [SI], the best first."""
    from foucault.kernels.north_likelihood import likelihood_batch

    model, m = compensation.model, len(pairs)
    A = np.vstack([model.gyro_matrix[:2], model.accel_matrix[:2]])
    b = np.concatenate([model.gyro_bias[:2], model.accel_bias[:2]])
    latitude = np.full(m, 0.0 if known.latitude is None else known.latitude)
    sd = np.full(m, np.inf if known.latitude is None else np.maximum(known.latitude_sd, EXACT))
    near = np.full(m, np.nan if known.near is None else known.near)
    sign = 1.0 if known.hemisphere == "north" else -1.0
    best = Best(
        np.empty((m, 4)), np.empty((m, 4, 4)), np.empty((m, 4, 5)), np.empty(m),
        np.empty(m, np.int8), np.empty(m), np.empty((m, 4)), np.empty(m),
    )  # fmt: skip
    likelihood_batch(  # one layout, one compilation
        np.ascontiguousarray(pairs.values), covariance, np.stack(starts), A, b,
        np.full(m, known.gravity), EARTH_RATE, latitude, sd, sign, near, known.near_sd, ROUNDS,
        best.angles, best.cov, best.gain,
        best.square, best.rank, best.other, best.other_square, best.status,
    )  # fmt: skip
    return best


def widen(
    best: Best, horizontal: FloatArray, pairs: Pairs, known: Known, compensation: Compensation,
    budget: dict[str, FloatArray],
) -> None:  # fmt: skip
    """Where the rate along z_b is lost in the noise, let the uncertainty cover both its signs.

    W = sqrt(1 - r^2) has no slope where r, the horizontal rate, is 1: there W is nothing better
    than sqrt(2 k) for an error k of r.

    `horizontal` (m,): r [1]; `pairs`: set-ups [SI]; `budget` (m, a): variances by source, changed
    to what they do beside W [rad^2].
    """
    direction = pairs.values[:, :2] / np.maximum(
        np.linalg.norm(pairs.values[:, :2], axis=1, keepdims=True), 1e-300
    )
    sd = np.sqrt(np.einsum("ni,nij,nj->n", direction, pairs.cov[:, :2, :2], direction)) / EARTH_RATE
    lost = (1.0 - horizontal**2 < LOST * sd) & np.isfinite(best.angles[:, 0])
    if not lost.any():
        return
    N, M, x, s = compensated(pairs.values[lost], known.gravity, compensation).T
    excess = np.maximum(np.hypot(N, M), 1.0)
    W = np.sqrt(LOST * sd[lost])
    pitch, roll = tilt_of(x, s)
    ends = [_attitude_of(N / excess, M / excess, sign * W, pitch, roll) for sign in (1.0, -1.0)]
    across = np.stack([-direction[lost, 1], direction[lost, 0]], 1)
    turn = np.einsum("ni,nij,nj->n", across, pairs.cov[lost, :2, :2], across) / EARTH_RATE**2
    tilt = np.einsum("nii->n", pairs.cov[lost, 2:, 2:]) / known.gravity**2
    for axis, k, other in ((0, 0, turn), (3, 1, tilt)):
        half = turned(ends[0][k] - ends[1][k]) / 2
        best.cov[lost, axis, :], best.cov[lost, :, axis] = 0.0, 0.0
        best.cov[lost, axis, axis] = half**2 + other
        wanted = [v for v in budget.values() if axis < v.shape[1]]
        linear = np.asarray(sum(v[lost, axis] for v in wanted))
        for v in wanted:  # the sources share what they do beside W
            v[lost, axis] *= other / np.maximum(linear, 1e-300)
    best.status[lost] = 1


def spans(angles: list[int]) -> bool:
    """Tell whether constant, cosine and sine over whole-degree `angles` [deg] are told apart."""
    a = np.radians(np.array(angles, float))
    design = np.stack([np.ones_like(a), np.cos(a), np.sin(a)], 1)
    return len(a) >= 3 and bool(np.linalg.svd(design, compute_uv=False)[-1] > 0.05)
