"""What a transfer alignment did, and what it found: delay, estimates, what each manoeuvre shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import format_value
from foucault.models.geodesy import displacement
from foucault.report import figures_navigation
from foucault.report import figures_transfer as figures
from foucault.report.figures import FIRST
from foucault.report.figures_transfer import Times
from foucault.report.figures_tumble import Family
from foucault.report.page import Block, Column, Facts, Figure, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Result
from foucault.units import plain

MATCHED = {
    "velocity+attitude": "velocity and attitude", "velocity": "velocity", "attitude": "attitude",
}  # fmt: skip
"""What of the messages is used, in words."""

FORMS = {"vector": "attitude as a rotation vector", "angles": "attitude as heading, pitch, roll"}
"""How attitudes are compared, in words."""

METHODS = {
    "rate matching": "what both turned", "likelihood": "the likeliest",
    "state": "the middle of its bracket",
}  # fmt: skip
"""Where the delay starts from, in words."""

WANTED = {"prior": "every state, in units of its prior", "outage": "position after the outage"}
"""What a bound is of, in words."""

GROUPS = {
    "gyro.bias": ("gyro bias", "deg/h"),
    "gyro.scale": ("gyro scale", "ppm"),
    "accel.bias": ("accel bias", "mg"),
    "installation": ("installation", "arcmin"),
    "master": ("delay", "ms"),
    "load": ("installation per g", "arcmin"),
}
"""Group of coefficients -> how a figure calls it, and its unit."""

MOST = 40
"""So many stretches are listed and marked [1]."""

DOTTED = "Dotted: a manoeuvre begins or ends."

BACK = 5.0
"""Turns that come to less end where they began [deg]."""

MINUTE = float(np.radians(1 / 60))


def mine(result: Result) -> bool:
    return result.procedure == "transfer_alignment" and "filter" in result.diagnostics


def started(result: Result) -> float:
    """Return when the slave's log begins by its clock [s]: times of the report count from there."""
    return float(result.diagnostics.get("start", 0.0))


def table_of(result: Result, name: str) -> Mapping[str, Any] | None:
    """Return a table of the run, its times counted from the start of the slave's log [s].

    None where there is none, or where it is of another procedure, which has tables of that name.
    """
    table = result.tables.get(name)
    if table is None or not mine(result):
        return None
    clock = ("time", "start", "end")
    return {k: np.asarray(v, float) - started(result) if k in clock else v
            for k, v in table.items()}  # fmt: skip


def done(result: Result) -> Section | None:
    """What was matched, by which filter, and where the delay is from."""
    if not mine(result):
        return None
    d, f = result.diagnostics, result.diagnostics["filter"]
    messages, noise = d["messages"], d["noise"]
    matching = [MATCHED[d["matching"]]]
    if "attitude" in d["matching"]:
        matching.append(FORMS[f["attitude_form"]])
    pairs = [
        ("matched", "; ".join(matching)),
        ("sd of a difference", _scatter(d["matching"], f)),
        ("messages used", f"{messages['used']} of {messages['logged']}"),
        ("filter", _filter(d)),
        ("delay", _delay(d["delay"])),
        ("mount", _mount(f)),
        ("noise of the gyros", _noise(noise["gyro"], "angle random walk")),
        ("noise of the accelerometers", _noise(noise["accel"], "velocity random walk")),
        *_clock(started(result)),
    ]
    lead = (
        "The slave is navigated beside its master; what the two say of the same instants shows "
        "the errors of the slave, how it is mounted, and how late the messages are."
    )
    if f["gamma"] is not None:
        times = f["gamma"] / f["least_gamma"]
        words = f"{plain(f['gamma'], 4)}, {times:.2f} times the least, {plain(f['least_gamma'], 4)}"
        at = [name for name, _ in pairs].index("delay")
        pairs[at:at] = [("gamma", words), ("bound of", WANTED.get(f["wanted"], str(f["wanted"])))]
        lead += (
            " Standard deviations are those of an H-infinity filter: bounds, inflated as gamma "
            "demands, rather than the spread of the error. They do not make up for a noise or a "
            "mount that is far from what was said."
        )
    return Section("What was done", lead, [Facts(pairs)])


def _clock(start: float) -> list[tuple[str, str]]:
    words = f"{plain(start, 13)} s of the slave's clock, the start of its log"
    return [("time 0", words)] if start else []


def _scatter(matching: str, f: Mapping[str, Any]) -> str:
    parts = []
    if "velocity" in matching:
        parts.append(f"{plain(f['velocity_sd'], 3)} m/s")
    if "attitude" in matching:
        parts.append(f"{plain(f['attitude_sd'] / MINUTE, 3)} arcmin")
    return ", ".join(parts) + " each component"


def _filter(d: Mapping[str, Any]) -> str:
    f, passes = d["filter"], np.array(d["passes"]["values"], float)
    name = {"kalman": "Kalman", "h_infinity": "H-infinity"}[f["name"]]
    n = len(passes)
    return f"{name}, {f['states']} states, {n} pass{'es' * (n != 1)}"


def _delay(delay: Mapping[str, Any]) -> str:
    if delay["method"] in METHODS:
        value = milliseconds(delay["used"], delay["sd"])
        return f"{value} ms, starting from {METHODS[delay['method']]}"
    if delay["method"] == "none":
        return "none: messages are taken as if they held when they arrive"
    return f"{plain(1e3 * delay['used'])} ms, as given"


def milliseconds(seconds: float, sd: float) -> str:
    value, spread = 1e3 * seconds, 1e3 * sd
    return f"{signed(format_value(value, spread))} ± {format_value(spread, spread)}"


def _mount(f: Mapping[str, Any]) -> str:
    parts = []
    if f["load"]:
        parts.append("gives way under load")
    if f["flexure_sd"] > 0:
        parts.append(f"bends by {plain(f['flexure_sd'] / MINUTE, 3)} arcmin over "
                     f"{plain(f['flexure_time'], 3)} s")  # fmt: skip
    if f["wander"] > 0:
        parts.append("wanders")
    return ", ".join(parts) or "rigid"


def _noise(white: float, kind: str) -> str:
    unit = units.display_unit(kind, white)
    return f"{plain(units.convert(white, kind, unit), 3)} {shown(unit)}"


def signed(text: str) -> str:
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


# -- the motion ------------------------------------------------------------------------------


def changes(result: Result) -> Times:
    """Return when a manoeuvre begins or ends [s]; nothing where there are too many."""
    table = table_of(result, "stretches")
    if table is None or len(table["start"]) > MOST:
        return []
    return [float(t) for t in table["start"][1:]]


def families(result: Result) -> list[Family]:
    """Return the coefficients in groups of one kind."""
    out = []
    for group, (words, unit) in GROUPS.items():
        some = [c for c in result.coefficients.layout.coefficients
                if c.name.startswith(f"{group}.")]  # fmt: skip
        if some:
            names = tuple(c.name for c in some)
            labels = tuple(n.rpartition(".")[2] for n in names)
            out.append(Family(words, names, labels, shown(unit), units.factor(unit, some[0].kind)))
    return out


def motion(result: Result) -> Section | None:
    """What each manoeuvre has shown of every group of coefficients."""
    table, course = table_of(result, "stretches"), table_of(result, "estimates")
    if not mine(result) or table is None or course is None:
        return None
    c = result.coefficients
    before = dict(zip(c.names, c.prior_sd, strict=True))
    groups = [f for f in families(result) if all(0 < before[m] < np.inf for m in f.members)]
    path = table_of(result, "smoothed")
    moved = path is not None and len(path["time"]) > 1
    blocks: list[Block] = [
        figures.known(course, groups, before, changes(result), 62 if moved else 100)
    ]
    if path is not None and moved:
        blocks.append(_map(path))
    n = len(table["start"])
    lead = (
        "Standard deviation of each group of coefficients, that of its least known axis, over "
        "that beforehand. "
    )
    if n <= MOST:
        words = "Manoeuvre by manoeuvre, sd after it over sd before it, mean of the axes:"
        blocks += [Text(words), _stretches(table, groups, before)]
        lead += DOTTED
    else:
        lead += f"The vehicle did {n} manoeuvres, too many to be listed."
    return Section("What the motion shows", lead, blocks)


def _stretches(
    table: Mapping[str, Any], groups: list[Family], before: Mapping[str, float]
) -> Table:
    columns = [
        Column("manoeuvre"), Column("from [s]", "number"), Column("to [s]", "number", aside=True),
        *(Column(f"{g.name}", "number") for g in groups),
    ]  # fmt: skip
    rows = []
    last = {m: before[m] for g in groups for m in g.members}
    for k, (a, b) in enumerate(zip(table["start"], table["end"], strict=True)):
        now = {m: float(table[f"{m}_sd"][k]) for m in last}
        cells = [np.exp(np.mean([np.log(now[m] / last[m]) for m in g.members])) for g in groups]
        rows.append([_did(table, k), f"{a:.0f}", f"{b:.0f}", *(_left(float(v)) for v in cells)])
        last = now
    return Table(columns, rows)


def _left(part: float) -> str:
    return f"{part:.2f}" if part > 0.095 else plain(part, 1)


def _did(table: Mapping[str, Any], k: int) -> str:
    kind, turn = str(table["kind"][k]), float(np.degrees(table["turn"][k]))
    faster = float(table["speed"][k])
    if kind == "turning":
        return "turns to and fro" if turn < BACK else f"turns, net {turn:.0f}°"
    if kind == "accelerated":
        return f"{'faster' if faster > 0 else 'slower'} by {abs(faster):.1f} m/s"
    return "straight on"


def _map(path: Mapping[str, FloatArray]) -> Figure:
    lat, lon = (np.asarray(path[k], float) for k in ("latitude", "longitude"))
    zero = np.zeros_like(lat)
    east, north, _ = displacement(lat[0], lon[0], 0.0, lat, lon, zero).T
    time = np.asarray(path["time"], float)
    at = [int(np.searchsorted(time, t)) for t in np.linspace(time[0], time[-1], 5)[1:-1]]
    marks = [(f"{time[i]:.0f} s", float(east[i]), float(north[i])) for i in at]
    line = ("slave", east, north, FIRST, "solid")
    return figures_navigation.paths([line], [], marks, "East and north of the start.", share=38)


# -- estimates ----------------------------------------------------------------------------------


def estimates(result: Result) -> Section | None:
    """Estimates against time with two standard deviations."""
    table = table_of(result, "estimates")
    if not mine(result) or table is None or not len(table["time"]):
        return None
    times = changes(result)
    blocks: list[Block] = [figures.estimates(table, f, times) for f in families(result)]
    lead = (
        "Each estimate as it was at that time, within two standard deviations. In the first "
        "moments, when nothing is known, a band may leave the figure. "
    )
    lead += DOTTED if times else ""
    return Section("Estimates in the course of time", lead.strip(), blocks)
