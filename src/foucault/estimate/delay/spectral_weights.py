"""Weights of residuals by their own spectrum, axis by axis.

The spectrum is the sum of two kinds of white noise, of the residual itself and of what it is the
difference of, and of whatever else there is, which is smoothed. The filter that makes such
residuals white looks back only: one that looked ahead as well would do so too, but spread what one
row does over rows far away.

References
----------
.. [1] P. Whittle, "The Analysis of Multiple Stationary Time Series", J. R. Statist. Soc. B 15,
   1953, p. 125-139.
.. [2] A. V. Oppenheim, R. W. Schafer, *Discrete-Time Signal Processing*, 1989, chapter 12
   (minimum phase from the cepstrum).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray

ComplexArray = npt.NDArray[np.complex128]

LEAST = 4
"""A spectrum is smoothed over at least so many values on either side [1]."""

RATIOS = 1.0 - np.geomspace(1.0, 1e-4, 25)
"""Parts of differenced white noise in the residuals that are tried [1]."""


def spectrum_of(residual: FloatArray) -> FloatArray:
    """Return the spectrum of residuals, shape (f, 3) [rad^2].

    White noise of phi and of attitude, ``S = c (1 - r + r (2 sin(w/2))^2)``, are fitted first; what
    is left over is smoothed.

    `residual` (k, 3): residuals [rad].
    """
    k = len(residual)
    power = np.abs(waves(residual)) ** 2
    power = np.maximum(power, 1e-20 * power.max(initial=1e-280))
    rise = 4 * np.sin(np.pi * np.linspace(0.0, 0.5, len(power))) ** 2
    shapes = 1 - RATIOS[:, None] + RATIOS[:, None] * rise
    out = np.empty_like(power)
    for axis, p in enumerate(power.T):
        inner, shape = p[1:], shapes[:, 1:]  # the bias has taken the first
        level = np.log(np.mean(inner / shape, axis=1)) + np.mean(np.log(shape), axis=1)
        best = shapes[np.argmin(level)]
        out[:, axis] = best * _smoothed(inner / best[1:], _most(k))
    return np.asarray(out)


def shared(turned: FloatArray, spectrum: FloatArray) -> FloatArray:
    """Return how much of what the slave turned the master has too, by frequency (f, 3) [1].

    Where the slave bends or is noisy its own rate says too much of what a delay would change.

    `turned` (k, 3): what the slave turned [rad]; `spectrum` (f, 3): spectrum of the residuals
    [rad^2].
    """
    power = np.abs(waves(turned)) ** 2
    smooth = np.stack([_smoothed(p[1:], _most(len(turned))) for p in power.T], axis=1)
    return np.asarray(np.clip(1.0 - spectrum / np.maximum(smooth, 1e-300), 0.0, 1.0))


def filtered(x: FloatArray, gain: FloatArray | ComplexArray) -> FloatArray:
    """Return series through a filter, as long as a Fourier transform likes, not shorter.

    `x` (k, 3) or (k, 3, p): series [any unit]; `gain` (f, 3): gain by frequency and axis [1].
    """
    return _in_time(waves(x) * (gain if x.ndim == 2 else gain[..., None]))


def whitening(spectrum: FloatArray) -> ComplexArray:
    """Return the filter that makes residuals white, looking back only, shape (f, 3); [2].

    `spectrum` (f, 3): their power in each row [rad^2].
    """
    cepstrum = _in_time(np.log(spectrum).astype(complex))
    half = len(spectrum) - 1
    cepstrum[1:half] *= 2.0
    cepstrum[half + 1 :] = 0.0
    return np.asarray(np.exp(-0.5 * waves(cepstrum)))


def waves(x: FloatArray) -> ComplexArray:
    """Return the Fourier transform along the first axis, of a length that it likes, even.

    `x` (k, ...): series, zeros are put behind them [any unit].
    """
    from scipy.fft import next_fast_len, rfft

    return np.asarray(rfft(x, 2 * next_fast_len(-(-len(x) // 2), real=True), axis=0))


def _in_time(bins: ComplexArray) -> FloatArray:
    """Return its inverse."""
    from scipy.fft import irfft

    return np.asarray(irfft(bins, 2 * (len(bins) - 1), axis=0))


def _most(k: int) -> int:
    return max(LEAST, round(0.5 * float(np.sqrt(k))))


def _smoothed(power: FloatArray, most: int) -> FloatArray:
    """Return running means, over fewer values near the start, with one value more in front."""
    n = len(power)
    half = np.clip(np.arange(n) // 2, min(LEAST, n - 1), min(most, n - 1))
    padded = np.pad(power, n - 1, mode="reflect")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    middle = np.arange(n) + n - 1
    smooth = (total[middle + half + 1] - total[middle - half]) / (2 * half + 1)
    return np.concatenate([smooth[:1], smooth])
