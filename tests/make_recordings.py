"""Small recordings as other programs write them: bags of ROS, a log of PX4, sentences."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FloatArray = npt.NDArray[np.float64]

START = 1_700_000_000 * 10**9
"""Stamp of the first message [ns]."""


class Bag:
    """Writes a bag: `.bag` for ROS 1, else a folder of ROS 2."""

    def __init__(self, path: Path, mcap: bool = False) -> None:
        self.ros1 = path.suffix == ".bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            said = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(said, "tf2_msgs/msg/TFMessage"))
        plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        self.writer: Any = (
            Writer1(path) if self.ros1 else Writer2(path, version=9, storage_plugin=plugin)
        )

    def __enter__(self) -> Bag:
        self.writer.__enter__()
        return self

    def __exit__(self, *problem: Any) -> None:
        self.writer.__exit__(*problem)

    def _type(self, name: str) -> Any:
        return self.store.types[name]

    def header(self, stamp: int, frame: str) -> Any:
        said = {"stamp": self._type("builtin_interfaces/msg/Time")(stamp // 10**9, stamp % 10**9),
                "frame_id": frame}  # fmt: skip
        return self._type("std_msgs/msg/Header")(**({"seq": 0} if self.ros1 else {}), **said)

    def vector(self, values: FloatArray) -> Any:
        return self._type("geometry_msgs/msg/Vector3")(*values.tolist())

    def quaternion(self, x: float, y: float, z: float, w: float) -> Any:
        return self._type("geometry_msgs/msg/Quaternion")(x, y, z, w)

    def add(self, topic: str, kind: str, stamps: Any, messages: list[Any]) -> None:
        connection = self.writer.add_connection(topic, kind, typestore=self.store)
        to = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        for stamp, message in zip(stamps, messages, strict=True):
            self.writer.write(connection, int(stamp) + 1_000_000, to(message, kind))

    def imu(self, topic: str, stamps: Any, w: FloatArray, f: FloatArray, empty: str = "") -> None:
        """Add readings in forward-left-up; `empty` is a field that the driver does not fill."""
        kind = "sensor_msgs/msg/Imu"
        covariance = {
            f"{field}_covariance": np.full(9, -1.0 if field == empty else 0.0)
            for field in ("orientation", "angular_velocity", "linear_acceleration")
        }
        messages = [
            self._type(kind)(
                header=self.header(int(stamp), "imu_link"),
                orientation=self.quaternion(0.0, 0.0, 0.0, 1.0),
                angular_velocity=self.vector(w[i]), linear_acceleration=self.vector(f[i]),
                **covariance,
            )
            for i, stamp in enumerate(stamps)
        ]  # fmt: skip
        self.add(topic, kind, stamps, messages)

    def poses(self, topic: str, kind: str, stamps: Any, p: FloatArray, q: FloatArray) -> None:
        """Add positions and attitudes (x, y, z, w), of tf beside another body."""
        point, made_of = self._type("geometry_msgs/msg/Point"), self._type("geometry_msgs/msg/Pose")
        pose = [made_of(point(*a.tolist()), self.quaternion(*b.tolist()))
                for a, b in zip(p, q, strict=True)]  # fmt: skip
        heads = [self.header(int(s), "room") for s in stamps]
        if kind == "geometry_msgs/msg/PoseStamped":
            made = [self._type(kind)(h, x) for h, x in zip(heads, pose, strict=True)]
        elif kind == "geometry_msgs/msg/PoseWithCovarianceStamped":
            cov = self._type("geometry_msgs/msg/PoseWithCovariance")
            made = [self._type(kind)(h, cov(x, np.zeros(36)))
                    for h, x in zip(heads, pose, strict=True)]  # fmt: skip
        else:
            one = self._type("geometry_msgs/msg/TransformStamped")
            turned = self._type("geometry_msgs/msg/Transform")
            made = [one(h, "marker", turned(self.vector(a), self.quaternion(*b.tolist())))
                    for h, a, b in zip(heads, p, q, strict=True)]  # fmt: skip
            if kind == "tf2_msgs/msg/TFMessage":
                other = turned(self.vector(np.zeros(3)), self.quaternion(0.0, 0.0, 0.0, 1.0))
                made = [self._type(kind)([one(x.header, "wand", other), x]) for x in made]
        self.add(topic, kind, stamps, made)

    def odometry(self, topic: str, stamps: Any, q: FloatArray, v: FloatArray, frame: str) -> None:
        """Add attitudes (x, y, z, w) and velocities in the axes of the child."""
        kind, zero, flat = "nav_msgs/msg/Odometry", np.zeros(3), np.zeros(36)
        messages = [
            self._type(kind)(
                header=self.header(int(stamp), frame), child_frame_id="base_link",
                pose=self._type("geometry_msgs/msg/PoseWithCovariance")(
                    self._type("geometry_msgs/msg/Pose")(
                        self._type("geometry_msgs/msg/Point")(0.0, 0.0, 0.0),
                        self.quaternion(*q[i].tolist()),
                    ), flat,
                ),
                twist=self._type("geometry_msgs/msg/TwistWithCovariance")(
                    self._type("geometry_msgs/msg/Twist")(self.vector(v[i]), self.vector(zero)),
                    flat,
                ),
            )
            for i, stamp in enumerate(stamps)
        ]  # fmt: skip
        self.add(topic, kind, stamps, messages)


_TYPES = {"uint64_t": "Q", "uint32_t": "I", "int32_t": "i", "uint16_t": "H", "float": "f"}


def ulog(
    path: Path, messages: dict[str, tuple[str, list[tuple[Any, ...]]]],
    parameters: dict[str, float] | None = None,
) -> None:  # fmt: skip
    """Write a log of PX4: message -> fields as PX4 writes them, rows; its number after a slash."""

    def part(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    out = b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", 0)
    out += part(b"B", bytes(40))
    for name, fields in {n.partition("/")[0]: f for n, (f, _) in messages.items()}.items():
        out += part(b"F", f"{name}:{fields}".encode())
    for name, value in (parameters or {}).items():
        key = f"float {name}".encode()
        out += part(b"P", bytes([len(key)]) + key + struct.pack("<f", value))
    for number, name in enumerate(messages):
        plain, _, multi = name.partition("/")
        out += part(b"A", bytes([int(multi or 0)]) + struct.pack("<H", number) + plain.encode())
    for number, (fields, rows) in enumerate(messages.values()):
        form = "<"
        for field in fields.rstrip(";").split(";"):
            kind, _, count = field.split()[0].partition("[")
            form += _TYPES[kind] * int(count.rstrip("]") or 1)
        for row in rows:
            out += part(b"D", struct.pack("<H", number) + struct.pack(form, *row))
    path.write_bytes(out)


DATAFLASH = {"Q": "Q", "B": "B", "f": "f", "I": "I", "H": "H", "N": "16s", "n": "4s", "Z": "64s",
             "a": "32h"}  # fmt: skip
"""Letter of a type in a log of ArduPilot -> letter of struct."""


def dataflash(path: Path, messages: dict[str, tuple[str, str, list[tuple[Any, ...]]]]) -> None:
    """Write a log of ArduPilot: name -> letters of its types, labels, rows; kinds from 130 on."""
    packed = [(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    forms = {}
    for number, (name, (letters, labels, _)) in enumerate(messages.items(), start=130):
        forms[name] = number, "<" + "".join(DATAFLASH[c] for c in letters)
        packed.append((number, 3 + struct.calcsize(forms[name][1]), name, letters, labels))
    out = b""
    for number, length, *words in packed:
        out += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length,
                                            *(w.encode() for w in words))  # fmt: skip
    rows = [(name, row) for name, (_, _, some) in messages.items() for row in some]
    for name, row in sorted(rows, key=lambda r: r[1][0] if isinstance(r[1][0], int) else 0):
        number, form = forms[name]
        fields = [y for x in row for y in (x if isinstance(x, list) else [x])]
        fields = [x.encode() if isinstance(x, str) else x for x in fields]
        out += b"\xa3\x95" + bytes([number]) + struct.pack(form, *fields)
    path.write_bytes(out)
