"""Quick plots of a log before anything is estimated: readings, rests and how they were found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.inspection import Inspection
from foucault.files import atomic
from foucault.report import ends, figures, render
from foucault.report.ends import Heading
from foucault.report.page import Figure, Section
from foucault.tables import AXES

POINTS = 4000
"""Samples drawn per line; a longer log is shown by the extremes of blocks."""

_COLOURS = (figures.FIRST, figures.SECOND, figures.THIRD)


def write(inspection: Inspection, path: str | Path) -> None:
    """Write one self-contained HTML file."""
    log, rests = inspection.log, inspection.rests
    spans = [(log.time[a], log.time[b - 1]) for a, b in zip(rests.first, rests.last, strict=True)]
    shaded = f"The {len(rests)} rests found are shaded."
    sections = []
    if log.accel is not None:
        figure = _readings(log.time, log.accel, "m/s²")
        sections.append(Section("Specific force", "", [figure]))
    if log.gyro is not None:
        figure = _readings(log.time, np.degrees(log.gyro), "°/s")
        sections.append(Section("Angular rate", "", [figure]))
    means = log.averaged is not None
    keep = _extremes(rests.level)
    level = {"time": log.time[keep]}
    for name in ("accel_level", "gyro_level"):
        column = getattr(rests, name)
        if len(column) == len(log):
            level[name] = column[keep]
    if not means:
        detection = figures.detection(level, rests.threshold, spans)
        sections.append(Section("Rests", shaded, [detection]))
    noticed = ends.findings(inspection.findings)
    sections += [] if noticed is None else [noticed]
    name = str(log.source.get("file", "log"))
    line = [f"{len(log)} samples", f"{log.duration:.0f} s", f"{log.rate:.6g} Hz"]
    still = f"{len(rests) - int(inspection.turning.sum())} rests found"
    if means:
        line, still = [f"{len(log)} means", f"{log.duration:.0f} s"], f"{len(log)} means"
    head = Heading(f"Log {name}", line, "plain", still, [])
    with atomic(path) as temporary:
        temporary.write_text(render(head, sections), encoding="utf-8")


def _readings(time: FloatArray, x: FloatArray, unit: str) -> Figure:
    data = []
    for i, axis in enumerate(AXES):
        if np.isnan(x[:, i]).all():  # not logged
            continue
        keep = _extremes(x[:, i])
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": axis,
                "x": figures.numbers(time[keep]),
                "y": figures.numbers(x[keep, i]),
                "line": {"color": _COLOURS[i], "width": 1.1},
            }
        )
    look = figures.layout(320, xaxis=figures.axis("time [s]"), yaxis=figures.axis(f"[{unit}]"))
    return Figure(data, look)


def _extremes(x: FloatArray) -> npt.NDArray[np.intp]:
    """Return the samples to draw: all of a short log, lowest and highest of blocks of a long."""
    block = -(-2 * len(x) // POINTS)
    if block <= 2:
        return np.arange(len(x))
    starts = range(0, len(x), block)
    filled = np.nan_to_num(x)
    picks = [s + f(filled[s : s + block]) for s in starts for f in (np.argmin, np.argmax)]
    return np.unique(np.array(picks, dtype=np.intp))
