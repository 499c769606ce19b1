"""Bytes of a log as each instrument sends them, and as prints of programs that nobody described."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import reduce

import numpy as np

from foucault.tables import Log
from make_frames import mavlink
from make_live import frames


def sbg(log: Log) -> bytes:
    return b"".join(frames(log))


def _rows(log: Log):
    return enumerate(zip(log.time.tolist(), log.accel, log.gyro, strict=True))


def xsens(log: Log) -> bytes:
    out = b""
    for _, (t, f, w) in _rows(log):
        items = struct.pack(">HBI", 0x1060, 4, round(1e4 * t))
        items += struct.pack(">HB3f", 0x4020, 12, *f) + struct.pack(">HB3f", 0x8020, 12, *w)
        body = struct.pack(">BBB", 0xFF, 0x36, len(items)) + items
        out += b"\xfa" + body + bytes([-sum(body) & 0xFF])
    return out


def novatel(log: Log) -> bytes:
    out, dt = b"", log.interval
    for _, (t, f, w) in _rows(log):
        body = struct.pack("<Id6d", 2300, 1000.0 + t, *(w * dt), *(f * dt))
        raw = b"\xaa\x44\x12" + struct.pack("<BHBBHHBBHIIHH", 28, 812, 0, 0, len(body), 0, 0, 0,
                                            2300, 100000, 0, 0, 0) + body  # fmt: skip
        out += raw + struct.pack("<I", zlib.crc32(raw, 0xFFFFFFFF) ^ 0xFFFFFFFF)
    return out


def adis(log: Log) -> bytes:
    out = b""
    for k, (_, f, w) in _rows(log):
        counts = [*np.round(np.degrees(w) * 40), *np.round(f / 9.80665 * 800)]
        words = struct.pack(">H6hhH", 0, *(int(x) for x in counts), 251, k & 0xFFFF)
        out += words + struct.pack(">H", sum(words))
    return out


def _vehicle(x: np.ndarray) -> tuple[float, ...]:
    return float(x[1]), float(x[0]), -float(x[2])


def highres(log: Log) -> bytes:
    return b"".join(
        mavlink(105, 93, struct.pack("<Q13fH", round(1e6 * t) + 1, *_vehicle(f), *_vehicle(w),
                                     *[0.0] * 7, 63), k)
        for k, (t, f, w) in _rows(log)
    )  # fmt: skip


def scaled(log: Log) -> bytes:
    def whole(x: np.ndarray, unit: float) -> list[int]:
        return [round(a / unit) for a in _vehicle(x)]

    return b"".join(
        mavlink(26, 170, struct.pack("<I9h", round(1e3 * t) + 1, *whole(f, 9.80665e-3),
                                     *whole(w, 1e-3), 0, 0, 0), k)
        for k, (t, f, w) in _rows(log)
    )  # fmt: skip


def _sentence(body: str) -> str:
    return f"${body}*{reduce(int.__xor__, body.encode()):02X}\r\n"


def vnimu(log: Log) -> bytes:
    out = ""
    for _, (_, f, w) in _rows(log):
        f, w = _vehicle(f), _vehicle(w)
        out += _sentence(f"VNIMU,+00.2,+00.1,-00.4,{f[0]:+07.3f},{f[1]:+07.3f},{f[2]:+07.3f},"
                         f"{w[0]:+010.6f},{w[1]:+010.6f},{w[2]:+010.6f},+20.7,+84.322")  # fmt: skip
    return out.encode()


def vnymr(log: Log) -> bytes:
    out = ""
    for _, (_, f, w) in _rows(log):
        f, w = _vehicle(f), _vehicle(w)
        out += _sentence(f"VNYMR,+1.0,+2.0,+3.0,+00.2,+00.1,-00.4,{f[0]:+07.3f},{f[1]:+07.3f},"
                         f"{f[2]:+07.3f},{w[0]:+010.6f},{w[1]:+010.6f},{w[2]:+010.6f}")  # fmt: skip
    return out.encode()


SENT: dict[str, Callable[[Log], bytes]] = {
    "sbg_imu_short": sbg, "xsens_mtdata2": xsens, "novatel_corrimudata": novatel,
    "adis16470_burst": adis, "mavlink2_highres_imu": highres, "mavlink2_scaled_imu": scaled,
    "vectornav_vnimu": vnimu, "vectornav_vnymr": vnymr,
}  # fmt: skip


def arduino(log: Log) -> bytes:
    """Named cells, milliseconds, m/s^2 and deg/s."""
    return "".join(
        f"t:{round(1e3 * t)} ax:{f[0]:.4f} ay:{f[1]:.4f} az:{f[2]:.4f} "
        f"gx:{w[0]:.3f} gy:{w[1]:.3f} gz:{w[2]:.3f} T:25.10\r\n"
        for _, (t, f, w) in ((k, (t, f, np.degrees(w))) for k, (t, f, w) in _rows(log))
    ).encode()


def sentences(log: Log) -> bytes:
    """Sentences with a checksum, gyros before accelerometers, in rad/s and g."""
    out = ""
    for k, (t, f, w) in _rows(log):
        cells = [f"{x:.6f}" for x in (*w, *(f / 9.80665))]
        body = f"PIMU,{t:.3f},{','.join(cells)}"
        out += f"${body}*{reduce(int.__xor__, body.encode()):02X}\r\n"
        if k % 20 == 0:
            out += "$GPGGA,1,2,3*00\r\n"
    return out.encode()


def counts(log: Log) -> bytes:
    """Counts of a usual converter behind a tabulator, without a time."""
    return "".join(
        "\t".join(str(round(x)) for x in (*(f / 9.80665 * 8192), *(np.degrees(w) * 65.5))) + "\n"
        for _, (_, f, w) in _rows(log)
    ).encode()


PRINTED = {"arduino": arduino, "sentences": sentences, "counts": counts}
