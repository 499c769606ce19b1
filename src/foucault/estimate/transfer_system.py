"""Transfer alignment: what a slave INS's free run and its master's say about the slave's errors.

The slave is navigated freely from one copy of the master's state. What it then says at each of the
master's messages, less what the master says, is linear in the slave's errors (those of
`models.ins_errors`), in the installation mu and in the delay of the messages::

    velocity   C_l dv ...  at the place of the message         + (tau - tau_0) v'
    attitude   log(C_ns (C_nm C_0)') = -phi + C_nm C_0 (mu + k (f_z/g - 1) + th) + (tau - tau_0) w

with C_ns = C_nm C_ms, C_ms = C_0 (I + [mu x]); k the compliance of the mount under load, th its
flexure, a second-order Markov process. A message that arrives at t holds at t - tau: the slave is
looked at there, between its samples. The delay tau_0 that is assumed, the installation, the start
and the coefficients are the point of linearisation; further passes move it to where the one before
ended.

References
----------
.. [1] J. Lyou, Y.-C. Lim, "Transfer alignment error compensator design using H-infinity filter",
   *Proc. American Control Conference*, 2002.
.. [2] Y.-C. Lim, J. Lyou, "Transfer alignment error compensator design for nonlinear measurement
   equations with a time delay", *J. Mechanical Science and Technology* 23 (2009).
.. [3] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 15.1 (transfer alignment).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.coefficients import Layout
from foucault.estimate.ins_filter import Updates, run, seen_at_place
from foucault.estimate.linear_filter import LinearSystem
from foucault.models.attitude import angles_of
from foucault.models.earth import EARTH_RATE, SEMI_MAJOR_AXIS
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp, log
from foucault.models.transfer import LIVELY, Matching, Messages, Mount, states_of_transfer
from foucault.navigate.increments import Increments
from foucault.navigate.state import State, states_of
from foucault.tables import AXES

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


SPAN = 0.1
"""What a delay does is judged by the motion so long before and after: noise and vibration of one
sample, which the master does not share, would look like knowledge of it [s]."""


@dataclass(frozen=True)
class Slave:
    """The slave's log and what is known of it.

    Attributes
    ----------
    increments : Increments
        As measured.
    sensors : Sensors
        Coefficients to estimate.
    noise : ImuNoise
        Its noise [SI].
    first : int
        Row at whose end the run starts [1].
    gravity_offset : float
        Measured local minus normal gravity [m/s^2].
    """

    increments: Increments
    sensors: Sensors
    noise: ImuNoise
    first: int = 0
    gravity_offset: float = 0.0


@dataclass(frozen=True)
class Known:
    """The point that a pass is linear about, or what is known beforehand.

    Attributes
    ----------
    state : State
        Of the slave at the start.
    coefficients : ndarray, shape (p,)
        Errors of its sensors [SI].
    installation : ndarray, shape (3,)
        mu [rad].
    delay : float
        tau [s].
    """

    state: State
    coefficients: FloatArray
    installation: FloatArray
    delay: float


@dataclass(frozen=True)
class Free:
    """A free run of the slave beside the master.

    Attributes
    ----------
    system : LinearSystem
        What the messages say about the errors.
    layout : Layout
        Meaning of the states.
    time : ndarray, shape (m,)
        When the messages hold [s].
    rows : ndarray of int, shape (m,)
        Rows of the increments next to that [1].
    used : ndarray of bool, shape (k,)
        Which messages are used: those that hold after the start, one for each row.
    velocity_n : ndarray, shape (m, 3)
        Of the slave, as navigated [m/s].
    C_ns : ndarray, shape (m, 3, 3)
        Attitude of the slave, as navigated [1].
    history : ndarray, shape (m, 12)
        States of `kernels.strapdown` at the rows [SI].
    """

    system: LinearSystem
    layout: Layout
    time: FloatArray
    rows: IntArray
    used: npt.NDArray[np.bool_]
    velocity_n: FloatArray
    C_ns: FloatArray
    history: FloatArray


def free_run(
    slave: Slave, master: Messages, mount: Mount, matching: Matching, at: Known, prior: Known,
    sd: FloatArray,
) -> Free:  # fmt: skip
    """Navigate the slave freely, and say what the messages tell of its errors.

    Parameters
    ----------
    slave : Slave
        Its log.
    master : Messages
        What the master says.
    mount : Mount
        How they are fixed together.
    matching : Matching
        What of the messages is used.
    at : Known
        The point to be linear about.
    prior : Known
        What was known beforehand.
    sd : ndarray, shape (n,)
        How well, for every state: phi, velocity and position [rad], [m/s], [m], then the others
        [SI].
    """
    layout = states_of_transfer(slave.sensors, mount, matching)
    valid = master.time - at.delay
    rows, used = _rows(slave, valid, matching)
    some, when = master[used], valid[used]
    found = run(
        slave.increments, at.state, slave.sensors, Updates.none(rows),
        np.zeros((9 + len(slave.sensors),) * 2), ImuNoise(), first=slave.first,
        estimate=at.coefficients, gravity_offset=slave.gravity_offset, keep="transitions",
    )  # fmt: skip
    history = found.trajectory.history
    states = states_of(history)
    place = _by_the_master(states, seen_at_place(history, states))
    seen = _between(slave, states, rows, when, at.coefficients, matching)
    H, z = _measured(layout, seen, some, mount, matching, at, place)
    R = np.full(z.shape, np.inf)
    R[:, : 3 if matching.vertical else 2] = matching.velocity_sd**2
    R[:, 3:] = matching.attitude_sd**2
    steps = np.diff(slave.increments.time[rows], prepend=slave.increments.time[slave.first])
    Phi, half = _carried(layout, found.transitions, steps, slave, mount)
    x0, P0 = _start(layout, at, prior, sd)
    system = LinearSystem(Phi, half, H, z, R, x0, P0)
    return Free(system, layout, when, rows, used, seen.velocity_n, seen.C_ns, history)


def _rows(
    slave: Slave, valid: FloatArray, matching: Matching
) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Return the rows next to when the messages hold, each once, and which messages those are."""
    time = slave.increments.time
    after = np.searchsorted(time, valid)
    at = np.clip(after, 1, len(time) - 1)
    nearer = valid - time[at - 1] < time[at] - valid
    rows = at - (nearer | (matching.shift == "sample"))
    usual = float(np.median(slave.increments.dt))
    used = (rows > slave.first) & (valid < time[-1] + usual)
    used[used] = np.diff(rows[used], prepend=slave.first) > 0
    return rows[used].astype(np.int64), used


def _by_the_master(states: dict[str, FloatArray], place: FloatArray) -> FloatArray:
    """Return `place`, (phi, velocity, position), for axes of the true place.

    East and north of the computed place are turned about up by dr_E tan L / R: in a free run that
    is hundreds of metres off the master's would be seen as a heading error.
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
class _Seen:
    """The slave where the messages hold: n frame, its changes about then, and what it felt."""

    velocity_n: FloatArray
    C_ns: FloatArray
    rate_n: FloatArray
    acceleration_n: FloatArray
    w_ib_b: FloatArray
    f_b: FloatArray


def _between(
    slave: Slave, states: dict[str, FloatArray], rows: IntArray, when: FloatArray,
    coefficients: FloatArray, matching: Matching,
) -> _Seen:  # fmt: skip
    """Look at the slave between its samples: it goes on as over the interval that holds `when`."""
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
    return _Seen(v + pull * ahead[:, None], exp(rate * ahead[:, None]) @ C, *slow, w, f)


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


def _measured(
    layout: Layout, seen: _Seen, master: Messages, mount: Mount, matching: Matching, at: Known,
    place: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return H (m, 6, n) and z (m, 6): velocity, then attitude."""
    m, n = len(master), len(layout)
    H, z = np.zeros((m, 6, n)), np.empty((m, 6))
    C_ms = mount.C_ms @ exp(at.installation)
    w_m = np.einsum("ij,kj->ki", C_ms, seen.w_ib_b)
    lever_n = np.einsum("kij,kj->ki", master.C_nm, np.cross(w_m, mount.lever_m))
    z[:, :3] = seen.velocity_n - master.velocity_n - lever_n
    H[:, :3, :9] = place[:, 3:6]
    C_nominal = master.C_nm @ C_ms
    H[:, 3:, :9] = -place[:, 0:3]
    mu = layout.group("installation")
    H[:, 3:, mu] = C_nominal
    z[:, 3:] = log(seen.C_ns @ np.swapaxes(C_nominal, 1, 2))
    if matching.delay:
        tau = layout.index("master.delay")
        H[:, :3, tau], H[:, 3:, tau] = seen.acceleration_n, seen.rate_n
    if mount.load:  # by the force along the master's z
        load = seen.f_b @ C_ms[2] / 9.80665 - 1.0
        H[:, 3:, layout.group("load")] = C_nominal * load[:, None, None]
    if mount.flexure_sd > 0:
        H[:, 3:, layout.group("flexure")] = C_nominal
    if matching.attitude == "angles":
        J, difference = _as_angles(seen.C_ns, C_nominal)
        H[:, 3:] = J @ H[:, 3:]
        z[:, 3:] = difference
    return H, z


def _as_angles(C_ns: FloatArray, C_nominal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how heading, pitch and roll go with a rotation about n, and their differences."""
    heading, pitch, _ = angles_of(C_ns).T
    sH, cH, cP, tP = np.sin(heading), np.cos(heading), np.cos(pitch), np.tan(pitch)
    J = np.zeros((len(C_ns), 3, 3))
    J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = tP * sH, tP * cH, -1.0
    J[:, 1, 0], J[:, 1, 1] = cH, -sH
    J[:, 2, 0], J[:, 2, 1] = sH / cP, cH / cP
    difference = angles_of(C_ns) - angles_of(C_nominal)
    return J, np.remainder(difference + np.pi, 2 * np.pi) - np.pi


def _carried(
    layout: Layout, transitions: FloatArray, steps: FloatArray, slave: Slave, mount: Mount
) -> tuple[FloatArray, FloatArray]:
    """Return the transitions of the states that change, and half of the noise between them."""
    m, _, known = transitions.shape
    n = len(layout)
    moving = n if mount.flexure_sd > 0 else 9
    Phi = np.zeros((m, moving, n))
    Phi[:, np.arange(9, moving), np.arange(9, moving)] = 1.0
    Phi[:, :9, :known] = transitions
    q = np.zeros(n)
    q[0:3], q[3:6] = slave.noise.gyro.white**2, slave.noise.accel.white**2
    for name, triad in (("gyro.bias", slave.noise.gyro), ("accel.bias", slave.noise.accel)):
        some = [i for i, label in enumerate(layout.names) if label.startswith(name)]
        q[some] = triad.random_walk**2
    q[layout.group("installation")] = mount.wander**2
    if mount.flexure_sd > 0:
        b = LIVELY / mount.flexure_time
        angle, rate = layout.group("flexure"), layout.group("flexure_rate")
        fade = np.exp(-b * steps)
        Phi[:, angle, angle] = (fade * (1 + b * steps))[:, None]
        Phi[:, angle, rate] = (fade * steps)[:, None]
        Phi[:, rate, angle] = (-fade * b**2 * steps)[:, None]
        Phi[:, rate, rate] = (fade * (1 - b * steps))[:, None]
        q[rate] = 4.0 * b**3 * mount.flexure_sd**2
    return Phi, 0.5 * steps[:, None] * q


def _start(
    layout: Layout, at: Known, prior: Known, sd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the expected errors of the point `at`, and their covariance."""
    p = len(at.coefficients)
    P0 = np.diag(np.asarray(sd, float) ** 2)
    back = np.linalg.inv(seen_at_place(at.state.packed()[None])[0])
    P0[:9, :9] = back @ P0[:9, :9] @ back.T
    x0 = np.zeros(len(layout))
    phi = log(prior.state.C_nb @ at.state.C_nb.T)  # C_at = (I - phi x) C_prior
    seen = np.concatenate([phi, at.state.velocity_n - prior.state.velocity_n, np.zeros(3)])
    x0[:9] = back @ seen
    x0[9 : 9 + p] = prior.coefficients - at.coefficients
    x0[layout.group("installation")] = prior.installation - at.installation
    if "master.delay" in layout.names:
        x0[layout.index("master.delay")] = prior.delay - at.delay
    return x0, P0
