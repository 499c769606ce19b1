"""Simulate an instrument that moves over the Earth: exact increments, and the true trajectory.

What the instrument feels follows from attitude and velocity, which are functions of time (see
`simulate.path`), and from the position, their integral::

    w_ib_b = w_lb_b + C_bl (w_ie_l + w_el_l)
    f_b    = C_bl (v_l' + (2 w_ie_l + w_el_l) x v_l - g_l)

with all derivatives in closed form. An increment is the integral of these by Gauss-Legendre
quadrature, split where one segment, or the ramp of a profile, ends and another begins: exact to
rounding at any sample rate. It is the integral of the rate in turning body axes, which is what an
instrument puts out, so that coning and sculling are in it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import legendre

from foucault.arrays import FloatArray
from foucault.errors import error, require, require_word
from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import angles_of, body_rate, exp, matrix_of
from foucault.navigate.strapdown import State
from foucault.plans.manoeuvres import Plan, Segment, Start
from foucault.simulate.noise import noisy_log, sampled_log
from foucault.simulate.path import Kinematics, Path, Piece, level_rate, path_of, pieces_of
from foucault.tables import Log, whole_samples

Reading = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_CHUNK = 16384  # times worked on at once: their arrays stay in the cache
_SHORT = 1 / 5  # of a piece's step; over such an interval five nodes give all digits
_FEW = legendre.leggauss(5)
_MANY = legendre.leggauss(8)


@dataclass(frozen=True)
class TrueTrajectory:
    """Where the body truly is."""

    time: FloatArray  # (n,) when [s]
    # latitude, longitude: (n,) geodetic latitude and longitude [rad]
    latitude: FloatArray
    longitude: FloatArray
    height: FloatArray  # (n,) height above the ellipsoid [m]
    velocity_n: FloatArray  # (n, 3) velocity relative to the Earth, frame n [m/s]
    C_nb: FloatArray  # (n, 3, 3) attitude, body to East-North-Up [1]

    @property
    def angles(self) -> FloatArray:
        """Heading, pitch and roll, shape (n, 3) [rad]."""
        return angles_of(self.C_nb)

    def state(self, row: int) -> State:
        """Return the state of a row, negative ones counted from the end.

        `row`: its number [1].
        """
        return State(
            float(self.latitude[row]), float(self.longitude[row]), float(self.height[row]),
            self.velocity_n[row], self.C_nb[row],
        )  # fmt: skip


@dataclass(frozen=True)
class Motion:
    """A motion of the body over the Earth as a function of time. Times are given in order."""

    pieces: list[Piece]  # what the vehicle does, in order; the first ends at time 0 and is steady
    path: Path
    gravity_offset: float = 0.0  # local gravity minus normal gravity [m/s^2]

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.pieces[-1].end

    def truth(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f_b [m/s^2] and w_ib_b [rad/s], shape (n, 3) each.

        `time` (n,): when, in order [s].
        """
        f_b, w_b = np.empty((2, len(time), 3))
        for piece, rows in _stretches(self.pieces, time):
            f_b[rows], w_b[rows] = self._felt(piece, time[rows])
        return f_b, w_b

    def _felt(self, piece: Piece, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        now = piece.at(time)
        v, dv = _velocity(now)
        p, height = self.path.axis_and_height(time)
        earth = EARTH_RATE * p
        moving = level_rate(p, height, v, self.path.carried)
        f = dv + np.cross(2.0 * earth + moving, v)
        f[:, 2] += gravity(np.arcsin(np.clip(p[:, 2], -1.0, 1.0)), height) + self.gravity_offset
        C_vl = np.swapaxes(matrix_of(*now.angles.T), 1, 2)
        f_v = (C_vl @ f[:, :, None])[:, :, 0]
        w_v = (C_vl @ (earth + moving)[:, :, None])[:, :, 0] + body_rate(now.angles, now.rates)
        f_b, w_b = f_v @ piece.C_vb, w_v @ piece.C_vb
        if piece.axis_b is None:
            return f_b, w_b
        back = exp(-piece.axis_b * now.spin[:, None])
        f_b, w_b = (back @ f_b[:, :, None])[:, :, 0], (back @ w_b[:, :, None])[:, :, 0]
        return f_b, w_b + piece.axis_b * now.spin_rate[:, None]

    def increments(
        self, time: FloatArray, reading: Reading | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return dtheta_b [rad] and dvel_b [m/s] between times, shape (n - 1, 3) each.

        `time` (n,): when, in order, at most one first interval may lie before the start [s];
        `reading` or None: true f_b and w_ib_b -> what an instrument integrates instead.
        """
        inner = self.path.edges
        edges = np.union1d(time, inner[(inner > time[0]) & (inner < time[-1])])
        short = _SHORT * min(piece.step for piece in self.pieces)
        x, weight = _FEW if np.diff(time).max() <= short else _MANY
        half = np.diff(edges) / 2
        dtheta, dvel = np.empty((2, len(half), 3))
        step = _CHUNK // len(x)
        for first in range(0, len(half), step):
            rows = slice(first, first + step)
            h = half[rows, None]
            f_b, w_b = self.truth((edges[:-1][rows, None] + h * (1.0 + x)).ravel())
            if reading is not None:
                f_b, w_b = reading(f_b, w_b)
            dvel[rows] = h * (weight @ f_b.reshape(-1, len(x), 3))
            dtheta[rows] = h * (weight @ w_b.reshape(-1, len(x), 3))
        begins = np.searchsorted(edges, time[:-1])
        return np.add.reduceat(dtheta, begins), np.add.reduceat(dvel, begins)

    def trajectory(self, time: FloatArray) -> TrueTrajectory:
        """Return the true trajectory at `time`, shape (n,), in order [s]."""
        C_lb, v_l = np.empty((len(time), 3, 3)), np.empty((len(time), 3))
        for piece, rows in _stretches(self.pieces, time):
            now = piece.at(time[rows])
            C_lb[rows] = matrix_of(*now.angles.T) @ piece.C_vb
            if piece.axis_b is not None:
                C_lb[rows] = C_lb[rows] @ exp(piece.axis_b * now.spin[:, None])
            v_l[rows] = _velocity(now)[0]
        latitude, longitude, height, C_nl = self.path.at(time)
        v_n = (C_nl @ v_l[:, :, None])[:, :, 0]
        return TrueTrajectory(time, latitude, longitude, height, v_n, C_nl @ C_lb)


def motion_of(
    plan: Plan,
    start: Start,
    *,
    headings: Literal["north", "start"] = "north",
    gravity_offset: float = 0.0,
    lead: float = 1.0,
) -> tuple[Motion, list[tuple[str, float, float]]]:
    """Return the motion of a plan, and label, beginning and end [s] of each of its segments.

    `headings`: headings of the plan are from north, or from the direction that was north at the
    start and is carried along without turning about up, for plans that come close to a pole;
    `gravity_offset`: local gravity minus normal gravity [m/s^2]; `lead`: how long the vehicle has
    gone steadily before time 0 [s].
    """
    if headings not in ("north", "start"):
        raise error(
            "manoeuvre.value", key="headings", what="the simulation", given=repr(headings),
            allowed='"north" or "start"',
        )  # fmt: skip
    pieces, spans = pieces_of(plan, start)
    first = pieces[0]
    steady = Piece(-lead, lead, first.speed, first.course, first.climb, first.C_vb)
    pieces = [steady, *pieces]
    edges = np.concatenate([*(piece.joints() for piece in pieces), [pieces[-1].end]])
    edges = np.unique(edges)

    def velocity(time: FloatArray) -> FloatArray:
        out = np.empty((len(time), 3))
        for piece, rows in _stretches(pieces, time):
            out[rows] = _velocity(piece.at(time[rows]))[0]
        return out

    path = path_of(start, edges, velocity, headings == "start")
    return Motion(pieces, path, gravity_offset), spans


@dataclass(frozen=True)
class MotionSimulation:
    """A simulated run."""

    log: Log  # what the instrument said [SI]
    model: ImuModel  # the errors it had
    truth: TrueTrajectory  # where it truly was, at the times of the log
    # label of each segment of the plan, its beginning and end [s]
    labels: list[tuple[str, float, float]]
    motion: Motion  # the motion at any time


def simulate_motion(
    plan: Plan,
    start: Start,
    *,
    rate: float = 100.0,
    model: ImuModel | None = None,
    noise: ImuNoise | None = None,
    sampled: Literal["rate", "increment"] = "increment",
    headings: Literal["north", "start"] = "north",
    gravity_offset: float = 0.0,
    seed: int = 0,
) -> MotionSimulation:
    """Simulate the log of a plan.

    Parameters
    ----------
    plan : sequence of segments
        What the vehicle does, from time 0.
    start : Start
        Where and how it begins.
    rate : float
        Sample rate [Hz].
    model : ImuModel or None
        Errors of the instrument, which act on rates, not on increments; None for none.
    noise : ImuNoise or None
        Its noise [SI]; None for none.
    sampled : {"rate", "increment"}
        Instantaneous rates, or means over the interval before each sample: increments over the
        interval. The first sample is at time 0, after one interval of steady motion.
    headings : {"north", "start"}
        As for `motion_of`.
    gravity_offset : float
        Local gravity minus normal gravity [m/s^2].
    seed : int, shape ()
        Seed of the noise [1].
    """
    require("start", start, Start)
    require("model", model, ImuModel, none=True)
    require("noise", noise, ImuNoise, none=True)
    require_word("sampled", sampled, ("rate", "increment"))
    require("rate", rate, Real)
    require("gravity_offset", gravity_offset, Real)
    if not np.isfinite(gravity_offset):
        raise error("manoeuvre.value", key="gravity_offset", what="the simulation",
                    given=gravity_offset, allowed="a finite number")  # fmt: skip
    require("plan", plan, Sequence)
    for segment in plan:
        require("a segment of the plan", segment, *get_args(Segment))
    model, noise = model or ImuModel(), noise or ImuNoise()
    length = sum(segment.time for segment in plan)
    if not 1.0 <= rate * length < np.inf and plan:
        raise error(
            "manoeuvre.value", key="rate", what="the simulation", given=rate,
            allowed=f"finite and {1.0 / length:.3g} Hz or more, one interval of the plan",
        )  # fmt: skip
    motion, labels = motion_of(
        plan, start, headings=headings, gravity_offset=gravity_offset, lead=1.0 / rate
    )
    samples = whole_samples(np.floor(motion.end * rate + 1e-9)) + 1
    rng = np.random.default_rng(seed)
    if sampled == "rate":
        log = sampled_log(
            motion.truth, samples=samples, rate=rate, sampled=sampled, model=model, noise=noise,
            rng=rng,
        )  # fmt: skip
    else:
        time = np.arange(-1, samples) / rate
        dtheta, dvel = motion.increments(time, model.measure)
        dt = np.diff(time)[:, None]
        log = noisy_log(time[1:], dvel / dt, dtheta / dt, sampled=sampled, noise=noise, rng=rng)
    return MotionSimulation(log, model, motion.trajectory(log.time), labels, motion)


def _velocity(now: Kinematics) -> tuple[FloatArray, FloatArray]:
    """Return v_l and its derivative in l: D(chi) u and D(chi) (u' + chi' (u_y, -u_x, 0))."""
    s, c = np.sin(now.course), np.cos(now.course)
    turn = now.course_rate
    x, y, z = now.u.T
    dx, dy, dz = now.u_rate.T
    dx, dy = dx + turn * y, dy - turn * x
    v = np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
    return v, np.stack([c * dx + s * dy, c * dy - s * dx, dz], axis=-1)


def _stretches(pieces: list[Piece], time: FloatArray) -> Iterator[tuple[Piece, slice]]:
    """Yield each piece with the rows of `time` that are in it, so many at once."""
    starts = np.array([piece.start for piece in pieces[1:]])
    cuts = [0, *np.searchsorted(time, starts), len(time)]
    for piece, first, last in zip(pieces, cuts[:-1], cuts[1:], strict=True):
        for at in range(first, last, _CHUNK):
            yield piece, slice(at, min(at + _CHUNK, last))
