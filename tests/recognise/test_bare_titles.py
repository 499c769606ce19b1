"""Titles of many loggers and languages: sensor, axis, number and unit."""

from __future__ import annotations

import pytest

from foucault.recognise.titles import Meaning, meaning, unit_of, units_row


@pytest.mark.parametrize(
    ("title", "role", "axis", "unit"),
    [
        ("Acc_X", "accel", 0, ""), ("ax", "accel", 0, ""), ("gx", "gyro", 0, ""),
        ("gFx", "accel", 0, ""), ("wz", "gyro", 2, ""), ("gyro_rad[1]", "gyro", 1, "rad"),
        ("accelerometer_m_s2[2]", "accel", 2, "m/s^2"), ("timestamp", "time", None, ""),
        ("accelerometer_timestamp_relative", "other", None, ""),
        ("accelerometerTimestamp_sinceReboot(s)", "time", None, "s"),
        ("gyro_integral_dt", "other", None, ""), ("PacketCounter", "counter", None, ""),
        ("SampleTimeFine", "time", None, ""), ("Mag_X", "mag", 0, ""), ("Roll", "other", None, ""),
        ("field.angular_velocity.x", "gyro", 0, ""),
        ("field.linear_acceleration.z", "linear", 2, ""),
        ("field.linear_acceleration_covariance0", "other", 0, ""),
        ("%time", "time", None, ""), ("seconds_elapsed", "time", None, ""),
        ("Gyroscope X (deg/s)", "gyro", 0, "deg/s"), ("X-Gyro", "gyro", 0, ""),
        ("Absolute acceleration (m/s^2)", "other", None, "m/s^2"), ("xacc", "accel", 0, ""),
        ("Gyro_Phi", "gyro", 0, ""), ("w_b_q", "gyro", 1, ""), ("pitch_rate (deg/s)", "gyro", 1,
                                                                "deg/s"),
        ("p", "gyro", 0, ""), ("DeltaThetaX", "dtheta", 0, ""),
        ("dtheta_x", "dtheta", 0, ""), ("delta_angle_dt", "other", None, ""),
        ("delta_velocity[1]", "dvel", 1, ""),
        ("Beschleunigung Y (m/s²)", "accel", 1, "m/s^2"), ("Drehrate Z [°/s]", "gyro", 2, "deg/s"),
        ("Vitesse angulaire Z (rad/s)", "gyro", 2, "rad/s"), ("加速度X(g)", "accel", 0, "g"),
        ("角速度Y(°/s)", "gyro", 1, "deg/s"), ("X軸加速度", "accel", 0, ""),
        ("Угловая скорость Y", "gyro", 1, ""), ("가속도 X", "accel", 0, ""),
        ("temps (s)", "time", None, "s"), ("temp", "temperature", None, ""),
        ("TimeUS", "time", None, ""), ("GYRO_XOUT", "gyro", 0, ""), ("x", "", None, ""),
        ("field.header.frame_id", "", None, ""), ("p_x_m", "other", 0, "m"),
        ("q_w", "other", None, ""), ("north (mm)", "other", None, "mm"),
    ],
)  # fmt: skip
def test_a_title_means(title, role, axis, unit):
    found = meaning(title)
    assert (found.role, found.axis if role else None, found.unit) == (role, axis, unit)


def test_the_number_of_a_sensor_tells_it_from_another():
    assert meaning("acc1_x").sensor == "1"
    assert meaning("imu2_gyro_y") == Meaning("gyro", 1, "2")


def test_a_logger_that_reads_gravity_is_known_by_its_titles():
    assert meaning("accelerometerAccelerationX(G)").gravity
    assert not meaning("accelerometer_x").gravity


def test_units_as_people_write_them():
    assert [unit_of(u) for u in ("°/s", "m/s²", "(dps)", "LSB", "µs", "furlong")] == [
        "deg/s", "m/s^2", "deg/s", "count", "us", "",
    ]  # fmt: skip
    assert units_row(["ms", "g", "g", "g", "", "-"])
    assert not units_row(["t", "ax", "ay", "az"])
