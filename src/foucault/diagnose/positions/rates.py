"""Which means are rests and which are spins, and how fast the spins turn, by the gyros alone.

The rate of a rest is the bias of the gyros, that of a spin has a part along up besides. Across up
both show the bias only, so that the bias is found from all means together, and what is left along
up tells spins from rests.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.rests import split, turning

SLOWEST = np.radians(0.01)
"""No spin is slower, unless it is told so; the Earth turns at 0.004 deg/s [rad/s]."""


def spin_rates(
    w: FloatArray, f: FloatArray | None, time: FloatArray, slowest: float | None
) -> FloatArray:
    """Return the rate of each spin, without bias, shape (n,) [rad/s]; 0 at rest.

    `w` (n, 3): mean rates [rad/s]; `f` (n, 3) or None: mean specific forces, without them the
    rate of a spin has no sign [m/s^2]; `time` (n,): length of each mean [s]; `slowest` or None:
    slowest rate that was commanded, where known [rad/s].
    """
    if f is None:
        rate = np.linalg.norm(w, axis=1)
    else:
        up = f / np.maximum(np.linalg.norm(f, axis=1), 1e-300)[:, None]
        rate = ((w - bias_across(w, up, time)) * up).sum(axis=1)
    rate = np.where(np.abs(rate) > _threshold(rate, time, slowest), rate, 0.0)
    rest = rate == 0
    if not rest.any() or not rate.any():
        return np.asarray(rate)
    # Rests tell the bias better, and so the size does not depend on where up is.
    bias = np.median(w[rest], axis=0)
    off = np.linalg.norm(w - bias, axis=1)
    rate = np.sign(rate) * off
    if slowest is not None and f is not None and rest.sum() > 4:
        # Slower than commanded is no rest either, but a move about the outer axis.
        moving = np.zeros(len(rate), bool)
        moving[rest] = turning(w[rest])[0]
        sense = np.sign(((w - bias) * f).sum(axis=1))
        rate = np.where(moving, sense * off, rate)
    return np.asarray(rate)


def bias_across(w: FloatArray, up: FloatArray, time: FloatArray) -> FloatArray:
    """Fit the bias to the rates across up, which no spin about the vertical has.

    `w` (n, 3): mean rates at rest and in spins [rad/s]; `up` (n, 3): directions of up [1]; `time`
    (n,): length of each mean [s]. Returns (3,): bias; its part along up is zero where up has but
    one direction [rad/s].
    """
    across = np.eye(3) - up[:, :, None] * up[:, None, :]
    weight = np.minimum(time, 30.0)
    for _ in range(10):
        N = np.einsum("n,nij->ij", weight, across)
        b = np.linalg.pinv(N, rcond=1e-3) @ np.einsum("n,nij,nj->i", weight, across, w)
        off = np.linalg.norm(np.einsum("nij,nj->ni", across, w - b), axis=1)
        # A turn that is no spin counts less.
        weight = np.minimum(time, 30.0) / (1 + (off / max(3 * np.median(off), 1e-6)) ** 2)
    return np.asarray(b)


def _threshold(rate: FloatArray, time: FloatArray, slowest: float | None) -> float:
    if slowest is not None:
        return 0.4 * slowest
    size = np.maximum(np.abs(rate), SLOWEST / 10)
    if size.max() < 3 * size.min():  # all rests or all spins
        return 0.0 if float(np.median(size)) > np.radians(0.5) else np.inf
    # Each second counts alike, not each run: moves leave many short ones.
    seconds = np.repeat(size, np.maximum(1, np.round(time).astype(int)))
    return float(max(split(seconds / SLOWEST) * SLOWEST, SLOWEST))
