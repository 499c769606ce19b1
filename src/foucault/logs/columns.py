"""From the words of a description to column numbers of a file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from foucault.errors import error, suggestion
from foucault.logs.raw import RawTable
from foucault.tables import AXES

if TYPE_CHECKING:
    from foucault.logs.layout import ColumnName

TIME_NAMES = ("time", "t", "timestamp", "time_s", "seconds", "sec")
TEMPERATURE_NAMES = ("temperature", "temp")
TRIAD_PREFIXES = {
    "gyro": ("gyro", "gyr", "g", "w", "omega", "angular_velocity"),
    "accel": ("accel", "acc", "a", "f", "linear_acceleration"),
}
"""Usual beginnings of column names; ``gx``, ``gyr_x``, ``gyro.x`` and ``Gyro X`` all count."""

SINGLE_NAMES = {
    "gyro": ("rate", "angularrate", "rotationrate"),
    "accel": ("acceleration", "specificforce"),
}
"""Usual names of the only column of a triad, without spaces."""


def find(
    raw: RawTable, wanted: ColumnName, path: Path, block: str, table: str = "log"
) -> tuple[int, float]:
    """Find one column.

    `wanted`: name, or number from 0, text may start with "-"; `block`: block of the campaign that
    names the column, for the error text; `table`: table of the campaign that the block is in, for
    the error text. Returns `number`: number of the column; `sign`: -1.0 where the sign is to be
    turned, else 1.0.
    """
    if isinstance(wanted, str) and wanted in raw.names:
        return raw.names.index(wanted), 1.0
    text = _spaced(str(wanted))
    if isinstance(wanted, str) and raw.named:
        # Spaces at the ends are not seen; and `t` names "t (s)" too. Where only one is called so.
        for known in (_spaced, _bare):
            alike = [i for i, name in enumerate(raw.names) if known(name) == text]
            if len(alike) == 1:
                return alike[0], 1.0
            if alike:
                break
    if isinstance(wanted, str) and text.startswith("-"):
        number, _ = find(raw, text[1:], path, block, table)
        return number, -1.0
    if text.isdecimal() and len(text) < 9 and int(text) < len(raw.names):
        return int(text), 1.0
    if raw.named:
        hint = suggestion(text, raw.names)
        allowed = "The columns are " + ", ".join(raw.names) + "."
    else:
        hint = ""
        count = len(raw.names)
        allowed = f"The file has no names; its {count} columns are numbered 0 to {count - 1}."
    words = {"hint": hint, "allowed": allowed, "table": table, "block": block}
    raise error("log.unknown_column", file=path.name, name=text, **words)


def guess(raw: RawTable, block: str, path: Path) -> list[int]:
    """Find the columns of a block by the names people usually give them.

    Returns column numbers: one, or three for a triad.
    """
    plain = [_plain(name) for name in raw.names] if raw.named else []
    singles = {"time": TIME_NAMES, "temperature": TEMPERATURE_NAMES}.get(block)
    groups: list[Sequence[str]]
    if singles is not None:
        groups = [[name] for name in singles]
    else:
        groups = [[p + axis for axis in AXES] for p in TRIAD_PREFIXES[block]]
    for group in groups:
        names = [re.sub(r"[^a-z0-9]", "", name) for name in group]
        if set(names) <= set(plain):
            return [plain.index(name) for name in names]
    example = "columns = [1, 2, 3]" if singles is None else "column = 0"
    have = f"columns {', '.join(raw.names)}" if raw.named else f"{len(raw.names)} unnamed columns"
    raise error("log.cannot_guess", file=path.name, block=block, have=have, example=example)


def guess_some(raw: RawTable, block: str) -> list[int | None]:
    """Find the columns of a triad that lacks some, by the names people usually give them.

    Returns column numbers of x, y, z; a single column without an axis in its name is x; empty
    where there is none.
    """
    plain = [_plain(name) for name in raw.names] if raw.named else []
    known = [re.sub(r"[^a-z0-9]", "", p) for p in TRIAD_PREFIXES[block]]
    for prefix in known:
        found = [plain.index(prefix + a) if prefix + a in plain else None for a in AXES]
        if found != [None] * 3:
            return found
    alone = [i for i, name in enumerate(plain) if name in (*known, *SINGLE_NAMES[block])]
    return [alone[0], None, None] if len(alone) == 1 else []


def titled_axis(title: str) -> int:
    """Return the number of the axis that a title names, as "gyro_z (deg/s)" does; else 0, for x."""
    word = _plain(title)
    named = [p for known in TRIAD_PREFIXES.values() for p in known]
    prefixes = {re.sub(r"[^a-z0-9]", "", p) for p in named} | {""}
    ends = bool(re.search(r"[_. -][xyzXYZ]$", re.sub(r"\s*[(\[].*", "", title.strip())))
    return AXES.index(word[-1]) if word[-1:] in AXES and (ends or word[:-1] in prefixes) else 0


def _bare(name: str) -> str:
    """Return a column's `name` without a unit in brackets."""
    return re.sub(r"\s*[(\[][^)\]]*[)\]]\s*$", "", _spaced(name))


def _spaced(name: str) -> str:
    """Return a title without spaces at its ends, and one of each within."""
    return " ".join(name.split())


def _plain(name: str) -> str:
    # "Gyro_X (deg/s)" and "gyro x [deg/s]" both mean gyrox
    return re.sub(r"[^a-z0-9]", "", re.sub(r"[(\[].*", "", name).lower())
