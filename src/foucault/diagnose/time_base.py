"""What the clock of a log adds to a result: the one seam through which every procedure passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.models.layouts import is_cluster
from foucault.models.references import clock_slope
from foucault.result import Result, TimeBase
from foucault.tables import Clock, Log

WORDS = {
    "sensor": "the sensor's own oscillator",
    "host": "the crystal of a host or logger",
    "disciplined": "a clock that is steered",
}
"""Whose clock it is -> the same in a sentence."""


def times_the_table(log: Log) -> bool:
    """Tell whether the rate of a table is its logged angle over the time of `log`."""
    table = log.table
    return (
        log.averaged is None and table is not None and bool(np.isfinite(table.angles[:, 0]).any())
    )


def with_clock(result: Result, clock: Clock, *, turned: bool, summed: bool) -> Result:
    """Put what the clock of the log makes of the coefficients beside them, and say it.

    Parameters
    ----------
    result : Result
        Its covariance is that in the log's own time [SI].
    clock : Clock
        What counted the time of the log.
    turned : bool
        Whether the reference of the gyros is an angle over the time of the log.
    summed : bool
        Whether the readings are increments.
    """
    vector = result.coefficients
    slope = np.where(vector.free, clock_slope(vector, turned=turned, summed=summed), 0.0)
    finite = np.isfinite(slope) & (slope != 0.0)
    error = {
        name: float(v * clock.sd)
        for name, v, some in zip(vector.names, slope, finite, strict=True)
        if some
    }
    base = TimeBase(clock.source, clock.sd, clock.declared, error)
    unseen = [_words(base, cluster=is_cluster(vector)), *(result.diagnostics.get("unseen") or ())]
    return replace(result, clock=base, diagnostics=result.diagnostics | {"unseen": unseen})


def in_words(result: Result) -> str:
    """Say what stands in a table of coefficients, and what the clock adds in seconds."""
    base = result.clock
    if base is None or not base.error:
        return ""
    sizes = [abs(v) for n, v in base.error.items() if n.split(".")[1].endswith("scale")]
    size = f"{max(sizes, default=base.sd) * 1e6:.3g} ppm"
    triads = " and ".join(dict.fromkeys(n.partition(".")[0] for n in base.error))
    return (
        f"sd in the log's own time; in seconds {WORDS[base.source]} adds {size} to the scale "
        f"factors of {triads}."
    )


def _words(base: TimeBase, *, cluster: bool) -> str:
    if not base.error:
        return (
            "A wrong time base: no reference of this session is counted by the clock of the log, "
            "so that it changes no coefficient."
        )
    what = [
        what
        for what, start in (
            ("torquer scale factors", "gyro.torquer_scale."),
            ("gyro scale factors", "gyro.scale."),
            ("accelerometer scale factors", "accel.scale."),
            ("drift rates" if cluster else "gyro biases", "gyro.drift." if cluster else "gyro.b"),
        )
        if any(name.startswith(start) for name in base.error)
    ]
    known = "declared" if base.declared else "taken for it; declare clock or clock_sd in [log]"
    return (
        f"A wrong time base: a clock that is 1 ppm fast is 1 ppm in all "
        f"{' and '.join(what) or 'coefficients'}. The time is that of {WORDS[base.source]}, "
        f"{base.sd * 1e6:.3g} ppm ({known}): part of every uncertainty in seconds, not of those in "
        "the log's own time."
    )
