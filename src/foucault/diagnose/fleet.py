"""Many instruments side by side: how their coefficients are distributed, and which stand out.

The middle of a population is its median and its width 1.4826 times the median distance from it
(MAD), which a few odd instruments do not move; z is the distance of an instrument from the middle
over that width. Who stands out is decided by the generalised extreme studentized deviate [1]_: the
farthest is set against the mean and standard deviation of all others, taken away, and the next is
looked at, so that one odd instrument does not hide another. The false-alarm rate is that of all
instruments and coefficients together (Bonferroni). The limit is that of the mean and not of the
MAD, which knows the width of eight instruments no better than three would.

An instrument that was measured worse than the others is farther from them for that reason alone:
its distance is made smaller by what its variance has more than the typical one.

References
----------
.. [1] B. Rosner, "Percentage points for a generalized ESD many-outlier procedure", Technometrics
   25(2), 1983.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits

TO_SD = 1.482602218505602
"""Standard deviation over MAD, for a normal distribution [1]."""

ODD = 0.25
"""Largest part of a fleet that can stand out of it: more are a second population [1]."""

FEWEST = 8
"""Fewer instruments have no distribution that one of them could stand out of [1]."""


@dataclass(frozen=True)
class Distribution:
    """One coefficient over the fleet."""

    name: str
    count: int  # instruments that have it [1]
    median: float  # middle value [SI]
    spread: float  # robust standard deviation over the instruments [SI]
    # lowest, highest: extreme values [SI]
    lowest: float
    highest: float
    sd: float  # median standard deviation of the measurement [SI]


@dataclass(frozen=True)
class Outlying:
    """A coefficient of an instrument that differs from the fleet's by more than chance."""

    index: int  # number of the instrument [1]
    name: str  # the coefficient, or "noise of the accelerometers", "noise of the gyros"
    value: float  # its value [SI]; of noise the ratio to that of the fleet [1]
    # distance from the median over the spread; of noise the square root of chi-square over its
    # limit [1]
    z: float


def distributions(names: Sequence[str], values: FloatArray, sd: FloatArray) -> list[Distribution]:
    """Describe how each coefficient is distributed.

    `names` (p,): coefficients; `values` (N, p): their values, NaN where an instrument has none
    [SI]; `sd` (N, p): their standard deviations [SI].
    """
    out = []
    for k, name in enumerate(names):
        x = values[np.isfinite(values[:, k]), k]
        if not len(x):
            continue
        middle, spread = middle_and_spread(x)
        known = sd[np.isfinite(sd[:, k]), k]
        typical = float(np.median(known)) if len(known) else float("nan")
        out.append(
            Distribution(name, len(x), middle, spread, float(x.min()), float(x.max()), typical)
        )
    return out


def middle_and_spread(x: FloatArray) -> tuple[float, float]:
    """Return the median and 1.4826 times the median distance from it.

    `x` (n,): values [any].
    """
    middle = float(np.median(x))
    return middle, float(TO_SD * np.median(np.abs(x - middle)))


def outlying(
    names: Sequence[str], values: FloatArray, sd: FloatArray | None = None
) -> list[Outlying]:
    """Name the instruments that differ from the fleet, the farthest first.

    `names` (p,): coefficients; `values` (N, p): their values, NaN where an instrument has none
    [SI]; `sd` (N, p): their standard deviations [SI], None where all are measured alike.
    """
    known = np.isfinite(values)
    looked = [k for k in range(len(names)) if known[:, k].sum() >= FEWEST]
    out = []
    for k in looked:
        mine = np.flatnonzero(known[:, k])
        x = values[mine, k]
        middle, spread = middle_and_spread(x)
        if not spread > 0:  # more than half of the instruments say the same to the last bit
            continue
        z = (x - middle) / spread
        if sd is not None:
            z = z / np.sqrt(1.0 + _worse(sd[mine, k]) / spread**2)
        far = _extreme(z, FALSE_ALARM / len(looked))
        out += [Outlying(int(mine[j]), names[k], float(x[j]), float(z[j])) for j in far]
    return sorted(out, key=lambda o: -abs(o.z))


def _worse(sd: FloatArray) -> FloatArray:
    """Return by how much variances are larger than the typical one; where unknown, not."""
    variance = np.where(np.isfinite(sd), sd, 0.0) ** 2
    return np.asarray(np.maximum(variance - np.median(variance), 0.0))


def _extreme(z: FloatArray, false_alarm: float) -> list[int]:
    """Return which values do not belong to one normal distribution, the farthest first [1]_."""
    from scipy.special import stdtrit

    order = np.argsort(z, kind="stable")  # the farthest is the first or the last of those left
    first, last, taken, count = 0, len(z) - 1, list[int](), 0
    m = len(z) - np.arange(int(ODD * len(z)))
    t = stdtrit(m - 2, 1 - false_alarm / (2 * m))
    for limit in (m - 1) * t / np.sqrt(m * (m - 2 + t**2)):
        y = z[order[first : last + 1]]
        middle, spread = y.mean(), y.std(ddof=1)
        above = y[-1] - middle > middle - y[0]
        taken.append(int(order[last if above else first]))
        if max(y[-1] - middle, middle - y[0]) / spread > limit:
            count = len(taken)
        first, last = first + (not above), last - above
    return taken[:count]


def noisy(chi_square: FloatArray, redundancy: FloatArray) -> list[Outlying]:
    """Name the instruments whose residuals are larger than the noise of the fleet explains.

    `chi_square` (N, 2): sums of squared residuals over their variances, accelerometers and gyros
    [1]; `redundancy` (N, 2): what they should be [1].
    """
    usable = np.isfinite(chi_square) & (redundancy >= 0.5)
    tests = max(int(usable.sum()), 1)
    out = []
    for t, what in enumerate(("accelerometers", "gyros")):
        for i in np.flatnonzero(usable[:, t]):
            high = chi_square_limits(float(redundancy[i, t]), tests=tests)[1]
            if chi_square[i, t] > high:
                ratio = float(np.sqrt(chi_square[i, t] / redundancy[i, t]))
                z = float(np.sqrt(chi_square[i, t] / high))
                out.append(Outlying(int(i), f"noise of the {what}", ratio, z))
    return sorted(out, key=lambda o: -o.z)
