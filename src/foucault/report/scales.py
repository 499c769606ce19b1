"""Axes of a still drawing: what they span, where a value lies on them, and their ticks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray

PAD = 0.05  # Room beyond the data on each side, of their range [1].
MONTHS = 1e7  # Dates that span more are written as months [s].

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass
class Axis:
    """An axis: `span` is what it shows, in powers of ten if `log`, in numbers of names."""

    letter: str
    look: Mapping[str, Any]
    span: tuple[float, float]
    names: list[str] | None = None  # of the categories; None for numbers
    log: bool = False
    dates: bool = False
    pixels: tuple[float, float] = (0.0, 1.0)

    @property
    def title(self) -> str:
        """What stands along it."""
        title = self.look.get("title", "")
        return str(title if isinstance(title, str) else title.get("text", ""))

    @property
    def hidden(self) -> bool:
        """Whether only what lies on it is drawn."""
        return self.look.get("visible") is False

    @property
    def domain(self) -> tuple[float, float]:
        """The part of the drawing it takes [1]."""
        first, last = self.look.get("domain", (0.0, 1.0))
        return first, last

    @property
    def anchor(self) -> str:
        """Name of the axis at whose start it stands."""
        return str(self.look.get("anchor", "y" if self.letter == "x" else "x"))

    def domain_of_other(self, axes: Mapping[str, Axis]) -> tuple[float, float]:
        """Return the part that the axis takes at whose start it stands."""
        return axes[self.anchor].domain if self.anchor in axes else (0.0, 1.0)

    def numbers(self, values: Sequence[Any]) -> FloatArray:
        """Return values as numbers on this axis, NaN for what is not known."""
        if self.names is not None:
            place = {name: float(k) for k, name in enumerate(self.names)}
            return np.array([place.get(str(v), v if _real(v) else np.nan) for v in values], float)
        if self.dates:
            days = np.array([str(v) for v in values], "datetime64[s]")
            return days.astype(np.int64).astype(float)
        return np.array(values, float)

    def at(self, values: Sequence[Any]) -> FloatArray:
        """Return the pixels of values."""
        return self.of(self.numbers(values))

    def of(self, numbers: Any) -> FloatArray:
        """Return the pixels of numbers."""
        x = np.asarray(numbers, float)
        if self.log:
            x = np.log10(np.where(x > 0, x, np.nan))
        a, b = self.span
        return np.asarray(self.pixels[0] + (x - a) / (b - a) * (self.pixels[1] - self.pixels[0]))


def _real(value: Any) -> bool:
    return isinstance(value, int | float)


def axis_of(
    name: str, look: Mapping[str, Any], data: Sequence[Any], layout: Mapping[str, Any]
) -> Axis:
    """Return the axis that traces call `name`, wide enough for all that lies on it."""
    letter = name[0]
    mine = [t for t in data if t.get(f"{letter}axis", letter) == name]
    values = [v for t in mine for v in _values(t, letter)]
    kind = look.get("type") or _kind(values)
    axis = Axis(letter, look, (0.0, 1.0), log=kind == "log", dates=kind == "date")
    if kind == "category":
        found = dict.fromkeys(str(v) for v in values if v is not None)
        axis.names = list(look.get("categoryarray") or found)
    given = look.get("range")
    if given is not None:
        first, last = axis.numbers(given) if axis.dates else given
        axis.span = (float(first), float(last))
    elif axis.names is not None:
        axis.span = (-0.5, len(axis.names) - 0.5)
    else:
        axis.span = _reach(axis, mine, values, layout)
    if look.get("autorange") == "reversed":
        axis.span = axis.span[::-1]
    return axis


def _kind(values: Sequence[Any]) -> str:
    return "category" if any(isinstance(v, str) for v in values) else "linear"


def _values(trace: Mapping[str, Any], letter: str) -> list[Any]:
    """What a trace has on an axis, its bars and the ends of its whiskers among it."""
    if trace["type"] == "histogram":
        edges, size = bins(trace)
        return list(edges if letter == "x" else [0.0, *size])
    values = list(trace.get(letter, ()))
    if letter == "y" and "error_y" in trace:
        rows = [
            (v, e)
            for v, e in zip(values, trace["error_y"]["array"], strict=True)
            if v is not None and e is not None
        ]
        values += [v + s * e for v, e in rows for s in (-1, 1)]
    if trace["type"] == "bar" and (letter == "x") == (trace.get("orientation") == "h"):
        values.append(0.0)
    return values


def bins(trace: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Return the edges and the density of a histogram."""
    how = trace["xbins"]
    n = max(round((how["end"] - how["start"]) / how["size"]), 1)
    edges = how["start"] + how["size"] * np.arange(n + 1)
    values = np.array([v for v in trace["x"] if v is not None], float)
    count, _ = np.histogram(values, edges)
    return edges, count / max(values.size, 1) / how["size"]


def _reach(
    axis: Axis, traces: Sequence[Any], values: Sequence[Any], layout: Mapping[str, Any]
) -> tuple[float, float]:
    """Return what the data span, and some room beyond."""
    x = axis.numbers([v for v in values if v is not None])
    if axis.log:
        x = np.log10(x[x > 0])
    elif layout.get("barmode") == "stack" and axis.letter == "y":
        sums: dict[Any, float] = {}
        for t in (t for t in traces if t["type"] == "bar"):
            for at, size in zip(t["x"], t["y"], strict=True):
                sums[at] = sums.get(at, 0.0) + (size or 0.0)
        x = np.append(x, list(sums.values()))
    x = x[np.isfinite(x)]
    if not x.size:
        return 0.0, 1.0
    low, high = float(x.min()), float(x.max())
    pad = PAD * (high - low) or 0.5 * abs(high) or 1.0
    marked = axis.letter == "y" or any("markers" in t.get("mode", "") for t in traces)
    bars = any(t["type"] == "bar" for t in traces)
    low, high = (low - pad, high + pad) if marked or bars or low == high else (low, high)
    if bars and axis.letter == "y" and x.min() >= 0:
        low = 0.0
    if axis.look.get("rangemode") == "tozero":
        low, high = min(low, 0.0), max(high, 0.0)
        low = 0.0 if x.min() >= 0 else low
    return low, high


# -- ticks ------------------------------------------------------------------------------------


def ticks(axis: Axis) -> list[tuple[Any, str]]:
    """Return the values that an axis marks, each with how it is written."""
    look = axis.look
    low, high = sorted(axis.span)
    if "tickvals" in look:
        texts = look.get("ticktext") or [written(v) for v in look["tickvals"]]
        some = list(zip(look["tickvals"], texts, strict=True))
        inside = (axis.log or low - 1e-9 <= axis.numbers([v])[0] <= high + 1e-9 for v, _ in some)
        return [t for t, shown in zip(some, inside, strict=True) if shown]
    if axis.names is not None:
        some = [(n, n) for k, n in enumerate(axis.names) if low <= k <= high]
        step = 1 if look.get("tickmode") == "linear" else -(-len(some) // 40)
        return some[:: max(step, 1)]
    if axis.dates:
        unit = "datetime64[M]" if high - low > MONTHS else "datetime64[D]"
        seconds = np.linspace(low, high, 5)[1:-1]
        days = [str(np.datetime64(int(s), "s").astype(unit)) for s in seconds]
        return [(d, d) for d in dict.fromkeys(days)]
    if axis.log:
        powers = range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1)
        if len(powers) >= 2:
            every = -(-len(powers) // 9)
            return [(10.0**p, _power(p)) for p in powers if p % every == 0]
        values = _steps(10**low, 10**high, 5)
    elif "dtick" in look:
        step, start = look["dtick"], look.get("tick0", 0)
        first = start + step * math.ceil((low - start) / step - 1e-9)
        values = [first + step * k for k in range(int((high - first) / step + 1e-9) + 1)]
    else:
        values = _steps(low, high, look.get("nticks", 7))
    return [(v, written(v)) for v in values]


def _steps(low: float, high: float, most: int) -> list[float]:
    """Return round values between two, at most so many."""
    raw = (high - low) / max(most, 1)
    if not raw > 0:
        return [low]
    ten = 10 ** math.floor(math.log10(raw))
    step = next(s * ten for s in (1, 2, 5, 10) if s * ten >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 12 - math.floor(math.log10(step)))
            for k in range(first, math.floor(high / step + 1e-9) + 1)]  # fmt: skip


def written(value: Any) -> str:
    """Write a number of an axis."""
    if not _real(value):
        return str(value)
    size = abs(value)
    if size and (size >= 1e6 or size < 1e-4):
        power = math.floor(math.log10(size) + 1e-9)
        return f"{value / 10**power:.4g}×{_power(power)}".replace("-", "−")
    return f"{value:.6g}".replace("-", "−")


def _power(power: int) -> str:
    """Write a power of ten."""
    if 0 <= power < 4:
        return f"{10**power:d}"
    if -3 <= power < 0:
        return f"{10.0**power:g}"
    return "10" + str(power).translate(_RAISED)
