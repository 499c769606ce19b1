"""Consistency: do errors have the size that was promised? Two-sided chi-square limits.

An error e with covariance P has the normalised square ``e' inv(P) e``, which is chi-square with
as many degrees of freedom as e has entries where P is right. Of estimation errors it is called
NEES (the truth must be known), of innovations NIS (it needs no truth).

References
----------
.. [1] Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
   Navigation*, Wiley, 2001, section 5.4 (NEES and NIS tests).
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.words import check
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.result import Check


def nees(errors: FloatArray, cov: FloatArray) -> FloatArray:
    """Return the normalised estimation error squared, ``e' inv(P) e``, of each trial.

    `errors` (trials, n): estimate minus truth [SI]; `cov` (trials, n, n) or (n, n): predicted
    covariance [SI]. Returns (trials,): NEES; chi-square with n degrees of freedom where the
    covariance is right [1].
    """
    scale = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    unit = errors / scale
    correlation = cov / (scale[..., :, None] * scale[..., None, :])
    solved = np.linalg.solve(correlation, unit[..., None])[..., 0]
    return np.asarray(np.sum(unit * solved, axis=-1))


def consistency_check(
    name: str, squares: FloatArray, dof: int, false_alarm: float = FALSE_ALARM
) -> Check:
    """Test the mean of independent normalised squares, two-sided, and say what it means.

    `squares` (n,): normalised squares of independent trials or updates [1]; `dof`: degrees of
    freedom of each [1]; `false_alarm`: probability of failing a result that is right [1].
    """
    n = len(squares)
    low, high = (v / (n * dof) for v in chi_square_limits(n * dof, false_alarm))
    value = float(np.mean(squares) / dof)
    return check("consistency", name, value, low, high, {"name": name})
