"""Draw sensor noise: white, first-order Markov, random walk; quantise."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.models.noise import TriadNoise

FloatArray = npt.NDArray[np.float64]


def draw_noise(noise: TriadNoise, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the noise of one triad at evenly spaced times, quantisation left out.

    Parameters
    ----------
    noise : TriadNoise
        Its standard deviations [SI].
    time : ndarray, shape (n,)
        Times of the samples [s].
    rng : Generator
        Source of random numbers.

    Returns
    -------
    ndarray, shape (n, 3)
        Noise [unit of the triad].
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


def quantise(x: FloatArray, step: float) -> FloatArray:
    """Round readings to multiples of `step` (0: leave them).

    Parameters
    ----------
    x : ndarray, shape (n, 3)
        Readings [any unit].
    step : float
        Step of the output [unit of x].
    """
    return np.round(x / step) * step if step > 0 else x
