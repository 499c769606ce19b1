"""Read what a master INS said from a file of any format, and write it as one.

Whatever a file holds - north, east, down; a heading that counts the other way; degrees, wrapped at
180 or at 360 - becomes East-North-Up and an attitude matrix. What cannot be is refused, what looks
wrong is told (`logs.master_checks`).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.files import atomic
from foucault.logs import columns, master_checks, reference
from foucault.logs.layout import TimeColumn, scaled_unit
from foucault.logs.master_description import MasterDescription
from foucault.logs.raw import RawTable, kept, open_raw
from foucault.models.attitude import matrix_of
from foucault.models.master import MasterTable
from foucault.models.rotation import turned

Data = dict[str, FloatArray]

_VELOCITY = {
    "ENU": ("velocity_east", "velocity_north", "velocity_up"),
    "NED": ("velocity_north", "velocity_east", "velocity_down"),
}
_PLACE = ("latitude", "longitude", "height")
_ANGLES = ("heading", "pitch", "roll")
_ROUNDING = 1e-6  # of angles at the end of their range [rad]


def read(description: MasterDescription, folder: str | Path = ".") -> MasterTable:
    """Read the table of a master.

    `folder`: folder that a relative file name starts from. Raises ``master.*``, ``log.*``,
    ``reference.*``: what is missing, or cannot be.
    """
    assert description.file is not None
    path = Path(folder) / description.file
    return master_table(open_raw(path, description), description, path)


def master_table(raw: RawTable, description: MasterDescription, path: Path) -> MasterTable:
    """Return the messages of a file in order, each once, East-North-Up and in SI."""
    data = _columns(raw, description, path)
    missing = [n for n in ("time", *_VELOCITY["ENU"], *_ANGLES) if n not in data]
    if missing:
        names = ", ".join(name.replace("_", " ") for name in missing)
        raise error("master.columns", file=path.name, what=f"it has no {names}")
    _possible(data, description, path)
    heading = data["heading"]
    if description.attitude.sense == "counter-clockwise":
        heading = -heading
    place = {"latitude", "longitude"} <= data.keys() and {n: data.get(n) for n in _PLACE}
    table = MasterTable(
        data["time"],
        np.column_stack([data[name] for name in _VELOCITY["ENU"]]),
        matrix_of(heading, data["pitch"], data["roll"]),
        data.get("arrival"),
        findings=raw.findings,
        **(place or {}),
    ).cleaned(description.missing, path.name)
    return master_checks.checked(table, description, path.name)


def _columns(raw: RawTable, used: MasterDescription, path: Path) -> Data:
    """Read what is described, and by titles what is not, in SI; down turned up."""
    picks = dict(_described(raw, used, path))
    needed = {"time", *_VELOCITY["ENU"], *_ANGLES} - {"time" if used.rate else ""}
    known = picks.keys() | ({"velocity_up"} if "velocity_down" in picks else set())
    if raw.named and needed - known:
        picks = reference.titled_columns(raw, path) | picks
    numbers = [number for number, _ in picks.values()]
    pieces = list(kept(raw, path).blocks(numbers))
    rows = np.concatenate(pieces) if pieces else np.empty((0, len(numbers)))
    if not len(rows):
        raise error("log.empty", file=path.name)
    data = dict(zip(picks, (rows * [size for _, size in picks.values()]).T, strict=True))
    if "velocity_down" in data:
        data.setdefault("velocity_up", -data["velocity_down"])
    if used.rate is not None:
        data["time"] = np.arange(len(rows)) / used.rate
    return data


def _described(
    raw: RawTable, used: MasterDescription, path: Path
) -> Iterator[tuple[str, tuple[int, float]]]:
    """Yield name, number of the column and the SI value of one."""
    for name in ("time", "arrival"):
        block: TimeColumn | None = getattr(used, name)
        if block is not None:
            yield name, _time(raw, block, name, path)
    wanted: list[tuple[tuple[str, ...], tuple[int | str, ...] | None, list[float], str]] = []
    if used.position is not None:
        angle = scaled_unit(used.position.unit, "angle")
        sizes = [angle, angle, scaled_unit(used.position.height_unit, "length")]
        wanted.append((_PLACE, used.position.columns, sizes, "position"))
    if used.velocity.unit is not None:
        sizes = [scaled_unit(used.velocity.unit, "velocity")] * 3
        wanted.append((_VELOCITY[used.velocity.frame], used.velocity.columns, sizes, "velocity"))
    if used.attitude.unit is not None:
        sizes = [scaled_unit(used.attitude.unit, "angle")] * 3
        wanted.append((_ANGLES, used.attitude.columns, sizes, "attitude"))
    for names, some, sizes, what in wanted:
        for name, column, size in zip(names, some or (), sizes, strict=False):
            number, sign = columns.find(raw, column, path, what, "master")
            yield name, (number, sign * size)


def _time(raw: RawTable, block: TimeColumn, name: str, path: Path) -> tuple[int, float]:
    if block.column is None:
        if name != "time":
            raise error("master.columns", file=path.name, what=f"{name} has no `column`")
        return columns.guess(raw, name, path)[0], block.one()
    number, sign = columns.find(raw, block.column, path, name, "master")
    if block.iso != (number in raw.stamps):
        code = "log.time_not_iso" if block.iso else "log.time_iso"
        raise error(code, file=path.name, column=raw.names[number], unit=block.unit)
    return number, sign * block.one()


def _possible(data: Data, used: MasterDescription, path: Path) -> None:
    """Refuse angles outside of their range: a wrong unit, or columns in another order."""
    unit = used.attitude.unit or "in the titles"
    limits = {"heading": 2 * np.pi, "pitch": np.pi / 2, "roll": np.pi}
    for name, limit in limits.items():
        worst = float(np.nanmax(np.abs(data[name]), initial=0.0))
        if worst > limit + _ROUNDING:
            raise error("master.angles", file=path.name, angle=name, unit=unit,
                        given=f"{np.degrees(worst):.6g}")  # fmt: skip
    if "latitude" in data:
        worst = float(np.nanmax(np.abs(data["latitude"]), initial=0.0))
        if worst > np.pi / 2:
            raise error("reference.latitude", file=path.name, given=f"{np.degrees(worst):.6g}")


def write(table: MasterTable, path: str | Path, *, wrap: Literal[180, 360] = 360) -> None:
    """Write a table as CSV whose titles say what it holds, readable as master and as reference.

    `path`: the file, replaced whole or not at all; `wrap`: headings from 0 to 360 deg, or from
    -180 to 180 deg.
    """
    angles = table.angles.copy()
    if wrap == 180:
        angles[:, 0] = turned(angles[:, 0])
    made: dict[str, tuple[FloatArray | None, int]] = {
        "time (s)": (table.time, 6),
        "arrival (s)": (table.arrival, 6),
        **{f"{n} (deg)": (np.degrees(angles[:, i]), 7) for i, n in enumerate(_ANGLES)},
        **{f"velocity {n} (m/s)": (table.velocity_n[:, i], 6)
           for i, n in enumerate(("east", "north", "up"))},
        "latitude (deg)": (None if table.latitude is None else np.degrees(table.latitude), 10),
        "longitude (deg)": (None if table.longitude is None else np.degrees(table.longitude), 10),
        "height (m)": (table.height, 4),
    }  # fmt: skip
    some = {title: (v, digits) for title, (v, digits) in made.items() if v is not None}
    with atomic(Path(path)) as part:
        np.savetxt(
            part, np.column_stack([v for v, _ in some.values()]), delimiter=",", comments="",
            header=",".join(some), fmt=[f"%.{digits}f" for _, digits in some.values()],
        )  # fmt: skip
