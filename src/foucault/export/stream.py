"""Correct readings as they come: text from a pipe, messages one by one, the messages of a bag.

Text goes through in the blocks that have come since the last look, `EVERY` apart, by the same
functions as a file; where accelerometers are apart or late a block waits for the next one, whose
first samples its derivatives need. Single messages go through the code that `export --to python`
writes, which needs 5 us for each and takes differences from the message before.
"""

from __future__ import annotations

import secrets
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from foucault.errors import Finding, error
from foucault.export.calibrated_log import check_fits, corrected
from foucault.export.code import python_text
from foucault.export.request import FAMILIES, OWN_AXES, request
from foucault.files import atomic
from foucault.logs import own
from foucault.logs.follow import Follower, StreamTail
from foucault.logs.formats import IMU, opened_bag, topic_of_bag
from foucault.logs.raw import reading
from foucault.result import Result
from foucault.tables import Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription
    from foucault.logs.raw import Progress

EVERY = 0.05  # What comes within this time is corrected at once [s].
BODY = "forward-left-up"  # Axes of `sensor_msgs/Imu` by REP 103.
MARK = "/foucault/calibrated"  # Topic by which a bag says that it was corrected.

Three = Sequence[float]


def calibrate_stream(
    result: Result,
    description: LogDescription,
    source: IO[bytes],
    target: IO[bytes],
    *,
    sha256: str = "",
    force: bool = False,
) -> tuple[int, tuple[Finding, ...]]:
    """Correct text that comes through a pipe until it ends; return samples and what was noticed.

    `source`, `target`: text as the description says, and our own log; `sha256`: fingerprint of the
    result file; `force`: as for `calibrate_log`.
    """
    if not force:
        check_fits(result, description, {})
    follower = Follower(StreamTail(source), description)
    logs, remarks, seen = corrected(result, _coming(follower), sha256, force)
    samples = own.write_text_blocks(logs, target, remarks)
    return samples, (*follower.findings, *seen())


def _coming(follower: Follower) -> Iterator[Log]:
    some = False
    while True:
        log = follower.poll()
        if log is not None:
            some = True
            yield log
        elif follower.tail.ended:
            break
        if not follower.behind and not follower.tail.ended:
            time.sleep(EVERY)
    if not some:
        raise error("log.empty", file=follower.tail.name)


class Corrector:
    """Correct one reading after the other, for a driver or a node.

    `result`: a calibration without functions of temperature; `axes`: of the readings, a key of
    `request.AXES`; `force`: also an unusable result.
    """

    def __init__(self, result: Result, axes: str = OWN_AXES, *, force: bool = False) -> None:
        if result.temperature is not None:
            raise error("temperature.receiver", receiver="A stream of messages")
        code = python_text(request(result, "stream", FAMILIES, axes=axes, force=force))
        names: dict[str, Any] = {}
        exec(compile(code, "calibration", "exec"), names)  # numbers and our own functions alone
        self._single, self._next = names["compensate"], names.get("compensate_next")
        self._before: Any = None
        self._last: float | None = None

    def __call__(self, at: float, accel: Three, gyro: Three) -> tuple[Three, Three]:
        """Return specific force and angular rate without errors, (3,) [m/s^2], [rad/s].

        `at`: time of the reading, of which only differences count [s]; `accel`, `gyro` (3,): as
        read [m/s^2], [rad/s].
        """
        if self._next is None:
            f, w = self._single(accel, gyro)
        else:
            step = 0.0 if self._last is None else at - self._last
            f, w, self._before = self._next(self._before, step, accel, gyro)
            self._last = at
        return f, w

    def message(self, imu: Any) -> Any:
        """Return a `sensor_msgs/Imu`, of rclpy or of rosbags, corrected in place."""
        f, w = imu.linear_acceleration, imu.angular_velocity
        at = imu.header.stamp.sec + 1e-9 * imu.header.stamp.nanosec
        accel, gyro = self(at, (f.x, f.y, f.z), (w.x, w.y, w.z))
        f.x, f.y, f.z = map(float, accel)
        w.x, w.y, w.z = map(float, gyro)
        return imu


def calibrate_bag(
    result: Result,
    bag: str | Path,
    path: str | Path,
    *,
    topic: str | None = None,
    axes: str = BODY,
    force: bool = False,
    progress: Progress | None = None,
) -> int:
    """Write a bag with the readings of one topic corrected, all else as it is; return how many.

    `bag`: of ROS 1 (``.bag``) or ROS 2 (folder, ``.mcap``, ``.db3``); `path`: bag to write, of the
    same kind; `topic` or None: of ``sensor_msgs/Imu``, where there are several; `axes`: of its
    readings; `force`: also an unusable result, and a second time; `progress` or None: called with
    the fraction done.
    """
    bag, path = Path(bag), Path(path)
    if path.exists():
        raise error("output.exists", path=path)
    correct = Corrector(result, axes, force=force)
    with opened_bag(bag) as reader:
        chosen = topic_of_bag(reader, IMU, topic, bag)
        ros1 = not reader.is2
        if (path.suffix == ".bag") != ros1:
            raise error("apply.bag_kind", path=path, kind="ROS 1" if ros1 else "ROS 2",
                        allowed="a name that ends in .bag" if ros1 else "a folder")  # fmt: skip
        if not force and any(c.topic == MARK for c in reader.connections):
            raise error("apply.again", file=bag.name)
        if ros1:
            with atomic(path) as temporary:
                temporary.unlink()
                return _copied(reader, temporary, chosen, correct, progress)
        temporary = path.with_name(f".partial-{secrets.token_hex(8)}-{path.name}")
        try:
            count = _copied(reader, temporary, chosen, correct, progress)
            _unsay(temporary)
            temporary.rename(path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        return count


UNKNOWN = f"RIHS01_{64 * '0'}"
"""What rosbags is told of a type that nobody knows; taken out again, see `_unsay`."""


def _messages(reader: Any) -> Iterator[Any]:
    with reading(reader.paths[0], "ros"):
        yield from reader.messages()


def _copied(
    reader: Any, path: Path, topic: str, correct: Corrector, progress: Progress | None
) -> int:
    store, total, count = reader.typestore, max(1, reader.message_count), 0
    to = store.serialize_cdr if reader.is2 else store.serialize_ros1
    with _writer(reader, path) as writer:
        connections = {c.id: _like(writer, c, store) for c in reader.connections}
        for done, (connection, stamp, data) in enumerate(_messages(reader)):
            if done == 0:
                _mark(writer, stamp, topic, reader.is2)
            if connection.topic == topic:
                with reading(reader.paths[0], "ros"):
                    message = reader.deserialize(data, connection.msgtype)
                data = bytes(to(correct.message(message), connection.msgtype))
                count += 1
            writer.write(connections[connection.id], stamp, data)
            if progress is not None and done % 5000 == 0:
                progress(done / total)
    return count


def _writer(reader: Any, path: Path) -> Any:
    """Return what writes a bag of the same kind and storage."""
    from rosbags import rosbag1, rosbag2

    if not reader.is2:
        return rosbag1.Writer(path)
    (bag,) = reader.paths
    mcap = bag.suffix == ".mcap" or any(bag.glob("*.mcap"))
    plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
    return rosbag2.Writer(path, version=9, storage_plugin=plugin)


def _like(writer: Any, c: Any, store: Any) -> Any:
    """Add a connection like one of the bag that is read."""
    words: dict[str, Any] = {"typestore": store}
    ros2 = hasattr(c.ext, "serialization_format")
    if c.msgdef.data:
        words = {"msgdef": c.msgdef.data, "rihs01" if ros2 else "md5sum": c.digest}
    elif ros2 and c.msgtype not in store.types:  # bags before ROS 2 Iron do not describe types
        words = {"msgdef": "", "rihs01": UNKNOWN}
    names = ("serialization_format", "offered_qos_profiles") if ros2 else ("callerid", "latching")
    words |= {name: getattr(c.ext, name) for name in names}
    return writer.add_connection(c.topic, c.msgtype, **words)


def _unsay(bag: Path) -> None:
    """Take out of a bag of SQLite the descriptions that its writer wants of unknown types."""
    import sqlite3

    metadata = bag / "metadata.yaml"
    said = metadata.read_text(encoding="utf-8")
    if UNKNOWN not in said:
        return
    metadata.write_text(said.replace(UNKNOWN, "''"), encoding="utf-8")
    for file in bag.glob("*.db3"):
        with closing(sqlite3.connect(file)) as base, base:
            unknown = "WHERE type_description_hash = ?"
            base.execute(f"DELETE FROM message_definitions {unknown}", (UNKNOWN,))
            base.execute(f"UPDATE topics SET type_description_hash = '' {unknown}", (UNKNOWN,))


def _mark(writer: Any, stamp: int, topic: str, ros2: bool) -> None:
    """Say in a message of its own which topic is corrected."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/String"
    said = store.types[kind](data=topic)
    data = store.serialize_cdr(said, kind) if ros2 else store.serialize_ros1(said, kind)
    writer.write(writer.add_connection(MARK, kind, typestore=store), stamp, bytes(data))
