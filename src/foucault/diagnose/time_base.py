"""What the clock of a log adds to a result: the one seam through which every procedure passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, finding
from foucault.models.layouts import is_cluster
from foucault.models.references import clock_slope
from foucault.result import Result, TimeBase
from foucault.tables import AXES, Clock, Log

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


def stretched(log: Log, share: float) -> Log:
    """Return the log as a clock that is fast by `share`, shape () [1], would have stamped it."""
    start, fast = float(log.time[0]), 1.0 + share
    slower = fast if log.sampled == "increment" else 1.0
    return replace(
        log,
        time=start + (log.time - start) * fast,
        gyro=None if log.gyro is None else log.gyro / slower,
        accel=None if log.accel is None else log.accel / slower,
    )


def with_clock(
    result: Result, clock: Clock, *, turned: bool, summed: bool, slope: FloatArray | None = None
) -> Result:
    """Put what the clock of the log makes of the coefficients beside them, and say it.

    `result`: its covariance is that in the log's own time [SI]; `turned`: whether the reference
    of the gyros is an angle over the time of the log; `slope` (n,) or None: derivative of the
    coefficients with respect to the logarithm of the clock's rate, where it does not follow from
    the two [SI].
    """
    vector, plain = result.coefficients, slope is None
    if slope is None:
        slope = clock_slope(vector, turned=turned, summed=summed)
    slope = np.where(vector.free, slope, 0.0)
    finite = np.isfinite(slope) & (slope != 0.0)
    error = {
        name: float(v * clock.sd)
        for name, v, some in zip(vector.names, slope, finite, strict=True)
        if some
    }
    base = TimeBase(clock.source, clock.sd, clock.declared, error)
    sentence = _words(base, _what(base, vector) if plain else _most(base, vector))
    unseen = [*(result.diagnostics.get("unseen") or ()), sentence]
    told = _alike(vector) if summed else ()
    return replace(
        result, clock=base, diagnostics=result.diagnostics | {"unseen": unseen},
        findings=(*result.findings, *told),
    )  # fmt: skip


ALIKE = 0.1
"""Three scale factors within so much of their mean are off by one cause [1]."""

FAR = 2e-3
"""Gravity is not so far off anywhere, and few accelerometers are by chance all alike [1]."""


def _alike(vector: CoefficientVector) -> tuple[Finding, ...]:
    """Tell increments whose accelerometer scale factors are off alike: their interval is wrong."""
    names = [f"accel.scale.{axis}" for axis in AXES]
    if not all(name in vector.layout for name in names):
        return ()
    scales = np.array([vector.value(name) for name in names])
    mean = float(scales.mean())
    if not abs(mean) > FAR or not np.abs(scales - mean).max() < ALIKE * abs(mean):
        return ()
    return (finding("log.alike", percent=f"{100 * mean:+.3g}", clock=f"{-100 * mean:+.3g}"),)


def in_words(result: Result) -> str:
    """Say what stands in a table of coefficients, and what the clock adds in seconds."""
    base = result.clock
    if base is None or not base.error:
        return ""
    names = {"gyro": "gyros", "accel": "accelerometers"}
    heads = dict.fromkeys(name.partition(".")[0] for name in base.error)
    triads = " and ".join(names[head] for head in heads if head in names)
    return (
        f"sd in the log's own time; in seconds {WORDS[base.source]} adds {base.sd * 1e6:.3g} ppm "
        f"to the {triads}: `sd in seconds` of the report."
    )


def _what(base: TimeBase, vector: CoefficientVector) -> str:
    """Say which coefficients follow the clock, one by one."""
    drift = ("drift rates", "gyro.drift.") if is_cluster(vector) else ("gyro biases", "gyro.bias.")
    groups = (
        ("torquer scale factors", "gyro.torquer_scale."), ("gyro scale factors", "gyro.scale."),
        ("accelerometer scale factors", "accel.scale."), drift,
    )  # fmt: skip
    what = [what for what, start in groups if any(name.startswith(start) for name in base.error)]
    return f"a clock that is 1 ppm fast is 1 ppm in all {' and '.join(what) or 'coefficients'}"


def _most(base: TimeBase, vector: CoefficientVector) -> str:
    """Say which coefficient the clock changes most, against its standard deviation."""
    sd = dict(zip(vector.names, vector.sd.tolist(), strict=True))
    share = {n: abs(e) / sd[n] for n, e in base.error.items() if sd[n] > 0}
    worst = max(share, key=lambda n: share[n], default="")
    return f"a clock of log and messages that is fast changes {worst} most"


def _words(base: TimeBase, what: str) -> str:
    if not base.error:
        return (
            "A wrong time base: no reference of this session is counted by the clock of the log, "
            "so that it changes no coefficient."
        )
    known = "declared" if base.declared else "taken for it; declare clock or clock_sd in [log]"
    return (
        f"A wrong time base: {what}. The time is that of {WORDS[base.source]}, "
        f"{base.sd * 1e6:.3g} ppm ({known}): part of every uncertainty in seconds, not of those in "
        "the log's own time."
    )
