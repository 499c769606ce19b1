"""From the readings of a set-up to the four numbers that say everything of its attitude.

Each reading is linear in the rates c, s along y_b and x_b, and in what is of no interest::

    gyro_k = c cos a_k + s sin a_k + offset + drift (t_k - t_mid) + noise

Generalised least squares with the full covariance of the noise (white, bias instability and random
walk, exactly averaged over each dwell) gives (s, c); accelerometers likewise. Nothing is lost: for
Gaussian noise the four numbers with their covariance carry all the information of the readings.
The covariance is kept apart by source, because the weights are known: ``sum_s W Sigma_s W'``.

Set-ups with the same stops at the same times share their weights.

Every solution that a set-up has, and which of them is taken.

Two components of the Earth's rate leave two signs of the third, and with stops that show one
direction only a circle of headings. Maximum likelihood is started from all of them; what fits alike
is told apart by what is known of hemisphere and rough heading, and the next best is kept
(design/README.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray, transposed
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise, mean_variance, window_covariance
from foucault.models.north_seeker import Compensation, Dwells, earth_rate_b
from foucault.models.rotation import turned

UNSEEN = 1e4
"""Variance, in squares of the Earth's rate or of g, of a component that no reading shows; larger,
and rounding would lose what is seen of the component across it [1]."""

GRAVITY = 9.8
"""Scale of specific force, for `UNSEEN` only [m/s^2]."""

GYRO_NOISE, GYRO_DRIFT, GYRO_OFFSET = "gyro noise", "gyro drift", "gyro offset"
TILT_NOISE, TILT_DRIFT, INDEXING = "tilt: noise", "tilt: drift", "indexing"

NEARLY_FREE = 1.1
"""A drift is estimated by itself where it makes no rate less certain than by this factor [1]."""


@dataclass(frozen=True)
class Nuisance:
    """What is known of offset, drift and index angles beforehand."""

    # offset, offset_sd: the gyro's constant offset and its standard deviation, infinite where
    # nothing is known [rad/s]
    offset: float = 0.0
    offset_sd: float = np.inf
    # of its linear drift; 0 for none, infinite where it is estimated freely [rad/s^2]
    drift_sd: float = 0.0
    index_sd: float = 0.0  # of every index angle [rad]
    # of the time between the index angle and the middle of the gyro's reading, which matters where
    # the base turns [s]
    lag_sd: float = 0.0


@dataclass(frozen=True)
class Pairs:
    """The four numbers of m set-ups, in the order gyro x, gyro y, accelerometer x, y."""

    # (m, 4) rate along x_b and y_b [rad/s], specific force along them [m/s^2], as measured
    values: FloatArray
    sources: dict[str, FloatArray]  # (m, 4, 4) covariance by source [SI]
    # offset, drift: (m,) of the gyro [rad/s], [rad/s^2]
    offset: FloatArray
    drift: FloatArray
    # (m, 4) what a linear drift of 1 rad/s^2 that is not estimated does to the four numbers [s]
    drift_slope: FloatArray
    fit: FloatArray  # (n,) of every gyro reading [rad/s]
    # residuals, accel_residuals: (n,) of every reading over its standard deviation, NaN where
    # nothing controls it [1]
    residuals: FloatArray
    accel_residuals: FloatArray
    # chi_square, dof: (m, 2) sum of squares of the white residuals of gyro and accelerometers [1]
    chi_square: FloatArray
    dof: IntArray
    # (n, q) white residuals of the q accelerometers, independent but for what the fit took [1]
    accel_white: FloatArray = field(default_factory=lambda: np.zeros((0, 1)))
    # gyro_weights, accel_weights: (n, 2), (n, q, 2) what a reading adds to its set-up's rates, and
    # to its specific forces, along x_b and y_b [1]
    gyro_weights: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    accel_weights: FloatArray = field(default_factory=lambda: np.zeros((0, 1, 2)))

    def __len__(self) -> int:
        return len(self.values)

    @property
    def cov(self) -> FloatArray:
        """Covariance of all sources together, shape (m, 4, 4) [SI]."""
        return np.asarray(sum(self.sources.values()))

    @property
    def noise_alone(self) -> Pairs:
        """The same with the white noise alone, for a bound."""
        kept = {k: v for k, v in self.sources.items() if k in (GYRO_NOISE, TILT_NOISE)}
        return replace(self, sources=kept)


@dataclass
class _Fit:
    """One linear fit of g set-ups with the same stops, or of 1 whose weights all of them share."""

    weights: FloatArray  # (g, p, k) of p unknowns from k readings
    design: FloatArray  # (k, p) readings from unknowns
    root: FloatArray  # (g, k, k) of the covariance of the readings
    white: FloatArray  # (k,) its white part
    slow: FloatArray  # (k, k) what wanders
    redundancy: FloatArray  # (g, k) of each reading [1]
    dof: IntArray  # (g,) readings that are not spent [1]
    drift: FloatArray = field(default_factory=lambda: np.zeros(0))  # (k,) times of the readings [s]


def reduce(dwells: Dwells, noise: ImuNoise, nuisance: Nuisance | None = None) -> Pairs:
    """Reduce set-ups to their four numbers, by noise and what is known of the rest [SI]."""
    nuisance = nuisance or Nuisance()
    n, m = len(dwells), len(dwells.names)
    values, slope = np.zeros((m, 4)), np.zeros((m, 4))
    names = (GYRO_NOISE, GYRO_DRIFT, GYRO_OFFSET, TILT_NOISE, TILT_DRIFT, INDEXING)
    parts = {name: np.zeros((m, 4, 4)) for name in names}
    offset, drift = np.zeros(m), np.zeros(m)
    fit, residuals = np.zeros(n), np.full((2, n), np.nan)
    chi_square, dof = np.zeros((m, 2)), np.zeros((m, 2), np.int64)
    accel_white = np.zeros((n, 1) if dwells.accel is None else dwells.accel.shape)
    gyro_weights, accel_weights = np.zeros((n, 2)), np.zeros((*accel_white.shape, 2))
    # Wrong index angles act by the slope of each set-up's own curve: then none share weights.
    for setups, rows in _alike(dwells, apart=nuisance.index_sd > 0):
        first = dwells.rows(rows[0])
        wrong = _index_variance(dwells, rows, noise, nuisance)
        gyro = _gyro_fit(first, noise.gyro, nuisance, wrong[0])
        unknowns = _times(gyro.weights, dwells.gyro[rows] - nuisance.offset)
        values[setups, :2], offset[setups] = unknowns[:, :2], unknowns[:, 2] + nuisance.offset
        drift[setups] = unknowns[:, 3] if unknowns.shape[1] > 3 else 0.0
        fit[rows] = unknowns @ gyro.design.T + nuisance.offset
        _judge(gyro, dwells.gyro[rows] - fit[rows], setups, rows, 0, residuals, chi_square, dof)
        W = gyro.weights[:, :2]
        gyro_weights[rows] = transposed(W)
        parts[GYRO_NOISE][setups, :2, :2] = (W * gyro.white) @ transposed(W) + _unseen(
            gyro, EARTH_RATE
        )
        parts[GYRO_DRIFT][setups, :2, :2] = W @ gyro.slow @ transposed(W)
        slope[setups, :2] = moved = W @ gyro.drift
        if np.isfinite(nuisance.drift_sd):  # what the prior leaves of it, at its full size
            parts[GYRO_DRIFT][setups, :2, :2] += nuisance.drift_sd**2 * _square(moved)
        if np.isfinite(nuisance.offset_sd):
            moved = W.sum(axis=2)
            parts[GYRO_OFFSET][setups, :2, :2] = nuisance.offset_sd**2 * _square(moved)
        all_weights = np.zeros((len(W), 2, 4, rows.shape[1]))
        all_weights[:, 0, :2] = W
        if dwells.accel is not None:
            accel = _accel_fit(first, noise.accel, wrong[1])
            A = dwells.accel[rows].reshape(len(rows), -1)
            found = _times(accel.weights, A)
            values[setups, 2:] = found[:, :2]
            left = A - found @ accel.design.T
            accel_white[rows] = _whitened(accel.root, left.reshape(*rows.shape, -1))
            if dwells.accel.shape[1] == 1:
                _judge(accel, left, setups, rows, 1, residuals, chi_square, dof)
                all_weights[:, 1, 2:] = accel.weights[:, :2]
            else:  # two a row: of the scatter alone
                chi_square[setups, 1] = np.sum(accel_white[rows] ** 2, axis=(1, 2))
                dof[setups, 1] = 2 * accel.dof
            V = accel.weights[:, :2]
            accel_weights[rows] = transposed(V).reshape(len(V), rows.shape[1], -1, 2)
            unseen = _unseen(accel, GRAVITY)
            parts[TILT_NOISE][setups, 2:, 2:] = (V * accel.white) @ transposed(V) + unseen
            parts[TILT_DRIFT][setups, 2:, 2:] = V @ accel.slow @ transposed(V)
        else:
            parts[TILT_NOISE][setups, 2:, 2:] = UNSEEN * GRAVITY**2 * np.eye(2)
        if nuisance.index_sd or nuisance.lag_sd:
            parts[INDEXING][setups] = _indexing(first, all_weights, values[setups], nuisance)
    used = {k: v for k, v in parts.items() if v.any()}
    return Pairs(values, used, offset, drift, slope, fit, residuals[0], residuals[1],
                 chi_square, dof, accel_white, gyro_weights, accel_weights)  # fmt: skip


AT_ONCE = 1 << 22
"""Numbers that the covariances of set-ups fitted together may have [1]."""


def _alike(dwells: Dwells, *, apart: bool) -> list[tuple[IntArray, IntArray]]:
    """Return groups of set-ups with the same stops: their numbers (g,), and their rows (g, k).

    With `apart` each has weights of its own, so that not too many are in one.
    """
    order = np.argsort(dwells.setup, kind="stable")
    edges = np.searchsorted(dwells.setup[order], np.arange(len(dwells.names) + 1))
    count = np.diff(edges)
    out = []
    for k in np.unique(count):
        setups = np.flatnonzero(count == k)
        rows = order[edges[setups, None] + np.arange(k)]
        start = dwells.start[rows] - dwells.start[rows[:, :1]]
        shape = np.stack([dwells.cosine[rows], dwells.sine[rows], dwells.time[rows], start], 1)
        groups: dict[bytes, list[int]] = {}
        for i, one in enumerate(np.round(shape, 9)):
            groups.setdefault(one.tobytes(), []).append(i)
        for found in groups.values():
            most = max(AT_ONCE // int(k) ** 2, 1) if apart else len(found)
            pieces = [found[i : i + most] for i in range(0, len(found), most)]
            out += [(setups[piece], rows[piece]) for piece in pieces]
    return out


def _times(weights: FloatArray, x: FloatArray) -> FloatArray:
    """Return what readings `x` (g, k) say of the unknowns, shape (g, p)."""
    if len(weights) == 1:
        return np.asarray(x @ weights[0].T)
    return np.asarray((weights @ x[..., None])[..., 0])


def _square(x: FloatArray) -> FloatArray:
    """Return the product of each row of `x` (g, p) with itself, shape (g, p, p)."""
    return x[:, :, None] * x[:, None, :]


def _whitened(root: FloatArray, x: FloatArray) -> FloatArray:
    """Return readings `x` (g, k, q) of covariance `root` (g, k, k) or (1, k, k) as white ones."""
    if len(root) > 1:
        return np.asarray(np.linalg.solve(root, x))
    g, k, q = x.shape
    side_by_side = np.moveaxis(x, 0, 1).reshape(k, -1)
    return np.moveaxis(np.linalg.solve(root[0], side_by_side).reshape(k, g, q), 0, 1)


def _index_variance(
    dwells: Dwells, rows: IntArray, noise: ImuNoise, nuisance: Nuisance
) -> tuple[FloatArray, FloatArray]:
    """Return what wrong index angles add to the variance of gyro and accelerometer, (g, k) each.

    `rows` (g, k): of set-ups with the same stops. What adds nothing has one row.
    """
    d = dwells.rows(rows[0])
    none = np.zeros((1, len(d)))
    if not nuisance.index_sd or d.rotates:  # one error of a rotation leaves no residual
        return none, none

    def of(fit: _Fit, said: FloatArray) -> FloatArray:
        x, y = _times(fit.weights, said)[:, :2].T
        return (nuisance.index_sd * (np.outer(x, d.cosine) - np.outer(y, d.sine))) ** 2

    gyro = of(_gyro_fit(d, noise.gyro, nuisance, none), dwells.gyro[rows] - nuisance.offset)
    if dwells.accel is None or dwells.accel.shape[1] > 1:
        return gyro, none
    return gyro, of(_accel_fit(d, noise.accel, none), dwells.accel[rows, 0])


def _gyro_fit(d: Dwells, noise: TriadNoise, nuisance: Nuisance, more: FloatArray) -> _Fit:
    mid = d.start + d.time / 2
    t = mid - np.average(mid, weights=d.time)
    design, sds = [d.sine, d.cosine, np.ones(len(d))], [np.inf, np.inf, nuisance.offset_sd]
    if nuisance.drift_sd > 0:
        design.append(t)
        sds.append(nuisance.drift_sd)
    fit = _fit(np.stack(design, 1), np.array(sds), d, noise, EARTH_RATE, more)
    fit.drift = t
    return fit


def _accel_fit(d: Dwells, noise: TriadNoise, more: FloatArray) -> _Fit:
    assert d.accel is not None
    if d.accel.shape[1] == 1:
        design = np.stack([d.sine, d.cosine, np.ones(len(d))], 1)
        return _fit(design, np.full(3, np.inf), d, noise, GRAVITY, more)
    # Two accelerometers that stay with the case: each the mean of its rows, in the order of rows.
    one = _fit(np.ones((len(d), 1)), np.full(1, np.inf), d, noise, GRAVITY, np.zeros((1, len(d))))
    both = np.eye(2)
    weights, design, slow = (
        np.asarray(np.kron(part, both), float) for part in (one.weights[0], one.design, one.slow)
    )
    white = np.repeat(one.white, 2)
    return _Fit(weights[None], design, one.root, white, slow, one.redundancy, one.dof)


def _fit(
    design: FloatArray, sd: FloatArray, d: Dwells, noise: TriadNoise, size: float, more: FloatArray
) -> _Fit:
    """Weigh readings for unknowns with prior standard deviations `sd`, by least squares.

    `d`: stops that all have; `more` (g, k): variance of the readings of each beside the noise.
    """
    white = mean_variance(replace(noise, bias_instability=0.0, random_walk=0.0), d.time, d.interval)
    begin = d.start - d.start.min()
    slow = np.zeros((len(d), len(d)))
    if noise.bias_instability or noise.random_walk:
        slow = window_covariance(begin, begin + d.time, noise)
    own = (white + more)[:, :, None] * np.eye(len(d))
    root = np.asarray(np.linalg.cholesky(own + slow), float)
    J = np.linalg.solve(root, design[None])  # one for all: NumPy 1 takes (n, k) for vectors
    # The first two unknowns get the widest prior that still counts as one: without it a component
    # that no reading shows would have no variance at all.
    known = np.where(np.isfinite(sd), 1.0 / np.maximum(sd, 1e-300) ** 2, 0.0)
    if design.shape[1] > 1:
        known[:2] += 1.0 / (UNSEEN * size**2)
    scale = np.sqrt(np.sum(J**2, axis=1) + known)
    scale[scale == 0] = 1.0
    J = J / scale[:, None]
    normal = transposed(J) @ J + (known / scale**2)[:, :, None] * np.eye(len(known))
    gain = np.linalg.pinv(normal, rcond=1e-13, hermitian=True) @ transposed(J)
    hat = J @ gain
    weights = transposed(np.linalg.solve(transposed(root), transposed(gain / scale[:, :, None])))
    spent = np.rint(np.trace(hat, axis1=1, axis2=2)).astype(np.int64)
    redundancy = 1.0 - np.diagonal(hat, axis1=1, axis2=2)
    dof = np.maximum(len(d) - spent, 0)
    return _Fit(np.asarray(weights, float), design, root, white, slow, redundancy, dof)


def _unseen(fit: _Fit, size: float) -> FloatArray:
    """Return the variance of what the readings do not show of the first two unknowns, (g, 2, 2)."""
    # With its weights a visible component is returned in full, W X = I; what is missing is unseen.
    missing = np.eye(2) - (fit.weights @ fit.design)[:, :2, :2]
    U, s, _ = np.linalg.svd(missing)  # a direction is unseen or seen, rounding apart
    U = U * (s > 0.5)[:, None]
    return np.asarray(UNSEEN * size**2 * U @ transposed(U))


def _judge(
    fit: _Fit, left: FloatArray, setups: IntArray, rows: IntArray, sensor: int,
    residuals: FloatArray, chi_square: FloatArray, dof: IntArray,
) -> None:  # fmt: skip
    """Standardize what the fit has left of the readings of alike set-ups."""
    white = _whitened(fit.root, left[..., None])[..., 0]
    controlled = fit.redundancy > 1e-6
    share = np.sqrt(np.where(controlled, fit.redundancy, 1.0))
    residuals[sensor, rows] = np.where(controlled, white / share, np.nan)
    chi_square[setups, sensor] = np.sum(white**2, axis=1)
    dof[setups, sensor] = fit.dof


def turn_rate(d: Dwells) -> float:
    """Return how fast the base turns [rad/s]."""
    return float(np.ptp(np.unwrap(d.index))) / max(float(np.ptp(d.start)), 1e-9)


def _indexing(d: Dwells, weights: FloatArray, values: FloatArray, nuisance: Nuisance) -> FloatArray:
    """Covariance of wrong index angles, shape (g, 4, 4), by `weights` (g or 1, 2, 4, k).

    Stops are each off by themselves; a base that turns is off by the same angle all the time.
    """
    across = np.stack([d.cosine, -d.sine])  # d e / d a = (cos a, -sin a)
    slope = np.stack([values[:, :2] @ across, values[:, 2:] @ across], 1)  # gyro, accelerometer
    moved = np.sum(weights * slope[:, :, None], axis=1)
    variance = nuisance.index_sd**2
    if d.rotates:
        moved = moved.sum(axis=2, keepdims=True)
        variance += (turn_rate(d) * nuisance.lag_sd) ** 2
    return np.asarray(variance * moved @ transposed(moved))


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
        """Return what is known of the set-ups of numbers `rows` (k,) [1]."""
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
    """Return pitch and roll [rad] of up along x_b, y_b, `x`, `s` (m,), at most 1 together."""
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
    """Solve from `starts` (m, 4) [rad] by `covariance` (m, 4, 4) [SI], the best first."""
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


def spans(angles: list[int]) -> bool:
    """Tell whether constant, cosine and sine over whole-degree `angles` [deg] are told apart."""
    a = np.radians(np.array(angles, float))
    design = np.stack([np.ones_like(a), np.cos(a), np.sin(a)], 1)
    return len(a) >= 3 and bool(np.linalg.svd(design, compute_uv=False)[-1] > 0.05)
