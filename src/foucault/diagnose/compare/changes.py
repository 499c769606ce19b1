"""Have the coefficients of an instrument changed from one calibration to the next, and how?

Results x_i with covariances P_i are compared all together: ``x_i = A_i beta + e_i`` is solved by
weighted least squares, with one constant value (nothing changed), a straight line in time (drift)
or a step between two results. The sum of squares that is left is chi-square with n p - r p degrees
of freedom where the model holds; correlations inside a result are kept. Errors of different results
are independent but for what they share, ``e_i = own_i + L_i g`` with g of unit variance: the error
of a local gravity that both were given drops out of their difference.

What changed is found coefficient by coefficient, where the sd of each alone decides, and by leaving
one out: chi-square without coefficient k is what a change of k alone would leave [1]_. False alarms
are shared between the tests, so that one comparison in a hundred of unchanged instruments has any.

References
----------
.. [1] W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
   Commission, Publications on Geodesy 2(5), 1968.
.. [2] W. A. Fuller, *Measurement Error Models*, Wiley, 1987 (generalised least squares with known
   covariance).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.compare.fit import Series, constant, line, step
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits

YEAR = 365.25 * 86400.0
"""A Julian year [s]."""

TOO_ALIKE = 0.001
"""Results that agree better than one comparison in so many are noted [1]."""


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
    """Return the limit of a chi-square variable that is too large.

    `dof`: degrees of freedom [1]; `false_alarm`: probability that any of the tests is beyond it
    by chance [1]; `tests`: how many share it [1].
    """
    return chi_square_limits(dof, 2 * false_alarm, tests)[1]


def history(series: Series) -> History:
    """Compare the results of one instrument.

    `series`: two results or more [SI].
    """
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
