"""Bags of ROS 1 (.bag) and ROS 2 (a folder, .mcap, .db3): messages of one topic as rows.

``sensor_msgs/Imu`` declares what it holds (REP 103, REP 145): rates in rad/s, specific force in
m/s^2 (+1 g up at rest), axes forward-left-up, which are turned to right-forward-up here: right is
minus y, forward is x. ``nav_msgs/Odometry`` gives the table of a master: attitude and velocity
against axes that REP 103 wants east-north-up.

rosbags reads them; it is loaded when a bag is opened.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, finding
from foucault.logs.raw import Progress, RawTable, library

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

IMU, ODOMETRY = "sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"

_ROWS = 1 << 12
_NAMES = ("time", "recorded", *(f"{field}.{axis}" for field in (
    "angular_velocity", "linear_acceleration") for axis in "xyz"))  # fmt: skip
_MASTER = ("time (s)", *(f"velocity {name} (m/s)" for name in ("east", "north", "up")),
           *(f"{name} (rad)" for name in ("heading", "pitch", "roll")))  # fmt: skip
_TURNED = ("-{0}.y", "{0}.x", "{0}.z")
"""Right, forward, up in the columns of forward, left, up."""

_EAST = ("map", "earth", "utm", "enu", "world")
"""Frames whose x axis is east by REP 105, or by their name."""


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a bag; its columns are the fields of the messages of one topic."""
    kind = ODOMETRY if hasattr(description, "attitude") else IMU
    with _opened(path) as bag:
        topic = _topic(bag, kind, description.topic, path)
        first = next(_messages(bag, topic), None)
        if first is None:
            raise error("log.empty", file=path.name)
    if kind == ODOMETRY:
        return RawTable(_MASTER, True, _reader(path, topic, _odometry, progress),
                        findings=_axes_of_master(first[1], topic, path))  # fmt: skip
    declared: dict[str, Any] = {"time": {"column": "time", "unit": "s"}}
    for block, field, unit in (("gyro", "angular_velocity", "rad/s"),
                               ("accel", "linear_acceleration", "m/s^2")):  # fmt: skip
        # The first element of its covariance is -1 where a driver does not fill a field.
        if getattr(first[1], f"{field}_covariance")[0] != -1:
            declared[block] = {"columns": [name.format(field) for name in _TURNED], "unit": unit}
    told = finding(
        "log.declared", file=path.name, what=f"messages {IMU} on {topic}",
        units="rad/s, m/s^2, +1 g up at rest, stamped by header.stamp", axes="forward-left-up",
        turned="x = -y, y = x, z = z",
    )  # fmt: skip
    return RawTable(_NAMES, True, _reader(path, topic, _imu, progress), findings=(told,),
                    declared=declared, sampled="rate")  # fmt: skip


def _opened(path: Path) -> Any:
    reader = library("rosbags.highlevel", "ros", path)
    types = library("rosbags.typesys", "ros", path)
    usual = types.get_typestore(types.Stores.LATEST)
    return reader.AnyReader([path], default_typestore=usual)


def _topic(bag: Any, kind: str, wanted: str | None, path: Path) -> str:
    able = sorted({c.topic for c in bag.connections if c.msgtype == kind})
    if wanted in able:
        return str(wanted)
    if wanted is None and len(able) == 1:
        return str(able[0])
    have = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in bag.connections})) or "nothing"
    if able and wanted is None:
        raise error("log.several_topics", file=path.name, have=", ".join(able), example=able[0])
    what = f"no topic '{wanted}' of {kind}" if wanted else f"no topic of {kind}"
    raise error("log.no_topic", file=path.name, what=what, have=have)


def _messages(bag: Any, topic: str) -> Iterator[tuple[int, Any]]:
    some = [c for c in bag.connections if c.topic == topic]
    for connection, recorded, data in bag.messages(connections=some):
        yield recorded, bag.deserialize(data, connection.msgtype)


def _reader(path: Path, topic: str, row: Any, progress: Progress | None) -> Any:
    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        with _opened(path) as bag:
            total = max(1, sum(c.msgcount for c in bag.connections if c.topic == topic))
            rows: list[tuple[float, ...]] = []
            done = 0
            for recorded, message in _messages(bag, topic):
                rows.append(row(recorded, message))
                if len(rows) == _ROWS:
                    done += len(rows)
                    if progress:
                        progress(min(1.0, done / total))
                    yield np.array(rows)[:, list(columns)]
                    rows = []
            if progress:
                progress(1.0)
            if rows:
                yield np.array(rows)[:, list(columns)]

    return blocks


def _seconds(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _imu(recorded: int, message: Any) -> tuple[float, ...]:
    w, f = message.angular_velocity, message.linear_acceleration
    return (_seconds(message), recorded * 1e-9, w.x, w.y, w.z, f.x, f.y, f.z)


def _odometry(_recorded: int, message: Any) -> tuple[float, ...]:
    """Return a row of `_MASTER`: the twist is in axes of the child, the pose turns it."""
    from scipy.spatial.transform import Rotation

    q, v = message.pose.pose.orientation, message.twist.twist.linear
    C = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    forward, left, up = C.T  # axes of the child, east-north-up
    velocity = C @ np.array([v.x, v.y, v.z])
    heading = np.arctan2(forward[0], forward[1])
    pitch = np.arctan2(forward[2], np.hypot(forward[0], forward[1]))
    roll = np.arctan2(left[2], up[2])
    return (_seconds(message), *velocity.tolist(), float(heading), float(pitch), float(roll))


def _axes_of_master(message: Any, topic: str, path: Path) -> tuple[Finding, ...]:
    frame = message.header.frame_id
    told = finding(
        "log.declared", file=path.name, what=f"messages {ODOMETRY} on {topic}",
        units=f"m/s in the axes of '{message.child_frame_id}', stamped by header.stamp",
        axes=f"east-north-up of '{frame}', forward-left-up of '{message.child_frame_id}'",
        turned="heading clockwise from north, pitch nose up, roll right side down",
    )  # fmt: skip
    if any(word in frame for word in _EAST):
        return (told,)
    return told, finding("log.master_frame", file=path.name, topic=topic, frame=frame)
