"""Covariance of what a session of rests and turns observes.

White noise makes the observations independent, one 3 x 3 block each. Bias instability and
random walk tie them together: the bias averaged over one rest or turn is correlated with the
bias over every other, and their covariance matrix is added exactly. Where the latitude is
unknown, the Earth's rotation is an unknown of known size.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise, carried_rounding, rounding_bias
from foucault.models.rests_and_turns import Prediction, Session

QUIET_ENDS = 0.6
"""About how long a turn between two detected rests is still quiet, both ends together [s]."""

QUIETEST = 1e-9
"""Least white noise, [m/s^2/sqrt(Hz)] and [rad/s/sqrt(Hz)]: below what any instrument has, and far
enough above rounding that the estimation of a noise-free log settles."""


@dataclass(frozen=True)
class SessionNoise:
    """Everything that makes an observation differ from the model."""

    # accel_psd, gyro_psd: (3,) white noise power that acts on the mean of a rest [unit^2 s]
    accel_psd: FloatArray
    gyro_psd: FloatArray
    # (3,) white noise power that the integration over a turn adds up [rad^2/s]
    turn_psd: FloatArray
    slow: ImuNoise  # bias instability and random walk; its white part is not used here
    # accel_repeatability, gyro_repeatability, turn_repeatability: standard deviation, per axis, of
    # what the noise does not explain in a rest's specific force [m/s^2], a rest's rate [rad/s] and
    # the rotation of a turn [rad]
    accel_repeatability: float = 0.0
    gyro_repeatability: float = 0.0
    turn_repeatability: float = 0.0
    # accel_rounding, gyro_rounding: (3,) constant error of rounding in the mean of a rest [unit]:
    # another one in every rest for the accelerometers, the same in all rests for the gyros, which
    # always read their bias
    accel_rounding: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_rounding: FloatArray = field(default_factory=lambda: np.zeros(3))
    # accel_carried, gyro_carried: (3,) variance of the sum of increments at an instant, whose
    # rounding goes on to the next reading: it counts at both ends of a rest or turn [unit^2 s^2]
    accel_carried: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_carried: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("accel_psd", "gyro_psd", "turn_psd"):
            object.__setattr__(self, name, np.maximum(getattr(self, name), QUIETEST**2))

    @classmethod
    def declared(cls, noise: ImuNoise, interval: float, increments: bool = False) -> SessionNoise:
        """Take the noise as declared; rounding to steps acts as white noise, but of increments.

        `noise`: declared noise [SI]; `interval`: sample interval [s]; `increments`: whether the
        samples are means over their intervals, which carry rounding on.
        """

        def carried(triad: TriadNoise) -> FloatArray:
            return np.full(3, carried_rounding(triad.quantisation, interval))

        if increments:
            white = [np.full(3, triad.white**2) for triad in (noise.accel, noise.gyro)]
            return cls(
                white[0], white[1], white[1], noise,
                accel_carried=carried(noise.accel), gyro_carried=carried(noise.gyro),
            )  # fmt: skip

        def psd(triad: TriadNoise) -> FloatArray:
            return np.full(3, triad.white**2 + triad.quantisation**2 / 12 * interval)

        def rounding(triad: TriadNoise) -> FloatArray:
            sd = triad.white / np.sqrt(interval)
            return np.full(3, rounding_bias(triad.quantisation, sd))

        return cls(
            psd(noise.accel), psd(noise.gyro), psd(noise.gyro), noise,
            accel_rounding=rounding(noise.accel), gyro_rounding=rounding(noise.gyro),
        )  # fmt: skip


def blocks(session: Session, noise: SessionNoise, at: Prediction) -> FloatArray:
    """Return the independent part of the covariance, one block per observation.

    `noise`: its noise [SI]; `at`: the linearised model, for the noise of the turns. Returns (k,
    3, 3): covariance blocks in the order of `Prediction.residuals` [SI].
    """
    rest_time = session.rest_time[:, None, None]
    floor = np.diag(noise.accel_rounding**2) + noise.accel_repeatability**2 * np.eye(3)
    out = [np.diag(noise.accel_psd) / rest_time + floor]
    out[0] += 2 * np.diag(noise.accel_carried) / rest_time**2
    if session.gyro_mean is not None:
        # An unknown Earth rate has its full size over all directions: a third per axis.
        unknown = EARTH_RATE**2 / 3 if session.site.latitude is None else 0.0
        rest_floor = noise.gyro_repeatability**2 + unknown
        turn_floor = noise.turn_repeatability**2 + unknown * session.turn_time**2
        ends = 2 * np.diag(noise.gyro_carried)
        out.append(np.diag(noise.gyro_psd) / rest_time + rest_floor * np.eye(3))
        out[-1] += ends / rest_time**2
        out.append(at.turn_noise + ends + turn_floor[:, None, None] * np.eye(3))
    return np.concatenate(out)


def window_covariance(start: FloatArray, end: FloatArray, noise: TriadNoise) -> FloatArray:
    """Return the covariance of the slow bias averaged over windows that do not overlap.

    Markov part, with tau the correlation time and T the lengths: ``s^2 2 tau/T (1 - tau/T
    (1 - exp(-T/tau)))`` on the diagonal, and off it ``s^2`` times the product of the averages
    of the two exponentials. Random walk: ``q^2 (t + T/3)`` on the diagonal, ``q^2`` times the
    middle of the earlier window off it (the bias of the model is the value at time zero).

    `start`, `end` (m,): ends of the windows, counted from the start of the log [s]; `noise`: bias
    instability, correlation time and random walk [SI]. Returns (m, m): covariance [unit^2].
    """
    T = np.maximum(end - start, 1e-9)
    mid = (start + end) / 2
    tau = noise.correlation_time
    x = T / tau
    gap = np.abs(mid[:, None] - mid[None, :]) / tau
    # exp(-gap) sinh(x/2)/(x/2) for each window, kept from overflowing at long windows.
    shape = -np.expm1(-x) / x
    between = np.maximum(gap - (x[:, None] + x[None, :]) / 2, 0.0)
    markov = np.exp(-between) * np.outer(shape, shape)
    small = x < 1e-4
    own = 2 / x * (1 - shape)
    np.fill_diagonal(markov, np.where(small, 1 - x / 3, own))
    walk = np.minimum(mid[:, None], mid[None, :])
    np.fill_diagonal(walk, start + T / 3)
    return np.asarray(noise.bias_instability**2 * markov + noise.random_walk**2 * walk)


def correlated(session: Session, noise: SessionNoise, at: Prediction) -> FloatArray | None:
    """Return the part of the covariance that ties observations together, or None.

    `noise`: its noise [SI]; `at`: the linearised model, for the effect of a bias on a turn.
    Returns (3 k, 3 k): covariance of all residuals [SI]; None where there is no slow noise.
    """
    slow = any(t.bias_instability or t.random_walk for t in (noise.slow.accel, noise.slow.gyro))
    coarse = session.gyro_mean is not None and noise.gyro_rounding.any()
    if not (slow or coarse):
        return None
    time = session.log.time - session.log.time[0]
    rest_start, rest_end = time[session.first], time[session.last - 1]
    n, total = len(rest_start), 3 * len(at.residuals)
    out = np.zeros((total, total))
    accel = window_covariance(rest_start, rest_end, noise.slow.accel)
    out[: 3 * n, : 3 * n] = np.kron(accel, np.eye(3))
    if session.gyro_mean is not None:
        start = np.concatenate([rest_start, rest_end[:-1]])
        end = np.concatenate([rest_end, rest_start[1:]])
        gyro = window_covariance(start, end, noise.slow.gyro)
        effect = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), at.turn_bias])
        part = np.einsum("iab,ij,jcb->iajc", effect, gyro, effect)
        out[3 * n :, 3 * n :] = part.reshape(total - 3 * n, total - 3 * n)
        if coarse:
            # The same in all rests. A turn is rounded alike too, but only where it is still
            # quiet, near its ends, and how long that is is not known well enough to subtract
            # the one from the other: they count as two errors.
            share = np.minimum(1.0, QUIET_ENDS / session.turn_time)[:, None, None]
            effect = effect * noise.gyro_rounding
            rests = effect[:n].reshape(-1, 3)
            turns = (effect[n:] * share).reshape(-1, 3)
            out[3 * n : 6 * n, 3 * n : 6 * n] += rests @ rests.T
            out[6 * n :, 6 * n :] += turns @ turns.T
    return out


def joined(independent: FloatArray, tied: FloatArray) -> FloatArray:
    """Return the whole covariance: blocks on the diagonal plus what ties them together.

    `independent` (k, 3, 3): covariance blocks [SI]; `tied` (3 k, 3 k): covariance between
    observations [SI].
    """
    full = tied.copy()
    at = 3 * np.arange(len(independent))[:, None, None] + np.arange(3)[:, None]
    full[at, np.swapaxes(at, 1, 2)] += independent
    return full


def whiten(
    residuals: FloatArray,
    jacobian: FloatArray,
    independent: FloatArray,
    tied: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Make residuals white with unit variance: multiply by the inverse Cholesky factor.

    `residuals` (k, 3): residuals [SI]; `jacobian` (k, 3, m): their Jacobian [SI]; `independent`
    (k, 3, 3): covariance blocks [SI]; `tied` (3 k, 3 k) or None: covariance between observations,
    added to the blocks [SI]. Returns `residuals` (3 k,): white residuals [1]; `jacobian` (3 k,
    m): their Jacobian [1 per unit of the state].
    """
    k, _, m = jacobian.shape
    both = np.concatenate([jacobian, residuals[:, :, None]], axis=2)
    if tied is None:
        white = np.linalg.solve(np.linalg.cholesky(independent), both).reshape(3 * k, m + 1)
    else:
        from scipy.linalg import solve_triangular

        root = np.linalg.cholesky(joined(independent, tied))
        white = solve_triangular(root, both.reshape(3 * k, m + 1), lower=True, check_finite=False)
    return white[:, -1], white[:, :-1]
