"""Two calibrated instruments on one body: how the axes of one lie in those of the other.

At rest both feel the same specific force, ``f_a = C_ab f_b``, whatever lies between them. With
means over rests of different orientations ``C_ab = exp([r x]) C`` is the rotation that leaves the
least squares of ``f_a - C_ab f_b``; about a solution C ::

    r = N^-1 sum_i [f_a,i x]^T (C f_b,i - f_a,i),    N = sum_i [f_a,i x]^T [f_a,i x]

which is linear in both forces. Its covariance is that of what is left over the rests,
and of both calibrations, whose errors move all rests together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.stretches import find_rests
from foucault.models.imu import ImuModel
from foucault.models.layouts import of_one_sample, of_sensors
from foucault.models.rotation import cross_matrix
from foucault.models.rotation import log as rotation_vector
from foucault.result import Result
from foucault.tables import Log

FEWEST = 3  # Rests that a rotation is told from at least [1].
ALONG = 0.1  # Gravity in all rests nearer than this to one line tells no turn about it [1].


@dataclass(frozen=True)
class Tie:
    """How an instrument b lies in the axes of another one, a: ``x_a = C_ab x_b``."""

    C_ab: FloatArray  # (3, 3) [1]
    cov: FloatArray  # (3, 3) of the rotation vector, about the axes of a [rad^2]
    rests: int  # both were at rest in so many [1]

    @property
    def rotation(self) -> FloatArray:
        """The rotation vector of C_ab, shape (3,), about the axes of a [rad]."""
        return rotation_vector(self.C_ab)

    @property
    def sd(self) -> FloatArray:
        """Its standard deviations, shape (3,) [rad]."""
        return np.sqrt(np.diag(self.cov))


def tie(a: Result, log_a: Log, b: Result, log_b: Log) -> Tie | None:
    """Tell how two instruments lie to each other; None where no common rests tell it.

    `a`, `b`: their calibrations; `log_a`, `log_b`: what they were calibrated from, times of one
    clock [SI].
    """
    if log_a.accel is None or log_b.accel is None or a.temperature or b.temperature:
        return None
    means = _common(log_a, log_b)
    if len(means[0][0]) < FEWEST:
        return None
    f_a, f_b = (_forces(r.coefficients, *m) for r, m in zip((a, b), means, strict=True))
    U, size, Vt = np.linalg.svd(f_a.T @ f_b)
    if size[1] < ALONG * size[0]:
        return None
    C_ab = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    cross = cross_matrix(f_a)
    N = np.einsum("nji,njk->ik", cross, cross)
    to_r = np.linalg.solve(N, np.concatenate(cross.transpose(0, 2, 1), axis=1))
    left = (f_b @ C_ab.T - f_a).ravel()
    cov = left @ left / (left.size - 3) * np.linalg.inv(N)
    for result, mean, C, f in ((a, means[0], np.eye(3), f_a), (b, means[1], C_ab, f_b)):
        moved = to_r @ _slopes(result.coefficients, mean, C, f)
        P = result.coefficients.cov
        cov = cov if P is None else cov + moved @ np.nan_to_num(P) @ moved.T
    return Tie(C_ab, cov, len(f_a))


def _common(log_a: Log, log_b: Log) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return means of accelerometers and gyros (n, 3) of both while both were at rest [SI]."""
    spans = [
        [(log.time[i], log.time[j - 1]) for i, j in find_rests(log).spans] for log in (log_a, log_b)
    ]
    both = [
        (max(s, t), min(e, u)) for s, e in spans[0] for t, u in spans[1] if min(e, u) > max(s, t)
    ]
    out: list[tuple[FloatArray, FloatArray]] = []
    for log in (log_a, log_b):
        assert log.accel is not None
        ends = np.searchsorted(log.time, np.reshape(both, (-1, 2)))
        rows = [slice(i, max(j, i + 1)) for i, j in ends.tolist()]
        gyro = np.zeros_like(log.accel) if log.gyro is None else log.gyro
        accel, rate = (
            np.array([x[r].mean(axis=0) for r in rows]).reshape(-1, 3) for x in (log.accel, gyro)
        )
        out.append((accel, rate))
    return tuple(out)


def _forces(vector: CoefficientVector, accel: FloatArray, gyro: FloatArray) -> FloatArray:
    """Return specific forces (n, 3) of means [m/s^2]."""
    model = ImuModel.from_coefficients(of_one_sample(of_sensors(vector)))
    f_b, _ = model.compensate(accel, gyro)
    assert f_b is not None
    return f_b


def _slopes(
    vector: CoefficientVector, means: tuple[FloatArray, FloatArray], C: FloatArray, f: FloatArray
) -> FloatArray:
    """Return how forces turned by C (3, 3) change with the coefficients, shape (3 n, m) [SI]."""
    steps = np.nan_to_num(vector.sd)
    out = np.zeros((f.size, len(vector)))
    for k in np.flatnonzero(steps):
        values = vector.values.copy()
        values[k] += steps[k]
        moved = _forces(CoefficientVector(vector.layout, values), *means)
        out[:, k] = ((moved - f) @ C.T).ravel() / steps[k]
    return out
