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

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import ClassVar, NamedTuple

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.estimate.ins_filter import Updates, run, seen_at_place
from foucault.estimate.transfer.reset import Reset
from foucault.estimate.transfer.slave import Linearisation, Motion, Slave, between, by_the_master
from foucault.infer.filtered import Fit
from foucault.infer.linear_filter import LinearSystem
from foucault.models.attitude import angles_of
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
"""A free run is reset after so long: its errors are to stay small enough for equations that are
linear in them, and its vertical channel runs away [s]."""

LATELY = 10.0
"""Where it goes on is a mean over so long [s]."""

MOST = 0.5
"""A delay that leaves less of the messages inside the slave's log is none [1]."""


@dataclass(frozen=True, kw_only=True)
class FreeInertial(LinearSystem):
    """A free run of the slave beside the master: the system, and the run that it is about."""

    time: FloatArray  # (m,) when the messages hold [s]
    rows: IntArray  # (m,) rows of the increments next to that [1]
    # (k,) which messages are used: those that hold after the start, one for each row
    used: BoolArray
    history: FloatArray  # (m, 12) states of `kernels.strapdown` at the rows [SI]
    w_ib_b: FloatArray  # (m, 3) rate of the slave then, its bias taken out [rad/s]


TransferFit = Fit[Linearisation, FreeInertial]


@dataclass(frozen=True)
class TransferModel:
    """What is said of slave, master and mount: a model of `infer.filtered`."""

    slave: Slave
    master: Messages
    mount: Mount  # how they are fixed together
    matching: Matching  # what of the messages is used
    start: Linearisation  # what was known beforehand; the first pass is linear about it
    # (n,) how well, for every state: phi, velocity and position [rad], [m/s], [m], then the others
    # [SI]
    sd: FloatArray

    first: ClassVar[int] = 9
    kinds: ClassVar[Mapping[str, slice]] = {"velocity": slice(0, 3), "attitude": slice(3, 6)}

    @cached_property
    def layout(self) -> Layout:
        """Meaning of the states."""
        return states_of_transfer(self.slave.sensors, self.mount, self.matching, self.slave.noise)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.layout.names

    def estimate(self, found: TransferFit, prior: CoefficientVector) -> CoefficientVector:
        """Return what was found of `prior` at the last message, with covariance [SI].

        `found`: the model solved. A bending that comes and goes is not part of it.
        """
        every = CoefficientVector(Layout(self.layout.coefficients[9:]), found.values, found.cov)
        return replace(every.chosen(prior.names), prior_sd=prior.prior_sd)

    def values(self, point: Linearisation) -> FloatArray:
        """Return what a point adds to the states after the ninth, shape (n - 9,) [SI]."""
        out = np.zeros(len(self.layout))
        out[9 : 9 + len(point.coefficients)] = point.coefficients
        out[self.layout.group("installation")] = point.installation
        out[self._delay] = point.delay
        return out[9:]

    def retract(self, point: Linearisation, x: FloatArray) -> Linearisation | None:
        """Return the point that errors at the start lead to.

        `x` (n,): errors at the start [SI]. Returns None where nothing can be linear about it.
        """
        seen = seen_at_place(point.state.packed()[None])[0] @ x[:9]
        state = replace(point.state, C_nb=exp(seen[:3]) @ point.state.C_nb,
                        velocity_n=point.state.velocity_n - seen[3:6])  # fmt: skip
        out = Linearisation(
            state, point.coefficients + x[9 : 9 + len(point.coefficients)],
            point.installation + x[self.layout.group("installation")],
            point.delay + float(np.sum(x[self._delay])),
        )  # fmt: skip
        numbers = (out.coefficients, out.installation, state.velocity_n, state.C_nb, [out.delay])
        valid, time = self.master.time - out.delay, self.slave.increments.time
        inside = (valid > time[self.slave.first]) & (valid < time[-1])
        possible = all(np.isfinite(x).all() for x in numbers) and np.mean(inside) > MOST
        return out if possible else None

    @property
    def _delay(self) -> list[int]:
        """Where the delay is among the states, if it is one."""
        return [i for i, name in enumerate(self.names) if name == "master.delay"]

    def about(self, point: Linearisation) -> FreeInertial:
        """Navigate the slave freely from a point, and say what the messages tell of its errors."""
        rows, used = self._rows(point.delay)
        master, when = self.master[used], (self.master.time - point.delay)[used]
        pieces = zip(*self._pieces(point, master, rows, when), strict=True)
        history, _, w_ib_b, transitions, jump, H, z = (
            each[0] if len(each) == 1 else np.concatenate(each) for each in pieces
        )
        R = np.full(z.shape, np.inf)
        R[:, : 3 if self.matching.vertical else 2] = self.matching.velocity_sd**2
        R[:, 3:] = self.matching.attitude_sd**2
        Phi, half = self._carried(transitions, self.steps(rows))
        x0, P0 = self._start(point)
        return FreeInertial(Phi, half, H, z, R, x0, P0, jump, time=when, rows=rows, used=used,
                            history=history, w_ib_b=w_ib_b)  # fmt: skip

    def steps(self, rows: IntArray) -> FloatArray:
        """Return the times from one of `rows` (m,) to the next, the first from the start [s]."""
        time = self.slave.increments.time
        return np.diff(time[rows], prepend=time[self.slave.first])

    def _rows(self, delay: float) -> tuple[IntArray, BoolArray]:
        """Return the rows next to when messages hold, each once, and which messages those are."""
        slave, time, valid = self.slave, self.slave.increments.time, self.master.time - delay
        after = np.searchsorted(time, valid)
        at = np.clip(after, 1, len(time) - 1)
        nearer = valid - time[at - 1] < time[at] - valid
        rows = at - (nearer | (self.matching.shift == "sample"))
        usual = float(np.median(slave.increments.dt))
        used = (rows > slave.first) & (valid < time[-1] + usual)
        used[used] = np.diff(rows[used], prepend=slave.first) > 0
        return rows[used].astype(np.int64), used

    def _pieces(
        self, point: Linearisation, master: Messages, rows: IntArray, when: FloatArray
    ) -> list[_Piece]:
        """Navigate piece by piece, each begun by what the master said at the end of the last."""
        slave, first, begun = self.slave, self.slave.first, Reset.of(point.state)
        many = max(1, ceil((when[-1] - slave.increments.time[first]) / PIECE))
        parts, out = np.array_split(np.arange(len(rows)), many), list[_Piece]()
        for before, part in zip((parts[0], *parts), parts, strict=False):
            if out:
                first, begun = int(rows[before[-1]]), self._reset(out[-1], master[before], point)
            found = run(
                slave.increments, begun.state, slave.sensors, Updates.none(rows[part]),
                np.zeros((9 + len(slave.sensors),) * 2), ImuNoise(), first=first,
                estimate=point.coefficients, gravity_offset=slave.gravity_offset,
                keep="transitions",
            )  # fmt: skip
            history = found.trajectory.history
            states = states_of(history)
            motion = between(slave, states, rows[part], when[part], point.coefficients,
                             self.matching)  # fmt: skip
            place = by_the_master(states, seen_at_place(history, states))
            H, z = self._measured(motion, master[part], point, place)
            Phi, jump = found.transitions, np.zeros((len(part), self._moving))
            jump[0, :9] = Phi[0, :, :9] @ begun.jump
            Phi[0, :, :9] = Phi[0, :, :9] @ begun.turn
            out.append(_Piece(history, motion.C_ns, motion.w_ib_b, Phi, jump, H, z))
        return out

    def _reset(self, piece: _Piece, master: Messages, point: Linearisation) -> Reset:
        """Return where the next piece begins, by what the last seconds of this one showed.

        Over some seconds, for a delay that is not known yet looks like an error of the attitude
        while the vehicle turns. The position follows from the velocities.
        """
        late = master.time >= master.time[-1] - LATELY
        C_nominal = master.C_nm[late] @ (self.mount.C_ms @ exp(point.installation))
        turned = log(piece.C_ns[late] @ np.swapaxes(C_nominal, 1, 2)).mean(axis=0)
        faster = piece.z[:, :3]
        away = np.diff(master.time, prepend=master.time[0]) @ faster
        return Reset.by(piece.history[-1], turned, faster[late].mean(axis=0), away)

    def _measured(
        self, motion: Motion, master: Messages, point: Linearisation, place: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return H (m, 6, n) and z (m, 6): velocity, then attitude."""
        mount, layout = self.mount, self.layout
        H, z = np.zeros((len(master), 6, len(layout))), np.empty((len(master), 6))
        C_ms = mount.C_ms @ exp(point.installation)
        w_m = np.einsum("ij,kj->ki", C_ms, motion.w_ib_b)
        lever_n = np.einsum("kij,kj->ki", master.C_nm, np.cross(w_m, mount.lever_m))
        z[:, :3] = motion.velocity_n - master.velocity_n - lever_n
        H[:, :3, :9] = place[:, 3:6]
        C_nominal = master.C_nm @ C_ms
        H[:, 3:, :9] = -place[:, 0:3]
        mu = layout.group("installation")
        H[:, 3:, mu] = C_nominal
        z[:, 3:] = log(motion.C_ns @ np.swapaxes(C_nominal, 1, 2))
        if self.matching.delay:
            tau = layout.index("master.delay")
            H[:, :3, tau], H[:, 3:, tau] = motion.acceleration_n, motion.rate_n
        if mount.load:  # by the force along the master's z
            load = motion.f_b @ C_ms[2] / 9.80665 - 1.0
            H[:, 3:, layout.group("load")] = C_nominal * load[:, None, None]
        if mount.flexure_sd > 0:
            H[:, 3:, layout.group("flexure")] = C_nominal
        if self.matching.attitude == "angles":
            J, difference = _as_angles(motion.C_ns, C_nominal)
            H[:, 3:] = J @ H[:, 3:]
            z[:, 3:] = difference
        return H, z

    @property
    def _moving(self) -> int:
        """How many of the first states change on the way."""
        changes = {*FLEXURE.names, *WANDER.names}
        return 9 if changes.isdisjoint(self.names) else len(self.names)

    def _carried(self, transitions: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the transitions of the states that change, and half of the noise between them."""
        m, _, known = transitions.shape
        layout, noise, moving = self.layout, self.slave.noise, self._moving
        Phi = np.zeros((m, moving, len(layout)))
        Phi[:, np.arange(9, moving), np.arange(9, moving)] = 1.0
        Phi[:, :9, :known] = transitions
        q = np.zeros(len(layout))
        q[0:3], q[3:6] = noise.gyro.white**2, noise.accel.white**2
        for name, triad in (("gyro.bias", noise.gyro), ("accel.bias", noise.accel)):
            q[[i for i, n in enumerate(layout.names) if n.startswith(name)]] = triad.random_walk**2
        q[layout.group("installation")] = self.mount.wander**2
        half = 0.5 * steps[:, None] * q
        if self.mount.flexure_sd > 0:
            bending(Phi, half, layout, steps, self.mount)
        for i, name in enumerate(layout.names):
            if name in WANDER.names:
                triad = noise.gyro if name.startswith("gyro") else noise.accel
                past = steps / triad.correlation_time
                Phi[:, i, i] = np.exp(-past)
                # As a bias acts, but for what it fades meanwhile.
                mean = -np.expm1(-past) / past
                Phi[:, :9, i] = mean[:, None] * Phi[:, :9, layout.index(bias_of(name))]
                # So that it stays as large.
                half[:, i] = triad.bias_instability**2 * np.tanh(past)
        return Phi, half

    def _start(self, point: Linearisation) -> tuple[FloatArray, FloatArray]:
        """Return the expected errors of a point, and their covariance."""
        P0 = np.diag(np.asarray(self.sd, float) ** 2)
        back = np.linalg.inv(seen_at_place(point.state.packed()[None])[0])
        P0[:9, :9] = back @ P0[:9, :9] @ back.T
        prior, at = self.start.state, point.state
        phi = log(prior.C_nb @ at.C_nb.T)  # C_at = (I - phi x) C_prior
        seen = np.concatenate([phi, at.velocity_n - prior.velocity_n, np.zeros(3)])
        return np.concatenate([back @ seen, self.values(self.start) - self.values(point)]), P0

    def loose(self, seconds: float) -> TransferModel:
        """Return the model if the start is known so much too early or too late.

        `seconds`: standard deviation of the delay [s].
        """
        first, x = self.slave.first, self.slave.increments
        C_ns = self.start.state.C_nb
        f_n = C_ns @ x.dvel_b[first] / x.dt[first] - [0.0, 0.0, 9.80665]
        rates = np.concatenate([C_ns @ x.dtheta_b[first] / x.dt[first], f_n])
        sd = self.sd.copy()
        sd[:6] = np.hypot(sd[:6], seconds * rates)
        return replace(self, sd=sd)

    def heavier(self, by: float) -> TransferModel:
        """Return the model where gravity is larger `by` so much [m/s^2]."""
        offset = self.slave.gravity_offset + by
        return replace(self, slave=replace(self.slave, gravity_offset=offset))

    def without_delay(self) -> TransferModel:
        """Return the model with the delay of its start, which is no state."""
        return replace(self, matching=replace(self.matching, delay=False),
                       sd=np.delete(self.sd, self._delay))  # fmt: skip


class _Piece(NamedTuple):
    """What `FreeInertial` has, of some of the messages."""

    history: FloatArray
    C_ns: FloatArray
    w_ib_b: FloatArray
    transitions: FloatArray
    jump: FloatArray
    H: FloatArray
    z: FloatArray


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
