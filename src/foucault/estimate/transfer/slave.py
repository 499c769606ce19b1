"""A slave, and where its free run is when the messages of its master hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.models.earth import EARTH_RATE, SEMI_MAJOR_AXIS
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.transfer import Matching
from foucault.navigate.increments import Increments
from foucault.navigate.state import State
from foucault.tables import AXES

SPAN = 0.1
"""What a delay does is judged by the motion so long before and after: noise and vibration of one
sample, which the master does not share, would look like knowledge of it [s]."""


@dataclass(frozen=True)
class Slave:
    """The slave's log and what is known of it."""

    increments: Increments
    sensors: Sensors
    noise: ImuNoise  # its noise [SI]
    first: int = 0  # row at whose end the run starts [1]
    gravity_offset: float = 0.0  # measured local minus normal gravity [m/s^2]


@dataclass(frozen=True)
class Linearisation:
    """The point that a pass is linear about, or what is known beforehand."""

    state: State  # of the slave at the start
    coefficients: FloatArray  # (p,) errors of its sensors [SI]
    installation: FloatArray  # (3,) mu [rad]
    delay: float  # tau [s]


def by_the_master(states: dict[str, FloatArray], place: FloatArray) -> FloatArray:
    """Return `place`, (phi, velocity, position), for axes of the true place.

    East and north of the computed place are turned about up by dr_E tan L / R: in a free run that
    is hundreds of metres off the master's would be seen as a heading error.

    `states`: of the run, see `navigate.state.states_of` [SI]; `place` (m, 9, 9): see
    `estimate.ins_filter.seen_at_place` [SI].
    """
    turn = np.tan(states["latitude"]) / (SEMI_MAJOR_AXIS + states["height"])
    turned = turn[:, None] * place[:, 6]  # of the computed axes against the true ones, about up
    out = place.copy()
    v = states["velocity_n"]
    out[:, 2] += turned
    out[:, 3] += v[:, 1:2] * turned
    out[:, 4] -= v[:, 0:1] * turned
    return out


@dataclass(frozen=True)
class Motion:
    """The slave where the messages hold."""

    velocity_n: FloatArray  # (m, 3) velocity [m/s]
    C_ns: FloatArray  # (m, 3, 3) attitude [1]
    # rate_n, acceleration_n: (m, 3) how attitude and velocity change about then [rad/s], [m/s^2]
    rate_n: FloatArray
    acceleration_n: FloatArray
    # w_ib_b, f_b: (m, 3) rate and specific force of the interval, slave's axes [rad/s], [m/s^2]
    w_ib_b: FloatArray
    f_b: FloatArray


def between(
    slave: Slave, states: dict[str, FloatArray], rows: IntArray, when: FloatArray,
    coefficients: FloatArray, matching: Matching,
) -> Motion:  # fmt: skip
    """Look at the slave between its samples: it goes on as over the interval that holds `when`.

    `states`: of its run at `rows`, see `navigate.state.states_of` [SI]; `rows` (m,): rows of the
    increments next to `when` [1]; `when` (m,): when the messages hold [s]; `coefficients` (p,):
    errors of its sensors [SI]; `matching`: whether it is looked at between samples at all.
    """
    inc = slave.increments
    ahead = when - inc.time[rows] if matching.shift == "interpolated" else np.zeros(len(rows))
    inside = np.minimum(rows + (ahead > 0), len(inc) - 1)
    names = slave.sensors.layout.names
    w, f = (x[inside] / inc.dt[inside, None] for x in (inc.dtheta_b, inc.dvel_b))
    for k, a in enumerate(AXES):  # scale factors hardly count over part of an interval
        if f"gyro.bias.{a}" in names:
            w[:, k] -= coefficients[names.index(f"gyro.bias.{a}")]
        if f"accel.bias.{a}" in names:
            f[:, k] -= coefficients[names.index(f"accel.bias.{a}")]
    rate, pull = _changes(states, w, f)
    C, v = states["C_nb"], states["velocity_n"]
    first = np.searchsorted(inc.time, inc.time[rows] - SPAN) + 1
    last = np.minimum(np.searchsorted(inc.time, inc.time[rows] + SPAN) + 1, len(inc) - 1)
    ends = np.column_stack([np.minimum(first, last - 1), last]).ravel()
    total, angle, velocity = (
        np.add.reduceat(x, ends)[::2] for x in (inc.dt[:, None], inc.dtheta_b, inc.dvel_b)
    )
    slow = _changes(states, angle / total, velocity / total)
    return Motion(v + pull * ahead[:, None], exp(rate * ahead[:, None]) @ C, *slow, w, f)


def _changes(
    states: dict[str, FloatArray], w: FloatArray, f: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how attitude and velocity change, frame n [rad/s], [m/s^2]."""
    C, v, latitude = states["C_nb"], states["velocity_n"], states["latitude"]
    earth = EARTH_RATE * np.stack(
        [np.zeros_like(latitude), np.cos(latitude), np.sin(latitude)], axis=-1
    )
    rate = np.einsum("kij,kj->ki", C, w) - earth
    pull = np.einsum("kij,kj->ki", C, f) - 2.0 * np.cross(earth, v)
    pull[:, 2] -= 9.80665  # a few milligal are nothing over part of an interval
    return rate, pull
