"""What a reference that is not known exactly makes of the coefficients found by it.

Local gravity is common to all accelerometers, the rate of a table to all gyros: no reading shows
that either is wrong, so that its uncertainty is added to the covariance of the estimate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel, coefficient_slot

FloatArray = npt.NDArray[np.float64]


def with_references(
    coefficients: CoefficientVector, site: Site, table_rate_sd: float = 0.0
) -> CoefficientVector:
    """Add the uncertainty of gravity and of a table's rate, each common to a whole triad.

    Parameters
    ----------
    coefficients : CoefficientVector
        The estimate, as if both were known [SI].
    site : Site
        Gravity and its uncertainty.
    table_rate_sd : float
        Relative sd of an error that all spin rates share [1].
    """
    assert coefficients.cov is not None
    gravity = gravity_error(coefficients, site)
    rate = rate_slope(coefficients) * table_rate_sd
    cov = coefficients.cov + np.outer(gravity, gravity) + np.outer(rate, rate)
    return replace(coefficients, cov=cov)


def gravity_error(vector: CoefficientVector, site: Site) -> FloatArray:
    """Return what one standard deviation of local gravity makes of coefficients, shape (n,).

    Parameters
    ----------
    vector : CoefficientVector
        The coefficients [SI].
    site : Site
        Gravity and its uncertainty.
    """
    return gravity_slope(vector) * (site.gravity_sd / site.gravity)


def gravity_slope(vector: CoefficientVector) -> FloatArray:
    """Return how coefficients found by the norm of gravity change with the g that was assumed.

    A g assumed larger by the fraction e makes every specific force larger by it, and so the
    accelerometer matrix, the g-sensitivity and the deflection smaller by e and the quadratic terms
    by 2 e; an asymmetry stays what it is.

    Parameters
    ----------
    vector : CoefficientVector
        The coefficients; those of other models do not change with it.

    Returns
    -------
    ndarray, shape (n,)
        Derivative with respect to ln(g) [SI unit of each coefficient].
    """
    known = [i for i, name in enumerate(vector.names) if name in LAYOUT]
    model = ImuModel.from_coefficients(vector.chosen(vector.names[i] for i in known))
    powers = {"accel_matrix": -1.0, "g_sensitivity": -1.0, "accel_quadratic": -2.0}
    powers["deflection"] = -1.0
    out = np.zeros(len(vector))
    for i in known:
        block, where = coefficient_slot(vector.names[i])
        out[i] = powers.get(block, 0.0) * getattr(model, block)[where]
    return out


def rate_slope(vector: CoefficientVector) -> FloatArray:
    """Return how coefficients change with the logarithm of the rate that was assumed, (n,).

    Parameters
    ----------
    vector : CoefficientVector
        The coefficients; those of other models do not change with it [SI].
    """
    known = [i for i, name in enumerate(vector.names) if name in LAYOUT]
    model = ImuModel.from_coefficients(vector.chosen(vector.names[i] for i in known))
    out = np.zeros(len(vector))
    for i in known:
        block, where = coefficient_slot(vector.names[i])
        if block == "gyro_matrix":
            out[i] = -model.gyro_matrix[where]
    return out
