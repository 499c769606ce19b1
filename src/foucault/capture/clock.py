"""A counter of an instrument against the clock of the computer that hears it.

Bytes arrive late, never early: by buffers of the port, by a computer that was busy. The least delay
of each part of a session is therefore nearly the same, and a line through those least delays is the
rate of one clock against the other. How much they scatter about it says how sure that is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from foucault.arrays import FloatArray

PARTS = 24
"""Parts of a session whose least delays are taken [1]."""

UNLIKELY = 0.05
"""No clock is so far off: what was heard was not heard as it was made [1]."""

HOST_SD = 1e-4
"""What is taken for the standard deviation of the rate of a computer's clock [1]."""


class Clocks(NamedTuple):
    """One clock against the other."""

    rate: float  # by how much the instrument's runs faster than the computer's [1]
    rate_sd: float  # of that, from the scatter of the least delays [1]
    jitter: float  # of the arrival, 95 % of delays beyond the least are below that [s]


def compared(host: FloatArray, sensor: FloatArray) -> Clocks | None:
    """Compare two clocks; None where there is too little to compare.

    `host` (n,): when each row was heard [s]; `sensor` (n,): when it was made, by its own clock [s].
    """
    good = np.isfinite(host) & np.isfinite(sensor)
    host, sensor = host[good], sensor[good]
    if len(np.unique(host)) < 2 * PARTS or np.ptp(sensor) <= 0:
        return None
    t = sensor - sensor[0]
    late = (host - host[0]) - t
    parts = np.array_split(np.arange(len(t)), PARTS)
    least = np.array([part[np.argmin(late[part])] for part in parts])
    x, y = t[least], late[least]
    kept = np.ones(len(x), bool)
    for _ in range(5):  # a part in which everything was late says nothing of the line
        slope, base = np.polyfit(x[kept], y[kept], 1)
        off = y - (slope * x + base)
        scale = 1.4826 * float(np.median(np.abs(off[kept]))) + 1e-9
        now = np.abs(off) < 4 * scale
        if now.sum() < 6 or np.array_equal(now, kept):
            break
        kept = now
    scatter = float(np.sqrt(np.sum(off[kept] ** 2) / max(int(kept.sum()) - 2, 1)))
    # Where rows are heard in bursts, the least delay hides how a row lies in its burst.
    steps = np.diff(host)
    scatter = max(scatter, float(np.median(steps[steps > 0])) / np.sqrt(12))
    sd = scatter / float(np.sqrt(np.sum((x[kept] - x[kept].mean()) ** 2)))
    beyond = late - (slope * t + base)
    rate = 1 / (1 + float(slope)) - 1
    if abs(rate) > UNLIKELY:
        return None
    return Clocks(rate, sd, float(np.quantile(beyond - beyond.min(), 0.95)))


STOOD = 1.0
"""One of two clocks that stands for less is not told [s]."""


def on_host(host: FloatArray, sensor: FloatArray) -> FloatArray:
    """Return when each row was made by the computer's clock, shape (n,) [s].

    `host` (n,): when each row was heard [s]; `sensor` (n,): when it was made, by its own clock [s].
    The least delay is taken for none: what every row needs at least nobody here can know. Where
    one of the clocks stood or began anew, the line begins anew.
    """
    found = compared(host, sensor)
    slope = 0.0 if found is None else 1 / (1 + found.rate) - 1
    t = sensor - sensor[0]
    late, out = host - (1 + slope) * t, np.empty(len(t))
    breaks = np.flatnonzero(np.abs(np.diff(late)) > STOOD) + 1
    for part in np.split(np.arange(len(t)), breaks):
        k = part[0]
        out[part] = (1 + slope) * t[part] + np.nanmin(late[part])
        if k and out[k] <= out[k - 1]:  # what was kept somewhere comes at once: no time of day
            out[part] += out[k - 1] - out[k] + max(t[k] - t[k - 1], 0.0)
    return out
