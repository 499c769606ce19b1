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

from foucault.arrays import FloatArray


def design(readings: FloatArray, norm: float) -> FloatArray:
    """Return the rows of the linear system, shape (m, 9) [1].

    `readings` (m, 3): mean readings, one per orientation [unit of norm]; `norm`: true norm [unit
    of readings].
    """
    x, y, z = (readings / norm).T  # normalised: condition 10 instead of 3e8
    return np.stack(
        [x * x, y * y, z * z, -2 * x * y, -2 * x * z, -2 * y * z, -2 * x, -2 * y, -2 * z], axis=1
    )


def solve(readings: FloatArray, norm: float | FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Solve for the lower-triangular matrix L and the bias b of ``N = L x + b``, ``|x| = norm``.

    `readings` (m, 3): mean readings N, one per orientation, m >= 9 [unit of norm]; `norm` (m,):
    true norm, of all or of each, its sign does not count [unit of readings]. Returns `L` (3, 3):
    lower triangular, positive diagonal [1]; `b` (3,): bias [unit of readings]. None instead of
    the pair where the orientations do not determine an ellipsoid.

    With ``s = |norm| / h``, h the largest norm, ``(N - b)' A (N - b) = (s h)^2`` divided by h^2 is
    ``rows @ K = s^2 - c`` where ``c = b' A b / h^2`` follows from K itself: K is affine in c. With
    equal norms ``c = d' b / (1 + d' b)`` of the solution for c = 0; otherwise it is iterated.
    """
    sizes = np.broadcast_to(np.abs(norm), len(readings))
    h = float(sizes.max())
    s = sizes / h
    rows = design(readings, h) / s[:, None]  # equal noise in the readings, whatever their size
    right = np.column_stack([s, 1.0 / s])
    fit, _, rank, _ = np.linalg.lstsq(rows, right, rcond=1e-9)
    if rank < 9:
        return None
    # Once more for what rounding left: the decomposition costs two digits.
    fit = fit + np.linalg.lstsq(rows, right - rows @ fit, rcond=1e-9)[0]
    K = np.asarray(fit, float)
    try:
        A, d = _ellipsoid(K[:, 0] - _excess(K) * K[:, 1])
        b = np.linalg.solve(A, d)
        # L L' = inv(A) with L lower triangular
        return np.linalg.cholesky(np.linalg.inv(A)), np.asarray(b * h)
    except np.linalg.LinAlgError:  # not an ellipsoid
        return None


def _excess(K: FloatArray) -> float:
    """Find c with ``c = d' b`` where A and d are those of ``K[:, 0] - c K[:, 1]``, by secants."""

    def miss(c: float) -> float:
        A, d = _ellipsoid(K[:, 0] - c * K[:, 1])
        return float(d @ np.linalg.solve(A, d)) - c

    before, at_before = 0.0, miss(0.0)
    c = at_before / (1.0 + at_before)
    for _ in range(30):
        at = miss(c)
        if abs(at) <= 1e-16 or at == at_before:
            break
        before, at_before, c = c, at, c - at * (c - before) / (at - at_before)
    return c


def _ellipsoid(K: FloatArray) -> tuple[FloatArray, FloatArray]:
    A = np.array([[K[0], -K[3], -K[4]], [-K[3], K[1], -K[5]], [-K[4], -K[5], K[2]]])
    return A, K[6:9]


def published_recovery(readings: FloatArray, norm: float) -> tuple[FloatArray, FloatArray]:
    """Recover L and b as published, to first order: for showing what that costs.

    ``b' A b`` is neglected, so that scale factor errors are too small by about ``|b|^2 / 2``
    relative to the norm; misalignments and biases are right to first order only.

    `readings` (m, 3): mean readings, one per orientation, m >= 9 [unit of norm]; `norm`: true
    norm [unit of readings].

    References
    ----------
    .. [1] Dong et al., 2018, eqs. (8) and (12), misprints corrected.
    """
    rows = design(readings, norm)
    K = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]
    root = K[:3] ** -0.5
    yx = K[3] * root[0] / K[1]
    zx = K[4] * root[0] / K[2]
    zy = K[5] * root[1] / K[2]
    L = np.array([[root[0], 0.0, 0.0], [yx, root[1], 0.0], [zx, zy, root[2]]])
    return L, K[6:9] / K[:3] * norm
