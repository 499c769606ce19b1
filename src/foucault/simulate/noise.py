"""From what is true to what the log says: sampling, sensor noise, rounding.

Noise of means over intervals of any length is drawn as means. A Markov bias and a random walk go on
between the intervals. Over a time t the end of each and its
mean follow from where it began by a joint normal law, so that no samples are needed::

    m(t)  = m0 exp(-t/T) + u          mean = m0 (1 - exp(-t/T)) T/t + v
    r(t)  = r0 + u                    mean = r0 + v

References
----------
.. [1] D. T. Gillespie, "Exact numerical simulation of the Ornstein-Uhlenbeck process and its
   integral", Physical Review E 54(2), 1996.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.imu import ImuModel
from foucault.models.magnetometer import Magnetometer
from foucault.models.noise import ImuNoise, TriadNoise, mean_variance
from foucault.tables import Log


@dataclass(frozen=True)
class Simulated:
    """A simulated session of one instrument."""

    log: Log  # [SI]
    model: ImuModel | Magnetometer  # its errors
    said: dict[str, Any]  # what else is true

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        return self.said


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


def mean_noise(
    noise: TriadNoise,
    start: FloatArray,
    length: FloatArray,
    interval: float,
    columns: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Draw the noise of means, shape (n, columns) [unit of the triad].

    `noise`: its standard deviations [SI], a random walk is zero where the first mean begins;
    `start`, `length` (n,): beginning and length of each mean, in order and without overlap [s];
    `interval`: sample interval behind the means [s]; `columns`: number of sensors [1].
    """
    alone = replace(noise, bias_instability=0.0, random_walk=0.0)
    out = np.zeros((len(start), columns))
    if alone.white > 0 or alone.quantisation > 0:
        sd = np.sqrt(mean_variance(alone, length, interval))
        out += sd[:, None] * rng.standard_normal(out.shape)
    between = np.append(start[1:] - start[:-1] - length[:-1], 0.0)
    steps = np.maximum(np.column_stack([length, between]).ravel(), 0.0)
    for law in (_markov, _walk):
        drawn = law(noise, steps, columns, rng)
        if drawn is not None:
            out += drawn[::2]
    return out


def _markov(
    noise: TriadNoise, steps: FloatArray, columns: int, rng: np.random.Generator
) -> FloatArray | None:
    if noise.bias_instability == 0:
        return None
    T = noise.correlation_time
    x = np.maximum(steps / T, 1e-9)
    keep, fade = np.exp(-x), -np.expm1(-x)
    # Variances of end and integral, and their covariance, of a process with sd 1; series for
    # short steps, where the closed form is a small difference of large terms.
    end = -np.expm1(-2 * x)
    long = 2 * x - 3 + 4 * keep - keep**2
    integral = np.where(x < 1e-2, 2 * x**3 / 3 * (1 - 0.75 * x + 0.35 * x**2), long)
    both = fade**2
    first = noise.bias_instability * rng.standard_normal(columns)
    mean = fade / x
    law = (keep, mean, end, both / x, integral / x**2)
    return _chain(first, law, noise.bias_instability, columns, rng)


def _walk(
    noise: TriadNoise, steps: FloatArray, columns: int, rng: np.random.Generator
) -> FloatArray | None:
    if noise.random_walk == 0:
        return None
    one = np.ones_like(steps)
    law = (one, one, steps, steps / 2, steps / 3)
    return _chain(np.zeros(columns), law, noise.random_walk, columns, rng)


def _chain(
    at: FloatArray,
    law: tuple[FloatArray, ...],
    size: float,
    columns: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the mean over each step, shape (steps, columns), of a process that begins at `at`."""
    keep, share, end, both, mean = law
    normal = rng.standard_normal((len(keep), 2, columns))
    a = np.sqrt(end)
    b = np.where(a > 0, both / np.where(a > 0, a, 1.0), 0.0)
    c = np.sqrt(np.maximum(mean - b**2, 0.0))
    ends = size * a[:, None] * normal[:, 0]
    means: FloatArray = size * (b[:, None] * normal[:, 0] + c[:, None] * normal[:, 1])
    for i in range(len(keep)):
        means[i] += share[i] * at
        at = keep[i] * at + ends[i]
    return means
