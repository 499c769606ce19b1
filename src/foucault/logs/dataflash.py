"""Logs of ArduPilot (DataFlash ``.bin``): messages of one IMU as rows.

The file describes itself: a message FMT for each kind says its length, the type of each field (a
letter) and their names. A record is ``A3 95``, the number of its kind, and the fields.

``IMU``           filtered readings at the rate of the main loop; ``I``: number of the IMU
``GYR``, ``ACC``  single readings of one gyro, beside the accelerometer of the same number
``ISBH``, ``ISBD``  batches of one sensor at its own rate, a head and 32 samples of 16 bit a message
                    (value = sample / ``mul``): ``ISBD.gyro/0``, ``ISBD.accel/0``, each alone

SI units in axes forward-right-down, specific force -1 g along down at rest, as in logs of PX4. All
of them are written after ArduPilot's own rotation, temperature calibration, offsets and scale
factors (``INS_*``); the last two are put back where the parameters of the log (messages PARM) say
what they were.
"""

from __future__ import annotations

import re
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.logs.formats import Columns, beside_each_other, declared_frd, topic_of_messages
from foucault.logs.raw import Progress, RawTable, in_blocks, must_fit

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

HEAD, FMT = b"\xa3\x95", 128
"""How a record begins, and the number of the kind of message that describes the others."""

_TYPES = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4",
    "f": "<f4", "d": "<f8", "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4",
    "E": "<u4", "L": "<i4", "M": "u1", "q": "<i8", "Q": "<u8", "g": "<f2",
}  # fmt: skip
"""Letter of a type -> type of NumPy; those that count hundredths are not needed here."""

_FMT = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"),
                 ("labels", "S64")])  # fmt: skip

_OWN = re.compile(r"INS(?P<late>[45])?_(?P<sensor>ACC|GYR)(?P<number>[23])?(?P<what>OFFS|SCAL)"
                  r"_(?P<axis>[XYZ])")  # fmt: skip
"""Parameters of ArduPilot's own calibration: ``INS_GYROFFS_X``, ``INS_ACC2SCAL_Y``."""

Records = npt.NDArray[Any]

_KINDS = ("IMU", "ACC", "GYR", "ISBH", "ISBD")

_SENSORS = {0: "ISBD.accel", 1: "ISBD.gyro"}
"""Type of sensor in the head of a batch -> what its samples are called here."""

_BATCH = 32
"""Samples in a message of a batch [1]."""


def open_dataflash(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a log of ArduPilot; its columns are the fields of one IMU, in SI."""
    must_fit(path, 2.0 * path.stat().st_size)
    kinds = _records(path.read_bytes(), (*_KINDS, "PARM"))
    data = _by_instance(kinds)
    usual = any(name.startswith(("IMU/", "GYR/")) for name in data)
    batches = () if usual and description.topic is None else tuple(_SENSORS.values())
    topic = topic_of_messages(data, ("IMU", "GYR", *batches), description.topic, path)
    name, _, number = topic.partition("/")
    if name == "IMU":
        columns = _imu(data[topic])
    elif name in _SENSORS.values():
        columns = data[topic]
    else:
        sensors = (_sensor(data.get(f"{kind}/{number}"), kind) for kind in ("GYR", "ACC"))
        gyro, accel = sensors
        columns = beside_each_other(gyro, accel, topic, path)
    own, sure = _own_calibration(kinds.get("PARM"), int(number))
    undone = sure and bool(own) and description.own_calibration == "undo"
    if undone:
        columns = _put_back(columns, own)
    return RawTable(
        tuple(columns), True, in_blocks(columns, progress),
        findings=_told(own, undone, topic, path), declared=declared_frd(columns), sampled="rate",
    )  # fmt: skip


def instruments(path: Path) -> list[str]:
    """Return one topic for each instrument of a log, its filtered readings where it has them."""
    data = _by_instance(_records(path.read_bytes(), _KINDS))
    paired = [name for name in data if name.startswith("GYR/") and f"ACC/{name[4:]}" in data]
    return [name for name in data if name.startswith("IMU/")] or paired


def _records(content: bytes, wanted: Sequence[str]) -> dict[str, Records]:
    """Return the messages of some kinds as structured arrays, by the name of the kind."""
    lengths: dict[int, int] = {FMT: 3 + _FMT.itemsize}
    types: dict[int, tuple[str, np.dtype[Any]]] = {}
    places: dict[int, list[int]] = {}
    at, end = 0, len(content)
    while at + 3 <= end:
        kind = content[at + 2]
        after = at + lengths.get(kind, 0)
        # Where bytes were lost a record runs into another: it goes, on with the next that is whole.
        if (
            content[at : at + 2] != HEAD
            or after == at
            or (after != end and content[after : after + 2] != HEAD)
        ):
            at = content.find(HEAD, at + 1)
            if at < 0:
                break
            continue
        if kind == FMT:
            said = np.frombuffer(content, _FMT, 1, at + 3)[0]
            number = int(said["type"])
            lengths.setdefault(number, int(said["length"]))
            name = said["name"].decode("ascii", "replace")
            if name in wanted:
                types[number] = name, _dtype(said)
        elif kind in types:
            places.setdefault(kind, []).append(at + 3)
        at = after
    if not types:
        raise ValueError("it describes none of the messages IMU, ACC, GYR and ISBD")
    raw = np.frombuffer(content, np.uint8)
    out = {}
    for kind, starts in places.items():
        name, dtype = types[kind]
        rows = raw[np.array(starts)[:, None] + np.arange(dtype.itemsize)]
        out[name] = np.ascontiguousarray(rows).view(dtype)[:, 0]
    return out


def _dtype(said: Any) -> np.dtype[Any]:
    letters, labels = (said[key].decode("ascii", "replace") for key in ("format", "labels"))
    if set(letters) - set(_TYPES) or len(letters) != labels.count(",") + 1:
        raise ValueError(f"the format '{letters}' of its message {said['name'].decode()} is none")
    fields = zip(labels.split(","), letters, strict=True)
    return np.dtype([(label, _TYPES[letter]) for label, letter in fields])


def _by_instance(kinds: Mapping[str, Records]) -> dict[str, Any]:
    """Return the messages of each sensor by kind and number, ``IMU/0``; batches as columns."""
    out: dict[str, Any] = {}
    for kind in ("IMU", "GYR", "ACC"):
        if kind not in kinds:
            continue
        rows = kinds[kind]
        number = rows["I"] if "I" in (rows.dtype.names or ()) else np.zeros(len(rows), int)
        for each in np.unique(number):
            out[f"{kind}/{each}"] = rows[number == each]
    if "ISBH" in kinds and "ISBD" in kinds:
        out |= _batches(kinds["ISBH"], kinds["ISBD"])
    return out


def _batches(heads: Records, data: Records) -> dict[str, Columns]:
    """Return the samples of each sensor; a batch of which a message is missing is left out."""
    # A batch has the number N of its head, which counts on and begins again at 65536.
    cuts = np.flatnonzero(np.diff(data["N"].astype(int), prepend=-1))
    runs: dict[int, deque[Records]] = defaultdict(deque)
    for rows in np.split(data, cuts[1:]):
        runs[int(rows["N"][0])].append(rows)
    found: dict[str, list[FloatArray]] = {}
    for head in heads:
        left, count = runs[int(head["N"])], int(head["smp_cnt"])
        rows = left.popleft() if left else data[:0]
        whole = np.array_equal(rows["seqno"], np.arange(-(-count // _BATCH)))
        if not whole or head["type"] not in _SENSORS or not (head["mul"] and head["smp_rate"] > 0):
            continue
        x = [np.concatenate(rows[axis])[:count] / float(head["mul"]) for axis in "xyz"]
        time = head["SampleUS"] * 1e-6 + np.arange(count) / float(head["smp_rate"])
        name = f"{_SENSORS[int(head['type'])]}/{head['instance']}"
        found.setdefault(name, []).append(np.column_stack([time, *x]))
    out = {}
    for name in sorted(found):
        block = name[len("ISBD.") :].partition("/")[0]
        table = np.concatenate(found[name])
        out[name] = {"time": table[:, 0]} | {f"{block}_{a}": table[:, k]
                                             for k, a in enumerate("xyz", 1)}  # fmt: skip
    return out


def _imu(rows: Records) -> Columns:
    out = {"time": rows["TimeUS"] * 1e-6}
    for block, word in (("gyro", "Gyr"), ("accel", "Acc")):
        out |= {f"{block}_{axis}": np.asarray(rows[f"{word}{axis.upper()}"], float)
                for axis in "xyz"}  # fmt: skip
    if "T" in (rows.dtype.names or ()) and np.isfinite(rows["T"]).all():
        out["temperature"] = np.asarray(rows["T"], float)
    return out


def _sensor(rows: Records | None, kind: str) -> dict[str, Any] | None:
    """Return the readings of one sensor as the pairing of logs of PX4 takes them."""
    if rows is None:
        return None
    word = {"GYR": "Gyr", "ACC": "Acc"}[kind]
    axes = {axis: np.asarray(rows[f"{word}{axis.upper()}"], float) for axis in "xyz"}
    return {"timestamp": rows["TimeUS"], "timestamp_sample": rows["SampleUS"], **axes}


def _own_calibration(parameters: Records | None, number: int) -> tuple[dict[str, float], bool]:
    """Return what ArduPilot itself took off one IMU, and whether readings without it are known.

    By ``accel_off_x``, ``accel_scale_x``, ``gyro_off_x``, only what is not zero or one. It is known
    where no value changed, readings were not turned after it (`AHRS_ORIENTATION`), and their change
    with temperature was not taken off.
    """
    held: dict[str, set[float]] = defaultdict(set)
    for row in () if parameters is None else parameters:
        held[row["Name"].decode("ascii", "replace")].add(float(row["Value"]))
    own: dict[str, float] = {}
    warm = (f"INS_TCAL{number + 1}_ENABLE", f"INS{number + 1}_TCAL_ENABLE")
    sure = held["AHRS_ORIENTATION"] == {0.0} and not any(held[name] - {0.0} for name in warm)
    for name, values in list(held.items()):
        match = _OWN.fullmatch(name)
        if match is None or int(match["late"] or match["number"] or 1) != number + 1:
            continue
        scale = match["what"] == "SCAL"
        if values != {1.0 if scale else 0.0}:
            sure &= len(values) == 1 and (not scale or min(values) > 0)
            block = "accel" if match["sensor"] == "ACC" else "gyro"
            own[f"{block}_{'scale' if scale else 'off'}_{match['axis'].lower()}"] = min(values)
    return own, sure


def _put_back(columns: Columns, own: Mapping[str, float]) -> Columns:
    """Return the readings of the sensor itself, y / scale + offset, y = (raw - offset) scale."""
    out = dict(columns)
    for name in columns:
        block, _, axis = name.partition("_")
        scale, off = own.get(f"{block}_scale_{axis}", 1.0), own.get(f"{block}_off_{axis}", 0.0)
        if (scale, off) != (1.0, 0.0):
            out[name] = columns[name] / scale + off
    return out


def _told(own: Mapping[str, float], undone: bool, topic: str, path: Path) -> tuple[Finding, ...]:
    told = finding(
        "log.declared", file=path.name, what=f"messages {topic} of ArduPilot",
        units="rad/s, m/s^2, -1 g along down at rest, time since the start of the system",
        axes="forward-right-down", turned="x = y, y = x, z = -z",
    )  # fmt: skip
    if not own:
        return (told,)
    code = "log.ardupilot_undone" if undone else "log.ardupilot_calibrated"
    return told, finding(code, file=path.name, topic=topic, count=len(own))
