"""What the instrument errs by while it is aligned: white noise, and biases taken as constant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.session_noise import SessionNoise, window_covariance

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SensorErrors:
    """Noise and biases of an instrument during one alignment.

    Attributes
    ----------
    gyro_psd, accel_psd : ndarray, shape (3,)
        White noise [rad^2/s], [m^2/s^3].
    gyro_bias_sd, accel_bias_sd : float
        Standard deviation of the bias of each sensor [rad/s], [m/s^2].
    """

    gyro_psd: FloatArray = field(default_factory=lambda: np.zeros(3))
    accel_psd: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_bias_sd: float = 0.0
    accel_bias_sd: float = 0.0

    @classmethod
    def declared(
        cls,
        noise: ImuNoise,
        interval: float,
        length: float,
        gyro_bias_sd: float = 0.0,
        accel_bias_sd: float = 0.0,
    ) -> SensorErrors:
        """Take noise as declared; what changes slowly is a bias for as long as an alignment lasts.

        Parameters
        ----------
        noise : ImuNoise
            Declared noise [SI].
        interval : float, shape ()
            Sample interval [s].
        length : float, shape ()
            Length of the alignment [s].
        gyro_bias_sd, accel_bias_sd : float, shape ()
            Standard deviation of the bias of each sensor [rad/s], [m/s^2].
        """
        white = SessionNoise.declared(noise, interval)
        return cls(
            white.gyro_psd,
            white.accel_psd,
            _slow(noise.gyro, length, gyro_bias_sd),
            _slow(noise.accel, length, accel_bias_sd),
        )

    def mean_cov(self, length: float) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of a mean specific force and a mean rate, each shape (3, 3) [SI].

        Parameters
        ----------
        length : float, shape ()
            Length of the mean [s].
        """
        return (
            np.diag(self.accel_psd / length + self.accel_bias_sd**2),
            np.diag(self.gyro_psd / length + self.gyro_bias_sd**2),
        )


def _slow(noise: TriadNoise, length: float, bias_sd: float) -> float:
    wander = window_covariance(np.zeros(1), np.array([length]), noise)[0, 0]
    return float(np.sqrt(bias_sd**2 + wander))
