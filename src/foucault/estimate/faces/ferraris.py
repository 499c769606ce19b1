"""The published solution of six rests and three turns, and the attitude during a turn.

Biases are half the sum of opposite rests, the accelerometer matrix half their difference over g;
the gyro matrix is the integral of the rate, less bias and g-sensitivity, over the angle. Opposite
rests and turns are taken at their word: no redundancy is used and no Earth rate is known.

References
----------
.. [1] F. Ferraris, U. Grimaldi, M. Parvis, "Procedure for effortless in-field calibration of
   three-axial rate gyro and accelerometers", Sensors and Materials 7(5), 1995, eqs. (9)-(23).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.kernels.rotation import integrate_turns
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.faces import FaceReadings, TurnReadings
from foucault.models.imu import ImuModel
from foucault.tables import Log


def turn_spread(log: Log, turns: TurnReadings, model_k: ImuModel) -> FloatArray:
    """Integrate the attitude over each turn: what a vector fixed in space adds up to.

    `log`: the log [SI]; `turns`: the turns [SI]. Returns (m, 3, 3): ``int C_k(t)k(0) dt``: times
    a vector in case axes at the start, its integral [s].
    """
    assert log.gyro is not None
    out = np.empty((len(turns), 3, 3))
    for j, (a, b) in enumerate(zip(turns.first, turns.last, strict=True)):
        time = log.time[a:b]
        _, rate = model_k.compensate(None if log.accel is None else log.accel[a:b], log.gyro[a:b])
        assert rate is not None
        rate = np.ascontiguousarray(rate)
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

    `rests`: the rests, on six faces, several on one face are averaged by their length [SI];
    `turns`: turns about three axes [SI]; `site`: gravity, with a latitude the vertical part of
    the Earth's rotation is taken off first; `spread` (m, 3, 3) or None: attitude during the
    turns, see `turn_spread`, needed with a latitude [s].
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
