"""From an IMU and poses of its body to parameters: the motion between poses is that of the IMU.

Parameters: ``C_bm``, ``l_b``, ``tau``, ``kappa``, the level of the world, the errors of the IMU and
the delay of its accelerometers. With ``w`` and ``f`` the readings without these errors::

    C' = C [w x],   v' = C f + g_v,   p' = v
    z_C = Log((C C_bm)' C_meas),   z_p = p_meas - p - C l_b,   at t + tau + kappa (t - t_mid)

Two antennas have no attitude: the base ``d_b`` from the first to the second takes the place of the
rotation, and a position ``z_2 = p_2 - p - C (l_b + d_b)``, or a base ``z_2 = d_meas - C d_b`` of a
receiver that measures it by itself, that of ``z_C``. A known length of the base is a reading too.

Nodes are the samples before the poses. A pass is linear about parameters and motion; the motion is
eliminated by the filter of `kernels.pose`, whose white rows are all that is left.

The noise of poses is coloured: their errors come from the cluster of markers, and stay for a while.
They are states beside those of the motion, ``e_k = rho e_k-1 + white``; size and rho are those that
the smoothed errors have with their covariance, again and again, which is maximum likelihood [1].
Where rows are not white even so, the covariance of the fit is too small: the scores of blocks tell
their true scatter, ``P (sum s s') P``, and the two halves of the log whether that holds.

References
----------
.. [1] R. H. Shumway, D. S. Stoffer, "An approach to time series smoothing and forecasting using the
   EM algorithm", Journal of Time Series Analysis 3(4), 1982.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.estimate import two_bodies as bodies
from foucault.estimate.two_bodies import (
    BLOCK,
    COLOURED,
    MOVED,
    ROUND,
    SETTLED,
    Answers,
    Change,
    even,
)
from foucault.infer.gauss_newton import student
from foucault.infer.linear_filter import likeliest
from foucault.infer.shown import shares, shown
from foucault.kernels import pose as kernels
from foucault.models import imu, pose, size_effect
from foucault.models.pose import Second
from foucault.models.rotation import cross, exp, right_jacobian_inverse
from foucault.models.rotation import log as vector_of
from foucault.navigate.increments import increments_of
from foucault.tables import Log, gaps

GYRO = tuple(f"gyro.misalignment.{a}{b}" if a != b else f"gyro.scale.{a}"
             for a in "xyz" for b in "xyz")  # fmt: skip
ACCEL = ("accel.scale.x", "accel.misalignment.yx", "accel.scale.y", "accel.misalignment.zx",
         "accel.misalignment.zy", "accel.scale.z")  # fmt: skip
NAMES = (
    *pose.LAYOUT.names, *(f"gyro.bias.{a}" for a in "xyz"), *(f"accel.bias.{a}" for a in "xyz"),
    *GYRO, *ACCEL, "accel.delay",
)  # fmt: skip
"""Parameters in the order of the columns of `kernels.pose`."""

OF_ANTENNAS = (*pose.BASE.names, *NAMES[3:])
"""The same where a base is in place of the rotation."""

LAYOUT = Layout(
    (*imu.LAYOUT.coefficients, *size_effect.OFFSET.coefficients, *pose.LAYOUT.coefficients,
     *pose.BASE.coefficients)
)  # fmt: skip
"""What a campaign may name."""

USUAL = {
    "pose.rotation": np.pi / np.sqrt(3), "pose.lever": 0.5, "pose.delay": 0.2, "pose.clock": 0.01,
    "pose.level": 0.5, "pose.base": 5.0, "gyro.bias": 0.2, "accel.bias": 2.0, "gyro.scale": 0.03,
    "gyro.misalignment": 0.03, "accel.scale": 0.03, "accel.misalignment": 0.03,
    "accel.delay": 0.01,
}  # fmt: skip
"""Standard deviations beforehand where nothing else is said, about the start [SI]."""

CUT = 5.0
"""A pose that is off by so many standard deviations is left out [1]."""

STUDENT = 4.0
"""Degrees of freedom of the errors of poses before they are told from outliers [1]."""

NOISY, ALONE = (1, 3), (8,)
"""Passes in which what the motion shows is told from what its noise does, before all has settled;
positions alone start too far off to tell [1]."""

DECIDED = 5
"""Passes after which the noise of the poses, and which are left out, is decided [1]."""

COLOUR_FROM = 4
"""Pass from which on colour is looked for: before, what a start has wrong looks like it [1]."""

LOUD = 3.0
"""Noise is too much that is so many times what most poses have [1]."""

SLOWEST = 0.98
"""Correlation of a pose's error with the next that is counted with at most [1]."""

FRESH = 0.01
"""Part of an error that stays which is not like the one before, so that rows keep a noise [1]."""

AGAIN, ALIKE = 20, 0.003
"""Times that the noise of poses is found from what it makes of them, at most, and by what part it
still moves then [1]."""

LAGGED = 3.0
"""Correlation of a pose's error with the next beyond so many standard deviations counts [1]."""

START_SD = np.repeat([10.0, 20.0, 20.0], 3)
"""How far the motion at the first node may be from where it starts: anywhere [rad, m/s, m]."""


@dataclass(frozen=True)
class Point:
    """Parameters, and the motion at the nodes."""

    C_bm: FloatArray  # (3, 3) axes of the tracked body to those of the IMU [1]
    lever_b: FloatArray  # (3,) from the accelerometers to the tracked point [m]
    tau: float  # [s]
    kappa: float  # [1]
    up_v: FloatArray  # (3,) up in the world of the pose [1]
    gyro: tuple[FloatArray, FloatArray]  # bias (3,) [rad/s], S + M (3, 3) [1]
    accel: tuple[FloatArray, FloatArray]  # bias (3,) [m/s^2], S + M (3, 3), lower [1]
    late: float  # of the accelerometers [s]
    node: IntArray  # (m,) sample before each pose
    C: FloatArray  # (m, 3, 3) attitude of the IMU, world of the pose [1]
    v: FloatArray  # (m, 3) velocity of its accelerometers [m/s]
    p: FloatArray  # (m, 3) their position [m]
    base_b: FloatArray | None = None  # (3,) from the first antenna to the second [m]

    @cached_property
    def tilt(self) -> FloatArray:
        """Rotation vector from the z axis of the world to up, shape (3,) [rad]."""
        axis = np.array([-self.up_v[1], self.up_v[0], 0.0])  # z x up
        sine = float(np.linalg.norm(axis))
        angle = np.arctan2(sine, self.up_v[2])
        return axis * (angle / sine) if sine > 1e-12 else np.array([angle, 0.0, 0.0])

    @property
    def values(self) -> FloatArray:
        """Parameters in the order of `NAMES`, shape (32,) [SI]."""
        return np.concatenate([
            vector_of(self.C_bm) if self.base_b is None else self.base_b, self.lever_b,
            [self.tau, self.kappa], self.tilt[:2],
            self.gyro[0], self.accel[0], self.gyro[1].ravel(),
            self.accel[1][np.tril_indices(3)], [self.late],
        ])  # fmt: skip

    @cached_property
    def across(self) -> FloatArray:
        """Two directions across up, of the tilts about x and y, shape (3, 2) [1]."""
        T = exp(self.tilt)
        return np.column_stack([-T[:, 1], T[:, 0]])

    def moved(self, delta: FloatArray, x: FloatArray) -> Point:
        """Return the point a step away: `delta` (32,) of the parameters, `x` (m, 9) [SI]."""
        up = self.up_v + self.across @ delta[8:10]
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = delta[25:31]
        base = None if self.base_b is None else self.base_b + delta[:3]
        return replace(
            self, C_bm=self.C_bm if self.base_b is not None else self.C_bm @ exp(delta[:3]),
            base_b=base, lever_b=self.lever_b + delta[3:6],
            tau=self.tau + delta[6], kappa=self.kappa + delta[7], up_v=up / np.linalg.norm(up),
            gyro=(self.gyro[0] + delta[10:13], self.gyro[1] + delta[16:25].reshape(3, 3)),
            accel=(self.accel[0] + delta[13:16], self.accel[1] + lower),
            late=self.late + delta[31], C=self.C @ exp(x[:, :3]), v=self.v + x[:, 3:6],
            p=self.p + x[:, 6:],
        )  # fmt: skip

    def of_values(self) -> FloatArray:
        """Return the derivative of `values` by a step, shape (32, 32) [SI]."""
        out = np.eye(32)
        if self.base_b is None:
            out[:3, :3] = right_jacobian_inverse(vector_of(self.C_bm))
        for c, across in enumerate(self.across.T):
            up = self.up_v + 1e-6 * across
            tilt = replace(self, up_v=up / np.linalg.norm(up)).tilt
            out[8:10, 8 + c] = (tilt - self.tilt)[:2] / 1e-6
        return out


@dataclass(frozen=True)
class Readings:
    """What is compared: samples of the IMU, and poses."""

    time: FloatArray  # (n,) ends of the intervals [s]
    dt: FloatArray  # (n,) [s]
    dtheta: FloatArray  # (n, 3) increments of angle as read [rad]
    dvel: FloatArray  # (n, 3) increments of velocity as read [m/s]
    rise: FloatArray  # (n, 3) by how much the specific force grew over the interval [m/s^2]
    stamp: FloatArray  # (m,) of the poses [s]
    middle: float  # middle of all stamps [s]
    position: FloatArray  # (m, 3) [m]
    C_vm: FloatArray | None  # (m, 3, 3) [1]
    broken: IntArray  # (n,) how many gaps of the log lie before each sample [1]
    white: tuple[float, float]  # of gyros and accelerometers [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]
    gravity: tuple[float, float]  # and its standard uncertainty [m/s^2]
    log: Log
    jumped: IntArray  # (m,) how often the world has jumped before each pose [1]
    second: Second | None = None  # antenna; a direction has the known length of its base
    length: tuple[float, float] | None = None  # of the base, and its uncertainty [m]

    @cached_property
    def measured(self) -> BoolArray:
        """Return what there is of each pose, (m, 6)."""
        two = np.isfinite(self.position[:, 0])
        one = np.full(len(two), self.C_vm is not None)
        if self.second is not None:
            one = np.isfinite(self.second.place[:, 0])
        out = np.repeat(np.column_stack([one, two]), 3, axis=1)
        out[:, 0] &= self.second is None or self.second.told != "direction"  # along the base
        return out

    @property
    def place(self) -> FloatArray:
        """Return the positions, (m, 3), on lines where the first antenna was lost [m]."""
        ok = np.isfinite(self.position[:, 0])
        return self.position if ok.all() else even(self.stamp[ok], self.position[ok], self.stamp)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters, 32 of them."""
        return NAMES if self.second is None else OF_ANTENNAS

    @classmethod
    def of(
        cls, log: Log, stamp: FloatArray, position: FloatArray, C_vm: FloatArray | None,
        white: tuple[float, float], gravity: tuple[float, float],
    ) -> Readings:  # fmt: skip
        """Take a log and poses.

        `stamp` (m,) [s], `position` (m, 3) [m], `C_vm` (m, 3, 3) or None [1]; `white`: of gyros and
        accelerometers [SI]; `gravity` and its standard uncertainty [m/s^2].
        """
        x = increments_of(log, gaps="bridge")
        assert log.accel is not None
        f = x.dvel_b / x.dt[:, None]
        rise = np.gradient(f, axis=0)
        if log.sampled == "rate" and len(x) == len(log):
            rise = np.diff(log.accel, axis=0, prepend=log.accel[:1])
        broken = np.cumsum(gaps(x.dt).astype(int))
        return cls(x.time, x.dt, x.dtheta_b, x.dvel_b, rise, stamp, float(stamp[0] + stamp[-1]) / 2,
                   position, C_vm, broken, white, gravity, log,
                   np.zeros(len(stamp), int))  # fmt: skip

    def noisy(self, noise: Noise, rng: np.random.Generator) -> Readings:
        """Return the same readings with their noise once more."""
        g, a = (w / np.sqrt(self.log.interval) * rng.standard_normal((len(self.log), 3))
                for w in self.white)  # fmt: skip
        assert self.log.gyro is not None and self.log.accel is not None
        log = replace(self.log, gyro=self.log.gyro + g, accel=self.log.accel + a)
        turn, move = (sd * _drawn(len(self.stamp), rho, rng) for sd, rho in
                      zip((noise.attitude, noise.position), noise.stays, strict=True))  # fmt: skip
        C = None if self.C_vm is None else self.C_vm @ exp(turn)
        made = Readings.of(log, self.stamp, self.position + move, C, self.white, self.gravity)
        second = self.second and replace(self.second, place=self.second.place + turn)
        return replace(made, middle=self.middle, jumped=self.jumped, second=second,
                       length=self.length)  # fmt: skip

    def __getitem__(self, rows: BoolArray | slice) -> Readings:
        """Return the readings with some of the poses."""
        C = None if self.C_vm is None else self.C_vm[rows]
        other = None if self.second is None else self.second[rows]
        return replace(self, stamp=self.stamp[rows], position=self.position[rows], C_vm=C,
                       jumped=self.jumped[rows], second=other)  # fmt: skip

    def scaled(self, by: float) -> Readings:
        """Return the readings with places that are so many times as large, `by` [1]."""
        other = self.second
        if other is not None and other.told != "direction":
            other = replace(other, place=by * other.place)
        return replace(self, position=by * self.position, second=other)

    def at(self, tau: float, kappa: float) -> FloatArray:
        """Return when the poses held by the clock of the IMU, shape (m,) [s].

        `tau`: offset [s]; `kappa`: rate of the clocks [1].
        """
        return np.asarray(self.stamp + tau + kappa * (self.stamp - self.middle))

    def nodes(self, tau: float, kappa: float) -> IntArray:
        """Return the sample before each pose, shape (m,); `tau`: offset [s]; `kappa`: rate [1]."""
        found = np.searchsorted(self.time, self.at(tau, kappa), side="right") - 1
        return np.clip(found, 1, len(self.time) - 3)


@dataclass(frozen=True)
class Corrected:
    """Increments without the errors of a point."""

    # K_g, K_a: (3, 3) inverse of I + S + M of gyros and of accelerometers [1]
    K_g: FloatArray
    K_a: FloatArray
    theta: FloatArray  # (n, 3) rotation vectors, coning added [rad]
    raw_g: FloatArray  # (n, 3) without coning [rad]
    force: FloatArray  # (n, 3) velocity in axes of the beginning, sculling added [m/s]
    raw_a: FloatArray  # (n, 3) without [m/s]
    middle: FloatArray  # (n, 3) position in axes of the beginning [m]
    late: FloatArray  # (n, 3) derivative by the delay of the accelerometers [m/s^2]


def corrected(r: Readings, at: Point) -> Corrected:
    """Take the errors of a point away from the increments [SI]."""
    K_g = np.asarray(np.linalg.inv(np.eye(3) + at.gyro[1]), float)
    K_a = np.asarray(np.linalg.inv(np.eye(3) + at.accel[1]), float)
    th = (r.dtheta - at.gyro[0] * r.dt[:, None]) @ K_g.T
    u = (r.dvel + at.late * r.rise - at.accel[0] * r.dt[:, None]) @ K_a.T
    before, less = np.vstack([th[:1], th[:-1]]), np.vstack([u[:1], u[:-1]])
    coned = th + cross(before, th) / 12
    turned = cross(th, u)
    again = cross(th, turned)
    sculled = u + turned / 2 + again / 6 + (cross(before, u) + cross(less, th)) / 12
    half = r.dt[:, None] * (u / 2 - (u - less) / 12 + turned / 6 + again / 24)
    return Corrected(K_g, K_a, coned, th, sculled, u, half, r.rise @ K_a.T)


@dataclass(frozen=True)
class Noise:
    """Of the poses."""

    attitude: float  # [rad]; of a second antenna [m]
    position: float  # [m]
    weights: FloatArray  # (m, 2) what attitude and position of each pose count [1]
    stays: tuple[float, float] = (0.0, 0.0)  # correlation of an error with that before [1]

    @property
    def sd(self) -> FloatArray:
        """Of the numbers of a pose, (6,): attitude [rad] before position [m]."""
        return np.repeat([self.attitude, self.position], 3)


@dataclass(frozen=True)
class Pass:
    """One linearisation: the motion filtered, and eliminated."""

    nu: FloatArray  # (m, 6) white, NaN-free; zero where nothing was measured [1]
    M: FloatArray  # (m, 6, 32) their derivative by the parameters [1 / SI]
    used: BoolArray  # (m, 6)
    about: Linear
    noise: Noise
    fed: tuple[FloatArray, ...]  # what `kernels.forward` took, but for D [SI]

    def smoothed(self, delta: FloatArray, spread: bool = False) -> Smoothed:
        """Return the motion's step for that of the parameters, `delta` (32,) [SI].

        `spread`: find its covariance too.
        """
        return smoothed(self.about, self.fed, delta, spread)

    @property
    def rows(self) -> FloatArray:
        """Derivatives of all white rows, (6 m, 32) [1 / SI]."""
        return self.M.reshape(-1, 32)

    @cached_property
    def information(self) -> FloatArray:
        """Of the parameters by these rows, (32, 32) [1 / SI^2]."""
        return self.rows.T @ self.rows

    def left(self, delta: FloatArray) -> FloatArray:
        """Return the white rows after a step `delta` (32,) [SI], (m, 6) [1]."""
        return self.nu - (self.rows @ delta).reshape(self.nu.shape)


@dataclass(frozen=True)
class Smoothed:
    """A step of the motion, and how well poses are known once it is."""

    x: FloatArray  # (m, 9) [SI]
    absorbed: FloatArray  # (m, 6) variance of what poses should be, if asked [rad^2], [m^2]
    following: FloatArray  # (m, 6) covariance with the next, none where noise is white
    # What is filtered, (m, d) and (m, d, d), and then smoothed, if asked [SI]
    states: tuple[FloatArray, ...]


class Room(dict[str, FloatArray]):
    """Large arrays of a pass, for the next one to be written over: new memory costs as much."""

    def array(self, name: str, *shape: int) -> FloatArray:
        """Return the array of a name as it was left, at first zeros of a `shape` [1]."""
        if name not in self or self[name].shape != shape:
            self[name] = np.zeros(shape)
        return self[name]


def compared(
    r: Readings, at: Point, c: Corrected, columns: int, room: Room
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compare poses with a point [SI].

    Returns poses less it (m, 6), attitude [rad] or second antenna before position [m]; what that
    changes by with the motion (m, 6, 9) and with the first `columns` parameters, none or 32 [SI].
    """
    m, none = len(r.stamp), np.zeros((0, 3))
    z, H, D = np.zeros((m, 6)), np.zeros((m, 6, 9)), room.array("D", m, 6, columns)
    arm, share, kind = np.zeros(3), 0.0, int(r.C_vm is not None)
    if r.second is not None:
        assert at.base_b is not None
        share, kind = float(r.second.told == "position"), 2 + (r.second.told == "direction")
        arm = at.base_b + share * at.lever_b
    kernels.compared(
        at.node, r.at(at.tau, at.kappa) - r.time[at.node], r.stamp - r.middle, r.dt, c.theta,
        c.force, c.raw_g, c.K_g, at.C, at.v, at.p, -r.gravity[0] * at.up_v, at.C_bm, at.lever_b,
        arm, share, kind, r.position, none if r.second is None else r.second.place,
        np.zeros((0, 3, 3)) if r.C_vm is None else np.ascontiguousarray(r.C_vm), z, H, D,
    )  # fmt: skip
    return np.where(r.measured, z, 0.0), H, D


def misses(r: Readings, at: Point) -> FloatArray:
    """Return poses less those of a point, (m, 6): attitude [rad] before position [m]."""
    return compared(r, at, corrected(r, at), 0, Room())[0]


@dataclass(frozen=True)
class Linear:
    """Motion and poses about a point, whatever the noise of the poses."""

    at: Point
    hold: IntArray  # (k,) numbers of parameters that are not estimated [1]
    moved: FloatArray  # (m, 16) from the node before: see `kernels.pose` [SI]
    J: FloatArray  # (m, 9, 22) its derivative by errors of the IMU [SI]
    Q: FloatArray  # (m, 9, 9) its covariance [SI]
    u: FloatArray  # (m, 9) what was moved less that of the point [SI]
    z: FloatArray  # (m, 6) poses less those of the point [rad], [m]
    H: FloatArray  # (m, 6, 9) their derivative by the motion [SI]
    D: FloatArray  # (m, 6, p) and by the parameters [SI]
    G: FloatArray  # (3, 2) of gravity by level [m/s^2]
    C: FloatArray  # (m, 3, 3) attitude [1]


def linear(
    r: Readings, at: Point, hold: IntArray, motion: bool = False, room: Room | None = None
) -> Linear:
    """Linearise about a point.

    `hold` (k,): numbers of parameters that are not estimated [1]; `motion`: alone, without any
    parameters; `room`: of a pass that is not needed any more.
    """
    room = Room() if room is None else room
    m, c = len(r.stamp), corrected(r, at)
    moved, Q = np.zeros((m, 16)), room.array("Q", m, 9, 9)
    J = room.array("J", 0 if motion else m, 9, 22)
    kernels.preintegrate(at.node, r.dt, c.theta, c.force, c.middle, c.K_g, c.K_a, c.raw_g, c.raw_a,
                         c.late, r.white[0]**2, r.white[1]**2, moved, J, Q)  # fmt: skip
    g_v, T = -r.gravity[0] * at.up_v, moved[1:, 15:]
    u = np.zeros((m, 9))
    C, turn = at.C[:-1], moved[1:, :9].reshape(-1, 3, 3)
    u[1:, :3] = vector_of(np.swapaxes(at.C[1:], 1, 2) @ C @ turn)
    u[1:, 3:6] = at.v[:-1] + g_v * T + np.einsum("kij,kj->ki", C, moved[1:, 9:12]) - at.v[1:]
    u[1:, 6:] = (at.p[:-1] + at.v[:-1] * T + g_v * T**2 / 2
                 + np.einsum("kij,kj->ki", C, moved[1:, 12:15]) - at.p[1:])  # fmt: skip
    # Nothing leads over a gap, nor into a world that has jumped.
    apart = np.flatnonzero(np.diff(r.broken[at.node] + r.jumped, prepend=0))
    u[apart], Q[apart] = 0.0, np.diag(START_SD**2)
    z, H, D = compared(r, at, c, 0 if motion else 32, room)
    if not motion:
        D[:, :, hold] = J[:, :, hold[hold >= 10] - 10] = J[apart] = 0.0
    G = -r.gravity[0] * at.across
    return Linear(at, hold, moved, J, Q, u, z, H, D, 0.0 * G if 8 in hold else G, at.C)


def one_pass(
    r: Readings, at: Point, noise: Noise, hold: IntArray, motion: bool = False,
    room: Room | None = None,
) -> Pass:  # fmt: skip
    """Linearise about a point and eliminate the motion.

    `hold` (k,): numbers of parameters that are not estimated [1]; others as of `linear`.
    """
    return eliminated(r, linear(r, at, hold, motion, room), noise, room)


def eliminated(r: Readings, about: Linear, noise: Noise, room: Room | None = None) -> Pass:
    """Filter the motion away."""
    used, fed = _fed(r, about, noise)
    m, p = len(r.stamp), about.D.shape[2]
    nu, M = np.empty((m, 6)), (Room() if room is None else room).array("M", m, 6, p)
    d = fed[4].shape[1]
    fine = kernels.forward(*fed[:10], about.D, *fed[10:], nu, M, np.empty((0, d)),
                           np.empty((0, d, d)))  # fmt: skip
    if not fine or not np.isfinite(nu).all():
        raise np.linalg.LinAlgError("the motion between two poses has no covariance")
    return Pass(nu, M, used, about, noise, fed)


def _fed(
    r: Readings, about: Linear, noise: Noise
) -> tuple[BoolArray, tuple[FloatArray, ...]]:  # fmt: skip
    """Return what is used of the poses (m, 6), and what `kernels.forward` takes but D.

    Errors of poses that stay are states of the motion.
    """
    m, n = len(r.stamp), 6 * any(noise.stays)
    weights = np.repeat(noise.weights, 3, axis=1)
    used = (weights > 0) & r.measured
    R = np.where(used, noise.sd**2 / np.where(used, weights, 1.0), np.inf)
    R = FRESH**2 * R if n else R
    since = np.diff(r.stamp, prepend=2 * r.stamp[0] - r.stamp[1]) / np.median(np.diff(r.stamp))
    keep = np.repeat(noise.stays, 3)[:n] ** since[:, None]
    start = np.diag(np.concatenate([START_SD, noise.sd[:n]]) ** 2)
    H, u = about.H, about.u
    if n:
        H = np.concatenate([H, np.tile(np.eye(6), (m, 1, 1))], axis=2)
        u = np.pad(u, ((0, 0), (0, n)))
    return used, (about.C, about.moved, about.J, about.Q, u, about.G, keep, noise.sd[:n] ** 2,
                  about.z, H, R, start)  # fmt: skip


def smoothed(
    about: Linear, fed: tuple[FloatArray, ...], delta: FloatArray, spread: bool = False
) -> Smoothed:
    """Return the motion's step for that of the parameters.

    `about`, `fed`: where, and what is filtered there [SI]; `delta` (p,): that of the parameters
    [SI]; `spread`: find its covariance too.
    """
    C, moved, J, Q, u, G, keep, stays, z, H, R, start = fed
    u, m, d = u.copy(), *u.shape
    if len(delta):
        z = z - (about.D.reshape(-1, len(delta)) @ delta).reshape(z.shape)
        T, a = moved[1:, 15:], (J[1:].reshape(-1, 22) @ delta[10:]).reshape(-1, 3, 3)
        u[1:, :3] += a[:, 0]
        u[1:, 3:9] += (a[:, 1:] @ np.swapaxes(C[:-1], 1, 2)).reshape(-1, 6)
        u[1:, 3:9] += np.hstack([T * (G @ delta[8:10]), T**2 / 2 * (G @ delta[8:10])])
    x, P, none = np.empty((m, d)), np.empty((m, d, d)), np.empty((m, 6, 0))
    nu, following = np.empty((m, 6)), np.zeros((m, d - 9))
    fine = kernels.forward(C, moved, J, Q, u, G, keep, stays, z, H, none, R, start, nu, none, x, P)
    states = (x.copy(), P.copy(), x, P) if spread else ()
    if not (
        fine
        and np.isfinite(nu).all()
        and kernels.backward(C, moved, Q, u, keep, stays, spread, x, P, following)
    ):
        raise np.linalg.LinAlgError("the motion between two poses has no covariance")
    H = H[:, :, :9]
    absorbed = np.sum(H @ P[:, :9, :9] * H, axis=2) if spread else np.zeros((m, 6))
    return Smoothed(x[:, :9], absorbed, following, states)


def of_noise(
    r: Readings, at: Point, p: Pass, noise: Noise, hold: IntArray, room: Room
) -> FloatArray:
    """Return the information that noise makes by itself, (32, 32): see `infer.shown` [1 / SI^2].

    `hold` (k,): numbers of parameters that are not estimated [1].
    """
    again = r.noisy(noise, np.random.default_rng(0))
    about = linear(again, at, hold, motion=True)
    x = smoothed(about, _fed(again, about, noise)[1], np.zeros(0)).x
    off = one_pass(again, at.moved(np.zeros(32), x), noise, hold, room=room).rows - p.rows
    return np.asarray(off.T @ off)


@dataclass(frozen=True)
class Solution:
    """What was found."""

    readings: Readings
    point: Point
    last: Pass
    step: FloatArray  # (32,) of the parameters, from where the last pass is linear [SI]
    made: FloatArray  # (32, 32) information that noise makes by itself [1 / SI^2]
    noise: Noise
    cov: FloatArray  # (32, 32) as it is stated [SI]
    formal: FloatArray  # (32, 32) as if their noise were white, and gravity known [SI]
    of_gravity: FloatArray  # (32,) what one standard uncertainty of gravity makes of each [SI]
    spread: float  # by how much scores scatter more than white rows, as an sd [1]
    halves: float  # rms of the difference of the halves over its sd [1]
    lag_one: tuple[float, float]  # correlation of errors of attitude and position with the next [1]
    passes: int  # that were made [1]
    converged: bool
    prior_sd: FloatArray  # (32,)
    hold: IntArray  # (k,) numbers of parameters that were not estimated [1]

    @property
    def rows(self) -> FloatArray:
        """White rows after the last step, (m, 6), NaN where nothing is used [1]."""
        return np.where(self.last.used, self.last.nu, np.nan)

    @property
    def residuals(self) -> FloatArray:
        """Poses less those that were found, (m, 6): attitude [rad] before position [m]."""
        return misses(self.readings, self.point)

    @property
    def unseen(self) -> BoolArray:
        """Parameters that the motion does not show: as uncertain as they were, (32,)."""
        return np.sqrt(np.diag(self.cov)) > 0.5 * self.prior_sd


def solve(
    r: Readings,
    start: Point,
    known: Mapping[str, tuple[float, float]],
    sd: tuple[float | None, float | None],
    *,
    robust: bool = True,
    most: int = 30,
    hold: IntArray | None = None,
) -> Solution:
    """Pass by pass, from a start.

    `known`: mean and sd of parameters beforehand, by name [SI]; `sd`: of attitude [rad] and
    position [m] of the poses, None where it is found; `most`: passes [1]; `hold` (k,): numbers of
    parameters that are not estimated [1].
    """
    mean, prior_sd = _prior(start, known, r.names)
    hold = np.zeros(0, int) if hold is None else hold
    m = len(r.stamp)
    usual = np.radians(0.3) if r.second is None else 2e-3
    noise = Noise(sd[0] or usual, sd[1] or 2e-3, np.ones((m, 2)))
    at, cost, settled, passes, told = start, np.inf, False, 0, False
    made, room, other = np.zeros((32, 32)), Room(), Room()
    about = linear(r, at, hold, room=room)
    for passes in range(1, most + 1):
        p = eliminated(r, about, noise, room)
        if passes in (NOISY if r.C_vm is not None else ALONE) or told:
            made = of_noise(r, at, p, noise, hold, other)
        off = np.asarray(np.linalg.solve(at.of_values(), mean - at.values), float)
        delta, moved = _step(r, p, made, off, prior_sd)
        last, cost = cost, float(np.sum(p.left(delta)[p.used] ** 2))
        still = passes > 3 and moved < SETTLED and abs(last - cost) < 1e-3 * max(cost, 1e-12)
        # The noise was decided when all was still far off, and what stays is not found at once.
        again = not told and (passes > DECIDED + 2 or any(noise.stays))
        if still and not told and not again and passes > DECIDED:
            # What the motion shows is asked once more where all has settled.
            made, told = of_noise(r, at, p, noise, hold, other), True
            delta, moved = _step(r, p, made, off, prior_sd)
        motion = p.smoothed(delta, spread=passes <= DECIDED)
        # Terms of second order make a start that is far off overshoot: as far as can be linear.
        size = max(1.0, float(np.abs(delta[:3]).max()) / 0.5, float(np.abs(delta[6])) / 0.05)
        at = _on_nodes(r, at.moved(delta / size, motion.x / size))
        room, other = other, room  # the pass that is behind is still asked
        about = linear(r, at, hold, room=room)
        # A pose at the edge of the cut would come and go for ever; wild ones must not stay hidden.
        if passes <= DECIDED or (robust and _loud(r, about.z, noise, sd)):
            motion = motion if passes <= DECIDED else p.smoothed(delta, spread=True)
            noise = _weighed(r, about.z, motion, noise, sd, student=passes <= 2, robust=robust,
                             colour=passes >= COLOUR_FROM)  # fmt: skip
        same = bool(((noise.weights > 0.5) == (p.noise.weights > 0.5)).all())
        settled = still and moved < SETTLED and same
        if settled and told:
            break
        if settled and again:
            noise = _decided(r, about, noise, sd, robust=robust)
        told = told or settled
    if not settled or noise is not p.noise:
        p, delta = eliminated(r, about, noise, room), np.zeros(32)
    return _stated(r, at, p, delta, made, prior_sd, hold, passes, settled)


def _step(
    r: Readings, p: Pass, made: FloatArray, off: FloatArray, prior_sd: FloatArray
) -> tuple[FloatArray, float]:
    """Return the step (32,) [SI], and the largest part of its sd by which one moves [1]."""
    told, score = _length(r, p.about.at)
    seen = shown(p.information + told, made, prior_sd)
    delta = seen.step(p.rows.T @ p.nu.ravel() + score, off, prior_sd)
    delta[p.about.hold] = 0.0
    return delta, float(np.max(np.abs(delta) / np.sqrt(np.diag(seen.covariance(prior_sd)))))


def _loud(
    r: Readings, left: FloatArray, noise: Noise, sd: tuple[float | None, float | None]
) -> bool:
    """Tell whether the noise that was found is far more than most of what is `left` (m, 6) [SI].

    It is so after a bad start.
    """
    off, ok = np.abs(left), r.measured
    z = np.array([np.median(x[o]) if o.any() else np.inf for x, o in
                  ((off[:, :3], ok[:, :3]), (off[:, 3:], ok[:, 3:]))]) * 1.4826 * LOUD  # fmt: skip
    found = z < (noise.attitude, noise.position)  # colour widens all of them: it hides none
    return bool((found & [given is None for given in sd]).any())


def _length(r: Readings, at: Point) -> tuple[FloatArray, FloatArray]:
    """Return information (32, 32) and score (32,) of a known length of the base [1 / SI^2]."""
    row = np.zeros(32)
    if r.length is None or at.base_b is None:
        return np.zeros((32, 32)), row
    length, sd = r.length
    found = float(np.linalg.norm(at.base_b))
    row[:3] = at.base_b / found / sd
    return np.outer(row, row), row * (length - found) / sd


def _prior(
    start: Point, known: Mapping[str, tuple[float, float]], names: tuple[str, ...]
) -> tuple[FloatArray, FloatArray]:
    mean, sd = start.values.copy(), np.zeros(32)
    for i, name in enumerate(names):
        sd[i] = USUAL[name.rpartition(".")[0] if name.rpartition(".")[0] in USUAL else name]
        if name.startswith(("gyro.", "accel.", "pose.lever")):
            mean[i] = 0.0
        for given, (value, spread) in known.items():
            if name == given or name.startswith(given + "."):
                mean[i], sd[i] = value, spread
    return mean, sd


def _on_nodes(r: Readings, at: Point) -> Point:
    """Carry the motion to the samples before the poses, where the offset has moved by samples."""
    node = r.nodes(at.tau, at.kappa)
    if np.abs(r.time[node] - r.time[at.node]).max() < 1.5 * float(np.median(r.dt)):
        return at
    c = corrected(r, at)
    dt = r.dt[at.node + 1, None]
    w, f = c.theta[at.node + 1] / dt, c.force[at.node + 1] / dt
    d = (r.time[node] - r.time[at.node])[:, None]
    a = np.einsum("kij,kj->ki", at.C, f) - r.gravity[0] * at.up_v
    return replace(at, node=node, C=at.C @ exp(w * d), v=at.v + a * d,
                   p=at.p + at.v * d + a * d**2 / 2)  # fmt: skip


def _decided(
    r: Readings, about: Linear, noise: Noise, sd: tuple[float | None, float | None], *, robust: bool
) -> Noise:
    """Find the noise of the poses again until it stays, about a point that does."""
    for _ in range(AGAIN):
        before = noise
        motion = smoothed(about, _fed(r, about, noise)[1], np.zeros(0), spread=True)
        noise = _weighed(r, about.z, motion, noise, sd, student=False, robust=robust, colour=True)
        now, last = (np.array([n.attitude, n.position, *1 - np.array(n.stays)])
                     for n in (noise, before))  # fmt: skip
        if (np.abs(now - last) < ALIKE * last).all():
            break
    return noise


def _weighed(
    r: Readings, left: FloatArray, motion: Smoothed, noise: Noise,
    sd: tuple[float | None, float | None], *, student: bool, robust: bool, colour: bool,
) -> Noise:  # fmt: skip
    """Find the noise of the poses from what is `left` (m, 6) [SI], and what each of them counts."""
    ok = r.measured
    sds, weights = [noise.attitude, noise.position], np.ones_like(noise.weights)
    stays = list(noise.stays)
    for k in range(2):
        own = slice(3 * k, 3 * k + 3)
        if not ok[:, own].any():
            continue
        off, absorbed = left[:, own], motion.absorbed[:, own] * ok[:, own]
        kept = (noise.weights[:, k] > 0.5) & ok[:, 3 * k + 1]
        given = sd[k]
        if given is None:
            # Of what is left R (1 - leverage) is seen.
            free = 1 - np.minimum(absorbed / sds[k] ** 2 * noise.weights[:, k, None], 0.98)
            middle = 1.4826 * float(np.median((np.abs(off) / np.sqrt(free))[ok[:, own]]))
            free *= ok[:, own]
            if student or kept.sum() < 10:
                sds[k] = middle
            else:
                sds[k] = float(np.sqrt(np.sum(off[kept] ** 2) / np.sum(free[kept])))
                if robust:  # from a start that is far off, wild poses would hide in a large noise
                    sds[k] = min(sds[k], 1.5 * middle)
            sds[k] = max(sds[k], 1e-7)
        if robust:
            square = np.sum((off / sds[k]) ** 2, axis=1)
            far = (np.abs(off) > CUT * sds[k]).any(axis=1)
            weights[:, k] = (
                (STUDENT + 3) / (STUDENT + square) if student else np.where(far, 0.0, 1.0)
            )
        if not colour:
            continue
        if motion.following.size:  # what was followed is like the next one's too
            both = kept[1:] & kept[:-1]
            like = off[1:] * off[:-1] + motion.following[:-1, own]
            rho = float(np.sum(like[both]) / np.sum((off**2 + absorbed)[1:][both]))
        else:
            rho = _lag_one(off, kept)
            rho = rho if rho > LAGGED / np.sqrt(kept.sum()) else 0.0
        stays[k] = float(np.clip(rho, 0.0, SLOWEST))
    return Noise(sds[0], sds[1], weights, (stays[0], stays[1]))


def _drawn(count: int, rho: float, rng: np.random.Generator) -> FloatArray:
    """Return noise of variance 1 whose correlation with the next is `rho` [1], (count, 3) [1]."""
    white = rng.standard_normal((count, 3))
    if not rho:
        return white
    white[1:] *= np.sqrt(1 - rho**2)
    each = [list(accumulate(axis, lambda last, new: new + rho * last)) for axis in white.T.tolist()]
    return np.array(each).T


def _stated(
    r: Readings, at: Point, p: Pass, delta: FloatArray, made: FloatArray, prior_sd: FloatArray,
    hold: IntArray, passes: int, settled: bool,
) -> Solution:  # fmt: skip
    """Return what is stated of a point a last step `delta` (32,) [SI] from that of a pass."""
    seen = shown(p.information + _length(r, at)[0], made, prior_sd)
    formal, noise = seen.covariance(prior_sd), p.noise
    left, M = p.left(delta), (p.rows @ seen.onto.T).reshape(p.M.shape)
    block = ((r.stamp - r.stamp[0]) / BLOCK).astype(int)
    scores, first = np.zeros((block.max() + 1, 32)), np.flatnonzero(np.diff(block, prepend=-1))
    scores[block[first]] = np.add.reduceat(np.einsum("kqp,kq->kp", M, left), first)
    gain = np.asarray(np.linalg.inv(seen.information + np.diag(prior_sd**-2.0)), float)
    ratio, told, spread = bodies.scatter(scores, gain, formal, prior_sd)
    wide = np.ones(32)
    if spread > COLOURED:
        wide[told] = np.maximum(ratio * student(block.max()), 1.0)[told]
    # The halves: what each of them says alone, all rows being independent of one another.
    found, covs = [], []
    for rows in (block < (block.max() + 1) / 2, block >= (block.max() + 1) / 2):
        own = M[rows].reshape(-1, 32)
        half = np.linalg.inv(own.T @ own + np.diag(1 / prior_sd**2))
        found.append(half @ (own.T @ left[rows].ravel()))
        covs.append(half @ (own.T @ own) @ half)
    own = np.flatnonzero(told & (np.diag(covs[0] + covs[1]) < prior_sd**2 / 4))
    halves = 1.0
    if len(own):
        off = (found[0] - found[1])[own] / wide[own]
        both = (covs[0] + covs[1])[np.ix_(own, own)]
        # Rounding leaves no sign where halves hardly tell what the whole does.
        halves = float(np.sqrt(abs(off @ np.linalg.solve(both, off)) / len(own)))
    factor = halves if halves > MOVED else 1.0
    J = at.of_values()
    # Poses tell the size of what is added to gravity: its error is no scale of all that is read.
    heavier = replace(r, gravity=(r.gravity[0] + r.gravity[1], 0.0))
    off = one_pass(heavier, p.about.at, noise, hold, motion=True).nu - p.nu
    of_gravity = np.clip(J @ gain @ (M.reshape(-1, 32).T @ off.ravel()), -prior_sd, prior_sd)
    scaled = formal * np.outer(wide, wide) * factor**2
    held = np.minimum(1.0, prior_sd / np.sqrt(np.diag(scaled)))  # no more than was known before
    cov = J @ (scaled * np.outer(held, held)) @ J.T + np.outer(of_gravity, of_gravity)
    cov = cov if r.second is not None else _without_circles(cov, at.lever_b, prior_sd)
    lag = [noise.stays[k] or _lag_one(left[:, 3 * k : 3 * k + 3], p.used[:, 3 * k]) for k in (0, 1)]
    return Solution(r, at, replace(p, nu=left), delta, made, noise, cov, J @ formal @ J.T,
                    of_gravity, spread, halves, (lag[0], lag[1]), passes, settled, prior_sd,
                    hold)  # fmt: skip


def changes(s: Solution) -> dict[str, Change]:
    """Return what explains most by changing for good: parameters by their groups, and motion.

    "motion" is what the IMU does not lead on from a pose to the next.
    """
    r, hold, prior_sd = s.readings, s.hold, s.prior_sd
    begin = np.arange(r.stamp[0], r.stamp[-1], bodies.SPLIT)
    edges = [*np.searchsorted(r.stamp, begin), len(r.stamp)]

    def of(p: Pass) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the step that is left, scores after it, and information, of blocks."""
        seen = shown(p.information + _length(r, s.point)[0], s.made, prior_sd)
        M, gain = p.rows @ seen.onto.T, np.linalg.inv(seen.information + np.diag(prior_sd**-2.0))
        step = gain @ (M.T @ (p.nu - s.last.nu).ravel())
        e = p.nu.ravel() - M @ step
        parts = [slice(6 * a, 6 * b) for a, b in pairwise(edges)]
        return (
            step,
            np.array([M[k].T @ e[k] for k in parts]),
            np.array([M[k].T @ M[k] for k in parts]),
        )

    _, scores, information = of(s.last)
    groups = dict[str, list[int]]()
    for i in sorted(set(range(32)) - set(hold)):
        groups.setdefault(bodies.group_of(r.names[i]), []).append(i)
    out = bodies.changes(begin, scores, information, prior_sd, groups)
    # All that follows a pose says of its state what smoothing adds to the filter.
    x, P, whole, cov = s.last.smoothed(np.zeros(32), spread=True).states
    inverse = np.linalg.inv(P)
    own = (inverse @ (P - cov) @ inverse)[:-1, :9, :9]
    told = np.einsum("kij,kj->ki", inverse, whole - x)[:-1, :9]
    shock = likeliest(own, told, ways=len(out) + 1)
    about, after = s.last.about, shock.epoch + 1
    u, Q = about.u.copy(), about.Q.copy()
    u[after], Q[after] = 0.0, np.diag(START_SD**2)
    apart = eliminated(r, replace(about, u=u, Q=Q), s.noise)
    moved, scores, information = of(replace(apart, nu=apart.left(s.step)))
    P = np.linalg.inv(information.sum(axis=0) + np.diag(prior_sd**-2.0))
    spread = bodies.scatter(bodies.wider(begin, scores), P, P, prior_sd)[2]
    out["motion"] = Change(float(r.stamp[after]), shock, moved[None], spread)
    J = s.point.of_values()
    return {name: replace(x, moved=x.moved @ J.T) for name, x in out.items()}


def answers(s: Solution, added: FloatArray) -> Answers:
    """Return what changes of a solution with what is `added` (n, 6, c) to rates and forces [SI]."""
    r, p, about = s.readings, s.last, s.last.about
    at, count, step = about.at, added.shape[2], PART * r.dt[:, None]
    fed, nu, none = p.fed, np.empty((len(r.stamp), 6)), np.empty((0, 0))
    M = np.zeros((*nu.shape, 0))
    for first in range(0, count, 22):
        # As errors of the IMU are: columns of what is integrated, and of what poses are held to.
        J, D = np.zeros((len(nu), 9, 22)), np.zeros((len(nu), 6, 32))
        for k, column in enumerate(np.moveaxis(added[:, :, first : first + 22], 2, 0)):
            other = linear(replace(r, dtheta=r.dtheta + step * column[:, :3],
                                   dvel=r.dvel + step * column[:, 3:]),
                           at, s.hold, motion=True)  # fmt: skip
            u = (other.u - about.u) / PART
            J[:, :3, k] = u[:, :3]
            J[1:, 3:, k] = (u[1:, 3:].reshape(-1, 2, 3) @ about.C[:-1]).reshape(-1, 6)
            D[:, :, 10 + k] = (about.z - other.z) / PART
        part = np.empty((*nu.shape, 32))
        kernels.forward(*fed[:2], J, *fed[3:5], 0.0 * about.G, *fed[6:10], D, *fed[10:], nu, part,
                        none, none[:, :, None])  # fmt: skip
        M = np.concatenate([M, part[:, :, 10:]], axis=2)
    seen = shown(p.information + _length(r, at)[0], s.made, s.prior_sd)
    gain = np.linalg.inv(seen.information + np.diag(s.prior_sd**-2.0)) @ seen.onto
    off, e = -M[:, :, :count].reshape(-1, count), p.nu.ravel()
    by = gain @ (p.rows.T @ off)
    E = off - p.rows @ (seen.onto.T @ by)
    return Answers(float(e @ e), E.T @ e, E.T @ E, s.point.of_values() @ by,
                   int(np.count_nonzero(e)))  # fmt: skip


PART = 0.01
"""Of what is added to readings it is seen what it does: it may be no small change [1]."""


def _without_circles(cov: FloatArray, lever: FloatArray, prior_sd: FloatArray) -> FloatArray:
    """Return the covariance (32, 32) with what a rotation that is hardly known takes round with it.

    A `lever` arm (3,) [m] goes round a circle, not along its tangent: that adds its sagitta. Where
    the rotation may be anything nothing is known of both but what was, `prior_sd` (32,) [SI].
    """
    out, square = cov.copy(), float(np.linalg.eigvalsh(cov[:3, :3])[-1])
    if square < ROUND**2:
        out[range(3, 6), range(3, 6)] += float(lever @ lever) * square**2 / 4
        return out
    lost = np.flatnonzero(np.diag(cov)[:6] > (0.1 * ROUND * prior_sd[:6]) ** 2)
    out[lost] = out[:, lost] = 0.0
    out[lost, lost] = prior_sd[lost] ** 2
    return out


def _lag_one(rows: FloatArray, used: BoolArray) -> float:
    both = used[1:] & used[:-1]
    total = float(np.sum(rows[used] ** 2))
    return float(np.sum(rows[1:][both] * rows[:-1][both])) / total if total else 0.0


def budget(s: Solution) -> dict[str, FloatArray]:
    """Return the variance of every parameter by source, (32,) each [SI]; they add up to `cov`."""
    r, n = s.readings, s.noise
    about, J, room = s.last.about, s.point.of_values(), Room()
    gyros = linear(replace(r, white=(r.white[0], 0.0)), about.at, s.hold, motion=True).Q
    first = "attitude of the poses" if r.second is None else "second antenna"

    def cov(of: str) -> FloatArray:
        by = 1 + STEP
        more = {"gyros": gyros, "accelerometers": about.Q - gyros}.get(of, 0.0 * gyros)
        noise = replace(n, attitude=n.attitude * (by if of == first else 1.0),
                        position=n.position * (by if of == "position of the poses" else 1.0)
                        )  # fmt: skip
        p = eliminated(r, replace(about, Q=about.Q + (by**2 - 1) * more), noise, room)
        seen = shown(p.information + _length(r, s.point)[0], s.made, s.prior_sd)
        return np.asarray(np.diag(J @ seen.covariance(s.prior_sd) @ J.T))

    names = ["gyros", "accelerometers", "position of the poses"]
    names += [first] * bool(r.measured[:, :3].any())
    parts = {
        name: np.maximum(cov(name) - np.diag(s.formal), 0.0) / ((1 + STEP) ** 2 - 1)
        for name in names
    }
    gravity = s.of_gravity**2
    out = shares(parts, np.diag(s.formal), np.diag(s.cov) - gravity, COLOUR)
    return out | {"local gravity": gravity}


COLOUR = "colour of the poses' noise"  # Source of what is related from pose to pose.

STEP = 1e-3
"""Part of a noise by which it is changed to see what hangs on it [1]."""
