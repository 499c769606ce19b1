"""Which position of the plan each reading was taken in, told by the direction of up.

Readings are aligned with the plan in the order in which they were taken, as one aligns two texts:
a position that is left out, repeated or added costs as much as two directions 25 deg apart. Where
that leaves positions and readings without a partner, the instrument may be mounted turned: any
attitude that keeps the order explains the readings better than another order does. Two readings
that lie well apart fit a few pairs of positions of the plan, each with one attitude; the attitude
that brings most readings near a position is refined by all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IndexArray, IntArray
from foucault.models import turntable
from foucault.models.noise import Readings

APART = np.radians(12.0)
"""Two directions lie as far apart as two others when it differs by less [rad]."""

NEAR = np.radians(20.0)  # A reading this near to a position may be in it [rad].
PAIRS = 4  # Pairs of readings that are tried: one reading of a pair may be in no position [1].
MOST = 120  # Attitudes that are handed on; a regular solid fits itself in 60 [1].


def attitudes(
    up: FloatArray, spin: BoolArray | None, nominal: FloatArray, nominal_spin: BoolArray
) -> list[FloatArray]:
    """Return rotations from case to body axes that may explain the directions, the best first.

    `up` (n, 3): direction of up in each reading, body axes, NaN where unknown [1]; `spin` (n,) or
    None: which are spins, where the log can tell; `nominal` (m, 3): direction of up in each
    position of the plan, case axes [1]; `nominal_spin` (m,): which of them are spins.
    """
    usable = np.flatnonzero(np.isfinite(up).all(axis=1))
    kinds = np.zeros(len(up), bool) if spin is None else spin
    plan_kinds = np.zeros(len(nominal), bool) if spin is None else nominal_spin
    found = [np.empty((0, 3, 3))]
    for i, j in _pairs(up, usable):
        a, b = _alike(up[i] @ up[j], nominal)
        same = (plan_kinds[a] == kinds[i]) & (plan_kinds[b] == kinds[j])
        body = _frame(up[i][None], up[j][None])
        found.append(body @ _frame(nominal[a[same]], nominal[b[same]]).transpose(0, 2, 1))
    all_of = np.concatenate(found)
    if not len(all_of):
        return []
    score = np.zeros(len(all_of))
    for kind in (False, True):
        mine, theirs = up[usable][kinds[usable] == kind], nominal[plan_kinds == kind]
        if len(mine) and len(theirs):
            turned = np.einsum("kij,mj->kim", all_of, theirs)
            cosine = np.einsum("ni,kim->knm", mine, turned, optimize=True).max(axis=2)
            off = np.arccos(np.clip(cosine, -1.0, 1.0))
            score += np.maximum(0.0, 1 - (off / NEAR) ** 2).sum(axis=1)
    best = np.argsort(-score, kind="stable")[:MOST]
    return [all_of[k] for k in best if score[k] > 0.5 * score[best[0]]]


def _pairs(up: FloatArray, usable: IndexArray) -> list[tuple[int, int]]:
    """Choose pairs of readings that lie most nearly across one another."""
    if len(usable) < 2:
        return []
    cosine = np.abs(up[usable] @ up[usable].T)
    out, left = [], np.ones(len(usable), bool)
    for _ in range(PAIRS):
        both = left[:, None] & left[None, :] & ~np.eye(len(usable), dtype=bool)
        if not both.any():
            break
        i, j = np.unravel_index(int(np.argmin(np.where(both, cosine, 2.0))), cosine.shape)
        if cosine[i, j] < np.cos(np.radians(30.0)):
            out.append((int(usable[i]), int(usable[j])))
        left[[i, j]] = False
    return out


def _alike(cosine: float, nominal: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return the pairs of positions that lie as far apart as two readings."""
    apart = np.arccos(np.clip(nominal @ nominal.T, -1.0, 1.0))
    a, b = np.nonzero(np.abs(apart - np.arccos(np.clip(cosine, -1.0, 1.0))) < APART)
    across = np.abs((nominal[a] * nominal[b]).sum(axis=1)) < np.cos(np.radians(15.0))
    return a[across], b[across]


def _frame(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return right-handed axes with the first between two directions, shape (k, 3, 3)."""
    one = x + y
    three = np.cross(x, y)
    one = one / np.maximum(np.linalg.norm(one, axis=1), 1e-300)[:, None]
    three = three / np.maximum(np.linalg.norm(three, axis=1), 1e-300)[:, None]
    return np.stack([one, np.cross(three, one), three], axis=2)


FAR = float(np.radians(25.0))  # Directions further apart than this are different positions [rad].

SMALL = np.radians(30.0)
"""An instrument is mounted as the plan says when it is turned by less [rad]."""

SMALLER = np.radians(10.0)
"""The same where the order is given up: regular plans fit themselves in many attitudes [rad]."""

OTHER_SENSE = 0.02
"""What a spin in the other sense than planned costs: less than any other difference [1]."""

MOST_OF_ALL = 0.7
"""A match of so many of all readings, or of all positions, needs no other explanation [1]."""

SET = np.radians(10.0)
"""Where neither order nor attitude is known, directions in one position differ by less [rad]."""

LATE = 1e-4  # What a place further on in the plan costs where the order is given up [1].


@dataclass(frozen=True)
class Match:
    """Readings and positions that belong together."""

    row: IntArray  # (n,) position of the plan for each reading, -1 for none [1]
    ordered: bool  # whether they follow each other as in the plan
    rotation: FloatArray  # (3, 3) from case to body axes, as the directions tell [1]

    def unused(self, positions: int) -> IntArray:
        """Return which of so many `positions` of a plan [1] no reading was taken in."""
        return np.setdiff1d(np.arange(positions), self.row)


def directions(readings: Readings) -> FloatArray:
    """Return the direction of up in each reading, shape (n, 3) [1]; NaN where it is unknown.

    `readings`: means of accelerometers, or of gyros in spins [SI].
    """
    if readings.accel is not None:
        return _unit(readings.accel)
    out = np.full((len(readings), 3), np.nan)
    if readings.gyro is not None:
        spin = readings.spin
        out[spin] = _unit(readings.gyro[spin]) * np.sign(readings.rate[spin])[:, None]
    return out


def _unit(x: FloatArray) -> FloatArray:
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=1), 1e-300)[:, None])


def rotation(up: FloatArray, nominal: FloatArray) -> FloatArray:
    """Return the rotation from `nominal` (n, 3) to `up`, (3, 3) [1]; of fewer than two none."""
    if len(up) == 0:
        return np.eye(3)
    U, s, Vt = np.linalg.svd(up.T @ nominal)
    if s[1] < 0.05 * len(up):
        return np.eye(3)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt)


def turned(C: FloatArray) -> float:
    """Return the angle [rad] of a rotation `C` (3, 3)."""
    return float(np.arccos(np.clip((np.trace(C) - 1) / 2, -1.0, 1.0)))


def match(
    up: FloatArray,
    spin: BoolArray | None,
    nominal: FloatArray,
    nominal_spin: BoolArray,
    in_order: bool = False,
    other_sense: BoolArray | None = None,
    start: FloatArray | None = None,
) -> Match:
    """Find the position of each reading.

    `up` (n, 3): direction of up in each reading, body axes [1]; `spin` (n,) or None: which are
    spins, where the log can tell; `nominal` (m, 3): direction of up in each position of the plan,
    case axes [1]; `nominal_spin` (m,): which of them are spins; `in_order`: whether the order
    must be that of the plan; `other_sense` (n, m) or None: which readings are spins in the other
    sense than which positions, where the log can tell; `start` (3, 3): attitude to start from,
    from case to body axes, None for that of the plan [1].
    """
    first = C = np.eye(3) if start is None else start
    found = Match(np.full(len(up), -1), True, C)
    for _ in range(3):
        cost = _cost(up, spin, nominal @ C.T, nominal_spin)
        if other_sense is not None:
            cost = cost + OTHER_SENSE * other_sense
        row, ordered = _aligned(cost), True
        if not in_order and (row < 0).any() and len(np.unique(row[row >= 0])) < len(nominal):
            free = _assigned(cost)
            if (free >= 0).sum() > (row >= 0).sum():
                row, ordered = free, False
        found = Match(row, ordered, C)
        some = (row >= 0) & np.isfinite(up).all(axis=1)
        again = rotation(up[some], nominal[row[some]])
        if turned(again @ first.T) > (SMALL if ordered else SMALLER):
            break
        C = again
    return found


def _cost(
    up: FloatArray,
    spin: BoolArray | None,
    nominal: FloatArray,
    nominal_spin: BoolArray,
    far: float = FAR,
) -> FloatArray:
    angle = np.arccos(np.clip(np.nan_to_num(up @ nominal.T, nan=1.0), -1.0, 1.0))
    cost = np.where(angle < far, (angle / far) ** 2, np.inf)
    if spin is not None:
        cost[spin[:, None] != nominal_spin[None, :]] = np.inf
    return np.asarray(cost)


def _aligned(cost: FloatArray) -> IntArray:
    """Align in order; a reading or a position without partner costs 1."""
    n, m = cost.shape
    if n == m and np.trace(cost) <= 2.0:  # any other way has two without partner at least
        return np.arange(n)
    costs = cost.tolist()  # numbers of Python: one by one, those of NumPy take ten times as long
    best = [[float(j) for j in range(m + 1)]]
    for i in range(n):
        above, here = best[i], [i + 1.0]
        for j in range(m):
            here.append(min(above[j] + costs[i][j], min(above[j + 1], here[j]) + 1.0))
        best.append(here)
    row = np.full(n, -1)
    i, j = n, m
    while i and j:
        if best[i][j] == best[i - 1][j - 1] + costs[i - 1][j - 1]:
            i, j = i - 1, j - 1
            row[i] = j
        elif best[i][j] == best[i - 1][j] + 1.0:
            i -= 1
        else:
            j -= 1
    return row


def _assigned(cost: FloatArray) -> IntArray:
    from scipy.optimize import linear_sum_assignment

    n, m = cost.shape
    late = LATE * np.abs(np.arange(n)[:, None] - np.arange(m)[None, :])
    finite = np.where(np.isfinite(cost), cost + late, 1e3)
    i, j = linear_sum_assignment(finite)
    row = np.full(n, -1)
    good = np.isfinite(cost[i, j])
    row[i[good]] = j[good]
    return row


def with_plan(
    readings: Readings, plan: turntable.TablePlan, spins_known: bool, free: bool = False
) -> Match:
    """Match readings with a plan.

    `plan`: what was planned [SI]; `free`: whether another order in another attitude may be told
    too: that is not certain, for regular plans fit themselves in many attitudes.
    """
    up, nominal = directions(readings), turntable.up_k(plan.angles)
    spin, planned = readings.spin if spins_known else None, plan.rate != 0
    other = None
    if readings.accel is not None:
        other = np.sign(readings.rate)[:, None] * np.sign(plan.rate)[None, :] < 0
    found = match(up, spin, nominal, planned, other_sense=other)
    if not found.ordered and _off(found, up, nominal) > SET:  # by chance only
        found = Match(np.full(len(up), -1), True, np.eye(3))
    if (found.ordered and fits(found, len(plan))) or readings.accel is None:
        return found
    tried = attitudes(up, spin, nominal, planned)
    turned_in_order = [
        match(up, spin, nominal, planned, True, other, C)
        for C in [_as_planned(up, nominal), *tried]
    ]
    best = _best(turned_in_order, up, nominal, len(plan))
    # Another order of all positions is likelier than another attitude of some.
    if best is not None and fits(found, len(plan)) and _count(found) > _count(best):
        return found
    if best is not None or (not free and fits(found, len(plan))):
        return best or found
    if not free or fits(found, len(plan)):
        return found
    sets = []
    for C in tried[:40]:
        cost = _cost(up, spin, nominal @ C.T, planned, SET)
        sets.append(Match(_assigned(cost), False, C))
    return _best(sets, up, nominal, len(plan)) or found


def fits(found: Match, positions: int) -> bool:
    """Tell whether most readings, or those of most of so many `positions` [1], have their place."""
    return bool((found.row >= 0).sum() >= MOST_OF_ALL * min(len(found.row), positions))


def off(found: Match, up: FloatArray, nominal: FloatArray) -> FloatArray:
    """Return how far each reading is from its position, shape (n,) [rad]; NaN where it has none.

    `up` (n, 3): direction of up in each reading, body axes [1]; `nominal` (m, 3): direction of up
    in each position of the plan, case axes [1].
    """
    cosine = (up * (nominal[found.row] @ found.rotation.T)).sum(axis=1)
    return np.where(found.row >= 0, np.arccos(np.clip(cosine, -1.0, 1.0)), np.nan)


def _off(found: Match, up: FloatArray, nominal: FloatArray) -> float:
    each = off(found, up, nominal)
    each = each[np.isfinite(each)]
    return float(np.median(each)) if len(each) else np.inf


def _count(found: Match) -> int:
    return int((found.row >= 0).sum())


def _as_planned(up: FloatArray, nominal: FloatArray) -> FloatArray:
    """Return the attitude that fits if every position was read once and in order."""
    if len(up) != len(nominal) or not np.isfinite(up).all():
        return np.eye(3)
    return rotation(up, nominal)


def _best(found: list[Match], up: FloatArray, nominal: FloatArray, positions: int) -> Match | None:
    """Return the match of most readings, and of the smallest misses, if it is one."""
    good = [m for m in found if fits(m, positions) and (m.row >= 0).sum() > 3]
    good = [m for m in good if _off(m, up, nominal) < SET]
    return max(good, key=lambda m: (int((m.row >= 0).sum()), -_off(m, up, nominal)), default=None)
