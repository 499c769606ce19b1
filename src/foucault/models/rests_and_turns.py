"""Observation model of a session of rests and turns: what the means and the turns should be.

At rest j the body has the attitude ``C_nb[j]`` in the local frame. Three things are observed::

    accelerometer mean   a_j = accel model of  f_j = C_nb[j]' (0, 0, g)
    gyro mean            w_j = gyro model of   C_nb[j]' w_ie_n   and f_j
    turn to rest j + 1   C_se(gyro model) = C_nb[j]' Exp(w_ie_n T_j) C_nb[j + 1]

where C_se integrates the compensated rate over the turn (s: body axes at its start, e: at its
end). The Earth term is the rotation of the local frame while the turn lasts. Unknown are the
coefficients of the model and one attitude per rest; heading is a nuisance that only the Earth's
rotation ties to north.

The turn residual is the rotation vector from modelled to measured, in s:
``rho = Log(C_se (C_nb[j]' Exp(w_ie_n T_j) C_nb[j+1])')``. With an error d_eps of the integrated
rotation in s, and body-side perturbations ``C_nb Exp(phi)``::

    d_rho = Jl^-1 d_eps + Jr^-1 phi_j - Jr^-1 (C_nb[j]' E C_nb[j+1]) phi_{j+1}
    d_eps = - int C_sb inv(L_g) (d_b + dL_g w + dG f) dt

An error of the accelerometers reaches the turns only through G, which makes it second order: the
Jacobian leaves it out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.kernels.rotation import integrate_turns
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel, coefficient_slot
from foucault.models.rotation import cross_matrix, exp, log, right_jacobian_inverse
from foucault.tables import Log


@dataclass(frozen=True)
class Session:
    """The data of a session, reduced to what the model needs."""

    log: Log  # the readings [SI]
    # first, last: (n,) first sample of each rest and the sample after its last
    first: IntArray
    last: IntArray
    site: Site  # gravity and, where known, latitude
    accel_mean: FloatArray  # (n, 3) mean specific force of each rest [m/s^2]
    gyro_mean: FloatArray | None  # (n, 3) mean rate of each rest [rad/s]

    @classmethod
    def reduce(cls, log: Log, first: IntArray, last: IntArray, site: Site) -> Session:
        """Average the rests of a log.

        `log`: the readings [SI], accelerometers must be present; `first`, `last` (n,): first
        sample of each rest and the sample after its last.
        """
        assert log.accel is not None

        def means(x: FloatArray) -> FloatArray:
            rows = [x[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)]
            return np.stack(rows)

        gyro = None if log.gyro is None else means(log.gyro)
        return cls(log, first, last, site, means(log.accel), gyro)

    @property
    def rest_time(self) -> FloatArray:
        """Length of each rest, shape (n,) [s]."""
        return np.asarray((self.last - self.first) * self.log.interval)

    @property
    def turn_time(self) -> FloatArray:
        """Length of each turn, from the last sample of a rest to the first of the next [s]."""
        return self.log.time[self.first[1:]] - self.log.time[self.last[:-1] - 1]

    @cached_property
    def turns(self) -> tuple[Log, IntArray, IntArray]:
        """Return the samples of the turns alone, with first and last sample of each turn.

        One more sample on either side is kept, for the rule that integrates rates. Between
        turns the shortened log jumps in time; nothing is integrated there.
        """
        keep = np.zeros(len(self.log), bool)
        for a, b in zip(self.last[:-1] - 1, self.first[1:], strict=True):
            keep[max(a - 1, 0) : b + 2] = True
        place = np.cumsum(keep) - 1
        log_ = replace(
            self.log,
            time=self.log.time[keep],
            gyro=None if self.log.gyro is None else self.log.gyro[keep],
            accel=None if self.log.accel is None else self.log.accel[keep],
            temperature=None,
        )
        return log_, place[self.last[:-1] - 1], place[self.first[1:]]

    @property
    def earth(self) -> FloatArray:
        """w_ie_n, frame n, shape (3,) [rad/s]; zero where the latitude is unknown."""
        return np.zeros(3) if self.site.latitude is None else earth_rate_n(self.site.latitude)


@dataclass(frozen=True)
class Attitudes:
    """Model and attitudes: the state of the estimation."""

    model: ImuModel
    C_nb: FloatArray  # (n, 3, 3) attitude of each rest, body to East-North-Up [1]


@dataclass(frozen=True)
class Prediction:
    """Residuals, observation minus prediction, and the Jacobian of the prediction."""

    # (k, 3) one row per observation: rests (accelerometer), rests (gyro), turns [SI]
    residuals: FloatArray
    # (k, 3, m) columns: the coefficients, then three attitude angles per rest [SI]
    jacobian: FloatArray
    # (n - 1, 3, 3) covariance of each turn from unit white noise of the gyro, times the given psd
    # [rad^2]
    turn_noise: FloatArray
    # (n - 1, 3, 3) rotation error per constant rate error of the gyro output, in s [s]
    turn_bias: FloatArray
    # (2 n - 1, 3, 3) what the Earth's rate, frame n, does to mean rates and turns [SI]
    earth: FloatArray
    turn_path: FloatArray  # (n - 1,) angle travelled [rad]
    C_se: FloatArray  # (n - 1, 3, 3) integrated rotation of each turn [1]


def predict(
    session: Session, names: Sequence[str], state: Attitudes, gyro_psd: FloatArray
) -> Prediction:
    """Compare a session with the model at a state.

    `gyro_psd` (3,): white noise power of the gyro outputs [rad^2/s].
    """
    model, C_nb = state.model, state.C_nb
    n, p = len(C_nb), len(names)
    f = session.site.gravity * C_nb[:, 2, :]  # C_nb' (0, 0, g), one row per rest
    w = np.einsum("nji,j->ni", C_nb, session.earth)
    accel, gyro = model.measure(f, w)
    gyro_rows = 0 if session.gyro_mean is None else n + n - 1
    J = np.zeros((n + gyro_rows, 3, p + 3 * n))
    r = np.empty((n + gyro_rows, 3))
    rest = np.arange(n)
    tilt = p + 3 * rest[:, None] + np.arange(3)  # attitude columns of each rest

    r[:n] = session.accel_mean - accel
    slopes = model.slopes(f, w, names)
    J[:n, :, :p] = slopes.accel
    J[rest[:, None, None], np.arange(3)[:, None], tilt[:, None, :]] = (
        slopes.accel_by_force @ cross_matrix(f)
    )
    if session.gyro_mean is None:
        empty = np.zeros((0, 3, 3))
        return Prediction(r, J, empty, empty, empty, np.zeros(0), empty)

    r[n : 2 * n] = session.gyro_mean - gyro
    J[n : 2 * n, :, :p] = slopes.gyro
    J[n + rest[:, None, None], np.arange(3)[:, None], tilt[:, None, :]] = (
        slopes.gyro_by_rate @ cross_matrix(w) + slopes.gyro_by_force @ cross_matrix(f)
    )
    r[2 * n :], noise, bias, by_rate, path, C_se = _turns(
        session, names, state, gyro_psd, J[2 * n :]
    )
    C_bn = np.swapaxes(C_nb, 1, 2)
    turned = by_rate @ C_bn[:-1] * session.turn_time[:, None, None]
    earth = np.concatenate([slopes.gyro_by_rate @ C_bn, turned])
    return Prediction(r, J, noise, bias, earth, path, C_se)


def _turns(
    session: Session, names: Sequence[str], state: Attitudes, gyro_psd: FloatArray, J: FloatArray
) -> tuple[FloatArray, ...]:
    """Fill the Jacobian of the turns in place; return residuals, noise, slopes, path, C_se."""
    model, C_nb = state.model, state.C_nb
    log_, first, last = session.turns
    n, p = len(C_nb), len(names)
    inverse = np.linalg.inv(model.gyro_matrix)
    f_b, w_b = model.compensate(log_.accel, log_.gyro)
    assert f_b is not None
    assert w_b is not None
    C_se, bias, scale, force, noise, path = integrate_turns(
        log_.time,
        np.ascontiguousarray(w_b),  # one layout, one compilation
        np.ascontiguousarray(f_b),
        inverse @ np.diag(gyro_psd) @ inverse.T,
        first,
        last,
        log_.sampled == "increment",
    )
    modelled = (
        np.swapaxes(C_nb[:-1], 1, 2) @ exp(session.earth * session.turn_time[:, None]) @ C_nb[1:]
    )
    rho = log(C_se @ np.swapaxes(modelled, 1, 2))
    right = right_jacobian_inverse(rho)
    left = np.swapaxes(right, 1, 2)

    # Columns of d_eps, turned into the prediction's sign: minus d_rho.
    bias_s = left @ bias @ inverse
    inputs = {"gyro_matrix": scale, "g_sensitivity": force}
    for column, name in enumerate(names):
        block, where = coefficient_slot(name)
        if block == "gyro_bias":
            J[:, :, column] = bias_s[:, :, where]
        elif block in inputs:
            columns = inputs[block].reshape(-1, 3, 3, 3)[:, :, :, where[1]]
            J[:, :, column] = np.einsum("nab,nbi,i->na", left, columns, inverse[:, where[0]])
    turn = np.arange(n - 1)
    start = p + 3 * turn[:, None] + np.arange(3)
    at = (turn[:, None, None], np.arange(3)[:, None])
    J[(*at, start[:, None, :])] = -right
    J[(*at, start[:, None, :] + 3)] = right @ modelled
    return rho, noise, bias_s, right, path, C_se
