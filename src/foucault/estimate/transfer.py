"""Transfer alignment: a slave INS's errors from its free run and what its master says.

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

A free run that has gone astray is reset. Errors of attitude, velocity and position are vectors in
space: seen from the Earth, those of the new run are those of the old one and a difference that is
known without noise. Only the axes of the level frame, which belong to the computed place, are
others::

    psi_new = C_l'l psi_old - log(C_eb_new C_eb_old')     and likewise of v and r

The delay of the messages, and how far and how slowly a mount bends, are those that make the
innovations likeliest: a bending that comes and goes makes innovations that depend on those before
them, what is left, which is faster than the messages, is the noise of the attitudes. Afterwards
the slave goes on alone, and its errors make the position wrong (`after_outage`).

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
from foucault.errors import FoucaultError
from foucault.infer.filtered import Fit
from foucault.infer.linear_filter import LinearRun, LinearSystem, kalman
from foucault.kernels.ins_filter import corrected
from foucault.models.earth import (
    EARTH_RATE,
    SEMI_MAJOR_AXIS,
    displaced,
    east_north_up,
    ecef,
    transport_rate,
)
from foucault.models.ins_errors import Sensors, dynamics
from foucault.models.noise import ImuNoise
from foucault.models.rotation import angles_of, cross, cross_matrix, exp, log
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
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import free_run, seen_at_place, white_noise
from foucault.navigate.strapdown import State, state_of, states_of
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

    `states`: of the run, see `navigate.strapdown.states_of` [SI]; `place` (m, 9, 9): see
    `navigate.ins_filter.seen_at_place` [SI].
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
    # (m, 3) each: how attitude and velocity change about then [rad/s], [m/s^2]; where asked for
    slow: tuple[FloatArray, FloatArray] | None
    # w_ib_b, f_b: (m, 3) rate and specific force of the interval, slave's axes [rad/s], [m/s^2]
    w_ib_b: FloatArray
    f_b: FloatArray


def between(
    slave: Slave, states: dict[str, FloatArray], rows: IntArray, when: FloatArray,
    coefficients: FloatArray, matching: Matching, *, changing: bool = True,
) -> Motion:  # fmt: skip
    """Look at the slave between its samples: it goes on as over the interval that holds `when`.

    `states`: of its run at `rows`, see `navigate.strapdown.states_of` [SI]; `rows` (m,): rows of
    the increments next to `when` [1]; `when` (m,): when the messages hold [s]; `coefficients` (p,):
    errors of its sensors [SI]; `matching`: whether it is looked at between samples at all;
    `changing`: whether it is asked how it changes.
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
    slow = _changes(states, *_about(inc, rows)) if changing else None
    return Motion(v + pull * ahead[:, None], exp(rate * ahead[:, None]) @ C, slow, w, f)


def _about(inc: Increments, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean rate and specific force of the slave about `rows` [rad/s], [m/s^2]."""
    first = np.searchsorted(inc.time, inc.time[rows] - SPAN) + 1
    last = np.minimum(np.searchsorted(inc.time, inc.time[rows] + SPAN) + 1, len(inc) - 1)
    ends = np.column_stack([np.minimum(first, last - 1), last]).ravel()
    total, angle, velocity = (
        np.add.reduceat(x, ends)[::2] for x in (inc.dt[:, None], inc.dtheta_b, inc.dvel_b)
    )
    return angle / total, velocity / total


def _changes(
    states: dict[str, FloatArray], w: FloatArray, f: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how attitude and velocity change, frame n [rad/s], [m/s^2]."""
    C, v, latitude = states["C_nb"], states["velocity_n"], states["latitude"]
    earth = EARTH_RATE * np.stack(
        [np.zeros_like(latitude), np.cos(latitude), np.sin(latitude)], axis=-1
    )
    rate = np.einsum("kij,kj->ki", C, w) - earth
    pull = np.einsum("kij,kj->ki", C, f) - 2.0 * cross(earth, v)
    pull[:, 2] -= 9.80665  # a few milligal are nothing over part of an interval
    return rate, pull


@dataclass(frozen=True)
class Reset:
    """Where a run goes on, and what that makes of its errors."""

    state: State  # where, how fast and how turned
    # (9, 9) axes of the new level frame from those of the old one, for (psi, dv, dr) [1]
    turn: FloatArray
    jump: FloatArray  # (9,) what is added to the errors, in the new level frame [SI]

    @classmethod
    def of(cls, state: State) -> Reset:
        """Return the beginning of a run."""
        return cls(state, np.eye(9), np.zeros(9))

    @classmethod
    def by(cls, row: FloatArray, turned: FloatArray, faster: FloatArray, away: FloatArray) -> Reset:
        """Return the reset that takes out what a run is thought to be wrong by.

        `row` (12,): state of `kernels.strapdown` at the end of the run [SI]; `turned` (3,):
        rotation vector from the true to the computed attitude, frame n [rad]; `faster` (3,):
        computed less true velocity, frame n [m/s]; `away` (3,): computed less true position,
        frame n [m].
        """
        old = state_of(row)
        latitude, longitude, height = displaced(old.latitude, old.longitude, old.height, -away)
        new = State(float(latitude), float(longitude), float(height), old.velocity_n - faster,
                    exp(-turned) @ old.C_nb)  # fmt: skip
        before, after = _in_space(row), _in_space(new.packed())
        psi = -log(after[0] @ before[0].T)
        C_le = after[3].T
        turn = np.asarray(np.kron(np.eye(3), C_le @ before[3]), np.float64)
        jump = np.concatenate([C_le @ d for d in (psi, after[1] - before[1], after[2] - before[2])])
        return cls(new, turn, jump)


def _in_space(row: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return C_eb, velocity and position in frame e, and C_el of a state."""
    x = states_of(row)
    C_en = east_north_up(float(x["latitude"]), float(x["longitude"]))
    place = ecef(float(x["latitude"]), float(x["longitude"]), float(x["height"]))
    return C_en @ x["C_nb"], C_en @ x["velocity_n"], place, C_en @ x["C_nl"]


PIECE = 300.0
"""A free run is reset after so long: its errors are to stay small enough for equations that are
linear in them, and its vertical channel runs away [s]."""

LATELY = 10.0  # Where it goes on is a mean over so long [s].
MOST = 0.5  # A delay that leaves less of the messages inside the slave's log is none [1].


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
    counted: tuple[str, ...] = ()  # names of `models.transfer.COUNTED` that are states too
    # states that changed at once, when between [s], and by what sd [SI]
    shocks: tuple[tuple[tuple[int, ...], float, float, float], ...] = ()

    first: ClassVar[int] = 9
    kinds: ClassVar[Mapping[str, slice]] = {"velocity": slice(0, 3), "attitude": slice(3, 6)}

    @cached_property
    def layout(self) -> Layout:
        """Meaning of the states."""
        return states_of_transfer(self.slave.sensors, self.mount, self.matching, self.slave.noise,
                                  self.counted)  # fmt: skip

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
        return self._at("master.delay")

    def _at(self, name: str) -> list[int]:
        """Return where the state `name` is, if it is one."""
        return [i for i, other in enumerate(self.names) if other == name]

    def about(self, point: Linearisation) -> FreeInertial:
        """Navigate the slave freely from a point, and say what the messages tell of its errors."""
        rows, used = self._rows(point.delay)
        master, when = self.master[used], (self.master.time - point.delay)[used]
        Phi = np.empty((len(rows), self._moving, len(self.layout)))
        pieces = zip(*self._pieces(point, master, rows, when, Phi), strict=True)
        history, _, w_ib_b, jump, H, z = (
            each[0] if len(each) == 1 else np.concatenate(each) for each in pieces
        )
        R = np.full(z.shape, np.inf)
        R[:, : 3 if self.matching.vertical else 2] = self.matching.velocity_sd**2
        R[:, 3:] = self.matching.attitude_sd**2
        half = self._carried(Phi, self.steps(rows))
        for states, begin, end, sd in self.shocks:
            inside = np.flatnonzero((when >= begin) & (when < end))
            half[np.ix_(inside, np.array(states))] += sd**2
        if self.counted:
            self._drive(Phi, rows, states_of(history))
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
        self, point: Linearisation, master: Messages, rows: IntArray, when: FloatArray,
        transitions: FloatArray,
    ) -> list[_Piece]:  # fmt: skip
        """Navigate piece by piece, each begun by what the master said at the end of the last.

        Fills of `transitions` (m, b, n) what navigates [SI].
        """
        slave, first, begun = self.slave, self.slave.first, Reset.of(point.state)
        many = max(1, ceil((when[-1] - slave.increments.time[first]) / PIECE))
        edges = [slice(p[0], p[-1] + 1) for p in np.array_split(np.arange(len(rows)), many)]
        out, timed = list[_Piece](), {"master.delay", "messages.rate"}.intersection(self.names)
        for before, part in zip((edges[0], *edges), edges, strict=False):
            if out:
                first = int(rows[part.start - 1])
                begun = self._reset(out[-1], master[before], point)
            Phi = transitions[part]
            history = free_run(
                slave.increments, begun.state, slave.sensors, rows[part], Phi, first=first,
                estimate=point.coefficients, gravity_offset=slave.gravity_offset,
            ).history  # fmt: skip
            states = states_of(history)
            motion = between(slave, states, rows[part], when[part], point.coefficients,
                             self.matching, changing=bool(timed))  # fmt: skip
            place = by_the_master(states, seen_at_place(history, states))
            H, z = self._measured(motion, master[part], point, place)
            jump, onto = np.zeros(Phi.shape[:2]), Phi[0, :9, :9]
            jump[0, :9] = onto @ begun.jump
            onto[:] = onto @ begun.turn
            out.append(_Piece(history, motion.C_ns, motion.w_ib_b, jump, H, z))
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
        lever_n = np.einsum("kij,kj->ki", master.C_nm, cross(w_m, mount.lever_m))
        z[:, :3] = motion.velocity_n - master.velocity_n - lever_n
        H[:, :3, :9] = place[:, 3:6]
        C_nominal = master.C_nm @ C_ms
        H[:, 3:, :9] = -place[:, 0:3]
        mu = layout.group("installation")
        H[:, 3:, mu] = C_nominal
        z[:, 3:] = log(motion.C_ns @ np.swapaxes(C_nominal, 1, 2))
        if motion.slow is not None:
            turning, pull = motion.slow
            age = master.time[:, None] - float(np.mean(self.master.time))
            for name, late in (("master.delay", 1.0), ("messages.rate", age)):
                for i in self._at(name):
                    H[:, :3, i], H[:, 3:, i] = pull * late, turning * late
        if "lever_arm.x" in self.counted:
            H[:, :3, layout.group("lever_arm")] = master.C_nm @ cross_matrix(w_m)
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

    def _drive(self, Phi: FloatArray, rows: IntArray, states: dict[str, FloatArray]) -> None:
        """Write what is counted with into the transitions `Phi` (m, b, n) [SI].

        A drift acts as its coefficient does, as far as it has come: from -1/2 to 1/2 over the run.
        """
        layout, inc = self.layout, self.slave.increments
        steps = self.steps(rows)
        begin, end = inc.time[self.slave.first], inc.time[rows[-1]]
        ramp = (inc.time[rows] - steps / 2 - begin) / (end - begin) - 0.5
        for name in self.counted:
            j = layout.index(name)
            if name.startswith("drift."):
                Phi[:, :9, j] = ramp[:, None] * Phi[:, :9, layout.index(name[len("drift.") :])]
            elif name == "site.gravity":
                Phi[:, 5, j], Phi[:, 8, j] = steps, steps**2 / 2
            elif name == "site.latitude":
                L = states["latitude"]
                turned = EARTH_RATE * np.stack([0.0 * L, -np.sin(L), np.cos(L)], axis=-1)
                Phi[:, :3, j] = steps[:, None] * np.einsum("kji,kj->ki", states["C_nl"], turned)

    @property
    def _moving(self) -> int:
        """How many of the first states change on the way."""
        changes = {*FLEXURE.names, *WANDER.names}
        return 9 if changes.isdisjoint(self.names) else len(self.names)

    def _carried(self, Phi: FloatArray, steps: FloatArray) -> FloatArray:
        """Return half of the noise between transitions `Phi` (m, b, n), and complete them [SI]."""
        layout, noise, moving = self.layout, self.slave.noise, self._moving
        Phi[:, 9:] = np.eye(moving, len(layout))[9:]
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
        return half

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
        """Return the model if the start is known `seconds` [s], as sd, early or late."""
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

    def faster(self, by: float) -> TransferModel:
        """Return the model where the clock of all stamps is fast `by` so much [1]."""
        inc, fast = self.slave.increments, 1.0 + by
        more = 1.0 if inc.counted else fast  # rates over longer intervals
        inc = replace(inc, time=inc.time * fast, dt=inc.dt * fast, dtheta_b=inc.dtheta_b * more,
                      dvel_b=inc.dvel_b * more)  # fmt: skip
        shocks = tuple((at, begin * fast, end * fast, sd) for at, begin, end, sd in self.shocks)
        return replace(self, slave=replace(self.slave, increments=inc), shocks=shocks,
                       master=replace(self.master, time=self.master.time * fast))  # fmt: skip

    def without_delay(self) -> TransferModel:
        """Return the model with the delay of its start, which is no state."""
        return replace(self, matching=replace(self.matching, delay=False),
                       sd=np.delete(self.sd, self._delay))  # fmt: skip


class _Piece(NamedTuple):
    """What `FreeInertial` has, of some of the messages."""

    history: FloatArray
    C_ns: FloatArray
    w_ib_b: FloatArray
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


EVALUATIONS = 80  # Runs of the filter at most [1].
STARTS = (1.0, 10.0)  # Correlation times that are tried first [s].
FAR = np.log(1e3)  # Logarithm of how far the search goes from where it starts [1].


@dataclass(frozen=True)
class DelayFit:
    """The delay for which the messages are likeliest."""

    # delay, sd: delay and its standard deviation, from the curvature of the likelihood [s]
    delay: float
    sd: float
    # tried, log_likelihood: (k,) what was tried [s], and how likely [1]
    tried: FloatArray
    log_likelihood: FloatArray
    at_edge: bool  # whether it lies at an end of the bracket: it may be outside


def likeliest_delay(model: TransferModel, bracket: tuple[float, float]) -> DelayFit:
    """Return the delay of maximum likelihood, the rest being estimated for each that is tried.

    `model`: without the delay as a state, that of its start is not used; `bracket`: where it may
    lie [s].

    Messages that hold before the start of the run with the largest delay are left out for all, so
    that every delay is judged by the same ones.
    """
    from scipy.optimize import minimize_scalar

    increments, master = model.slave.increments, model.master
    start = float(increments.time[model.slave.first]) + 2 * float(np.median(increments.dt))
    same = replace(model, master=master[master.time - bracket[1] > start])
    tried: list[tuple[float, float]] = []

    def against(tau: float) -> float:
        system = same.about(replace(model.start, delay=tau))
        tried.append((tau, kalman(system).log_likelihood))
        return -tried[-1][1]

    found = minimize_scalar(against, bounds=bracket, method="bounded",
                            options={"xatol": 1e-5, "maxiter": 40})  # fmt: skip
    tau = float(found.x)
    width = max(2e-4, 0.01 * (bracket[1] - bracket[0]))
    sides = [against(tau + d) - found.fun for d in (-width, width)]
    curvature = float(np.sum(sides)) / width**2
    each, likely = np.array(sorted(tried)).T
    edge = min(tau - bracket[0], bracket[1] - tau) < width
    return DelayFit(tau, curvature**-0.5 if curvature > 0 else np.inf, each, likely, edge)


@dataclass(frozen=True)
class FlexureFit:
    """The likeliest bending."""

    sd: float  # standard deviation [rad]
    time: float  # correlation time [s]
    attitude_sd: float  # sd of what is left of the difference of attitudes [rad]
    # by how much the log-likelihood is higher than it was, and than that of a rigid mount whose
    # attitudes have another noise [1]
    gain: float
    run: LinearRun  # the filter that knows it


def likeliest_flexure(model: TransferModel, at: Linearisation, likelihood: float) -> FlexureFit:
    """Return the bending of maximum likelihood, all else being estimated for each that is tried.

    `model`: its bending is not used, attitudes are, their sd is where the search starts;
    `likelihood`: log-likelihood so far [1].
    """
    from scipy.optimize import minimize, minimize_scalar

    mount, attitude_sd = model.mount, model.matching.attitude_sd
    known = dict(zip(model.names, model.sd, strict=True))
    some = replace(model, mount=replace(mount, flexure_sd=attitude_sd, flexure_time=STARTS[0]))
    free = replace(some, sd=np.array([known.get(name, 0.0) for name in some.names])).about(at)
    layout, steps = some.layout, some.steps(free.rows)

    def system(x: FloatArray) -> LinearSystem:
        size, slow, noise = np.exp(x).tolist()
        m = replace(mount, flexure_sd=size, flexure_time=slow)
        bending(free.Phi, free.half, layout, steps, m)
        for name, value in (("flexure", size), ("flexure_rate", size * LIVELY / slow)):
            i = layout.group(name)
            free.P0[i, i] = value**2
        R = free.R.copy()
        R[:, 3:] = noise**2
        return replace(free, R=R)

    def against(x: FloatArray) -> float:
        if np.any(np.abs(x - start) > FAR):
            return np.inf
        return -kalman(system(x)).log_likelihood

    tried = []
    for first in STARTS:
        start = np.log([attitude_sd, first, attitude_sd])
        tried.append((against(start), first))
    start = np.log([attitude_sd, min(tried)[1], attitude_sd])
    corners = start + np.vstack([np.zeros(3), np.diag([-1.0, 1.0, -0.5])])
    best = minimize(against, start, method="Nelder-Mead",
                    options={"maxfev": EVALUATIONS, "xatol": 0.03, "fatol": 0.2,
                             "initial_simplex": corners})  # fmt: skip
    size, slow, noise = np.exp(best.x).tolist()
    # Attitudes that are noisier or quieter than was said are no mount that bends.
    rigid = minimize_scalar(
        lambda x: against(np.array([start[0] - FAR, start[1], x])),
        bounds=(start[2] - FAR, start[2] + FAR), method="bounded", options={"xatol": 0.03},
    )  # fmt: skip
    so_far = max(likelihood, -float(rigid.fun))
    return FlexureFit(size, slow, noise, -float(best.fun) - so_far, kalman(system(best.x)))


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
    onto = np.eye(9 + p)
    try:
        on = free_run(slave.increments, state, slave.sensors, np.array([end]), onto[None],
                      first=int(rows[-1]), estimate=values,
                      gravity_offset=slave.gravity_offset)  # fmt: skip
    except FoucaultError:  # of passes that went astray: nothing goes on from there
        vector = CoefficientVector(slave.sensors.layout, values, cov[9:, 9:])
        return HandOver(state, vector, cov[:9, :9], int(rows[-1]))
    seconds = float(np.ptp(slave.increments.time[[rows[-1], end]]))
    half = np.diag(seconds / 2 * white_noise(slave.sensors, slave.noise))
    cov = onto @ (cov + half) @ onto.T + half
    place = seen_at_place(on.history)[0]
    vector = CoefficientVector(slave.sensors.layout, values, cov[9:, 9:])
    return HandOver(on.state(-1), vector, place @ cov[:9, :9] @ place.T, end)


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
