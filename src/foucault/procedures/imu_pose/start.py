"""Where to start: offset, rotation, lever arm and level in closed form, and what they contradict.

Norms of rates do not know the rotation: their correlation tells the offset, window by window the
rate of the clocks. A rotation brings the rates together [Wahba], and one linear least squares the
forces::

    accel = C_bv p'' - Om l - C_bv g_v + b_a,    Om = [alpha x] + [w x]^2

Of positions alone the gyros are integrated over some seconds, and ``C_b0b accel = X p'' + c -
C_b0b Om l`` is solved for one offset after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.errors import FoucaultError, error
from foucault.estimate import two_bodies as bodies
from foucault.estimate.antennas import LEFT, SUSPECT, TURNED, least, of_base
from foucault.estimate.delay_matching import SlaveAttitude
from foucault.estimate.imu_pose import Point, Readings, corrected, misses, solve
from foucault.estimate.norm_observation import wahba
from foucault.estimate.two_bodies import clocks
from foucault.guard.mistakes import exchanges
from foucault.logs.pose import FEWEST
from foucault.models.pose import READINGS, PoseTable
from foucault.models.rotation import cross_matrix, exp
from foucault.models.rotation import log as vector_of
from foucault.navigate.increments import Increments
from foucault.tables import Log
from foucault.units import plain


@dataclass(frozen=True)
class Forces:
    """What the accelerometers read, and what has to explain it."""

    accel: FloatArray  # (k, 3) [m/s^2]
    C_bv: FloatArray  # (k, 3, 3) [1]
    pull: FloatArray  # (k, 3) second derivative of the position, world of the pose [m/s^2]
    Om: FloatArray  # (k, 3, 3) what a lever arm is multiplied by [1/s^2]

    @cached_property
    def _rows(self) -> FloatArray:
        """What lever arm, gravity and bias do to what is read, (3 k + 3, 9) [SI]."""
        one = np.broadcast_to(np.eye(3), self.C_bv.shape)
        A = np.concatenate([-self.Om, -self.C_bv, one], axis=2).reshape(-1, 9)
        return np.vstack([A, np.eye(9)[6:]])  # a bias that cannot be told from gravity stays small

    def fits(self, accel: FloatArray, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lever arm, gravity and bias, (9, b) [SI], and what they leave (rms), (b,) [m/s^2].

        `accel`, `pull` (b, k, 3) or one of them (k, 3): b times as the attributes of these names.
        """
        y = accel - np.einsum("kij,...kj->...ki", self.C_bv, pull)
        y = np.pad(y.reshape(len(y), -1).T, ((0, 3), (0, 0)))
        x = np.linalg.lstsq(self._rows, y, rcond=None)[0]
        return x, np.sqrt(np.mean((y - self._rows @ x)[:-3] ** 2, axis=0))

    def fit(self) -> tuple[FloatArray, float]:
        """Return lever arm, gravity and bias, (9,) [SI], and what they leave (rms) [m/s^2]."""
        x, left = self.fits(self.accel[None], self.pull)
        return x[:, 0], float(left[0])

    def scaled(self) -> tuple[float, float, float, float]:
        """Return how large positions had to be, its sd, gravity, and what is left (rms) [SI]."""
        k = len(self.accel)
        one = np.broadcast_to(np.eye(3), (k, 3, 3))
        pulled = np.einsum("kij,kj->ki", self.C_bv, self.pull)[:, :, None]
        A = np.concatenate([-self.Om, -self.C_bv, one, pulled], axis=2).reshape(-1, 10)
        y = self.accel.ravel()
        # In one unit: a lever arm in mm beside positions in mm.
        wide = np.vstack([A, np.eye(10)[6:9]])
        x = np.linalg.lstsq(wide, np.append(y, np.zeros(3)), rcond=None)[0]
        left = float(np.sqrt(np.mean((y - A @ x) ** 2)))
        sd = left * float(np.sqrt(np.linalg.pinv(wide.T @ wide)[9, 9]))
        return float(x[9]), sd, float(np.linalg.norm(x[3:6])), left

    def unmoved(self) -> float:
        """Return what is left where positions are not looked at (rms) [m/s^2]."""
        return float(self.fits(self.accel[None], 0.0 * self.pull)[1][0])

    @property
    def explained(self) -> float:
        """What is left with any unit of the positions, or any axes of the forces (rms) [m/s^2]."""
        scaled, fits = self.scaled()[3], float(self.exchanged(exchanges()).min())
        return fits if scaled > 0.7 * self.unmoved() else min(scaled, fits)

    def exchanged(self, tried: Sequence[FloatArray], moved: bool = False) -> FloatArray:
        """Return what is left where accelerometers have other axes, (b,) (rms) [m/s^2].

        `tried`: axes, (3, 3) each [1]; `moved`: those of the positions, not of accelerometers.
        """
        turns = np.swapaxes(np.array(tried), 1, 2)
        if moved:
            return self.fits(self.accel, self.pull @ turns)[1]
        return self.fits(self.accel @ turns, self.pull)[1]

    def some(self, most: int) -> Forces:
        """Return at most so many of them, evenly chosen; `most` [1]."""
        step = max(1, len(self.accel) // most)
        return Forces(self.accel[::step], self.C_bv[::step], self.pull[::step], self.Om[::step])


@dataclass(frozen=True)
class Start:
    """What closed forms say, and how well."""

    point: Point
    reading: str | None  # of the quaternion, a key of `READINGS`
    clocks: bodies.Clocks  # NaN of positions alone
    singular: FloatArray  # (3,) of the matrix from the rates of the IMU to those of the body [1]
    sign: float  # of its determinant [1]
    free_misfit: float  # what that matrix leaves of the rates, as a part of them [1]
    misfit: float  # what the rotation leaves of the rates, as a part of them [1]
    force: float  # what lever arm, gravity and bias leave of the forces [m/s^2]
    gravity: float  # length of gravity as found [m/s^2]
    forces: Forces
    step: float  # between two of these forces [s]


def _without_jumps(x: FloatArray) -> FloatArray:
    """Return `x` (n, q) with what is far from both neighbours' median put onto that median."""
    from scipy.ndimage import median_filter

    middle = median_filter(x, size=(5, 1), mode="nearest")
    off = np.abs(x - middle)
    far = (off > 10 * np.median(off, axis=0) + 1e-9).any(axis=1)
    return np.where(far[:, None], middle, x)


def start_of(log: Log, r: Readings, q: PoseTable) -> Start:
    """Find offset, clock rate, rotation, lever arm and level in closed form, from rates and forces.

    `q`: the same poses, with the numbers of their quaternions.
    """
    assert log.gyro is not None
    assert log.accel is not None
    step, usual = (float(np.median(np.diff(t))) for t in (log.time, q.time))
    w_imu, f_imu = (
        bodies.smoothed_alike(x, step, k, usual) for k, x in ((1, log.gyro), (2, log.accel))
    )
    own = np.arange(q.time[0], q.time[-1], usual)
    assert q.quaternion is not None
    numbers = q.quaternion / np.linalg.norm(q.quaternion, axis=1)[:, None]
    flips = np.cumprod(np.where(np.sum(numbers[1:] * numbers[:-1], axis=1) < 0, -1.0, 1.0))
    numbers = bodies.even(q.time, _without_jumps(numbers * np.append(1.0, flips)[:, None]), own)
    bad = bodies.gaps(q.time, own, max(4 * usual, bodies.SMOOTH))
    found: list[Start] = []
    known: dict[tuple[int, ...], bodies.Clocks] = {}
    for reading, (order, sign) in READINGS.items():
        if q.reading not in (None, reading):
            continue
        w = _body_rate(numbers[:, order] * [1.0, sign, sign, sign], usual)
        w[bad] = 0.0
        _same_time(log.gyro, w, log.duration, own[-1] - own[0])
        if tuple(order) not in known:  # in axes of the world rates have the same norms
            known[tuple(order)] = clocks((log.time, w_imu), (own, w), r.middle, ~bad)
        c = known[tuple(order)]
        found.append(_with_rates(log, r, q, reading, c, (own, w, bad), (w_imu, f_imu)))
    # Rates do not tell all readings apart, forces do; a mirror image, another unit or sign is no
    # reason for another reading.
    least = min(s.free_misfit for s in found)
    return min(
        (s for s in found if s.free_misfit < 1.5 * least + 0.05),
        key=lambda s: s.forces.some(500).explained,
    )


def _same_time(w_imu: FloatArray, w: FloatArray, lasted: float, poses: float) -> None:
    """Refuse poses whose time has another unit: they turn slower as they last longer."""
    ratio = float(np.sqrt(np.mean(np.sum(w_imu**2, axis=1)) / np.mean(np.sum(w**2, axis=1))))
    power = 3 * round(np.log10(ratio) / 3)
    if power and 0.2 < ratio / 10.0**power < 5 and 0.1 < poses / lasted / 10.0**power < 10:
        raise error("pose.time_unit", times=plain(10.0**power, 1), poses=plain(poses, 2),
                    lasted=plain(lasted, 2))  # fmt: skip


def _body_rate(q: FloatArray, step: float) -> FloatArray:
    """Return the rate in body axes, (n, 3) [rad/s], of quaternions (n, 4), scalar first."""
    s, d = bodies.smooth(q, step), bodies.smooth(q, step, 1)
    v, dv = s[:, 1:], d[:, 1:]
    square = np.sum(s**2, axis=1)[:, None]
    return np.asarray(2 * (s[:, :1] * dv - d[:, :1] * v - np.cross(v, dv)) / square)


def _with_rates(
    log: Log, r: Readings, q: PoseTable, reading: str, c: bodies.Clocks,
    body: tuple[FloatArray, FloatArray, BoolArray], sensed: tuple[FloatArray, FloatArray],
) -> Start:  # fmt: skip
    (own, w_m, bad), (w_imu, f_imu) = body, sensed
    usual = float(own[1] - own[0])
    tau, kappa = c.tau, c.kappa
    t = own + tau + kappa * (own - r.middle)
    inside = ~bad & (t > log.time[0] + bodies.SMOOTH) & (t < log.time[-1] - bodies.SMOOTH)
    inside[:5] = inside[-5:] = False
    if inside.sum() < FEWEST:
        raise error("pose.few", file="The time of the log", count=int(inside.sum()), least=FEWEST)
    w_b = bodies.even(log.time, w_imu, t[inside])
    w = w_m[inside]
    # Hardly turned, rates are noise: what is centred is what the turning says.
    x, y = w_b - w_b.mean(axis=0), w - w.mean(axis=0)
    C_bm = wahba(x, y)
    free = np.linalg.lstsq(y, x, rcond=None)[0].T
    left = float(np.sqrt(np.sum((x - y @ C_bm.T) ** 2) / np.sum(x**2)))
    loose = float(np.sqrt(np.sum((x - y @ free.T) ** 2) / np.sum(x**2)))
    bias = w_b.mean(axis=0) - C_bm @ w.mean(axis=0)
    C_mv = np.swapaxes(_attitudes(q.time, q.attitude(reading), own)[inside], 1, 2)
    # Forces: accel = C_bv p'' - Om l - C_bv g_v + b_a, all smoothed alike.
    position = bodies.even(q.time, _without_jumps(q.position), own)
    pull = bodies.smooth(position, usual, 2)[inside]
    wb = w_b - bias
    alpha = np.gradient(bodies.even(log.time, w_imu, t), t, axis=0)[inside]
    Om = cross_matrix(alpha) + cross_matrix(wb) @ cross_matrix(wb)
    forces = Forces(bodies.even(log.time, f_imu, t[inside]), C_bm @ C_mv, pull, Om)
    if (axis := bodies.one_axis(x)) is not None:
        # Turns about one axis leave the angle about it to the forces.
        some = forces.some(700)
        angles = np.arange(-18, 18) * np.pi / 18
        left_over = [replace(some, C_bv=exp(a * axis) @ some.C_bv).fit()[1] for a in angles]
        about = exp(angles[int(np.argmin(left_over))] * axis)
        C_bm, forces = about @ C_bm, replace(forces, C_bv=about @ forces.C_bv)
    C_vb = q.attitude(reading) @ C_bm.T
    x9, off = forces.some(2000).fit()
    size = float(np.linalg.norm(x9[3:6]))
    node = r.nodes(tau, kappa)
    at = Point(
        C_bm, x9[:3], float(tau), float(kappa), -x9[3:6] / max(size, 1e-9),
        (bias, np.zeros((3, 3))), (x9[6:], np.zeros((3, 3))), 0.0, node,
        *_motion(r, C_vb, x9[:3]),
    )  # fmt: skip
    return Start(at, reading, c, np.linalg.svd(free)[1],
                 float(np.sign(np.linalg.det(free))), loose, left, off, size, forces,
                 usual)  # fmt: skip


def _attitudes(time: FloatArray, C: FloatArray, at: FloatArray) -> FloatArray:
    """Return the attitude between two that are known, shape (n, 3, 3)."""
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    part = np.clip((at - time[k]) / (time[k + 1] - time[k]), 0, 1)[:, None]
    return np.asarray(C[k] @ exp(vector_of(np.swapaxes(C[k], 1, 2) @ C[k + 1]) * part))


def _motion(
    r: Readings, C_vb: FloatArray, lever: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return attitude, velocity and position of the IMU at the poses, to start from."""
    p = r.place - C_vb @ lever
    return C_vb, np.gradient(p, r.stamp, axis=0), p


# -- of positions alone --------------------------------------------------------------------------

SPAN = 15.0  # So long gyros can be integrated before their biases are known [s].

FREE_AT_FIRST = np.r_[3:7, 8:16]
"""Parameters that a few seconds tell: lever arm, offset, level and biases."""

MIRRORED = "axes of all positions are mirrored, or the accelerometers reversed"
BASES = {
    "with a heading that is anticlockwise": np.diag([-1.0, 1.0, 1.0]),
    "as north, east, down": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "as north, east, up": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""What may be wrong where up is not z: of everything, and of a base that was measured by itself."""


def start_of_places(log: Log, r: Readings, longest: float) -> tuple[Start, Point]:
    """Find where to start from positions alone; the offset is looked for within `longest` [s].

    A base fits a mirrored world as well, reversed, and one that is turned: positions do not.
    """
    found, start, off = _of_places(log, r, longest)
    size = np.inf if start.base_b is None else float(np.linalg.norm(start.base_b))
    upright = start.up_v[2] > 0.9 and off < SUSPECT * size
    if r.second is None or upright or not bodies.of_a_unit(found.gravity / r.gravity[0]):
        return found, start
    assert log.accel is not None
    other = replace(log, accel=-log.accel)
    tried = {MIRRORED: (other, replace(r, dvel=-r.dvel, rise=-r.rise, log=other))}
    tried |= {words: (log, replace(r, second=replace(r.second, place=r.second.place @ C)))
              for words, C in BASES.items()}  # fmt: skip
    left = dict.fromkeys(tried, np.inf)
    for words, case in tried.items():
        with suppress(FoucaultError, np.linalg.LinAlgError):
            left[words] = _of_places(*case, longest)[2]
    best = min(left, key=lambda words: left[words])
    if left[best] < min(off / bodies.CLEARLY, LEFT * size):
        code = "pose.world_mirrored" if best == MIRRORED else "pose.base_axes"
        more = {} if best == MIRRORED else {"words": best}
        raise error(code, factor=plain(off / left[best], 2), **more)
    if off > LEFT * size:
        raise error("pose.base_turns", left=plain(off / size, 2), allowed=plain(LEFT, 1))
    return found, start


def _of_places(log: Log, r: Readings, longest: float) -> tuple[Start, Point, float]:
    """Return the start, and how far positions, or the base, are off then (median) [m]."""
    assert log.gyro is not None
    assert log.accel is not None
    step = float(np.median(np.diff(log.time)))
    usual = float(np.median(np.diff(r.stamp)))
    w, f = (bodies.smoothed_alike(x, step, k, usual) for k, x in ((1, log.gyro), (2, log.accel)))
    own = np.arange(r.stamp[0], r.stamp[-1], usual)
    pull = bodies.smooth(bodies.even(r.stamp, _without_jumps(r.place), own), usual, 2)
    bad = bodies.gaps(r.stamp, own, max(4 * usual, bodies.SMOOTH))
    bad[:5] = bad[-5:] = True
    lively, base_b = pull, None
    if r.second is not None:  # its positions may be too noisy to be differentiated twice
        there = np.isfinite(r.second.base(r.position)[:, 0])
        lively = bodies.smooth(
            bodies.even(r.stamp[there], r.second.base(r.position)[there], own), usual, 1
        )
    first = _liveliest(own, lively * ~bad[:, None], SPAN)
    rows = slice(first, first + round(SPAN / usual))
    own, pull, bad = own[rows], pull[rows], bad[rows]
    turns = SlaveAttitude(Increments.of(r.time, r.dtheta, r.dvel))
    alpha = np.gradient(w, log.time, axis=0)

    def tried(tau: float) -> tuple[float, FloatArray, Forces]:
        t = own + tau
        inside = ~bad & (t > log.time[1]) & (t < log.time[-2])
        if inside.sum() < 0.5 * len(own):
            return np.inf, np.zeros(15), Forces(*np.zeros((4, 1, 3, 3)))
        t = t[inside]
        C = turns.at(t)[0]
        wb = cross_matrix(bodies.even(log.time, w, t))
        Om = cross_matrix(bodies.even(log.time, alpha, t)) + wb @ wb
        force = bodies.even(log.time, f, t)
        y = np.einsum("kij,kj->ki", C, force)
        one = np.eye(3)
        X = np.einsum("ij,kl->kijl", one, pull[inside]).reshape(-1, 3, 9)
        A = np.concatenate([X, np.broadcast_to(one, (len(t), 3, 3)), -C @ Om], axis=2)
        x = np.linalg.lstsq(A.reshape(-1, 15), y.ravel(), rcond=None)[0]
        left = float(np.sqrt(np.mean((y.ravel() - A.reshape(-1, 15) @ x) ** 2)))
        return left, x, Forces(force, np.swapaxes(C, 1, 2), pull[inside], Om)

    if r.second is None:
        tau = least(lambda t: tried(t)[0], longest)
        left, x, forces = tried(tau)
        _overlap(left, own, log)
        U, size, V = np.linalg.svd(x[:9].reshape(3, 3))
        sign = float(np.linalg.det(U @ V))
        C_0v = U @ np.diag([1.0, 1.0, sign]) @ V
        lever, g_v = x[12:], -C_0v.T @ x[9:12]
    else:
        base = bodies.even(r.stamp[there], r.second.base(r.position)[there], own)
        within = float(log.time[0]), float(log.time[-1])
        tau, C_0v, base_b, off = of_base(turns, own[~bad], base[~bad], longest, within)
        _overlap(off, own, log)
        if off > TURNED:
            raise error("pose.base_turns", left=plain(off, 2), allowed=plain(TURNED, 1))
        _, _, forces = tried(tau)
        forces = replace(forces, C_bv=forces.C_bv @ C_0v)
        x, left = forces.fit()
        lever, g_v, size, sign = x[:3], x[3:6], np.ones(3), 1.0
    gravity = float(np.linalg.norm(g_v))
    inside = (r.at(tau, 0.0) > own[0] + tau) & (r.at(tau, 0.0) < own[-1] + tau)
    few = r[inside]

    def at_places(some: Readings, C_vb: FloatArray, at: Point) -> Point:
        C, v, p = _motion(some, C_vb, at.lever_b)
        return replace(at, node=some.nodes(at.tau, at.kappa), C=C, v=v, p=p)

    zero = np.zeros((3, 3))
    begun = Point(np.eye(3), lever, tau, 0.0, -g_v / max(gravity, 1e-9), (np.zeros(3), zero),
                  (np.zeros(3), zero), 0.0, few.nodes(tau, 0.0), zero, zero, zero,
                  base_b)  # fmt: skip
    begun = at_places(few, C_0v.T @ turns.at(few.at(tau, 0.0))[0], begun)
    hold = np.setdiff1d(np.arange(32), FREE_AT_FIRST) if base_b is None else np.array([7, 31])
    short = solve(few, begun, {}, (None, None), most=8, hold=hold)
    # From there the gyros without their biases lead to both ends.
    at = short.point
    dtheta = corrected(r, at).raw_g
    turns = SlaveAttitude(Increments.of(r.time, dtheta, r.dvel))
    middle = len(few.stamp) // 2
    known = turns.at(few.at(at.tau, at.kappa))[0]
    C_v0 = at.C[middle] @ known[middle].T
    start = at_places(r, C_v0 @ turns.at(r.at(at.tau, at.kappa))[0], at)
    none = bodies.Clocks(tau, 0.0, np.nan, np.nan, 0.0, 0.0)
    found = Start(start, None, none, size, sign, np.nan, np.nan, left, gravity, forces, usual)
    z, ok = np.abs(misses(few, short.point)), few.measured
    off = max(float(np.median(x[o])) for x, o in ((z[:, :3], ok[:, :3]), (z[:, 3:], ok[:, 3:]))
              if o.any())  # fmt: skip
    return found, start, off


def _liveliest(time: FloatArray, pull: FloatArray, span: float) -> int:
    """Return the row where a stretch of `span` [s] with the most acceleration (n, 3) begins."""
    n = round(span / float(time[1] - time[0]))
    total = np.append(0.0, np.cumsum(np.sum(pull**2, axis=1)))
    return int(np.argmax(total[n:] - total[:-n])) if len(time) > n else 0


def _overlap(left: float, own: FloatArray, log: Log) -> None:
    """Refuse poses at times when there is no log, whatever the offset; then infinite is `left`."""
    if not np.isfinite(left):
        inside = (own > log.time[0]) & (own < log.time[-1])
        raise error("pose.few", file="The time of the log, with any offset within longest_offset,",
                    count=int(inside.sum()), least=FEWEST)  # fmt: skip
