"""What the titles of the columns of a file say: which axis, and in which unit.

``gyro_x (deg/s)``, ``acc_x [g]``, ``time_ms``. A triad in a unit of increments, such as ``gyro_x
(rad)`` and ``accel_x (m/s)``, holds increments, if all triads do. Used only for a log that nobody
described; what a campaign declares is never overruled.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foucault.errors import Finding, FoucaultError, error, finding
from foucault.logs import columns
from foucault.logs.layout import scaled_unit
from foucault.logs.raw import RawTable, open_raw

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

_BRACKETS = re.compile(r"[^(\[]+[(\[]\s*([^)\]]+?)\s*[)\]]")
_ENDINGS = {
    "time": {"s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns"},
    "gyro": {"dps": "deg/s", "deg_s": "deg/s", "rad_s": "rad/s"},
    "accel": {"g": "g", "mg": "mg", "m_s2": "m/s^2", "ms2": "m/s^2", "mps2": "m/s^2"},
    "temperature": {"c": "degC", "degc": "degC", "k": "K"},
}
"""How names end that carry their unit without brackets: ``time_ms``, ``gyro_x_dps``."""

_RATES = {"gyro": "angular rate", "accel": "specific force"}
_INCREMENTS = {"gyro": "angle increment", "accel": "velocity increment"}
"""What triads measure, and those whose rows are integrals over the interval before."""


def description_of(path: Path) -> tuple[LogDescription, tuple[Finding, ...]]:
    """Describe a log by the titles of its columns, or not at all where it describes itself."""
    from foucault.logs.description import LogDescription

    alone = LogDescription.model_validate({"file": path.name})
    raw = open_raw(path, alone)
    if raw.declared is not None:
        return alone, ()
    have = "the columns " + ", ".join(raw.names) if raw.named else f"{len(raw.names)} columns"
    words = {"file": path.name, "have": have}
    try:
        said = _blocks(raw, path)
        described = LogDescription.model_validate({"file": path.name, **said})
    except FoucaultError as problem:  # a unit that is not known, or counts without a scale
        raise error("log.bare", reason=problem.message.rstrip("."), **words) from None
    except ValueError as problem:
        raise error("log.bare", reason=problem, **words) from None
    units = ", ".join(
        f"{name} in {about['unit']}" + " (increments)" * ("kind" in about)
        for name, about in said.items()
    )
    return described, (finding("log.units_from_titles", file=path.name, units=units),)


def _blocks(raw: RawTable, path: Path) -> dict[str, dict[str, Any]]:
    if not raw.named:
        raise ValueError("the file has no titles")
    found: dict[str, dict[str, Any]] = {}
    for block, endings in _ENDINGS.items():
        bare = tuple(_without(name, endings) for name in raw.names)
        try:
            numbers = columns.guess(RawTable(bare, True, raw.blocks), block, path)
        except FoucaultError:
            continue
        names = [raw.names[n] for n in numbers]
        if block == "time" and numbers[0] in raw.stamps:
            given: set[str | None] = {"iso"}
        else:
            given = {unit_in(name, endings) for name in names}
        if None in given or len(given) != 1:
            raise ValueError(f"the titles of {block} do not give one unit: {', '.join(names)}")
        key = {"column": numbers[0]} if len(numbers) == 1 else {"columns": numbers}
        found[block] = {**key, "unit": given.pop()}
    if not found.keys() & {"gyro", "accel"}:
        found |= _some_axes(raw)
    if "time" not in found:
        raise ValueError("no column has a usual name of time")
    if not found.keys() & {"gyro", "accel"}:
        raise ValueError(
            "no three columns have usual names of gyro or accelerometer, nor has one with a unit"
        )
    triads = {name: said for name, said in found.items() if name in _INCREMENTS}
    if all(_measures(said["unit"], _INCREMENTS[name]) for name, said in triads.items()):
        for said in triads.values():
            said["kind"] = "increment"
    return found


def _some_axes(raw: RawTable) -> dict[str, dict[str, Any]]:
    """Describe triads that lack columns, such as a single gyro, where the titles give the unit."""
    found: dict[str, dict[str, Any]] = {}
    for block, kind in _RATES.items():
        bare = tuple(_without(name, _ENDINGS[block]) for name in raw.names)
        numbers = columns.guess_some(RawTable(bare, True, raw.blocks), block)
        units = {unit_in(raw.names[n], _ENDINGS[block]) for n in numbers if n is not None}
        unit = units.pop() if len(units) == 1 else None
        if unit is not None and (_measures(unit, kind) or _measures(unit, _INCREMENTS[block])):
            found[block] = {"columns": numbers, "unit": unit}
    return found


def _measures(unit: str, kind: str) -> bool:
    try:
        scaled_unit(unit, kind)
    except FoucaultError:
        return False
    return True


def unit_in(title: str, endings: dict[str, str]) -> str | None:
    """Return the unit in a column's `title`, None where it has none.

    `endings`: how names may end that carry their unit, and that unit.
    """
    inside = _BRACKETS.fullmatch(title.strip())
    if inside:
        return re.sub(r"(?<=s)2$", "^2", inside[1])
    low = title.strip().lower()
    return next((unit for end, unit in endings.items() if low.endswith(f"_{end}")), None)


def _without(title: str, endings: dict[str, str]) -> str:
    """Return a column's `title` without an ending that is its unit."""
    low = title.strip().lower()
    end = next((end for end in endings if low.endswith(f"_{end}")), None)
    return title.strip() if end is None else title.strip()[: -len(end) - 1]
