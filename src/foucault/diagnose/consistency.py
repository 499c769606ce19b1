"""Consistency: do the errors have the size that was promised? Two-sided chi-square limits.

References
----------
.. [1] Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
   Navigation*, Wiley, 2001, section 5.4 (NEES and NIS tests).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.estimate.chi_square import chi_square_limits

FloatArray = npt.NDArray[np.float64]

__all__ = ["chi_square_limits", "nees"]


def nees(errors: FloatArray, cov: FloatArray) -> FloatArray:
    """Return the normalised estimation error squared, ``e' inv(P) e``, of each trial.

    Parameters
    ----------
    errors : ndarray, shape (trials, n)
        Estimate minus truth [SI].
    cov : ndarray, shape (trials, n, n) or (n, n)
        Predicted covariance [SI].

    Returns
    -------
    ndarray, shape (trials,)
        NEES; chi-square with n degrees of freedom where the covariance is right [1].
    """
    scale = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    unit = errors / scale
    correlation = cov / (scale[..., :, None] * scale[..., None, :])
    solved = np.linalg.solve(correlation, unit[..., None])[..., 0]
    return np.asarray(np.sum(unit * solved, axis=-1))
