"""Where a motion leads on the ellipsoid: its velocity integrated to the last digits.

Level frame l, in one of two kinds:

north
    East-North-Up. The state is latitude, longitude and height::

        L' = v_N / (RM + h)      lon' = v_E / ((RN + h) cos L)      h' = v_U

carried along
    East-North-Up at the start (at a pole: of the longitude given), then carried along without
    turning about up relative to the Earth, w_el has no up component. Nothing grows near the poles,
    and a straight run along the ellipsoid is a geodesic. The state is C_el and the height::

        C_el' = C_el [w_el x]    w_el = c0 (z x v) + c1 (v . p) (z x p)

    with the Earth's axis p in l (third row of C_el), c0 = 1 / (RN + h) and c0 + c1 cos^2 L =
    1 / (RM + h).

Velocity is a known function of time, so that the rates depend on the state through the slow change
of radii and axis alone. The integral equation is solved for all times at once by Picard's
iteration: velocities at the Gauss-Legendre nodes of short panels, the integral of their
interpolating polynomials, new rates, and so on until no digit changes.

A plan of manoeuvres as pieces of time in which all that changes is a smooth function.

The vehicle goes with speed V along a path of course chi (clockwise from the second axis of a level
frame l, which is north or carried along, see above) and angle of climb gamma. Its
own axes v are right, forward, up, with heading, pitch and roll chi, gamma and bank; the body is
fastened in it, and a table may turn it there::

    v_l  = D(chi) u,   u = (0, V cos gamma, V sin gamma) + (rate of a sway to right, forward, up)
    C_lb = C_lv(chi, gamma, bank; + sway) C_vb Exp(axis_b angle)
    tan bank = V chi' / g         no specific force sideways; 0 in a flat turn
    sin gamma = height' / V       in a climb by a height

D is the rotation by -chi about up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.earth import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    east_north_up,
    gravity,
    radii,
)
from foucault.models.rotation import cross_matrix, exp, matrix_of, turned
from foucault.plans.manoeuvres import (
    STEEPEST,
    TABLE_AXES,
    Accelerate,
    Climb,
    Plan,
    Profile,
    Rest,
    Rotate,
    Segment,
    Start,
    STurn,
    Sway,
    Three,
    Turn,
    name,
    steep,
    step,
)

NORTHERNMOST = np.radians(89.9)
"""Up to here headings may be from north; 11 km from the pole north turns by 5 deg in 1 km [rad]."""

NODES, WEIGHTS = legendre.leggauss(8)
"""Quadrature on a panel, from -1 to 1 [1]."""

# Values at the nodes -> Legendre coefficients of their integral from -1, times half a panel.
_INTEGRAL = legendre.legint(np.linalg.inv(legendre.legvander(NODES, 7)), lbnd=-1)
_TO_NODES = legendre.legvander(NODES, 8) @ _INTEGRAL
_MOST_ROUNDS = 100


@dataclass(frozen=True)
class Path:
    """Position over time, as polynomials on panels."""

    edges: FloatArray  # (p + 1,) edges of the panels, 0 is one of them [s]
    # (p, m) state at the beginning of each panel [rad, m]: latitude, longitude and height, or C_el
    # row by row and height
    begin: FloatArray
    shape: FloatArray  # (p, 9, m) legendre coefficients of its change in the panel [rad, m]

    @property
    def carried(self) -> bool:
        """Whether frame l is carried along."""
        return len(self.begin[0]) == 10

    def _state(self, time: FloatArray, which: slice) -> FloatArray:
        panel = np.clip(np.searchsorted(self.edges, time, side="right") - 1, 0, len(self.begin) - 1)
        left, right = self.edges[panel], self.edges[panel + 1]
        x = (2.0 * time - left - right) / (right - left)
        powers = legendre.legvander(x, 8)
        change = np.einsum("nk,nkm->nm", powers, self.shape[panel, :, which])
        return np.asarray(self.begin[panel, which] + change)

    def axis_and_height(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the Earth's axis, frame l, shape (n, 3) [1], and height, shape (n,) [m].

        `time` (n,): when [s].
        """
        if self.carried:
            y = self._state(time, slice(6, 10))
            return y[:, :3], y[:, 3]
        y = self._state(time, slice(0, 3))
        return np.stack([np.zeros(len(y)), np.cos(y[:, 0]), np.sin(y[:, 0])], axis=-1), y[:, 2]

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return latitude, longitude [rad], height [m], shape (n,), and C_nl, shape (n, 3, 3).

        `time` (n,): when [s].
        """
        y = self._state(time, slice(None))
        if not self.carried:
            alike = np.broadcast_to(np.eye(3), (len(y), 3, 3))
            return y[:, 0], turned(y[:, 1]), y[:, 2], alike
        C_el = y[:, :9].reshape(-1, 3, 3)
        up = C_el[:, :, 2]
        latitude = np.arctan2(up[:, 2], np.hypot(up[:, 0], up[:, 1]))
        longitude = np.arctan2(up[:, 1], up[:, 0])
        C_nl = np.swapaxes(east_north_up(latitude, longitude), 1, 2) @ C_el
        return latitude, longitude, y[:, 9], C_nl


def level_rate(p: FloatArray, height: FloatArray, v: FloatArray, carried: bool) -> FloatArray:
    """Return w_el, frame l, shape (n, 3) [rad/s].

    `p` (n, 3): the Earth's axis, frame l [1]; `height` (n,): height [m]; `v` (n, 3): velocity,
    frame l [m/s]; `carried`: whether l is carried along, without a rate about up, or stays
    East-North-Up.
    """
    d = 1.0 - ECCENTRICITY_SQUARED * p[:, 2] ** 2
    RN = SEMI_MAJOR_AXIS / np.sqrt(d)
    RM = RN * (1.0 - ECCENTRICITY_SQUARED) / d
    c0 = 1.0 / (RN + height)
    c1 = c0 * RN * ECCENTRICITY_SQUARED / (d * (RM + height))
    along = c1 * (v[:, 0] * p[:, 0] + v[:, 1] * p[:, 1])
    x, y = -c0 * v[:, 1] - along * p[:, 1], c0 * v[:, 0] + along * p[:, 0]
    z = np.zeros_like(x) if carried else y * p[:, 2] / p[:, 1]
    return np.stack([x, y, z], axis=-1)


def path_of(
    start: Start, edges: FloatArray, velocity: Callable[[FloatArray], FloatArray], carried: bool
) -> Path:
    """Integrate a velocity that is known as a function of time.

    `edges` (p + 1,): edges of the panels, in order, 0 is one of them [s]; `velocity`: times,
    shape (n,) [s] -> velocity, frame l, shape (n, 3) [m/s]; `carried`: whether l is carried
    along, or stays East-North-Up.
    """
    half = np.diff(edges) / 2
    middle = edges[:-1] + half
    v = velocity((middle[:, None] + half[:, None] * NODES).ravel())
    first = [start.latitude, start.longitude, start.height]
    if carried:
        first = [*east_north_up(start.latitude, start.longitude).ravel(), start.height]
    y0 = np.array(first)
    zero = int(np.flatnonzero(edges == 0.0)[0])
    y = np.broadcast_to(y0, (len(half), len(NODES), len(y0)))
    slope = _carried_slope if carried else _north_slope
    before = np.inf
    for _ in range(_MOST_ROUNDS):
        rate = slope(y.reshape(-1, len(y0)), v).reshape(y.shape)
        whole = np.einsum("p,k,pkm->pm", half, WEIGHTS, rate)
        begin = np.concatenate([np.zeros((1, len(y0))), np.cumsum(whole, axis=0)])
        begin += y0 - begin[zero]
        new = begin[:-1, None] + half[:, None, None] * np.einsum("jk,pkm->pjm", _TO_NODES, rate)
        change = float(np.abs(new[..., :-1] - y[..., :-1]).max())
        y = new
        if not carried:
            _require_far_from_poles(y[..., 0])
        if change == 0.0 or (change < 1e-14 and change >= before):
            break
        before = change
    shape = half[:, None, None] * np.einsum("jk,pkm->pjm", _INTEGRAL, rate)
    return Path(edges, begin[:-1], shape)


def _north_slope(y: FloatArray, v: FloatArray) -> FloatArray:
    RM, RN = radii(y[:, 0])
    h = y[:, 2]
    east = v[:, 0] / ((RN + h) * np.cos(y[:, 0]))
    return np.stack([v[:, 1] / (RM + h), east, v[:, 2]], axis=-1)


def _carried_slope(y: FloatArray, v: FloatArray) -> FloatArray:
    C_el = y[:, :9].reshape(-1, 3, 3)
    turn = C_el @ cross_matrix(level_rate(y[:, 6:9], y[:, 9], v, True))
    return np.concatenate([turn.reshape(-1, 9), v[:, 2:]], axis=1)


def _require_far_from_poles(latitude: FloatArray) -> None:
    farthest = latitude.flat[np.argmax(np.abs(latitude))]
    if not abs(farthest) < NORTHERNMOST:
        limit = np.degrees(NORTHERNMOST)
        raise error("manoeuvre.pole", given=np.degrees(farthest), limit=f"{limit:.4g}")


@dataclass(frozen=True)
class Oscillation:
    """Sums of sinusoids that grow and die down: ``S(t / fade) sum_k a sin(w_k t + phase_k)``."""

    amplitude: FloatArray  # (c,) of the tones of each quantity [any unit]
    frequency: FloatArray  # (c, k) angular frequencies of the tones [rad/s]
    phase: FloatArray  # (c, k) phases of the tones [rad]
    # time, fade: how long it lasts, and how long growing and dying down take [s]
    time: float
    fade: float

    @classmethod
    def of(cls, sway: Sway) -> Oscillation:
        """Draw the tones of heading, pitch, roll, and of the shift right, forward and up."""
        rng = np.random.default_rng(sway.seed)
        shape = (6, sway.tones)
        spread = rng.uniform(-1.0, 1.0, shape) if sway.tones > 1 else np.zeros(shape)
        frequency = 2 * np.pi / sway.period * 2.0**spread
        amplitude = np.array([*sway.angles, *sway.shift]) / np.sqrt(sway.tones)
        phase = rng.uniform(0.0, 2 * np.pi, shape)
        fade = sway.time / 4 if sway.fade is None else sway.fade
        return cls(amplitude, frequency, phase, sway.time, fade)

    @property
    def shortest(self) -> float:
        """Shortest period [s]."""
        return float(2 * np.pi / self.frequency.max())

    def at(self, t: FloatArray) -> Three:
        """Return values, rates and accelerations, shape (c, n) each [unit, s].

        `t` (n,): time since it began [s].
        """
        late = t > self.time / 2
        x = np.clip(np.where(late, self.time - t, t) / self.fade, 0.0, 1.0)
        e, e1, e2 = step(x)
        e1, e2 = np.where(late, -e1, e1) / self.fade, e2 / self.fade**2
        s, s1, s2 = np.zeros((3, len(self.amplitude), len(t)))
        for c in np.flatnonzero(self.amplitude):
            for w, phase in zip(self.frequency[c], self.phase[c], strict=True):
                sine, cosine = np.sin(w * t + phase), np.cos(w * t + phase)
                s[c] += sine
                s1[c] += w * cosine
                s2[c] -= w * w * sine
        a = self.amplitude[:, None]
        return a * e * s, a * (e1 * s + e * s1), a * (e2 * s + 2 * e1 * s1 + e * s2)


_STILL = Profile()
_STEADY_STEP, _CHANGING_STEP = 1.0, 0.25  # longest panels of quadrature [s]


class Kinematics(NamedTuple):
    """What a piece does at some times: see the text of the module."""

    angles: FloatArray
    rates: FloatArray
    course: FloatArray
    course_rate: FloatArray
    u: FloatArray
    u_rate: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


@dataclass(frozen=True)
class Piece:
    """A piece of time of a motion."""

    # start, time: when it begins, and how long it lasts [s]
    start: float
    time: float
    speed: float  # speed at the beginning [m/s]
    # course, climb: course and angle of climb at the beginning [rad]
    course: float
    climb: float
    C_vb: FloatArray  # (3, 3) body in the vehicle at the beginning [1]
    # accelerate, turn, pitch, rise, spin: changes of speed [m/s], course and angle of climb [rad],
    # of height in a climb by a height [m], of the angle on a table [rad]
    accelerate: Profile = _STILL
    turn: Profile = _STILL
    pitch: Profile = _STILL
    rise: Profile = _STILL
    spin: Profile = _STILL
    axis_b: FloatArray | None = None  # (3,) axis of the table, frame b [1]
    # g of the bank of a turn, infinite where the vehicle stays flat [m/s^2]
    bank_gravity: float = np.inf
    # of heading, pitch, roll [rad] and of the shift right, forward, up [m]
    sway: Oscillation | None = None

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.start + self.time

    def after(self, time: float) -> Piece:
        """Return the steady piece of `time` [s] that follows."""
        C_vb = self.C_vb
        if self.axis_b is not None:
            C_vb = C_vb @ exp(self.axis_b * self.spin.total)
        return Piece(
            self.end, time, self.speed + self.accelerate.total, self.course + self.turn.total,
            self.climb + self.pitch.total, C_vb,
        )  # fmt: skip

    @property
    def profiles(self) -> list[Profile]:
        """The profiles that change anything."""
        some = (self.accelerate, self.turn, self.pitch, self.rise, self.spin)
        return [profile for profile in some if profile.total]

    @property
    def step(self) -> float:
        """Longest time over which all is close to a polynomial of low order [s]."""
        steps = [min(_CHANGING_STEP, profile.ramp / 4) for profile in self.profiles]
        if self.sway is not None:
            steps.append(min(_CHANGING_STEP, self.sway.fade / 4, self.sway.shortest / 4))
        return min(steps, default=_STEADY_STEP)

    def joints(self) -> FloatArray:
        """Return where its functions begin and change, and times in between, `step` apart [s]."""
        marks = [0.0, self.time]
        for profile in self.profiles:
            marks += [profile.ramp, profile.time / 2, profile.time - profile.ramp]
        if self.sway is not None:
            marks += [self.sway.fade, self.time / 2, self.time - self.sway.fade]
        edges = np.unique(marks)
        parts = np.ceil(np.diff(edges) / self.step).astype(int)
        within = [np.arange(n) / n * d for n, d in zip(parts, np.diff(edges), strict=True)]
        spread = [edge + w for edge, w in zip(edges[:-1], within, strict=True)]
        return self.start + np.concatenate(spread)

    def at(self, time: FloatArray) -> Kinematics:
        """Return what it does at `time`, shape (n,) [s]; steady outside of it."""
        t = np.clip(time - self.start, 0.0, self.time)
        V, dV = self.speed + self.accelerate.at(t)[0], self.accelerate.at(t)[1]
        turn, turn_rate, turn_curve = self.turn.at(t)
        climb, climb_rate = self._climb(t, V)
        spin, spin_rate, _ = self.spin.at(t)
        tangent = V * turn_rate / self.bank_gravity
        bank_rate = V * turn_curve / self.bank_gravity / (1.0 + tangent**2)
        angles = np.stack([self.course + turn, climb, np.arctan(tangent)], axis=-1)
        rates = np.stack([turn_rate, climb_rate, bank_rate], axis=-1)
        s, c = np.sin(climb), np.cos(climb)
        zero = np.zeros_like(t)
        u = np.stack([zero, V * c, V * s], axis=-1)
        along, across = dV, V * climb_rate
        u_rate = np.stack([zero, along * c - across * s, along * s + across * c], axis=-1)
        if self.sway is not None:
            shift, shift_rate, shift_curve = self.sway.at(t)
            angles += shift[:3].T
            rates += shift_rate[:3].T
            u += shift_rate[3:].T
            u_rate += shift_curve[3:].T
        return Kinematics(angles, rates, self.course + turn, turn_rate, u, u_rate, spin, spin_rate)

    def _climb(self, t: FloatArray, V: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.rise.total == 0.0:
            change, rate, _ = self.pitch.at(t)
            return self.climb + change, rate
        _, rise, curve = self.rise.at(t)
        sine = rise / V
        return np.arcsin(sine), curve / V / np.sqrt(1.0 - sine**2)


def pieces_of(plan: Plan, start: Start) -> tuple[list[Piece], list[tuple[str, float, float]]]:
    """Return the pieces of a plan, and label, beginning and end [s] of each of its segments."""
    if not plan:
        raise error("manoeuvre.empty")
    C_vb = matrix_of(0.0, start.pitch, start.roll)
    before = Piece(0.0, 0.0, start.speed, start.heading, 0.0, C_vb)
    g = gravity(start.latitude, start.height)
    pieces: list[Piece] = []
    spans = []
    for segment in plan:
        begin = before.end
        for part in _parts(segment):
            before = _piece(part, before.after(part.time), g, name(segment))
            pieces.append(before)
        spans.append((segment.label or type(segment).__name__, begin, before.end))
    return pieces, spans


def _parts(segment: Segment) -> list[Segment]:
    if not isinstance(segment, STurn):
        return [segment]
    a, t = segment.angle, segment.time / 4
    turns = ((a, t), (-2 * a, 2 * t), (a, t))
    return [Turn(angle, time, segment.banked) for angle, time in turns]


def _piece(segment: Segment, steady: Piece, g: float, what: str) -> Piece:
    """Return what a segment makes of the steady piece it begins as."""
    match segment:
        case Rest():
            _require_rest(steady, what)
        case Accelerate():
            change = Profile(segment.speed - steady.speed, segment.time, _ramp(segment))
            return replace(steady, accelerate=change)
        case Turn():
            return _turn(segment, steady, g, what)
        case Climb():
            return _climb(segment, steady, what)
        case Sway():
            turn = Profile(segment.turn, segment.time, segment.time / 2)
            return replace(steady, sway=Oscillation.of(segment), turn=turn)
        case Rotate():
            _require_rest(steady, what)
            C_lb = matrix_of(steady.course, steady.climb, 0.0) @ steady.C_vb
            number = TABLE_AXES.index(segment.axis)
            axis = np.eye(3)[number] if number < 3 else C_lb[number - 3]
            change = Profile(segment.angle, segment.time, segment.ramp)
            return replace(steady, spin=change, axis_b=axis)
    return steady


def _turn(segment: Turn, steady: Piece, g: float, what: str) -> Piece:
    change = Profile(segment.angle, segment.time, _ramp(segment))
    if not segment.banked:
        return replace(steady, turn=change)
    _require_speed(steady, what)
    bank = float(np.arctan(steady.speed * change.peak / g))
    if abs(bank) > STEEPEST:
        raise steep(what, "a bank", bank)
    return replace(steady, turn=change, bank_gravity=g)


def _climb(segment: Climb, steady: Piece, what: str) -> Piece:
    if segment.angle is not None:
        change = segment.angle - steady.climb
        if change:
            _require_speed(steady, what)
        return replace(steady, pitch=Profile(change, segment.time, _ramp(segment)))
    _require_speed(steady, what)
    if abs(steady.climb) > 1e-12:
        raise error(
            "manoeuvre.not_level", what=what, time=steady.start, given=np.degrees(steady.climb)
        )
    rise = Profile(segment.height or 0.0, segment.time, _ramp(segment))
    sine = rise.peak / steady.speed
    if abs(sine) > np.sin(STEEPEST):
        # Past the vertical there is no angle to name: the height itself is longer than the way.
        raise steep(what, "an angle of climb", float(np.arcsin(np.clip(sine, -1.0, 1.0))))
    return replace(steady, climb=0.0, rise=rise)


def _ramp(segment: Accelerate | Turn | Climb) -> float:
    return segment.time / 2 if segment.ramp is None else segment.ramp


def _require_rest(steady: Piece, what: str) -> None:
    if steady.speed > 0:
        raise error("manoeuvre.moving", what=what, time=steady.start, speed=steady.speed)


def _require_speed(steady: Piece, what: str) -> None:
    if steady.speed <= 0:
        raise error("manoeuvre.still", what=what, time=steady.start)
