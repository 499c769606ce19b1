"""Following a log that another program writes: nothing lost, nothing twice, nothing half read."""

from __future__ import annotations

import os
import threading
import time
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read, write
from foucault.logs.follow import READ_BYTES, FileTail, Follower, StreamTail, open_tail
from foucault.tables import Log
from refusals import refuses

GYRO = {"columns": ["gx", "gy", "gz"], "unit": "deg/s"}
ACCEL = {"columns": ["ax", "ay", "az"], "unit": "g"}
TIME = {"column": "t", "unit": "ms"}
HEAD = "t,gx,gy,gz,ax,ay,az\n"


def described(**more: Any) -> LogDescription:
    return LogDescription.model_validate(
        {"file": "log.csv", "time": TIME, "gyro": GYRO, "accel": ACCEL} | more
    )


def row(i: int, separator: str = ",") -> str:
    return separator.join(f"{v:.6g}" for v in (10 * i, i, -i, 0.5 * i, 0.1, 0.2, 0.9)) + "\n"


def rows(start: int, end: int) -> str:
    return "".join(row(i) for i in range(start, end))


def append(path: Path, text: str) -> None:
    with path.open("a") as stream:
        stream.write(text)


def follower(path: Path, description: LogDescription | None = None) -> Follower:
    description = description or described()
    return Follower(open_tail(path, description), description)


def drained(following: Follower) -> list[Log]:
    """Everything there is now."""
    parts = [following.poll() for _ in range(5)]
    return [part for part in parts if part is not None]


def times(parts: list[Log]) -> list[float]:
    return [float(t) for part in parts for t in part.time]


def test_rows_come_once_and_in_si(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    following = follower(path)
    assert following.poll() is None
    assert following.tail.missing
    append(path, HEAD + rows(0, 5))
    first = following.poll()
    assert first is not None
    assert not following.tail.missing
    np.testing.assert_allclose(first.time, np.arange(5) / 100)
    np.testing.assert_allclose(first.gyro[3], np.radians([3, -3, 1.5]))
    np.testing.assert_allclose(first.accel[0], np.array([0.1, 0.2, 0.9]) * 9.80665)
    assert following.poll() is None
    append(path, rows(5, 7))
    assert times(drained(following)) == pytest.approx([0.05, 0.06])
    assert following.findings == ()


def test_half_a_line_waits_for_its_other_half(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    following = follower(path)
    text = HEAD + rows(0, 12)
    got: list[Log] = []
    for i in range(0, len(text), 7):  # cuts every line, the title too
        append(path, text[i : i + 7])
        got += drained(following)
        n = len(times(got))
        assert n == 0 or n <= text[: i + 7].count("\n") - 1
    assert times(got) == pytest.approx(np.arange(12) / 100)
    append(path, "120,12,-12")
    assert drained(following) == []


@pytest.mark.parametrize("rate", [50, 4000])
def test_a_writer_in_another_thread(tmp_path: Path, rate: int) -> None:
    path = tmp_path / "log.csv"
    n = 600

    def record() -> None:
        time.sleep(0.05)
        with path.open("w") as stream:
            stream.write(HEAD)
            for i in range(n):
                stream.write(row(i))
                if i % 7 == 0:
                    stream.flush()
                    time.sleep(1e-4 if rate == 50 else 0)

    writer = threading.Thread(target=record)
    writer.start()
    following, got = follower(path), []
    end = time.monotonic() + 20
    while len(times(got)) < n and time.monotonic() < end:
        got += drained(following)
        time.sleep(0.002)
    writer.join()
    assert times(got) == pytest.approx(np.arange(n) / 100)
    whole = read(described(), tmp_path)
    np.testing.assert_array_equal(np.concatenate([part.gyro for part in got]), whole.gyro)


def test_a_file_that_shrinks_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 50))
    following = follower(path)
    assert len(times(drained(following))) == 50
    path.write_text(HEAD + rows(100, 104))
    assert times(drained(following)) == pytest.approx([1.0, 1.01, 1.02, 1.03])
    assert following.restarts == 1
    (told,) = following.findings
    assert told.code == "watch.restarted"
    assert "'log.csv' was written anew." in told.message


def test_a_file_emptied_and_filled_beyond_its_old_length_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 10))
    following = follower(path)
    drained(following)
    path.write_text(HEAD + rows(500, 600))
    assert len(times(drained(following))) == 100
    assert following.restarts == 1


def test_a_file_that_is_replaced_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 10))
    following = follower(path)
    drained(following)
    path.replace(tmp_path / "log.csv.1")
    assert drained(following) == []
    assert following.tail.missing
    path.write_text(HEAD + rows(0, 20))
    assert len(times(drained(following))) == 20
    assert following.restarts == 1


def test_columns_may_change_when_it_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 9))
    following = follower(path)
    drained(following)
    path.write_text("ax,ay,az,gx,gy,gz,t\n" + "0.1,0.2,0.9,1,2,3,0\n0.1,0.2,0.9,1,2,3,10\n" * 1
                    + "0.1,0.2,0.9,1,2,3,20\n")  # fmt: skip
    (part,) = drained(following)
    np.testing.assert_allclose(part.gyro[0], np.radians([1, 2, 3]))


def test_bad_lines_are_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 4) + "40,4,x4\n" + rows(5, 7) + "70,7,-7,abc,1,1,1\n" + row(8))
    following = follower(path)
    assert times(drained(following)) == pytest.approx([0, 0.01, 0.02, 0.03, 0.05, 0.06, 0.08])
    (told,) = following.findings
    assert told.code == "watch.lines"
    assert told.message == (
        "Lines or rows left out so far: 2. The first: 'log.csv' line 6 has 3 columns instead of 7."
    )
    append(path, "90,9,-9,,1,1,1\n" + row(10))
    assert times(drained(following)) == pytest.approx([0.1])
    assert "so far: 3." in following.findings[0].message


def test_rubbish_only_gives_nothing_but_is_told(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 3))
    following = follower(path)
    drained(following)
    append(path, "rubbish\n\n# remark\n")
    assert drained(following) == []
    assert "so far: 1." in following.findings[0].message


def test_comments_spaces_numbers_and_rate(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    description = described(
        file="log.txt", time=None, rate="200 Hz", gyro={"columns": [1, 2, "-3"], "unit": "deg/s"},
        accel={"columns": [4, 5, 6], "unit": "g"},
    )  # fmt: skip
    following = follower(path, description)
    append(path, "# recorded today\n\n")
    assert drained(following) == []
    append(path, "".join(row(i, "   ") for i in range(4)))
    append(path, "% pause\n" + row(4, " "))
    got = drained(following)
    assert times(got) == pytest.approx(np.arange(5) / 200)
    np.testing.assert_allclose(got[0].gyro[2], np.radians([2, -2, -1]))
    assert following.findings == ()


def test_increments_are_those_of_the_finished_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    description = described(
        gyro={**GYRO, "unit": "deg", "kind": "increment"},
        accel={**ACCEL, "unit": "m/s", "kind": "increment"},
    )
    following, got = follower(path, description), []
    append(path, HEAD)
    for start in range(0, 40, 4):
        append(path, rows(start + (start > 20) * 5, start + 4 + (start > 20) * 5))
        got += drained(following)
    whole = read(description, tmp_path)
    assert got[0].sampled == whole.sampled == "increment"
    np.testing.assert_allclose(np.concatenate([p.gyro for p in got]), whole.gyro, rtol=1e-12)
    np.testing.assert_allclose(np.concatenate([p.accel for p in got]), whole.accel, rtol=1e-12)


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_our_own_csv_needs_no_description(tmp_path: Path, sampled: Any) -> None:
    path = tmp_path / "session.csv"
    rng = np.random.default_rng(0)
    log = Log(np.arange(100) / 100, rng.normal(size=(100, 3)), rng.normal(size=(100, 3)), sampled)
    write(log, path)
    following = follower(path, LogDescription.model_validate({"file": path.name}))
    (got,) = drained(following)
    assert got.sampled == sampled
    np.testing.assert_array_equal(got.accel, log.accel)
    np.testing.assert_array_equal(got.time, log.time)


def test_a_long_file_is_caught_up_with_in_parts(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 60_000))
    assert path.stat().st_size > 1.5 * READ_BYTES
    following = follower(path)
    first = following.poll()
    assert first is not None
    assert following.behind
    got = [first, *drained(following)]
    assert not following.behind
    assert times(got) == pytest.approx(np.arange(60_000) / 100)


def test_a_pipe_until_its_end() -> None:
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb") as stream:
        following = Follower(StreamTail(stream), described())
        assert following.poll() is None
        assert not following.tail.ended
        text = (HEAD + rows(0, 30)).encode()
        for i in range(0, len(text), 100):
            os.write(writer, text[i : i + 100])
        os.close(writer)
        got: list[Log] = []
        end = time.monotonic() + 10
        while not following.tail.ended and time.monotonic() < end:
            got += drained(following)
            time.sleep(0.001)
    assert following.tail.ended
    assert times(got) == pytest.approx(np.arange(30) / 100)


def test_a_stream_in_memory() -> None:
    following = Follower(StreamTail(BytesIO((HEAD + rows(0, 9)).encode())), described())
    got: list[Log] = []
    end = time.monotonic() + 10
    while not following.tail.ended and time.monotonic() < end:
        got += drained(following)
    assert len(times(got)) == 9


@pytest.mark.parametrize(
    ("name", "more", "words"),
    [
        ("log.parquet", {}, "it is Parquet"),
        ("log.csv.gz", {}, "it is gzip"),
        ("log.dat", {"format": "mat"}, "it is mat"),
        ("log.dat", {"record": {"type": "float64", "columns": 7}}, "it is binary"),
    ],
)
def test_other_formats_are_refused(
    tmp_path: Path, name: str, more: dict[str, Any], words: str
) -> None:
    with refuses("watch.format", "cannot be followed while it grows") as problem:
        follower(tmp_path / name, described(file=name, **more))
    assert words in problem.value.message


def test_binary_content_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(FoucaultError, match="not text"):
        follower(path).poll()


def test_a_text_without_line_ends_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("1,2,3;" * 20_000)
    with pytest.raises(FoucaultError, match="no end of line in"):
        follower(path).poll()


def test_several_files_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FoucaultError, match=r"2 files \(log.csv, accel.csv\)"):
        Follower(FileTail(tmp_path / "log.csv"), described(accel={**ACCEL, "file": "accel.csv"}))
    with pytest.raises(FoucaultError, match="is a folder, not a file"):
        open_tail(tmp_path, described())


def test_wrong_columns_are_said_at_the_first_rows(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(0, 3))
    with pytest.raises(FoucaultError, match="no column 'gyx'"):
        follower(path, described(gyro={**GYRO, "columns": ["gyx", "gy", "gz"]})).poll()
    with refuses("watch.no_accel", "no accelerometer columns"):
        follower(path, described(accel=None)).poll()
