"""Telemetry of MAVLink (``.tlog``), as a ground station keeps it: messages of one IMU as rows.

Each packet follows the time of its arrival, 8 bytes. Its own head is, in version 1 and 2::

    FE length sequence system component message
    FD length incompatible compatible sequence system component message(3)

then the payload, zeros at its end left out in version 2, the checksum, and a signature of 13 bytes
where the lowest bit of `incompatible` is set. Fields lie in a payload by size, extensions last::

    HIGHRES_IMU                 m/s^2, rad/s; `id`: number of the IMU
    SCALED_IMU, 2, 3            mG, mrad/s: whole numbers, too coarse to calibrate by
    RAW_IMU                     as each autopilot likes; no unit is declared; `id`: as above

all in axes forward-right-down, specific force -1 g along down at rest. Temperatures are left out:
those of PX4 are the barometer's and the magnetometer's.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray
from foucault.errors import finding
from foucault.logs.formats import Columns, declared_frd, topic_of_messages
from foucault.logs.raw import Progress, RawTable, in_blocks, must_fit
from foucault.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

_SIX = [(f"{block}_{axis}", "<i2") for block in ("accel", "gyro") for axis in "xyz"]
_SCALED = np.dtype([("time", "<u4"), *_SIX, ("rest", "V8")])
_RAW = np.dtype([("time", "<u8"), *_SIX, ("mag", "V6"), ("id", "u1"), ("rest", "V2")])
_HIGHRES = np.dtype([("time", "<u8"), *[(name, "<f4") for name, _ in _SIX], ("rest", "V30"),
                     ("id", "u1")])  # fmt: skip

MESSAGES = {
    105: ("HIGHRES_IMU", _HIGHRES, 93), 26: ("SCALED_IMU/0", _SCALED, 170),
    116: ("SCALED_IMU/1", _SCALED, 76), 129: ("SCALED_IMU/2", _SCALED, 46),
    27: ("RAW_IMU", _RAW, 144),
}  # fmt: skip
"""Number of a message -> its name, its payload, and the byte that ends what is summed up."""

_TABLE = np.arange(256, dtype=np.uint16)
for _ in range(8):
    _TABLE = np.where(_TABLE & 1, _TABLE >> 1 ^ 0x8408, _TABLE >> 1).astype(np.uint16)
"""What a byte does to the checksum, CRC-16/MCRF4XX."""

_HEADS = {0xFE: 6, 0xFD: 10}
"""First byte of a packet -> length of its head [byte]."""

_ARRIVAL = 8
"""Length of the time of arrival before each packet [byte]."""


def open_mavlink(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open telemetry; its columns are the fields of one IMU, in SI where a unit is known."""
    must_fit(path, 2.0 * path.stat().st_size)
    data = _messages(path.read_bytes())
    kinds = tuple(dict.fromkeys(name.partition("/")[0] for name in data))
    topic = topic_of_messages(data, kinds, description.topic, path)
    name = topic.partition("/")[0].rpartition(":")[2]
    columns = _columns(name, data[topic])
    declared = declared_frd(columns)
    if name == "RAW_IMU":
        for block in ("accel", "gyro"):
            del declared[block]["unit"]
    units = {"RAW_IMU": "no units", "HIGHRES_IMU": "rad/s, m/s^2"}.get(name, "mrad/s, mG")
    told = finding(
        "log.declared", file=path.name, what=f"messages {topic} of MAVLink",
        units=f"{units}, -1 g along down at rest, time of the autopilot",
        axes="forward-right-down", turned="x = y, y = x, z = -z",
    )  # fmt: skip
    how = "single numbers" if name == "HIGHRES_IMU" else "whole numbers"
    thin = finding("log.telemetry", file=path.name, topic=topic, how=how)
    return RawTable(
        tuple(columns), True, in_blocks(columns, progress),
        findings=(told, thin), declared=declared, sampled="rate",
    )  # fmt: skip


def instruments(path: Path) -> list[str]:
    """Return one topic for each instrument, of the finest messages that there are."""
    names = _messages(path.read_bytes())
    groups = ([name for name in names if kind in name]
              for kind in ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"))  # fmt: skip
    return next((some for some in groups if some), [])


def _columns(name: str, rows: npt.NDArray[Any]) -> Columns:
    accel, gyro = (1e-3 * STANDARD_GRAVITY, 1e-3) if name == "SCALED_IMU" else (1.0, 1.0)
    out = {"time": rows["time"] * (1e-3 if name == "SCALED_IMU" else 1e-6)}
    for block, factor in (("gyro", gyro), ("accel", accel)):
        out |= {f"{block}_{axis}": rows[f"{block}_{axis}"] * factor for axis in "xyz"}
    return {key: np.asarray(x, float) for key, x in out.items()}


def _messages(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the messages of each IMU by name and number, those with a wrong checksum left out.

    Where several systems send them, the number of each goes before the name: ``2:HIGHRES_IMU/0``.
    """
    alike: dict[tuple[int, int, int, int], list[tuple[int, bytes]]] = {}
    for at, head, end, system, message in _packets(content):
        key = system, list(MESSAGES).index(message), head, end - at
        alike.setdefault(key, []).append((at, content[at:end]))
    whole: dict[tuple[int, int], list[tuple[int, bytes]]] = {}
    for (system, kind, head, _), packets in sorted(alike.items()):
        _, dtype, extra = [*MESSAGES.values()][kind]
        right = _sums_agree(np.frombuffer(b"".join(p for _, p in packets), np.uint8)
                            .reshape(len(packets), -1), extra)  # fmt: skip
        # Version 2 leaves out zeros at the end, version 1 fields that came later.
        whole.setdefault((system, kind), []).extend(
            (at, packet[head:-2].ljust(dtype.itemsize, b"\0")[: dtype.itemsize])
            for (at, packet), fine in zip(packets, right.tolist(), strict=True)
            if fine
        )
    out: dict[str, npt.NDArray[Any]] = {}
    for (system, kind), rows in whole.items():
        name, dtype, _ = [*MESSAGES.values()][kind]
        name = name if len({s for s, _ in whole}) == 1 else f"{system}:{name}"
        fields = np.frombuffer(b"".join(row for _, row in sorted(rows)), dtype)
        if "id" in (dtype.names or ()):
            out |= {f"{name}/{each}": fields[fields["id"] == each]
                    for each in np.unique(fields["id"])}  # fmt: skip
        elif len(fields):
            out[name] = fields
    if not out:
        raise ValueError("it has none of the messages HIGHRES_IMU, SCALED_IMU and RAW_IMU")
    return out


def _packets(content: bytes) -> Iterator[tuple[int, int, int, int, int]]:
    """Yield where each packet of `MESSAGES` begins, how long its head is, where it ends, its sender
    and its number."""
    at = _ARRIVAL
    while at + 10 <= len(content):
        head, length = _HEADS.get(content[at], 0), content[at + 1]
        end = at + head + length + 2
        signed = 13 if head == 10 and content[at + 2] & 1 else 0
        after = end + signed + _ARRIVAL
        # Where bytes were lost a packet runs into another: on with the next byte that begins one.
        if not head or (after < len(content) and content[after] not in _HEADS):
            at += 1
            continue
        wide = 3 if head == 10 else 1
        message = int.from_bytes(content[at + head - wide : at + head], "little")
        if message in MESSAGES and end <= len(content):
            yield at, head, end, content[at + head - wide - 2], message
        at = after


def _sums_agree(packets: npt.NDArray[np.uint8], extra: int) -> BoolArray:
    """Return which packets (n, m) have the checksum that they say."""
    sum_ = np.full(len(packets), 0xFFFF, np.uint16)
    for byte in (*packets[:, 1:-2].T, np.full(len(packets), extra, np.uint8)):
        sum_ = sum_ >> 8 ^ _TABLE[(sum_ ^ byte) & 0xFF]
    return np.asarray(sum_ == np.ascontiguousarray(packets[:, -2:]).view("<u2")[:, 0])
