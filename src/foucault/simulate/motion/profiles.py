"""Oscillations that come and go smoothly; for changes that stay see `plans.profiles`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.plans.manoeuvres import Sway
from foucault.plans.profiles import Three, step


@dataclass(frozen=True)
class Oscillation:
    """Sums of sinusoids that grow and die down: ``S(t / fade) sum_k a sin(w_k t + phase_k)``."""

    amplitude: FloatArray  # (c,) of the tones of each quantity [any unit]
    frequency: FloatArray  # (c, k) angular frequencies of the tones [rad/s]
    phase: FloatArray  # (c, k) phases of the tones [rad]
    # time, fade: how long it lasts, and how long growing and dying down take [s]
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

        `t` (n,): time since it began [s].
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
