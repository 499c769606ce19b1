"""The slave as it goes on alone, and what its errors make of the position after an outage."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.estimate.ins_filter import Updates, run
from foucault.estimate.transfer.model import FreeInertial, TransferFit
from foucault.estimate.transfer.slave import Slave
from foucault.kernels.ins_filter import corrected
from foucault.models.earth import EARTH_RATE, SEMI_MAJOR_AXIS, transport_rate
from foucault.models.ins_errors import Sensors, dynamics
from foucault.models.rotation import exp
from foucault.navigate.state import State, state_of, states_of


@dataclass(frozen=True)
class HandOver:
    """The slave as it goes on alone."""

    state: State  # where it is, how fast and how turned
    coefficients: CoefficientVector  # errors of its sensors, with covariance [SI]
    cov: FloatArray  # (9, 9) covariance of (phi, velocity, position), frame n [SI]
    row: int  # row of the increments at whose end all this holds [1]


def hand_over(
    slave: Slave, found: TransferFit, time: float, *, position: State | None = None
) -> HandOver:
    """Carry what was found at the last message on to the hand-over.

    `time`: when it is handed over, by the slave's clock, after the last message holds [s];
    `position` or None: where it was when the last message held, by the master: a free run does
    not know.
    """
    p = len(slave.sensors)
    x, rows = found.run.states[-1], found.system.rows
    state = state_of(corrected(found.system.history[-1:], x[None, :9])[0])
    if position is not None:
        state = replace(state, latitude=position.latitude, longitude=position.longitude,
                        height=position.height)  # fmt: skip
    end = max(slave.increments.row_at(time), int(rows[-1]))
    values, cov = found.point.coefficients + x[9 : 9 + p], found.run.cov[: 9 + p, : 9 + p]
    try:
        on = run(
            slave.increments, state, slave.sensors, Updates.none(np.array([end])), cov,
            slave.noise, first=int(rows[-1]), estimate=values,
            gravity_offset=slave.gravity_offset,
        )  # fmt: skip
    except FoucaultError:  # of passes that went astray: nothing goes on from there
        vector = CoefficientVector(slave.sensors.layout, values, cov[9:, 9:])
        return HandOver(state, vector, cov[:9, :9], int(rows[-1]))
    return HandOver(on.trajectory.state(-1), on.estimate, on.cov_at_place(), end)


def after_outage(
    free: FreeInertial, sensors: Sensors, seconds: float, *, turn: float = 0.0
) -> FloatArray:
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
    out = np.zeros((2, len(free.x0)))
    known = 9 + len(sensors)
    out[:, :known] = expm(A * seconds)[6:8]
    return out
