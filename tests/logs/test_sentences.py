"""Sentences of receivers: counts and axes, checksums, and what must be asked for."""

from __future__ import annotations

import zlib
from functools import reduce
from operator import xor

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from foucault.logs import text as sentences
from refusals import refuses

# The examples of the maker's manual, whose checksums are not of our making.
SHORT = (
    "%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,"
    "607017,-1009773*1fb76c28"
)
EXTENDED = (
    "%RAWIMUSXA,2209,491674.014;04,41,2209,491674.013699,ea59fe00,329308016,-2706935,4508389,"
    "196192,417138,-1000837*038422a7"
)
LONG = (
    "#RAWIMUXA,USB1,0,64.5,FINESTEERING,2209,491740.110,02000020,0dc5,16809;04,41,2209,"
    "491740.109817,ea57fe00,329394068,-2396829,4481425,321199,257329,-936077*cf9c035d"
)
SIZES = {"gyro": {"unit": "1e-9 rad", "kind": "increment"},
         "accel": {"unit": "2e-9 m/s", "kind": "increment"}}  # fmt: skip


def novatel(week, seconds, counts):
    said = f"RAWIMUSA,{week},{seconds:.3f};{week},{seconds:.9f},00000077," + ",".join(
        str(int(c)) for c in counts
    )
    return f"%{said}*{zlib.crc32(said.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF:08x}"


def vectornav(values, sum="own"):
    said = "VNIMU," + ",".join(f"{v:+010.6f}" for v in values)
    return f"${said}*{reduce(xor, said.encode()):02X}" if sum == "own" else f"${said}*XX"


@pytest.fixture
def imu(tmp_path):
    """Write lines and read them."""

    def run(lines, name="log.asc", **words):
        (tmp_path / name).write_text("\r\n".join(lines) + "\r\n")
        return read(LogDescription.model_validate({"file": name, **words}), tmp_path)

    return run


@pytest.mark.parametrize("line", [SHORT, EXTENDED, LONG])
def test_the_examples_of_the_manual(line, imu):
    counts = [int(c) for c in line.partition("*")[0].split(",")[-6:]]
    z, y, x, wz, wy, wx = counts
    following = novatel(2209, float(line.partition("*")[0].split(",")[-8]) + 0.01, counts)
    log = imu([line, "$GPGGA,nothing of ours*00", following], **SIZES)
    np.testing.assert_allclose(log.accel, 2e-9 * np.array([[x, -y, z]] * 2) / 0.01, rtol=1e-6)
    np.testing.assert_allclose(log.gyro, 1e-9 * np.array([[wx, -wy, wz]] * 2) / 0.01, rtol=1e-6)
    assert log.sampled == "increment"
    assert "log.declared" in [item.code for item in log.findings]


def test_the_log_of_a_csv_of_the_same_numbers_over_the_end_of_a_week(imu, read_text):
    rng = np.random.default_rng(6)
    counts = rng.integers(-(10**6), 10**6, (100, 6))
    time = [604799.5 + k / 100 for k in range(100)]
    lines = [novatel(2209 + int(t >= 604800), t % 604800, c)
             for t, c in zip(time, counts, strict=True)]  # fmt: skip
    log = imu(lines, **SIZES)
    seconds = [float(f"{t % 604800:.9f}") + 604800.0 * (t >= 604800) for t in time]
    rows = [[repr(t), *map(str, c)] for t, c in zip(seconds, counts, strict=True)]
    same = read_text(
        "t,z,y,x,wz,wy,wx\n" + "\n".join(map(",".join, rows)) + "\n", name="same.csv",
        time={"column": "t", "unit": "s"},
        gyro={"columns": ["wx", "-wy", "wz"], **SIZES["gyro"]},
        accel={"columns": ["x", "-y", "z"], **SIZES["accel"]},
    )  # fmt: skip
    for key in ("time", "gyro", "accel"):
        np.testing.assert_array_equal(getattr(log, key), getattr(same, key), strict=True)


def test_the_size_of_a_count_is_asked_for(imu):
    with refuses("log.open_unit") as caught:
        imu([SHORT])
    assert "[log.gyro]" in caught.value.cure
    with pytest.raises(FoucaultError) as caught:
        imu([SHORT], gyro=SIZES["gyro"])
    assert "[log.accel]" in caught.value.cure


@pytest.mark.parametrize(
    ("bad", "reason"),
    [(SHORT[:-1] + "9", "checksum"), (SHORT[:60], "cut off"), (SHORT.replace("607017", "6o"), "")],
)
def test_a_damaged_sentence(bad, reason, imu):
    good = [novatel(2209, 491600 + k / 100, range(k, k + 6)) for k in range(5)]
    with refuses("log.sentence") as caught:
        imu([*good, bad], **SIZES)
    assert "line 6" in caught.value.message
    assert reason in caught.value.message
    log = imu([*good[:3], bad, *good[3:]], missing="drop", **SIZES)
    assert len(log) == 5
    assert "log.dropped" in [item.code for item in log.findings]


def test_vectornav_in_right_forward_up(imu, monkeypatch):
    monkeypatch.setattr(sentences, "_ROWS", 4)
    rng = np.random.default_rng(2)
    rows = rng.normal(0, 1, (10, 11))
    rows[:, 5] -= 9.8  # specific force points up: minus z
    rows[:, 9] += 25
    rows = np.round(rows, 6)
    log = imu([vectornav(row, "own" if k % 2 else "XX") for k, row in enumerate(rows)],
              rate="40 Hz")  # fmt: skip
    np.testing.assert_array_equal(log.accel, rows[:, [4, 3, 5]] * [1, 1, -1])
    np.testing.assert_array_equal(log.gyro, rows[:, [7, 6, 8]] * [1, 1, -1])
    np.testing.assert_allclose(log.temperature, rows[:, 9] + 273.15, rtol=1e-15)
    np.testing.assert_array_equal(log.time, np.arange(10) / 40)
    assert log.accel[:, 2].mean() > 8


def test_vectornav_has_no_time(imu):
    with refuses("log.no_time"):
        imu([vectornav(range(11))])


def test_no_sentence_of_ours(imu):
    with refuses("log.no_topic"):
        imu(["$GPGGA,1,2,3*00"], format="novatel")


def test_corrected_readings_are_refused_by_name(imu):
    """Less gravity, the Earth's rate and what a filter believes the errors to be."""
    row = "%CORRIMUDATASA,1581,341553.000;1581,341552.9975,-6e-7,-1e-6,1e-6,6e-5,-1e-5,-2e-5*0"
    with refuses("log.no_topic", "CORRIMUDATA"):
        imu(50 * [row])
