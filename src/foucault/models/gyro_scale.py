"""What a gyro's scale factor does that no straight line does: asymmetry and non-linearity.

The rate that a gyro senses, ``r = (I + S_g + M_g) w``, is the input of its readout. The readout
answers, each axis by itself::

    y = r + a |r| + c r^3

The scale factor is that of the straight line times ``1 + a`` for positive and ``1 - a`` for
negative rates, so that the asymmetry a is half the difference of the two as a fraction of their
mean (IEEE Std 528 and 647 call the whole difference so). The cubic term c is the non-linearity
that is alike in both senses; a term in r^2 is not told from the asymmetry by a few rates, and the
even part is left to a alone.

Accelerometers that scale unlike in their two senses answer so too, without the cubic term.

r belongs to the instrument whatever axes w is written in, so the terms survive a change of axes or
of gauge without approximation.

References
----------
.. [1] IEEE Std 528-2019 (scale factor, asymmetry, linearity error), IEEE Std 647-2006, annex A.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray

NEWTON_STEPS = 30
"""More than are ever needed where the readout has an inverse: 4 to 6 are usual [1]."""


def readout(r: FloatArray, asymmetry: FloatArray, cubic: FloatArray) -> FloatArray:
    """Return ``r + a |r| + c r^3``, shape (..., 3) [rad/s].

    `r` (..., 3): rate sensed [rad/s]; `asymmetry` (3,): a, each axis [1]; `cubic` (3,): c, each
    axis [1/(rad/s)^2].
    """
    return np.asarray(r + asymmetry * np.abs(r) + cubic * r**3)


def readout_slope(r: FloatArray, asymmetry: FloatArray, cubic: FloatArray) -> FloatArray:
    """Return the derivative of `readout`, ``1 + a sign(r) + 3 c r^2``, shape (..., 3) [1].

    `r` (..., 3): rate sensed [rad/s]; `asymmetry` (3,): a, each axis [1]; `cubic` (3,): c, each
    axis [1/(rad/s)^2].
    """
    return np.asarray(1.0 + asymmetry * np.sign(r) + 3.0 * cubic * r**2)


def sensed(y: FloatArray, asymmetry: FloatArray, cubic: FloatArray) -> FloatArray:
    """Solve `readout` for r, exact to rounding, shape (..., 3) [rad/s].

    Newton's method on one side of zero, where the answer is ``k r + c r^3`` with
    ``k = 1 + a sign(y)``: from ``y / k`` it goes to the root without passing it.

    `y` (..., 3): readings without bias and g-sensitivity [rad/s]; `asymmetry` (3,): a, each axis,
    less than 1 in size [1]; `cubic` (3,): c, each axis [1/(rad/s)^2].

    With c < 0 the readout turns back at ``r^2 = -k / (3 c)``; no reading beyond has an inverse.
    """
    k = 1.0 + asymmetry * np.sign(y)
    r = np.asarray(y / k)
    if not cubic.any():
        return r
    for _ in range(NEWTON_STEPS):
        step = (k * r + cubic * r**3 - y) / (k + 3.0 * cubic * r**2)
        r = r - step
        if np.max(np.abs(step), initial=0.0) <= 4e-16 * np.max(np.abs(r), initial=1.0):
            break
    return r
