"""Readings corrected as they come: a pipe, single messages, a bag, a node."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import re
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from commands import run
from foucault.errors import FoucaultError
from foucault.export.request import AXES, in_axes
from foucault.export.stream import MARK, Corrector, calibrate_bag, calibrate_stream
from foucault.logs import read
from foucault.logs.description import LogDescription
from foucault.result import Result
from foucault.run_folder import save
from foucault.tables import Log
from make_recordings import START, Bag
from make_terms import SIZES, Readings, Same, with_terms
from refusals import refused, refuses

ROOT = Path(__file__).parents[2]
COLUMNS = ["gx", "gy", "gz", "ax", "ay", "az"]
RAW = LogDescription.model_validate({
    "file": "raw.csv",
    "time": {"column": "t", "unit": "s"},
    "gyro": {"columns": COLUMNS[:3], "unit": "rad/s"},
    "accel": {"columns": COLUMNS[3:], "unit": "m/s^2"},
})  # fmt: skip


def raw_text(readings: Readings) -> tuple[str, Log]:
    accel, gyro = readings
    t = np.arange(len(accel)) / 200.0
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, gyro, accel]).tolist()]
    return "\n".join([",".join(["t", *COLUMNS]), *rows, ""]), Log(t, gyro, accel, "rate")


# -- a pipe ------------------------------------------------------------------------------------


@pytest.mark.parametrize("families", [("accel.bias", "gyro.scale", "gyro.bias"), tuple(SIZES)])
def test_a_stream_is_corrected_as_a_file(
    families: tuple[str, ...], readings: Readings, tmp_path: Path, same: Same
) -> None:
    result = with_terms(*families)
    text, log = raw_text(readings)
    out = io.BytesIO()
    samples, _ = calibrate_stream(result, RAW, io.BytesIO(text.encode()), out)
    (tmp_path / "out.csv").write_bytes(out.getvalue())
    got, want = read(LogDescription(file="out.csv"), tmp_path), result.apply(log)
    assert samples == len(log) == len(got)
    same(got.accel, want.accel)
    same(got.gyro, want.gyro)
    assert "foucault.calibrated_by" in out.getvalue().decode()
    with refuses("apply.again"):
        own = LogDescription(file="out.csv")
        calibrate_stream(result, own, io.BytesIO(out.getvalue()), io.BytesIO())
    with refuses("log.empty"):
        calibrate_stream(result, RAW, io.BytesIO(b""), io.BytesIO())


def test_samples_come_out_before_the_stream_ends(
    readings: Readings, tmp_path: Path, linear: Result
) -> None:
    """A line is there soon after it went in, while the pipe is open."""
    text, log = raw_text(readings)
    save(linear, tmp_path / "run")
    campaign = tmp_path / "raw.toml"
    campaign.write_text(
        '[site]\ngravity = "9.81 m/s^2"\n[log]\nfile = "raw.csv"\n'
        'time = { column = "t", unit = "s" }\n'
        'gyro = { columns = ["gx", "gy", "gz"], unit = "rad/s" }\n'
        'accel = { columns = ["ax", "ay", "az"], unit = "m/s^2" }\n'
        '[procedure]\nname = "hand_rotated"\n'
    )
    words = [sys.executable, "-m", "foucault", "apply", tmp_path / "run", campaign, "--stream"]
    env = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(text.encode())
        process.stdin.flush()
        begun = time.monotonic()
        lines = [process.stdout.readline() for _ in range(10)]
        assert time.monotonic() - begun < 60
        assert process.poll() is None
        assert lines[2].startswith(b"time,") or lines[3].startswith(b"time,")
        rest, said = process.communicate()
    assert process.returncode == 0, said
    assert f"{len(log)} samples corrected." in said.decode()
    assert rest


@pytest.mark.parametrize(
    ("words", "code"),
    [(["--stream", "-o", "x.csv"], "-o has no place"),
     (["--stream", "--topic", "/imu"], "--topic has no place"),
     ([], "There is no log to correct, or no -o to write it to.")],
)  # fmt: skip
def test_a_stream_and_files_do_not_mix(
    words: list[str], code: str, tmp_path: Path, linear: Result
) -> None:
    save(linear, tmp_path / "run")
    done = run("apply", tmp_path / "run", *words, code=1)
    assert code in done.stderr


def test_a_topic_of_a_log_that_is_no_bag(linear: Result, tmp_path: Path) -> None:
    save(linear, tmp_path / "run")
    words = ["apply", tmp_path / "run", tmp_path / "raw.csv", "-o", tmp_path / "new.csv"]
    done = run(*words, "--topic", "/imu", "--json")
    assert json.loads(done.stdout)["error"]["code"] == "apply.topic"


# -- messages ----------------------------------------------------------------------------------


def test_single_readings_are_corrected_exactly(
    full: Result, apart: Result, readings: Readings, same: Same
) -> None:
    for axes in AXES:
        correct = Corrector(full, axes)
        C = AXES[axes]
        accel, gyro = (r @ C.T for r in readings)
        pairs = [correct(0.0, a, g) for a, g in zip(accel.tolist(), gyro.tolist(), strict=True)]
        f_s, w_s = in_axes(full.model, C).compensate(accel, gyro)
        same([f for f, _ in pairs], f_s)
        same([w for _, w in pairs], w_s)
    correct = Corrector(apart)  # a first sample has none before it
    first = correct(5.0, *(r[0].tolist() for r in readings))
    second = correct(5.01, *(r[1].tolist() for r in readings))
    assert np.abs(np.array(Corrector(apart)(0.0, *(r[1].tolist() for r in readings)))
                  - np.array(second)).max() > 1e-3  # fmt: skip
    assert first != second


def test_a_bag_becomes_a_bag(readings: Readings, linear: Result, tmp_path: Path) -> None:
    accel, gyro = readings
    stamps = START + np.arange(len(accel)) * 10**7
    C = AXES["forward-left-up"]
    for name, mcap in (("a.bag", False), ("folder", False), ("mcap", True)):
        bag = tmp_path / name
        with Bag(bag, mcap=mcap) as made:
            made.imu("/imu/raw", stamps, gyro @ C.T, accel @ C.T)
            made.odometry("/odometry", stamps[:3], np.tile([0, 0, 0, 1.0], (3, 1)),
                          np.zeros((3, 3)), "map")  # fmt: skip
        out = tmp_path / f"out-{name}"
        assert calibrate_bag(linear, bag, out) == len(accel)
        log = read(LogDescription.model_validate({"file": out.name}), tmp_path)
        f_b, w_b = linear.model.compensate(accel, gyro)
        np.testing.assert_allclose(log.accel, f_b, atol=1e-12 * np.abs(f_b).max())
        np.testing.assert_allclose(log.gyro, w_b, atol=1e-12 * np.abs(w_b).max())
        np.testing.assert_allclose(log.time, stamps * 1e-9, rtol=3e-16)
        kept = [
            (c.topic, at, data) for path in (bag, out) for c, at, data in messages(path)
            if c.topic == "/odometry"
        ]  # fmt: skip
        assert kept[:3] == kept[3:] and len(kept) == 6
        assert [c.topic for c, _, _ in messages(out) if c.topic == MARK] == [MARK]
        with pytest.raises(FoucaultError, match="is calibrated already"):
            calibrate_bag(linear, out, tmp_path / f"again-{name}")
        with pytest.raises(FoucaultError, match="exists already"):
            calibrate_bag(linear, bag, out)
        with refuses("apply.bag_kind"):
            calibrate_bag(linear, bag, tmp_path / ("other" if name == "a.bag" else "other.bag"))
    assert not list(tmp_path.glob(".partial-*"))


def messages(path: Path) -> list[Any]:
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        return [(c, at, bytes(data)) for c, at, data in reader.messages()]


def test_types_that_nobody_describes_stay_as_they_are(
    readings: Readings, linear: Result, tmp_path: Path
) -> None:
    """Bags before ROS 2 Iron hold no definitions, and types of one's own are in no library."""
    accel, gyro = readings
    stamps = START + np.arange(len(accel)) * 10**7
    with Bag(tmp_path / "drive") as made:
        made.imu("/imu", stamps, gyro, accel)
        made.odometry("/own", stamps[:3], np.tile([0, 0, 0, 1.0], (3, 1)), np.zeros((3, 3)), "map")
    metadata = tmp_path / "drive" / "metadata.yaml"
    said = metadata.read_text().replace("nav_msgs/msg/Odometry", "own_msgs/msg/Secret")
    metadata.write_text(re.sub(r"RIHS01_\w+", "''", said))
    (file,) = (tmp_path / "drive").glob("*.db3")
    with closing(sqlite3.connect(file)) as base, base:
        base.execute("DELETE FROM message_definitions")
        base.execute("UPDATE topics SET type_description_hash = ''")
        base.execute("UPDATE topics SET type = 'own_msgs/msg/Secret' WHERE name = '/own'")
    assert calibrate_bag(linear, tmp_path / "drive", tmp_path / "out") == len(accel)
    before, after = (
        [(c.msgtype, at, data) for c, at, data in messages(tmp_path / name) if c.topic == "/own"]
        for name in ("drive", "out")
    )
    assert before == after and len(before) == 3
    assert "RIHS01_00" not in (tmp_path / "out" / "metadata.yaml").read_text()


def test_the_command_writes_a_bag(readings: Readings, linear: Result, tmp_path: Path) -> None:
    accel, gyro = readings
    stamps = START + np.arange(len(accel)) * 10**7
    with Bag(tmp_path / "drive") as made:
        for topic in ("/left", "/right"):
            made.imu(topic, stamps, gyro, accel)
    save(linear, tmp_path / "run")
    words = ["apply", tmp_path / "run", tmp_path / "drive", "-o", tmp_path / "out"]
    done = run(*words, code=1)
    assert "/left, /right" in done.stderr
    done = run(*words, "--topic", "/left", code=0)
    assert "with 50 corrected messages" in done.stdout
    before, after = (messages(tmp_path / name) for name in ("drive", "out"))
    for topic, alike in (("/right", len(accel)), ("/left", 0)):
        old, new = ([data for c, _, data in some if c.topic == topic] for some in (before, after))
        assert sum(a == b for a, b in zip(old, new, strict=True)) == alike


def _damaged(folder: Path) -> None:
    """Write bags that no recorder writes, and one whose second half is missing."""
    with Bag(folder / "whole.bag") as made:
        made.imu("/imu", START + np.arange(5000) * 10**7, np.zeros((5000, 3)), np.ones((5000, 3)))
    whole = (folder / "whole.bag").read_bytes()
    (folder / "half.bag").write_bytes(whole[: len(whole) // 2])
    spoiled = bytearray(whole)
    spoiled[20_000:21_000] = bytes(1000)
    (folder / "spoiled.bag").write_bytes(spoiled)
    for name in ("junk.bag", "junk.mcap"):
        (folder / name).write_bytes(b"\xf6\x00\xff" * 2000)
    (folder / "empty.bag").write_bytes(b"")
    for name, said in (("folder", "a: ["), ("nothing", "")):
        (folder / name).mkdir()
        (folder / name / "metadata.yaml").write_text(said)
    (folder / "other").mkdir()


@pytest.mark.parametrize(
    "name",
    ["half.bag", "spoiled.bag", "junk.bag", "junk.mcap", "empty.bag", "folder", "nothing", "other",
     "none.bag"],
)  # fmt: skip
def test_a_damaged_bag_is_named_and_nothing_is_left(
    name: str, linear: Result, tmp_path: Path
) -> None:
    _damaged(tmp_path)
    before = sorted(tmp_path.iterdir())
    out = "out.bag" if name.endswith(".bag") else "out"
    said = refused(calibrate_bag, linear, tmp_path / name, tmp_path / out)
    assert said.code in ("log.unreadable", "log.missing_file") and name in said.message
    assert sorted(tmp_path.iterdir()) == before


# -- the node ----------------------------------------------------------------------------------


class FakeNode:
    """As much of `rclpy.node.Node` as the node uses."""

    parameters: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, name: str) -> None:
        self.published: list[Any] = []
        self.heard: dict[str, Any] = {}

    def declare_parameter(self, name: str, default: Any) -> Any:
        class Parameter:
            value = self.parameters.get(name, default)

        return Parameter

    def create_publisher(self, kind: Any, topic: str, qos: Any) -> Any:
        class Publisher:
            publish = staticmethod(self.published.append)

        return Publisher

    def create_subscription(self, kind: Any, topic: str, received: Any, qos: Any) -> None:
        self.heard[topic] = received


def test_the_node_corrects_messages(
    readings: Readings, linear: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against the message classes of rosbags, which are those of ROS 2."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    fakes = {"rclpy": {}, "rclpy.node": {"Node": FakeNode}, "sensor_msgs": {},
             "rclpy.qos": {"qos_profile_sensor_data": None},
             "sensor_msgs.msg": {"Imu": store.types["sensor_msgs/msg/Imu"]}}  # fmt: skip
    for name, said in fakes.items():
        module = ModuleType(name)
        vars(module).update(said)
        monkeypatch.setitem(sys.modules, name, module)
    file = ROOT / "examples" / "ros2_imu_node.py"
    spec = importlib.util.spec_from_file_location("ros2_imu_node", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    save(linear, tmp_path / "run")
    FakeNode.parameters = {"run": str(tmp_path / "run")}
    node = module.ImuCorrection()
    C = AXES["forward-left-up"]
    with Bag(tmp_path / "drive") as made:
        made.imu("/imu", START + np.arange(50) * 10**7, *(r @ C.T for r in readings[::-1]))
    with AnyReader([tmp_path / "drive"]) as reader:
        for connection, _, data in reader.messages():
            node.heard["imu/raw"](reader.deserialize(data, connection.msgtype))
    f_b, w_b = linear.model.compensate(*readings)
    got = [[m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z]
           for m in node.published]  # fmt: skip
    np.testing.assert_allclose(got, f_b @ C.T, atol=1e-12 * np.abs(f_b).max())
    assert node.published[7].header.stamp.nanosec == 7 * 10**7
    assert np.abs(w_b @ C.T - [[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z]
                               for m in node.published]).max() < 1e-12 * 10  # fmt: skip
