"""The file of a vehicle with several IMUs, which rests and is turned by hand: known errors."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault.models.imu import ImuModel
from foucault.models.rotation import exp
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import Log
from make_recordings import START, Bag, dataflash, ulog
from make_session import quiet_session

TO_FRD = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
NOISE = 2e-3, 2e-4
"""Scatter of single readings, accelerometers and gyros [SI]."""

IMU = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"


def imus(
    count: int = 2, seed: int = 1, rate: float = 100.0
) -> tuple[list[Log], list[ImuModel], list[Any]]:
    """Return what each IMU reads [SI], its errors, and how it lies in the first, C_0k."""
    truth, rng = quiet_session(rate).log, np.random.default_rng(seed)
    logs, models, turns = [], [], []
    for k in range(count):
        C_0k = exp(np.radians([1.0, -2.0, 1.5]) * k)
        model = draw_errors("mems", 100 * seed + k)
        accel, gyro = model.measure(truth.accel @ C_0k, truth.gyro @ C_0k)
        noise = [rng.normal(0, sd, accel.shape) for sd in NOISE]
        logs.append(replace(truth, accel=accel + noise[0], gyro=gyro + noise[1]))
        models.append(model)
        turns.append(C_0k)
    return logs, models, turns


OFFS, SCAL, GYRO = np.array([0.3, -0.2, 0.5]), np.array([1.02, 0.97, 0.99]), 0.01 * np.arange(3)
"""What an autopilot may have calibrated itself, forward-right-down [SI]."""


def bin_file(path: Path, logs: list[Log], single: bool = False, own: bool = False) -> None:
    """Write a log of ArduPilot, with `single` readings of each sensor too.

    `own`: with offsets and scale factors of the autopilot taken off, and among its parameters.
    """
    rest = (0, 0, 25.0, 1, 1, 1000, 1000)
    parameters = [(1, "AHRS_ORIENTATION", 0.0)]
    if own:
        logs = [replace(log, accel=((log.accel @ TO_FRD.T - OFFS) * SCAL) @ TO_FRD,
                        gyro=log.gyro - GYRO @ TO_FRD) for log in logs]  # fmt: skip
        parameters += [
            (1, f"INS_{key}_{axis}", float(x))
            for k in ("", "2", "3")[: len(logs)]
            for key, values in ((f"ACC{k}OFFS", OFFS), (f"ACC{k}SCAL", SCAL), (f"GYR{k}OFFS", GYRO))
            for axis, x in zip("XYZ", values, strict=True)
        ]
    rows = [
        (round(1e6 * t) + 10**6, k, *(TO_FRD @ log.gyro[i]), *(TO_FRD @ log.accel[i]), *rest)
        for i, t in enumerate(logs[0].time)
        for k, log in enumerate(logs)
    ]
    more = {}
    for kind, at in (("Gyr", 2), ("Acc", 5)) if single else ():
        labels = "TimeUS,I,SampleUS," + ",".join(f"{kind}{axis}" for axis in "XYZ")
        more[kind.upper()] = "QBQfff", labels, [(*r[:2], r[0], *r[at : at + 3]) for r in rows]
    dataflash(path, {"PARM": ("QNf", "TimeUS,Name,Value", parameters), "IMU": (*IMU, rows), **more})


def ulg_file(path: Path, logs: list[Log]) -> None:
    """Write a log of PX4 with increments of each IMU."""
    fields = (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;"
        "float[3] delta_velocity;uint16_t delta_angle_dt;uint16_t delta_velocity_dt;"
    )
    dt = float(np.median(np.diff(logs[0].time)))
    said = round(1e6 * dt)
    ulog(path, {
        f"vehicle_imu/{k}": (fields, [
            (at, at, *(TO_FRD @ log.gyro[i] * dt), *(TO_FRD @ log.accel[i] * dt), said, said)
            for i, t in enumerate(log.time) for at in [round(1e6 * t) + 10**6]])
        for k, log in enumerate(logs)})  # fmt: skip


def tlog_file(path: Path, logs: list[Log], message: str = "highres_imu", version: int = 2) -> None:
    """Write telemetry of MAVLink with HIGHRES_IMU of each IMU, or other messages, by pymavlink."""
    from importlib import import_module

    dialect = import_module(f"pymavlink.dialects.v{version}0.common")
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    out = b""
    for i, t in enumerate(logs[0].time):
        at = round(1e6 * t) + 10**6
        packets = [mav.heartbeat_encode(2, 3, 0, 0, 0)] if i % 50 == 0 else []
        for k, log in enumerate(logs):
            f, w = TO_FRD @ log.accel[i], TO_FRD @ log.gyro[i]
            whole = [round(x) for x in [*(f / 9.80665e-3), *(w / 1e-3)]]
            if message == "highres_imu":
                packets.append(mav.highres_imu_encode(at, *f, *w, *[0.0] * 6, 20.0, 63,
                                                      *([k] if version == 2 else [])))  # fmt: skip
            elif message == "raw_imu":
                packets.append(
                    mav.raw_imu_encode(at, *whole, 0, 0, 0, *([k] if version == 2 else []))
                )
            else:
                name = f"scaled_imu{k + 1 if k else ''}_encode"
                packets.append(getattr(mav, name)(at // 1000, *whole, 0, 0, 0))
        for packet in packets:
            out += struct.pack(">Q", at) + packet.pack(mav)
    path.write_bytes(out)


def bag_file(path: Path, logs: list[Log], mcap: bool = False) -> None:
    """Write a bag with a topic of each IMU."""
    to_flu = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    with Bag(path, mcap) as bag:
        for k, log in enumerate(logs):
            stamps = START + np.round(1e9 * log.time).astype(int)
            bag.imu(f"/imu{k}", stamps, log.gyro @ to_flu.T, log.accel @ to_flu.T)
