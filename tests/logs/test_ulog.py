"""Logs of PX4: increments, means and raw sensors in right-forward-up, and one clear error else."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from make_recordings import ulog
from refusals import refuses

N = 200
IMU = ("uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;"
       "uint16_t delta_angle_dt;uint16_t delta_velocity_dt;")  # fmt: skip
COMBINED = "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
SENSOR = "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;float temperature;"
RNG = np.random.default_rng(5)
W = RNG.normal(0, 0.1, (N, 3)).astype(np.float32)
F = RNG.normal([0, 0, -9.81], 0.2, (N, 3)).astype(np.float32)  # specific force points up: -z
TICKS = 1_000_000 + np.cumsum(RNG.integers(4000, 6000, N))
TO_B = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


def described(**words):
    return LogDescription.model_validate({"file": "flight.ulg", **words})


def combined(ticks=TICKS):
    return COMBINED, [(t, *W[i], *F[i]) for i, t in enumerate(ticks)]


def sensor(values, ticks):
    return SENSOR, [(t + 300, t, *v, 25.0) for t, v in zip(ticks, values, strict=True)]


def test_means_are_the_log_of_a_csv_of_the_same_numbers(tmp_path):
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined()})
    log = read(described(), tmp_path)
    rows = np.column_stack([TICKS * 1e-6, W, F]).tolist()
    text = "\n".join(",".join(map(repr, row)) for row in rows)
    (tmp_path / "same.csv").write_text("t,wx,wy,wz,fx,fy,fz\n" + text + "\n")
    same = read(
        LogDescription.model_validate({
            "file": "same.csv", "time": {"column": "t", "unit": "s"},
            "gyro": {"columns": ["wy", "wx", "-wz"], "unit": "rad/s"},
            "accel": {"columns": ["fy", "fx", "-fz"], "unit": "m/s^2"}}),
        tmp_path,
    )  # fmt: skip
    for key in ("time", "gyro", "accel"):
        np.testing.assert_array_equal(getattr(log, key), getattr(same, key), strict=True)
    assert log.sampled == "increment"  # means over each interval
    assert log.accel[:, 2].mean() > 9.7
    told = next(item for item in log.findings if item.code == "log.declared")
    assert "forward-right-down" in told.message


def test_accelerometers_that_px4_calls_invalid_are_missing(tmp_path):
    kind = COMBINED + "int32_t accelerometer_timestamp_relative;"
    invalid = {7: 2**31 - 1, 9: 2**31 - 1}
    rows = [(*row, invalid.get(i, -200)) for i, row in enumerate(combined()[1])]
    ulog(tmp_path / "flight.ulg", {"sensor_combined": (kind, rows)})
    with pytest.raises(FoucaultError) as caught:
        read(described(), tmp_path)
    assert "rows 7, 9" in str(caught.value)
    log = read(described(missing="drop"), tmp_path)
    np.testing.assert_array_equal(log.time, np.delete(TICKS, [7, 9]) * 1e-6)


def test_increments_are_divided_by_their_own_times(tmp_path):
    spans = RNG.integers(3000, 7000, (N, 2))
    rows = [
        (t + 500, t, *(W[i] * np.float32(a * 1e-6)), *(F[i] * np.float32(b * 1e-6)), a, b)
        for i, (t, (a, b)) in enumerate(zip(TICKS, spans, strict=True))
    ]
    ulog(tmp_path / "flight.ulg", {"vehicle_imu": (IMU, rows)})
    log = read(described(), tmp_path)
    np.testing.assert_allclose(log.gyro, W @ TO_B.T, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(log.accel, F @ TO_B.T, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(log.time, TICKS * 1e-6)  # of the sample, not of the message
    assert log.sampled == "increment"
    rows[7] = (*rows[7][:-1], 0)
    ulog(tmp_path / "flight.ulg", {"vehicle_imu": (IMU, rows)})
    with refuses("log.averaged"):
        read(described(), tmp_path)


def test_a_gyro_and_the_accelerometer_beside_it(tmp_path):
    late = TICKS + RNG.integers(-900, 900, N)
    keep = np.delete(np.arange(N), [3, 50])  # two samples of the accelerometer were lost
    messages = {"sensor_gyro/1": sensor(W, TICKS), "sensor_accel/1": sensor(F[keep], late[keep])}
    ulog(tmp_path / "flight.ulg", messages)
    log = read(described(topic="sensor_gyro/1"), tmp_path)
    np.testing.assert_array_equal(log.gyro, W[keep] @ TO_B.T)
    np.testing.assert_array_equal(log.accel, F[keep] @ TO_B.T)
    assert log.temperature[0] == pytest.approx(298.15)
    assert log.sampled == "rate"


def test_sensors_that_are_not_sampled_together(tmp_path):
    ulog(tmp_path / "flight.ulg",
         {"sensor_gyro": sensor(W, TICKS), "sensor_accel": sensor(F[::4], TICKS[::4])})  # fmt: skip
    with refuses("log.unpaired") as caught:
        read(described(), tmp_path)
    assert "25 %" in caught.value.message
    ulog(tmp_path / "flight.ulg", {"sensor_gyro": sensor(W, TICKS)})
    with refuses("log.no_topic"):
        read(described(), tmp_path)


def test_which_message(tmp_path):
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined(), "sensor_gyro": sensor(W, TICKS),
                                   "sensor_accel": sensor(F, TICKS)})  # fmt: skip
    with refuses("log.several_topics") as caught:
        read(described(), tmp_path)
    assert "sensor_combined/0, sensor_gyro/0" in caught.value.message
    assert read(described(topic="sensor_combined"), tmp_path).sampled == "increment"
    with refuses("log.no_topic"):
        read(described(topic="vehicle_imu"), tmp_path)


def test_what_px4_has_taken_off_already_is_told(tmp_path):
    own = {"CAL_GYRO0_XOFF": 0.01, "CAL_ACC0_ZSCALE": 1.0, "CAL_ACC0_YOFF": 0.0}
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined()}, own)
    (told,) = [f for f in read(described(), tmp_path).findings if f.code == "log.px4_calibrated"]
    assert "; 1 of them" in told.message
    ulog(tmp_path / "flight.ulg",
         {"sensor_gyro": sensor(W, TICKS), "sensor_accel": sensor(F, TICKS)}, own)  # fmt: skip
    raw = read(described(), tmp_path)
    assert "log.px4_calibrated" not in [item.code for item in raw.findings]


@pytest.mark.parametrize("part", [0.0, 0.004, 0.02])
def test_a_log_that_was_cut_off_before_its_messages(part, tmp_path):
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined()})
    data = (tmp_path / "flight.ulg").read_bytes()
    (tmp_path / "flight.ulg").write_bytes(data[: int(part * len(data))])
    with pytest.raises(FoucaultError) as caught:
        read(described(), tmp_path)
    assert caught.value.code in ("log.unreadable", "log.no_topic")


def test_a_log_that_ends_in_the_middle_of_a_message_keeps_the_whole_ones(tmp_path):
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined()})
    data = (tmp_path / "flight.ulg").read_bytes()
    (tmp_path / "flight.ulg").write_bytes(data[:-5])  # the battery went: what was written counts
    log = read(described(), tmp_path)
    np.testing.assert_array_equal(log.gyro, W[:-1] @ TO_B.T)


def test_a_log_with_damage_inside(tmp_path, capsys):
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined()})
    data = bytearray((tmp_path / "flight.ulg").read_bytes())
    data[len(data) // 2 : len(data) // 2 + 200] = b"\xff" * 200
    (tmp_path / "flight.ulg").write_bytes(data)
    with pytest.raises(FoucaultError) as caught:
        read(described(), tmp_path)
    assert caught.value.code in ("log.unreadable", "log.missing_value")  # 0xff are NaN in a float
    assert capsys.readouterr().out == ""


def test_without_the_library(tmp_path, monkeypatch):
    ulog(tmp_path / "flight.ulg", {"sensor_combined": combined()})
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with refuses("log.library") as caught:
        read(described(), tmp_path)
    assert 'pip install "foucault[px4]"' in caught.value.cure
