"""What errors at the hand-over make of the position after an outage."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.transfer.system import Free
from foucault.models.earth import EARTH_RATE, SEMI_MAJOR_AXIS, transport_rate
from foucault.models.ins_errors import Sensors, dynamics
from foucault.models.rotation import exp
from foucault.navigate.state import states_of


def after_outage(free: Free, sensors: Sensors, seconds: float, *, turn: float = 0.0) -> FloatArray:
    """Return the response of the horizontal position to all states, shape (2, n) [m per SI].

    The slave goes on straight and level from the last message, after a quick turn where one is
    given. Straight on, a tilt and the bias that hides it go on hiding each other; turned, not.

    `seconds`: how long the outage lasts [s]; `turn`: change of heading at its beginning, positive
    to the right [rad].
    """
    from scipy.linalg import expm

    last = states_of(free.history[-1])
    latitude, height = float(last["latitude"]), float(last["height"])
    C_ln = last["C_nl"].T
    turned = exp(np.array([0.0, 0.0, -turn]))
    C_nb = turned @ last["C_nb"]
    v = turned @ (last["velocity_n"] * [1.0, 1.0, 0.0])
    w_ie = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    w_en = transport_rate(latitude, height, v)
    w_en[2] = 0.0  # frame l does not turn about up
    C_lb = C_ln @ C_nb
    force_n = np.array([0.0, 0.0, 9.80665])
    A = dynamics(sensors, C_lb, C_nb.T @ (w_ie + w_en), C_nb.T @ force_n,
                 C_ln @ w_ie, C_ln @ w_en, 9.80665 / SEMI_MAJOR_AXIS)  # fmt: skip
    # The height is aided by a barometer: the vertical channel does not run away.
    A[5, :] = 0.0
    out = np.zeros((2, len(free.layout)))
    known = 9 + len(sensors)
    out[:, :known] = expm(A * seconds)[6:8]
    return out
