"""Calibrate many instruments that went through the same positions, in one batch.

Norm observation by its linear equations with the exact recovery (`estimate.norm_observation`), the
frames tied together by parallel vectors (`estimate.norm_observation`), and the covariance by
first-order propagation. With the inverse ``x = inv(M) (N - b)`` of the model, a reading leaves the
residual ``r = |x| - h`` of its norm; noise of variance v per axis gives it the variance
``v |m|^2`` with ``m = inv(M)' x / |x|``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.kernels.norm_observation import calibrate_batch
from foucault.models.imu import LAYOUT, LINEAR_LOWER

STATUS = ("solved", "singular", "no ellipsoid", "not finite")  # What the number of a status means.
NEEDED = 9  # Rests, and spins, that the linear equations need [1].

SIZE = len(LINEAR_LOWER)
_ROWS, _COLUMNS = np.tril_indices(SIZE)
DIAGONAL = np.flatnonzero(_ROWS == _COLUMNS)
_OFF_ACCEL = ((1, 0), (2, 0), (2, 1))
_OFF_GYRO = tuple((i, j) for i in range(3) for j in range(3) if i != j)


@dataclass(frozen=True)
class FleetReadings:
    """Means of N instruments over the same m rests and k spins."""

    rest: FloatArray  # (N, m, 3) mean specific force at rest, frame b [m/s^2]
    # accel, gyro: (N, k, 3) mean specific force and mean rate in spins, frame b [m/s^2] and [rad/s]
    accel: FloatArray
    gyro: FloatArray
    # rest_variance, accel_variance, gyro_variance: (N, m) variance of the noise of these means, per
    # axis; with a first axis of 1 it is that of all instruments [SI]
    rest_variance: FloatArray
    accel_variance: FloatArray
    gyro_variance: FloatArray
    # (k,) norm of the true mean rate of each spin, negative where clockwise seen from above [rad/s]
    rate: FloatArray
    gravity: float  # local gravity [m/s^2]

    def __len__(self) -> int:
        return len(self.rest)

    def __getitem__(self, some: BoolArray | IntArray) -> FleetReadings:
        """Return some of the instruments, by mask or by number."""
        rest, accel, gyro = (x[some] if len(x) > 1 else x for x in self.variances)
        return replace(
            self, rest=self.rest[some], accel=self.accel[some], gyro=self.gyro[some],
            rest_variance=rest, accel_variance=accel, gyro_variance=gyro,
        )  # fmt: skip

    @property
    def variances(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The three variances."""
        return self.rest_variance, self.accel_variance, self.gyro_variance

    def with_variance_times(self, accel: FloatArray, gyro: FloatArray) -> FleetReadings:
        """Return them with variances times `accel`, `gyro`, (N,) or (1,) [1]."""
        a, w = accel[:, None], gyro[:, None]
        return replace(
            self, rest_variance=self.rest_variance * a, accel_variance=self.accel_variance * a,
            gyro_variance=self.gyro_variance * w,
        )  # fmt: skip


@dataclass(frozen=True)
class FleetEstimate:
    """Coefficients of N instruments with their covariance; NaN where the status is not 0."""

    values: FloatArray  # (N, 21) coefficients in the order of `models.imu.LINEAR_LOWER` [SI]
    packed: FloatArray  # (N, 231) lower triangles of their covariances, row by row [SI]
    lever_arm: FloatArray  # (N, 3) the accelerometers from the centre of the table, frame b [m]
    lever_arm_cov: FloatArray  # (N, 3, 3) covariance of it [m^2]
    status: IntArray  # (N,) number of the status in `STATUS`
    # (N, 2) sum of squares of the norm residuals over their sds, accelerometers and gyros [1]
    chi_square: FloatArray
    # (2,) readings beyond what the coefficients need: what `chi_square` should be [1]
    redundancy: FloatArray
    # (N, 2) sd of one reading per axis that the residuals tell; NaN without redundancy [SI]
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.status)

    @property
    def solved(self) -> BoolArray:
        """Which instruments were solved, shape (N,)."""
        return np.asarray(self.status == 0)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (N, 21) [SI]."""
        return np.asarray(np.sqrt(self.packed[:, DIAGONAL]))

    @property
    def ratio(self) -> FloatArray:
        """Chi-square over redundancy, shape (N, 2) [1]; NaN without redundancy."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.redundancy > 0, self.chi_square / self.redundancy, np.nan)

    def cov(self, i: int) -> FloatArray:
        """Return the covariance of instrument `i`, shape () [1], shape (21, 21) [SI]."""
        out = np.empty((SIZE, SIZE))
        out[_ROWS, _COLUMNS] = out[_COLUMNS, _ROWS] = self.packed[i]
        return out

    def coefficients(self, i: int) -> CoefficientVector:
        """Return the coefficients of instrument `i`, shape () [1], with covariance."""
        return CoefficientVector(LAYOUT.subset(LINEAR_LOWER), self.values[i], self.cov(i))


def calibrate(readings: FleetReadings, *, lever_arm: bool = True) -> FleetEstimate:
    """Calibrate all [SI]; what is singular has a status. Raises ``fleet.shape``: shapes differ."""
    _check(readings)
    r = readings
    blocks = [np.ascontiguousarray(x, float) for x in (r.rest, r.accel, r.gyro)]
    rate = np.ascontiguousarray(r.rate, float)
    table = np.concatenate(r.variances, axis=1) if _alike(r) else np.concatenate(
        [np.broadcast_to(v, (len(r), v.shape[1])) for v in r.variances], axis=1
    )  # fmt: skip
    rows, which = np.unique(table, axis=0, return_inverse=True) if len(table) > 1 else (table, None)
    m, k = r.rest.shape[1], r.gyro.shape[1]
    parts = []
    for number, row in enumerate(rows):  # one batch for every set of variances: mostly one
        mine = slice(None) if len(rows) == 1 else np.flatnonzero(np.ravel(which) == number)
        rest, accel, gyro = (x[mine] for x in blocks)
        found = calibrate_batch(
            rest, row[:m].copy(), accel, row[m : m + k].copy(), gyro, row[m + k :].copy(),
            rate, float(r.gravity), bool(lever_arm),
        )  # fmt: skip
        parts.append((mine, found))
    if len(parts) == 1:
        return _wrapped(r, parts[0][1])
    joined = [np.empty((len(r), *x.shape[1:]), x.dtype) for x in parts[0][1]]
    for mine, found in parts:
        for target, x in zip(joined, found, strict=True):
            target[mine] = x
    return _wrapped(r, joined)


def _alike(r: FleetReadings) -> bool:
    return all(len(v) == 1 for v in r.variances)


def _check(r: FleetReadings) -> None:
    n, m, k = len(r.rest), r.rest.shape[1], len(r.rate)
    want = {
        "rest": (n, m, 3), "accel": (n, k, 3), "gyro": (n, k, 3), "rest_variance": (n, m),
        "accel_variance": (n, k), "gyro_variance": (n, k),
    }  # fmt: skip
    for name, shape in want.items():
        given = getattr(r, name).shape
        if given != shape and not (name.endswith("variance") and given == (1, *shape[1:])):
            raise error("fleet.shape", what=name, given=given, allowed=shape)


def _wrapped(r: FleetReadings, found: list[FloatArray]) -> FleetEstimate:
    Ma, ba, Mg, bg, arm, packed, arm_cov, _, kernel_status = found
    status: IntArray = kernel_status.astype(np.int64)
    diagonals = [np.diagonal(M, axis1=1, axis2=2) - 1.0 for M in (Ma, Mg)]
    off_accel = np.stack([Ma[:, i, j] for i, j in _OFF_ACCEL], axis=1)
    off_gyro = np.stack([Mg[:, i, j] for i, j in _OFF_GYRO], axis=1)
    values = np.concatenate([ba, diagonals[0], off_accel, bg, diagonals[1], off_gyro], axis=1)
    finite = [np.isfinite(x).all(axis=(1, 2)) for x in (r.rest, r.accel, r.gyro)]
    status[~np.logical_and.reduce(finite)] = STATUS.index("not finite")
    status[(status == 0) & ~np.isfinite(values).all(axis=1)] = STATUS.index("not finite")
    bad = status != 0
    if bad.any():
        for x in (values, packed, arm, arm_cov):
            x[bad] = np.nan
        Ma, Mg = Ma.copy(), Mg.copy()
        Ma[bad] = Mg[bad] = np.eye(3)
        ba, bg = values[:, :3], values[:, 9:12]
    triads = (
        _residuals(r.rest, Ma, ba, np.full(r.rest.shape[1], r.gravity), r.rest_variance),
        _residuals(r.gyro, Mg, bg, np.abs(r.rate), r.gyro_variance),
    )
    redundancy = np.array([r.rest.shape[1] - NEEDED, r.gyro.shape[1] - NEEDED], float)
    with np.errstate(invalid="ignore", divide="ignore"):
        noise = np.stack([np.sqrt(t[1] / d) for t, d in zip(triads, redundancy, strict=True)], 1)
    noise[:, redundancy <= 0] = np.nan
    chi_square = np.stack([t[0] for t in triads], axis=1)
    return FleetEstimate(values, packed, arm, arm_cov, status, chi_square, redundancy, noise)


def _residuals(
    N: FloatArray, M: FloatArray, b: FloatArray, h: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the sums over readings of ``r^2 / (v |m|^2)`` and of ``r^2 / |m|^2``, (N,)."""
    inverse = np.linalg.inv(M)
    x = (N - b[:, None, :]) @ np.swapaxes(inverse, 1, 2)
    norm = np.sqrt(np.einsum("nji,nji->nj", x, x))
    m = x @ inverse
    # m is x' inv(M) and not yet divided by |x|
    squares = ((norm - h) * norm) ** 2 / np.einsum("nji,nji->nj", m, m)
    return np.sum(squares / variance, axis=1), np.sum(squares, axis=1)
