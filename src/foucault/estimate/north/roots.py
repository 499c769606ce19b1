"""Every solution that a set-up has, and which of them is taken.

Two components of the Earth's rate leave two signs of the third, and with stops that show one
direction only a circle of headings. Maximum likelihood is started from all of them; what fits alike
is told apart by what is known of hemisphere and rough heading, and the next best is kept
(design/README.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.estimate.north.reduction import Pairs
from foucault.models.earth import EARTH_RATE
from foucault.models.north_seeker import Compensation, earth_rate_b
from foucault.models.rotation import turned

Hemisphere = Literal["north", "south"]

ROUNDS = 60
"""Gauss-Newton steps at most [1]."""

EXACT = 1e-9
"""Standard deviation of a latitude that is known exactly [rad]."""

DISTINCT = 1e-5
"""Solutions nearer than this are one [rad]."""

PLAUSIBLE = 25.0
"""Another solution is possible where its sum of squares is larger by less than this, five sd: where
the rate along z_b is small, errors of the latitude are far from Gaussian [1]."""

AGAINST = 1e3
"""What speaks against the opposite hemisphere, or a case that hangs upside down, which two
components of gravity cannot tell from one that stands [1]."""

NEAR_SD = float(np.radians(10.0))
"""Standard deviation of a rough heading unless it is given, such as that of a compass [rad]."""

HARDLY = 0.1
"""A component of the rate with a larger sd, in horizontal Earth rates, is hardly seen [1]."""

DEFAULT = 1e-3
"""What speaks against the other sign of the rate along z_b, where both give the same hemisphere:
less than anything that is known, more than rounding [1]."""

LOST = 10.0
"""The rate along z_b is lost in the noise where its square is below this many sd of the horizontal
rate [1]: five sd of its own."""


@dataclass(frozen=True)
class Known:
    """What is known of the place and of the attitude before the readings."""

    gravity: float | FloatArray  # (m,) of all set-ups, or of each [m/s^2]
    # (m,) positive north, of all set-ups or of each [rad]; None where unknown
    latitude: float | FloatArray | None = None
    latitude_sd: float | FloatArray = 0.0  # (m,) its standard deviation [rad]
    hemisphere: Hemisphere = "north"  # decides between roots where the latitude is unknown
    # (m,) rough heading, good to `near_sd`, which decides between solutions that fit alike [rad]
    near: float | FloatArray | None = None
    near_sd: float = NEAR_SD  # standard deviation of that heading [rad]
    # how far from level the case may stand, about each axis; None where only the accelerometers
    # know [rad]
    level_sd: float | None = None

    def of(self, rows: npt.NDArray[np.int64]) -> Known:
        """Return what is known of some set-ups.

        `rows` (k,): their numbers [1].
        """
        names = ("gravity", "latitude", "latitude_sd", "near")
        each: dict[str, Any] = {name: getattr(self, name) for name in names}
        some: dict[str, Any] = {k: v[rows] for k, v in each.items() if isinstance(v, np.ndarray)}
        return replace(self, **some)


def compensated(
    values: FloatArray, gravity: float | FloatArray, compensation: Compensation
) -> FloatArray:
    """Return the four numbers without the errors of the instrument, shape (m, 4) [1].

    `values` (m, 4): as measured [SI]; `gravity` (m,): [m/s^2]; `compensation`: errors of the
    instrument, couplings of z are left in, as they need the attitude. Returns (m, 4): rates over
    the Earth's rate, specific forces over gravity, along x_b and y_b [1].
    """
    model = compensation.model
    rate = np.linalg.solve(model.gyro_matrix[:2, :2], (values[:, :2] - model.gyro_bias[:2]).T).T
    force = np.linalg.solve(model.accel_matrix[:2, :2], (values[:, 2:] - model.accel_bias[:2]).T).T
    return np.hstack([rate / EARTH_RATE, force / np.reshape(gravity, (-1, 1))])


def starts_of(
    pairs: Pairs, known: Known, compensation: Compensation
) -> tuple[list[FloatArray], FloatArray]:
    """Return where to start from.

    `pairs`: set-ups [SI]. Returns `starts` (m, 4): heading, pitch, roll, latitude [rad]; the
    likeliest first; `horizontal` (m,): rate along x_b and y_b over the Earth's, 0 where it is
    hardly seen [1].
    """
    N, M, x, s = compensated(pairs.values, known.gravity, compensation).T
    pitch, roll = tilt_of(x, s)
    # A direction that is hardly seen leaves more than the two roots.
    cos = 1.0 if known.latitude is None else np.cos(known.latitude)
    seen = np.linalg.eigvalsh(pairs.cov[:, :2, :2])[:, 1] < (HARDLY * EARTH_RATE * cos) ** 2
    horizontal = np.where(seen, np.hypot(N, M), 0.0)
    starts = []
    square = np.sqrt(np.maximum(1 - M**2 - N**2, 1e-6))
    for sign in (1.0, -1.0) if known.hemisphere == "north" else (-1.0, 1.0):
        heading, latitude = _attitude_of(N, M, sign * square, pitch, roll)
        if known.latitude is not None:
            reach = 5 * known.latitude_sd
            latitude = np.clip(latitude, known.latitude - reach, known.latitude + reach)
        starts.append(np.stack([heading, pitch, roll, latitude], 1))
    if known.latitude is not None and not seen.all():
        for heading in np.radians(np.arange(0.0, 360.0, 30.0)):
            same = np.ones_like(pitch)
            starts.append(np.stack([heading * same, pitch, roll, known.latitude * same], 1))
    return starts, horizontal


def tilt_of(x: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pitch and roll [rad] of two components of up, made shorter than 1 where they are not.

    `x`, `s` (m,): up along x_b and y_b [1].
    """
    shorter = np.maximum(np.hypot(s, x) / 0.99999, 1.0)
    s, x = s / shorter, x / shorter
    return np.arcsin(s), np.arctan2(-x, np.sqrt(np.maximum(1 - s**2 - x**2, 0.0)))


def _attitude_of(
    N: FloatArray, M: FloatArray, W: FloatArray, pitch: FloatArray, roll: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return heading and latitude of three components of the Earth's rate."""
    X = np.cos(roll) * N + np.sin(roll) * W
    q = np.cos(roll) * W - np.sin(roll) * N
    Y = np.cos(pitch) * M - np.sin(pitch) * q
    Z = np.sin(pitch) * M + np.cos(pitch) * q
    return np.arctan2(-X, Y) % (2 * np.pi), np.arctan2(Z, np.hypot(X, Y))


@dataclass
class Best:
    """The best solution of each set-up, and the next best."""

    angles: FloatArray  # (m, 4) heading, pitch, roll, latitude [rad]
    cov: FloatArray  # (m, 4, 4) covariance [rad^2]
    # (m, 4, 5) slope of the angles against the four numbers [1/SI] and a latitude known before [1]
    gain: FloatArray
    square: FloatArray  # (m,) sum of squares [1]
    status: npt.NDArray[np.int8]  # (m,) see `kernels.north_seeking`
    rank: FloatArray  # (m,) the sum of squares, with what speaks against the solution [1]
    other: FloatArray  # (m, 4) the next best [rad]
    other_square: FloatArray  # (m,) its sum of squares, with what speaks against it [1]


def best_of(
    pairs: Pairs, covariance: FloatArray, known: Known, compensation: Compensation,
    starts: list[FloatArray],
) -> Best:  # fmt: skip
    """Solve from every start, and rank what was found.

    `pairs`: set-ups [SI]; `covariance` (m, 4, 4): of their numbers [SI]; `starts` (m, 4): where
    to start from [rad].
    """
    found = [_from(pairs, covariance, known, compensation, start) for start in starts]
    angles = np.stack([f[0] for f in found])
    solved = np.stack([f[5] == 0 for f in found])
    square = np.stack([np.where(np.isfinite(f[3]), f[3], np.inf) for f in found])
    latitude_var = np.stack([f[1][:, 3, 3] for f in found])
    # An unfinished solution is better than none, where no other is better.
    rank = square + _preference(angles, latitude_var, known) + np.where(solved, 0.0, 1e6)
    order = np.argsort(rank, axis=0, kind="stable")
    each = np.arange(len(pairs))
    pick = order[0]
    best = angles[pick, each]
    other, other_square = np.full_like(best, np.nan), np.full(len(pairs), np.inf)
    for k in order[1:][::-1]:  # the best of those that differ is written last
        there = angles[k, each]
        apart = _apart(there, best)
        take = (apart > DISTINCT) & solved[k, each]
        other[take], other_square[take] = there[take], rank[k, each][take]
    cov, gain, square, status = (np.stack([f[i] for f in found])[pick, each] for i in (1, 2, 3, 5))
    return Best(best, cov, gain, square, status, rank[pick, each], other, other_square)


def _apart(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return how far two solutions are apart in heading or latitude, shape (m,) [rad]."""
    return np.maximum(np.abs(turned(a[:, 0] - b[:, 0])), np.abs(a[:, 3] - b[:, 3]))


def _preference(angles: FloatArray, latitude_var: FloatArray, known: Known) -> FloatArray:
    """Return what speaks against solutions that fit alike, in squares of a sd, (k, m) [1]."""
    out = np.where(np.abs(angles[..., 2]) > np.pi / 2, AGAINST, 0.0)
    if known.latitude is None:  # no reading knows the hemisphere
        sign = 1.0 if known.hemisphere == "north" else -1.0
        beyond = np.maximum(-sign * angles[..., 3], 0.0)
        out += np.minimum(beyond**2 / np.maximum(latitude_var, EXACT**2), AGAINST)
        along_z = earth_rate_b(*np.moveaxis(angles, -1, 0))[..., 2]
        out += np.where(sign * along_z < 0, DEFAULT, 0.0)
    if known.near is not None:
        out += 2 * (1 - np.cos(angles[..., 0] - known.near)) / known.near_sd**2
    return out


def _from(
    pairs: Pairs, cov: FloatArray, known: Known, compensation: Compensation, start: FloatArray
) -> tuple[FloatArray, ...]:
    from foucault.kernels.north_seeking import likelihood_batch

    model = compensation.model
    A = np.vstack([model.gyro_matrix[:2], model.accel_matrix[:2]])
    b = np.concatenate([model.gyro_bias[:2], model.accel_bias[:2]])
    m = len(pairs)
    latitude = np.full(m, 0.0 if known.latitude is None else known.latitude)
    sd = np.full(m, np.inf if known.latitude is None else np.maximum(known.latitude_sd, EXACT))
    found: tuple[FloatArray, ...] = likelihood_batch(
        pairs.values, cov, start, A, b, np.full(m, known.gravity), EARTH_RATE, latitude, sd, ROUNDS
    )
    return found


def widen(
    best: Best, horizontal: FloatArray, pairs: Pairs, known: Known, compensation: Compensation,
    budget: dict[str, FloatArray],
) -> None:  # fmt: skip
    """Where the rate along z_b is lost in the noise, let the uncertainty cover both its signs.

    W = sqrt(1 - r^2) has no slope where r, the horizontal rate, is 1: there W is nothing better
    than sqrt(2 k) for an error k of r.

    `horizontal` (m,): r [1]; `pairs`: set-ups [SI]; `budget` (m, 4): variances by source, changed
    to what they do beside W [rad^2].
    """
    direction = pairs.values[:, :2] / np.maximum(
        np.linalg.norm(pairs.values[:, :2], axis=1, keepdims=True), 1e-300
    )
    sd = np.sqrt(np.einsum("ni,nij,nj->n", direction, pairs.cov[:, :2, :2], direction)) / EARTH_RATE
    lost = (1.0 - horizontal**2 < LOST * sd) & np.isfinite(best.angles[:, 0])
    if not lost.any():
        return
    N, M, x, s = compensated(pairs.values[lost], known.gravity, compensation).T
    excess = np.maximum(np.hypot(N, M), 1.0)
    W = np.sqrt(LOST * sd[lost])
    pitch, roll = tilt_of(x, s)
    ends = [_attitude_of(N / excess, M / excess, sign * W, pitch, roll) for sign in (1.0, -1.0)]
    across = np.stack([-direction[lost, 1], direction[lost, 0]], 1)
    turn = np.einsum("ni,nij,nj->n", across, pairs.cov[lost, :2, :2], across) / EARTH_RATE**2
    tilt = np.einsum("nii->n", pairs.cov[lost, 2:, 2:]) / known.gravity**2
    for axis, k, other in ((0, 0, turn), (3, 1, tilt)):
        half = turned(ends[0][k] - ends[1][k]) / 2
        best.cov[lost, axis, :], best.cov[lost, :, axis] = 0.0, 0.0
        best.cov[lost, axis, axis] = half**2 + other
        linear = np.asarray(sum(v[lost, axis] for v in budget.values()))
        for v in budget.values():  # the sources share what they do beside W
            v[lost, axis] *= other / np.maximum(linear, 1e-300)
    best.status[lost] = 1
