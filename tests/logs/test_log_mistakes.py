"""Every mistake a file or its description can hold gives one error, and its words help."""

import gzip

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, checks, follow, read
from foucault.symptoms import SYMPTOMS
from refusals import refuses

HEAD = "t,gx,gy,gz,ax,ay,az"
WORDS = {
    "time": {"column": "t", "unit": "s"},
    "gyro": {"columns": ["gx", "gy", "gz"], "unit": "deg/s"},
    "accel": {"columns": ["ax", "ay", "az"], "unit": "g"},
}


def lines(n=20):
    rng = np.random.default_rng(1)
    out = []
    for i in range(n):
        values = [0.01 * i, *rng.normal(0, 0.1, 3), *rng.normal([0, 0, 1], 0.01)]
        out.append(",".join(f"{v:.6f}" for v in values))
    return out


def cells(row, column, value):
    """Put `value` into one cell of good lines."""
    good = lines()
    parts = good[row].split(",")
    parts[column] = value
    good[row] = ",".join(parts)
    return good


def refused(read_text, rows, code, *parts, head=HEAD, **words):
    text = "\n".join([head, *rows] if head else rows) + "\n"
    with refuses(code) as caught:
        read_text(text, **{**WORDS, **words})
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize("cell", ["#N/A", "1.#QNAN", "-1.#IND", "#DIV/0!", "%"])
def test_no_number_that_looks_like_a_comment_is_named(read_text, cell):
    refused(
        read_text, cells(8, 2, cell), "log.not_numeric", f"line 10, column 'gy': '{cell}' is not"
    )
    refused(read_text, cells(8, 6, f"0.1,{cell},1"), "log.ragged", "columns instead of 7")


def test_a_point_where_the_comma_is_the_decimal_sign(read_text):
    rows = [line.replace(",", ";").replace(".", ",") for line in lines()]
    rows[8] = rows[8].replace(",", ".", 1)
    said = "'0.080000' is not a number. The comma is taken for"
    refused(read_text, rows, "log.not_numeric", said, head=HEAD.replace(",", ";"), decimal=",")


def test_good_lines_are_good(read_text):
    log = read_text("\n".join([HEAD, *lines()]), **WORDS)
    assert len(log) == 20
    assert log.findings == ()


def test_missing_file_names_what_is_there(tmp_path):
    (tmp_path / "session.csv").write_text("")
    (tmp_path / "sesion.txt").write_text("")
    with refuses("log.missing_file", "sesion.csv' does not exist. The folder has") as caught:
        read(LogDescription.model_validate({"file": "sesion.csv", **WORDS}), tmp_path)
    assert "session.csv" in str(caught.value)
    with pytest.raises(FoucaultError, match="is a folder, not a file"):
        read(LogDescription.model_validate({"file": ".", **WORDS}), tmp_path)
    with pytest.raises(FoucaultError, match="does not exist"):
        read(LogDescription.model_validate({"file": "no/where.csv", **WORDS}), tmp_path)


def test_unknown_column(read_text):
    gyro = {"columns": ["gx", "gyy", "gz"], "unit": "deg/s"}
    refused(
        read_text, lines(), "log.unknown_column", "'log.csv' has no column 'gyy'.",
        "Did you mean 'gy'?", "The columns are t, gx, gy, gz, ax, ay, az.", "[log.gyro]",
        gyro=gyro,
    )  # fmt: skip


def test_column_number_beyond_the_last(read_text):
    gyro = {"columns": [1, 2, 7], "unit": "deg/s"}
    refused(
        read_text, lines(), "log.unknown_column", "no column '7'", "numbered 0 to 6",
        gyro=gyro, time={"column": 0, "unit": "s"}, head=None,
    )  # fmt: skip


def test_columns_that_cannot_be_guessed(read_text):
    refused(
        read_text, lines(), "log.cannot_guess", "'log.csv' has 7 unnamed columns",
        "columns = [1, 2, 3] in [log.gyro]", gyro={"unit": "deg/s"}, head=None,
        time={"column": 0, "unit": "s"},
    )  # fmt: skip
    refused(
        read_text, lines(), "log.cannot_guess", "none has a usual name of accel",
        accel={"unit": "g"}, head="t,gx,gy,gz,k,l,m",
    )  # fmt: skip


def test_ragged_line(read_text):
    short = lines()
    short[4] = short[4].rpartition(",")[0]
    refused(read_text, short, "log.ragged", "'log.csv' line 6 has 6 columns instead of 7")
    long = lines()
    long[9] += ",3.0"
    refused(read_text, long, "log.ragged", "line 11 has 8 columns instead of 7")
    refused(
        read_text, [row.replace(",", "  ") for row in short], "log.ragged",
        "line 6 has 6 columns instead of 7", head=HEAD.replace(",", " "),
    )  # fmt: skip


def test_title_line_with_another_count(read_text):
    refused(
        read_text, lines(), "log.header_count", "names 6 columns, but line 2",
        head="t,gx,gy,gz,ax,ay",
    )  # fmt: skip


def test_truncated_last_line(read_text):
    cut = lines()
    cut[-1] = cut[-1][:20]
    refused(
        read_text, cut, "log.truncated", "ends in the middle of line 21, with 3 of 7 columns",
        "Delete the last line",
    )  # fmt: skip
    with refuses("log.truncated"):
        read_text("\n".join([HEAD, *lines()])[:-8] + "-", **WORDS)


def test_cell_that_is_not_a_number(read_text):
    refused(
        read_text, cells(7, 5, "0.0l"), "log.not_numeric",
        "'log.csv' line 9, column 'ay': '0.0l' is not a number.",
    )  # fmt: skip
    rows = [row.replace(",", ";").replace(".", ",") for row in lines()]
    refused(read_text, rows, "log.not_numeric", 'write decimal = ","', head=HEAD.replace(",", ";"))
    rows = cells(7, 5, '"-1,000.25"')
    refused(
        read_text, rows, "log.not_numeric", "'-1,000.25' is not a number. Write thousands without"
    )


def test_zero_bytes_in_the_first_lines_are_no_text(tmp_path):
    (tmp_path / "log.csv").write_text("\0\n".join([HEAD, *lines()]))
    with pytest.raises(FoucaultError, match=r"zero bytes in its first lines.* Save it as UTF-8"):
        read(LogDescription.model_validate({"file": "log.csv", **WORDS}), tmp_path)


def test_text_in_columns_that_are_not_used_is_fine(read_text):
    rows = [f"rest {i},{row}" for i, row in enumerate(lines())]
    assert len(read_text("\n".join(["note," + HEAD, *rows]), **WORDS)) == 20


@pytest.mark.parametrize("cell", ["nan", "NaN", "", "NA"])
def test_missing_value(read_text, cell):
    rows = cells(7, 5, cell)
    refused(
        read_text, rows, "log.missing_value",
        "missing values in accel, 1 in all: row 7 of the data (from 0)", 'missing = "drop"',
    )  # fmt: skip
    log = read_text("\n".join([HEAD, *rows]), **WORDS, missing="drop")
    assert len(log) == log.source["rows"] == 19
    assert [f.code for f in log.findings] == ["log.dropped", "log.gap"]
    assert "Missing or infinite values in accel were left out, 1 in all: row 7 of the data" in (
        log.findings[0].message
    )


@pytest.mark.parametrize("cell", ["inf", "-inf", "Infinity", "1e200"])
def test_infinite_value(read_text, cell):
    refused(read_text, cells(3, 1, cell), "log.infinite", "in gyro", "row 3 of the data")


def test_many_missing_values_are_counted(read_text):
    rows = cells(3, 0, "")
    rows[5:13] = [",,,,,,"] * 8
    refused(read_text, rows, "log.missing_value", "9 in all: rows 3, 5, 6, 7, 8, ...")
    refused(read_text, [",,,,,,"] * 9, "log.empty", missing="drop")


@pytest.mark.parametrize("text", ["", "\n\n", "t,gx,gy,gz,ax,ay,az\n", "# only remarks\n"])
def test_empty_log(read_text, text):
    with refuses("log.empty", match=r"'log.csv' has no samples"):
        read_text(text, **WORDS)


def test_empty_files_of_other_formats(tmp_path):
    np.save(tmp_path / "a.npy", np.empty((0, 7)))
    (tmp_path / "b.bin").write_bytes(b"")
    for file in ("a.npy", "b.bin"):
        words = {"file": file, "rate": "1 Hz", "record": {"type": "float32", "columns": 7}}
        words |= {"accel": {"columns": [0, 1, 2], "unit": "g"}, "format": file[-3:]}
        words["format"] = {"npy": "npy", "bin": "binary"}[file[-3:]]
        with pytest.raises(FoucaultError, match="has no samples"):
            read(LogDescription.model_validate(words), tmp_path)


def test_time_backward_and_repeated(read_text):
    refused(
        read_text, cells(8, 0, "0.005"), "log.time_backward",
        "row 8 of the data (from 0): 0.005 s after 0.07 s, counted from the start; 1 such rows",
        "The logger was restarted, or two logs were put together: keep one part of the file.",
    )  # fmt: skip
    refused(read_text, cells(8, 0, "-3599.92"), "log.time_backward", "add 3600 s to the times")
    for bits, tick, unit in ((32, 1e-6, "us"), (16, 1e-3, "ms"), (24, 1e-6, "us")):
        told = lines(40)
        for k, line in enumerate(told):
            count = (2**bits - round(0.15 / tick) + round(0.01 * k / tick)) % 2**bits
            told[k] = f"{count},{line.partition(',')[2]}"
        said = f"The counter has {bits} bits and began again: add {2**bits * tick:.9g} s to the"
        refused(read_text, told, "log.time_backward", said, time={"column": "t", "unit": unit})
    # A stamp that is late by less than an interval is no restart.
    refused(read_text, cells(8, 0, "0.065"), "log.time_backward", 'rate = "100 Hz"')
    newest_first = lines()[::-1]
    refused(read_text, newest_first, "log.time_backward", "19 such rows in all. The logger was")
    refused(
        read_text, cells(8, 0, "0.07"), "log.time_repeated",
        "Row 8 of the data (from 0) has the same time as the row before, 0.07 s", 'rate = "100 Hz"',
    )  # fmt: skip


def test_neither_time_nor_rate(read_text):
    refused(read_text, lines(), "log.no_time", 'Write rate = "100 Hz"', time=None)


def test_undescribed(read_text):
    refused(
        read_text, lines(), "log.undescribed", "'log.csv' has t, gx, gy, gz, ax, ay, az",
        "Add [log.gyro]", gyro=None, accel=None,
    )  # fmt: skip


def test_damaged_files(tmp_path):
    good = gzip.compress("\n".join([HEAD, *lines(2000)]).encode())
    (tmp_path / "cut.csv.gz").write_bytes(good[: len(good) // 2])
    for name in ("a.parquet", "b.npz", "c.npy", "d.mat"):
        (tmp_path / name).write_bytes(b"\x01\x02 no such thing" * 50)
    for name in ("cut.csv.gz", "a.parquet", "b.npz", "c.npy", "d.mat"):
        with refuses("log.unreadable") as caught:
            read(LogDescription.model_validate({"file": name, **WORDS}), tmp_path)
        assert f"'{name}' cannot be read as" in str(caught.value)


def test_pickled_objects_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with refuses("log.unreadable"):
        read(LogDescription.model_validate({"file": "a.npy", **WORDS}), tmp_path)


def test_binary_mistakes(tmp_path):
    (tmp_path / "log.ins").write_bytes(np.ones(70).tobytes() + b"abc")
    words = {"file": "log.ins", "rate": "1 Hz", "accel": {"columns": [0, 1, 2], "unit": "g"}}
    with pytest.raises(FoucaultError, match="cannot be told from its suffix"):
        read(LogDescription.model_validate(words), tmp_path)
    with pytest.raises(FoucaultError, match=r"Add \[log.record\]"):
        read(LogDescription.model_validate({**words, "format": "binary"}), tmp_path)
    record = {"type": "float64", "columns": 7}
    with pytest.raises(FoucaultError, match="ends with 3 bytes of a record of 56 bytes"):
        read(LogDescription.model_validate({**words, "record": record}), tmp_path)


def test_two_files_must_belong_together(tmp_path):
    rows = lines()

    def save(name, rows):
        (tmp_path / name).write_text("\n".join([HEAD, *rows]))

    def load():
        words = {**WORDS, "gyro": {**WORDS["gyro"], "file": "gyro.csv"}}
        words["accel"] = {**WORDS["accel"], "file": "accel.csv"}
        return read(LogDescription.model_validate(words), tmp_path)

    save("gyro.csv", rows)
    save("accel.csv", cells(5, 0, "0.0549"))
    log = load()
    assert log.source["file"] == "gyro.csv + accel.csv"
    assert log.time[5] == 0.05
    save("accel.csv", cells(5, 0, "0.0551"))
    with refuses("log.join_time") as caught:
        load()
    assert "Row 5: 'gyro.csv' is at 0.05 s but 'accel.csv' at 0.0551 s" in str(caught.value)
    save("accel.csv", rows[:-1])
    with pytest.raises(FoucaultError, match=r"'gyro.csv' has 20 samples but 'accel.csv' has 19"):
        load()


def test_every_symptom_of_logs_is_complete():
    for code, row in SYMPTOMS.items():
        if code.startswith(("log.", "output.")):
            assert row.severity in ("error", "warning", "note")
            assert row.symptom
            assert row.message.endswith((".", "{hint}"))
            assert row.cure.endswith(".")


@pytest.mark.parametrize(
    ("interval", "declared", "likely", "rate", "then"),
    [
        (10.0, "s", "ms", "0.1", "100"),
        (1e4, "s", "us", "0.0001", "100"),
        (1e7, "s", "ns", "0.0000001", "100"),
        (1.0, "us", "ms", "1000000", "1000"),
        (0.005, "ms", "s", "200000", "200"),
    ],
)
def test_a_wrong_unit_of_time_is_named(read_text, interval, declared, likely, rate, then):
    rows = [f"{i * interval!r},{row.partition(',')[2]}" for i, row in enumerate(lines())]
    time = {"column": "t", "unit": declared}
    (found,) = read_text("\n".join([HEAD, *rows]), **{**WORDS, "time": time}).findings
    assert found.code == "log.time_unit"
    assert f'with unit = "{declared}" of time' in found.message
    assert f'write unit = "{likely}" in [log.time], which gives {then} Hz' in found.cure
    if float(rate) > 1e-6:
        assert f"The median rate is {rate} Hz" in found.message


@pytest.mark.parametrize("interval", [1.0, 0.01, 1e-5, 2e9, 1e-11])
def test_a_rate_that_is_plausible_or_cannot_be_mended_says_nothing(interval):
    assert checks.time_scale(interval, "s", 1.0) == ()


def test_times_in_words_count_from_the_start(read_text):
    rows = [f"{1717171717 + 0.01 * i:.2f},{row.partition(',')[2]}" for i, row in enumerate(lines())]
    del rows[9:12]
    (found,) = read_text("\n".join([HEAD, *rows]), **WORDS).findings
    assert "The longest is 40 ms, 0.08 s from the start, where 10 ms is usual" in found.message


def test_rows_written_twice_are_left_out(read_text):
    rows = [row for row in lines() for _ in range(2)]
    log = read_text("\n".join([HEAD, *rows]), **WORDS)
    assert len(log) == 20
    (found,) = log.findings
    assert found.code == "log.rows_doubled"
    assert found.message.startswith("20 rows repeat the row before them")


def test_a_log_in_blocks_loses_the_same_doubled_rows(tmp_path, monkeypatch):
    rows = [row for row in lines() for _ in range(2)]
    (tmp_path / "log.csv").write_text("\n".join([HEAD, *rows]))
    words = LogDescription.model_validate({"file": "log.csv", **WORDS})
    monkeypatch.setattr(follow, "BLOCK_ROWS", 7)  # cuts between two equal rows
    logs = list(follow.blocks(words, tmp_path))
    assert len(logs) > 3
    assert np.array_equal(np.concatenate([p.time for p in logs]), read(words, tmp_path).time)


def test_equal_times_with_other_data_name_the_rate(read_text):
    rows = [f"{0.04 * (i // 4):.2f},{row.partition(',')[2]}" for i, row in enumerate(lines(101))]
    refused(read_text, rows, "log.time_repeated", "but other readings", 'rate = "100 Hz" in [log]')


PREAMBLE = ["Logger 7, firmware 1.2", "Rate: 100 Hz", "", HEAD]


def test_a_preamble_is_named_and_its_length_found(read_text):
    refused(
        read_text, lines(), "log.preamble", "line 2 is neither a title nor a sample: 'Rate: 100",
        "Write header = 4 in [log]", head="\n".join(PREAMBLE),
    )  # fmt: skip
    log = read_text("\n".join([*PREAMBLE, *lines()]), **WORDS, header=4)
    assert len(log) == 20
    assert log.findings == ()


def test_a_header_that_swallows_a_sample_is_noticed(read_text):
    log = read_text("\n".join(["", HEAD, *lines()]), **WORDS, header=3)
    assert len(log) == 19
    (found,) = log.findings
    assert found.code == "log.header_numbers"
    assert "line 3 is one of the 3 lines of the header" in found.message
    assert lines()[0][:20] in found.message
    assert read_text("\n".join(["", HEAD, *lines()]), **WORDS, header=2).findings == ()


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_the_decimal_comma_of_a_date(read_text, zone):
    """ISO 8601 allows it, and where numbers have a comma loggers write it."""
    rows = [
        f"2026-05-04T10:00:00,{10 * i:03d}{zone};" + row.partition(",")[2].replace(",", ";")
        for i, row in enumerate(lines())
    ]
    commas = [row.replace(".", ",") for row in rows]
    head, iso = HEAD.replace(",", ";"), {"time": {"column": "t", "unit": "iso"}}
    want = read_text("\n".join([HEAD, *lines()]), **WORDS)
    for text, decimal in ((rows, "."), (commas, ",")):
        log = read_text("\n".join([head, *text]), **{**WORDS, **iso}, decimal=decimal)
        start = 1777888800 - (7200 if zone == "+02:00" else 0)
        assert log.time == pytest.approx(start + 0.01 * np.arange(20), abs=1e-6)
        np.testing.assert_array_equal(log.gyro, want.gyro)


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_are_times(read_text, zone):
    rows = [
        f"2026-05-04T10:00:00.{10 * i:03d}{zone},{row.partition(',')[2]}"
        for i, row in enumerate(lines())
    ]
    text = "\n".join([HEAD, *rows])
    log = read_text(text, **{**WORDS, "time": {"column": "t", "unit": "iso"}})
    start = 1777888800 - (7200 if zone == "+02:00" else 0)
    assert log.time == pytest.approx(start + 0.01 * np.arange(20), abs=1e-6)
    assert log.findings == ()
    refused(read_text, rows, "log.time_iso", "column 't' holds dates", 'Write unit = "iso"')
    iso = {"time": {"column": "t", "unit": "iso"}}
    refused(read_text, lines(), "log.time_not_iso", "does not begin with a date", **iso)
    gyro = {"columns": ["t", "gy", "gz"], "unit": "deg/s"}
    refused(read_text, rows, "log.not_numeric", "'a date' is not a number", gyro=gyro, **iso)
    rows[6] = "04.05.2026" + rows[6][10:]
    refused(read_text, rows, "log.not_a_date", "line 8, column 't': '04.05.2026", **iso)


@pytest.mark.parametrize("between", [[], ["   ", "", "# restarted", "\t"]], ids=["plain", "blanks"])
def test_a_fault_far_down_is_told_by_its_line(monkeypatch, read_text, between):
    from foucault.logs import text

    monkeypatch.setattr(text, "BLOCK_BYTES", 200)
    rows = [line for good in lines(40) for line in (good, *between)]
    number = rows.index(lines(40)[30]) + 2  # from 1, after the titles
    good = read_text("\n".join([HEAD, *rows]), **WORDS)
    assert len(good) == 40
    rows[number - 2] = rows[number - 2].replace("0.30", "O.30", 1)
    refused(read_text, rows, "log.not_numeric", f"line {number}", "O.30")
