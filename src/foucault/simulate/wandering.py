"""Noise of means over intervals of any length, drawn as means.

A Markov bias and a random walk go on between the intervals. Over a time t the end of each and its
mean follow from where it began by a joint normal law, so that no samples are needed::

    m(t)  = m0 exp(-t/T) + u          mean = m0 (1 - exp(-t/T)) T/t + v
    r(t)  = r0 + u                    mean = r0 + v

References
----------
.. [1] D. T. Gillespie, "Exact numerical simulation of the Ornstein-Uhlenbeck process and its
   integral", Physical Review E 54(2), 1996.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.noise import TriadNoise
from foucault.models.readings import mean_variance


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
