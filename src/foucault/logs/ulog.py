"""Logs of PX4 (.ulg): messages of one kind as rows.

PX4 writes SI units in axes forward-right-down, specific force -1 g along down at rest; they are
turned to right-forward-up here: right is y, forward is x, up is minus z.

``vehicle_imu``        angle and velocity increments, each with the time it was summed over: they
                       are divided by it, which gives means over each interval
``sensor_combined``    means of the selected sensors over each interval
``sensor_gyro``        one gyro as the driver reads it, and the accelerometer of the same number
                       beside it: pairs of samples not half an interval apart

The first two are less what PX4 itself has calibrated, the last is not. pyulog reads the file; it
is loaded when one is opened, and holds the messages of one kind.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, finding
from foucault.logs.raw import BLOCK_ROWS, Progress, RawTable, library, must_fit

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

Columns = dict[str, FloatArray]

_PAIRED = 0.9
"""Samples of a gyro that must have an accelerometer beside them, as part of all [1]."""

_AGE, _INVALID = "accelerometer_timestamp_relative", 2**31 - 1
"""Field of ``sensor_combined``, and its value where that of the accelerometer is not valid [us]."""

_OWN = re.compile(r"CAL_(?:ACC|GYRO)\d_[XYZ](OFF|SCALE)")
"""Parameters of PX4's own calibration."""


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a log of PX4; its columns are the fields of one message, in SI."""
    pyulog = library("pyulog", "px4", path)
    wanted = [*_MESSAGES, "sensor_accel"]
    must_fit(path, path.stat().st_size)
    with path.open("rb") as stream, redirect_stdout(StringIO()):  # it prints what it meets
        log = pyulog.ULog(stream, message_name_filter_list=wanted)
    if log.file_corruption:
        raise ValueError("the log is corrupt")
    data = {f"{d.name}/{d.multi_id}": d.data for d in log.data_list if len(d.data["timestamp"])}
    topic = _topic(data, description.topic, path)
    message, _, number = topic.partition("/")
    columns = _MESSAGES[message](data[topic], data.get(f"sensor_accel/{number}"), topic, path)
    names = tuple(columns)
    rows = len(columns["time"])

    def blocks(some: Sequence[int]) -> Iterator[FloatArray]:
        for start in range(0, rows, BLOCK_ROWS):
            if progress:
                progress(min(1.0, (start + BLOCK_ROWS) / rows))
            yield np.column_stack([columns[names[c]][start : start + BLOCK_ROWS] for c in some])

    return RawTable(
        names, True, blocks, findings=_told(log, topic, path), declared=_declared(columns),
        sampled="rate" if message == "sensor_gyro" else "increment",
    )  # fmt: skip


def _topic(data: Mapping[str, Any], wanted: str | None, path: Path) -> str:
    able = [name for name in data if name.partition("/")[0] in _MESSAGES]
    named = {name.removesuffix("/0"): name for name in able} | {name: name for name in able}
    if wanted in named:
        return named[str(wanted)]
    if wanted is None and len(able) == 1:
        return able[0]
    have = ", ".join(able)
    if able and wanted is None:
        raise error("log.several_topics", file=path.name, have=have, example=able[0])
    what = f"no message '{wanted}'" if wanted else f"none of the messages {', '.join(_MESSAGES)}"
    raise error("log.no_topic", file=path.name, what=what, have=have or "no other of them")


def _declared(columns: Columns) -> dict[str, Any]:
    out: dict[str, Any] = {"time": {"column": "time", "unit": "s"}}
    for block, unit in (("gyro", "rad/s"), ("accel", "m/s^2")):
        out[block] = {"columns": [f"{block}_y", f"{block}_x", f"-{block}_z"], "unit": unit}
    if "temperature" in columns:
        out["temperature"] = {"column": "temperature", "unit": "degC"}
    return out


def _told(log: Any, topic: str, path: Path) -> tuple[Finding, ...]:
    told = finding(
        "log.declared", file=path.name, what=f"messages {topic} of PX4",
        units="rad/s, m/s^2, -1 g along down at rest, time since the start of the system",
        axes="forward-right-down", turned="x = y, y = x, z = -z",
    )  # fmt: skip
    usual = {"OFF": 0.0, "SCALE": 1.0}
    own = [
        name
        for name, value in log.initial_parameters.items()
        if (match := _OWN.fullmatch(name)) and value != usual[match[1]]
    ]
    if topic.startswith("sensor_gyro") or not own:
        return (told,)
    return told, finding("log.px4_calibrated", file=path.name, topic=topic, count=len(own))


def _triads(gyro: Sequence[Any], accel: Sequence[Any]) -> Columns:
    out: Columns = {}
    for block, triad in (("gyro", gyro), ("accel", accel)):
        for axis, values in zip("xyz", triad, strict=True):
            out[f"{block}_{axis}"] = np.asarray(values, np.float64)
    return out


def _fields(data: Any, name: str) -> list[Any]:
    return [data[f"{name}[{k}]"] for k in range(3)]


def _seconds(data: Any, name: str = "timestamp") -> FloatArray:
    return np.asarray(data[name] * 1e-6, np.float64)


def _vehicle_imu(data: Any, _accel: Any, _topic: str, path: Path) -> Columns:
    spans = [data[name] * 1e-6 for name in ("delta_angle_dt", "delta_velocity_dt")]
    for span in spans:
        if not (span > 0).all():
            raise error("log.averaged", file=path.name, row=int(np.argmin(span)), value=span.min())
    triads = [
        [np.asarray(values, np.float64) / span for values in _fields(data, name)]
        for name, span in zip(("delta_angle", "delta_velocity"), spans, strict=True)
    ]
    return {"time": _seconds(data, "timestamp_sample"), **_triads(*triads)}


def _combined(data: Any, _accel: Any, _topic: str, _path: Path) -> Columns:
    triads = _triads(_fields(data, "gyro_rad"), _fields(data, "accelerometer_m_s2"))
    if _AGE in data:
        for axis in "xyz":
            triads[f"accel_{axis}"][data[_AGE] == _INVALID] = np.nan
    return {"time": _seconds(data), **triads}


def _sensors(data: Any, accel: Any, topic: str, path: Path) -> Columns:
    """Put the sample of the accelerometer beside each of the gyro that is nearest in time."""
    if accel is None:
        raise error("log.no_topic", file=path.name, have=topic,
                    what=f"no sensor_accel beside {topic}")  # fmt: skip
    mine, other = (_seconds(d, "timestamp_sample" if "timestamp_sample" in d else "timestamp")
                   for d in (data, accel))  # fmt: skip
    half = 0.5 * float(np.median(np.diff(mine))) if len(mine) > 1 else np.inf
    last = len(other) - 1
    after = np.minimum(np.searchsorted(other, mine), last)
    before = np.maximum(after - 1, 0)
    near = np.where(mine - other[before] < np.abs(other[after] - mine), before, after)
    beside = np.flatnonzero(np.abs(other[near] - mine) <= half)
    beside = beside[np.diff(near[beside], prepend=-1) > 0]  # each of the accelerometer once
    share = len(beside) / len(mine)
    if share < _PAIRED:
        raise error("log.unpaired", file=path.name, topic=topic, share=f"{100 * share:.0f}")
    gyro = [data[axis][beside] for axis in "xyz"]
    force = [accel[axis][near[beside]] for axis in "xyz"]
    out = {"time": mine[beside], **_triads(gyro, force)}
    if "temperature" in data and np.isfinite(data["temperature"]).all():
        out["temperature"] = np.asarray(data["temperature"][beside], np.float64)
    return out


_MESSAGES = {"sensor_combined": _combined, "vehicle_imu": _vehicle_imu, "sensor_gyro": _sensors}
