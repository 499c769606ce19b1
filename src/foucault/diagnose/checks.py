"""Checks that every method makes: it was solved, its numbers can be, its priors fit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.errors import ADVICE, Status
from foucault.estimate.chi_square import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.result import Check, Level
from foucault.tables import AXES

FloatArray = npt.NDArray[np.float64]

VISIBLE = 4.0
"""The Earth's rate and its opposite are told apart when they lie this far apart [sd]."""

NEAR = 3.0
"""A g-sensitivity within this of what a reversed sign makes may well be that [sd]."""

REVERSED = (
    'the accelerometers read gravity instead of specific force (reads = "gravity"), both triads '
    "are mirrored alike, or the latitude has the wrong sign"
)
"""What turns the vertical Earth rate around."""


def status_check(status: Status, weakest: tuple[str, ...]) -> Check:
    """Return the check that the estimation converged and saw everything.

    Parameters
    ----------
    status : Status
        How the estimation ended.
    weakest : tuple of str
        Combinations of coefficients that were not seen.
    """
    fine = status is Status.CONVERGED
    words = ADVICE[status]
    if weakest:
        words += " Not seen: " + "; ".join(weakest) + "."
    return Check("converged", float(fine), 1.0, None, fine, words, Level.UNUSABLE)


def plausible_scales(coefficients: CoefficientVector) -> list[Check]:
    """Return the checks of size: a scale factor error of a third is a wrong unit.

    Parameters
    ----------
    coefficients : CoefficientVector
        The estimate.
    """
    out = []
    for triad, words in (("accel", "accelerometer"), ("gyro", "gyro")):
        names = [n for n in coefficients.names if n.startswith(f"{triad}.scale.")]
        if not names:
            continue
        values = [coefficients.value(n) for n in names]
        percent = 100 * float(max(values, key=abs))
        fine = abs(percent) < 30
        sentence = (
            f"The largest {words} scale factor error is {percent:.2g} %."
            if fine
            else f"A {words} scale factor error of {percent:.0f} % is a wrong unit or count "
            f"scale, not an instrument: check [log.{triad}]."
        )
        out.append(Check(f"{triad} scale", percent, -30.0, 30.0, fine, sentence, Level.UNUSABLE))
    return out


def prior_check(coefficients: CoefficientVector, residuals: FloatArray) -> Check:
    """Compare the estimate with what was said to be known beforehand.

    Parameters
    ----------
    coefficients : CoefficientVector
        The estimate.
    residuals : ndarray, shape (k,)
        White residuals of the k priors, in order [1].
    """
    known = np.flatnonzero(np.isfinite(coefficients.prior_sd))
    miss = np.abs(residuals)
    limit = float(np.sqrt(chi_square_limits(1, tests=len(known))[1]))
    worst = int(np.argmax(miss))
    fine = bool(miss[worst] <= limit)
    name = coefficients.names[known[worst]]
    words = f"{name} is {miss[worst]:.1f} standard deviations from what was known before" + (
        "." if fine else ": the prior is wrong or too narrow, and it bends the other coefficients."
    )
    return Check("prior", float(miss[worst]), None, limit, fine, words)


CHANCE = 0.005
"""False alarms of the test of the Earth's sign at rest, one-sided [1]."""


def reversed_earth_at_rest(
    rates: FloatArray, up: FloatArray, matrix: FloatArray, site: Site, sd: float = 0.0
) -> Check | None:
    """Doubt rates at rest that are nearer to those of a reversed Earth rate than to none.

    A reversed sign of the vertical part leaves ``-2 w_ie sin(L) up`` in every rest. One number is
    looked for, not nine of a g-sensitivity, so that gyros tell it whose noise hides each of those.

    Parameters
    ----------
    rates : ndarray, shape (n, 3)
        Mean rates at rest, without the Earth's rate as the latitude says it [rad/s].
    up : ndarray, shape (n, 3)
        Directions of up, body axes [1].
    matrix : ndarray, shape (3, 3)
        Scale factors and misalignments of the gyros [1].
    site : Site
        Latitude.
    sd : float
        Least scatter of these rates that their noise makes, per axis [rad/s].

    Returns
    -------
    Check or None
        None where the latitude is unknown or the directions are too few or too much alike.
    """
    from scipy.special import stdtrit

    n = len(rates)
    if site.latitude is None or n < 3:
        return None
    made = float(-2 * EARTH_RATE * np.sin(site.latitude))
    x, y = up @ matrix.T, rates
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    size, dof = float(np.sum(x**2)), 3 * n - 4
    if size < 0.1 * n or made == 0.0:
        return None
    k = float(np.sum(x * y)) / size
    scatter = max(float(np.sqrt(np.sum((y - k * x) ** 2) / dof)), sd)
    slope_sd = scatter / np.sqrt(size)
    if slope_sd <= 0.0:
        return None
    limit = float(stdtrit(dof, 1 - CHANCE))
    away = k / slope_sd * float(np.sign(made))
    nearer = abs(k - made) < abs(k)
    fine = bool(away <= limit or not nearer)
    hour = np.degrees(1.0) * 3600
    words = (
        f"The rates at rest point along up by {hour * k:+.2f} +- {hour * slope_sd:.2f} deg/h; a "
        f"reversed sign of the Earth's rate would make it {hour * made:+.2f}"
    ) + ("." if fine else f". It is probably that: {REVERSED}.")
    top = limit if nearer else None
    return Check("vertical Earth rate", away, None, top, fine, words)


MANY = 10.0
"""An uncertainty so many times what noise and plan allow is no success of the plan [1]."""


def foreseen_check(coefficients: CoefficientVector, bound: npt.ArrayLike) -> Check:
    """Compare the uncertainties with those that noise and plan allow.

    Scatter that is estimated makes a result honest, not good: where one reading spoils all, the
    uncertainties grow until everything fits.

    Parameters
    ----------
    coefficients : CoefficientVector
        The estimate, with covariance [SI].
    bound : array_like, shape (n,)
        Cramer-Rao bound of the same coefficients by the noise alone, as sd; NaN or infinite where
        nothing tells them [SI].
    """
    least = np.asarray(bound, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(np.isfinite(least) & (least > 0), coefficients.sd / least, 0.0)
    worst = int(np.argmax(ratio))
    fine = bool(ratio[worst] <= MANY)
    words = (
        f"The uncertainty of {coefficients.names[worst]} is {ratio[worst]:.1f} times what noise "
        "and plan allow"
    ) + (
        "."
        if fine
        else ": `foucault preflight` promises a better result of this plan. Some readings do not "
        "belong to the others, and their scatter is shared by all."
    )
    return Check("uncertainty against the plan", float(ratio[worst]), None, MANY, fine, words)


def reversed_earth_check(coefficients: CoefficientVector, site: Site) -> Check | None:
    """Doubt a g-sensitivity that is what a reversed sign of the Earth's rate would make.

    One that is alike about all axes adds ``k f`` to the rates, which at rest is upward as the
    vertical Earth rate is: estimated, it takes up a reversed sign as ``k g = -2 w_ie sin L``, and
    leaves nothing in the residuals.

    Parameters
    ----------
    coefficients : CoefficientVector
        The estimate, with covariance [SI].
    site : Site
        Gravity and latitude.

    Returns
    -------
    Check or None
        None where g-sensitivity or latitude is not known, or too little to tell.
    """
    names = [f"gyro.g_sensitivity.{a}{a}" for a in AXES]
    if site.latitude is None or not set(names) <= set(coefficients.names):
        return None
    at = [coefficients.layout.index(name) for name in names]
    if coefficients.cov is None or not coefficients.free[at].all():
        return None
    unit = np.degrees(1.0) * 3600 * site.gravity
    each, cov = unit * coefficients.values[at], unit**2 * coefficients.cov[np.ix_(at, at)]
    value, sd = float(each.mean()), float(np.sqrt(cov.mean()))
    made = float(-2 * np.degrees(EARTH_RATE) * 3600 * np.sin(site.latitude))
    if not 0 < VISIBLE * sd <= abs(made):
        return None
    away = abs(value - made) / sd
    alike = np.ptp(each) < abs(made) + VISIBLE * float(np.sqrt(np.diag(cov).max()))
    fine = bool(away > NEAR or not alike)
    words = (
        f"The g-sensitivity is {value:+.1f} +- {sd:.1f} deg/h per g, mean of all axes; a reversed "
        f"sign of the Earth's rate would make it {made:+.1f} about each"
    )
    words += (
        "." if fine else f". It may well be that: {REVERSED}. Set g_sensitivity = false to see."
    )
    return Check("vertical Earth rate", away, NEAR if alike else None, None, fine, words)
