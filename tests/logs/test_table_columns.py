"""Columns of a table, rows that are means, and several instruments in one file."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, by_serial, follow, read, write
from foucault.logs.reading import serials
from foucault.tables import TableColumns
from refusals import refuses

HEAD = "t,gx,gy,gz,ax,ay,az"
BLOCKS = {
    "time": {"column": "t", "unit": "s"},
    "gyro": {"columns": ["gx", "gy", "gz"], "unit": "deg/s"},
    "accel": {"columns": ["ax", "ay", "az"], "unit": "g"},
}


def rows(n, more=lambda k: ""):
    """Return `n` lines of a log at 100 Hz, with more columns."""
    rng = np.random.default_rng(3)
    lines = []
    for k in range(n):
        w, f = rng.normal(0, 0.1, 3), rng.normal([0, 0, 1], 0.001)
        cells = [k / 100, *w, *f]
        lines.append(",".join(f"{x:.6f}" for x in cells) + more(k))
    return "\n".join(lines)


def test_table_columns_are_read_in_si(read_text):
    text = f"{HEAD},mid,out,rate,pos\n" + rows(
        6, lambda k: f",90,{k * 36},-10,{k // 3 if k else ''}"
    )
    table = {"columns": ["-out", "mid", ""], "unit": "deg", "rate": "rate", "rate_unit": "deg/s",
             "position": "pos"}  # fmt: skip
    log = read_text(text, **BLOCKS, table=table)
    np.testing.assert_allclose(log.table.angles[:, 0], -np.radians(36) * np.arange(6))
    np.testing.assert_allclose(log.table.angles[:, 1], np.pi / 2)
    assert np.isnan(log.table.angles[:, 2]).all()
    np.testing.assert_allclose(log.table.rate, -np.radians(10))
    assert log.table.position.tolist() == [-1, 0, 0, 1, 1, 1]
    assert log.table.position.dtype == np.int64


@pytest.mark.parametrize(
    ("table", "code"),
    [
        ({}, "log.table_empty"),
        ({"columns": ["a", "b"], "unit": "deg"}, "log.table_columns"),
        ({"columns": ["a", "b", "c"]}, "log.table_unit"),
        ({"rate": "a", "unit": "deg"}, "log.table_unit"),
        ({"columns": ["a", "b", "c"], "unit": "deg/s"}, "unit.kind"),
    ],
)
def test_table_block_that_cannot_be_used_is_refused(table, code):
    with refuses(code):
        LogDescription.model_validate({"file": "a.csv", "table": table})


def test_position_must_be_a_whole_number(read_text):
    text = f"{HEAD},pos\n" + rows(4, lambda k: f",{k / 2}")
    with refuses("log.position_number", match=r"0\.5 is not a whole number"):
        read_text(text, **BLOCKS, table={"position": "pos"})


@pytest.fixture
def table_log(log):
    """The noisy log with everything a table can tell, one axis missing."""
    n = len(log)
    angles = np.column_stack([np.arange(n) * 0.01, np.full(n, 0.5), np.full(n, np.nan)])
    position = np.repeat([0, -1, 1, 2, 3], n // 5)
    return replace(log, table=TableColumns(angles, np.full(n, 0.1), position))


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet", ".npz"])
def test_own_files_keep_the_table_columns(tmp_path, table_log, suffix):
    write(table_log, tmp_path / f"log{suffix}")
    again = read(LogDescription(file=f"log{suffix}"), tmp_path)
    np.testing.assert_array_equal(again.table.angles, table_log.table.angles)
    np.testing.assert_array_equal(again.table.rate, table_log.table.rate)
    np.testing.assert_array_equal(again.table.position, table_log.table.position)
    np.testing.assert_array_equal(again.accel, table_log.accel)
    assert again.averaged is None


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_own_files_keep_that_rows_are_means(tmp_path, table_log, suffix):
    few = replace(table_log[:40], averaged=np.linspace(10, 20, 40))
    write(few, tmp_path / f"log{suffix}")
    again = read(LogDescription(file=f"log{suffix}"), tmp_path)
    np.testing.assert_array_equal(again.averaged, few.averaged)
    np.testing.assert_array_equal(again.time, few.time)
    (block,) = follow.blocks(LogDescription(file=f"log{suffix}"), tmp_path)
    np.testing.assert_array_equal(block.averaged, few.averaged)


def test_blocks_carry_the_table_columns(tmp_path, table_log, monkeypatch):
    monkeypatch.setattr(follow, "BLOCK_ROWS", 64)
    write(table_log, tmp_path / "log.csv")
    parts = list(follow.blocks(LogDescription(file="log.csv"), tmp_path))
    assert len(parts) == 8
    position = np.concatenate([part.table.position for part in parts])
    np.testing.assert_array_equal(position, table_log.table.position)
    np.testing.assert_array_equal(
        np.concatenate([part.table.angles for part in parts]), table_log.table.angles
    )


MEANS = {key: BLOCKS[key] for key in ("gyro", "accel")}


def test_means_need_no_time_and_are_not_checked_as_samples(read_text):
    # Equal rows, and far apart: a stuck axis, a doubled row and gaps if these were samples.
    line = "0,0,0.0042,0,0,1.0001,"
    text = "gx,gy,gz,ax,ay,az,len\n" + "\n".join(line + s for s in ["60"] * 12 + ["30"])
    log = read_text(text, **MEANS, averaged={"column": "len", "unit": "s"})
    np.testing.assert_array_equal(log.averaged, [60.0] * 12 + [30.0])
    np.testing.assert_array_equal(log.time, np.arange(13) * 60.0)
    assert log.findings == ()


def test_means_may_run_backward_in_time(read_text):
    text = f"{HEAD},len\n" + "\n".join(f"{t},0,0,0,0,0,1,2" for t in (30, 10, 20))
    log = read_text(text, **BLOCKS, averaged={"column": "len", "unit": "min"})
    np.testing.assert_array_equal(log.averaged, 120.0)
    np.testing.assert_array_equal(log.time, [30, 10, 20])


def test_sums_over_a_position_are_divided_by_its_time(read_text):
    text = "gx,gy,gz,ax,ay,az,len\n0,0,360,0,0,98.0665,10\n0,0,720,0,0,196.133,20"
    log = read_text(
        text,
        gyro={**BLOCKS["gyro"], "unit": "deg", "kind": "increment"},
        accel={**BLOCKS["accel"], "unit": "m/s", "kind": "increment"},
        averaged={"column": "len", "unit": "s"},
    )
    np.testing.assert_allclose(log.gyro[:, 2], np.radians(36), rtol=1e-15)
    np.testing.assert_allclose(log.accel[:, 2], 9.80665, rtol=1e-15)
    assert log.sampled == "rate"


def test_means_in_a_wrong_unit_are_still_told(read_text):
    text = "gx,gy,gz,ax,ay,az,len\n" + "\n".join(["0,0,0,0,0,9.81,60"] * 3)
    log = read_text(text, **MEANS, averaged={"column": "len", "unit": "s"})
    assert [f.code for f in log.findings] == ["log.accel_unit"]


@pytest.mark.parametrize("length", ["0", "-5"])
def test_means_over_no_time_are_refused(read_text, length):
    text = f"gx,gy,gz,ax,ay,az,len\n0,0,0,0,0,1,60\n0,0,0,0,0,1,{length}"
    with refuses("log.averaged", "row 1"):
        read_text(text, **MEANS, averaged={"column": "len", "unit": "s"})


def fleet(order, n=50):
    """Return a text with rows of several instruments and the log each must give."""
    rng = np.random.default_rng(5)
    count = dict.fromkeys(order, 0)
    lines, want = [], {name: [] for name in count}
    for name in order:
        for _ in range(n):
            f = rng.normal([0, 0, 1], 0.001)
            t = count[name] / 100
            count[name] += 1
            lines.append(f"{name},{t},0,0,0," + ",".join(map(repr, f.tolist())))
            want[name].append(f * 9.80665)
    return "serial," + HEAD + "\n" + "\n".join(lines), {k: np.array(v) for k, v in want.items()}


@pytest.mark.parametrize(
    "order",
    [["007", "B-2", "C"], ["A", "B", "A", "C", "B", "A"], ["only"]],
    ids=["in turn", "mixed", "one"],
)
@pytest.mark.parametrize("rows_of_block", [7, 10_000])
def test_every_instrument_gets_its_own_log(tmp_path, order, rows_of_block, monkeypatch):
    text, want = fleet(order)
    (tmp_path / "fleet.csv").write_text(text)
    from foucault.logs import text

    monkeypatch.setattr(text, "BLOCK_BYTES", 60 * rows_of_block)
    description = LogDescription.model_validate({"file": "fleet.csv", **BLOCKS, "serial": "serial"})
    got = dict(by_serial(description, tmp_path))
    assert got.keys() == want.keys() == set(serials(description, tmp_path))
    for name, log in got.items():
        np.testing.assert_allclose(log.accel, want[name], rtol=1e-12)
        assert log.source["serial"] == name
        assert {f.code for f in log.findings} == {"log.stuck"}  # its gyros, not its rows


def test_instruments_of_a_parquet_file(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    n = 30
    serial = ["u7", "u8", "u9"] * n
    accel = np.arange(3.0 * n)
    columns = {"serial": serial, "len": [10.0] * 3 * n, "x": 0 * accel, "y": 0 * accel, "z": accel}
    parquet.write_table(pa.table(columns), tmp_path / "fleet.parquet", row_group_size=16)
    description = LogDescription.model_validate(
        {"file": "fleet.parquet", "serial": "serial", "averaged": {"column": "len", "unit": "s"},
         "accel": {"columns": ["x", "y", "z"], "unit": "m/s^2"}}
    )  # fmt: skip
    for k, (name, log) in enumerate(by_serial(description, tmp_path)):
        assert name == f"u{k + 7}"
        np.testing.assert_array_equal(log.accel[:, 2], accel[k::3])
        np.testing.assert_array_equal(log.time, 10.0 * np.arange(n))


def test_serial_numbers_may_be_a_column_of_numbers_in_a_binary_format(tmp_path):
    data = np.column_stack([np.repeat([3, 5], 20), np.tile(np.arange(20) / 100, 2),
                            np.random.default_rng(1).normal(9.8, 0.1, (40, 3))])  # fmt: skip
    np.save(tmp_path / "fleet.npy", data)
    description = LogDescription.model_validate(
        {"file": "fleet.npy", "serial": 0, "time": {"column": 1, "unit": "s"},
         "accel": {"columns": [2, 3, 4], "unit": "m/s^2"}}
    )  # fmt: skip
    got = dict(by_serial(description, tmp_path))
    assert list(got) == ["3", "5"]
    np.testing.assert_array_equal(got["5"].accel, data[20:, 2:])


def test_one_broken_instrument_does_not_stop_the_others(tmp_path):
    text, _ = fleet(["A", "B", "C"])
    lines = text.split("\n")
    lines[60] = "B,0.09,0,0,0,,,"  # values are missing
    (tmp_path / "fleet.csv").write_text("\n".join(lines))
    description = LogDescription.model_validate({"file": "fleet.csv", **BLOCKS, "serial": "serial"})
    got = dict(by_serial(description, tmp_path))
    assert isinstance(got["B"], FoucaultError)
    assert got["B"].code == "log.missing_value"
    assert len(got["A"]) == len(got["C"]) == 50


def test_several_instruments_are_not_one_log(tmp_path):
    text, _ = fleet(["A", "B"])
    (tmp_path / "fleet.csv").write_text(text)
    words = {"file": "fleet.csv", **BLOCKS, "serial": "serial"}
    with refuses("log.several_serials", "A, B"):
        read(LogDescription.model_validate(words), tmp_path)
    (tmp_path / "fleet.csv").write_text(fleet(["A"])[0])
    assert len(read(LogDescription.model_validate(words), tmp_path)) == 50


def test_serial_numbers_need_a_column_and_one_file(tmp_path):
    (tmp_path / "fleet.csv").write_text(fleet(["A"])[0])
    with refuses("log.no_serial"):
        next(by_serial(LogDescription.model_validate({"file": "fleet.csv", **BLOCKS}), tmp_path))
    two = {
        "time": BLOCKS["time"],
        "serial": "serial",
        "gyro": {**BLOCKS["gyro"], "file": "a.csv"},
        "accel": {**BLOCKS["accel"], "file": "b.csv"},
    }
    with refuses("log.serial_files"):
        next(by_serial(LogDescription.model_validate(two), tmp_path))


FLEET = """
import json, sys
import pyarrow.csv, pydantic
from foucault.logs import LogDescription, by_serial
def peak():
    with open("/proc/self/status") as lines:
        return next(1024 * int(l.split()[1]) for l in lines if l.startswith("VmHWM"))
columns = {"time": {"column": "t", "unit": "s"}, "accel": {"columns": ["x", "y", "z"], "unit": "g"}}
words = {"file": sys.argv[1], "serial": "s", **columns}
before, count = peak(), 0
for serial, log in by_serial(LogDescription.model_validate(words)):
    count += len(log)
print(json.dumps([count, peak() - before]))
"""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
def test_a_fleet_one_after_the_other_takes_the_memory_of_one(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    def peak(units, rows=20_000):
        rng = np.random.default_rng(2)
        file = tmp_path / f"fleet{units}.parquet"
        columns = {"s": np.repeat([f"u{k}" for k in range(units)], rows)}
        columns["t"] = np.tile(np.arange(rows) / 100, units)
        columns |= {axis: rng.normal(0, 1, units * rows).round(5) for axis in "xyz"}
        parquet.write_table(pa.table(columns), file)
        command = [sys.executable, "-c", FLEET, str(file)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        count, memory = json.loads(done.stdout)
        assert count == units * rows
        return memory

    # The difference of two sizes leaves out what pyarrow takes for its buffers once.
    more = peak(180) - peak(60)
    assert more < 0.5 * 120 * 20_000 * 4 * 8  # far less than the rows that it read more


ENDS = ("end", "start")
FRACTION = {"start": 0.0, "middle": 0.5, "end": 1.0}


def turning(stamped, at, gap=False, speed=100.0):
    """1 Hz increments on a table that turns; the angle is read at an instant of the interval."""
    lines = ["t,ax,ay,az,out,rate"]
    for k in range(12):
        start = float(k) + 5.0 * (gap and k > 5)  # five rows are missing
        angle = (10.0 + speed * (start + FRACTION[at])) % 360.0
        lines.append(f"{start + FRACTION[stamped]:.1f},0,0,9.8,{angle:.6f},{speed}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize("at", ["start", "middle", "end"])
@pytest.mark.parametrize("stamped", ENDS)
def test_the_instant_that_a_table_angle_belongs_to(read_text, stamped, at, gap):
    table = {"columns": ["out", "", ""], "unit": "deg", "stamped": at}
    words = {
        "time": {"column": "t", "unit": "s"},
        "accel": {"columns": ["ax", "ay", "az"], "unit": "m/s", "kind": "increment"},
        "stamped": stamped,
    }
    log = read_text(turning(stamped, at, gap), **words, table=table)
    off = log.table.angles[:, 0] - np.radians(10.0 + 100.0 * log.time)
    np.testing.assert_allclose(np.angle(np.exp(1j * off)), 0.0, atol=1e-6)
    assert np.isnan(log.table.angles[:, 1:]).all()
    description = LogDescription.model_validate({"file": "log.csv", **words, "table": table})
    assert description.apart == FRACTION[stamped] - FRACTION[at]


def test_an_angle_of_another_instant_that_turns_more_than_half_a_turn_in_a_row(read_text):
    words = {
        "time": {"column": "t", "unit": "s"},
        "accel": {"columns": ["ax", "ay", "az"], "unit": "m/s", "kind": "increment"},
    }
    table = {"columns": ["out", "", ""], "unit": "deg", "stamped": "middle", "rate": "rate",
             "rate_unit": "deg/s"}  # fmt: skip
    log = read_text(turning("end", "middle", speed=250.0), **words, table=table)
    off = log.table.angles[:, 0] - np.radians(10.0 + 250.0 * log.time)
    np.testing.assert_allclose(np.angle(np.exp(1j * off)), 0.0, atol=1e-6)


def test_blocks_and_the_whole_log_agree_on_angles_of_another_instant(tmp_path, monkeypatch):
    (tmp_path / "log.csv").write_text(turning("end", "middle"))
    description = LogDescription.model_validate({
        "file": "log.csv", "time": {"column": "t", "unit": "s"},
        "accel": {"columns": ["ax", "ay", "az"], "unit": "m/s", "kind": "increment"},
        "table": {"columns": ["out", "", ""], "unit": "deg", "stamped": "middle"},
    })  # fmt: skip
    monkeypatch.setattr(follow, "BLOCK_ROWS", 5)
    parts = [block.table.angles[:, 0] for block in follow.blocks(description, tmp_path)]
    assert len(parts) == 3
    whole = read(description, tmp_path).table.angles[:, 0]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
