"""What three accelerometers that are not at one point, or not at one time with the gyros, read.

An accelerometer at r_i from the point that is navigated, in body axes, feels besides::

    (w x (w x r_i) + w' x r_i) along its own axis i          (size effect)

and one whose readings are stamped later than the gyros' by tau reads ``f(t - tau) = f - tau f'``.
Both are linear in r_i and tau, with products and derivatives of the rates as inputs (see
`kernels.ins_filter`); the derivatives are central differences of the readings.

Where all three are shifted alike the point that is navigated is another one: a set of lever arms is
known but for such a shift. Here r_z is zero: the point is the z accelerometer.

References
----------
.. [1] P. G. Savage, *Strapdown Analytics*, 2nd ed., 2007, section 8.1.4.1 (size effect).
"""

from __future__ import annotations

import numpy as np

from foucault.coefficients import Coefficient, Layout
from foucault.models.ins_errors import Sensors
from foucault.tables import AXES

LEVER = Layout(
    tuple(
        Coefficient(
            f"accel.lever.{i}{k}", f"r_{i}{k}", "length",
            f"{k} coordinate of the {i} accelerometer from the z accelerometer, body axes",
        )
        for i in AXES[:2]
        for k in AXES
    )
)  # fmt: skip
"""Lever arms of the x and y accelerometers from the z accelerometer."""

OFFSET = Layout(
    (Coefficient("accel.delay", "tau", "time", "how much later accelerometers read than gyros"),)
)
"""Time between gyros and accelerometers."""

_PRODUCTS = {(0, 0): 31, (1, 1): 32, (2, 2): 33, (0, 1): 34, (0, 2): 35, (1, 2): 36}
_RATE_CHANGE, _FORCE_CHANGE = 37, 40


def with_size_effect(sensors: Sensors, *, lever: bool = True, delay: bool = True) -> Sensors:
    """Return the coefficients with lever arms and delay of the accelerometers after them.

    Parameters
    ----------
    sensors : Sensors
        The others.
    lever, delay : bool
        Which of the two are added.
    """
    rows: list[tuple[int, int, int, float]] = []
    more: list[Coefficient] = []
    if lever:
        for c, (i, k) in enumerate((i, k) for i in range(2) for k in range(3)):
            rows += [(len(sensors) + c, 3 + i, *part) for part in _lever_terms(i, k)]
        more += LEVER.coefficients
    if delay:
        c = len(sensors) + len(more)
        rows += [(c, 3 + i, _FORCE_CHANGE + i, -1.0) for i in range(3)]
        more += OFFSET.coefficients
    if not rows:
        return sensors
    coefficient, axis, entry, weight = (np.array(x) for x in zip(*rows, strict=True))
    return Sensors(
        Layout((*sensors.layout.coefficients, *more)),
        np.concatenate([sensors.coefficient, coefficient]),
        np.concatenate([sensors.axis, axis]),
        np.concatenate([sensors.entry, entry]),
        np.concatenate([sensors.weight, weight]),
    )


def _lever_terms(i: int, k: int) -> list[tuple[int, float]]:
    """Return inputs and factors of what r_ik does: (w_i w_k - delta_ik w^2) and w' x r."""
    if i == k:
        return [(_PRODUCTS[j, j], -1.0) for j in range(3) if j != i]
    pair = (min(i, k), max(i, k))
    # (w' x r)_i = w'_(i+1) r_(i+2) - w'_(i+2) r_(i+1)
    turn = ((i + 1) % 3, 1.0) if k == (i + 2) % 3 else ((i + 2) % 3, -1.0)
    return [(_PRODUCTS[pair], 1.0), (_RATE_CHANGE + turn[0], turn[1])]
