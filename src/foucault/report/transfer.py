"""What a transfer alignment did, and what it found: delay, estimates, what each manoeuvre shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.coefficients import format_value
from foucault.models.geodesy import displacement
from foucault.report import figures_navigation
from foucault.report import figures_transfer as figures
from foucault.report.figures import FIRST
from foucault.report.figures_transfer import Panel, Times
from foucault.report.figures_tumble import Family
from foucault.report.page import Block, Column, Facts, Figure, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Result
from foucault.units import plain

FloatArray = npt.NDArray[np.float64]

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

UNSEEN = 0.01
"""A part whose delay is less certain than this shows none [s]."""

MINUTE = float(np.radians(1 / 60))


def mine(result: Result) -> bool:
    return result.procedure == "transfer_alignment" and "filter" in result.diagnostics


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
    ]
    lead = (
        "The slave is navigated beside its master; what the two say of the same instants shows "
        "the errors of the slave, how it is mounted, and how late the messages are."
    )
    if f["gamma"] is not None:
        times = f["gamma"] / f["least_gamma"]
        words = f"{plain(f['gamma'], 4)}, {times:.2f} times the least, {plain(f['least_gamma'], 4)}"
        pairs[4:4] = [("gamma", words), ("bound of", WANTED.get(f["wanted"], str(f["wanted"])))]
        lead += (
            " Standard deviations are those of an H-infinity filter: bounds, inflated as gamma "
            "demands, rather than the spread of the error. They do not make up for a noise or a "
            "mount that is far from what was said."
        )
    return Section("What was done", lead, [Facts(pairs)])


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
        return f"{_ms(delay['used'], delay['sd'])} ms, starting from {METHODS[delay['method']]}"
    if delay["method"] == "none":
        return "none: messages are taken as if they held when they arrive"
    return f"{plain(1e3 * delay['used'])} ms, as given"


def _ms(seconds: float, sd: float) -> str:
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


# -- the delay -------------------------------------------------------------------------------


def delay(result: Result) -> Section | None:
    """How late messages are by each method and in parts, and what that is worth in motion."""
    if not mine(result):
        return None
    known = result.diagnostics["delay"]
    blocks: list[Block] = []
    rows = _methods(known)
    if rows:
        columns = [Column("method"), Column("delay [ms]", "number"), Column("± sd [ms]", "number")]
        blocks.append(Table(columns, rows))
    if words := _drift(known):
        blocks.append(Text(words))
    gone, lead = result.tables.get("delayed"), ""
    if gone is not None and len(gone["time"]) and known["used"] != 0:
        lead = _worth(gone, known["used"])
        blocks.append(_gone(gone, changes(result)))
    tried, fit = result.tables.get("likelihood"), known.get("likelihood")
    if tried is not None and fit:
        log_l = np.asarray(tried["log_likelihood"], float)
        times = np.asarray(tried["delay"], float)
        blocks.append(figures.likelihood(times, log_l.max() - log_l, fit["value"], fit["sd"]))
    parts = result.tables.get("delay_parts")
    if parts is not None and len(parts["start"]) > 1:
        blocks += [Text("By matching what both turned, part by part of the log:"), _parts(parts)]
    return Section("Delay of the messages", lead, blocks) if blocks else None


def _methods(known: Mapping[str, Any]) -> list[list[str]]:
    out = []
    if "sd" in known:
        out.append(("the result: state of the filter", known["used"], known["sd"]))
    for key, words in (("likelihood", "likeliest"), ("rate_matching", "what both turned")):
        if known.get(key):
            out.append((words, known[key]["value"], known[key]["sd"]))
    return [[words, *_ms(value, sd).split(" ± ")] for words, value, sd in out]


def _drift(known: Mapping[str, Any]) -> str:
    match = known.get("rate_matching")
    if not match or not match["drift_sd"] > 0:
        return ""
    if match["drift"] == 0:
        return (f"The clocks of the two do not drift against one another, within "
                f"{plain(2e6 * match['drift_sd'], 2)} ppm.")  # fmt: skip
    sd = 1e6 * match["drift_sd"]
    value = signed(format_value(1e6 * match["drift"], sd))
    return f"The delay grows by {value} ± {format_value(sd, sd)} ppm of time: the clocks drift."


def _worth(gone: Mapping[str, FloatArray], used: float) -> str:
    turn = float(np.degrees(np.nanmax(np.abs(gone["heading"]))))
    speed = float(np.nanmax(np.hypot(gone["velocity_east"], gone["velocity_north"])))
    return (
        f"In {plain(1e3 * used, 4)} ms the slave went on by up to {plain(turn, 2)}° of heading and "
        f"{plain(speed, 2)} m/s of velocity: so far off a message is when it arrives."
    )


def _gone(gone: Mapping[str, FloatArray], times: Times) -> Figure:
    some = [
        Panel("heading [°]", (("heading", np.degrees(gone["heading"])),), {}),
        Panel("east [m/s]", (("velocity east", gone["velocity_east"]),), {}),
        Panel("north [m/s]", (("velocity north", gone["velocity_north"]),), {}),
    ]
    alt = "What the slave went on in heading and velocity while each message was under way"
    caption = "The slave when a message arrives less the slave when it held."
    time = np.asarray(gone["time"], float)
    return figures.panels(time, some, times, alt, 50, 100, caption)


def _parts(parts: Mapping[str, FloatArray]) -> Table:
    columns = [Column("from [s]", "number"), Column("to [s]", "number"),
               Column("delay [ms]", "number"), Column("± sd [ms]", "number")]  # fmt: skip
    rows = []
    for a, b, value, sd in zip(*(parts[k] for k in ("start", "end", "delay", "delay_sd")),
                               strict=True):  # fmt: skip
        cells = _ms(float(value), float(sd)).split(" ± ") if sd < UNSEEN else ["not seen", ""]
        rows.append([f"{a:.0f}", f"{b:.0f}", *cells])
    return Table(columns, rows)


def signed(text: str) -> str:
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


# -- the motion ------------------------------------------------------------------------------


def changes(result: Result) -> Times:
    """Return when a manoeuvre begins or ends [s]; nothing where there are too many."""
    table = result.tables.get("stretches")
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
    table, course = result.tables.get("stretches"), result.tables.get("estimates")
    if not mine(result) or table is None or course is None:
        return None
    c = result.coefficients
    before = dict(zip(c.names, c.prior_sd, strict=True))
    groups = [f for f in families(result) if all(0 < before[m] < np.inf for m in f.members)]
    path = result.tables.get("smoothed")
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
    table = result.tables.get("estimates")
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
