"""Logs of real instruments, each against what is known about it."""

import gzip

import numpy as np
import pytest

from foucault.logs import LogDescription, read

SEVEN = {"type": "float64", "columns": 7}


def load(folder, **words):
    return read(LogDescription.model_validate(words), folder)


def median_norm(values):
    return np.median(np.linalg.norm(values, axis=1))


@pytest.mark.thorough
def test_xsens_in_two_files_of_counts(real):
    folder = real("xsens_hand_rotated")
    log = load(
        folder,
        time={"column": 0, "unit": "s"},
        gyro={
            "file": "xsens_gyro.mat.gz", "columns": [1, 2, 3], "unit": "count",
            "scale": "4778 count/(rad/s)", "zero": 32500,
        },
        accel={
            "file": "xsens_acc.mat.gz", "columns": [1, 2, 3], "unit": "count",
            "scale": "415 count/(m/s^2)", "zero": 33000, "saturation": [0, 65535],
        },
    )  # fmt: skip
    with gzip.open(folder / "xsens_acc.mat.gz") as a, gzip.open(folder / "xsens_gyro.mat.gz") as g:
        accel, gyro = np.loadtxt(a, max_rows=9000), np.loadtxt(g, max_rows=9000)
        assert sum(1 for line in a if line.strip()) == len(log) - 9000
    some = log[:9000]
    assert np.array_equal(some.time, accel[:, 0])
    assert some.accel == pytest.approx((accel[:, 1:] - 33000) / 415, rel=1e-15)
    assert some.gyro == pytest.approx((gyro[:, 1:] - 32500) / 4778, rel=1e-15)
    assert log.rate == pytest.approx(100.0, rel=1e-3)
    assert log.findings == ()
    assert log.source["file"] == "xsens_gyro.mat.gz + xsens_acc.mat.gz"


@pytest.mark.parametrize("name", ["imu0.log", "imu1.log"])
def test_mpu9150_without_time_and_names(real, name):
    folder = real("mpu9150_hand_rotated")
    words = {
        "file": name,
        "rate": "100 Hz",
        "accel": {"columns": [0, 1, 2], "unit": "m/s^2"},
        "gyro": {"columns": [3, 4, 5], "unit": "rad/s"},
    }
    log = load(folder, **words)
    assert np.array_equal(np.hstack([log.accel, log.gyro]), np.loadtxt(folder / name))
    assert log.duration == pytest.approx(160.0, abs=1.0)
    assert log.findings == ()
    (found,) = load(folder, **words | {"accel": {"columns": [0, 1, 2], "unit": "g"}}).findings
    assert found.cure.endswith('in [log.accel] write unit = "m/s^2".')


def test_ferraris_with_names(real):
    folder = real("ferraris_session")
    log = load(
        folder,
        file="example_ferraris_session.csv",
        rate="102.4 Hz",
        gyro={"unit": "deg/s"},
        accel={"unit": "m/s^2"},
    )
    table = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    assert log.gyro == pytest.approx(np.deg2rad(table[:, 1:4]), rel=1e-14)
    assert np.array_equal(log.accel, table[:, 4:7])
    assert log.findings == ()


def test_ring_laser_increments_in_packed_text(real):
    log = load(
        real("ring_laser_in_vehicle"),
        file="lasergyro_0-900s.imu.gz",
        rate="100 Hz",
        header=14,  # a title of eleven lines and three lines of other numbers
        gyro={"columns": [0, 1, 2], "unit": "0.1 arcsec", "kind": "increment"},
        accel={"columns": [3, 4, 5], "unit": "125 ug*s", "kind": "increment"},
    )
    assert len(log) == 89_996
    assert log.sampled == "increment"
    # Standing: it feels the Earth turn, and gravity within the unknown errors of the sensors.
    turn = np.degrees(np.linalg.norm(log.gyro.mean(axis=0))) * 3600
    assert turn == pytest.approx(15.041, abs=0.1)
    gravity = np.linalg.norm(log.accel.mean(axis=0))
    assert gravity == pytest.approx(9.7965, rel=5e-3)
    (found,) = log.findings  # the header declared ends with a line of six numbers, as samples are
    assert found.code == "log.header_numbers"
    assert "line 14 is one of the 14 lines of the header" in found.message


def test_ln100_binary(real):
    log = load(
        real("ln100_static"),
        file="x_LN100_up.ins",
        record=SEVEN,
        time={"column": 0, "unit": "s"},
        gyro={"columns": [1, 2, 3], "unit": "deg/s"},
        accel={"columns": [4, 5, 6], "unit": "m/s^2"},
    )
    assert (len(log) - 1) / log.duration == pytest.approx(64.055, rel=1e-3)
    turn = np.degrees(np.linalg.norm(log.gyro.mean(axis=0))) * 3600
    assert turn == pytest.approx(14.755, abs=5e-4)
    assert log.accel.mean(axis=0)[0] == pytest.approx(9.81, abs=0.01)
    assert log.findings == ()


def test_simulated_19_positions_binary_float32(real):
    words = {
        "file": "imusysclbt.bin",
        "record": {"type": "float32", "columns": 7},
        "rate": "100 Hz",
        "gyro": {"columns": [0, 1, 2], "unit": "rad", "kind": "increment"},
        "accel": {"columns": [3, 4, 5], "unit": "m/s", "kind": "increment"},
    }
    log = load(real("systematic_19_positions"), **words)
    assert len(log) == 98_200
    assert np.degrees(np.abs(log.gyro).max()) == pytest.approx(10.0, abs=0.02)
    assert median_norm(log.accel) == pytest.approx(9.7964, abs=0.002)
    assert log.findings == ()  # free of noise, which is no fault
    words["gyro"] = {"columns": [0, 1, 2], "unit": "rad/s"}
    words["accel"] = {"columns": [3, 4, 5], "unit": "m/s^2"}
    (found,) = load(real("systematic_19_positions"), **words).findings
    assert 'unit = "m/s" and kind = "increment"' in found.cure


def test_fog_mems_matlab(real):
    log = load(
        real("fog_mems_transfer"),
        file="transfer_align_fog_mems.mat",
        variable="mimu",
        time={"column": 6, "unit": "s"},
        gyro={"columns": [0, 1, 2], "unit": "rad", "kind": "increment"},
        accel={"columns": [3, 4, 5], "unit": "m/s", "kind": "increment"},
    )
    assert len(log) == 10_001
    assert log.rate == pytest.approx(100.0, rel=1e-6)
    assert median_norm(log.accel) == pytest.approx(9.79, abs=0.05)
    assert log.findings == ()
