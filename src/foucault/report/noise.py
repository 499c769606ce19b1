"""Pages of a log alone: quick plots before anything is estimated, and its Allan variance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from foucault import __version__
from foucault.arrays import FloatArray
from foucault.diagnose.allan import NOISES, WORDS, Channel, LogAllan, Noise, described
from foucault.diagnose.live import Inspection
from foucault.report import chart, page
from foucault.report.chart import SERIES, SOFT, Trace, area, dots, draw, line, log_axis, numbers
from foucault.report.page import (
    Code,
    Document,
    Figure,
    Heading,
    Section,
    Table,
    columns,
    section,
    told,
    unit_of,
)
from foucault.tables import AXES

POINTS = 4000
"""Samples drawn per line; a longer log is shown by the extremes of blocks."""

TRIADS = {
    "accel": ("Accelerometers", "Specific force", "specific force", "m/s²"),
    "gyro": ("Gyros", "Angular rate", "angular rate", "°/s"),
}
"""What each is called, what it reads, the kind of that, and the unit it is drawn in."""

KINDS = {
    "overlapping": "Allan deviation (overlapping)",
    "modified": "Modified Allan deviation",
    "hadamard": "Hadamard deviation (overlapping)",
}


def inspected(inspection: Inspection) -> Document:
    """Return readings, rests and how they were found."""
    log, rests = inspection.log, inspection.rests
    made = [
        Section(TRIADS[triad][1], "", [_readings(log.time, x, TRIADS[triad][3])])
        for triad, x in (
            ("accel", log.accel),
            ("gyro", None if log.gyro is None else np.degrees(log.gyro)),
        )
        if x is not None
    ]
    line_ = [f"{len(log)} samples", f"{log.duration:.0f} s", f"{log.rate:.6g} Hz"]
    found = f"{len(rests) - int(inspection.turning.sum())} rests found"
    if log.averaged is not None:
        line_, found = [f"{len(log)} means", f"{log.duration:.0f} s"], f"{len(log)} means"
    else:
        keep = _extremes(rests.level)
        level = {"time": log.time[keep]}
        for name in ("accel_level", "gyro_level"):
            column = getattr(rests, name)
            if len(column) == len(log):
                level[name] = column[keep]
        ends = zip(rests.first, rests.last, strict=True)
        spans = [(log.time[a], log.time[b - 1]) for a, b in ends]
        drawn = chart.detection(level, rests.threshold, spans)
        made.append(Section("Rests", f"The {len(rests)} rests found are shaded.", [drawn]))
    head = Heading(f"Log {log.source.get('file', 'log')}", line_, "plain", found, [])
    return Document.of(head, made, page.findings(inspection.findings))


def _readings(time: FloatArray, x: FloatArray, unit: str) -> Figure:
    data = []
    for i, axis in enumerate(AXES):
        if not np.isnan(x[:, i]).all():  # logged
            keep = _extremes(x[:, i])
            data.append(
                line(axis, time[keep], x[keep, i], SERIES[i], "(%{x}, %{y})|" + axis, width=1.1)
            )
    return draw("noise.readings", data, y=f"[{unit}]")


def _extremes(x: FloatArray) -> npt.NDArray[np.intp]:
    """Return the samples to draw: all of a short log, lowest and highest of blocks of a long."""
    block = -(-2 * len(x) // POINTS)
    if block <= 2:
        return np.arange(len(x))
    starts = range(0, len(x), block)
    filled = np.nan_to_num(x)
    picks = [s + f(filled[s : s + block]) for s in starts for f in (np.argmin, np.argmax)]
    return np.unique(np.array(picks, dtype=np.intp))


# -- Allan variance --------------------------------------------------------------------------


def document(measured: LogAllan, name: str, block: str) -> Document:
    """Return the noises seen, the curves, and the noise block to copy."""
    first = next(iter(measured.channels.values()))
    names = list(dict.fromkeys(word for word, noise, _ in _each(measured) if noise.seen))
    count = f"{len(names)} kinds" if len(names) != 1 else "1 kind"
    span = f"{measured.start:.6g} s to {measured.end:.6g} s"
    head = Heading(
        f"Noise of {name}",
        [f"{first.samples} samples", span, f"{1 / first.interval:.6g} Hz"],
        "plain",
        f"{count} of noise seen",
        [", ".join(names).capitalize() + "."] if names else [],
    )
    used = f"{span}, {first.samples} samples"
    made = [("log", name), ("part used", used), ("versions", f"foucault {__version__}")]
    return Document.of(
        head,
        _noises(measured),
        [_plot(measured, triad) for triad in ("gyro", "accel")],
        page.findings(measured.findings),
        section("noise.block", Code(block)),
        section("noise.method", told("noise.method.text")),
        page.provenance(made),
    )


def _each(measured: LogAllan) -> Iterator[tuple[str, Noise, str]]:
    for name, channel in measured.channels.items():
        for word, noise in zip(WORDS[name.split(".")[0]], channel.noises, strict=False):
            yield word, noise, name


def _noises(measured: LogAllan) -> Section | None:
    rows: list[list[str]] = []
    for word, noise, name in _each(measured):
        if [name] not in rows:
            rows.append([name])
        told_ = described(noise, name.split(".")[0], measured.channels[name].longest)
        rows.append(["good" if noise.seen else "plain", word, *told_])
    heads = columns(": state | noise | value: number | ± sd: number aside | 95 % interval")
    return section("noise.noises", Table(heads, rows))


def _plot(measured: LogAllan, triad: str) -> Section | None:
    channels = {n: c for n, c in measured.channels.items() if n.startswith(triad)}
    if not channels:
        return None
    kind = KINDS[next(iter(channels.values())).kind]
    return section("noise.plots", _figure(channels, triad), title=TRIADS[triad][0], kind=kind)


def _figure(channels: Mapping[str, Channel], triad: str) -> Figure:
    middle = float(np.median([np.median(c.deviation) for c in channels.values()]))
    unit, one = unit_of(TRIADS[triad][2], middle)
    data: list[Trace] = []
    for (name, c), colour in zip(channels.items(), SERIES, strict=False):
        tau = numbers(c.tau)
        edge = np.concatenate([c.high, c.low[::-1]]) / one
        of_axis: Trace = {"legendgroup": name}
        data += [
            area("", tau + tau[::-1], edge, opacity=0.16, **of_axis | {"fillcolor": colour}),
            line("", tau, c.curve / one, colour, width=1.2, **of_axis),
            dots(
                name,
                tau,
                c.deviation / one,
                colour,
                f"%{{x:.4g}} s: %{{y:.4g}} {unit}|{name}",
                size=7,
                **of_axis,
            ),
        ]
    if len(channels) == 1:  # with more the lines would hide one another
        data += _single_noises(next(iter(channels.values())), triad, one)
    low = min(float(c.low.min()) for c in channels.values()) / one
    high = max(float(c.high[c.dof > 1].max()) for c in channels.values()) / one
    span = [math.log10(low) - 0.1, math.log10(high) + 0.1]
    look = log_axis(f"deviation [{unit}]", range=span)
    return draw("noise.figure", data, y=look)


def _single_noises(c: Channel, triad: str, one: float) -> list[Trace]:
    dashes = dict(zip(NOISES, ("dot", "dash", "dashdot", "longdash", "longdashdot"), strict=True))
    return [
        line(word, c.tau, part / one, SOFT, width=1.1, dash=dashes[noise.name])
        for word, noise, part in zip(WORDS[triad], c.noises, c.parts, strict=True)
        if noise.seen and part.min() > 0
    ]
