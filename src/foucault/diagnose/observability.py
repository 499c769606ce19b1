"""What a plan makes visible, segment by segment: the stripped observability matrix.

A system that is constant in each segment [1]_, ``dx/dt = F_j x``, read as ``z = H_j x + noise``,
has in segment j the observability matrix ``Q_j = [H_j; H_j F_j; ...; H_j F_j^p]``. Stacked over
the segments, without the transitions between them, they are the stripped observability matrix::

    SOM = [Q_1; Q_2; ...; Q_r]

Its rank says how many combinations of the states the outputs and their derivatives tell. The
transitions may be left out where what a segment does not see does not move in it,
``null(Q_j) in null(F_j)`` [1]_; `Observability.exact` says whether that is so. Scaling:

* Columns by the prior: one is a standard deviation of the state before the data.
* Rows by the noise: a singular value is that deviation over the noise of one reading.
* Time by ``tau = 1 / (largest spectral radius of F)``, the time of one radian of the fastest
  motion, or the duration of the plan if that is shorter: ``H (F tau)^k`` neither grows nor
  vanishes with k, and a finer subdivision of the same plan does not change the units.

Powers: where only q states move (the other rows of F are zero), ``F = [[A, B], [0, 0]]``, and by
Cayley and Hamilton ``A^q`` is a combination of the lower powers of A. So ``H F^k`` beyond k = q
(at most n - 1) adds nothing, and p = q by default: 3, not 44, where an attitude moves under 42
constants.

The same growth, block by block, is computed for any linearised problem: there the rows of the
Jacobian stand in place of the SOM (`growth`).

References
----------
.. [1] D. Goshen-Meskin, I. Y. Bar-Itzhack, "Observability analysis of piece-wise constant
   systems", IEEE Trans. Aerospace and Electronic Systems 28(4), 1992, pp. 1056-1075.

How each output changes with each state along time, and when a coefficient is seen.

The curves are d(output)/d(state) as any linearised simulation or filter gives them. With white
noise on the outputs, their squares over its variance are the rate at which information comes in.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import Layout
from foucault.errors import error
from foucault.infer.information import (
    INVISIBLE,
    Combination,
    Information,
    largest_shares,
    proper_prior,
    terms,
    untouched,
)
from foucault.result import Linearised

NAMED = 1e-6  # Directions and motions below this are rounding [1].


@dataclass(frozen=True)
class LinearSegment:
    """A part of a plan in which the linearised system is constant."""

    F: FloatArray  # (n, n) of the rate of every state by every state [unit of the row / unit / s]
    H: FloatArray  # (m, n) of every output by every state [unit of the row / unit]
    duration: float  # how long it lasts [s]
    label: str = ""  # what the plan calls it


@dataclass(frozen=True)
class Gain:
    """What one segment adds to those before."""

    label: str  # the segment, shape ()
    rank: int  # combinations that are seen once it is over [1]
    added: int  # combinations it adds [1]
    singular_values: FloatArray  # (n,) of all rows so far: prior over noise, the largest first [1]
    alone: tuple[str, ...]  # states that are now seen each by itself, and were not before
    # combinations of the other states that are now seen: largest shares, in units of the priors [1]
    together: tuple[dict[str, float], ...]

    @property
    def words(self) -> str:
        """What it adds, in words."""
        what = [*self.alone, *(terms(shares, dots=True) for shares in self.together)]
        return f"{self.label}: {self.added} more, {self.rank} in all" + (
            f"; now seen: {'; '.join(what)}" if what else ""
        )


@dataclass(frozen=True)
class Observability:
    """What a plan makes visible of the states."""

    layout: Layout
    gains: tuple[Gain, ...]  # what each segment adds
    # (n,) of all segments: prior over noise of one reading, the largest first [1]
    singular_values: FloatArray
    # directions that no segment shows: the outputs stay the same when the states change so. Each is
    # named by its largest shares
    unseen: tuple[Combination, ...]
    tolerance: float  # A singular value below this times the largest counts as zero [1]
    # unit of time of the powers of F; NaN where no state moves [s]
    time_scale: float = float("nan")
    powers: int = 0  # highest power of F [1]
    # whether what a segment does not see stands still in it, so that the transitions between the
    # segments change nothing; otherwise `unseen` is of the stripped matrix only
    exact: bool = True

    @property
    def rank(self) -> int:
        """Combinations that are seen."""
        return self.gains[-1].rank

    @property
    def complete(self) -> bool:
        """Whether all states are seen."""
        return self.rank == len(self.layout)

    @property
    def smallest(self) -> float:
        """Smallest singular value that counts over the largest; 0 where nothing is seen."""
        s = self.singular_values
        return float(s[self.rank - 1] / s[0]) if self.rank else 0.0

    @property
    def words(self) -> tuple[str, ...]:
        """What each segment adds, then what remains unseen, in words."""
        return (*(g.words for g in self.gains), *(c.words for c in self.unseen))


def observability(
    segments: Sequence[LinearSegment],
    layout: Layout,
    prior_sd: FloatArray,
    noise_sd: FloatArray | float,
    *,
    powers: int | None = None,
    tolerance: float = INVISIBLE,
) -> Observability:
    """Analyse what a plan of constant segments makes visible, see the module.

    `segments`: a step in which the attitude changes much needs several; `layout`: the states, in
    the order of the columns; `prior_sd` (n,): sd of each before the data [SI unit]; `noise_sd`
    (m,) or (): of one reading of each output [unit of the output]; `powers` or None: highest power
    of F, else the number of states that move [1]; `tolerance`: singular values below this times
    the largest are zero. With the default a combination of that size would need (noise /
    (tolerance * largest))^2 readings: nobody has them, and rounding stays far below [1].
    """
    n = len(layout)
    sd = proper_prior(layout, prior_sd)
    noise = np.asarray(noise_sd, float)
    if not (np.isfinite(noise).all() and (noise > 0).all()):
        raise error("observability.noise", given=", ".join(f"{v:g}" for v in noise.ravel()))
    _check(segments, n, noise)
    moving = np.any([np.any(s.F != 0, axis=1) for s in segments], axis=0)
    p = min(int(moving.sum()), n - 1) if powers is None else powers
    # One radian of the fastest motion, at most the duration of the plan.
    fastest = max(float(np.abs(np.linalg.eigvals(s.F)).max(initial=0.0)) for s in segments)
    tau = 1.0 / max(fastest, 1.0 / sum(s.duration for s in segments))
    drift = [s.F * sd / sd[:, None] * tau for s in segments]
    parts = [
        _powers(s.H * sd / noise[..., None], F, p) for s, F in zip(segments, drift, strict=True)
    ]
    labels = [s.label or str(k) for k, s in enumerate(segments, 1)]
    gains, last, unseen = _gains(_stacked(parts), labels, layout, tolerance)
    exact = all(_still(Q, F, tolerance) for Q, F in zip(parts, drift, strict=True))
    unit = tau if moving.any() else float("nan")
    return Observability(layout, gains, last, unseen, tolerance, unit, p, exact)


def growth(
    at: Linearised,
    layout: Layout,
    prior_sd: FloatArray,
    *,
    steps: Mapping[str, Sequence[int]] | None = None,
    tolerance: float = INVISIBLE,
) -> Observability:
    """Analyse what each observation of a linearised problem makes visible.

    After step k the rows are the whitened ones of all observations up to then, the nuisance
    parameters eliminated; rows of a prior (block -1) do not count.

    `at`: white residuals and Jacobian, the coefficients are the first columns; `prior_sd` (n,):
    standard deviation of each before the data [SI unit]; `steps`: label -> numbers of the
    observations (`Linearised.blocks`) that come with it, in the order of time, None takes each
    observation as a step, in the order of their numbers [1]; `tolerance`: singular values below
    this times the largest are zero [1].
    """
    sd, n = proper_prior(layout, prior_sd), len(layout)
    if steps is None:
        steps = {str(b + 1): [b] for b in np.unique(at.blocks[at.blocks >= 0]).tolist()}
    used = np.cumsum([np.isin(at.blocks, list(blocks)) for blocks in steps.values()], axis=0) > 0
    roots = (_eliminated(at.jacobian[rows], n) * sd for rows in used)
    return Observability(layout, *_gains(roots, list(steps), layout, tolerance), tolerance)


def _check(segments: Sequence[LinearSegment], n: int, noise: FloatArray) -> None:
    if not segments:
        raise error("observability.segment", segment="1", what="it is missing")
    for k, s in enumerate(segments, 1):
        what, where = "", s.label or str(k)
        if s.F.shape != (n, n) or s.H.ndim != 2 or s.H.shape[1] != n:
            what = f"F is {s.F.shape}, H is {s.H.shape}, and there are {n} states"
        elif noise.ndim and noise.shape != (len(s.H),):
            what = f"{len(s.H)} outputs, and {noise.size} standard deviations of noise"
        elif not (np.isfinite(s.F).all() and np.isfinite(s.H).all()):
            what = "F or H has entries that are not finite"
        elif not (np.isfinite(s.duration) and s.duration > 0):
            what = f"it lasts {s.duration:g} s"
        if what:
            raise error("observability.segment", segment=where, what=what)


def _powers(H: FloatArray, F: FloatArray, powers: int) -> FloatArray:
    """Return Q of a segment: H, H F, ... H F^powers, all scaled."""
    rows = [H]
    for _ in range(powers):
        rows.append(rows[-1] @ F)
    return np.vstack(rows)


def _still(Q: FloatArray, F: FloatArray, tolerance: float) -> bool:
    """Whether what a segment does not see, null(Q), does not move in it."""
    s, Vt = _svd(Q, len(F))
    moved = F @ Vt[int(np.sum(s > tolerance * s[0])) :].T
    return bool(np.abs(moved).max(initial=0.0) <= NAMED * np.abs(F).max())


def _stacked(parts: Iterable[FloatArray]) -> Iterator[FloatArray]:
    """Yield a square root of the information of all parts so far, at most n rows."""
    root: FloatArray | None = None
    for part in parts:
        rows = part if root is None else np.vstack([root, part])
        root = np.asarray(np.linalg.qr(rows, mode="r"))
        yield root


def _eliminated(J: FloatArray, n: int) -> FloatArray:
    """Project what nuisance parameters explain out of the first n columns.

    Unlike `gauss_newton.eliminate` for nuisance parameters that these rows say nothing of.
    """
    nuisance = J[:, n:]
    nuisance = nuisance[:, np.any(nuisance != 0, axis=0)]
    if nuisance.size == 0:
        return np.asarray(J[:, :n])
    U, s, _ = np.linalg.svd(nuisance / np.linalg.norm(nuisance, axis=0), full_matrices=False)
    U = U[:, s > INVISIBLE * s[0]]
    return np.asarray(J[:, :n] - U @ (U.T @ J[:, :n]))


def _gains(
    roots: Iterable[FloatArray], labels: Sequence[str], layout: Layout, tolerance: float
) -> tuple[tuple[Gain, ...], FloatArray, tuple[Combination, ...]]:
    """Return what each of the growing `roots` adds, the last singular values, what is unseen."""
    n = len(layout)
    split = [_svd(root, n) for root in roots]
    last = split[-1][0]
    # One threshold for all, so that the rank cannot fall while rows are added.
    zero = tolerance * last[0]
    gains: list[Gain] = []
    seen, alone = np.zeros((0, n)), np.zeros(n, bool)
    for label, (s, Vt) in zip(labels, split, strict=True):
        rank = int(np.sum(s > zero))
        now = untouched(s, Vt, np.arange(n) < rank)
        fresh = tuple(layout.names[i] for i in np.flatnonzero(now & ~alone))
        together = _together(Vt[:rank], seen, now, layout) if rank > len(seen) else ()
        gains.append(Gain(label, rank, rank - len(seen), s, fresh, together))
        seen, alone = Vt[:rank], now
    blind = split[-1][1][gains[-1].rank :]
    unseen = tuple(Combination(float("inf"), largest_shares(layout, d)) for d in _sparse(blind))
    return tuple(gains), last, unseen


def _svd(root: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    _, s, Vt = np.linalg.svd(np.linalg.qr(root, mode="r"))
    return np.pad(s, (0, n - len(s))), Vt


def _together(
    seen: FloatArray, before: FloatArray, alone: BoolArray, layout: Layout
) -> tuple[dict[str, float], ...]:
    """Name what is seen now and was not `before`, of states that are not seen alone."""
    others = np.flatnonzero(~alone)
    if len(others) == 0:
        return ()
    # What was known, with the states that are now known by themselves taken out of it.
    _, s, Vt = np.linalg.svd(before[:, others], full_matrices=False)
    known = Vt[s > NAMED]
    now = seen[:, others] - (seen[:, others] @ known.T) @ known
    _, s, Vt = np.linalg.svd(now, full_matrices=False)
    part = Layout(tuple(layout.coefficients[i] for i in others))
    return tuple(largest_shares(part, d) for d in _sparse(Vt[s > NAMED]))


def _sparse(basis: FloatArray) -> FloatArray:
    """Return directions of length 1 that span the same, each with a state of its own.

    A basis from singular vectors mixes all directions; reduced to echelon form, with pivots by
    size, most shares are zero, and the rest can be read.
    """
    from scipy.linalg import qr

    if len(basis) == 0:
        return basis
    _, _, order = qr(basis, mode="economic", pivoting=True)
    pivots = np.sort(order[: len(basis)])
    reduced = np.linalg.solve(basis[:, pivots], basis)
    return np.asarray(reduced / np.linalg.norm(reduced, axis=1, keepdims=True))


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the outputs by the states along time."""

    time: FloatArray  # (k,) of each sample [s]
    layout: Layout  # the states
    outputs: tuple[str, ...]
    # (k, m, n) d(output)/d(state) at each sample [unit of the output / SI unit of the state]
    slopes: FloatArray

    def thinned(self, most: int = 1000) -> Sensitivity:
        """Return at most `most` [1] samples at even steps, for figures; first and last stay."""
        if len(self.time) <= most:
            return self
        keep = np.linspace(0, len(self.time) - 1, most).round().astype(np.intp)
        return replace(self, time=self.time[keep], slopes=self.slopes[keep])

    def share(self, noise_sd: FloatArray | float = 1.0) -> FloatArray:
        """Return the part of each state's information that has come in, shape (k, n) [1].

        This is information about a state when all others are known; zero where none comes.
        `noise_sd` (m,) or (): of the white noise of each output [unit of the output].
        """
        white = self.slopes / np.asarray(noise_sd, float)[..., None]
        total = np.cumsum(np.sum(white**2, axis=1), axis=0)
        return np.asarray(total / np.where(total[-1] > 0, total[-1], 1.0))

    def when(self, share: float = 0.5, noise_sd: FloatArray | float = 1.0) -> FloatArray:
        """Return when each state's information reaches a share, shape (n,), NaN if never [s].

        `share`: part of the information of the whole, above 0 to 1 [1]; `noise_sd` (m,) or (): of
        the white noise of each output [unit of the output].
        """
        # The last of a sum is 1 only to rounding.
        reached = self.share(noise_sd) >= share * (1 - 1e-12)
        first = self.time[np.argmax(reached, axis=0)]
        return np.where(reached.any(axis=0), first, np.nan)

    def information(self, noise_sd: FloatArray | float = 1.0) -> Information:
        """Return the information of all samples about the states.

        `noise_sd` (m,) or (): of the white noise of each output [unit of the output].
        """
        white = self.slopes / np.asarray(noise_sd, float)[..., None]
        n = len(self.layout)
        root = np.linalg.qr(white.reshape(-1, n), mode="r")
        return Information(self.layout, np.pad(root, ((0, n - len(root)), (0, 0))))
