"""Errors of a navigation: against a reference, standing still, and what they come from.

The error of a navigated trajectory against a reference, and how it grows.

Position error is a straight line from the reference to the estimate, east, north and up at the
reference. The trajectory, which is dense, is interpolated to the epochs of the reference, which
may be far apart: cubically in position with the velocities as slopes, linearly in velocity, about
a fixed axis in attitude.

References
----------
.. [1] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, appendix B.2.3 (circular error probable).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray, IndexArray
from foucault.errors import Finding, error, finding
from foucault.logs.reference import Reference
from foucault.models import earth, rotation
from foucault.models.earth import radii
from foucault.models.rotation import angles_of, turned
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.navigate.strapdown import Trajectory


NAUTICAL_MILE = 1852.0  # [m].

AGES = (1, 2, 5, 10, 20, 30, 60, 120, 180, 240, 300, 360, 480, 600, 720, 960, 1200, 1440)
"""Ages at which the growth of the error is listed [min]."""

WIDE = 0.25  # Between epochs farther apart than this part of an age nothing is listed at it [1].
MOST = 2000  # Epochs at which errors are kept [1].


@dataclass(frozen=True)
class NavigationError:
    """Error of a trajectory, estimate minus reference; NaN where the reference does not say."""

    time: FloatArray  # (m,) epochs, of the log's clock [s]
    start: float  # time at which the navigation started [s]
    position: FloatArray  # (m, 3) East, north, up [m]
    velocity: FloatArray  # (m, 3) East, north, up [m/s]
    angles: FloatArray  # (m, 3) heading, pitch, roll, between -pi and pi [rad]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def age(self) -> FloatArray:
        """Time since the navigation started, shape (m,) [s]."""
        return np.asarray(self.time - self.start)

    @property
    def horizontal(self) -> FloatArray:
        """Length of the horizontal position error, shape (m,) [m]."""
        return np.hypot(self.position[:, 0], self.position[:, 1])


@dataclass(frozen=True)
class Growth:
    """The error at one age of the navigation; NaN where the reference does not say."""

    age: float  # time since the start [s]
    # horizontal, vertical: length of the horizontal, and size of the vertical position error [m]
    horizontal: float
    vertical: float
    velocity: float  # length of the horizontal velocity error [m/s]
    heading: float  # heading error [rad]


def common_epochs(trajectory: Trajectory, reference: Reference) -> FloatArray:
    """Return the epochs of a reference that a trajectory covers, thinned evenly, shape (m,) [s].

    Raises ``navigate.apart``: they have no time in common.
    """
    first = float(trajectory.time[0])
    time = covered(reference, first, float(trajectory.time[-1]))
    step = -(-len(time) // MOST)
    kept = np.arange(len(time))[::-1][::step]  # the last one stays
    listed = np.searchsorted(time, first + 60.0 * np.array(AGES) - 1e-6)
    return np.asarray(time[np.union1d(kept, listed[listed < len(time)])])


def covered(reference: Reference, first: float, last: float) -> FloatArray:
    """Return epochs of a reference from `first` to `last`, (m,) [s]; ``navigate.apart``: none."""
    # Rows that are blank are no measurement: a slow sensor beside a fast one writes many.
    inside = (reference.time >= first) & (reference.time <= last) & reference.says
    if np.count_nonzero(inside) < 2:
        raise error(
            "navigate.apart", first=f"{first:.9g}", last=f"{last:.9g}",
            start=f"{reference.time[0]:.9g}", end=f"{reference.time[-1]:.9g}",
        )  # fmt: skip
    return np.asarray(reference.time[inside])


def error_of(trajectory: Trajectory, reference: Reference) -> NavigationError:
    """Compute the error of a trajectory at the epochs of a reference of the same clock."""
    time = common_epochs(trajectory, reference)
    row = np.searchsorted(reference.time, time)
    seen = _Bracket.of(trajectory, time)
    blank = np.full((len(time), 3), np.nan)
    position = blank.copy()
    if reference.position is not None:
        latitude, longitude, height = reference.position[row].T
        position = earth.displacement(latitude, longitude, height, *seen.position())
        if not reference.has_height:
            position[:, 2] = np.nan
    fast = blank if reference.velocity_n is None else seen.velocity() - reference.velocity_n[row]
    angles = blank
    if reference.angles is not None:
        angles = turned(angles_of(seen.attitude()) - reference.angles[row])
    return NavigationError(time, float(trajectory.time[0]), position, fast, angles)


@dataclass(frozen=True)
class _Bracket:
    """The states before and after each epoch, and how far between them it lies."""

    before: Trajectory
    after: Trajectory
    part: FloatArray

    @classmethod
    def of(cls, trajectory: Trajectory, time: FloatArray) -> _Bracket:
        t = trajectory.time
        i = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2)
        before = replace(trajectory, time=t[i], history=trajectory.history[i])
        after = replace(trajectory, time=t[i + 1], history=trajectory.history[i + 1])
        return cls(before, after, (time - t[i]) / (t[i + 1] - t[i]))

    def position(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return latitude, longitude and height."""
        a, b, u = self.before, self.after, self.part
        # The straight line between two samples misses u (u-1)/2 step (v1 - v0).
        step = b.time - a.time
        bow = (u * (u - 1) / 2 * step)[:, None] * (b.velocity_n - a.velocity_n)
        latitude = a.latitude + u * (b.latitude - a.latitude)
        height = a.height + u * (b.height - a.height) + bow[:, 2]
        longitude = a.longitude + u * turned(b.longitude - a.longitude)
        along, across = radii(latitude)
        longitude = longitude + bow[:, 0] / ((across + height) * np.cos(latitude))
        return latitude + bow[:, 1] / (along + height), longitude, height

    def velocity(self) -> FloatArray:
        """Return the velocity, linear between the samples."""
        v = self.before.velocity_n
        return np.asarray(v + self.part[:, None] * (self.after.velocity_n - v))

    def attitude(self) -> FloatArray:
        """Return C_nb, turned about a fixed axis between the samples."""
        C = self.before.C_nb
        turn = rotation.log(np.swapaxes(C, -1, -2) @ self.after.C_nb)
        return np.asarray(C @ rotation.exp(self.part[:, None] * turn))


def growth(errors: NavigationError) -> tuple[Growth, ...]:
    """Return the error at those of `AGES` that the run reaches and at its end, interpolated."""
    age = errors.age
    # An age that the last epoch is hardly beyond would be listed twice.
    wanted = [60.0 * a for a in AGES if 60.0 * a < 0.95 * age[-1]]
    rows = []
    for at in [*wanted, float(age[-1])]:
        i = int(np.clip(np.searchsorted(age, at), 1, max(1, len(age) - 1))) if len(age) > 1 else 0
        if at < age[-1] and (at < age[i - 1] or age[i] - age[i - 1] > WIDE * at):
            continue  # the reference says nothing there
        rows.append(_at(errors, at, i))
    return tuple(rows)


def _at(errors: NavigationError, age: float, i: int) -> Growth:
    """Return the error at an age between the epochs before and at `i`."""
    part = 1.0 if i == 0 else (age - errors.age[i - 1]) / (errors.age[i] - errors.age[i - 1])

    def between(x: FloatArray) -> FloatArray:
        return np.asarray(x[i] if part == 1 else x[i - 1] + part * (x[i] - x[i - 1]))

    east, north, up = between(errors.position)
    speed = float(np.hypot(*between(errors.velocity)[:2]))
    heading = float(errors.angles[i, 0])
    if part < 1:
        heading -= (1 - part) * float(turned(np.diff(errors.angles[i - 1 : i + 1, 0]))[0])
    return Growth(age, float(np.hypot(east, north)), abs(float(up)), speed, heading)


def radial_rate(errors: NavigationError, after: float = 60.0) -> float:
    """Return the rms of radial error over age [m/s], from the age `after` on [s]."""
    age, r = errors.age, errors.horizontal
    counts = (age >= min(after, 0.5 * float(age[-1]))) & np.isfinite(r) & (age > 0)
    return float(np.sqrt(np.mean((r[counts] / age[counts]) ** 2))) if counts.any() else float("nan")


def circular_error(cov: FloatArray) -> FloatArray:
    """Return the radius that holds half of all errors, shape (...) [m].

    The integral of the Gaussian over the circle is solved for, not approximated.

    `cov` (..., 2, 2): covariance of the horizontal position error [m^2].
    """
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(cov), 0.0))
    small, large = values[..., 0], values[..., 1]
    share = np.divide(small, large, out=np.zeros_like(small), where=large > 0)
    return np.asarray(large * np.interp(share, *_circular_table()))


@cache
def _circular_table() -> tuple[FloatArray, FloatArray]:
    """Return axis ratios, and the radius for half of the errors where the larger sd is 1."""
    angle = (np.arange(512) + 0.5) * np.pi / 512
    ratio = np.linspace(0.0, 1.0, 101)[1:, None]
    # P(r) = 1 - mean over angle of ratio/d exp(-r^2 d / (2 ratio^2)), d = ratio^2 c^2 + s^2
    d = (ratio * np.cos(angle)) ** 2 + np.sin(angle) ** 2
    low, high = np.full_like(ratio, 0.5), np.full_like(ratio, 1.3)
    for _ in range(50):
        r = (low + high) / 2
        inside = 1 - np.mean(ratio / d * np.exp(-(r**2) * d / (2 * ratio**2)), axis=1)[:, None]
        low, high = np.where(inside < 0.5, r, low), np.where(inside < 0.5, high, r)
    least = 0.6744897501960817  # the quartile of the normal distribution
    return np.append(0.0, ratio), np.append(least, (low + high) / 2)


# -- what each coefficient contributes -------------------------------------------------------------
#
# The errors of navigation are propagated with the errors of the sensors (`navigate.ins_filter`);
# an error of a coefficient acts twice, while the instrument is aligned and while it navigates::
#
#     x(t) = (S(t) + Phi(t) A) c + Phi(t) (phi_0, v_0, p_0) + noise,     A = d phi_0 / d c
#
# so that a level error and the accelerometer bias that made it cancel as they do in truth. With
# c the value of a coefficient this is what correcting it was worth; with the covariance of the
# coefficients it is what is left, beside the noise of alignment and sensors.

STATES = 9  # phi, velocity, position; east, north, up each


@dataclass(frozen=True)
class Budget:
    """Contributions of p coefficients at m epochs; phi [rad], velocity [m/s], position [m]."""

    time: FloatArray  # (m,) epochs, of the log's clock [s]
    names: tuple[str, ...]
    # values, sd: (p,) what was corrected, and how well that is known; sd NaN where unknown [SI]
    values: FloatArray
    sd: FloatArray
    # (m, 9, p) errors of navigation per unit of each coefficient, alignment included [SI]
    response: FloatArray
    # (m, 9, 9) covariance that what is left of all coefficients makes [SI]
    coefficients: FloatArray
    # (m, 9, 9) covariance that errors of the start make: attitude, velocity and place [SI]
    alignment: FloatArray
    noise: FloatArray  # (m, 9, 9) covariance that sensor noise after the alignment makes [SI]
    # (3, 3) covariance of phi at the start, by noise and what is left of the coefficients [rad^2]
    start: FloatArray

    @property
    def cov(self) -> FloatArray:
        """Covariance of all of it, shape (m, 9, 9) [SI]."""
        return np.asarray(self.coefficients + self.alignment + self.noise)

    @property
    def worth(self) -> FloatArray:
        """Error that each coefficient made before it was corrected, shape (m, 9, p) [SI]."""
        return np.asarray(self.response * self.values)

    @property
    def left(self) -> FloatArray:
        """Standard deviation that each coefficient alone leaves, shape (m, 9, p) [SI]."""
        return np.abs(self.response) * np.nan_to_num(self.sd)

    def ranked(self, part: FloatArray) -> IndexArray:
        """Return coefficients by error at the end in `part` (m, 9, p) [SI], largest first."""
        return np.argsort(-np.hypot(part[-1, 6], part[-1, 7]), kind="stable")


def budget(
    time: FloatArray,
    transition: FloatArray,
    aligned: FloatArray,
    coefficients: tuple[tuple[str, ...], FloatArray, FloatArray | None],
    phi_cov: FloatArray,
    noise_cov: FloatArray,
    velocity_sd: float = 0.0,
    position_sd: float = 0.0,
) -> Budget:
    """Put together what every source makes of the errors of navigation.

    `time` (m,): epochs [s]; `transition` (m, 9, 9 + p): errors per unit of the errors at the
    start, and of each coefficient, after it [SI]; `aligned` (3, p): attitude error at the start
    per unit of each coefficient [rad per SI]; `coefficients` or None: names, values, shape (p,),
    and covariance, shape (p, p), where known [SI]; `phi_cov` (3, 3): covariance of the start
    attitude by noise alone [rad^2]; `noise_cov` (m, 9, 9): covariance that sensor noise makes
    [SI]; `velocity_sd`: of each component at the start [m/s]; `position_sd`: of the place at the
    start, east, north and up [m].
    """
    names, values, cov = coefficients
    total = transition[:, :, STATES:] + transition[:, :, :3] @ aligned
    start = np.diag(np.repeat([0.0, velocity_sd**2, position_sd**2], 3))
    start[:3, :3] = phi_cov
    first = transition[:, :, :STATES]
    known = np.zeros((len(names),) * 2) if cov is None else cov
    sd = np.full(len(names), np.nan) if cov is None else np.sqrt(np.diag(cov))
    return Budget(
        time, names, values, sd, total, total @ known @ np.swapaxes(total, 1, 2),
        first @ start @ np.swapaxes(first, 1, 2), noise_cov,
        phi_cov + aligned @ known @ aligned.T,
    )  # fmt: skip


def normalised_square(error: FloatArray, cov: FloatArray) -> float:
    """Return ``e' P^-1 e`` [1] of `error` (k,) with `cov` (k, k): chi-square where P is right."""
    return float(error @ np.linalg.solve(cov, error))


# -- clock and course ------------------------------------------------------------------------------
#
# What of a navigation and its reference fits neither drift nor noise: clock and course.
#
# Over some minutes the error of a navigator that moves is, in the horizontal plane,
#
#     e(t) = tau v(t) + phi J p(t) + s p(t) + cubic in t
#
# with the velocity v of the reference, its displacement p from the start, a heading error phi and a
# scale error s; J turns by 90 degrees. Only a reference whose times are too large by tau makes an
# error that goes with the velocity, and an antenna ahead of the instrument one that looks alike.

SPAN = 1200.0  # For so long the drift of a navigator is a cubic, a quarter of a Schuler period [s].

EXPLAINS = 0.75
"""Part of the variance that drift leaves, of which the clock must explain as much [1]."""

FEWEST = 20  # Epochs below which nothing is said [1].
LEAST, LATEST = 0.02, 60.0  # A clock that is off by less, or by more, is not spoken of [s].
STEPS = 6  # Steps of the search [1].
STEADY = 0.02  # Part of the velocity that must not look like drift [1].


WAY = 100.0  # Courses are compared once the reference is so far from the start [m].

ASTRAY = np.radians(5.0)
"""Courses that differ by less are those of a poor heading, of which its sd tells [rad]."""


def course(errors: NavigationError, reference: Reference) -> tuple[Finding, ...]:
    """Return a warning where a navigation sets out in another direction than its reference."""
    if reference.still or reference.position is None:
        return ()
    place = reference.position[np.searchsorted(reference.time, errors.time)]
    known = np.isfinite(errors.position[:, :2]).all(axis=1)
    if not known.any():
        return ()
    path = earth.displacement(*place[known][0], *place[known].T)[:, :2]
    away = np.flatnonzero(np.hypot(*path.T) > WAY)
    if not len(away):
        return ()
    there = path[away[0]]
    error = errors.position[known][[0, away[0]], :2]
    computed = there + error[1] - error[0]
    # Drift that is as long as the way is no matter of heading.
    share = float(np.hypot(*computed) / np.hypot(*there))
    seen, wanted = (float(np.arctan2(*x)) for x in (computed, there))
    off = float(turned(np.array([seen - wanted]))[0])
    if abs(off) < ASTRAY or not 2 / 3 < share < 3 / 2:
        return ()
    words = {k: f"{np.degrees(v) % 360:.0f}" for k, v in (("seen", seen), ("wanted", wanted))}
    return (finding("navigate.course", off=f"{np.degrees(off):.0f}", **words),)


def clock(errors: NavigationError, reference: Reference) -> tuple[Finding, ...]:
    """Return a warning where a clock that is off explains most of the error beside drift."""
    late, speed = clock_offset(errors, reference)
    if not abs(late) > LEAST:
        return ()
    size = plain(abs(late), 2)
    way = "late" if late > 0 else "early"
    return (finding("navigate.clock", offset=size, way=way, distance=plain(abs(late) * speed, 2),
                    change="less" if late > 0 else "more",
                    place="ahead of" if late < 0 else "behind"),)  # fmt: skip


def clock_offset(errors: NavigationError, reference: Reference) -> tuple[float, float]:
    """Return by how much the times of a reference are too large, and the speed it is seen by.

    Returns `late`, `speed`: naN where the error does not show it [s], root mean square [m/s].
    """
    unseen = float("nan"), float("nan")
    if reference.still or reference.position is None:
        return unseen
    rows = np.searchsorted(reference.time, errors.time)
    known = np.isfinite(errors.position[:, :2]).all(axis=1) & (errors.age <= SPAN)
    if np.count_nonzero(known) < FEWEST:
        return unseen
    place = reference.position[rows[known]]
    path = earth.displacement(*place[0], *place.T)[:, :2]
    age = errors.age[known]
    velocity = np.gradient(path, age, axis=0)
    speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))
    if not speed > 0:
        return unseen
    across = path @ np.array([[0.0, -1.0], [1.0, 0.0]])
    drift = np.polynomial.polynomial.polyvander(age / age[-1], 3)
    A = np.column_stack([np.kron(np.eye(2), drift), _flat(across), _flat(path)])
    basis = np.linalg.svd(A / np.linalg.norm(A, axis=0), full_matrices=False)[0]
    e = _flat(errors.position[known, :2])
    late = explained = 0.0
    for _ in range(STEPS):  # on a long way off its course is not straight
        ahead = np.column_stack([np.interp(age + late, age, x) for x in path.T]) - path
        fast = np.column_stack([np.interp(age + late, age, x) for x in velocity.T])
        alone, left, v = (x - basis @ (basis.T @ x) for x in (e, e - _flat(ahead), _flat(fast)))
        if not np.linalg.norm(v) > STEADY * speed * np.sqrt(len(age)):
            return unseen  # a steady speed looks like drift
        step = float(v @ left / (v @ v))
        explained = 1 - float(np.sum((left - step * v) ** 2) / np.sum(alone**2))
        late += step
        if not abs(late) < LATEST:
            return unseen
    return (late, speed) if explained > EXPLAINS else unseen


def _flat(x: FloatArray) -> FloatArray:
    return np.concatenate(x.T)
