"""How late the messages of a master come, and what is found where that is ignored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import format_value
from foucault.report import figures_transfer as figures
from foucault.report.figures_transfer import Panel, Times
from foucault.report.figures_tumble import Family
from foucault.report.page import Block, Column, Figure, Section, Table, Text
from foucault.report.transfer import changes, families, milliseconds, mine, signed, table_of
from foucault.result import Result
from foucault.units import plain

UNSEEN = 0.01
"""A part whose delay is less certain than this shows none [s]."""

COMPARED = ("installation", "gyro.bias")
"""Groups of coefficients that are drawn with the delay and without it."""


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
    gone, lead = table_of(result, "delayed"), ""
    if gone is not None and len(gone["time"]) and known["used"] != 0:
        lead = _worth(gone, known["used"])
    tried, fit = table_of(result, "likelihood"), known.get("likelihood")
    if lead and gone is not None:
        blocks.append(_gone(gone, changes(result), 50 if tried is not None and fit else 100))
    if tried is not None and fit:
        log_l = np.asarray(tried["log_likelihood"], float)
        times = np.asarray(tried["delay"], float)
        blocks.append(figures.likelihood(times, log_l.max() - log_l, fit["value"], fit["sd"]))
    parts = table_of(result, "delay_parts")
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
    return [[words, *milliseconds(value, sd).split(" ± ")] for words, value, sd in out]


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


def _gone(gone: Mapping[str, FloatArray], times: Times, share: int) -> Figure:
    some = [
        Panel("heading [°]", (("heading", np.degrees(gone["heading"])),), {}),
        Panel("east [m/s]", (("velocity east", gone["velocity_east"]),), {}),
        Panel("north [m/s]", (("velocity north", gone["velocity_north"]),), {}),
    ]
    alt = "What the slave went on in heading and velocity while each message was under way"
    caption = "The slave when a message arrives less the slave when it held."
    time = np.asarray(gone["time"], float)
    return figures.panels(time, some, times, alt, share, 100, caption)


def _parts(parts: Mapping[str, FloatArray]) -> Table:
    columns = [Column("from [s]", "number"), Column("to [s]", "number"),
               Column("delay [ms]", "number"), Column("± sd [ms]", "number")]  # fmt: skip
    rows = []
    for a, b, value, sd in zip(*(parts[k] for k in ("start", "end", "delay", "delay_sd")),
                               strict=True):  # fmt: skip
        cells = (
            milliseconds(float(value), float(sd)).split(" ± ") if sd < UNSEEN else ["not seen", ""]
        )
        rows.append([f"{a:.0f}", f"{b:.0f}", *cells])
    return Table(columns, rows)


# -- what ignoring it does ---------------------------------------------------------------------


def ignored(result: Result) -> Section | None:
    """The estimates of the same run where messages are taken as if they held on arrival."""
    ours, other = table_of(result, "estimates"), table_of(result, "undelayed")
    if not mine(result) or ours is None or other is None or not len(other["time"]):
        return None
    times, drawn = changes(result), [f for f in families(result) if _compared(f)]
    blocks: list[Block] = [figures.compared(ours, other, f, times) for f in drawn]
    columns = [
        Column("coefficient", "name"), Column("unit", "short"), Column("with the delay", "number"),
        Column("± sd", "number"), Column("ignored", "number"),
        Column("± its sd", "number", aside=True),
        Column("off by, in its sds", "number", aside=True),
    ]  # fmt: skip
    rows = []
    for f in families(result):
        for name in (n for n in f.members if n in other):
            a, b = (float(x[name][-1]) / f.size for x in (ours, other))
            sd, claimed = (float(x[f"{name}_sd"][-1]) / f.size for x in (ours, other))
            rows.append([name, f.unit, signed(format_value(a, sd)), format_value(sd, sd),
                         signed(format_value(b, claimed)), format_value(claimed, claimed),
                         f"{abs(b - a) / claimed:.1f}"])  # fmt: skip
    lead = (
        "The same filter, told nothing of the delay: its estimates beside those above, each within "
        "the two standard deviations that it claims. Where the vehicle turns, a delay looks like "
        "a bias of an accelerometer and a rotation of the mounting."
    )
    return Section("Had the delay been ignored", lead, [*blocks, Table(columns, rows)])


def _compared(family: Family) -> bool:
    return any(m.startswith(f"{g}.") for g in COMPARED for m in family.members)
