"""Many instruments side by side: how their coefficients are distributed, and which stand out.

The middle of a population is its median and its width 1.4826 times the median distance from it
(MAD), which a few odd instruments do not move. The robust z-score of an instrument is its
distance from the median over that width. As the width is known no better than from 0.37 N
instruments' worth of a standard deviation, z is compared with Student's t of so many degrees of
freedom, at a false-alarm rate that all instruments and coefficients share (Bonferroni).

References
----------
.. [1] P. J. Rousseeuw, C. Croux, "Alternatives to the median absolute deviation", J. American
   Statistical Association 88(424), 1993 (efficiency of the MAD: 37 %).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits

FloatArray = npt.NDArray[np.float64]

TO_SD = 1.482602218505602
"""Standard deviation over MAD, for a normal distribution [1]."""

EFFICIENCY = 0.37
"""Efficiency of the MAD for a normal distribution [1]."""

FEWEST = 8
"""Fewer instruments have no distribution that one of them could stand out of [1]."""


@dataclass(frozen=True)
class Distribution:
    """One coefficient over the fleet.

    Attributes
    ----------
    name : str
        The coefficient.
    count : int
        Instruments that have it [1].
    median : float
        Middle value [SI].
    spread : float
        Robust standard deviation over the instruments [SI].
    lowest, highest : float
        Extreme values [SI].
    sd : float
        Median standard deviation of the measurement [SI].
    """

    name: str
    count: int
    median: float
    spread: float
    lowest: float
    highest: float
    sd: float


@dataclass(frozen=True)
class Outlying:
    """A coefficient of an instrument that differs from the fleet's by more than chance.

    Attributes
    ----------
    index : int
        Number of the instrument [1].
    name : str
        The coefficient, or "noise of the accelerometers", "noise of the gyros".
    value : float
        Its value [SI]; of noise the ratio to that of the fleet [1].
    z : float
        Distance from the median over the spread; of noise the square root of chi-square over its
        limit [1].
    """

    index: int
    name: str
    value: float
    z: float


def distributions(names: Sequence[str], values: FloatArray, sd: FloatArray) -> list[Distribution]:
    """Describe how each coefficient is distributed.

    Parameters
    ----------
    names : sequence of str, shape (p,)
        Coefficients.
    values : ndarray, shape (N, p)
        Their values, NaN where an instrument has none [SI].
    sd : ndarray, shape (N, p)
        Their standard deviations [SI].
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

    Parameters
    ----------
    x : ndarray, shape (n,)
        Values [any].
    """
    middle = float(np.median(x))
    return middle, float(TO_SD * np.median(np.abs(x - middle)))


def limit_of_z(instruments: int, tests: int, false_alarm: float = FALSE_ALARM) -> float:
    """Return the robust z-score beyond which an instrument stands out [1].

    Parameters
    ----------
    instruments : int, shape ()
        Size N of the fleet [1].
    tests : int, shape ()
        Number of z-scores that are looked at [1].
    false_alarm : float
        Probability that any of them is beyond by chance [1].
    """
    from scipy.special import stdtrit

    return float(stdtrit(max(EFFICIENCY * instruments, 1.0), 1 - false_alarm / (2 * tests)))


def outlying(names: Sequence[str], values: FloatArray) -> list[Outlying]:
    """Name the instruments that differ from the fleet, the farthest first.

    Parameters
    ----------
    names : sequence of str, shape (p,)
        Coefficients.
    values : ndarray, shape (N, p)
        Their values, NaN where an instrument has none [SI].
    """
    known = np.isfinite(values)
    tests = int(known.sum())
    out = []
    for k, name in enumerate(names):
        mine = np.flatnonzero(known[:, k])
        if len(mine) < FEWEST:
            continue
        x = values[mine, k]
        middle, spread = middle_and_spread(x)
        if not spread > 0:  # more than half of the instruments say the same to the last bit
            continue
        z = (x - middle) / spread
        far = np.flatnonzero(np.abs(z) > limit_of_z(len(mine), tests))
        out += [Outlying(int(mine[j]), name, float(x[j]), float(z[j])) for j in far]
    return sorted(out, key=lambda o: -abs(o.z))


def noisy(chi_square: FloatArray, redundancy: FloatArray) -> list[Outlying]:
    """Name the instruments whose residuals are larger than the noise of the fleet explains.

    Parameters
    ----------
    chi_square : ndarray, shape (N, 2)
        Sums of squared residuals over their variances, accelerometers and gyros [1].
    redundancy : ndarray, shape (N, 2)
        What they should be [1].
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
