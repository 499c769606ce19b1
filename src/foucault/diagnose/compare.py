"""Results of one instrument over time, or of several, against their joint uncertainty.

Many instruments side by side: how their coefficients are distributed, and which stand out.

The middle of a population is its median and its width 1.4826 times the median distance from it
(MAD), which a few odd instruments do not move; z is the distance of an instrument from the middle
over that width. Who stands out is decided by the generalised extreme studentized deviate [1]_: the
farthest is set against the mean and standard deviation of all others, taken away, and the next is
looked at, so that one odd instrument does not hide another. The false-alarm rate is that of all
instruments and coefficients together (Bonferroni). The limit is that of the mean and not of the
MAD, which knows the width of eight instruments no better than three would.

An instrument that was measured worse than the others is farther from them for that reason alone:
its distance is made smaller by what its variance has more than the typical one.

Have the coefficients of an instrument changed from one calibration to the next, and how?

Results x_i with covariances P_i are compared all together: ``x_i = A_i beta + e_i`` is solved by
weighted least squares, with one constant value (nothing changed), a straight line in time (drift)
or a step between two results. The sum of squares that is left is chi-square with n p - r p degrees
of freedom where the model holds; correlations inside a result are kept. Errors of different results
are independent but for what they share, ``e_i = own_i + L_i g`` with g of unit variance: the error
of a local gravity that both were given drops out of their difference.

What changed is found coefficient by coefficient, where the sd of each alone decides, and by leaving
one out: chi-square without coefficient k is what a change of k alone would leave [2]_. False alarms
are shared between the tests, so that one comparison in a hundred of unchanged instruments has any.

References
----------
.. [1] B. Rosner, "Percentage points for a generalized ESD many-outlier procedure", Technometrics
   25(2), 1983.
.. [2] W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
   Commission, Publications on Geodesy 2(5), 1968.
.. [3] W. A. Fuller, *Measurement Error Models*, Wiley, 1987 (generalised least squares with known
   covariance).

Several instruments side by side: can they be told apart, and is one unlike the others?

Instruments may differ; that is no fault. The chi-square of a coefficient about one common value
says whether the calibrations can tell the instruments apart at all. Which instrument stands out of
a population is decided as in a fleet, see `outlying`, and takes as many instruments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.comparable import Series, constant, line, step
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits

TO_SD = 1.482602218505602  # Standard deviation over MAD, for a normal distribution [1].
ODD = 0.25  # Largest part of a fleet that can stand out of it: more are a second population [1].
FEWEST = 8  # Fewer instruments have no distribution that one of them could stand out of [1].


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
    """Describe how `values` (N, p), NaN where there is none, with `sd` (N, p), lie [SI]."""
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
    """Return the median of `x` (n,) [any], and 1.4826 times the median distance from it."""
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
    y, half = z[order], len(z) // 2
    first, last, taken, count = 0, len(z) - 1, list[int](), 0
    m = len(z) - np.arange(int(ODD * len(z)))
    t = stdtrit(m - 2, 1 - false_alarm / (2 * m))
    # Sums from the middle outward: those left are the sum of two of them, and nothing cancels.
    # In numbers of Python: one of NumPy by itself takes ten times as long.
    (of_below, square_below), (of_above, square_above) = (
        [np.concatenate(([0.0], np.cumsum(x**k))).tolist() for k in (1, 2)]
        for x in (y[:half][::-1], y[half:])
    )
    values, numbers = y.tolist(), order.tolist()
    for limit in ((m - 1) * t / np.sqrt(m * (m - 2 + t**2))).tolist():
        n, low, high = last - first + 1, values[first], values[last]
        middle = (of_below[half - first] + of_above[last + 1 - half]) / n
        squares = square_below[half - first] + square_above[last + 1 - half]
        variance = (squares - n * (middle * middle)) / (n - 1)
        spread = math.sqrt(variance) if variance >= 0.0 else math.inf  # all alike, to rounding
        above = high - middle > middle - low
        taken.append(numbers[last if above else first])
        if max(high - middle, middle - low) > limit * spread:
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
        for d in np.unique(redundancy[usable[:, t], t]):
            high = chi_square_limits(float(d), tests=tests)[1]
            mine = usable[:, t] & (redundancy[:, t] == d) & (chi_square[:, t] > high)
            for i in np.flatnonzero(mine):
                ratio, z = (float(np.sqrt(chi_square[i, t] / x)) for x in (d, high))
                out.append(Outlying(int(i), f"noise of the {what}", ratio, z))
    return sorted(out, key=lambda o: -o.z)


YEAR = 365.25 * 86400.0  # A Julian year [s].
TOO_ALIKE = 0.001  # Results that agree better than one comparison in so many are noted [1].


@dataclass(frozen=True)
class Pair:
    """One result compared with an earlier one."""

    # first, second: numbers of the results [1]
    first: int
    second: int
    # change, sd: (p,) second minus first, and its standard deviation [SI]
    change: FloatArray
    sd: FloatArray
    chi_square: float  # of all changes together [1]
    # (p,) change that a coefficient would have made, had it alone changed, over its standard
    # deviation; its square is how much smaller chi-square would be without it [1]
    w: FloatArray

    @property
    def z(self) -> FloatArray:
        """Changes over their standard deviations, shape (p,) [1]."""
        return self.change / self.sd

    @property
    def alone(self) -> int | None:
        """Number of the coefficient whose change leaves nothing to explain [1]; None if none does.

        Of two that would, the one that leaves less.
        """
        best = int(np.argmax(np.abs(self.w)))
        others = len(self.w) - 1
        left = self.chi_square - self.w[best] ** 2
        return best if others == 0 or left <= upper(others, FALSE_ALARM) else None


def pair(series: Series, i: int, j: int) -> Pair:
    """Compare result number `j` with result number `i`, both shape () [1]."""
    common = series.shared[i] @ series.shared[j].T
    cov = series.cov[i] + series.cov[j] - common - common.T
    change, sd = series.values[j] - series.values[i], np.sqrt(np.diag(cov))
    information = np.linalg.inv(cov / np.outer(sd, sd))
    solved = information @ (change / sd)
    w = solved / np.sqrt(np.diag(information))
    return Pair(i, j, change, sd, float(change / sd @ solved), w)


@dataclass(frozen=True)
class Course:
    """What one coefficient did in time, looked at alone."""

    name: str
    chi_square: float  # of its values about a constant [1]
    stands_out: bool  # whether it is more than the limit that all coefficients share
    # drift, drift_sd: slope of the line; NaN without dates [SI per year]
    drift: float
    drift_sd: float
    drifts: bool  # whether the slope is more than chance, of all coefficients
    line_chi_square: float  # of its values about the line; NaN where there is none [1]
    step_after: int  # number of the result after which a step explains most [1]
    # step, step_sd: size of that step [SI]
    step: float
    step_sd: float
    step_chi_square: float  # what the step leaves [1]
    left: float  # chi-square of all other coefficients with this one left out [1]
    how: str  # "steady", "change" (of two results), "drift", "step", "drift or step" or "scatter"


@dataclass(frozen=True)
class History:
    """The results of one instrument compared."""

    series: Series  # the results [SI]
    chi_square: float  # of all coefficients of all results about constants [1]
    dof: int  # its degrees of freedom [1]
    # low, high: limits of it: below, the results are more alike than they say [1]
    low: float
    high: float
    limit: float  # of the chi-square of one coefficient [1]
    drift_limit: float  # of a slope over its standard deviation [1]
    pair_limit: float  # of the chi-square of a pair [1]
    # of a change over its standard deviation, shared by all coefficients of all pairs [1]
    z_limit: float
    pairs: tuple[Pair, ...]  # every pair, in order
    courses: tuple[Course, ...]  # (p,) coefficient by coefficient

    @property
    def changed(self) -> bool:
        """Whether anything is more than chance explains."""
        return self.chi_square > self.high or bool(self.standing_out)

    @property
    def standing_out(self) -> tuple[int, ...]:
        """Numbers of the coefficients that changed or drifted, the most striking first."""
        found = [k for k, c in enumerate(self.courses) if c.stands_out or c.drifts]
        return tuple(sorted(found, key=lambda k: -self.courses[k].chi_square))

    @property
    def likeliest(self) -> int:
        """Number of the coefficient whose change alone would explain most [1]."""
        return min(range(len(self.courses)), key=lambda k: self.courses[k].left)

    @property
    def alone(self) -> bool:
        """Whether a change of `likeliest` alone leaves nothing to explain."""
        p = len(self.courses)
        dof = self.dof * (p - 1) // p
        return dof == 0 or self.courses[self.likeliest].left <= upper(dof, FALSE_ALARM)


def upper(dof: int, false_alarm: float, tests: int = 1) -> float:
    """Return what a chi-square variable of `dof` exceeds by `false_alarm`, one of `tests` [1]."""
    return chi_square_limits(dof, 2 * false_alarm, tests)[1]


def history(series: Series) -> History:
    """Compare two results or more of one instrument [SI]."""
    n, p = series.values.shape
    # Together, one by one, and slopes, which tell something new of three results or more.
    share = FALSE_ALARM / (3 if series.dated and n > 2 else 2)
    all_pairs = tuple(pair(series, i, j) for i, j in combinations(range(n), 2))
    whole = constant(series)
    limit, drift_limit = upper(n - 1, share, p), float(np.sqrt(upper(1, share, p)))
    return History(
        series=series,
        chi_square=whole.chi_square,
        dof=whole.dof,
        low=chi_square_limits(whole.dof, 2 * TOO_ALIKE)[0],
        high=upper(whole.dof, share),
        limit=limit,
        drift_limit=drift_limit,
        pair_limit=upper(p, share, len(all_pairs)),
        z_limit=float(np.sqrt(upper(1, share, len(all_pairs) * p))),
        pairs=all_pairs,
        courses=tuple(_course(series, k, limit, drift_limit) for k in range(p)),
    )


def _course(series: Series, k: int, limit: float, drift_limit: float) -> Course:
    one, n = series.only([k]), len(series)
    still = constant(one).chi_square
    after, stepped = step(one)
    slope, slope_sd, straight = np.nan, np.nan, np.nan
    if series.dated:
        lined = line(one)
        slope, slope_sd = lined.values[1, 0] * YEAR, lined.sd[1, 0] * YEAR
        straight = lined.chi_square
    drifts = bool(series.dated and n > 2 and abs(slope) > drift_limit * slope_sd)
    out = still > limit
    return Course(
        name=series.names[k],
        chi_square=still,
        stands_out=bool(out),
        drift=float(slope),
        drift_sd=float(slope_sd),
        drifts=drifts,
        line_chi_square=float(straight),
        step_after=after,
        step=float(stepped.values[1, 0]),
        step_sd=float(stepped.sd[1, 0]),
        step_chi_square=stepped.chi_square,
        left=constant(series.without(k)).chi_square,
        how=_how(n, straight, stepped.chi_square) if out or drifts else "steady",
    )


def _how(n: int, straight: float, stepped: float) -> str:
    """Say what a coefficient that is not steady does; two results cannot tell."""
    if n == 2:
        return "change"
    most = upper(n - 2, FALSE_ALARM)
    fits = (straight <= most, stepped <= most)  # without dates the line is NaN and does not
    return {
        (True, True): "drift or step",
        (True, False): "drift",
        (False, True): "step",
        (False, False): "scatter",
    }[fits]


@dataclass(frozen=True)
class Spread:
    """One coefficient over the instruments."""

    name: str
    mean: float  # of the instruments, each weighted alike [SI]
    spread: float  # standard deviation of the instruments [SI]
    # lowest, highest: extreme values [SI]
    lowest: float
    highest: float
    sd: float  # root mean square of the standard deviations of the calibrations [SI]
    chi_square: float  # about one value for all [1]
    told_apart: bool  # whether that is more than chance, of all coefficients


@dataclass(frozen=True)
class Between:
    """Instruments compared, one result of each."""

    series: Series  # the results; n of them [SI]
    limit: float  # of the chi-square of a coefficient [1]
    spreads: tuple[Spread, ...]  # (p,) coefficient by coefficient
    # what stands out, the farthest first; nothing among few instruments
    outlying: tuple[Outlying, ...]


def between(series: Series) -> Between:
    """Compare instruments by a result of each, two or more [SI]."""
    n, p = series.values.shape
    limit = upper(n - 1, FALSE_ALARM, p)
    spreads = []
    for k, name in enumerate(series.names):
        x, sd = series.values[:, k], series.sd[:, k]
        chi_square = constant(series.only([k])).chi_square
        spreads.append(
            Spread(
                name, float(x.mean()), float(x.std(ddof=1)), float(x.min()), float(x.max()),
                float(np.sqrt(np.mean(sd**2))), chi_square, chi_square > limit,
            )
        )  # fmt: skip
    odd = outlying(series.names, series.values, series.sd)
    return Between(series, limit, tuple(spreads), tuple(odd))
