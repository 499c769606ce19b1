"""Alignment in inertial space: withstands sway, people walking about, and slow turns.

The gyros carry b relative to its axes at the start of the window, frame 0, however it sways; the
specific force integrated in that frame is compared with gravity, which turns with the Earth. With
N the local level frame of the start, held in inertial space, and w = w_ie_n::

    v_0(t) = C_0N gamma V(t) + c + r(t),    V(t) = int_0^t Exp(w s) (0, 0, g) ds

c is minus the velocity with which the window began, r the velocity of the disturbance, bounded
where the place is not left; gamma is the gravity seen over that given. Means over short epochs,
equal weights: least squares in C, gamma and c is the Procrustes problem, whose solution is exact
(one singular value decomposition, no start and no iteration). The attitude at the end is
``C_nb = Exp(-w T) C_N0 C_0b(T)``.

An error of the fit is a sum over what made it. With ``C_N0_est = (I - [phi0 x]) C_N0`` and the
Jacobian A_k of epoch k in (phi0, c, gamma), the velocity errors e_k give ``phi0 = sum_k D_k e_k``,
D the first rows of ``(A'A)^-1 A'``; white noise of the gyros in an interval j gives ``e_k = eta_j
x (V_k - V_j)`` for all later k, that of the accelerometers a step, and biases their integrals. The
disturbance counts with its measured standard deviation, and by so many fewer samples as it is
correlated.

References
----------
.. [1] S. Umeyama, "Least-squares estimation of transformation parameters between two point
   patterns", *IEEE Trans. Pattern Analysis and Machine Intelligence* 13 (4), 1991, pp. 376-380.
.. [2] P. M. G. Silson, "Coarse alignment of a ship's strapdown inertial attitude reference system
   using velocity loci", *IEEE Trans. Instrumentation and Measurement* 60 (6), 2011.

What the instrument errs by while it is aligned: white noise, and biases taken as constant.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.earth import SEMI_MAJOR_AXIS, Site, earth_rate_n
from foucault.models.noise import ImuNoise, SessionNoise, TriadNoise, window_covariance
from foucault.models.rotation import cross_matrix, exp

if TYPE_CHECKING:
    from foucault.navigate.increments import Increments


@dataclass(frozen=True)
class SensorErrors:
    """Noise and biases of an instrument during one alignment."""

    # gyro_psd, accel_psd: (3,) white noise [rad^2/s], [m^2/s^3]
    gyro_psd: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_psd: FloatArray = field(default_factory=lambda: np.zeros(3))
    # gyro_bias_sd, accel_bias_sd: standard deviation of the bias of each sensor [rad/s], [m/s^2]
    gyro_bias_sd: float = 0.0
    accel_bias_sd: float = 0.0
    # gyro_carried, accel_carried: (3,) variance of the sum of increments at an instant, by rounding
    # that is carried to the next one [rad^2], [m^2/s^2]
    gyro_carried: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_carried: FloatArray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def declared(
        cls,
        noise: ImuNoise,
        interval: float,
        length: float,
        gyro_bias_sd: float = 0.0,
        accel_bias_sd: float = 0.0,
        counted: bool = False,
    ) -> SensorErrors:
        """Take noise as declared; what changes slowly is a bias for as long as an alignment lasts.

        `noise`: declared noise [SI]; `interval`: sample interval [s]; `length`: length of the
        alignment [s]; `gyro_bias_sd`, `accel_bias_sd`: standard deviation of the bias of each
        sensor [rad/s], [m/s^2]; `counted`: whether the instrument adds up, and carries its
        rounding on.
        """
        white = SessionNoise.declared(noise, interval, counted)
        return cls(
            white.gyro_psd,
            white.accel_psd,
            _slow(noise.gyro, length, gyro_bias_sd),
            _slow(noise.accel, length, accel_bias_sd),
            white.gyro_carried,
            white.accel_carried,
        )

    def mean_cov(self, length: float) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of a mean force and rate over `length` [s], (3, 3) [SI]."""
        return (
            np.diag(
                self.accel_psd / length + 2 * self.accel_carried / length**2 + self.accel_bias_sd**2
            ),
            np.diag(
                self.gyro_psd / length + 2 * self.gyro_carried / length**2 + self.gyro_bias_sd**2
            ),
        )


def _slow(noise: TriadNoise, length: float, bias_sd: float) -> float:
    wander = window_covariance(np.zeros(1), np.array([length]), noise)[0, 0]
    return float(np.sqrt(bias_sd**2 + wander))


EPOCH = 1.0
"""Length of one epoch: longer than most vibration of a standing vehicle [s]."""

FEWEST = 20
"""Fewest epochs of a window: 7 unknowns and the correlation of the rest [1]."""


@dataclass(frozen=True)
class InertialFit:
    """What an alignment in inertial space found."""

    C_nb: FloatArray  # (3, 3) attitude at the end of the window [1]
    history: FloatArray  # (m, 3, 3) C_nb at the end of each epoch, the last the same [1]
    cov: FloatArray  # (3, 3) covariance of phi (E, N, U) [rad^2]
    # (3, 3) what each source adds to it: disturbance, gyro noise, accelerometer noise, gyro bias,
    # accelerometer bias [rad^2]
    parts: dict[str, FloatArray]
    epochs: FloatArray  # (m,) end of each epoch, counted from the start of the window [s]
    # (m, 3) velocity of the disturbance, E, N, U, less what constant biases explain [m/s]
    disturbance_n: FloatArray
    disturbance_sd: FloatArray  # (3,) its standard deviation, as a mean over an epoch [m/s]
    # (3,) the same of the velocity at one instant, vibration and rounding included [m/s]
    instant_sd: FloatArray
    gravity_seen: float  # size of gravity as the accelerometers say [m/s^2]
    # (3, 6) error phi of the attitude at the end of the first epoch per bias of gyros [s] and
    # accelerometers [rad/(m/s^2)]
    first_by_bias: FloatArray


def gravity_velocity(time: FloatArray, latitude: float, gravity: float) -> FloatArray:
    """Return the integral of gravity's reaction in the level frame of time 0, shape (n, 3) [m/s].

    ``V = g (sin(W t)/W u + (1 - cos(W t))/W k x u + (t - sin(W t)/W) (k . u) k)``, with the Earth's
    axis k, its rate W and up u.

    `time` (n,): time since that frame was level [s]; `latitude`: geodetic latitude, positive
    north [rad]; `gravity`: local gravity [m/s^2].
    """
    w = earth_rate_n(latitude)
    W = float(np.linalg.norm(w))
    k, up = w / W, np.array([0.0, 0.0, 1.0])
    angle = (W * time)[:, None]
    turned = np.sin(angle) * up + 2 * np.sin(angle / 2) ** 2 * np.cross(k, up)
    return np.asarray(gravity / W * (turned + (angle - np.sin(angle)) * k[2] * k))


@dataclass(frozen=True)
class _Epochs:
    """Means over epochs, m of them; frame 0 is b at the start."""

    ends: FloatArray  # (m,) since the start
    velocity: FloatArray  # (m, 3) integral of the specific force in frame 0
    V: FloatArray  # (m, 3) integral of gravity in N
    at_ends: tuple[FloatArray, FloatArray]  # both at the end of each epoch
    C_0b: FloatArray  # (m, 3, 3) at the end of each epoch
    C_nN: FloatArray  # (m, 3, 3) the same
    by_gyro: FloatArray  # (m, 3, 3) velocity error in 0 per constant gyro bias
    by_accel: FloatArray  # (m, 3, 3) and per constant accelerometer bias
    turned: FloatArray  # (m, 3, 3) attitude error in 0 at the end of each epoch per gyro bias


def moving_velocity(
    dt: FloatArray, velocity_n: FloatArray, latitude: float, gravity: float
) -> tuple[FloatArray, FloatArray]:
    """Return the integral of the specific force of a moving vehicle in the level frame of time 0.

    ``int C_Nn f_n dt = C_Nn v - v(0) + int C_Nn (g u + w_ie x v) dt``, C_Nn turned by the Earth and
    by the curved way, the latitude taken as constant.

    `dt` (n,): lengths of the intervals [s]; `velocity_n` (n, 3): velocity at their ends, E N U
    [m/s]; `latitude`: geodetic latitude, positive north [rad]; `gravity`: local gravity [m/s^2].
    Returns `V` (n, 3): the integral at the ends, but for the constant v(0) [m/s]; `C_Nn` (n, 3,
    3): the level frame at the ends against that of time 0 [1].
    """
    w_ie, step = earth_rate_n(latitude), dt[:, None]
    vE, vN, _ = velocity_n.T
    w_en = np.stack([-vN, vE, vE * np.tan(latitude)], axis=1) / SEMI_MAJOR_AXIS
    C_Nn = exp(np.cumsum(step, axis=0) * w_ie) @ exp(np.cumsum(w_en * step, axis=0))
    force = np.cross(w_ie, velocity_n) + np.array([0.0, 0.0, gravity])
    force = np.einsum("kij,kj->ki", C_Nn, force)
    force[1:] = 0.5 * (force[1:] + force[:-1])
    return np.einsum("kij,kj->ki", C_Nn, velocity_n) + np.cumsum(force * step, axis=0), C_Nn


def _epochs(
    increments: Increments, site: Site, latitude: float, velocity_n: FloatArray | None = None
) -> _Epochs:
    from foucault.kernels.inertial import from_start

    dt = increments.dt
    per = max(1, round(EPOCH / float(np.median(dt))))
    m = len(dt) // per
    if m < FEWEST:
        raise error("alignment.too_short", given=f"{dt.sum():.4g}", least=f"{FEWEST * EPOCH:g}")
    rows = slice(len(dt) - m * per, len(dt))  # the window ends where it was asked to
    part, dt = increments[rows], dt[rows]
    C, v = from_start(part.dtheta_b, part.dvel_b, *part.bends)
    end = np.cumsum(dt)
    if velocity_n is None:
        V = gravity_velocity(end, latitude, site.gravity)
        C_Nn = exp(np.outer(end[per - 1 :: per], earth_rate_n(latitude)))
    else:
        V, C_Nn = moving_velocity(dt, velocity_n[rows], latitude, site.gravity)
        C_Nn = C_Nn[per - 1 :: per]
    # Of biases, integrated over the samples: P = int C_0b dt, and v x P' is -int [f x] P dt.
    P = np.cumsum(C * dt[:, None, None], axis=0)
    df = np.diff(v, axis=0, prepend=0.0)
    by_gyro = -np.cumsum(cross_matrix(df) @ P, axis=0)

    def mean(x: FloatArray) -> FloatArray:
        return np.asarray(x.reshape(m, per, *x.shape[1:]).mean(axis=1))

    last = slice(per - 1, None, per)
    ends = v[last], V[last]
    C_nN = np.swapaxes(C_Nn, 1, 2)
    return _Epochs(
        end[last], mean(v), mean(V), ends, C[last], C_nN, mean(by_gyro), mean(P), P[last]
    )


def inertial_frame(
    increments: Increments,
    site: Site,
    sensors: SensorErrors | None = None,
    velocity_n: FloatArray | None = None,
) -> InertialFit:
    """Align in inertial space.

    `increments`: the window [rad], [m/s]; `site`: where it stands, the latitude must be known;
    `sensors`: what the instrument errs by, for the covariance, None for nothing but the
    disturbance; `velocity_n` (n, 3): velocity of the vehicle at the end of each interval, E N U,
    None at rest [m/s].
    """
    sensors = SensorErrors() if sensors is None else sensors
    latitude = known_latitude(site)
    at = _epochs(increments, site, latitude, velocity_n)
    C_N0, gamma = _procrustes(at)
    A = _jacobian(at.V, gamma)
    to_bias = np.concatenate([C_N0 @ at.by_gyro, C_N0 @ at.by_accel], axis=2)
    r, dof = _disturbance(at, C_N0, gamma, A, to_bias)
    sd = np.sqrt(np.sum(r**2, axis=0) / dof)
    lost = len(r) - dof
    inflation = np.array([correlation_time(r[:, k], lost) for k in range(3)])
    v, V = at.at_ends
    jitter = (v - at.velocity) @ C_N0.T - gamma * (V - at.V)
    D = _first_rows(A)
    history, to_n = at.C_nN @ C_N0 @ at.C_0b, at.C_nN[-1]
    white = _white(at, gamma, D, C_N0)
    by_bias = np.tile(np.einsum("kij,kjl->il", D, to_bias), (2, 1, 1))  # at first, at last
    by_bias[:, :, :3] -= C_N0 @ at.turned[[0, -1]]
    bias = by_bias[1]
    dt = at.ends[-1] / len(at.ends)
    sources = {
        "disturbance": np.einsum("kij,j,klj->il", D, inflation * sd**2, D),
        "gyro noise": _spread(white[0], sensors.gyro_psd * dt),
        "accelerometer noise": _spread(white[1], sensors.accel_psd * dt),
        "gyro bias": sensors.gyro_bias_sd**2 * bias[:, :3] @ bias[:, :3].T,
        "accelerometer bias": sensors.accel_bias_sd**2 * bias[:, 3:] @ bias[:, 3:].T,
    }
    parts = {name: to_n @ cov @ to_n.T for name, cov in sources.items()}
    return InertialFit(
        history[-1],
        history,
        np.sum(list(parts.values()), axis=0),
        parts,
        at.ends,
        r,
        sd,
        np.hypot(sd, jitter.std(axis=0)),
        gamma * site.gravity,
        at.C_nN[0] @ by_bias[0],
    )


def known_latitude(site: Site) -> float:
    """Return the latitude of a `site` [rad], or say that alignment needs it."""
    if site.latitude is None:
        raise error("alignment.no_latitude")
    return site.latitude


def _procrustes(at: _Epochs) -> tuple[FloatArray, float]:
    """Return C_N0 and gamma of the least squares fit, ref. [1] eqs. (40)-(42)."""
    v, V = (x - x.mean(axis=0) for x in (at.velocity, at.V))
    U, s, Wt = np.linalg.svd(V.T @ v)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Wt))])
    return (U * sign) @ Wt, float(np.sum(s * sign) / np.sum(V**2))


def _jacobian(V: FloatArray, gamma: float) -> FloatArray:
    """Return d(C_N0 v) / d(phi0, c, gamma) of each epoch, shape (m, 3, 7)."""
    ones = np.broadcast_to(np.eye(3), (len(V), 3, 3))
    return np.concatenate([-gamma * cross_matrix(V), ones, V[:, :, None]], axis=2)


def _first_rows(A: FloatArray) -> FloatArray:
    """Return D (m, 3, 3): phi0 is the sum of D_k e_k."""
    Q, R = np.linalg.qr(A.reshape(-1, 7))
    rows = np.linalg.solve(R, Q.T)[:3]
    return np.asarray(np.moveaxis(rows.reshape(3, len(A), 3), 1, 0))


def _disturbance(
    at: _Epochs, C_N0: FloatArray, gamma: float, A: FloatArray, to_bias: FloatArray
) -> tuple[FloatArray, float]:
    """Return the residuals less what the fit and constant biases explain, and their dof per axis.

    A bias is counted on its own; left in, it would pass for a disturbance.
    """
    v, V = (x - x.mean(axis=0) for x in (at.velocity, at.V))
    r = v @ C_N0.T - gamma * V
    columns = np.concatenate([A, to_bias], axis=2).reshape(r.size, -1)
    U, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    U = U[:, s > 1e-9 * s[0]]
    left = r.ravel() - U @ (U.T @ r.ravel())
    return left.reshape(r.shape), (r.size - U.shape[1]) / 3


def correlation_time(x: FloatArray, lost: float = 1.0) -> float:
    """Return how many samples are worth one that is independent, at least 1 [1].

    The larger of two estimates: ``1 + 2 sum_l rho_l``, the sum ended where two neighbours together
    are no longer positive, which sees long tails; and ``(1 + r) / (1 - r)`` with the correlation r
    of neighbours, corrected for what a mean and a fit take out of slow changes.

    `x` (m,): residuals of mean zero, evenly spaced [any unit]; `lost`: degrees of freedom that
    the fit took out of x [1].

    References
    ----------
    .. [1] C. J. Geyer, "Practical Markov chain Monte Carlo", *Statistical Science* 7 (4), 1992,
       pp. 473-483 (initial positive sequence).
    .. [2] F. H. C. Marriott, J. A. Pope, "Bias in the estimation of autocorrelations",
       *Biometrika* 41, 1954, pp. 390-402: -(1 + 4 r)/m of x less its mean; every other column of
       the fit that changes slowly takes about (1 + r)/m more.
    """
    m = len(x)
    spectrum = np.fft.rfft(x, 2 * m)
    rho = np.fft.irfft(np.abs(spectrum) ** 2)[:m]
    if rho[0] <= 0:
        return 1.0
    rho /= rho[0]
    pairs = rho[: m // 2 * 2].reshape(-1, 2).sum(axis=1)
    stop = np.flatnonzero(pairs <= 0)
    tail = float(2 * pairs[: stop[0] if len(stop) else None].sum() - 1)
    r = min(rho[1] + (1 + 4 * rho[1] + (lost - 1) * (1 + rho[1])) / m, 1 - 1 / m)
    return max(1.0, tail, float((1 + r) / (1 - r)))


def _white(
    at: _Epochs, gamma: float, D: FloatArray, C_N0: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return phi at the end, in N, per turn and per velocity step of each epoch, (m, 3, 3) in b."""
    later = np.flip(np.cumsum(np.flip(D, 0), axis=0), 0)
    moment = D @ cross_matrix(gamma * at.V)
    later_moment = np.flip(np.cumsum(np.flip(moment, 0), axis=0), 0)
    # eta x (V_k - V_j) = -[V_k - V_j x] eta
    turn = -(later_moment - later @ cross_matrix(gamma * at.V)) - np.eye(3)
    C_Nb = C_N0 @ at.C_0b
    return turn @ C_Nb, later @ C_Nb


def _spread(response: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("kij,j,klj->il", response, variance, response))
