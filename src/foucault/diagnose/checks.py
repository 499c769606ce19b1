"""Checks that every method makes: it was solved, its scale factors can be, its priors fit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.errors import ADVICE, Status
from foucault.estimate.chi_square import chi_square_limits
from foucault.result import Check, Level

FloatArray = npt.NDArray[np.float64]


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
