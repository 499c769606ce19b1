"""Figures of a systematic calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.report.figures import (
    FIRST,
    SECOND,
    THIRD,
    Trace,
    axis,
    count_axis,
    layout,
    level_line,
    numbers,
)
from foucault.report.page import Figure

Columns = Mapping[str, npt.NDArray[Any]]

WAYS = ("east", "north", "up")
COLOURS = dict(zip(WAYS, (FIRST, SECOND, THIRD), strict=True))
OF_AXES = dict(zip("xyz", (FIRST, SECOND, THIRD), strict=True))

COMPENSATED = {
    "none": "as it is", "all but deflection": "all but deflection compensated",
    "all": "compensated",
}  # fmt: skip
"""What is compensated, in words."""

DASHES = dict(zip(COMPENSATED, ("dot", "dash", "solid"), strict=True))

ARCSEC = float(np.radians(1.0 / 3600.0))

QUANTITIES = {
    "shift": (ARCSEC, "tilt [″]", "Tilt"),
    "velocity": (1.0, "velocity [m/s]", "Velocity"),
}
"""What is drawn of the navigation test: its unit [SI], the axis, and its name."""

SAME = np.cos(np.radians(3.0))
"""An axis nearer than this points there [1]."""

ROOM = 26
"""Width of the name of an axis [px]."""

LABELS = 40
"""So many rests are named on the axis, more are numbered [1]."""


def velocities(table: Columns) -> Figure:
    """Draw the velocity at the end of every rest: before above, after below with +-2 sd."""
    rest = np.asarray(table["rest"], int) + 1
    data: list[Trace] = []
    units = {name: _unit(table, name) for name in ("before", "after")}
    for k, way in enumerate(WAYS):
        x = numbers(rest + 0.16 * (k - 1))
        for name, ref in (("before", "y2"), ("after", "y")):
            unit, per = units[name]
            trace: Trace = {
                "type": "scatter", "mode": "markers", "name": way, "legendgroup": way, "x": x,
                "y": numbers(per * np.asarray(table[f"{name}_{way}"], float)), "yaxis": ref,
                "showlegend": name == "before", "marker": {"color": COLOURS[way], "size": 6},
                "customdata": rest.tolist(),
                "hovertemplate": f"rest %{{customdata}}: %{{y:.3g}} {unit}<extra>{way}, "
                f"{name}</extra>",
            }  # fmt: skip
            if name == "after":
                two_sd = 2 * per * np.asarray(table[f"sd_{way}"], float)
                trace["error_y"] = {
                    "type": "data", "array": numbers(two_sd), "width": 0, "thickness": 1.2,
                    "color": COLOURS[way],
                }  # fmt: skip
            data.append(trace)
    look = layout(
        400,
        xaxis=_rests(int(rest.max())),
        yaxis=axis(f"after [{units['after'][0]}]", domain=[0, 0.46]),
        yaxis2=axis(f"before [{units['before'][0]}]", domain=[0.56, 1]),
        shapes=[level_line(0, "y", "solid"), level_line(0, "y2", "solid")],
    )
    alt = "Velocity at the end of every rest, east, north and up, before and after the calibration"
    caption = "Note the two scales. Bars: two standard deviations of what is promised."
    return Figure(data, look, caption, alt=alt)


def _unit(table: Columns, name: str) -> tuple[str, float]:
    """Return the unit of a row of velocities, and how many of it are 1 m/s."""
    most = max(float(np.abs(table[f"{name}_{way}"]).max()) for way in WAYS)
    return ("m/s", 1.0) if most >= 1.0 else ("mm/s", 1e3)


def _rests(n: int) -> dict[str, Any]:
    return count_axis("rest", n, 12)


def attitudes(table: Columns, labels: Sequence[str]) -> Figure:
    """Draw which axis of the body points east, north and up at every rest."""
    rest = np.asarray(table["rest"], int)
    groups: dict[str, list[tuple[int, str, str, str]]] = {a: [] for a in "xyz"}
    for way in WAYS:
        parts = np.array([np.asarray(table[f"{a}.{way}"], float) for a in "xyz"])
        for k, column in enumerate(parts.T):
            i = int(np.abs(column).argmax())
            name = ("−" if column[i] < 0 else "+") + "xyz"[i]
            exact = abs(column[i]) > SAME
            angle = np.degrees(np.arccos(min(abs(float(column[i])), 1.0)))
            said = f"{labels[rest[k]]}: {name} {angle:.1f}° from {way}"
            groups["xyz"[i]].append((int(rest[k]) + 1, way, name if exact else f"({name})", said))
    data: list[Trace] = [
        {
            "type": "scatter", "mode": "text", "name": a, "x": [r for r, *_ in some],
            "y": [way for _, way, *_ in some], "text": [word for _, _, word, _ in some],
            "hovertext": [said for *_, said in some], "hoverinfo": "text", "showlegend": False,
            "textfont": {"color": OF_AXES[a], "size": 13},
        }
        for a, some in groups.items()
    ]  # fmt: skip
    n = int(rest.max()) + 1
    ticks = _rests(n)
    if n <= LABELS:
        ticks |= {"tickvals": [*range(1, n + 1)], "ticktext": list(labels), "tickangle": -60}
        ticks["title"] = {"text": ""}
    look = layout(
        220,
        xaxis=ticks,
        yaxis={"categoryorder": "array", "categoryarray": list(WAYS), "range": [-0.6, 2.6]},
        meta={"least": 90 + ROOM * n},
    )
    return Figure(data, look, alt="Axis of the body that points east, north and up at every rest")


def innovations(table: Columns, labels: Sequence[str]) -> Figure:
    """Draw the scatter of what is seen in every rest over what is allowed for."""
    count = np.maximum(np.asarray(table["count"], float), 1.0)
    ratio = np.sqrt(np.asarray(table["square"], float) / count)
    x = np.arange(1, len(ratio) + 1)
    data: list[Trace] = [
        {
            "type": "bar", "x": x.tolist(), "y": numbers(ratio), "marker": {"color": FIRST},
            "customdata": list(labels), "showlegend": False,
            "hovertemplate": "%{customdata}: %{y:.3f}<extra></extra>",
        }
    ]  # fmt: skip
    look = layout(
        230, xaxis=_rests(len(ratio)), shapes=[level_line(1.0)],
        yaxis=axis("innovation / sd", range=[0, max(1.15, 1.05 * float(ratio.max()))]),
    )  # fmt: skip
    caption = (
        "Root mean square of the normalised innovations of every rest. Below the dashed line the "
        "instrument stands stiller than was said, which does no harm."
    )
    alt = "Root mean square of the normalised innovations of every rest"
    return Figure(data, look, caption, alt=alt)


def navigation(table: Columns, about: str, what: str) -> Figure:
    """Draw tilt ("shift") or velocity of the navigation test against time."""
    mine = np.asarray(table["about"]).astype(str) == about
    ways = np.asarray(table["compensated"]).astype(str)
    time = np.asarray(table["time"], float)
    per, title, said = QUANTITIES[what]
    data: list[Trace] = []
    for way in dict.fromkeys(ways[mine].tolist()):
        rows = mine & (ways == way)
        data += [
            {
                "type": "scatter", "mode": "lines", "name": part, "legendgroup": part,
                "showlegend": way == "all", "x": numbers(time[rows]),
                "y": numbers(np.asarray(table[f"{what}_{part}"], float)[rows] / per),
                "line": {"color": COLOURS[part], "dash": DASHES[way], "width": 1.8},
                "hovertemplate": f"%{{x:.0f}} s: %{{y:.4g}}<extra>{part}, {COMPENSATED[way]}"
                "</extra>",
            }
            for part in WAYS[:2]
        ]  # fmt: skip
    look = layout(
        270, xaxis=axis("time since the spin began [s]"), yaxis=axis(title),
        shapes=[level_line(0, "y", "solid")], meta={"zoom": True},
    )  # fmt: skip
    alt = f"{said} east and north after a spin about {about}, compensated and not"
    return Figure(data, look, f"{said}, spin about {about}.", share=50, alt=alt)
