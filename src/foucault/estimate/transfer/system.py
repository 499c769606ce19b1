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
ended. What a delay does is taken from 0.1 s of motion on either side: design/README.md.

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
from math import ceil
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.estimate.ins_filter import Updates, run, seen_at_place
from foucault.estimate.linear_filter import LinearSystem
from foucault.estimate.transfer.anew import Anew
from foucault.estimate.transfer.measured import Known, Slave, between, by_the_master, measured
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp, log
from foucault.models.transfer import (
    FLEXURE,
    LIVELY,
    WANDER,
    Matching,
    Messages,
    Mount,
    bias_of,
    states_of_transfer,
)
from foucault.navigate.state import states_of

PIECE = 300.0
"""A free run is begun anew after so long: its errors are to stay small enough for equations that
are linear in them, and its vertical channel runs away [s]."""

LATELY = 10.0
"""Where it begins anew is a mean over so long [s]."""


@dataclass(frozen=True)
class Free:
    """A free run of the slave beside the master."""

    system: LinearSystem  # what the messages say about the errors
    layout: Layout  # meaning of the states
    time: FloatArray  # (m,) when the messages hold [s]
    rows: IntArray  # (m,) rows of the increments next to that [1]
    # (k,) which messages are used: those that hold after the start, one for each row
    used: npt.NDArray[np.bool_]
    velocity_n: FloatArray  # (m, 3) of the slave, as navigated [m/s]
    C_ns: FloatArray  # (m, 3, 3) attitude of the slave, as navigated [1]
    history: FloatArray  # (m, 12) states of `kernels.strapdown` at the rows [SI]


def free_run(
    slave: Slave, master: Messages, mount: Mount, matching: Matching, at: Known, prior: Known,
    sd: FloatArray,
) -> Free:  # fmt: skip
    """Navigate the slave freely, and say what the messages tell of its errors.

    `sd` (n,): how well, for every state: phi, velocity and position [rad], [m/s], [m], then the
    others [SI].
    """
    layout = states_of_transfer(slave.sensors, mount, matching, slave.noise)
    valid = master.time - at.delay
    rows, used = _rows(slave, valid, matching)
    some, when = master[used], valid[used]
    pieces = _pieces(slave, layout, some, mount, matching, at, rows, when)
    history, C_ns, velocity_n, transitions, jump, H, z = (
        each[0] if len(each) == 1 else np.concatenate(each) for each in zip(*pieces, strict=True)
    )
    R = np.full(z.shape, np.inf)
    R[:, : 3 if matching.vertical else 2] = matching.velocity_sd**2
    R[:, 3:] = matching.attitude_sd**2
    steps = np.diff(slave.increments.time[rows], prepend=slave.increments.time[slave.first])
    Phi, half = _carried(layout, transitions, steps, slave, mount)
    x0, P0 = _start(layout, at, prior, sd)
    system = LinearSystem(Phi, half, H, z, R, x0, P0, jump)
    return Free(system, layout, when, rows, used, velocity_n, C_ns, history)


class _Piece(NamedTuple):
    """What `Free` and `LinearSystem` have, of some of the messages."""

    history: FloatArray
    C_ns: FloatArray
    velocity_n: FloatArray
    transitions: FloatArray
    jump: FloatArray
    H: FloatArray
    z: FloatArray


def _pieces(
    slave: Slave, layout: Layout, some: Messages, mount: Mount, matching: Matching, at: Known,
    rows: IntArray, when: FloatArray,
) -> list[_Piece]:  # fmt: skip
    """Navigate piece by piece, each begun by what the master said at the end of the one before."""
    many = max(1, ceil((when[-1] - slave.increments.time[slave.first]) / PIECE))
    out: list[_Piece] = []
    first, anew = slave.first, Anew.of(at.state)
    parts = np.array_split(np.arange(len(rows)), many)
    for before, part in zip((None, *parts), parts, strict=False):
        if before is not None:
            first, anew = int(rows[before[-1]]), _set_back(out[-1], some[before], mount, at)
        found = run(
            slave.increments, anew.state, slave.sensors, Updates.none(rows[part]),
            np.zeros((9 + len(slave.sensors),) * 2), ImuNoise(), first=first,
            estimate=at.coefficients, gravity_offset=slave.gravity_offset, keep="transitions",
        )  # fmt: skip
        history = found.trajectory.history
        states = states_of(history)
        place = by_the_master(states, seen_at_place(history, states))
        seen = between(slave, states, rows[part], when[part], at.coefficients, matching)
        H, z = measured(layout, seen, some[part], mount, matching, at, place)
        Phi, jump = found.transitions, np.zeros((len(part), _moving(layout)))
        jump[0, :9] = Phi[0, :, :9] @ anew.jump
        Phi[0, :, :9] = Phi[0, :, :9] @ anew.turn
        out.append(_Piece(history, seen.C_ns, seen.velocity_n, Phi, jump, H, z))
    return out


def _set_back(piece: _Piece, some: Messages, mount: Mount, at: Known) -> Anew:
    """Return where the next piece begins, by what the last seconds of this one showed.

    Over some seconds, for a delay that is not known yet looks like an error of the attitude while
    the vehicle turns. The position follows from the velocities.
    """
    late = some.time >= some.time[-1] - LATELY
    C_nominal = some.C_nm[late] @ (mount.C_ms @ exp(at.installation))
    turned = log(piece.C_ns[late] @ np.swapaxes(C_nominal, 1, 2)).mean(axis=0)
    faster = piece.z[:, :3]
    away = np.diff(some.time, prepend=some.time[0]) @ faster
    return Anew.by(piece.history[-1], turned, faster[late].mean(axis=0), away)


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


def _carried(
    layout: Layout, transitions: FloatArray, steps: FloatArray, slave: Slave, mount: Mount
) -> tuple[FloatArray, FloatArray]:
    """Return the transitions of the states that change, and half of the noise between them."""
    m, _, known = transitions.shape
    n = len(layout)
    moving = _moving(layout)
    Phi = np.zeros((m, moving, n))
    Phi[:, np.arange(9, moving), np.arange(9, moving)] = 1.0
    Phi[:, :9, :known] = transitions
    q = np.zeros(n)
    q[0:3], q[3:6] = slave.noise.gyro.white**2, slave.noise.accel.white**2
    for name, triad in (("gyro.bias", slave.noise.gyro), ("accel.bias", slave.noise.accel)):
        some = [i for i, label in enumerate(layout.names) if label.startswith(name)]
        q[some] = triad.random_walk**2
    q[layout.group("installation")] = mount.wander**2
    half = 0.5 * steps[:, None] * q
    if mount.flexure_sd > 0:
        bending(Phi, half, layout, steps, mount)
    for i, name in enumerate(layout.names):
        if name in WANDER.names:
            triad = slave.noise.gyro if name.startswith("gyro") else slave.noise.accel
            past = steps / triad.correlation_time
            Phi[:, i, i] = np.exp(-past)
            # As a bias acts, but for what it fades meanwhile.
            mean = -np.expm1(-past) / past
            Phi[:, :9, i] = mean[:, None] * Phi[:, :9, layout.index(bias_of(name))]
            half[:, i] = triad.bias_instability**2 * np.tanh(past)  # so that it stays as large
    return Phi, half


def bending(
    Phi: FloatArray, half: FloatArray, layout: Layout, steps: FloatArray, mount: Mount
) -> None:
    """Write how a mount bends into the transitions and the noise between them.

    `Phi` (m, n, n): transitions [SI]; `half` (m, n): half of the noise between them [SI]; `steps`
    (m,): time from one message to the next [s].
    """
    b = LIVELY / mount.flexure_time
    angle, rate = layout.group("flexure"), layout.group("flexure_rate")
    fade = np.exp(-b * steps)
    Phi[:, angle, angle] = (fade * (1 + b * steps))[:, None]
    Phi[:, angle, rate] = (fade * steps)[:, None]
    Phi[:, rate, angle] = (-fade * b**2 * steps)[:, None]
    Phi[:, rate, rate] = (fade * (1 - b * steps))[:, None]
    half[:, rate] = (2.0 * b**3 * mount.flexure_sd**2 * steps)[:, None]


def _moving(layout: Layout) -> int:
    """Return how many of the first states change on the way."""
    changes = {*FLEXURE.names, *WANDER.names}
    return 9 if changes.isdisjoint(layout.names) else len(layout)


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
