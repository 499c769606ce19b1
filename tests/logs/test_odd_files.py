"""Files that are odd in the middle or at the end: each has one answer, bare or described."""

import subprocess

import numpy as np
import pytest
from pyarrow import parquet, table

import make_bare as make
from foucault import logs
from foucault.errors import FoucaultError
from foucault.logs import LogDescription
from foucault.recognise.reading import recognise
from refusals import refuses

HEAD, FORM = "t,ax,ay,az,gx,gy,gz", ["%.6f"] * 7
WORDS = {
    "file": "my.csv",
    "time": {"column": "t", "unit": "s"},
    "accel": {"columns": ["ax", "ay", "az"], "unit": "m/s^2"},
    "gyro": {"columns": ["gx", "gy", "gz"], "unit": "rad/s"},
}
JUNK = np.random.default_rng(0).integers(0, 256, 4000, dtype=np.uint8).tobytes()


@pytest.fixture(scope="module")
def lines():
    c = make.Columns.of(make.truth(1, 50.0, 12))
    return make.text(HEAD, [c.t, c.f, c.w], FORM).splitlines(keepends=True)


def both(folder, content):
    """Read a file with a description and as a bare one; return what either says."""
    (folder / "my.csv").write_bytes(content)
    out = []
    for run in (
        lambda: logs.read(LogDescription.model_validate(WORDS), folder),
        lambda: recognise([folder / "my.csv"]),
    ):
        with pytest.raises(FoucaultError) as ended:
            run()
        out.append(ended.value)
    assert out[0].message == out[1].message and out[0].cure == out[1].cure
    return out[0]


@pytest.mark.parametrize("title", [HEAD, "t,ay,ax,az,gx,gy,gz", "time,accel,gyro"])
def test_two_logs_pasted_after_each_other(lines, tmp_path, title):
    told = both(tmp_path, "".join([*lines, title + "\n", *lines[1:]]).encode())
    assert told.code == "log.begins_again"
    where = len(lines) + 1
    assert f"begins again at line {where}, which holds words alone" in told.message
    assert f"`head -n {where - 1} my.csv > first.csv` or `tail -n +{where}" in told.cure
    # What it says to do is enough.
    for command, name in zip(told.cure.split("`")[1::2], ("first", "second"), strict=True):
        subprocess.run(command, shell=True, cwd=tmp_path, check=True)
        part = (tmp_path / f"{name}.csv").read_text().splitlines(keepends=True)
        assert part[1:] == lines[1:]


def test_a_remark_of_the_logger_is_one_line_to_delete(lines, tmp_path):
    told = both(tmp_path, "".join([*lines[:90], "ERROR: no answer\n", *lines[90:]]).encode())
    assert told.code == "log.ragged" and "line 91 has 1 columns" in told.message
    assert "delete the line" in told.cure


def test_parquet_is_told_by_its_content(lines, tmp_path):
    columns = np.loadtxt(lines[1:], delimiter=",").T
    parquet.write_table(table(dict(zip(HEAD.split(","), columns, strict=True))), tmp_path / "p")
    (tmp_path / "p").rename(tmp_path / "my.csv")
    read = logs.read(recognise([tmp_path / "my.csv"]).description(), tmp_path)
    np.testing.assert_allclose(read.accel, columns[1:4].T)


def test_two_logs_without_titles_between_them(lines, tmp_path):
    (tmp_path / "my.csv").write_text("".join([*lines, *lines[1:]]))
    with refuses("log.time_backward", "two logs were put together: keep one part of the file"):
        logs.read(LogDescription.model_validate(WORDS), tmp_path)


@pytest.mark.parametrize("after", [b"", b"\n1.0,2.0,3.0,4.0,5.0,6.0,7.0\n"])
def test_bytes_that_are_no_text_after_a_good_head(lines, tmp_path, after):
    told = both(tmp_path, "".join(lines[:1000]).encode() + JUNK + after)
    assert told.code == "log.binary_bytes"
    assert "holds bytes that are no text from line 1001 on" in told.message
    assert "`head -n 1000 my.csv > cut.csv`" in told.cure


@pytest.mark.parametrize("cells", [1, 3, 6])
def test_a_log_cut_in_the_middle_of_a_row(lines, tmp_path, cells):
    cut = ",".join(lines[1000].split(",")[:cells])
    told = both(tmp_path, ("".join(lines[:1000]) + cut).encode())
    assert told.code == "log.truncated"
    assert told.message == f"'my.csv' ends in the middle of line 1001, with {cells} of 7 columns."
    assert told.cure.startswith("Delete the last line")
