"""Bags of ROS: the same log as the same numbers in a CSV, and one clear error else."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, follow, master, read
from foucault.logs import formats as ros
from foucault.logs import pose as poses
from foucault.logs.description import description_of
from foucault.logs.master import MasterDescription
from foucault.logs.pose import PoseDescription
from foucault.models.rotation import matrix_of
from make_recordings import START, Bag
from refusals import refuses

ROWS = 300
FORMS = ("imu.bag", "sqlite", "mcap", "sqlite/sqlite.db3", "mcap/mcap.mcap")


def described(name, **words):
    return LogDescription.model_validate({"file": name, **words})


@pytest.fixture(scope="module")
def readings():
    rng = np.random.default_rng(3)
    stamps = START + np.arange(ROWS) * 5_000_000 + rng.integers(0, 1000, ROWS)
    w, f = rng.normal(0, 0.1, (ROWS, 3)), rng.normal([0, 0, 9.81], 0.2, (ROWS, 3))
    return stamps, w, f


@pytest.fixture(scope="module")
def folder(readings, tmp_path_factory):
    stamps, w, f = readings
    folder = tmp_path_factory.mktemp("bags")
    for name in ("imu.bag", "sqlite", "mcap"):
        with Bag(folder / name, mcap=name == "mcap") as bag:
            bag.imu("/imu/data", stamps, w, f)
    seconds = [float(s // 10**9 + 1e-9 * (s % 10**9)) for s in stamps.tolist()]
    rows = (",".join(map(repr, r)) for r in np.column_stack([seconds, w, f]).tolist())
    (folder / "same.csv").write_text("t,wx,wy,wz,fx,fy,fz\n" + "\n".join(rows) + "\n")
    return folder


@pytest.fixture(scope="module")
def same(folder):
    return read(
        described("same.csv", time={"column": "t", "unit": "s"},
                  gyro={"columns": ["-wy", "wx", "wz"], "unit": "rad/s"},
                  accel={"columns": ["-fy", "fx", "fz"], "unit": "m/s^2"}),
        folder,
    )  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_a_bag_is_the_log_of_a_csv_of_the_same_numbers(name, folder, same):
    log = read(described(name), folder)
    for key in ("time", "gyro", "accel"):
        np.testing.assert_array_equal(getattr(log, key), getattr(same, key), strict=True)
    assert log.sampled == "rate"
    (told,) = (item for item in log.findings if item.code == "log.declared")
    assert "/imu/data" in told.message
    assert "x = -y, y = x, z = z" in told.message


def test_a_bag_alone_needs_no_description(folder):
    alone, told = description_of(folder / "imu.bag")
    assert told == ()
    assert alone.gyro is None


def test_a_folder_has_the_fingerprint_of_what_is_in_it(folder):
    prints = {read(described(name), folder).source["sha256"] for name in ("sqlite", "mcap")}
    assert len(prints) == 2
    assert {len(p) for p in prints} == {64}


def test_what_a_campaign_gives_takes_the_place_of_what_the_format_declares(folder, readings):
    # A driver that keeps to other axes and counts rates in deg/s, against the standard.
    columns = [f"angular_velocity.{a}" for a in "xyz"]
    log = read(described("imu.bag", gyro={"columns": columns, "unit": "deg/s"}), folder)
    np.testing.assert_allclose(log.gyro, np.radians(readings[1]), rtol=1e-15)
    assert log.accel is not None
    assert len(read(described("imu.bag", rate="200 Hz"), folder)) == ROWS
    late = read(described("imu.bag", time={"column": "recorded", "unit": "s"}), folder)
    assert late.time[0] == pytest.approx(readings[0][0] * 1e-9 + 1e-3, abs=1e-6)


def test_a_long_bag_comes_in_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(ros, "_ROWS", 16)
    monkeypatch.setattr(follow, "BLOCK_ROWS", 32)
    rng = np.random.default_rng(1)
    with Bag(tmp_path / "long.bag") as bag:
        bag.imu("/imu", START + np.arange(100) * 10**7, rng.normal(size=(100, 3)),
                rng.normal(size=(100, 3)))  # fmt: skip
    told = []
    parts = list(follow.blocks(described("long.bag"), tmp_path, told.append))
    assert [len(part) for part in parts] == [32, 32, 32, 4]
    whole = read(described("long.bag"), tmp_path)
    np.testing.assert_array_equal(np.concatenate([part.gyro for part in parts]), whole.gyro)
    assert told[0] < told[-1] <= 1.0


def test_which_topic(tmp_path, readings):
    stamps, w, f = (x[:5] for x in readings)
    with Bag(tmp_path / "two.bag") as bag:
        bag.imu("/front", stamps, w, f)
        bag.imu("/rear", stamps, -w, f)
    with refuses("log.several_topics") as caught:
        read(described("two.bag"), tmp_path)
    assert "/front, /rear" in caught.value.message
    assert 'topic = "/front"' in caught.value.cure
    rear = read(described("two.bag", topic="/rear"), tmp_path)
    np.testing.assert_array_equal(rear.gyro[:, 2], -w[:, 2])
    with refuses("log.no_topic") as caught:
        read(described("two.bag", topic="/raer"), tmp_path)
    assert "/rear (sensor_msgs/msg/Imu)" in caught.value.message


def test_a_field_that_the_driver_does_not_fill(tmp_path, readings):
    stamps, w, f = (x[:5] for x in readings)
    with Bag(tmp_path / "gyros.bag") as bag:
        bag.imu("/gyros", stamps, w, f, empty="linear_acceleration")
    log = read(described("gyros.bag"), tmp_path)
    assert log.accel is None
    assert log.gyro is not None


@pytest.mark.parametrize("name", ["imu.bag", "sqlite/sqlite.db3", "mcap/mcap.mcap"])
@pytest.mark.parametrize("part", [0.0, 0.3, 0.95])
def test_a_bag_that_was_cut_off(name, part, folder, tmp_path):
    data = (folder / name).read_bytes()
    cut = tmp_path / Path(name).name
    cut.write_bytes(data[: int(part * len(data))])
    with pytest.raises(FoucaultError) as caught:
        read(described(cut.name), tmp_path)
    assert caught.value.code in ("log.unreadable", "log.empty", "log.no_topic")
    assert cut.name in str(caught.value)


def test_an_empty_topic(tmp_path):
    with Bag(tmp_path / "none.bag") as bag:
        bag.imu("/imu", [], np.empty((0, 3)), np.empty((0, 3)))
    with refuses("log.empty"):
        read(described("none.bag"), tmp_path)


def test_without_the_library(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with refuses("log.library") as caught:
        read(described("imu.bag"), folder)
    assert 'pip install "foucault[ros]"' in caught.value.cure


def test_a_folder_that_is_no_bag(tmp_path):
    (tmp_path / "folder").mkdir()
    with refuses("log.missing_file"):
        read(described("folder"), tmp_path)


# -- a master ----------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", ["map", "odom"])
def test_odometry_is_a_master(frame, tmp_path):
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(4)
    heading, pitch, roll = rng.uniform(-3, 3, 20), rng.uniform(-1, 1, 20), rng.uniform(-3, 3, 20)
    C_nb = matrix_of(heading, pitch, roll)
    velocity = rng.normal(size=(20, 3))
    # forward, left, up in the columns of right, forward, up
    C_nf = C_nb @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    with Bag(tmp_path / "odom.bag") as bag:
        q = Rotation.from_matrix(C_nf).as_quat()
        v = np.einsum("nij,ni->nj", C_nf, velocity)
        bag.odometry("/odom", START + np.arange(20) * 10**8, q, v, frame)
    table = master.read(MasterDescription.model_validate({"file": "odom.bag"}), tmp_path)
    np.testing.assert_allclose(table.C_nb, C_nb, atol=1e-14)
    np.testing.assert_allclose(table.velocity_n, velocity, atol=1e-14)
    np.testing.assert_allclose(table.time, START * 1e-9 + np.arange(20) * 0.1, atol=1e-6)
    codes = [item.code for item in table.findings]
    assert ("log.master_frame" in codes) == (frame == "odom")
    assert "log.declared" in codes


# -- poses ---------------------------------------------------------------------------------------


def posed(**words):
    return PoseDescription.model_validate(words)


@pytest.mark.parametrize("name", ["poses.bag", "sqlite", "mcap"])
@pytest.mark.parametrize("kind", [
    "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped", "tf2_msgs/msg/TFMessage",
])  # fmt: skip
def test_poses_of_a_bag_are_those_that_were_recorded(kind, name, tmp_path):
    rng = np.random.default_rng(5)
    p, q = rng.normal(size=(60, 3)), rng.normal(size=(60, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    with Bag(tmp_path / name, mcap=name == "mcap") as bag:
        bag.poses("/pose", kind, START + np.arange(60) * 10**7, p, q)
    child = "marker" if kind.startswith("tf2") else None
    table = poses.read(posed(file=name, child=child), tmp_path)
    np.testing.assert_array_equal(table.position, p)
    np.testing.assert_array_equal(table.quaternion, q[:, [3, 0, 1, 2]])
    assert table.reading == "w x y z, body to world"
    np.testing.assert_allclose(np.diff(table.time), 0.01, atol=1e-6)


def test_odometry_is_a_pose_and_transforms_need_a_child(tmp_path):
    q = np.tile([0.0, 0.0, 0.0, 1.0], (60, 1))
    stamps, p = START + np.arange(60) * 10**7, np.arange(180.0).reshape(60, 3)
    with Bag(tmp_path / "odom.bag") as bag:
        bag.odometry("/odom", stamps, q, p, "room")
    with refuses("pose.few"):  # it stands where it was: the last pose repeated
        poses.read(posed(file="odom.bag"), tmp_path)
    with Bag(tmp_path / "tf.bag") as bag:
        bag.poses("/tf", "tf2_msgs/msg/TFMessage", stamps, p, q)
        bag.odometry("/odom", stamps, q, p, "room")
    with refuses("log.several_topics"):
        poses.read(posed(file="tf.bag"), tmp_path)
    for child in (None, "elsewhere"):
        with refuses("pose.frames"):
            poses.read(posed(file="tf.bag", topic="/tf", child=child), tmp_path)
    found = poses.read(posed(file="tf.bag", topic="/tf", child="marker"), tmp_path)
    np.testing.assert_array_equal(found.position, p)
