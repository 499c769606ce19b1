"""What residuals follow: the time, as a coefficient that drifts or jumps, or a term left out.

With white residuals r of a solution and its Jacobian J, a coefficient that changed in proportion to
time, by d from the first observation to the last, adds ``d c`` to the residuals, where c is the
coefficient's column of J times the time of each row, from -1/2 to 1/2. With c' the part of c that
the unknowns do not explain::

    d = c'.r / c'.c'        t = d |c'| / s

and t has Student's distribution, s the root mean square of what the drift leaves of the residuals:
scatter that was fitted to a drift does not hide it. One that jumped is the same with -1/2 before
and 1/2 after for the time.

Terms that were left out are tested in the same way, their own columns for c, several together by
the F distribution. Neither needs to know how large the noise is: it is all that can be tested where
the residuals alone tell it.

References
----------
.. [1] R. D. Cook, S. Weisberg, *Residuals and Influence in Regression*, Chapman and Hall, 1982,
   section 2.4 (added variables).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.result import Linearised
from foucault.tables import AXES

SHOWN = 1e-4  # A drift of which less than this share shows in the residuals is not tested [1].
LITTLE = 0.01  # A kind of observation with less than this share in a drift does not count [1].
ENOUGH = 3.0  # With fewer degrees of freedom besides it a drift is not told from chance [1].

TOGETHER = {  # what warms up changes all three alike, what slips turns one triad against the other
    **{family: {f"{family}.{a}": 1.0 for a in AXES} for family in ("accel.scale", "gyro.scale")},
    **{f"the angle of the gyros' axes about {a}":
       {f"gyro.misalignment.{b}{c}": 1.0, f"gyro.misalignment.{c}{b}": -1.0}
       for a, b, c in ("xyz", "yzx", "zxy")},
}  # fmt: skip
"""What may change -> the coefficients that then change with it, by its size times so much [1]."""

MOMENTS = 15  # A jump is looked for at so many moments at most [1].
FEWEST = 2  # So many observations at least are before a jump, and after it [1].


@dataclass(frozen=True)
class Drift:
    """The drift, or the jump, that the residuals show most clearly."""

    name: str  # the coefficient, or what several change with
    # size, sd: how much it changed from the first observation to the last [SI]
    size: float
    sd: float
    dof: float  # degrees of freedom that the sd was found from [1]
    when: float | None = None  # it jumped there; None: it drifted [s]
    limit: float = np.inf  # `ratio` that chance allows for the largest of all [1]
    explained: float = 0.0  # what it takes off the sum of squares of the residuals [1]

    @property
    def ratio(self) -> float:
        """The drift over its sd, without sign [1]."""
        return abs(self.size) / self.sd

    @property
    def significant(self) -> bool:
        """Whether it is more than chance."""
        return self.ratio > self.limit


def by_time(time: FloatArray) -> FloatArray:
    """Return `time` (k,) [s] from -1/2, the first, to 1/2, the last, shape (k,) [1]."""
    span = float(np.ptp(time))
    return np.asarray((time - time.min()) / span - 0.5) if span > 0 else np.zeros(len(time))


def jumps(time: FloatArray) -> dict[float | None, FloatArray]:
    """Return when coefficients may have jumped between observations at `time` (k,) [s].

    Moment -> -1/2 before it, 1/2 after it, shape (k,) [1].
    """
    each = np.unique(time)
    after = np.arange(FEWEST, len(each) - FEWEST + 1)
    after = after[np.unique(np.linspace(0, len(after) - 1, MOMENTS).astype(int))[: len(after)]]
    return {float(each[k - 1] + each[k]) / 2: np.where(time >= each[k], 0.5, -0.5) for k in after}


def settles(time: FloatArray) -> list[FloatArray]:
    """Return what settles soon, or later, by `time` (k,) [s], shape (k,) each [1]."""
    return [np.asarray(-np.exp(-(by_time(time) + 0.5) / share)) for share in (0.1, 0.3)]


def find_drift(
    at: Linearised,
    names: Sequence[str],
    candidates: Mapping[float | None, FloatArray],
    *,
    kinds: IntArray | None = None,
    least: float = 0.0,
) -> Drift | None:
    """Look for the coefficient whose change explains the residuals best.

    `at`: the problem linearised at its solution, everything that was estimated in its columns;
    `candidates`: moment of a jump [s], None for a drift -> (m, p) what it does to the white
    residuals, of each coefficient [1 / SI]; `kinds` (blocks,): kind of each observation, which has
    a scatter of its own, None for one kind; `least`: variance of white residuals at least, since
    what is counted with and may be nothing leaves less along it than along others [1]. Returns None
    where nothing would show.
    """
    from scipy.special import stdtrit

    what = [(name, when) for when in candidates for name in names]
    c = np.column_stack([np.empty((len(at.residuals), 0)), *candidates.values()])
    for together, signs in TOGETHER.items():
        if signs.keys() <= set(names):
            sum_of = np.array([signs.get(name, 0.0) for name in names])
            what += [(together, when) for when in candidates]
            c = np.column_stack([c, *(x @ sum_of for x in candidates.values())])
    left, r, free = _unexplained(at, c)
    kind = _kind_of_rows(at, kinds)
    square = np.sum(left**2, axis=0)
    shown = square > SHOWN * np.maximum(np.sum(c**2, axis=0), 1e-300)
    what, left, square = [what[k] for k in np.flatnonzero(shown)], left[:, shown], square[shown]
    size = left.T @ r / square
    variance, dof = _variance(left, r, size, free, kind, least)
    told = np.flatnonzero((dof >= ENOUGH) & (variance > 0))
    if not len(told):
        return None
    size, sd, dof = size[told], np.sqrt(variance[told]), dof[told]
    limit = -stdtrit(dof, FALSE_ALARM / len(told) / 2)
    # Of those that are alike but for rounding, as a jump anywhere in a gap is, the first.
    best = int(np.argmax((np.abs(size) / sd / limit).round(6)))
    name, when = what[told[best]]
    explained = float(size[best] ** 2 * square[told[best]])
    return Drift(name, float(size[best]), float(sd[best]), float(dof[best]), when,
                 float(limit[best]), explained)  # fmt: skip


def _unexplained(at: Linearised, c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what the unknowns leave of columns and residuals, and the redundancy of each row."""
    size = np.linalg.norm(at.jacobian, axis=0)
    basis, s, _ = np.linalg.svd(at.jacobian[:, size > 0] / size[size > 0], full_matrices=False)
    basis = basis[:, s > 1e-10 * s.max(initial=0.0)]
    r = at.residuals - basis @ (basis.T @ at.residuals)
    return c - basis @ (basis.T @ c), r, 1 - np.sum(basis**2, axis=1)


def _kind_of_rows(at: Linearised, kinds: IntArray | None) -> IntArray:
    kind = np.zeros(int(at.blocks.max(initial=0)) + 1, int) if kinds is None else kinds
    return np.where(at.blocks >= 0, kind[at.blocks], -1)


@dataclass(frozen=True)
class LeftOut:
    """Terms that were left out, as the residuals show them, all together."""

    names: tuple[str, ...]
    # size, sd: (k,) what they would be, and its standard deviation; NaN where nothing shows [SI]
    size: FloatArray
    sd: FloatArray
    ratio: float  # mean square that they explain over that of what remains [1]
    dof: float  # degrees of freedom of what remains [1]
    limit: float  # `ratio` that chance allows [1]

    @property
    def significant(self) -> bool:
        """Whether they are more than chance."""
        return self.ratio > self.limit


def find_left_out(
    at: Linearised, names: Sequence[str], columns: FloatArray, *, kinds: IntArray | None = None
) -> LeftOut | None:
    """Test whether the residuals follow terms that were not estimated.

    `at`: the problem linearised at its solution, everything that was estimated in its columns;
    `columns` (m, k): what each of them does to the white residuals [1 / SI]; `kinds` (blocks,) or
    None: kind of each observation, what the terms do not touch says nothing of them. Returns None
    where nothing would show.
    """
    from scipy.special import fdtri

    left, r, free = _unexplained(at, columns)
    shown = np.sum(left**2, axis=0) > SHOWN * np.maximum(np.sum(columns**2, axis=0), 1e-300)
    if not shown.any():
        return None
    unit = np.linalg.norm(left[:, shown], axis=0)
    Q, s, V = np.linalg.svd(left[:, shown] / unit, full_matrices=False)
    seen = s > np.sqrt(SHOWN)
    Q, V = Q[:, seen], V[seen] / s[seen, None]
    explained, kind = Q.T @ r, _kind_of_rows(at, kinds)
    share = np.sum(Q**2, axis=1)
    touched = [k for k in np.unique(kind[kind >= 0]) if share[kind == k].sum() > LITTLE]
    mine = np.isin(kind, touched)
    dof = float(np.sum((free - share)[mine]))
    remains = float(np.sum((r - Q @ explained)[mine] ** 2))
    if dof < ENOUGH or remains <= 0:
        return None
    variance, k = remains / dof, int(seen.sum())
    size, sd = np.full((2, len(names)), np.nan)
    size[shown] = V.T @ explained / unit
    sd[shown] = np.sqrt(variance * np.sum(V**2, axis=0)) / unit
    ratio = float(explained @ explained) / k / variance
    return LeftOut(tuple(names), size, sd, ratio, dof, float(fdtri(k, dof, 1 - FALSE_ALARM)))


def _variance(
    left: FloatArray,
    r: FloatArray,
    size: FloatArray,
    free: FloatArray,
    kind: IntArray,
    least: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the variance of every drift and its degrees of freedom, each kind with its scatter.

    Several scatters added have the degrees of freedom of Welch and Satterthwaite. What a prior
    says, of a bias that wanders too, is believed as it is: its rows have the variance 1. Where most
    of the drift is in them the observations tell no scatter of their own: there is one for all.
    """
    square = np.sum(left**2, axis=0)
    believed = np.sum(left[kind < 0] ** 2, axis=0) / square
    alone = _summed(left, r, size, free, kind, least, believed / square)
    together = _summed(left, r, size, free, np.zeros_like(kind), least, np.zeros(len(size)))
    variance, dof = np.where(believed > 0.5, together, alone)
    return variance, dof


def _summed(
    left: FloatArray, r: FloatArray, size: FloatArray, free: FloatArray, kind: IntArray,
    least: float, known: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    square, total, wide = np.sum(left**2, axis=0), known.copy(), np.zeros(len(size))
    enough = np.ones(len(size), bool)
    for one in np.unique(kind[kind >= 0]):
        mine = kind == one
        part, along = np.sum(left[mine] ** 2, axis=0), left[mine].T @ r[mine]
        rest = r[mine] @ r[mine] - 2 * size * along + size**2 * part
        share = part / square
        dof, counts = np.sum(free[mine]) - share, share > LITTLE
        enough &= (dof >= 1) | ~counts
        each = np.maximum(rest / np.maximum(dof, 1.0), least)
        variance = np.where(counts, share * each / square, 0.0)
        total, wide = total + variance, wide + variance**2 / np.maximum(dof, 1.0)
    dof = np.where(enough & (wide > 0), total**2 / np.where(wide > 0, wide, 1.0), 0.0)
    return np.where(enough, total, 0.0), dof
