"""Calibrate a triad from the known norm of what it measures: the linear solution, exact.

With ``N = L x + b`` and ``|x| = h`` known, ``(N - b)' A (N - b) = h^2`` where ``A = inv(L L')``.
Dividing by h^2 and collecting terms gives nine unknowns that enter linearly. The scale that the
division hides is recovered exactly, so that the solution is right for errors of any size.

References
----------
.. [1] Dong, Ren, Chen, Wang, Infrared and Laser Engineering 47(9), 2018, eqs. (7), (8), with
   the recovery made exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def design(readings: FloatArray, norm: float) -> FloatArray:
    """Return the rows of the linear system, shape (m, 9) [1].

    Parameters
    ----------
    readings : ndarray, shape (m, 3)
        Mean readings, one per orientation [unit of norm].
    norm : float
        True norm [unit of readings].
    """
    x, y, z = (readings / norm).T  # normalised: condition 10 instead of 3e8
    return np.stack(
        [x * x, y * y, z * z, -2 * x * y, -2 * x * z, -2 * y * z, -2 * x, -2 * y, -2 * z], axis=1
    )


def solve(readings: FloatArray, norm: float) -> tuple[FloatArray, FloatArray] | None:
    """Solve for the lower-triangular matrix L and the bias b of ``N = L x + b``, ``|x| = norm``.

    Parameters
    ----------
    readings : ndarray, shape (m, 3)
        Mean readings N, one per orientation, m >= 9 [unit of norm].
    norm : float
        True norm [unit of readings].

    Returns
    -------
    L : ndarray, shape (3, 3)
        Lower triangular, positive diagonal [1].
    b : ndarray, shape (3,)
        Bias [unit of readings].
        None instead of the pair where the orientations do not determine an ellipsoid.
    """
    rows = design(readings, norm)
    K, _, rank, _ = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=1e-9)
    if rank < 9:
        return None
    A1 = np.array([[K[0], -K[3], -K[4]], [-K[3], K[1], -K[5]], [-K[4], -K[5], K[2]]])
    d = K[6:9]
    try:
        b = np.linalg.solve(A1, d)
        A = A1 / (1.0 + d @ b)
        # L L' = inv(A) with L lower triangular
        return np.linalg.cholesky(np.linalg.inv(A)), b * norm
    except np.linalg.LinAlgError:  # not an ellipsoid
        return None
