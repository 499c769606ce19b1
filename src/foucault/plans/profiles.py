"""Smooth changes in time from one value to another, as vehicles and tables make them.

All is built from the 9th-order step S from 0 to 1, which has four continuous derivatives::

    S(x) = x^5 (126 - 420 x + 540 x^2 - 315 x^3 + 70 x^4)       S'(x) = 630 x^4 (1 - x)^4
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray

Three = tuple[FloatArray, FloatArray, FloatArray]


def step(x: FloatArray) -> Three:
    """Return S, S' and S'' at x, shape (n,) each [1].

    `x` (n,): from 0 to 1 [1].
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
    """

    total: float = 0.0  # value at the end [any unit]
    time: float = 1.0  # how long it takes [s]
    ramp: float = 0.5  # growth of the rate, and its fading, at most half of the time [s]

    @property
    def peak(self) -> float:
        """Largest rate [unit/s]."""
        return self.total / (self.time - self.ramp)

    def at(self, t: FloatArray) -> Three:
        """Return value, rate and acceleration, shape (n,) each [unit, s].

        `t` (n,): time since it began [s].
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
