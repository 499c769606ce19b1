"""Pages of a log alone: quick plots before anything is estimated, and its Allan variance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from foucault import __version__
from foucault.arrays import FloatArray, IndexArray
from foucault.diagnose.allan import (
    NOISES,
    UNIT_KINDS,
    WORDS,
    Channel,
    LogAllan,
    Noise,
    described,
)
from foucault.diagnose.bounding_pair import Pair, pairs
from foucault.diagnose.live import Inspection
from foucault.errors import Finding
from foucault.models.transfer import MasterTable
from foucault.report import chart, page
from foucault.tables import AXES, Log
from foucault.units import convert, display_unit, plain, span

POINTS = 4000  # Samples drawn per line; a longer log is shown by the extremes of blocks.

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


def inspected(inspection: Inspection, start: float = 0.0) -> page.Document:
    """Return readings, rests and how they were found; times count from `start` [s]."""
    log, rests = inspection.log, inspection.rests
    master, moves = _master(log), _moves(log)
    made: list[page.Section | None] = [
        page.Section(TRIADS[triad][1], "", [_readings(log.time, x, TRIADS[triad][3])])
        for triad, x in (
            ("accel", log.accel),
            ("gyro", None if log.gyro is None else np.degrees(log.gyro)),
        )
        if x is not None
    ]
    file = str(log.source.get("file", "log"))
    line_ = [f"{len(log)} samples", f"{log.duration:.0f} s", f"{log.rate:.6g} Hz"]
    found = page.counted(len(rests) - int(inspection.turning.sum()), "rest") + " found"
    if log.averaged is not None:
        line_, found = [f"{len(log)} means", f"{log.duration:.0f} s"], f"{len(log)} means"
        made.append(page.section("log.means", _rests(inspection, "mean")))
    elif master is not None:
        found = f"{len(master.messages.time)} messages of a master"
        made.append(page.section("log.master", _facts("", _messages(master, start))))
    elif moves:
        found = f"{len(log)} samples of what moves"
    else:
        keep = _extremes(rests.level)
        level = {"time": log.time[keep]}
        for name in ("accel_level", "gyro_level"):
            column = getattr(rests, name)
            if len(column) == len(log):
                level[name] = column[keep]
        ends = zip(rests.first, rests.last, strict=True)
        spans = [(log.time[a], log.time[b - 1]) for a, b in ends]
        shaded = page.said("log.rests.shaded", count=len(rests))
        drawn = replace(chart.detection(level, rests.threshold, spans), caption=shaded)
        made.append(page.section("log.rests", drawn, _rests(inspection, "rest")))
    head = page.Heading(f"Log {file}", line_, "plain", found, [])
    about = page.section("log.overview", _facts(file, _overview(inspection, start, moves)))
    # Of what moves, findings about rests say nothing.
    noticed = log.findings if moves else inspection.findings
    readings = page.section("log.readings", _axes(inspection, noise=not moves))
    return page.Document.of(head, about, readings, made, page.findings(noticed))


def glance(inspection: Inspection, start: float = 0.0) -> page.Document:
    """Return what fits on one screen: axes, a bar of the rests, each kind of finding once."""
    whole = inspected(inspection, start)
    log, moves = inspection.log, _moves(inspection.log)
    kept = [one for one in whole.sections if one.key in ("log.readings", "log.master")]
    first = page.said("log.overview.starts", start=plain(start, 13)) if start else ""
    rows = dict(_overview(inspection, start, moves))
    told_ = [f"{rows[k]} {k}" for k in ("interval", "gaps") if k in rows]
    kinds = [rows[k] for k in ("readings", "means") if k in rows]
    seen = [f"{k}: {rows[k]}" for k in ("rests found", "steady turns", "|f| at rest") if k in rows]
    bar = [] if log.averaged is not None or moves else [page.Code(_timeline(inspection))]
    line_ = [*whole.heading.line, *told_, *kinds]
    noticed = log.findings if moves else inspection.findings
    return page.Document.of(
        replace(whole.heading, line=line_),
        kept,
        page.section("log.glance", first, "\n".join(seen), bar),
        page.findings(page.counted_once(noticed)),
    )


BAR = 68  # Letters of the bar that shows when an instrument was at rest [1].


def _timeline(seen: Inspection) -> str:
    """Return the log as a bar: # at rest, = turning steadily, . moving."""
    time, n = seen.log.time, len(seen.log)
    edges = np.linspace(0, n, BAR + 1)
    share = {sign: np.zeros(BAR) for sign in "#="}
    for a, b, turns in zip(seen.rests.first, seen.rests.last, seen.turning, strict=True):
        inside = np.clip(np.minimum(edges[1:], b) - np.maximum(edges[:-1], a), 0.0, None)
        share["=" if turns else "#"] += inside / np.diff(edges)
    some = np.stack([1 - share["#"] - share["="], share["#"], share["="]])
    bar = "".join(np.array(list(".#="))[some.argmax(axis=0)])
    ends = f"{time[0]:.0f} s".ljust(BAR + 2 - len(f"{time[-1]:.0f} s")) + f"{time[-1]:.0f} s"
    return f"[{bar}]\n{ends}\n{page.told('log.glance.signs')}"


def _facts(title: str, pairs: Sequence[tuple[str, str]]) -> page.Table:
    return page.Table([page.Column(""), page.Column(title)], pairs)


def _readings(time: FloatArray, x: FloatArray, unit: str) -> page.Figure:
    data = []
    for i, axis in enumerate(AXES):
        if not np.isnan(x[:, i]).all():  # logged
            keep = _extremes(x[:, i])
            data.append(
                chart.line(
                    axis, time[keep], x[keep, i], chart.SERIES[i], "(%{x}, %{y})|" + axis, width=1.1
                )
            )
    return chart.draw("noise.readings", data, y=f"[{unit}]")


def _extremes(x: FloatArray) -> IndexArray:
    """Return the samples to draw: all of a short log, lowest and highest of blocks of a long."""
    block = -(-2 * len(x) // POINTS)
    if block <= 2:
        return np.arange(len(x))
    starts = np.arange(0, len(x), block)
    filled = np.nan_to_num(x)
    whole = np.append(filled, np.full(len(starts) * block - len(x), filled[-1]))
    each = whole.reshape(-1, block)
    picks = [starts + f(each, axis=1) for f in (np.argmin, np.argmax)]
    return np.unique(np.minimum(picks, len(x) - 1))


# -- what a log holds ------------------------------------------------------------------------


def _overview(seen: Inspection, start: float, moves: bool) -> list[tuple[str, str]]:
    log = seen.log
    if log.averaged is not None:
        took = f"{span(float(log.averaged.min()))} to {span(float(log.averaged.max()))}"
        return [("means", f"{len(log)}, each over {took}")]
    kind = {"rate": "instantaneous", "increment": "means over each interval"}[log.sampled]
    rows = [
        ("samples", f"{len(log)}"),
        ("duration", f"{log.duration:.2f} s"),
        ("rate", f"{plain(log.rate, 6)} Hz"),
        ("interval", f"{span(seen.shortest)} to {span(seen.longest)}"),
        ("gaps", f"{seen.gaps}"),
        ("readings", kind),
    ]
    if start:
        rows.insert(1, ("starts at", f"{plain(start, 13)} s; times below count from there"))
    if moves:
        return rows
    still = int(np.count_nonzero(~seen.turning))
    level = f"{seen.rests.threshold:.3g}"
    rows.append(("rests found", f"{still} (level below {level} x the quiet)"))
    if seen.turning.any():
        rows.append(("steady turns", f"{int(seen.turning.sum())}, listed among the rests"))
    f = _means(seen, "accel")
    if f is not None and len(f) and np.isfinite(f).all():
        size = np.linalg.norm(f if seen.turning.all() else f[~seen.turning], axis=1)
        rows.append(("|f| at rest", f"{size.min():.4f} to {size.max():.4f} m/s^2 (1 g = 9.80665)"))
    return rows


def _master(log: Log) -> MasterTable | None:
    """Return the messages of a master beside the log, where what is beside it is one."""
    beside = getattr(log, "master", None)
    return beside if isinstance(beside, MasterTable) else None


def _moves(log: Log) -> bool:
    """Whether it is calibrated as it moves, against what is beside it: nothing has to rest."""
    return type(log) is not Log


def _messages(master: MasterTable, start: float) -> list[tuple[str, str]]:
    """What there is to see of the messages of a master, by the clock that they are used by."""
    time, speed = master.messages.time - start, np.linalg.norm(master.velocity_n[:, :2], axis=1)
    pitch, roll = np.degrees(master.angles[:, 1:]).T
    place = "said" if master.has_place else "not said: it begins at [site]"
    return [
        ("messages", f"{len(time)}"),
        ("first to last", f"{time[0]:.2f} s to {time[-1]:.2f} s"),
        ("interval", f"{span(float(np.median(np.diff(time))))} as a rule"),
        ("horizontal speed", f"{speed.min():.2f} to {speed.max():.2f} m/s"),
        ("pitch", f"{pitch.min():.1f} to {pitch.max():.1f} deg"),
        ("roll", f"{roll.min():.1f} to {roll.max():.1f} deg"),
        ("position", place),
    ]


def _axes(seen: Inspection, noise: bool) -> page.Table:
    rows = []
    noise = noise and seen.log.averaged is None
    for name, axes, kind, unit, noise_kind, noise_unit in (
        ("accel", seen.accel, "gravity", "m/s^2", "velocity random walk", "ug/sqrt(Hz)"),
        ("gyro", seen.gyro, "angular rate", "deg/s", "angle random walk", "deg/sqrt(h)"),
    ):
        if axes is None:
            continue
        for i in seen.log.logged(name):
            numbers_ = (axes.mean, axes.sd, axes.lowest, axes.highest)
            cells = [f"{convert(float(c[i]), kind, unit):.4g}" for c in numbers_]
            n = convert(float(axes.noise[i]), noise_kind, noise_unit)
            white = f"{n:.3g} {noise_unit}" if np.isfinite(n) else "-"
            rows.append([f"{name} {AXES[i]} ({unit})", *cells, *[white] * noise])
    return page.Table(
        _columns("axis", "mean", "sd", "min", "max", *["noise at rest"] * noise), rows
    )


def _rests(seen: Inspection, kind: str) -> page.Table:
    f, w = _means(seen, "accel"), _means(seen, "gyro")
    turned = _table_columns(seen)
    rows: list[list[str]] = []
    for k in range(len(seen.rests)):
        up = size = turning = ""
        if f is not None and np.isfinite(f[k]).all():
            largest = int(np.argmax(np.abs(f[k])))
            tilt = np.degrees(np.arccos(abs(f[k, largest]) / np.linalg.norm(f[k])))
            up = f"{'+' if f[k, largest] > 0 else '-'}{AXES[largest]} ({tilt:.0f} deg off)"
            size = f"{np.linalg.norm(f[k]):.4f}"
        if w is not None:
            turning = f"{np.degrees(np.linalg.norm(w[k][list(seen.log.logged('gyro'))])):.3f}"
        start, end = (f"{seen.rest_rows[c][k]:.2f} s" for c in ("start", "end"))
        if seen.log.averaged is not None:
            end = f"{seen.rest_rows['start'][k] + seen.log.averaged[k]:.2f} s"
        state = "turning" if seen.turning[k] else "rest"
        more = (f"{x[k]:.3f}" for x in turned.values())
        rows.append([str(k + 1), start, end, up, size, turning, state, *more])
    heads = (kind, "start", "end", "up", "|f| (m/s^2)", "|w| (deg/s)", "state", *turned)
    return page.Table(_columns(*heads), rows)


ASIDE = ("min", "max", "end", "|w| (deg/s)")  # Columns for which a narrow page has no room.


def _columns(first: str, *others: str) -> list[page.Column]:
    return [
        page.Column(first),
        *(page.Column(other, "number", aside=other in ASIDE) for other in others),
    ]


def _table_columns(seen: Inspection) -> dict[str, FloatArray]:
    """Return angles and rate of the table in degrees, of logs that are means."""
    table = seen.log.table
    if table is None or seen.log.averaged is None:
        return {}
    names = ("outer (deg)", "middle (deg)", "inner (deg)")
    columns = dict(zip(names, np.degrees(table.angles.T), strict=True))
    if table.rate is not None:
        columns["table (deg/s)"] = np.degrees(table.rate)
    return {name: x for name, x in columns.items() if np.isfinite(x).any()}


def _means(seen: Inspection, triad: str) -> FloatArray | None:
    names = [f"{triad}_{axis}" for axis in AXES]
    if names[0] not in seen.rest_rows:
        return None
    return np.stack([seen.rest_rows[name] for name in names], axis=1)


# -- Allan variance --------------------------------------------------------------------------


def document(
    measured: LogAllan, name: str, block: str, noticed: Iterable[Finding] = ()
) -> page.Document:
    """Return the noises seen, the curves, and the noise block to copy."""
    first, bounds = next(iter(measured.channels.values())), pairs(measured)
    names = list(dict.fromkeys(word for word, noise, _ in _each(measured) if noise.seen))
    count = f"{len(names)} kinds" if len(names) != 1 else "1 kind"
    head = page.Heading(
        f"Noise of {name}",
        [
            f"At rest, {measured.start:.2f} s to {measured.end:.2f} s",
            f"{first.samples} samples",
            f"{1 / first.interval:.6g} Hz",
        ],
        "plain",
        f"{count} of noise seen",
        [", ".join(names).capitalize() + "."] if names else [],
    )
    used = f"{measured.start:.6g} s to {measured.end:.6g} s, {first.samples} samples"
    made = [("log", name), ("part used", used), ("versions", f"foucault {__version__}")]
    return page.Document.of(
        head,
        [_plot(measured, triad, bounds.get(triad)) for triad in ("gyro", "accel")],
        _each_axis(measured),
        page.findings(f for f in noticed if f.code != "allan.hidden"),  # the line above says it
        page.section("noise.block", page.Code(block)),
        _pairs(bounds),
        _noises(measured),
        page.section("noise.method", page.told("noise.method.text")),
        page.provenance(made),
    )


def _each(measured: LogAllan) -> Iterator[tuple[str, Noise, str]]:
    for name, channel in measured.channels.items():
        for word, noise in zip(WORDS[name.split(".")[0]], channel.noises, strict=False):
            yield word, noise, name


def _noises(measured: LogAllan) -> page.Section | None:
    rows: list[list[str]] = []
    for word, noise, name in _each(measured):
        if [name] not in rows:
            rows.append([name])
        told_ = described(noise, name.split(".")[0], measured.channels[name].longest)
        rows.append(["good" if noise.seen else "plain", word, *told_])
    heads = page.columns(": state | noise | value: number | ± sd: number aside | 95 % interval")
    return page.section("noise.noises", page.Table(heads, rows))


def _pairs(bounds: Mapping[str, Pair | None]) -> page.Section | None:
    """White noise and random walk for estimators, of each axis and of all of a triad."""
    rows = []
    for name, pair in bounds.items():
        if pair is None:
            continue
        kinds = [UNIT_KINDS[name.split(".")[0]][NOISES.index(n)] for n in ("white", "random_walk")]
        cells = [_in_unit(x, kind) for x, kind in zip((pair.white, pair.walk), kinds, strict=True)]
        rows.append([
            name if "." in name else f"{name}, all axes", *cells,
            f"{span(pair.first)} to {span(pair.last)}", f"{pair.least:.2f} to {pair.most:.2f}",
        ])  # fmt: skip
    heads = page.columns(
        " | N: number | K: number | bounds from: number aside | times measured: number"
    )
    return page.section("noise.pairs", page.Table(heads, rows))


def _in_unit(x: float, kind: str) -> str:
    unit = display_unit(kind, x)
    return f"{plain(convert(x, kind, unit), 4)} {unit}"


def _each_axis(measured: LogAllan) -> page.Section | None:
    """N, B and K of every axis, and in one line what was not seen."""
    seen = {NOISES[k] for c in measured.channels.values() for k in range(len(c.noises))
            if c.noises[k].seen}  # fmt: skip
    shown = [k for k, noise in enumerate(NOISES) if noise in MAIN or noise in seen]
    rows: list[list[str]] = []
    unseen: dict[str, list[str]] = {}
    for name, channel in measured.channels.items():
        cells = []
        for word, noise in zip(WORDS[name.split(".")[0]], channel.noises, strict=False):
            value, sd, _ = described(noise, name.split(".")[0], channel.longest)
            cells.append(f"{value} ± {sd}" if noise.seen else "-")
            if not noise.seen:
                unseen.setdefault(word, []).append(name)
        rows.append([name, *(cells[k] for k in shown)])
    heads = page.columns("axis", *(f"{LETTERS[NOISES[k]]}: number" for k in shown))
    of_all = [w for name in measured.channels for w in WORDS[name.split(".")[0]]]
    missed = [
        word if len(axes) == of_all.count(word) else f"{word} ({', '.join(axes)})"
        for word, axes in unseen.items()
    ]
    longest = f"{min(c.longest for c in measured.channels.values()):.3g}"
    line_ = (
        page.said("noise.axes.unseen", terms=", ".join(missed), longest=longest) if missed else ""
    )
    return page.section("noise.axes", page.Table(heads, rows), line_)


MAIN = ("white", "bias_instability", "random_walk")  # The coefficients that a data sheet has.
LETTERS = dict(zip(NOISES, "QNBKR", strict=True))  # The letters of IEEE Std 952.


def _plot(measured: LogAllan, triad: str, pair: Pair | None) -> page.Section | None:
    channels = {n: c for n, c in measured.channels.items() if n.startswith(triad)}
    if not channels:
        return None
    kind = KINDS[next(iter(channels.values())).kind]
    return page.section(
        "noise.plots", _figure(channels, triad, pair), title=TRIADS[triad][0], kind=kind
    )


def _figure(channels: Mapping[str, Channel], triad: str, pair: Pair | None) -> page.Figure:
    middle = float(np.median([np.median(c.deviation) for c in channels.values()]))
    unit, one = page.unit_of(TRIADS[triad][2], middle)
    data: list[chart.Trace] = []
    for (name, c), colour in zip(channels.items(), chart.SERIES, strict=False):
        tau = chart.numbers(c.tau)
        edge = np.concatenate([c.high, c.low[::-1]]) / one
        of_axis: chart.Trace = {"legendgroup": name}
        data += [
            chart.area("", tau + tau[::-1], edge, opacity=0.16, **of_axis | {"fillcolor": colour}),
            chart.line("", tau, c.curve / one, colour, width=1.2, **of_axis),
            chart.dots(
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
    if pair is not None:
        every = next(iter(channels.values())).tau
        inside = every[(every >= pair.first) & (every <= pair.last)]
        name = "N and K for estimators"
        data.append(
            chart.line(
                name, inside, pair.deviation(inside) / one, chart.INK, width=1.6, dash="dash"
            )
        )
    low = min(float(c.low.min()) for c in channels.values()) / one
    high = max(float(c.high[c.dof > 1].max()) for c in channels.values()) / one
    span = [math.log10(low) - 0.1, math.log10(high) + 0.1]
    look = chart.log_axis(f"deviation [{unit}]", range=span)
    return chart.draw("noise.figure", data, y=look)


def _single_noises(c: Channel, triad: str, one: float) -> list[chart.Trace]:
    dashes = dict(zip(NOISES, ("dot", "dash", "dashdot", "longdash", "longdashdot"), strict=True))
    return [
        chart.line(word, c.tau, part / one, chart.SOFT, width=1.1, dash=dashes[noise.name])
        for word, noise, part in zip(WORDS[triad], c.noises, c.parts, strict=True)
        if noise.seen and part.min() > 0
    ]
