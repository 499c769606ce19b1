"""From what is true to what the log says: sampling, sensor noise, rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.tables import Log

Truth = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

# Gauss-Legendre nodes and weights on [-1, 0], for the mean over the interval before a sample.
_NODES = (np.array([-1.0, 0.0, 1.0]) * np.sqrt(0.6) - 1.0) / 2.0
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0


def sampled_log(
    truth: Truth,
    *,
    samples: int,
    rate: float,
    sampled: Literal["rate", "increment"],
    model: ImuModel,
    noise: ImuNoise,
    rng: np.random.Generator,
) -> Log:
    """Sample a motion as an instrument with errors and noise does.

    `truth`: times, shape (n,) [s] -> true specific force and rate, frame b, shape (n, 3) each
    [SI]; `samples`: number of samples, from time zero [1]; `rate`: sample rate [Hz]; `sampled`:
    instantaneous rates, or means over the interval before each sample; `noise`: its noise [SI].
    """
    time = np.arange(samples) / rate
    if sampled == "rate":
        f_b, w_b = truth(time)
    else:
        parts = [truth(time + node / rate) for node in _NODES]
        f_b = sum(w * part[0] for w, part in zip(_WEIGHTS, parts, strict=True))
        w_b = sum(w * part[1] for w, part in zip(_WEIGHTS, parts, strict=True))
    accel, gyro = model.measure(f_b, w_b)
    return noisy_log(time, accel, gyro, sampled=sampled, noise=noise, rng=rng)


def noisy_log(
    time: FloatArray,
    accel: FloatArray,
    gyro: FloatArray,
    *,
    sampled: Literal["rate", "increment"],
    noise: ImuNoise,
    rng: np.random.Generator,
) -> Log:
    """Add noise to readings and round them.

    `time` (n,): times of the samples, evenly spaced [s]; `accel`, `gyro` (n, 3): readings without
    noise [SI]; `sampled`: instantaneous rates, or means over the interval before each sample;
    `noise`: their noise [SI].
    """
    carried = sampled == "increment"
    accel, gyro = (
        quantise(x + draw_noise(triad, time, rng), triad.quantisation, carried=carried)
        for x, triad in ((accel, noise.accel), (gyro, noise.gyro))
    )
    return Log(time, gyro, accel, sampled)


def draw_noise(noise: TriadNoise, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the noise of one triad at evenly spaced times, quantisation left out.

    `noise`: its standard deviations [SI]; `time` (n,): times of the samples [s]. Returns (n, 3):
    noise [unit of the triad].
    """
    n = len(time)
    dt = float(time[-1] - time[0]) / (n - 1)
    out = noise.white / np.sqrt(dt) * rng.standard_normal((n, 3))
    if noise.bias_instability > 0:
        from scipy.signal import lfilter

        keep = np.exp(-dt / noise.correlation_time)
        drive = noise.bias_instability * np.sqrt(1 - keep**2) * rng.standard_normal((n, 3))
        drive[0] = noise.bias_instability * rng.standard_normal(3)
        out += lfilter([1.0], [1.0, -keep], drive, axis=0)
    if noise.random_walk > 0:
        out += np.cumsum(noise.random_walk * np.sqrt(dt) * rng.standard_normal((n, 3)), axis=0)
    return np.asarray(out)


def quantise(x: FloatArray, step: float, *, carried: bool = False) -> FloatArray:
    """Round readings to multiples of `step` (0: leave them).

    `x` (n, 3): readings [any unit]; `step`: step of the output [unit of x]; `carried`: whether
    what a reading leaves out goes on to the next one, as where pulses are counted.
    """
    if step <= 0:
        return x
    if carried:
        return np.asarray(
            np.diff(np.round(np.cumsum(x / step, axis=0)), axis=0, prepend=0.0) * step
        )
    return np.asarray(np.round(x / step) * step)
