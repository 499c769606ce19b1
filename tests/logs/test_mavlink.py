"""Telemetry of MAVLink: what pymavlink writes is read, in SI, and damage costs what it hits."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from foucault.logs.mavlink import MESSAGES
from foucault.logs.raw import instruments
from foucault.tables import Log
from make_vehicle import tlog_file

RNG = np.random.default_rng(4)
N = 200
LOGS = [Log(np.arange(N) / 50, RNG.normal(0, 0.1, (N, 3)), RNG.normal([0, 0, 9.8], 0.2, (N, 3)))
        for _ in range(2)]  # fmt: skip


def described(**words: Any) -> LogDescription:
    return LogDescription.model_validate({"file": "flight.tlog", **words})


def test_the_payloads_are_those_of_the_dialect() -> None:
    from pymavlink.dialects.v20 import common

    for number, (name, dtype, extra) in MESSAGES.items():
        known = common.mavlink_map[number]
        assert known.crc_extra == extra
        assert known.msgname.startswith(name.partition("/")[0])
        assert known.unpacker.size == dtype.itemsize


@pytest.mark.parametrize("version", [1, 2])
def test_readings_in_si(version: int, tmp_path: Path) -> None:
    tlog_file(tmp_path / "flight.tlog", LOGS[:version], version=version)
    assert instruments(tmp_path / "flight.tlog") == [f"HIGHRES_IMU/{k}" for k in range(version)]
    log = read(described(topic=f"HIGHRES_IMU/{version - 1}"), tmp_path)
    same = LOGS[version - 1]
    np.testing.assert_allclose(log.accel, same.accel, rtol=2e-7)
    np.testing.assert_allclose(log.gyro, same.gyro, rtol=2e-7, atol=1e-9)
    np.testing.assert_allclose(log.time - log.time[0], same.time, atol=1e-6)
    assert {f.code for f in log.findings} == {"log.declared", "log.telemetry"}


def test_rounded_readings_are_told(tmp_path: Path) -> None:
    tlog_file(tmp_path / "flight.tlog", LOGS, "scaled_imu")
    assert instruments(tmp_path / "flight.tlog") == ["SCALED_IMU/0", "SCALED_IMU/1"]
    log = read(described(topic="SCALED_IMU/1"), tmp_path)
    np.testing.assert_allclose(log.accel, LOGS[1].accel, atol=0.51e-3 * 9.80665)
    np.testing.assert_allclose(log.gyro, LOGS[1].gyro, atol=0.51e-3)
    assert (
        "is whole numbers, at the rate of the link"
        in next(f for f in log.findings if f.code == "log.telemetry").message
    )


def test_raw_readings_want_a_unit(tmp_path: Path) -> None:
    tlog_file(tmp_path / "flight.tlog", LOGS[:1], "raw_imu")
    with pytest.raises(FoucaultError, match="unit"):
        read(described(), tmp_path)
    log = read(described(accel={"unit": "mg"}, gyro={"unit": "mrad/s"}), tmp_path)
    np.testing.assert_allclose(log.accel, LOGS[0].accel, atol=0.51e-3 * 9.80665)


def test_pymavlink_reads_the_same(tmp_path: Path) -> None:
    from pymavlink import mavutil

    path = tmp_path / "flight.tlog"
    tlog_file(path, LOGS)
    rows = []
    other = mavutil.mavlogfile(str(path))
    while (message := other.recv_match(type="HIGHRES_IMU")) is not None:
        if message.id == 1:
            rows.append([message.yacc, message.xacc, -message.zacc])
    other.close()
    np.testing.assert_array_equal(read(described(topic="HIGHRES_IMU/1"), tmp_path).accel, rows)


def test_wrong_checksums_and_lost_bytes_cost_their_packets(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    tlog_file(path, LOGS[:1])
    whole = path.read_bytes()
    third = len(whole) // 3
    flipped = bytearray(whole)
    flipped[third] ^= 4
    for content in (bytes(flipped), whole[:third] + whole[third + 100 :], whole[:-5]):
        path.write_bytes(content)
        log = read(described(missing="drop"), tmp_path)
        assert N - 3 <= len(log) < N
        rows = np.searchsorted(LOGS[0].time, log.time - 1.0 - 1e-7)
        np.testing.assert_allclose(log.accel, LOGS[0].accel[rows], rtol=2e-7)


def test_two_vehicles_and_none(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    from pymavlink.dialects.v20 import common

    out = b""
    for i in range(50):
        for system in (1, 7):
            mav = common.MAVLink(None, srcSystem=system, srcComponent=1)
            packet = mav.highres_imu_encode(20_000 * i, 0, 0, -9.8, *[0.1 * system] * 3,
                                            *[0.0] * 7, 63)  # fmt: skip
            out += struct.pack(">Q", i) + packet.pack(mav)
    path.write_bytes(out)
    assert instruments(path) == ["1:HIGHRES_IMU/0", "7:HIGHRES_IMU/0"]
    log = read(described(topic="7:HIGHRES_IMU/0"), tmp_path)
    np.testing.assert_allclose(log.gyro[:, 0], 0.7, rtol=1e-7)
    beat = mav.heartbeat_encode(2, 3, 0, 0, 0).pack(mav)
    for content in (bytes(8) + beat, b"", bytes(300)):
        path.write_bytes(content)
        with pytest.raises(FoucaultError):
            read(described(), tmp_path)
