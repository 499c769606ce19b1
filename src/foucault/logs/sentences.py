"""Logs of receivers that write one sentence a line, with a checksum, among sentences of others.

NovAtel ``RAWIMU``, ``RAWIMUS``, ``RAWIMUX``, ``RAWIMUSX`` in ASCII: increments over each interval
in counts, z, minus y, x, of the axes marked on the IMU, x right, y forward, z up. What one count
is depends on the IMU, so the units are asked for.

VectorNav ``$VNIMU``: rad/s, m/s^2 (-1 g along down at rest) and degC, not compensated, axes
forward-right-down. It has no time, so the rate is asked for.

References
----------
.. [1] NovAtel, OEM7 Commands and Logs Reference Manual, "RAWIMUX", "32-bit CRC".
.. [2] VectorNav, VN-100 User Manual, "IMU Measurements" (register 54), "Checksum / CRC".
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, finding
from foucault.logs.encoding import lines, open_text, position
from foucault.logs.raw import Progress, RawTable

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

_ROWS = 1 << 14
_WEEK = 7 * 86400.0


@dataclass(frozen=True)
class _Format:
    """How the sentences of one maker are read.

    `tag` matches the name at the start of a line; `sum` gives the checksum of what stands between
    the first letter and the star, `blank` that of a sentence sent without one; `row` makes the
    numbers of one line of its fields.
    """

    tag: re.Pattern[bytes]
    sum: Callable[[bytes], int]
    blank: bytes
    names: tuple[str, ...]
    row: Callable[[list[bytes]], list[float]]
    declared: dict[str, Any]
    sampled: Literal["rate", "increment"]
    words: dict[str, str]


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a log of sentences; lines of other sentences are passed over."""
    with open_text(path) as stream:
        found = next(
            ((n, f) for line in lines(stream) for n, f in _FORMATS.items() if f.tag.match(line)),
            None,
        )
    if found is None:
        raise error("log.no_topic", file=path.name, what="no sentence RAWIMU or $VNIMU",
                    have="other lines; of CORRIMUDATA gravity and errors are taken off, so that no "
                    "sensor can be calibrated from it")  # fmt: skip
    form = found[1]

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        size, rows = max(1, path.stat().st_size), list[list[float]]()
        dated = _Weeks(form.names)
        with open_text(path) as stream:
            for number, line in enumerate(lines(stream), start=1):
                if not form.tag.match(line):
                    continue
                rows.append(_numbers(form, line, number, description, path.name))
                if len(rows) == _ROWS:
                    if progress:
                        progress(min(1.0, position(stream) / size))
                    yield dated.counted(np.array(rows))[:, list(columns)]
                    rows = []
        if progress:
            progress(1.0)
        if rows:
            yield dated.counted(np.array(rows))[:, list(columns)]

    told = finding("log.declared", file=path.name, **form.words)
    return RawTable(form.names, True, blocks, findings=(told,), declared=form.declared,
                    sampled=form.sampled)  # fmt: skip


class _Weeks:
    """Counts time on from the first week seen; since 1980 it would lose its last digits."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._at = names.index("week") if "week" in names else None
        self._first = np.nan

    def counted(self, rows: FloatArray) -> FloatArray:
        if self._at is not None:
            weeks, time = rows[:, self._at], rows[:, self._at + 1]
            if np.isnan(self._first) and np.isfinite(weeks).any():
                self._first = float(weeks[np.isfinite(weeks)][0])
            time += (weeks - self._first) * _WEEK
        return rows


def _numbers(
    form: _Format, line: bytes, number: int, description: FileLayout, file: str
) -> list[float]:
    """Return the numbers of a sentence; NaN where it is damaged and may be left out."""
    said, star, tail = line[1:].rstrip().partition(b"*")
    try:
        if not star or (tail.upper() != form.blank and int(tail, 16) != form.sum(said)):
            raise ValueError("its checksum is wrong" if star else "it is cut off")
        row = form.row(said.replace(b";", b",").split(b","))
        if len(row) != len(form.names):
            raise ValueError(f"it has {len(row)} numbers instead of {len(form.names)}")
    except (ValueError, IndexError) as problem:
        if description.missing == "drop":
            return [float("nan")] * len(form.names)
        raise error("log.sentence", file=file, line=number, reason=problem) from None
    return row


def _novatel_sum(said: bytes) -> int:
    return zlib.crc32(said, 0xFFFFFFFF) ^ 0xFFFFFFFF  # begins with 0 and is not inverted


def _vectornav_sum(said: bytes) -> int:
    return reduce(xor, said, 0)


def _novatel_row(fields: list[bytes]) -> list[float]:
    # The last nine fields are alike in all four: week, seconds, status, then the six counts.
    week, seconds, _status, *counts = fields[-9:]
    z, y, x, wz, wy, wx = (float(int(count)) for count in counts)
    return [int(week), float(seconds), wx, wy, wz, x, y, z]


def _vectornav_row(fields: list[bytes]) -> list[float]:
    return [float(field) for field in fields[1:12]]


_FORMATS = {
    "novatel": _Format(
        re.compile(rb"[#%]RAWIMU\w*A,"), _novatel_sum, b"",
        ("week", "time", "gyro_x", "minus_gyro_y", "gyro_z", "accel_x", "minus_accel_y", "accel_z"),
        _novatel_row,
        {
            "time": {"column": "time", "unit": "s"},
            "clock": "disciplined",  # the time of GPS
            **{name: {"columns": [f"{name}_x", f"-minus_{name}_y", f"{name}_z"],
                      "kind": "increment"} for name in ("gyro", "accel")},
        },
        "increment",
        {"what": "sentences RAWIMU of NovAtel", "axes": "those marked on the IMU, right-forward-up",
         "units": "counts of increments, seconds of the week of GPS", "turned": "y = -(minus y)"},
    ),
    "vectornav": _Format(
        re.compile(rb"\$VNIMU,"), _vectornav_sum, b"XX",
        ("mag_x", "mag_y", "mag_z", "accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z",
         "temperature", "pressure"),
        _vectornav_row,
        {
            **{name: {"columns": [f"{name}_y", f"{name}_x", f"-{name}_z"], "unit": unit}
               for name, unit in (("gyro", "rad/s"), ("accel", "m/s^2"))},
            "temperature": {"column": "temperature", "unit": "degC"},
        },
        "rate",
        {"what": "sentences $VNIMU of VectorNav", "axes": "forward-right-down",
         "units": "rad/s, m/s^2, -1 g along down at rest, no time",
         "turned": "x = y, y = x, z = -z"},
    ),
}  # fmt: skip
