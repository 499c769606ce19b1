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
    assert "2 of them are not zero or one" in told.message  # the third is of the other gyro
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0), "PARM": (*PARM, parameters[1:2])})
    codes = {f.code for f in read(described(), tmp_path).findings}
    assert "log.ardupilot_calibrated" not in codes


HELD = [("AHRS_ORIENTATION", 0.0), ("INS_ACCOFFS_X", 0.1), ("INS_ACCOFFS_Z", -0.2),
        ("INS_ACCSCAL_Y", 0.99), ("INS_GYROFFS_Y", 0.01), ("INS_ACC2SCAL_X", 1.01),
        ("INS_GYR2OFFS_Z", -0.02), ("INS4_ACCOFFS_Y", 0.3), ("INS_TCAL1_ENABLE", 0.0)]  # fmt: skip


@pytest.mark.parametrize("number", [0, 1])
def test_what_ardupilot_took_off_is_put_back(number: int, tmp_path: Path) -> None:
    off, scale, gyro = ([[0.1, 0, -0.2], [0, 0, 0]], [[1, 0.99, 1], [1.01, 1, 1]],
                        [[0, 0.01, 0], [0, 0, -0.02]])  # fmt: skip
    raw_f, raw_w = F[number].astype(float), W[number].astype(float)
    y = (raw_f - off[number]) * scale[number]
    rows = [
        (int(t), number, *w, *f, 0, 0, 25.0, 1, 1, 1000, 1000)
        for t, w, f in zip(TICKS, (raw_w - gyro[number]).tolist(), y.tolist(), strict=True)
    ]
    parameters = [(1, name, value) for name, value in HELD]
    dataflash(tmp_path / "flight.bin", {"IMU": (*IMU, rows), "PARM": (*PARM, parameters)})
    log = read(described(), tmp_path)
    np.testing.assert_allclose(log.accel, raw_f @ TO_B.T, atol=3e-6)
    np.testing.assert_allclose(log.gyro, raw_w @ TO_B.T, atol=3e-8)
    told = next(f for f in log.findings if f.code == "log.ardupilot_undone")
    assert f"{4 if number == 0 else 2} offsets and scale factors" in told.message
    assert f"IMU/{number} were put back" in told.message
    kept = read(described(own_calibration="keep"), tmp_path)
    np.testing.assert_array_equal(kept.accel, y.astype(np.float32).astype(float) @ TO_B.T)
    assert "log.ardupilot_calibrated" in {f.code for f in kept.findings}


@pytest.mark.parametrize(
    "more",
    [("AHRS_ORIENTATION", 6.0), ("INS_TCAL1_ENABLE", 1.0), ("INS_ACCOFFS_X", 0.15),
     ("INS_ACCSCAL_Y", -1.0)],
)  # fmt: skip
def test_what_is_not_known_for_certain_is_not_put_back(
    more: tuple[str, float], tmp_path: Path
) -> None:
    """Another orientation, a calibration over temperature, a value that changed in flight."""
    parameters = [(1, name, value) for name, value in [*HELD, more]]
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0), "PARM": (*PARM, parameters)})
    log = read(described(), tmp_path)
    np.testing.assert_array_equal(log.accel, F[0].astype(float) @ TO_B.T)
    assert "log.ardupilot_calibrated" in {f.code for f in log.findings}


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


def batches(*said: tuple[int, int, int, Any]) -> Any:
    """Batches as the sampler writes them: number, type, instance and samples (32 k, 3) of each."""
    heads, data = [], []
    for number, kind, instance, samples in said:
        at = 10_000_000 + 150_000 * number
        heads.append((at, number, kind, instance, MUL[kind], len(samples), at, 1000.0))
        data += [(at + 1 + k, number, k, *samples[32 * k : 32 * k + 32].T.tolist())
                 for k in range(len(samples) // 32)]  # fmt: skip
    return {"ISBH": ("QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate", heads),
            "ISBD": ("QHHaaa", "TimeUS,N,seqno,x,y,z", data)}  # fmt: skip


MUL = {0: 208, 1: 938}


def test_batches_are_samples_over_their_multiplier(tmp_path: Path) -> None:
    """As pymavlink's tools/isb_extract.py has it: value = sample / mul, SampleUS + k / smp_rate."""
    accel = RNG.normal([0, 0, -2040], 20, (2, 64, 3)).astype(int)
    gyro = RNG.normal(0, 20, (96, 3)).astype(int)
    said = batches((7, 0, 0, accel[0]), (8, 1, 0, gyro), (9, 0, 0, accel[1]), (10, 0, 1, accel[0]))
    dataflash(tmp_path / "flight.bin", said)
    with pytest.raises(FoucaultError) as caught:
        read(described(), tmp_path)
    assert "ISBD.accel/0, ISBD.accel/1, ISBD.gyro/0" in str(caught.value)
    log = read(described(topic="ISBD.accel/0"), tmp_path)
    np.testing.assert_allclose(log.accel, np.concatenate(accel) / 208 @ TO_B.T, rtol=1e-15)
    starts = np.repeat([11.05, 11.35], 64)
    np.testing.assert_allclose(log.time, starts + np.tile(np.arange(64) / 1000, 2), rtol=1e-12)
    assert log.gyro is None
    log = read(described(topic="ISBD.gyro/0"), tmp_path)
    np.testing.assert_allclose(log.gyro, gyro / 938 @ TO_B.T, rtol=1e-15)
    assert log.accel is None
    # The usual readings come first where a log has both.
    dataflash(tmp_path / "flight.bin", {"IMU": imus(0), **said})
    assert read(described(), tmp_path).gyro is not None


def test_a_batch_with_a_hole_is_left_out(tmp_path: Path) -> None:
    gyro = RNG.normal(0, 20, (3, 96, 3)).astype(int)
    said = batches(*((n, 1, 0, gyro[n]) for n in range(3)))
    rows = said["ISBD"][2]
    for gone in (4, 5, 3):  # of the second batch: from the middle, the end, the beginning
        some = {**said, "ISBD": (*said["ISBD"][:2], rows[:gone] + rows[gone + 1 :])}
        dataflash(tmp_path / "flight.bin", some)
        log = read(described(), tmp_path)
        want = np.concatenate([gyro[0], gyro[2]]) / 938 @ TO_B.T
        np.testing.assert_allclose(log.gyro, want, rtol=1e-15)
    headless = {**said, "ISBH": (*said["ISBH"][:2], said["ISBH"][2][1:])}
    dataflash(tmp_path / "flight.bin", headless)
    assert len(read(described(), tmp_path)) == 192


def test_pymavlink_reads_the_same(tmp_path: Path) -> None:
    from pymavlink.DFReader import DFReader_binary

    dataflash(tmp_path / "flight.bin", {"IMU": imus(0)})
    other = DFReader_binary(str(tmp_path / "flight.bin"))
    rows = []
    while (message := other.recv_match(type="IMU")) is not None:
        rows.append([message.GyrX, message.GyrY, message.GyrZ, message.AccX])
    other.filehandle.close()
    log = read(described(), tmp_path)
    got = np.column_stack([log.gyro @ TO_B, (log.accel @ TO_B)[:, :1]])
    np.testing.assert_array_equal(got, np.array(rows))
