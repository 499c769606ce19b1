"""Two antennas on one body: what their base says before anything else is known.

``C_0b d_b = C_0v base``: the base in the world turns as the gyros say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.estimate.delay_matching import SlaveAttitude
from foucault.estimate.imu_pose import Point
from foucault.estimate.two_bodies import BLOCK, SURE
from foucault.logs.pose import FEWEST
from foucault.models.pose import PoseTable, Second
from foucault.tables import AXES
from foucault.units import plain

APART, RIGID, TURNED, SUSPECT, LEFT = (0.01, 100.0), 0.2, 0.3, 0.02, 0.06
"""How far antennas on one body can be apart [m]; part of the distance by which it may vary, and
parts of the base that the IMU's turning may leave: with biases that are not known yet, from where
other axes are tried, and once biases are known [1]."""

COARSE, FINE = 0.02, 0.002  # Steps of the offset [s].


def antennas(q: PoseTable, length: tuple[float, float] | None) -> Second:
    """Return what a second antenna says [m], by the known `length` of the base and its sd [m]."""
    assert q.second is not None
    second = q.second
    if second.told == "direction":
        if length is None:
            raise error("pose.no_length")
        second = replace(second, place=length[0] * second.place)
    base = second.base(q.position)
    there = np.isfinite(base[:, 0])
    if there.sum() < FEWEST:
        raise error("pose.second_few", count=int(there.sum()), of=len(q), least=FEWEST)
    size = np.linalg.norm(base[there], axis=1)
    far = float(np.median(size))
    scatter = 1.4826 * float(np.median(np.abs(size - far)))
    if not APART[0] < far < APART[1]:
        raise error("pose.base_size", apart=plain(far, 2), least=APART[0], most=int(APART[1]))
    if scatter > RIGID * far:
        low, high = (plain(float(x), 3) for x in np.quantile(size, [0.1, 0.9]))
        raise error("pose.base_varies", low=low, high=high)
    if length is not None:
        # Noise across the base makes it longer; errors that stay leave blocks apart.
        blocks = [np.median(x) for x in np.array_split(size, max(5, int(np.ptp(q.time) / BLOCK)))]
        sd = float(np.hypot(length[1], np.std(blocks) / np.sqrt(len(blocks))))
        if abs(far - length[0]) > SURE * sd + scatter**2 / far:
            raise error("pose.base_length", found=plain(far, 4), given=plain(length[0], 4),
                        sd=plain(1e3 * sd, 2))  # fmt: skip
    return second


AROUND = np.vstack([np.eye(3), -np.eye(3), np.array(list(product((1, -1), repeat=3))) / 3**0.5])
"""Directions of the base that are tried [1]."""


def of_base(
    turns: SlaveAttitude, time: FloatArray, base: FloatArray, longest: float,
    within: tuple[float, float],
) -> tuple[float, FloatArray, FloatArray, float]:  # fmt: skip
    """Return offset [s], C_0v (3, 3), base in b (3,) [m] with ``C_0b d_b = C_0v base`` best.

    And what part of the base most of them leave [1], infinite where nothing is in common. `turns`:
    what the gyros say, C_0b, `within` the times of their log [s]; `base` (k, 3) [m] at `time` (k,)
    [s] in the world; `longest`: offset [s]. The sum of ``(C_0b d)' C_0v u`` over all of them
    is linear in d and in C_0v, each of which is found in turn from the other.
    """
    u = base / np.linalg.norm(base, axis=1)[:, None]

    def tried(tau: float) -> tuple[float, FloatArray, FloatArray]:
        t = time + tau
        if np.mean((t > within[0]) & (t < within[1])) < 0.5:
            return np.inf, np.eye(3), AROUND[0]
        total = np.einsum("kia,kj->iaj", turns.at(time + tau)[0], u) / len(u)
        d, C = AROUND, np.zeros((len(AROUND), 3, 3))
        for _ in range(TURNS):
            U, _, V = np.linalg.svd(np.einsum("iaj,na->nij", total, d))
            U[:, :, 2] *= np.linalg.det(U @ V)[:, None]
            C = U @ V
            d = np.einsum("iaj,nij->na", total, C)
            d /= np.linalg.norm(d, axis=1)[:, None]
        alike = np.einsum("iaj,nij,na->n", total, C, d)
        best = int(np.argmax(alike))
        return -float(alike[best]), C[best], d[best]

    tau = least(lambda t: tried(t)[0], longest)
    alike, C_0v, d = tried(tau)
    off = np.linalg.norm(u @ C_0v.T - turns.at(time + tau)[0] @ d, axis=1)
    left = float(np.median(off)) if np.isfinite(alike) else np.inf
    return tau, C_0v, d * float(np.median(np.linalg.norm(base, axis=1))), left


TURNS = 15  # Times that rotation and base are found from each other [1].


def not_exchanged(at: Point, known: Mapping[str, tuple[float, float]]) -> None:
    """Refuse antennas that are exchanged, by what is `known` of their base [m]."""
    if at.base_b is None:
        return
    size = float(np.linalg.norm(at.base_b))
    said = [known.get(f"pose.base.{a}", known.get("pose.base")) for a in AXES]
    axes = [k for k in range(3) if said[k] is not None]
    given = np.array([(said[k] or (0.0,))[0] for k in axes])
    there = float(np.linalg.norm(given))
    if there > size / 2 and np.linalg.norm(at.base_b[axes] + given) < there / 2:
        found, wanted = (", ".join(plain(float(x), 3) for x in v) for v in (at.base_b[axes], given))
        raise error("pose.swapped", found=found, given=wanted)


def least(left: Callable[[float], float], longest: float) -> float:
    """Return the offset within `longest` [s] that leaves least [s]; `left`: what one leaves."""
    grid = np.arange(-longest, longest + COARSE, COARSE)
    best = grid[int(np.argmin([left(float(tau)) for tau in grid]))]
    grid = np.arange(best - COARSE, best + COARSE, FINE)
    return float(grid[int(np.argmin([left(float(t)) for t in grid]))])
