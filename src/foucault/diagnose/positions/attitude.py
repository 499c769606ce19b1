"""How an instrument is mounted on a table, told by the directions of up alone.

Two readings that lie well apart fit a few pairs of positions of the plan, each with one attitude;
the attitude that brings most readings near a position is refined by all of them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray

APART = np.radians(12.0)
"""Two directions lie as far apart as two others when it differs by less [rad]."""

NEAR = np.radians(20.0)
"""A reading this near to a position may be in it [rad]."""

PAIRS = 4
"""Pairs of readings that are tried: one reading of a pair may be in no position [1]."""

MOST = 120
"""Attitudes that are handed on; a regular solid fits itself in 60 [1]."""


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


def _pairs(up: FloatArray, usable: npt.NDArray[np.intp]) -> list[tuple[int, int]]:
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


def _alike(cosine: float, nominal: FloatArray) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
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
