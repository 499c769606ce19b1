"""Smooth changes in time: from one value to another, and oscillations that come and go.

All is built from the 9th-order step S from 0 to 1, which has four continuous derivatives::

    S(x) = x^5 (126 - 420 x + 540 x^2 - 315 x^3 + 70 x^4)       S'(x) = 630 x^4 (1 - x)^4
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.plans.manoeuvres import Sway

FloatArray = npt.NDArray[np.float64]
Three = tuple[FloatArray, FloatArray, FloatArray]


def step(x: FloatArray) -> Three:
    """Return S, S' and S'' at x, shape (n,) each [1].

    Parameters
    ----------
    x : ndarray, shape (n,)
        From 0 to 1 [1].
    """
    rest = x * (1.0 - x)
    third = rest**3
    s = x**5 * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + x * 70.0))))
    return s, 630.0 * third * rest, 2520.0 * third * (1.0 - 2.0 * x)


@dataclass(frozen=True)
class Profile:
    """A change from zero to `total`: the rate grows over `ramp`, is constant, and fades.

    With peak = total / (time - ramp) and x = t / ramp, in the first half of the time::

        rate = peak S(min(x, 1))    value = peak (ramp integral of S + max(t - ramp, 0))

    and the second half is the first one backwards.

    Attributes
    ----------
    total : float
        Value at the end [any unit].
    time : float
        How long it takes [s].
    ramp : float
        Growth of the rate, and its fading, at most half of the time [s].
    """

    total: float = 0.0
    time: float = 1.0
    ramp: float = 0.5

    @property
    def peak(self) -> float:
        """Largest rate [unit/s]."""
        return self.total / (self.time - self.ramp)

    def at(self, t: FloatArray) -> Three:
        """Return value, rate and acceleration, shape (n,) each [unit, s].

        Parameters
        ----------
        t : ndarray, shape (n,)
            Time since it began [s].
        """
        if self.total == 0.0:
            zero = np.zeros_like(t)
            return zero, zero, zero
        late = t > self.time / 2
        since = np.where(late, self.time - t, t)
        x = np.minimum(since / self.ramp, 1.0)
        s, slope, _ = step(x)
        integral = x**6 * (21.0 + x * (-60.0 + x * (67.5 + x * (-35.0 + x * 7.0))))
        value = self.peak * (self.ramp * integral + np.maximum(since - self.ramp, 0.0))
        curve = self.peak / self.ramp * slope
        return (
            np.where(late, self.total - value, value),
            self.peak * s,
            np.where(late, -curve, curve),
        )


@dataclass(frozen=True)
class Oscillation:
    """Sums of sinusoids that grow and die down: ``S(t / fade) sum_k a sin(w_k t + phase_k)``.

    Attributes
    ----------
    amplitude : ndarray, shape (c,)
        Of the tones of each quantity [any unit].
    frequency : ndarray, shape (c, k)
        Angular frequencies of the tones [rad/s].
    phase : ndarray, shape (c, k)
        Phases of the tones [rad].
    time, fade : float
        How long it lasts, and how long growing and dying down take [s].
    """

    amplitude: FloatArray
    frequency: FloatArray
    phase: FloatArray
    time: float
    fade: float

    @classmethod
    def of(cls, sway: Sway) -> Oscillation:
        """Draw the tones of heading, pitch, roll, and of the shift right, forward and up."""
        rng = np.random.default_rng(sway.seed)
        shape = (6, sway.tones)
        spread = rng.uniform(-1.0, 1.0, shape) if sway.tones > 1 else np.zeros(shape)
        frequency = 2 * np.pi / sway.period * 2.0**spread
        amplitude = np.array([*sway.angles, *sway.shift]) / np.sqrt(sway.tones)
        phase = rng.uniform(0.0, 2 * np.pi, shape)
        fade = sway.time / 4 if sway.fade is None else sway.fade
        return cls(amplitude, frequency, phase, sway.time, fade)

    @property
    def shortest(self) -> float:
        """Shortest period [s]."""
        return float(2 * np.pi / self.frequency.max())

    def at(self, t: FloatArray) -> Three:
        """Return values, rates and accelerations, shape (c, n) each [unit, s].

        Parameters
        ----------
        t : ndarray, shape (n,)
            Time since it began [s].
        """
        late = t > self.time / 2
        x = np.clip(np.where(late, self.time - t, t) / self.fade, 0.0, 1.0)
        e, e1, e2 = step(x)
        e1, e2 = np.where(late, -e1, e1) / self.fade, e2 / self.fade**2
        s, s1, s2 = np.zeros((3, len(self.amplitude), len(t)))
        for c in np.flatnonzero(self.amplitude):
            for w, phase in zip(self.frequency[c], self.phase[c], strict=True):
                sine, cosine = np.sin(w * t + phase), np.cos(w * t + phase)
                s[c] += sine
                s1[c] += w * cosine
                s2[c] -= w * w * sine
        a = self.amplitude[:, None]
        return a * e * s, a * (e1 * s + e * s1), a * (e2 * s + 2 * e1 * s1 + e * s2)
