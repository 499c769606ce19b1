"""What the instrument errs by while it is aligned: white noise, and biases taken as constant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.session_noise import SessionNoise, window_covariance


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
        """Return the covariance of a mean specific force and a mean rate, each shape (3, 3) [SI].

        `length`: length of the mean [s].
        """
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
