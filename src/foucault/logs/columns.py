"""A log of a few columns and one unit, described by no more than these."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from foucault.errors import FoucaultError, error
from foucault.logs.description import LogDescription, guess, unit_in
from foucault.logs.layout import scaled_unit
from foucault.logs.raw import open_raw

KINDS = {
    "gyro": ("angular rate", "angle"),
    "accel": ("specific force", "velocity"),
}
"""What a triad reads, as a rate and as an increment."""


def columns_alone(path: Path, columns: Sequence[str], unit: str, rate: str = "") -> LogDescription:
    """Describe up to three columns of a file.

    `columns`: titles or numbers from 0, of one to three columns, which become x, y and z; `unit`:
    says what they are: readings or increments of gyros or accelerometers; `rate`: such as "100 Hz",
    empty where a time column with a usual title says it.
    """
    if len(columns) > 3:
        raise error("allan.columns", count=len(columns))
    block: dict[str, Any] = _what(unit)
    block[next(iter(block))] |= {"columns": (*columns, "", "")[:3], "unit": unit}
    said = {"file": path.name, **block}
    if rate:
        return LogDescription.model_validate(said | {"rate": rate})
    raw = open_raw(path, LogDescription.model_validate({"file": path.name}))
    try:
        number = guess(raw, "time", path)[0]
    except FoucaultError:
        raise error("allan.no_rate", file=path.name) from None
    title = raw.names[number]
    of_time = "iso" if number in raw.stamps else unit_in(title, {})
    if of_time is None:
        raise error("allan.no_rate", file=path.name)
    return LogDescription.model_validate(said | {"time": {"column": number, "unit": of_time}})


def _what(unit: str) -> dict[str, dict[str, Any]]:
    """Return the triad that a unit belongs to, as a block without its columns."""
    for name, kinds in KINDS.items():
        for kind, how in zip(kinds, ("rate", "increment"), strict=True):
            try:
                scaled_unit(unit, kind)
            except FoucaultError:
                continue
            return {name: {"kind": how}}
    raise error("allan.unit", given=unit)
