"""Frames of instruments, spelled out byte by byte with checksums by their definition."""

from __future__ import annotations

import struct
import zlib


def crc_bitwise(data: bytes, poly: int, init: int, bits: int, reflected: bool) -> int:
    """The definition, bit by bit, of a register that shifts left."""
    value = init
    for byte in data:
        for k in range(8):
            bit = byte >> k & 1 if reflected else byte >> (7 - k) & 1
            top = value >> (bits - 1) & 1
            value = (value << 1) & ((1 << bits) - 1)
            if top ^ bit:
                value ^= poly
    return int(f"{value:0{bits}b}"[::-1], 2) if reflected else value


def kermit(data: bytes) -> bytes:
    return struct.pack("<H", crc_bitwise(data, 0x1021, 0, 16, True))


def sbg(k: int, high: bool = False) -> tuple[bytes, tuple[float, ...]]:
    f, w = (1000 * k + 1, -2000, 10283000), (-5, 7 + k, 1 << 20)
    status = 1 << 10 if high else 0
    body = struct.pack("<BBHIH3i3ih", 44, 0, 32, 5000 * k, status, *f, *w, 6400)
    divide = 12304174 if high else 67108864
    row = (5000.0 * k, status, *(x / 1048576 for x in f), *(x / divide for x in w), 25.0)
    return b"\xff\x5a" + body + kermit(body) + b"\x33", row


def xsens(k: int, double: bool = False) -> tuple[bytes, tuple[float, ...]]:
    f, w, code = (0.5 * k, -1.25, 9.75), (0.125, -0.5, 2.0 * k), "d" if double else "f"
    more = 3 if double else 0
    items = struct.pack(">HBI", 0x1060, 4, 50 * k)
    items += struct.pack(f">HB3{code}", 0x4020 + more, struct.calcsize(f">3{code}"), *f)
    items += struct.pack(f">HB3{code}", 0x8020 + more, struct.calcsize(f">3{code}"), *w)
    items += struct.pack(">HBf", 0x0810, 4, 31.5)
    raw = b"\xff\x36" + bytes([len(items)]) + items
    return b"\xfa" + raw + bytes([-sum(raw) & 0xFF]), (5000.0 * k, *f, *w, 31.5)


def novatel(k: int, number: int = 812) -> tuple[bytes, tuple[float, ...]]:
    w, f = (1e-5 * k, -2e-5, 3e-5), (0.01, 0.02 * k, 0.098)
    body = struct.pack("<Id6d", 2300, 100.0 + 0.005 * k, *w, *f)
    head = b"\xaa\x44\x12" + struct.pack("<BHBBHHBBHIIHH", 28, number, 0, 0, len(body), 0, 0, 0,
                                         2300, 100000, 0, 0, 0)  # fmt: skip
    raw = head + body
    check = zlib.crc32(raw, 0xFFFFFFFF) ^ 0xFFFFFFFF
    return raw + struct.pack("<I", check), (2300.0, 100.0 + 0.005 * k, *w, *f)


def adis(k: int) -> tuple[bytes, tuple[float, ...]]:
    w, f = (40, -80, 4 * (k % 1000)), (-800, 400, 799)
    words = struct.pack(">H3h3hhH", 0, *w, *f, 251, k & 0xFFFF)
    row = (0.0, *(x / 40 for x in w), *(x / 800 for x in f), 25.1, float(k))
    return words + struct.pack(">H", sum(words)), row


MADE = {"sbg_imu_short": sbg, "xsens_mtdata2": xsens, "novatel_corrimudata": novatel,
        "adis16470_burst": adis}  # fmt: skip


def mavlink(number: int, extra: int, payload: bytes, k: int) -> bytes:
    """A packet of version 2 of system 1, zeros at the end of its payload left out."""
    payload = payload.rstrip(b"\0") or b"\0"
    head = bytes([len(payload), 0, 0, k & 255, 1, 1]) + number.to_bytes(3, "little")
    check = crc_bitwise(head + payload + bytes([extra]), 0x1021, 0xFFFF, 16, True)
    return b"\xfd" + head + payload + struct.pack("<H", check)


def highres(k: int) -> tuple[bytes, tuple[float, ...]]:
    f, w = (0.5, -0.25 * k, -9.75), (0.125, 0.0, 0.0)
    payload = struct.pack("<Q13fH", 5000 * k, *f, *w, *[0.0] * 7, 0)
    return mavlink(105, 93, payload, k), (5000.0 * k, *f, *w)


def scaled(k: int) -> tuple[bytes, tuple[float, ...]]:
    f, w = (10, -20 * (k % 50), -1000), (5, 0, 0)
    payload = struct.pack("<I9h", 5 * k, *f, *w, 0, 0, 0)
    return mavlink(26, 170, payload, k), (5.0 * k, *f, *(x / 1000 for x in w))


MADE |= {"mavlink2_highres_imu": highres, "mavlink2_scaled_imu": scaled}

SENTENCES: dict[str, list[tuple[str, tuple[float, ...]]]] = {
    "vectornav_vnimu": [
        ("$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,"
         "+00.002066,-00.008442,-00.044656,+20.7,+084.322*66",
         (-0.015, 0.019, 9.948, 0.002066, -0.008442, -0.044656, 20.7)),
    ],
    "vectornav_vnymr": [
        ("$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,"
         "-01.258,-00.100,-09.701,-00.000018,+00.001122,-00.000551*69",
         (-1.258, -0.1, -9.701, -0.000018, 0.001122, -0.000551)),
        ("$VNYMR,-078.104,+005.642,+023.096,+00.0125,+00.1252,-00.1042,"
         "+00.878,-03.762,-08.854,-00.010387,-00.028062,-00.061305*68",
         (0.878, -3.762, -8.854, -0.010387, -0.028062, -0.061305)),
        ("$VNYMR,-004.328,+001.357,+178.257,+00.2219,-00.0720,+00.4652,"
         "+00.226,-00.321,+10.043,-00.001188,+00.001866,-00.007661*6C",
         (0.226, -0.321, 10.043, -0.001188, 0.001866, -0.007661)),
    ],
}  # fmt: skip
"""Sentences that instruments have sent, and their rows."""
