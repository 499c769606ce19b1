"""The run of a transfer alignment: innovations, bound, attitude of the slave, hand-over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import format_value
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.report import figures_transfer as figures
from foucault.report.figures_transfer import Panel
from foucault.report.figures_tumble import Family
from foucault.report.page import Block, Code, Column, Section, Table, Text
from foucault.report.transfer import MINUTE, changes, mine, signed, started, table_of
from foucault.result import Result
from foucault.units import plain

GROUPED = 60
"""Points that the course of the NIS is drawn with [1]."""


PLACES = {
    "master": "The position is the master's, the lever arm away",
    "site": "The master says no position: it is that of [site] and the way from there",
}
"""Where the position of a hand-over is from, in words."""


def innovations(result: Result) -> Section | None:
    """What each message said beyond what was expected, and how it scatters."""
    table = table_of(result, "innovations")
    if not mine(result) or table is None or "nis" not in table:
        return None
    times = changes(result)
    blocks: list[Block] = [figures.innovations(table, f, times) for f in _channels(result, table)]
    time, ratio, limits = grouped_nis(table)
    if len(time) > 1:
        blocks += [
            Text("Squares of the innovations over their variances, means over "
                 f"{(time[1] - time[0]):.2g} s; 1 where all that was said is right. Dashed: all "
                 "means lie between, but once in a hundred such runs."),
            figures.nis(time, ratio, limits, times),
        ]  # fmt: skip
    spread = result.diagnostics.get("innovations") or {}
    words = "; ".join(
        f"{name} {s['ratio']:.3f} times as much as expected, allowed {s['low']:.3f} to "
        f"{s['high']:.3f}" for name, s in spread.items()
    )  # fmt: skip
    lead = "What messages say less what the filter expects, and ±2 sd of what it allows for."
    lead += f" All together scatter: {words}." if words else ""
    if result.diagnostics["filter"]["gamma"] is not None:
        lead += " An H-infinity filter allows for more than it expects: it may lie below."
    return Section("Innovations", lead, blocks)


def _channels(result: Result, table: Mapping[str, Any]) -> list[Family]:
    names, of = ("heading", "pitch", "roll"), "attitude"
    if result.diagnostics["filter"]["attitude_form"] == "vector":
        names, of = ("east", "north", "up"), "attitude, about"
    velocity = {f"velocity_{way}": way for way in ("east", "north", "up")}
    attitude = {f"attitude_{k}": name for k, name in enumerate(names, 1)}
    out = []
    for words, some, unit, size in (("velocity", velocity, "m/s", 1.0),
                                    (of, attitude, "arcmin", MINUTE)):  # fmt: skip
        used = {k: v for k, v in some.items() if k in table}
        if used:
            out.append(Family(words, tuple(used), tuple(used.values()), unit, size))
    return out


def grouped_nis(table: Mapping[str, Any]) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Return times, means of the NIS over its number, and their limits.

    `table` (m,): the innovations.
    """
    used = [k for k in table if f"{k}_sd" in table]
    count = np.sum([np.isfinite(np.asarray(table[k], float)) for k in used], axis=0)
    nis, time = np.asarray(table["nis"], float), np.asarray(table["time"], float)
    seen = (count > 0) & np.isfinite(nis)
    nis, time, count = nis[seen], time[seen], count[seen]
    each = max(1, -(-len(nis) // GROUPED))
    n = len(nis) // each
    if n == 0:
        return np.empty(0), np.empty(0), (0.0, 0.0)
    square, number = (x[: n * each].reshape(n, each).sum(axis=1) for x in (nis, count))
    fewest = int(number.min())
    low, high = chi_square_limits(fewest, FALSE_ALARM, n)
    middle = time[: n * each].reshape(n, each).mean(axis=1)
    return middle, square / number, (low / fewest, high / fewest)


def bound(result: Result) -> Section | None:
    """How near the H-infinity filter comes to the end of its bound."""
    table = table_of(result, "gamma")
    if not mine(result) or table is None:
        return None
    f, used = result.diagnostics["filter"], 1 - np.asarray(table["margin"], float)
    worst = int(np.nanargmax(used))
    time = np.asarray(table["time"], float)
    most, when = plain(float(used[worst]), 2), plain(float(time[worst]), 4)
    lead = (
        f"There is an H-infinity filter of gamma {plain(f['gamma'], 4)} as long as what is "
        "uncertain of the states it is a bound of stays below gamma squared at every step. "
        f"The largest part of it, {most}, is used at {when} s. Below the least gamma what is "
        "inflated feeds itself from message to message until it reaches 1."
    )
    return Section("Bound of the filter", lead, [figures.bound(time, used, changes(result))])


def attitude(result: Result) -> Section | None:
    """Heading, pitch and roll of the slave as seen from the end, with sd."""
    table = table_of(result, "smoothed")
    if not mine(result) or table is None or not len(table["time"]):
        return None
    time, times = np.asarray(table["time"], float), changes(result)
    heading = np.degrees(np.unwrap(np.asarray(table["heading"], float)))
    turned = 360 * np.floor(heading[0] / 360)
    level = tuple((n, np.degrees(table[n])) for n in ("pitch", "roll"))
    some = [Panel("heading [°]", (("heading", heading - turned),), {}),
            Panel("pitch, roll [°]", level, {})]  # fmt: skip
    sds = [np.asarray(table[f"phi_{way}_sd"], float) / MINUTE for way in ("east", "north", "up")]
    about = tuple((f"about {w}", y) for w, y in zip(("east", "north", "up"), sds, strict=True))
    alt = "Heading, pitch and roll of the slave against time"
    blocks: list[Block] = [
        figures.panels(time, some, times, alt),
        figures.panels(time, [Panel("sd [arcmin]", about, {"rangemode": "tozero"})], times,
                       "Standard deviations of the attitude against time", 50, 260),
    ]  # fmt: skip
    middle = [float(np.median(sd)) for sd in sds]
    lead = (
        "Attitude of the slave from all messages, those after it too. Half of the time it is "
        f"known within {plain(max(middle[:2]), 2)} arcmin about level axes and "
        f"{plain(middle[2], 2)} arcmin about the vertical (sd)."
    )
    return Section("Attitude", lead, blocks)


def mounting(result: Result) -> Section | None:
    """How the slave is turned on its master, and how that is used."""
    known = result.diagnostics.get("mounting")
    if not mine(result) or not known:
        return None
    pairs = zip(("heading", "pitch", "roll"), known["nominal"], known["angles"], strict=True)
    rows = [[n, *(signed(f"{np.degrees(x):.4f}") for x in (said, found))]
            for n, said, found in pairs]  # fmt: skip
    columns = [Column("of the slave on its master"), Column("nominal [°]", "number"),
               Column("found [°]", "number")]  # fmt: skip
    arm = ", ".join(signed(plain(x, 4)) for x in known["lever_arm"])
    lead = (
        "Coordinates in the axes of the slave, s, go over into those of the master, m, by "
        "x_m = C_ms x_s. The coefficients of the installation are the rotation from the nominal "
        "C_ms to the one found, right-handed about the axes of the slave; their sd stands above. "
        f"The lever arm, {arm} m right, forward and up of the master, was taken as exact."
    )
    matrix = "\n".join(f"    [{', '.join(f'{x:.9f}' for x in row)}]," for row in known["C_ms"])
    code = (
        f"C_ms = np.array([  # x_m = C_ms @ x_s\n{matrix}\n])\n"
        "C_ns = C_nm @ C_ms    # attitude of the slave from that of its master, and\n"
        "C_nm = C_ns @ C_ms.T  # the other way: f_m = C_ms @ f_s, w_m = C_ms @ w_s"
    )
    return Section("Mounting", lead, [Table(columns, rows), Code(code)])


def handed(result: Result) -> Section | None:
    """The state in which the slave goes on alone."""
    state = result.diagnostics.get("hand_over")
    if not mine(result) or not state:
        return None
    sd = np.sqrt(np.diag(np.array(state["covariance"], float)))
    level = float(np.max(sd[:2])) / MINUTE
    speed = float(np.sqrt(np.mean(sd[3:6] ** 2)))
    rows = [
        ["latitude", f"{np.degrees(state['latitude']):.7f}", "", "°"],
        ["longitude", f"{np.degrees(state['longitude']):.7f}", "", "°"],
        ["height", f"{state['height']:.2f}", "", "m"],
    ]
    rows += [
        [f"velocity {way}", format_value(v, s), format_value(s, s), "m/s"]
        for way, v, s in zip(("east", "north", "up"), state["velocity"], sd[3:], strict=True)
    ]
    for name, spread in (("heading", sd[2] / MINUTE), ("pitch", level), ("roll", level)):
        rows.append([name, f"{np.degrees(state[name]):.4f}", format_value(spread, spread), "°"])
    cells = [[n, signed(v), f"{s} {'arcmin' if u == '°' and s else ''}".strip(), u]
             for n, v, s, u in rows]  # fmt: skip
    columns = [Column("quantity"), Column("value", "number"), Column("unit", "short"),
               Column("± sd", "number")]  # fmt: skip
    table = Table(columns, [[n, v, u, s] for n, v, s, u in cells])
    at = float(state["time"]) - started(result)
    lead = (
        f"How the slave goes on alone from {plain(at, 6)} s on: the last "
        "message carried forward over its delay, with the coefficients above. "
        f"{PLACES[state.get('place', 'master')]}; pitch and roll are known at least as well as is "
        "said."
    )
    more = (
        "Where the slave's log goes on after that, and something else knows where it went, this "
        "says what the calibration is worth in metres. Its --from counts from the start of LOG; "
        "where that is later than the start of this log, as in outage.csv of foucault "
        "simulate, take off by how much:"
    )
    angles = " ".join(f"--{n} '{np.degrees(state[n]):.5f} deg'"
                      for n in ("heading", "pitch", "roll"))  # fmt: skip
    code = (
        f"foucault navigate LOG --reference REFERENCE --calibration result.json \\\n"
        f"    --from '{plain(at, 9)} s' {angles} \\\n"
        f"    --heading-sd '{format_value(sd[2] / MINUTE, sd[2] / MINUTE)} arcmin' "
        f"--level-sd '{format_value(level, level)} arcmin' \\\n"
        f"    --velocity '{', '.join(f'{v:.4f} m/s' for v in state['velocity'])}' "
        f"--velocity-sd '{format_value(speed, speed)} m/s' -o navigation"
    )
    return Section("Hand-over", lead, [table, Text(more), Code(code)])
