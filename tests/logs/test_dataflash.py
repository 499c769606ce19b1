"""Logs of ArduPilot: each IMU, single sensors side by side, and one clear error else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from make_recordings import dataflash
from refusals import refuses

N = 300
RNG = np.random.default_rng(5)
W = RNG.normal(0, 0.1, (2, N, 3)).astype(np.float32)
F = RNG.normal([0, 0, -9.81], 0.2, (2, N, 3)).astype(np.float32)
TICKS = 1_000_000 + np.cumsum(RNG.integers(2400, 2600, N))
TO_B = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
IMU = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
PARM = "QNf", "TimeUS,Name,Value"


def imus(*numbers: int) -> Any:
    rest = (1, 1, 1000, 1000)
    return *IMU, [(int(t), k, *W[k, i].tolist(), *F[k, i].tolist(), 0, 0, 25.0 + k, *rest)
                  for i, t in enumerate(TICKS) for k in numbers]  # fmt: skip


def sensor(kind: str, values: Any, late: int = 0) -> Any:
    labels = "TimeUS,I,SampleUS," + ",".join(f"{kind}{axis}" for axis in "XYZ")
    return "QBQfff", labels, [(int(t) + 500, 0, int(t) + late, *v)
                              for t, v in zip(TICKS, values.tolist(), strict=True)]  # fmt: skip


def described(**words: Any) -> LogDescription:
    return LogDescription.model_validate({"file": "flight.bin", **words})


@pytest.mark.parametrize("number", [0, 1])
def test_each_imu_is_a_log(number: int, tmp_path: Path) -> None:
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0, 1)})
    with refuses("log.several_topics", "IMU/0, IMU/1"):
        read(described(), tmp_path)
    log = read(described(topic=f"IMU/{number}"), tmp_path)
    np.testing.assert_array_equal(log.gyro, W[number].astype(float) @ TO_B.T)
    np.testing.assert_array_equal(log.accel, F[number].astype(float) @ TO_B.T)
    np.testing.assert_array_equal(log.time, TICKS * 1e-6)
    assert log.accel[:, 2].mean() > 9.7
    np.testing.assert_allclose(log.temperature, 298.15 + number)
    assert "forward-right-down" in next(f for f in log.findings if f.code == "log.declared").message


def test_single_sensors_stand_side_by_side(tmp_path: Path) -> None:
    dataflash(tmp_path / "flight.bin", {"GYR": sensor("Gyr", W[0]),
                                        "ACC": sensor("Acc", F[0], late=300)})  # fmt: skip
    log = read(described(), tmp_path)
    np.testing.assert_array_equal(log.gyro, W[0].astype(float) @ TO_B.T)
    np.testing.assert_array_equal(log.accel, F[0].astype(float) @ TO_B.T)
    assert log.sampled == "rate"
    dataflash(tmp_path / "flight.bin", {"GYR": sensor("Gyr", W[0])})
    with pytest.raises(FoucaultError, match="no accelerometer beside GYR/0"):
        read(described(), tmp_path)


def test_what_ardupilot_has_calibrated_is_told(tmp_path: Path) -> None:
    held = [("INS_ACCOFFS_X", 0.1), ("INS_ACCSCAL_X", 1.0), ("INS_GYR2OFFS_Z", 0.01),
            ("INS_ACCSCAL_Y", 0.99), ("INS_GYR_CAL", 1.0)]  # fmt: skip
    parameters = [(1, name, value) for name, value in held]
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0), "PARM": (*PARM, parameters)})
    told = next(f for f in read(described(), tmp_path).findings
                if f.code == "log.ardupilot_calibrated")  # fmt: skip
    assert "3 of which are not zero or one" in told.message
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0), "PARM": (*PARM, parameters[1:2])})
    codes = {f.code for f in read(described(), tmp_path).findings}
    assert "log.ardupilot_calibrated" not in codes


def test_bytes_that_were_lost_cost_what_they_held(tmp_path: Path) -> None:
    file = tmp_path / "flight.bin"
    dataflash(file, {"IMU": imus(0)})
    whole = file.read_bytes()
    at = whole.index(b"\xa3\x95\x82", len(whole) // 2)
    file.write_bytes(whole[: at + 20] + whole[at + 100 : -7])
    log = read(described(), tmp_path)
    assert N - 4 <= len(log) < N
    rows = np.searchsorted(TICKS * 1e-6, log.time)
    np.testing.assert_array_equal(log.gyro, (W[0].astype(float) @ TO_B.T)[rows])


def test_a_log_without_an_imu_or_with_nonsense(tmp_path: Path) -> None:
    file = tmp_path / "flight.bin"
    dataflash(file, {"PARM": (*PARM, [(1, "A", 1.0)])})
    with refuses("log.no_topic"):
        read(described(), tmp_path)
    dataflash(file, {"ATT": ("Qf", "TimeUS,Roll", [(1, 0.0)])})
    for content in (file.read_bytes(), file.read_bytes()[:50], b"\xa3\x95\x80" + bytes(300)):
        file.write_bytes(content)
        with pytest.raises(FoucaultError):
            read(described(), tmp_path)


def test_pymavlink_reads_the_same(tmp_path: Path) -> None:
    reader = pytest.importorskip("pymavlink.DFReader", reason="pymavlink is in no extra")
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0)})
    other = reader.DFReader_binary(str(tmp_path / "flight.bin"))
    rows = []
    while (message := other.recv_match(type="IMU")) is not None:
        rows.append([message.GyrX, message.GyrY, message.GyrZ, message.AccX])
    other.filehandle.close()
    log = read(described(), tmp_path)
    got = np.column_stack([log.gyro @ TO_B, (log.accel @ TO_B)[:, :1]])
    np.testing.assert_array_equal(got, np.array(rows))
