"""What a log says about the table that the instrument stands on, and rows that are means."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, error
from foucault.logs.checks import GAP
from foucault.logs.own import ANGLES
from foucault.tables import Log, TableColumns


def whole_numbers(position: FloatArray, path: Path) -> FloatArray:
    """Refuse positions that are no whole numbers; an empty cell is -1.

    `position` (n,): numbers as in the file [1].
    """
    position = np.where(np.isnan(position), -1.0, position)
    wrong = position != np.rint(position)
    if wrong.any():
        raise error("log.position_number", file=path.name, value=f"{position[wrong][0]:g}")
    return np.maximum(position, -1.0)


def table_of(data: dict[str, FloatArray]) -> TableColumns | None:
    """Return what the blocks of a log say about the table, None where nothing.

    `data`: blocks by name, each shape (n,) [SI].
    """
    if not data.keys() & {*ANGLES, "table_rate", "position"}:
        return None
    none = np.full(len(data["time"]), np.nan)
    position = data.get("position")
    return TableColumns(
        np.column_stack([data.get(name, none) for name in ANGLES]),
        data.get("table_rate"),
        None if position is None else position.astype(np.int64),
    )


def angles_at_times(data: dict[str, FloatArray], apart: float) -> dict[str, FloatArray]:
    """Return the table angles at the times of their rows, from another instant of the interval.

    Between two rows an angle moves on evenly, by less than half a turn or, where the rate of the
    table is logged, by nearly what that says. Beside a gap it goes on as before.

    `data`: time and angles by name, each shape (n,) [SI]; `apart`: how many intervals the time of
    a row is after the instant of its angles [1].
    """
    time, turn = data["time"], 2 * np.pi
    step = np.diff(time)
    whole = step <= GAP * np.median(step) if len(step) else step > 0
    out = {}
    for name in data.keys() & {*ANGLES}:
        moved = np.diff(data[name])
        told = np.zeros_like(moved)
        if name == "outer" and "table_rate" in data:
            told = 0.5 * (data["table_rate"][1:] + data["table_rate"][:-1]) * step
        moved -= turn * np.round((moved - told) / turn)
        moved[~whole] = np.nan
        after, before = np.append(moved, np.nan), np.append(np.nan, moved)
        near, other = (after, before) if apart > 0 else (before, after)
        move = np.where(np.isnan(near), other, near)
        out[name] = data[name] + apart * np.nan_to_num(move)
    return out


def joined_tables(tables: list[TableColumns]) -> TableColumns:
    """Put what logs say about the table one after the other; they tell the same columns."""

    def one(name: str) -> Any:
        parts = [getattr(table, name) for table in tables]
        return None if parts[0] is None else np.concatenate(parts)

    return TableColumns(one("angles"), one("rate"), one("position"))


def means_log(
    data: dict[str, FloatArray],
    kind: str,
    findings: tuple[Finding, ...],
    source: dict[str, Any],
) -> Log:
    """Make a log of rows that are means: nothing is known of what happened between them.

    `data`: blocks by name, each shape (n,) or (n, 3) [SI]; `kind`: means, or sums over the time
    of each row.
    """
    length = data["averaged"]
    wrong = np.flatnonzero(~(length > 0))
    if len(wrong):
        row = int(wrong[0])
        raise error("log.averaged", file=source.get("file", "the log"), row=row,
                    value=f"{length[row]:g}")  # fmt: skip
    if kind == "increment":
        for name in ("gyro", "accel"):
            if name in data:
                data[name] = data[name] / length[:, None]
    return Log(data["time"], data.get("gyro"), data.get("accel"), "rate", data.get("temperature"),
              findings, source, table_of(data), length)  # fmt: skip
