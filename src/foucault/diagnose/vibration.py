"""Vibration in a log that moves, told apart from the noise of the sensor at rest.

An estimator that is tuned on the move takes vibration for noise of the sensor. Both scatter
single readings; the motion itself is slow, and sixth differences of successive readings hardly
see it: of white noise of density N^2 they have the power ``C(12, 6) N^2 / dt``, of a sway of
angular frequency w only ``(2 sin(w dt / 2))^12`` of its size. So each stretch of `WINDOW` has a
density as if all were white noise. In the rest it is the sensor's, with what the place shakes;
what stretches that move have beyond it is vibration, of standard deviation ``sqrt((moving - rest)
/ dt)`` in a reading.

Limits: vibration below an eighth of the rate is hardly seen, above half of it folded down. A sensor
that filters its readings shows less than its density in both, alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from foucault.errors import Finding, finding
from foucault.tables import AXES, Log
from foucault.units import convert, display_unit, plain

ORDER = 6  # Differences of readings that are taken [1].
WINDOW = 0.5  # Length of a stretch [s]; it has `SAMPLES` readings or more.
SAMPLES = 50  # Fewest readings of a stretch [1].

LOUD = 1.5
"""Stretches count as louder where their density is more than this times that of the rest [1]."""


@dataclass(frozen=True)
class Vibration:
    """How much louder the stretches of one axis are that are not in its rest."""

    axis: str
    # rest, moving: density as of white noise in the rest, and the median of the other stretches
    # [unit^2/Hz]
    rest: float
    moving: float
    highest: float  # that of the loudest twentieth of them [unit^2/Hz]
    sd: float  # standard deviation of what is added to a reading, by the median [unit]
    share: float  # of the stretches outside the rest, how many are louder [1]


def vibration(log: Log, start: float, end: float) -> tuple[Vibration, ...]:
    """Return the vibration of each axis outside a rest.

    `log`: readings, also while moving [SI]; `start`, `end`: first and last time of its rest [s].
    """
    size = max(SAMPLES, round(WINDOW / log.interval))
    count = len(log) // size
    first = log.time[: count * size : size]
    last = log.time[size - 1 : count * size : size]
    inside = (first >= start) & (last <= end)
    outside = (last < start) | (first > end)
    whole = last - first < 1.5 * size * log.interval  # no gap within
    if not (inside & whole).any() or not (outside & whole).any():
        return ()
    out = []
    for triad in ("gyro", "accel"):
        for k in log.logged(triad):
            x = getattr(log, triad)[: count * size, k].reshape(count, size)
            power = np.mean(np.diff(x, n=ORDER, axis=1) ** 2, axis=1)
            density = np.asarray(power * log.interval / comb(2 * ORDER, ORDER))
            rest = float(density[inside & whole].mean())
            moving = density[outside & whole]
            middle = float(np.median(moving))
            out.append(Vibration(
                f"{triad}.{AXES[k]}", rest, middle, float(np.quantile(moving, 0.95)),
                float(np.sqrt(max(middle - rest, 0.0) / log.interval)),
                float(np.mean(moving > LOUD * rest)),
            ))  # fmt: skip
    return tuple(out)


def findings(seen: tuple[Vibration, ...]) -> tuple[Finding, ...]:
    """Say what shakes, or that nothing does; alike for a log that is all rest."""
    if not seen:
        return (finding("allan.not_moving"),)
    loud = [v for v in seen if v.moving > LOUD * v.rest]
    if not loud:
        return (finding("allan.calm"),)
    words = []
    for v in loud:
        kind = {"gyro": "angular rate", "accel": "specific force"}[v.axis.partition(".")[0]]
        unit = display_unit(kind, v.sd)
        words.append(f"{v.axis} {plain(convert(v.sd, kind, unit), 3)} {unit} "
                     f"({plain((v.moving / v.rest) ** 0.5, 3)} times as loud)")  # fmt: skip
    return (finding("allan.vibration", axes=", ".join(words)),)
