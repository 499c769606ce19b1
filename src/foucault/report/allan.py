"""The page of an Allan variance: the noises seen, the curves, and the noise block to copy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from foucault import __version__
from foucault.diagnose.allan.deviation import NOISES, WORDS, Channel, Noise
from foucault.diagnose.allan.log import LogAllan, described
from foucault.files import atomic
from foucault.report import ends, figures, render
from foucault.report.ends import Heading
from foucault.report.page import Block, Code, Column, Figure, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.units import display_unit, factor

_COLOURS = (figures.FIRST, figures.SECOND, figures.THIRD)
_TRIADS = {"gyro": "Gyros", "accel": "Accelerometers"}
_PLOT_KINDS = {"gyro": "angular rate", "accel": "specific force"}
_KIND_WORDS = {
    "overlapping": "Allan deviation (overlapping)",
    "modified": "modified Allan deviation",
    "hadamard": "Hadamard deviation (overlapping)",
}


def write(measured: LogAllan, name: str, block: str, path: str | Path) -> None:
    """Write one self-contained HTML file."""
    first = next(iter(measured.channels.values()))
    seen = [(w, noise) for w, noise, _ in _each(measured) if noise.seen]
    names = list(dict.fromkeys(w for w, _ in seen))
    word = f"{len(names)} kinds of noise seen" if len(names) != 1 else "1 kind of noise seen"
    head = Heading(
        title=f"Noise of {name}",
        line=[
            f"{first.samples} samples",
            f"{measured.start:.6g} s to {measured.end:.6g} s",
            f"{1 / first.interval:.6g} Hz",
        ],
        state="plain",
        word=word,
        reasons=[", ".join(names).capitalize() + "."] if names else [],
    )
    sections = [_noise_section(measured), *_plots(measured)]
    noticed = ends.findings(measured.findings)
    sections += [] if noticed is None else [noticed]
    use = "Copy into the campaign file of this instrument."
    sections += [Section("Noise block", use, [Code(block)]), _method()]
    used = f"{measured.start:.6g} s to {measured.end:.6g} s, {first.samples} samples"
    made = [("log", name), ("part used", used), ("versions", f"foucault {__version__}")]
    sections.append(ends.provenance(made))
    with atomic(path) as temporary:
        temporary.write_text(render(head, sections), encoding="utf-8")


def _each(measured: LogAllan) -> Iterator[tuple[str, Noise, str]]:
    for name, channel in measured.channels.items():
        for i, noise in enumerate(channel.noises):
            yield WORDS[name.split(".")[0]][i], noise, name


def _noise_section(measured: LogAllan) -> Section:
    columns = [
        Column("", "state"),
        Column("noise"),
        Column("value", "number"),
        Column("± sd", "number", aside=True),
        Column("95 % interval"),
    ]
    rows: list[list[str]] = []
    for name, channel in measured.channels.items():
        triad = name.split(".")[0]
        rows.append([name])
        for i, noise in enumerate(channel.noises):
            state = "good" if noise.seen else "plain"
            rows.append([state, WORDS[triad][i], *described(noise, triad, channel.longest)])
    lead = (
        "Seen: three standard deviations above zero. Of what is not seen, the limit that holds "
        "with a probability of 95 %."
    )
    return Section("Noise", lead, [Table(columns, rows)])


def _plots(measured: LogAllan) -> Iterator[Section]:
    for triad, title in _TRIADS.items():
        channels = {n: c for n, c in measured.channels.items() if n.startswith(triad)}
        if channels:
            kind = _KIND_WORDS[next(iter(channels.values())).kind]
            lead = f"{kind.capitalize()} with its 95 % interval; lines: the noises fitted."
            blocks: list[Block] = [_figure(channels, triad)]
            yield Section(title, lead, blocks)


def _figure(channels: dict[str, Channel], triad: str) -> Figure:
    kind = _PLOT_KINDS[triad]
    middle = float(np.median([np.median(c.deviation) for c in channels.values()]))
    unit = display_unit(kind, middle)
    one = factor(unit, kind)
    data: list[figures.Trace] = []
    for (name, c), colour in zip(channels.items(), _COLOURS, strict=False):
        data += _traces(name, c, one, unit, colour)
    if len(channels) == 1:  # with more the lines would hide one another
        data += _single_noises(next(iter(channels.values())), triad, one)
    lowest = min(float(c.low.min()) for c in channels.values()) / one
    highest = max(float(c.high[c.dof > 1].max()) for c in channels.values()) / one
    look = figures.layout(
        460,
        xaxis=figures.axis("averaging time [s]", type="log", dtick=1),
        yaxis=figures.axis(
            f"deviation [{shown(unit)}]",
            type="log",
            dtick=1,
            range=[math.log10(lowest) - 0.1, math.log10(highest) + 0.1],
        ),
    )
    return Figure(data, look)


def _traces(name: str, c: Channel, one: float, unit: str, colour: str) -> list[figures.Trace]:
    """Draw one axis: its band, its deviations and the curve fitted."""
    tau = figures.numbers(c.tau)
    edge = figures.numbers(np.concatenate([c.high, c.low[::-1]]) / one)
    group = {"type": "scatter", "legendgroup": name}
    return [
        group
        | {
            "mode": "lines",
            "x": tau + tau[::-1],
            "y": edge,
            "fill": "toself",
            "fillcolor": colour,
            "opacity": 0.16,
            "line": {"width": 0},
            "hoverinfo": "skip",
            "showlegend": False,
        },
        group
        | {
            "mode": "lines",
            "x": tau,
            "y": figures.numbers(c.curve / one),
            "line": {"color": colour, "width": 1.2},
            "hoverinfo": "skip",
            "showlegend": False,
        },
        group
        | {
            "mode": "markers",
            "name": name,
            "x": tau,
            "y": figures.numbers(c.deviation / one),
            "marker": {"color": colour, "size": 7},
            "hovertemplate": f"%{{x:.4g}} s: %{{y:.4g}} {shown(unit)}<extra>{name}</extra>",
        },
    ]


def _single_noises(c: Channel, triad: str, one: float) -> list[figures.Trace]:
    dashes = dict(zip(NOISES, ("dot", "dash", "dashdot", "longdash", "longdashdot"), strict=True))
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "name": word,
            "x": figures.numbers(c.tau),
            "y": figures.numbers(part / one),
            "line": {"color": figures.SOFT, "width": 1.1, "dash": dashes[noise.name]},
            "hoverinfo": "skip",
        }
        for word, noise, part in zip(WORDS[triad], c.noises, c.parts, strict=True)
        if noise.seen and part.min() > 0
    ]


def _method() -> Section:
    text = (
        "The noises are fitted to the overlapping Allan variance, 3Q²/τ² + N²/τ + (2 ln 2/π)B² + "
        "K²τ/3 + R²τ²/2 (IEEE Std 952, annex C), by least squares with the covariance that the "
        "fitted noises give the variances at all τ. Intervals of the deviations are chi-square "
        "with the degrees of freedom that follow from the same covariance."
    )
    return Section("Method", "", [Text(text)])
