"""The figures of a fleet: histograms side by side, drawn from counts, so that they stay small."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.fleet import middle_and_spread
from foucault.models.imu import LAYOUT
from foucault.report import figures
from foucault.report.page import Figure, Section
from foucault.report.uncertainty import shown
from foucault.units import display_unit, factor

if TYPE_CHECKING:
    from foucault.campaign.fleet.table import FleetTable

PER_ROW = 3
"""Histograms side by side [1]."""

REACH = 8.0
"""Values farther from the median than this are counted in the margin [robust sd]."""

MANY = 30
"""So many redundant readings leave the size of the residuals little scatter [1]."""

TITLES = {
    "bias": "Biases", "scale": "Scale factor errors", "misalignment": "Misalignments",
}  # fmt: skip
TRIADS = {"accel": "accelerometers", "gyro": "gyros"}


def families(table: FleetTable) -> list[Section]:
    """Return one section per family of coefficients: a histogram for each of them."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(table.names):
        groups.setdefault(name.rpartition(".")[0], []).append(k)
    out = []
    for family, members in groups.items():
        rows = [members[i : i + PER_ROW] for i in range(0, len(members), PER_ROW)]
        drawn = [f for f in (_row(table, row) for row in rows) if f is not None]
        if not drawn:
            continue
        triad, _, what = family.partition(".")
        title = f"{TITLES.get(what, what.replace('_', ' '))} of the {TRIADS.get(triad, triad)}"
        lead = "Solid: median of the fleet."
        if table.tolerance is not None:
            limit = table.tolerance.limits([table.names[k] for k in members])[0]
            lead += " Dashed: tolerance." if np.isfinite(limit).any() else " No tolerance."
        out.append(Section(title, lead, drawn))
    return out


def _row(table: FleetTable, members: list[int]) -> Figure | None:
    """Draw the histograms of up to three coefficients."""
    block = table.values[:, members]
    known = block[np.isfinite(block)]
    if not len(known):
        return None
    kind = LAYOUT.coefficients[LAYOUT.index(table.names[members[0]])].kind
    unit = display_unit(kind, float(np.quantile(np.abs(known), 0.9)))
    size = factor(unit, kind)
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    shapes: list[dict[str, Any]] = []
    notes: list[dict[str, Any]] = []
    for i, k in enumerate(members):
        x = block[:, i][np.isfinite(block[:, i])] / size
        if not len(x):
            continue
        limit = np.inf
        if table.tolerance is not None:
            limit = float(table.tolerance.limits([table.names[k]])[0][0]) / size
        ref = "" if i == 0 else str(i + 1)
        bars, low, high, outside = _bars(x, limit)
        data.append(bars | {"xaxis": f"x{ref}", "yaxis": f"y{ref}", "name": table.names[k]})
        middle = middle_and_spread(x)[0]
        shapes.append(_upright(middle, ref, "solid"))
        shapes += [_upright(s * limit, ref, "dash") for s in (-1, 1) if low < s * limit < high]
        place = [i * 0.345, i * 0.345 + 0.31]
        name = table.names[k].rpartition(".")[2]
        axes |= {
            f"xaxis{ref}": figures.axis(
                f"{name} [{shown(unit)}]", domain=place, range=[low, high], anchor=f"y{ref}",
                nticks=5, showgrid=False,
            ),
            f"yaxis{ref}": figures.axis(
                "instruments" if i == 0 else "", anchor=f"x{ref}", rangemode="tozero", nticks=4
            ),
        }  # fmt: skip
        if outside:
            notes.append(_note(f"{outside} beyond", place[1]))
    look = figures.layout(
        230, bargap=0.03, showlegend=False, shapes=shapes, annotations=notes, **axes,
        meta={"narrow": {k: {"showticklabels": False} for k in axes if k[:5] == "yaxis"}},
    )  # fmt: skip
    look["margin"] = look["margin"] | {"t": 22}
    names = ", ".join(table.names[k] for k in members)
    return Figure(data, look, alt=f"Histograms over the instruments of {names}")


def _bars(
    x: FloatArray, limit: float, least: float = 0.0
) -> tuple[dict[str, Any], float, float, int]:
    """Count values in bins; return bars, the range of the axis, and how many lie outside it.

    Values that lie closer together than `least` are one bar, wide enough to be seen.
    """
    middle, spread = middle_and_spread(x)
    spread = spread or float(np.ptp(x)) or abs(middle) or 1.0
    near = x[np.abs(x - middle) <= REACH * spread]
    low, high, n = float(near.min()), float(near.max()), len(near)
    wanted = 2.0 * spread / max(n, 1) ** (1 / 3)  # a little finer than the usual rule
    bins = int(np.clip(np.ceil((high - low) / wanted), 5, 60))
    if high - low <= least:
        half = least / 2 or 2 * spread
        low, high, bins = middle - half, middle + half, 5
    counts, edges = np.histogram(x, bins=bins, range=(low, high))
    width = edges[1] - edges[0]
    bars = {
        "type": "bar",
        "x": figures.numbers((edges[:-1] + edges[1:]) / 2),
        "y": counts.tolist(),
        "width": float(f"{width:.6g}"),
        "marker": {"color": figures.FIRST, "opacity": 0.75},
        "hovertemplate": "%{x:.4g}: %{y}<extra></extra>",
    }
    reach = 0.06 * (high - low)
    left, right = low - reach, high + reach
    # The limits are shown unless that would squeeze the histogram into a corner.
    if np.isfinite(limit) and 2 * limit < 6 * (high - low):
        left, right = min(left, -1.08 * limit), max(right, 1.08 * limit)
    return bars, left, right, len(x) - n


def _upright(x: float, ref: str, dash: str) -> dict[str, Any]:
    solid = dash == "solid"
    line = {"color": "var(--ink)" if solid else figures.BAD, "width": 1.6, "dash": dash}
    return {
        "type": "line", "xref": f"x{ref}", "x0": float(f"{x:.6g}"), "x1": float(f"{x:.6g}"),
        "yref": f"y{ref} domain", "y0": 0, "y1": 1, "line": line,
    }  # fmt: skip


def _note(text: str, right: float) -> dict[str, Any]:
    return {
        "text": text, "xref": "paper", "x": right, "xanchor": "right", "yref": "paper", "y": 1.0,
        "yanchor": "bottom", "showarrow": False, "font": {"color": figures.WARNING, "size": 12},
    }  # fmt: skip


def ratios(table: FleetTable) -> Section | None:
    """Return the section on residuals: their size over what the noise says."""
    ratio = table.ratio
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    shapes, notes = [], []
    for t, name in enumerate(("accelerometers", "gyros")):
        x = ratio[np.isfinite(ratio[:, t]), t]
        if not len(x):
            continue
        ref = "" if not data else "2"
        bars, low, high, outside = _bars(x, np.inf, least=0.1)
        low = min(low, 0.9)
        high = max(high, 1.1)
        place = [0.0, 0.46] if not data else [0.54, 1.0]
        data.append(bars | {"xaxis": f"x{ref}", "yaxis": f"y{ref}", "name": name})
        shapes.append(_upright(1.0, ref, "solid"))
        axes |= {
            f"xaxis{ref}": figures.axis(
                name, domain=place, range=[low, high], anchor=f"y{ref}",
                showgrid=False,
            ),
            f"yaxis{ref}": figures.axis("instruments" if not ref else "", anchor=f"x{ref}"),
        }  # fmt: skip
        if outside:
            notes.append(_note(f"{outside} beyond", place[1]))
    if not data:
        return None
    look = figures.layout(
        250, bargap=0.03, showlegend=False, shapes=shapes, annotations=notes, **axes
    )
    look["margin"] = look["margin"] | {"t": 22}
    d = table.redundancy[np.isfinite(table.redundancy).all(axis=1)]
    lead = "What the model leaves over what the noise explains; it scatters about 1 (solid)."
    if len(d) and float(np.median(d)) < MANY:
        lead += (
            f" With {np.median(d[:, 0]):.0f} redundant readings of the accelerometers and "
            f"{np.median(d[:, 1]):.0f} of the gyros the scatter itself is large."
        )
    alt = "Histograms over the instruments of the size of the residuals over the noise"
    return Section("Residuals", lead, [Figure(data, look, alt=alt)])
