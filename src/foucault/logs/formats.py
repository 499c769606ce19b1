"""Binary files of others: Parquet, NumPy, MATLAB, plain records, bags of ROS, logs of PX4."""

from __future__ import annotations

import gzip
import math
import mmap
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, of_arrow
from foucault.errors import Finding, error, finding, suggestion
from foucault.logs.dialect import is_text, not_a_bomb, open_bytes, position
from foucault.logs.own import ARRAY_KEY, METADATA_KEY
from foucault.logs.raw import (
    BLOCK_ROWS,
    PIECE,
    Progress,
    RawTable,
    in_blocks,
    library,
    must_exist,
    must_fit,
    reading,
)
from foucault.logs.text import open_delimited

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout


_BATCH_ROWS = 1 << 16
"""Rows of a Parquet file at once: of the usual seven columns they stay in the cache."""


def open_parquet(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a Parquet file; its top-level columns are the columns of the log."""
    import pyarrow as pa
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        schema = file.schema_arrow
    marker = (schema.metadata or {}).get(METADATA_KEY, b"").decode()

    # Else whole columns of a row group, or of the file, are fetched ahead. A page that was
    # written with a checksum is compared with it.
    opened = partial(parquet.ParquetFile, path, pre_buffer=False, buffer_size=1 << 20,
                     page_checksum_verification=True)  # fmt: skip

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        wanted = [schema.field(c) for c in columns]
        for field in wanted:
            _must_be_number(path, field)
        names = list(dict.fromkeys(field.name for field in wanted))
        done = 0
        with opened() as file:
            total = max(1, file.metadata.num_rows)
            claimed = 8.0 * total * len(names)
            not_a_bomb(claimed, path.stat().st_size)
            must_fit(path, claimed)
            for batch in file.iter_batches(_BATCH_ROWS, columns=names):
                done += batch.num_rows
                if progress:
                    progress(done / total)
                yield np.array([_floats(batch.column(f.name)) for f in wanted]).T

    def words(column: int) -> Iterator[Any]:
        name = schema.field(column).name
        with opened() as file:
            for batch in file.iter_batches(_BATCH_ROWS, columns=[name]):
                cells = batch.column(0)
                if not pa.types.is_string(cells.type):
                    cells = pa.array([None if w is None else str(w) for w in cells.to_pylist()],
                                     pa.string())  # fmt: skip
                yield cells.fill_null("") if cells.null_count else cells  # which takes pandas

    return RawTable(tuple(schema.names), True, blocks, marker, words=words)


def _floats(column: Any) -> Any:
    import pyarrow as pa

    # Unsafe only in that an integer beyond 2^53 is rounded, as any float64 is.
    return of_arrow(column.cast(pa.float64(), safe=False))


def _must_be_number(path: Path, field: Any) -> None:
    from pyarrow import types

    if not (types.is_integer(field.type) or types.is_floating(field.type)):
        raise error(
            "log.not_numeric",
            file=path.name,
            line="every row",
            column=field.name,
            cell=f"of type {field.type}",
            hint="",
        )


# -- NumPy files: one array (.npy) or several by name (.npz) -------------------------------------

Array = npt.NDArray[Any]

PACKED = 1100
"""Zip makes nothing smaller than by this factor [1]."""


def open_numpy(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a .npy or .npz file; pickled objects are refused."""
    with path.open("rb") as stream:
        if stream.read(2) == b"PK":
            arrays = _unpacked(stream, path)
            marker = str(arrays.pop(ARRAY_KEY, ""))
            return from_arrays(path, arrays, description.variable, progress, marker)
    loaded = np.load(path, allow_pickle=False, mmap_mode="r")
    return from_arrays(path, {"": loaded}, None, progress)


def _unpacked(stream: IO[bytes], path: Path) -> dict[str, Array]:
    """Return the arrays of a .npz file, none larger than it can hold packed."""
    arrays, size, whole = {}, path.stat().st_size, 0.0
    with zipfile.ZipFile(stream) as parts:
        for info in parts.infolist():
            with parts.open(info) as part:
                version = np.lib.format.read_magic(part)
                header = np.lib.format.read_array_header_1_0 if version == (1, 0) else (
                    np.lib.format.read_array_header_2_0)  # fmt: skip
                shape, _, dtype = header(part)
                claimed = math.prod(shape) * dtype.itemsize
            if claimed > min(info.file_size, PACKED * size):
                raise ValueError(f"'{info.filename}' claims more numbers than it holds")
            whole += claimed
            not_a_bomb(whole, size)
            must_fit(path, claimed)
            with parts.open(info) as part:
                name = info.filename.removesuffix(".npy")
                arrays[name] = np.lib.format.read_array(part, allow_pickle=False)
    return arrays


def from_arrays(
    path: Path,
    arrays: Mapping[str, Array],
    variable: str | None,
    progress: Progress | None,
    marker: str = "",
) -> RawTable:
    """Make columns of the arrays of a file.

    `arrays`: arrays by name, each shape (n,), (n, k) or (k, n): samples run along the longer side
    [1]; `variable`: the one array to use, if None all arrays with as many samples as the longest;
    `progress` or None: called with the fraction read, from 0 to 1; `marker`: what the file says
    about itself if this package wrote it. Returns columns by number for one matrix, ``name``,
    ``name.0``, ``name.1`` ... for several.
    """
    tables = {n: t for n, a in arrays.items() if (t := _samples_first(a)) is not None}
    if variable is not None:
        if variable not in tables:
            hint, allowed = suggestion(variable, tables), ", ".join(tables)
            raise error("log.variable", file=path.name, name=variable, hint=hint, allowed=allowed)
        tables = {variable: tables[variable]}
    rows = max((len(t) for t in tables.values()), default=0)
    if rows == 0:
        raise error("log.empty", file=path.name)
    columns: dict[str, Array] = {}
    longest = {n: t for n, t in tables.items() if len(t) == rows}
    for name, table in longest.items():
        columns |= _named_columns(name, table, alone=len(longest) == 1)
    named = not all(map(str.isdigit, columns))
    return RawTable(tuple(columns), named, in_blocks(columns, progress), marker)


def _samples_first(array: Array) -> Array | None:
    numeric = array.dtype.names is not None or array.dtype.kind in "iuf"
    if not numeric or array.ndim not in (1, 2) or array.size == 0:
        return None
    return array.T if array.ndim == 2 and array.shape[0] < array.shape[1] else array


def _named_columns(name: str, table: Array, alone: bool) -> dict[str, Array]:
    if table.dtype.names is not None:
        return {field: table[field].reshape(len(table)) for field in table.dtype.names}
    if table.ndim == 1:
        return {name or "0": table}
    if table.shape[1] == 1 and not alone:
        return {name: table[:, 0]}
    prefix = "" if alone else f"{name}."
    return {f"{prefix}{i}": table[:, i] for i in range(table.shape[1])}


# -- MATLAB files: version 4 to 7 (binary) and ASCII ---------------------------------------------


def open_matlab(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a .mat file; one saved with -ascii is read as text."""
    with open_bytes(path) as stream:
        start = stream.read(4096)
    if start[:10] == b"MATLAB 7.3":
        raise error("log.matlab_73", file=path.name)
    if start[:6] != b"MATLAB" and is_text(start):
        return open_delimited(path, description, progress)
    from scipy.io import loadmat, whosmat

    with open_bytes(path) as stream:
        source: Any = stream  # the stubs know only paths, scipy also takes streams
        if not isinstance(source, gzip.GzipFile):  # gives what there is, not room for any claim
            source = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        claimed = sum(8.0 * math.prod(shape) for _, shape, _ in whosmat(source))
        not_a_bomb(claimed, path.stat().st_size)
        must_fit(path, claimed)
        source.seek(0)
        wanted = None if description.variable is None else [description.variable]
        contents = loadmat(source, variable_names=wanted)
        if wanted and wanted[0] not in contents:  # read again to tell which names there are
            source.seek(0)
            contents = loadmat(source)
    known = {k: v for k, v in contents.items() if not k.startswith("__")}
    chosen = known.get(description.variable or "")
    if isinstance(chosen, np.ndarray) and chosen.dtype.names is not None:
        return from_arrays(path, _in_structures({"": chosen}), None, progress)
    return from_arrays(path, _in_structures(known), description.variable, progress)


def _in_structures(contents: Mapping[str, Any], depth: int = 3) -> dict[str, Any]:
    """Return the arrays of a MATLAB file, those in a structure by the names of its fields."""
    out: dict[str, Any] = {}
    for name, value in contents.items():
        if not isinstance(value, np.ndarray):
            continue
        if value.dtype.names is None:
            out[name] = value
        elif value.size == 1 and depth:
            prefix = f"{name}." if name and len(contents) > 1 else ""
            inner = {f"{prefix}{field}": value[field].item() for field in value.dtype.names}
            out |= _in_structures(inner, depth - 1)
    return out


# -- Plain binary records: the same numbers again and again, nothing in between ------------------


def open_binary(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a file of binary records, laid out as ``[log.record]`` says."""
    record = description.record
    if record is None:
        raise error("log.record_missing", file=path.name)
    order = "<" if record.byte_order == "little" else ">"
    types = [order + np.dtype(name).str[1:] for name in record.types()]
    dtype = np.dtype([(str(i), kind) for i, kind in enumerate(types)])
    names = dtype.names or ()
    skip = record.skip

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        size = max(1, path.stat().st_size)
        with open_bytes(path) as stream:
            for start in range(0, skip, PIECE):
                if not stream.read(min(PIECE, skip - start)):
                    break
            while data := stream.read(BLOCK_ROWS * dtype.itemsize):
                whole = len(data) // dtype.itemsize
                if len(data) % dtype.itemsize:
                    left = len(data) - whole * dtype.itemsize
                    raise error("log.record_cut", file=path.name, left=left, record=dtype.itemsize)
                rows = np.frombuffer(data, dtype)
                if progress:
                    progress(min(1.0, position(stream) / size))
                yield np.column_stack([rows[names[c]] for c in columns]).astype(np.float64)

    return RawTable(names, False, blocks)


IMU, ODOMETRY = "sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"

# -- Bags of ROS 1 (.bag) and ROS 2 (a folder, .mcap, .db3): messages of one topic as rows -------
# ``sensor_msgs/Imu`` declares what it holds (REP 103, REP 145): rates in rad/s, specific force in
# m/s^2 (+1 g up at rest), axes forward-left-up, which are turned to right-forward-up here: right is
# minus y, forward is x. ``nav_msgs/Odometry`` gives the table of a master: attitude and velocity
# against axes that REP 103 wants east-north-up. Poses beside an IMU are of any world: those of
# `POSES`, of ``tf`` the transforms to one child.
#
# rosbags reads them; it is loaded when a bag is opened.

_ROWS = 1 << 12
_NAMES = ("time", "recorded", *(f"{field}.{axis}" for field in (
    "angular_velocity", "linear_acceleration") for axis in "xyz"))  # fmt: skip
_MASTER = ("time (s)", *(f"velocity {name} (m/s)" for name in ("east", "north", "up")),
           *(f"{name} (rad)" for name in ("heading", "pitch", "roll")))  # fmt: skip
POSES = {
    "geometry_msgs/msg/PoseStamped": "pose", "nav_msgs/msg/Odometry": "pose.pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "geometry_msgs/msg/TransformStamped": "transform", "tf2_msgs/msg/TFMessage": "transform",
    "tf/msg/tfMessage": "transform",
}  # fmt: skip
"""Messages that hold poses -> where a message holds its own."""

_POSE = ("time (s)", "x (m)", "y (m)", "z (m)", "qw", "qx", "qy", "qz")
_TURNED = ("-{0}.y", "{0}.x", "{0}.z")
"""Right, forward, up in the columns of forward, left, up."""

_EAST = ("map", "earth", "utm", "enu", "world")
"""Frames whose x axis is east by REP 105, or by their name."""


def open_ros(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a bag; its columns are the fields of the messages of one topic."""
    if hasattr(description, "child"):
        return _open_poses(path, description, progress)
    kind = ODOMETRY if hasattr(description, "attitude") else IMU
    with opened_bag(path) as bag:
        topic = topic_of_bag(bag, kind, description.topic, path)
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


def _open_poses(path: Path, description: Any, progress: Progress | None) -> RawTable:
    child = description.child
    with opened_bag(path) as bag:
        topic = topic_of_bag(bag, tuple(POSES), description.topic, path)
        kind = next(c.msgtype for c in bag.connections if c.topic == topic)
        several = kind.startswith("tf")
        if several:
            seen = {t.child_frame_id for _, m in _messages(bag, topic) for t in m.transforms}
            if child not in seen and (child is not None or len(seen) != 1):
                raise error("pose.frames", file=path.name, topic=topic, given=child or "no child",
                            have=", ".join(sorted(seen)) or "none")  # fmt: skip
            child = child or seen.pop()
    fields = POSES[kind].split(".")

    def rows(recorded: int, message: Any) -> list[tuple[float, ...]]:
        out: list[tuple[float, ...]] = []
        for one in message.transforms if several else (message,):
            if not several or one.child_frame_id == child:
                pose = one
                for field in fields:
                    pose = getattr(pose, field)
                p, q = ((pose.translation, pose.rotation) if fields[-1] == "transform"
                        else (pose.position, pose.orientation))  # fmt: skip
                out.append((_seconds(one), p.x, p.y, p.z, q.w, q.x, q.y, q.z))
        return out

    return RawTable(_POSE, True, _reader(path, topic, rows, progress),
                    declared={"reading": "w x y z, body to world"})  # fmt: skip


@contextmanager
def opened_bag(path: Path) -> Iterator[Any]:
    """Open a bag of ROS 1 or ROS 2."""
    must_exist(path)
    reader = library("rosbags.highlevel", "ros", path)
    types = library("rosbags.typesys", "ros", path)
    usual = types.get_typestore(types.Stores.LATEST)
    with ExitStack() as stack:
        with reading(path, "ros"):
            bag = stack.enter_context(reader.AnyReader([path], default_typestore=usual))
        yield bag


def instruments_of_bag(path: Path) -> list[str]:
    """Return the topics of inertial readings."""
    with opened_bag(path) as bag:
        return sorted({c.topic for c in bag.connections if c.msgtype == IMU and c.msgcount})


def topic_of_bag(bag: Any, kind: str | tuple[str, ...], wanted: str | None, path: Path) -> str:
    """Return the topic of messages of a kind, or of some kinds, that is wanted, or the only one."""
    kinds = (kind,) if isinstance(kind, str) else kind
    able = sorted({c.topic for c in bag.connections if c.msgtype in kinds})
    kind = kinds[0] if len(kinds) == 1 else "poses"
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
        with opened_bag(path) as bag:
            total = max(1, sum(c.msgcount for c in bag.connections if c.topic == topic))
            rows: list[tuple[float, ...]] = []
            done = 0
            for recorded, message in _messages(bag, topic):
                rows.extend(row(recorded, message))
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


def _imu(recorded: int, message: Any) -> list[tuple[float, ...]]:
    w, f = message.angular_velocity, message.linear_acceleration
    return [(_seconds(message), recorded * 1e-9, w.x, w.y, w.z, f.x, f.y, f.z)]


def _odometry(_recorded: int, message: Any) -> list[tuple[float, ...]]:
    """Return a row of `_MASTER`: the twist is in axes of the child, the pose turns it."""
    from scipy.spatial.transform import Rotation

    q, v = message.pose.pose.orientation, message.twist.twist.linear
    C = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    forward, left, up = C.T  # axes of the child, east-north-up
    velocity = C @ np.array([v.x, v.y, v.z])
    heading = np.arctan2(forward[0], forward[1])
    pitch = np.arctan2(forward[2], np.hypot(forward[0], forward[1]))
    roll = np.arctan2(left[2], up[2])
    return [(_seconds(message), *velocity.tolist(), float(heading), float(pitch), float(roll))]


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


# -- Logs of PX4 (.ulg): messages of one kind as rows --------------------------------------------
# PX4 writes SI units in axes forward-right-down, specific force -1 g along down at rest; they are
# turned to right-forward-up here: right is y, forward is x, up is minus z.
#
# ``vehicle_imu``        angle and velocity increments, each with the time it was summed over: they
#                        are divided by it, which gives means over each interval
# ``sensor_combined``    means of the selected sensors over each interval
# ``sensor_gyro``        one gyro as the driver reads it, and the accelerometer of the same number
#                        beside it: pairs of samples not half an interval apart
#
# The first two are less what PX4 itself has calibrated, the last is not. pyulog reads the file; it
# is loaded when one is opened, and holds the messages of one kind.

Columns = dict[str, FloatArray]

_PAIRED = 0.9
"""Samples of a gyro that must have an accelerometer beside them, as part of all [1]."""

_AGE, _INVALID = "accelerometer_timestamp_relative", 2**31 - 1
"""Field of ``sensor_combined``, and its value where that of the accelerometer is not valid [us]."""

_OWN = re.compile(r"CAL_(?:ACC|GYRO)\d_[XYZ](OFF|SCALE)")
"""Parameters of PX4's own calibration."""


def open_ulog(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a log of PX4; its columns are the fields of one message, in SI."""
    log, data = _ulog(path)
    topic = topic_of_messages(data, tuple(_MESSAGES), description.topic, path)
    message, _, number = topic.partition("/")
    columns = _MESSAGES[message](data[topic], data.get(f"sensor_accel/{number}"), topic, path)
    return RawTable(
        tuple(columns), True, in_blocks(columns, progress),
        findings=_told(log, topic, path), declared=declared_frd(columns),
        sampled="rate" if message == "sensor_gyro" else "increment",
    )  # fmt: skip


def _ulog(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return a log of PX4, and its messages of sensors by name and number."""
    pyulog = library("pyulog", "px4", path)
    must_fit(path, path.stat().st_size)
    with path.open("rb") as stream, redirect_stdout(StringIO()):  # it prints what it meets
        log = pyulog.ULog(stream, message_name_filter_list=[*_MESSAGES, "sensor_accel"])
    if log.file_corruption:
        raise ValueError("the log is corrupt")
    return log, {
        f"{d.name}/{d.multi_id}": d.data for d in log.data_list if len(d.data["timestamp"])
    }


def instruments_of_ulog(path: Path) -> list[str]:
    """Return one topic for each instrument: its increments, else single readings, else means."""
    _, data = _ulog(path)
    groups = ([name for name in data if name.startswith(f"{kind}/")]
              for kind in ("vehicle_imu", "sensor_gyro", "sensor_combined"))  # fmt: skip
    return next((sorted(some) for some in groups if some), [])


def topic_of_messages(
    data: Mapping[str, Any], kinds: Sequence[str], wanted: str | None, path: Path
) -> str:
    """Return the messages that are wanted, such as ``IMU/1``, or the only ones of these kinds."""
    able = [name for name in data if name.partition("/")[0] in kinds]
    named = {name.removesuffix("/0"): name for name in able} | {name: name for name in able}
    if wanted in named:
        return named[str(wanted)]
    if wanted is None and len(able) == 1:
        return able[0]
    have = ", ".join(able)
    if able and wanted is None:
        raise error("log.several_topics", file=path.name, have=have, example=able[0])
    what = f"no message '{wanted}'" if wanted else f"none of the messages {', '.join(kinds)}"
    raise error("log.no_topic", file=path.name, what=what, have=have or "no other of them")


def declared_frd(columns: Columns) -> dict[str, Any]:
    """Say what columns in SI and forward-right-down are."""
    out: dict[str, Any] = {"time": {"column": "time", "unit": "s"}}
    for block, unit in (("gyro", "rad/s"), ("accel", "m/s^2")):
        if f"{block}_x" in columns:
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


def _seconds_of_ulog(data: Any, name: str = "timestamp") -> FloatArray:
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
    return {"time": _seconds_of_ulog(data, "timestamp_sample"), **_triads(*triads)}


def _combined(data: Any, _accel: Any, _topic: str, _path: Path) -> Columns:
    triads = _triads(_fields(data, "gyro_rad"), _fields(data, "accelerometer_m_s2"))
    if _AGE in data:
        for axis in "xyz":
            triads[f"accel_{axis}"][data[_AGE] == _INVALID] = np.nan
    return {"time": _seconds_of_ulog(data), **triads}


def beside_each_other(data: Any, accel: Any, topic: str, path: Path) -> Columns:
    """Put the sample of the accelerometer beside each of the gyro that is nearest in time."""
    if accel is None:
        raise error("log.no_topic", file=path.name, have=topic,
                    what=f"no accelerometer beside {topic}")  # fmt: skip
    mine, other = (
        _seconds_of_ulog(d, "timestamp_sample" if "timestamp_sample" in d else "timestamp")
        for d in (data, accel)
    )
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


_MESSAGES = {
    "sensor_combined": _combined,
    "vehicle_imu": _vehicle_imu,
    "sensor_gyro": beside_each_other,
}
