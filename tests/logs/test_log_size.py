"""Files that are too large, or that pretend to be: refused in words, soon and cheaply."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from foucault import logs
from foucault.errors import FoucaultError
from foucault.logs import dialect, raw
from foucault.logs.description import LogDescription

ROW = b"0.01,0.1,0.2,0.3,0.1,0.2,9.8\n"
TITLES = b"time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n"
BY_NAME = {"time": {"unit": "s"}, "gyro": {"unit": "rad/s"}, "accel": {"unit": "m/s^2"}}
BY_NUMBER = {"time": {"column": 0, "unit": "s"},
             "gyro": {"columns": [1, 2, 3], "unit": "rad/s"},
             "accel": {"columns": [4, 5, 6], "unit": "m/s^2"}}  # fmt: skip


def rows(count: int) -> bytes:
    return TITLES + b"".join(b"%d" % k + ROW for k in range(count))


def refused(
    folder: Path, file: str, content: bytes | None = None, **words: object
) -> FoucaultError:
    if content is not None:
        (folder / file).write_bytes(content)
    said = BY_NUMBER if file.startswith(("log.npy", "log.mat", "log.bin")) else BY_NAME
    with pytest.raises(FoucaultError) as caught:
        logs.read(LogDescription.model_validate({"file": file, **said, **words}), folder)
    return caught.value


@pytest.mark.parametrize("file", ["log.csv", "log.csv.gz"])
@pytest.mark.parametrize("zeros", [1, 9 << 20])
def test_a_file_longer_than_what_was_written_says_where_that_ends(
    file: str, zeros: int, tmp_path: Path
) -> None:
    text = rows(50) + bytes(zeros)
    told = refused(tmp_path, file, gzip.compress(text) if file.endswith("gz") else text)
    assert told.code == "log.zero_bytes" and "from line 52 on" in told.message
    assert f"`head -n 51 {file} > cut.csv`" in told.cure


def test_zero_bytes_before_the_first_sample(tmp_path: Path) -> None:
    assert refused(tmp_path, "log.csv", bytes(9 << 20)).code in ("log.encoding", "log.unreadable")


def test_a_line_without_an_end(tmp_path: Path) -> None:
    told = refused(tmp_path, "log.csv", rows(5) + b"1" * (5 << 20))
    assert told.code == "log.unreadable" and "longer than 4 MB" in told.message
    told = refused(tmp_path, "log.csv", b"x" * (5 << 20))
    assert told.code == "log.unreadable" and "longer than 4 MB" in told.message


def test_a_file_of_remarks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foucault.logs.dialect.LONGEST_HEAD", 1 << 20)
    told = refused(tmp_path, "log.csv", b"# nothing\n" * 110_000)
    assert told.code == "log.unreadable" and "hold no sample" in told.message


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take what unpacks to a megabyte for large."""
    monkeypatch.setattr(dialect, "SMALL", 1 << 20)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("file", ["log.csv.gz", "log.bin.gz", "log.mat.gz", "log.txt"])
def test_what_unpacks_to_far_more_is_not_unpacked(file: str, tmp_path: Path) -> None:
    text = TITLES + ROW * 100_000
    words = {"record": {"type": "float64", "columns": 7}} if ".bin" in file else {}
    told = refused(tmp_path, file, gzip.compress(text), **words)
    assert told.code == "log.unreadable" and "do not pack by a factor of 200" in told.message


@pytest.mark.usefixtures("small")
def test_containers_that_unpack_to_far_more_are_not_unpacked(tmp_path: Path) -> None:
    zeros = np.zeros((200_000, 7))
    np.savez_compressed(tmp_path / "log.npz", imu=zeros)
    savemat(tmp_path / "log.mat", {"imu": zeros}, do_compression=True)
    table = pa.table(dict.fromkeys(TITLES.decode().strip().split(","), zeros[:, 0]))
    pq.write_table(table, tmp_path / "log.parquet")
    for file in ("log.npz", "log.mat", "log.parquet"):
        told = refused(tmp_path, file)
        assert told.code == "log.unreadable" and "by a factor of 200" in told.message


@pytest.mark.parametrize("file", ["log.csv", "log.csv.gz", "log.txt", "log.parquet", "log.npy",
                                  "log.npz", "log.mat", "log.bin"])  # fmt: skip
def test_a_log_larger_than_memory_is_refused_with_both_sizes(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = 120_000  # of 7 numbers: 13.4 MB, twice
    table = np.random.default_rng(1).normal(size=(count, 7))
    table[:, 0] = np.arange(count)
    titles = TITLES.decode().strip().split(",")
    columns = dict(zip(titles, table.T, strict=True))
    text = TITLES + b"".join(b"%d" % k + ROW for k in range(count))
    write = {
        "log.csv": lambda f: f.write_bytes(text),
        "log.csv.gz": lambda f: f.write_bytes(gzip.compress(text, 1)),
        "log.txt": lambda f: f.write_bytes(text.replace(b",", b" ")),
        "log.parquet": lambda f: pq.write_table(pa.table(columns), f),
        "log.npy": lambda f: np.save(f, table),
        "log.npz": lambda f: np.savez(f, **columns),
        "log.mat": lambda f: savemat(f, {"imu": table}),
        "log.bin": lambda f: f.write_bytes(table.tobytes()),
    }
    write[file](tmp_path / file)
    monkeypatch.setattr(raw, "free_memory", lambda: 5e6)
    words = {"record": {"type": "float64", "columns": 7}} if ".bin" in file else {}
    told = refused(tmp_path, file, **words)
    assert told.code == "log.too_large", told.message
    assert "needs about 0.01" in told.message and "GB are free" in told.message
    monkeypatch.setattr(raw, "free_memory", lambda: 5e7)
    said = BY_NUMBER if file.endswith((".npy", ".mat", ".bin")) else BY_NAME
    log = logs.read(LogDescription.model_validate({"file": file, **said, **words}), tmp_path)
    assert len(log) == count


def test_a_damaged_packed_file_is_no_bomb(tmp_path: Path) -> None:
    good = gzip.compress(rows(3000))
    with pytest.raises(zlib.error):
        zlib.decompress(good)
    assert refused(tmp_path, "log.csv.gz", good[: len(good) // 2]).code == "log.unreadable"


@pytest.mark.parametrize("mark", [b"", b"# a remark\n\n"])
def test_a_fault_far_into_a_file_has_its_line(mark: bytes, tmp_path: Path) -> None:
    half = b"".join(b"%d" % k + ROW for k in range(150_000))  # blocks are of 4 MB
    told = refused(tmp_path, "log.csv", TITLES + half + mark + half + b"3,4\n5,oops,7\n" + ROW)
    assert told.code == "log.ragged"
    assert f"line {300_002 + len(mark.splitlines())}" in told.message


def test_arrow_parses_in_memory_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A thread of its reads ahead, and after a fault it outlives the call. Threads of earlier tests
    # may still free theirs, so that the sum of what Arrow holds says nothing.
    parse, allocate = pacsv.read_csv, pa.allocate_buffer
    given, read = [], []

    def allocated(size: int) -> pa.Buffer:
        given.append(allocate(size))
        return given[-1]

    def watched(source: pa.NativeFile, *more: object) -> pa.Table:
        assert type(source) is pa.BufferReader
        read.append(source.read_buffer(1).address)
        source.seek(0)
        return parse(source, *more)

    monkeypatch.setattr(pa, "allocate_buffer", allocated)
    monkeypatch.setattr(pacsv, "read_csv", watched)
    (tmp_path / "log.csv").write_bytes(rows(500))
    logs.read(LogDescription.model_validate({"file": "log.csv", **BY_NAME}), tmp_path)
    assert len(read) == 1
    assert read == [buffer.address for buffer in given]
