"""Rests on the six faces, and turns between them.

The published solution of six rests and three turns, and the attitude during a turn.

Biases are half the sum of opposite rests, the accelerometer matrix half their difference over g;
the gyro matrix is the integral of the rate, less bias and g-sensitivity, over the angle. Opposite
rests and turns are taken at their word: no redundancy is used and no Earth rate is known.

References
----------
.. [1] F. Ferraris, U. Grimaldi, M. Parvis, "Procedure for effortless in-field calibration of
   three-axial rate gyro and accelerometers", Sensors and Materials 7(5), 1995, eqs. (9)-(23).

The model of rests on six faces, and of turns about the case axes, and what makes it uncertain.

A rest on a face says what the accelerometers measure when f is known in case axes k, a turn what
the gyros add up when the angle is known::

    accel mean     a_j = L C_bk f_k + b_a + K q(C_bk f_k),     f_k = g (up_k + d)
    gyro mean      w_j = A_g C_bk w_ie_k + b_g + G C_bk f_k
    gyro integral  W_t = A_g C_bk (angle axis_k + int w_ie_k dt) + b_g T + G C_bk int f_k dt

with L lower triangular (`Gauge.LOWER`) and C_bk the small rotation from case to body axes. All but
that rotation is linear: a few steps of least squares give the exact start, for errors of any size,
and the iteration from there weighs the readings.

No instrument lies on a face as it should. Up differs from the case axis by a small random vector
d across it, another one in each placement; turning the instrument on the spot keeps it. The axis
of a turn differs from up by another one, for the support is not level, that of a turn back by the
same; and the angle of a turn is not what it was meant to be::

    turn    W_t = ... + A_g C_bk angle (+-d + d_level) + A_g C_bk axis_k d_angle

Of the Earth's rotation only the vertical part is known in case axes; the horizontal part, whose
heading is not, is a source of error, and all of it where the latitude is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.infer import mixed
from foucault.infer.mixed import NOISE_BASIS, UNEXPLAINED_BASIS, Linearisation, Source
from foucault.kernels.rotation import integrate_turns
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, Gauge, ImuModel, coefficient_slot
from foucault.models.noise import QUIET_ENDS, ImuNoise, SessionNoise, TriadNoise, window_covariance
from foucault.models.rests_and_turns import FaceReadings, TurnReadings
from foucault.models.rotation import cross_matrix, exp
from foucault.result import Estimate
from foucault.tables import Log


def turn_spread(log: Log, turns: TurnReadings, state: State) -> FloatArray:
    """Integrate the attitude over each turn: what a vector fixed in space adds up to.

    `turns`: the turns [SI]. Returns (m, 3, 3): ``int C_k(t)k(0) dt``: times a vector in case axes
    at the start, its integral [s].
    """
    assert log.gyro is not None
    out = np.empty((len(turns), 3, 3))
    for j, (a, b) in enumerate(zip(turns.first, turns.last, strict=True)):
        time = log.time[a:b]
        force = None if log.accel is None else log.accel[a:b]
        _, rate = state.model.compensate(force, log.gyro[a:b])
        assert rate is not None
        rate = np.ascontiguousarray(rate @ state.C_bk)
        ends = np.array([0]), np.array([b - a - 1])
        _, constant, *_ = integrate_turns(
            time, rate, np.zeros_like(rate), np.zeros((3, 3)), *ends, log.sampled == "increment"
        )
        # The sum over n samples lasts one interval longer than from the first to the last.
        out[j] = constant[0].T * (turns.time[j] / (time[-1] - time[0]))
    return out


def published(
    rests: FaceReadings, turns: TurnReadings, site: Site, spread: FloatArray | None = None
) -> ImuModel:
    """Solve as published, in case axes.

    `rests`: the rests, on six faces, several on one face are averaged by their length [SI]; `site`:
    gravity, with a latitude the vertical part of the Earth's rotation is taken off first; `spread`
    (m, 3, 3) or None: attitude during the turns, see `turn_spread`, needed with a latitude [s].
    """
    assert rests.gyro is not None
    gyro, turned = rests.gyro, turns.gyro
    if site.latitude is not None and spread is not None:
        vertical = EARTH_RATE * np.sin(site.latitude)
        gyro = gyro - vertical * rests.up_k
        turned = turned - vertical * np.einsum("mij,mj->mi", spread, turns.up_k)
    up, down = (_faces(rests, rests.accel, sign) for sign in (1, -1))
    gyro_up, gyro_down = (_faces(rests, gyro, sign) for sign in (1, -1))
    half = 2 * site.gravity
    model = ImuModel(
        accel_matrix=(up - down) / half,  # eqs. (21)-(23)
        accel_bias=np.diag(up + down) / 2,  # eqs. (19), (20)
        gyro_bias=np.average(gyro, axis=0, weights=rests.time),
        g_sensitivity=(gyro_up - gyro_down) / half,  # eq. (9)
    )
    time = turns.time[:, None]
    force = np.linalg.solve(model.accel_matrix, (turns.accel - time * model.accel_bias).T).T
    net = turned - time * model.gyro_bias - force @ model.g_sensitivity.T  # eqs. (13), (14)
    ratio = net / turns.angle[:, None]
    columns = [np.average(ratio[turns.axis == a], axis=0) for a in range(3)]  # eq. (15)
    return replace(model, gyro_matrix=np.stack(columns, axis=1))


def _faces(rests: FaceReadings, x: FloatArray, sign: int) -> FloatArray:
    """Mean reading with each axis up (or down), as the columns of a matrix."""
    weights = rests.time * ((rests.axis == np.arange(3)[:, None]) & (rests.sign == sign))
    return np.asarray((weights / weights.sum(axis=1, keepdims=True) @ x).T)


def scale_and_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split a matrix as published: ``matrix = diag(K) R`` with rows of R of length one.

    `matrix` (3, 3): i + S + M in case axes [1]. Returns `K` (3,): scale factors [1]; `R` (3, 3):
    directions of the sensitive axes, one per row [1].
    """
    K = np.linalg.norm(matrix, axis=1)
    return K, matrix / K[:, None]


STEPS = 8  # Of the least squares: each leaves the square of what the rotation was off by [1].
PASSES = 2  # Times that the attitude in the turns is found; each is 1e-4 of the last, or less [1].
QUIETEST = 1e-10  # Least sd of a mean, [m/s^2] and [rad/s]: far below what any instrument has.

SCATTER = {"accel": "scatter of specific force at rest", "gyro": "scatter of angular rate at rest"}
"""Kind of reading -> source of what neither its noise nor the placement explains."""

BEYOND = "placement beyond placement_sd"
"""Source of what placements are off by beyond what was declared."""

TILTS = (
    ("placement", "placement_sd"), ("level of the turns", "level_sd"),
    ("angle of the turns", "angle_sd"),
)  # fmt: skip
"""Sources of error of how the instrument lay and turned, and the settings that say their sizes."""


@dataclass(frozen=True)
class State:
    """Model and mounting: the state of the estimation."""

    model: ImuModel  # the error model in body axes, `Gauge.LOWER`
    C_bk: FloatArray  # (3, 3) rotation from case to body axes [1]


@dataclass(frozen=True)
class Scene:
    """What was observed, and the motion in case axes that should have been."""

    rests: FaceReadings  # the rests [SI]
    turns: TurnReadings | None  # the turns [SI]
    site: Site
    force_k: FloatArray  # (n, 3) specific force at the rests [m/s^2]
    rate_k: FloatArray  # (n, 3) the known part of the rate at the rests [rad/s]
    turn_k: FloatArray  # (m, 3) the known part of the integral of the rate over the turns [rad]
    turn_force_k: FloatArray  # (m, 3) integral of the specific force over the turns [m/s]
    # (m, 3, 3) ``int C_k(t)k(0) dt`` over the turns: what a constant vector adds up to [s]
    spread: FloatArray

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Number of rests with specific force, of rests with rates, and of turns."""
        n = len(self.rests)
        return n, 0 if self.rests.gyro is None else n, 0 if self.turns is None else len(self.turns)

    @property
    def readings(self) -> FloatArray:
        """Everything that was read, shape (k, 3): rests (accel), rests (gyro), turns [SI]."""
        parts = [self.rests.accel]
        if self.rests.gyro is not None:
            parts.append(self.rests.gyro)
        if self.turns is not None:
            parts.append(self.turns.gyro)
        return np.concatenate(parts)

    def tilted(self, placement: float, level: float) -> Scene:
        """Return the scene for faces that are off by a random angle: its cosine is below one.

        `placement`: standard deviation about each of two axes of how the faces lie [rad];
        `level`: the same of the axis of a turn against the vertical [rad].
        """
        about = self.turn_k if self.turns is None else self.turns.angle[:, None] * self.turns.axis_k
        return replace(
            self,
            force_k=self.force_k * (1 - placement**2),
            turn_k=self.turn_k - about * (placement**2 + level**2),
        )


def scene_of(
    rests: FaceReadings,
    turns: TurnReadings | None,
    site: Site,
    names: Sequence[str],
    log: Log | None = None,
) -> tuple[Scene, State]:
    """Return what was observed and the least squares of it, all readings being alike.

    `rests`: the rests, on six faces [SI]; `log` or None: the log, for the attitude during the
    turns.
    """
    m = 0 if turns is None else len(turns)
    force = site.gravity * rests.up_k
    vertical = 0.0 if site.latitude is None else EARTH_RATE * np.sin(site.latitude)
    scene = Scene(
        rests, turns, site, force, vertical * rests.up_k,
        np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 3, 3)),
    )  # fmt: skip
    if turns is None:
        return scene, _least_squares(scene, names)
    assert log is not None
    about = turns.angle[:, None] * turns.axis_k
    state = _least_squares(replace(scene, turns=None), [n for n in names if n.startswith("accel")])
    mean, _ = state.model.compensate(turns.accel / turns.time[:, None], None)
    assert mean is not None
    scene = replace(scene, turn_k=about, turn_force_k=mean @ state.C_bk * turns.time[:, None])
    # What the Earth adds depends on the attitude, and the attitude on what it adds.
    for _ in range(PASSES):
        spread = turn_spread(log, turns, _least_squares(scene, names))
        known = vertical * np.einsum("mij,mj->mi", spread, turns.up_k)
        scene = replace(scene, turn_k=about + known, spread=spread)
    return scene, _least_squares(scene, names)


def _least_squares(scene: Scene, names: Sequence[str]) -> State:
    """Return model and mounting by all readings alike: linear, but for the change of axes."""
    state, p = State(ImuModel(), np.eye(3)), len(names)
    # Of turns per unit of time, so that rests and turns have equations of like size.
    time = np.ones((sum(scene.sizes), 1))
    if scene.turns is not None:
        time[-len(scene.turns) :, 0] = scene.turns.time
    for _ in range(STEPS):
        miss, J = predict(scene, names, state)
        rows = (J / time[:, :, None]).reshape(-1, p + 3)
        size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        step = np.linalg.lstsq(rows / size, (miss / time).ravel(), rcond=1e-12)[0] / size
        state = State(state.model.moved(names, step[:p]), exp(step[p:]) @ state.C_bk)
    return state


def predict(scene: Scene, names: Sequence[str], state: State) -> tuple[FloatArray, FloatArray]:
    """Return readings less what a state says, (k, 3), and its derivative, (k, 3, p + 3) [SI]."""
    model, C, p = state.model, state.C_bk, len(names)
    n, rated, m = scene.sizes
    J = np.zeros((n + rated + m, 3, p + 3))
    f, w = scene.force_k @ C.T, scene.rate_k @ C.T
    accel, gyro = model.measure(f, w)
    out = [accel]
    slopes = model.slopes(f, w, names)
    J[:n, :, :p], J[:n, :, p:] = slopes.accel, -slopes.accel_by_force @ cross_matrix(f)
    if rated:
        out.append(gyro)
        J[n : 2 * n, :, :p] = slopes.gyro
        J[n : 2 * n, :, p:] = -slopes.gyro_by_force @ cross_matrix(f)
        if m:  # without turns the gyros' axes are unknown: they say nothing of the mounting
            J[n : 2 * n, :, p:] -= slopes.gyro_by_rate @ cross_matrix(w)
    if m and scene.turns is not None:
        v, F, T = scene.turn_k @ C.T, scene.turn_force_k @ C.T, scene.turns.time
        G = model.g_sensitivity
        out.append(v @ model.gyro_matrix.T + T[:, None] * model.gyro_bias + F @ G.T)
        J[2 * n :, :, p:] = -model.gyro_matrix @ cross_matrix(v) - G @ cross_matrix(F)
        # Linear: what holds of rates holds of their integrals; a bias adds up with time.
        summed = np.where([name.startswith("gyro.bias.") for name in names], T[:, None], 1.0)
        J[2 * n :, :, :p] = model.slopes(F, v, names).gyro * summed[:, None]
    return scene.readings - np.concatenate(out), J


@dataclass(frozen=True)
class FaceNoise:
    """Noise of the means and integrals."""

    # accel_var, gyro_var: (n, 3) variance of the means, slow noise and shared rounding left out
    # [SI]
    accel_var: FloatArray
    gyro_var: FloatArray
    turn_var: FloatArray  # (m, 3) variance of the integrals [rad^2]
    session: SessionNoise  # what they were made of; its slow part is added exactly [SI]
    source: Literal["declared", "measured", "unknown"]  # where it is from

    @property
    def known(self) -> bool:
        """False where nobody knows the noise: means without a declaration."""
        return self.source != "unknown"

    @classmethod
    def sampled(
        cls,
        noise: SessionNoise,
        rests: FaceReadings,
        turns: TurnReadings | None,
        source: Literal["declared", "measured"],
    ) -> FaceNoise:
        """Take the noise of samples [SI], declared or measured in the rests."""
        time = rests.time[:, None]
        turn = np.zeros((0, 1)) if turns is None else turns.time[:, None]
        quiet = np.minimum(turn, QUIET_ENDS)
        lost = np.zeros((0, 1)) if turns is None else turns.bridged[:, None]
        return cls(
            noise.accel_psd / time + noise.accel_rounding**2 + 2 * noise.accel_carried / time**2,
            noise.gyro_psd / time + 2 * noise.gyro_carried / time**2,
            noise.turn_psd * turn + (noise.gyro_rounding * quiet) ** 2 + 2 * noise.gyro_carried
            + lost**2,
            noise, source,
        )  # fmt: skip

    @classmethod
    def of_means(cls, noise: ImuNoise | None, rests: FaceReadings) -> FaceNoise:
        """Take the noise of rows that are means already: how long they are says how quiet.

        `noise`: declared noise [SI]; None where unknown: the variances are those of a noise of 1.
        """
        zero, given = np.zeros(3), noise or ImuNoise(TriadNoise(1.0), TriadNoise(1.0))
        accel, gyro = (
            np.repeat(triad.white**2 / rests.time[:, None], 3, axis=1)
            for triad in (given.accel, given.gyro)
        )
        session = SessionNoise(zero, zero, zero, given)
        return cls(accel, gyro, np.zeros((0, 3)), session, "declared" if noise else "unknown")


@dataclass(frozen=True)
class OnFaces:
    """The model of a session on faces, as `infer.mixed` solves it.

    Its readings are those of `Scene.readings`; the last three columns are the mounting.
    """

    scene: Scene
    layout: Layout
    start: State
    noise: FaceNoise
    # sds of placement, level and angle, about each axis: of up against the case axis, of the axis
    # of a turn against up, of the angle of a turn. None: to be found, or like the placement [rad]
    given: tuple[float | None, float | None, float | None]
    near: tuple[float, float] = (0.0, 0.0)  # placement and level whose squares are taken [rad]

    @cached_property
    def kinds(self) -> dict[str, BoolArray]:
        """Kind of reading -> its components, shape (k, 3)."""
        kind = np.repeat(["accel", "gyro", "turns"], self.scene.sizes)
        return {name: np.tile(kind == name, (3, 1)).T for name in dict.fromkeys(kind.tolist())}

    @property
    def middle(self) -> FloatArray:
        """Middle of every reading, shape (k,) [s]."""
        start, time = self.windows
        return start + time / 2

    @cached_property
    def windows(self) -> tuple[FloatArray, FloatArray]:
        """Beginning and length of every reading, shape (k,) each [s]."""
        _, rated, m = self.scene.sizes
        parts: list[Any] = [self.scene.rests] * (1 + bool(rated)) + [self.scene.turns] * bool(m)
        return np.concatenate([x.start for x in parts]), np.concatenate([x.time for x in parts])

    def retract(self, state: State, step: FloatArray) -> State:
        """Apply `step` (p + 3,): coefficients and a rotation of the mounting [SI]."""
        p = len(self.layout)
        return State(state.model.moved(self.layout.names, step[:p]), exp(step[p:]) @ state.C_bk)

    def values(self, state: State) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        return state.model.coefficients(self.layout.names).values

    def linearise(self, state: State) -> Linearisation:
        """Compare the readings with the model at a state."""
        miss, J = predict(self.scene, self.layout.names, state)
        return Linearisation(miss, J, (*self._noise, *self._earth(state), *self._tilts(state)))

    def _rows(self, first: int, blocks: FloatArray) -> FloatArray:
        """Put blocks (r, 3, c) at the readings from `first` on, nothing at the others."""
        out = np.zeros((sum(self.scene.sizes), 3, blocks.shape[2]))
        out[first : first + len(blocks)] = blocks
        return out

    def _grouped(self, first: int, blocks: FloatArray, group: IntArray) -> FloatArray:
        """Do the same where the readings of one group share their causes."""
        out = np.zeros((len(blocks), 3, int(group.max(initial=0)) + 1, blocks.shape[2]))
        out[np.arange(len(blocks)), :, group] = blocks
        return self._rows(first, out.reshape(len(blocks), 3, -1))

    @cached_property
    def _noise(self) -> tuple[Source, ...]:
        """What the sensors are off by, known and unknown; none of it depends on the state."""
        n, rated, m = self.scene.sizes
        noise, slow = self.noise, self.noise.session.slow
        (kind, basis), (start, time) = NOISE_BASIS[noise.source], self.windows
        # What a rate is off by adds up over a turn.
        size = np.append(np.ones(n + rated), time[n + rated :])
        effect = size[:, None, None] * np.eye(3)
        triads = [
            ("accelerometer noise", SCATTER["accel"], slice(0, n), noise.accel_var, slow.accel)
        ]
        if rated:
            variance = np.concatenate([noise.gyro_var, noise.turn_var])
            mine = slice(n, n + rated + m)
            triads.append(("gyro noise", SCATTER["gyro"], mine, variance, slow.gyro))
        out = []
        for name, scatter, mine, variance, wander in triads:
            sensor = Source(name, noise=True, type=kind, basis=basis)
            white = self._rows(mine.start, np.sqrt(variance)[:, :, None] * np.eye(3))
            out.append(replace(sensor, each=white, sd=1.0 if noise.known else None, price=0.0))
            each = self._rows(mine.start, effect[mine])
            out.append(Source("least noise", each, sd=QUIETEST, noise=True))
            if noise.known:
                out.append(mixed.scatter(scatter, each))
            if wander.bias_instability or wander.random_walk:
                cov = window_covariance(start[mine], start[mine] + time[mine], wander)
                shared = self._rows(mine.start, mixed.tied(effect[mine], mixed.root(cov)))
                out.append(replace(sensor, shared=shared))
        if rated and noise.session.gyro_rounding.any():  # the same in all rests
            blocks = np.broadcast_to(np.diag(noise.session.gyro_rounding), (n, 3, 3))
            out.append(replace(sensor, shared=self._rows(n, blocks)))
        return tuple(out)

    def _earth(self, state: State) -> list[Source]:
        """The part of the Earth's rotation whose direction is unknown.

        Across up it is one vector for all of a placement: whole turns lead back to the same
        heading. Along up, where the latitude is unknown, it is one number for the session; both
        together have a third of the squared rate about every axis.
        """
        scene, latitude = self.scene, self.scene.site.latitude
        n, rated, _ = scene.sizes
        if not rated:
            return []
        parts = [x for x in (scene.rests, scene.turns) if x is not None]
        up, group = (
            np.concatenate([getattr(x, name) for x in parts]) for name in ("up_k", "group")
        )
        turned = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), scene.spread])
        effect = state.model.gyro_matrix @ state.C_bk @ turned
        across = self._grouped(n, effect @ _across(up), group)
        if latitude is not None:
            size, basis = (
                EARTH_RATE * np.cos(latitude) / np.sqrt(2),
                "heading not given: the whole circle",
            )
            return [Source("unknown heading", shared=across, sd=size, basis=basis)]
        along = self._rows(n, effect @ up[:, :, None])
        size, basis = EARTH_RATE / np.sqrt(3), "latitude not given: any direction"
        both = np.concatenate([across, along], axis=2)
        return [Source("unknown Earth rate", shared=both, sd=size, basis=basis)]

    def _tilts(self, state: State) -> list[Source]:
        """How far placements, the axes of turns and their angles are from what they should be.

        Along the vertical the cosine of a tilt scatters about its mean (see `Scene.tilted`) by the
        square of its sd, and so does its product with the misalignments, of which as much is
        unknown.
        """
        scene, C = self.scene, state.C_bk
        n, rated, m = scene.sizes
        rests, turns, model = scene.rests, scene.turns, state.model
        placed = rests.group if turns is None else np.concatenate([rests.group, turns.group])
        total = int(placed.max(initial=0)) + 1 + m
        off, square = np.zeros((n + rated + m, 3, total, 3)), np.zeros((n + rated + m, 3, total))
        row, g = np.arange(n), scene.site.gravity * _across(rests.up_k)
        off[row, :, rests.group] = model.accel_matrix @ C @ g
        square[row, :, rests.group] = scene.force_k @ (model.accel_matrix @ C).T
        if rated:
            off[n + row, :, rests.group] = model.g_sensitivity @ C @ g
        near, out = np.sqrt(2) * np.array(self.near), list[Source]()
        if turns is not None:
            seen, row = model.gyro_matrix @ C, 2 * n + np.arange(m)
            tilt = turns.angle[:, None, None] * (seen @ _across(turns.axis_k))
            squares = scene.turn_k @ seen.T
            # An axis that is level is off by itself; a vertical one by as much as up is.
            own = np.where(turns.about_up == 0, total - m + np.arange(m), turns.group)
            sign = np.where(turns.about_up == 0, 1.0, turns.about_up)
            off[row, :, own], square[row, :, own] = sign[:, None, None] * tilt, squares
            level = np.concatenate([tilt, near[1] * squares[:, :, None]], axis=2)
            angle = (turns.axis_k @ seen.T)[:, :, None]
            # The support is as level as before where it is turned on again, either way.
            support = np.unique(turns.group, return_inverse=True)[1]
            out = [
                replace(self.tilt(1), shared=self._grouped(2 * n, level, support)),
                replace(self.tilt(2), each=self._rows(2 * n, angle)),
            ]
        first = off.reshape(len(off), 3, -1)
        out.append(replace(self.tilt(0), shared=np.concatenate([first, near[0] * square], axis=2)))
        if self.given[0] is not None and self.noise.known:
            # What a tilt explains as well as scatter does is taken for a tilt: it costs less.
            price = 0.9 * mixed.SIGNIFICANT
            out.append(mixed.scatter(BEYOND, None, first, price))
        return out

    def tilt(self, which: int) -> Source:
        """Return name and size of an error: `which` [1] is 0 placement, 1 level, 2 angle."""
        like = 0 if self.given[which] is None else which
        (name, setting), sd = TILTS[like], self.given[like]
        if sd is None:
            kind, basis = UNEXPLAINED_BASIS
            return Source(name, sd=None, price=0.0, type=kind, basis=basis)
        return Source(name, sd=sd, basis=f"{setting} as given in the campaign")


def _across(u: FloatArray) -> FloatArray:
    """Projection on the plane across unit vectors, shape (..., 3, 3)."""
    return np.asarray(np.eye(3) - u[..., :, None] * u[..., None, :])


def on_faces(
    scene: Scene,
    start: State,
    names: Sequence[str],
    noise: FaceNoise,
    given: tuple[float | None, float | None, float | None],
) -> OnFaces:
    """State the model; the squares of tilts of unknown size are as large as they seem at first.

    `scene`, `start`: as `scene_of` returns them; `given`: placement, level and angle as
    declared, None: to be found, the last two are then like the placement [rad].
    """
    if given[0] is None and not noise.known:  # it is part of the noise that is found
        given = (0.0, *given[1:])
    model = OnFaces(scene, LAYOUT.subset(names), start, noise, given)
    size = given[0]
    if (
        size is None
    ):  # the mean of sd^2 over Student's distribution; noise has squares of no account
        left = model.linearise(start).residuals[: len(scene.rests)]
        dof = left.size - sum(name.startswith("accel.") for name in names) - 3
        size = float(np.linalg.norm(left)) / scene.site.gravity / np.sqrt(max(dof - 2, dof / 2))
    level = size if given[1] is None else given[1]
    return replace(model, scene=scene.tilted(size, level), near=(size, level))


def unbiased(estimate: Estimate) -> Estimate:
    """Take the bias of the change of axes out of a solution.

    The matrices in case axes are linear in the readings, so their errors have no mean. The body
    axes follow the accelerometers that were found, and are bent by the square of these errors:
    an error of placement of 5 arcmin makes 1 ppm of scale factor. The mean of the matrices in case
    axes over the errors of the solution undoes this to second order: of ``(A + dA) exp(phi) C_bk``
    it is ``(A (1 + <[phi x]^2> / 2) + <dA [phi x]>) C_bk``.
    """
    state, names, P = estimate.state, estimate.coefficients.names, estimate.state_cov
    p = len(names)
    square = P[p:, p:] - np.trace(P[p:, p:]) * np.eye(3)
    mean = {
        block: getattr(state.model, block) @ (np.eye(3) + square / 2)
        for block in ("accel_matrix", "gyro_matrix", "g_sensitivity")
    }
    for k, name in enumerate(names):
        block, where = coefficient_slot(name)
        if block in mean:
            mean[block][where[0]] += cross_matrix(P[k, p:])[where[1]]
    in_case = {block: matrix @ state.C_bk for block, matrix in mean.items()}
    model_k = replace(state.model, **in_case, accel_quadratic=np.zeros((3, 6)))
    model, C_bk = model_k.in_gauge(Gauge.LOWER)
    if not any(name.startswith("gyro.scale.") for name in names):
        model = replace(model, gyro_matrix=np.eye(3))
    model = replace(model, accel_quadratic=state.model.accel_quadratic)
    vector = replace(estimate.coefficients, values=model.coefficients(names).values)
    return replace(estimate, coefficients=vector, state=State(model, C_bk))
