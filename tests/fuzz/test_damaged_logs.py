"""Damaged log files of every format: a log that can be believed, or one error, soon and cheaply."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from make_damage import FLIGHTS, GOOD, NAMES, WORDS, bounded, damaged, table

from foucault import logs
from foucault.errors import FoucaultError
from foucault.logs import own
from foucault.logs.description import LogDescription, description_of
from foucault.tables import Log

BY_NAME = {"time": {"column": "time", "unit": "s"},
           "gyro": {"columns": list(NAMES[1:4]), "unit": "rad/s"},
           "accel": {"columns": list(NAMES[4:]), "unit": "m/s^2"}}  # fmt: skip
BY_NUMBER = {"time": {"column": 0, "unit": "s"},
             "gyro": {"columns": [1, 2, 3], "unit": "rad/s"},
             "accel": {"columns": [4, 5, 6], "unit": "m/s^2"}}  # fmt: skip
RECORD = {"record": {"type": "float64", "columns": 7}}


def described(file: str, **more: object) -> LogDescription:
    if file in FLIGHTS:
        return LogDescription.model_validate({"file": file} | more)
    numbered = file.endswith((".npy", ".mat", ".bin"))
    said = {"file": file, **(BY_NUMBER if numbered else BY_NAME)}
    return LogDescription.model_validate(said | (RECORD if file.endswith(".bin") else {}) | more)


def read(folder: Path, content: bytes, description: LogDescription) -> Log | None:
    """Read a log, or None where it is refused in words."""
    (folder / description.file).write_bytes(content)
    with bounded(str(description.file)):
        try:
            return logs.read(description, folder)
        except FoucaultError as problem:
            assert problem.message and problem.cure and len(str(problem)) < 3000
            return None


def believable(log: Log) -> None:
    """A log that was accepted holds numbers, and its time runs forward."""
    triads = [x for x in (log.gyro, log.accel) if x is not None]
    assert len(log) > 0 and triads
    for x in (log.time, *triads):
        assert np.isfinite(x).all()
    if len(log) > 2:
        assert (np.diff(log.time) > 0).all()


@pytest.mark.parametrize("file", GOOD)
def test_good_files_are_read(file: str, tmp_path: Path) -> None:
    log = read(tmp_path, GOOD[file], described(file))
    assert log is not None
    assert np.allclose(np.column_stack([log.time, log.gyro, log.accel]), table(), atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("file", [*GOOD, *FLIGHTS])
@given(data=st.data())
def test_damaged_files(file: str, tmp_path: Path, data: st.DataObject) -> None:
    log = read(tmp_path, data.draw(damaged((GOOD | FLIGHTS)[file])), described(file))
    if log is not None:
        believable(log)


@pytest.mark.parametrize("file", FLIGHTS)
def test_good_flights_are_read(file: str, tmp_path: Path) -> None:
    log = read(tmp_path, FLIGHTS[file], described(file))
    assert log is not None
    believable(log)


@given(content=st.binary(max_size=300), file=st.sampled_from([*GOOD, *FLIGHTS, "log.dat", "log"]))
def test_any_bytes(content: bytes, file: str, tmp_path: Path) -> None:
    log = read(tmp_path, content, described(file))
    if log is not None:
        believable(log)


CELLS = st.one_of(
    st.floats(-1e3, 1e3).map(repr), st.floats().map(str), st.integers().map(str),
    st.sampled_from([w.decode("utf-8", "replace") for w in WORDS]), st.text(max_size=6),
)  # fmt: skip


@pytest.mark.thorough
@given(
    rows=st.lists(st.lists(CELLS, min_size=6, max_size=8), max_size=8),
    delimiter=st.sampled_from([",", ";", "\t", "|", " ", "  ", ", "]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    titled=st.booleans(),
    number=st.booleans(),
)
def test_any_table_of_cells(
    rows: list[list[str]], delimiter: str, encoding: str, end: str, titled: bool, number: bool,
    tmp_path: Path,
) -> None:  # fmt: skip
    lines = [delimiter.join(NAMES)] * titled + [delimiter.join(row) for row in rows]
    content = end.join([*lines, ""]).encode(encoding, errors="replace")
    log = read(tmp_path, content, described("log.csv", **(BY_NUMBER if number else {})))
    if log is not None:
        believable(log)


WORD = st.one_of(st.text(max_size=3), st.sampled_from([",", ";", "\n", '"', "\\", "#", "1", "é"]))
COLUMN = st.one_of(st.integers(-9, 99), st.sampled_from(NAMES), st.text(max_size=3))


@given(
    keys=st.fixed_dictionaries(
        {},
        optional={
            "delimiter": WORD,
            "decimal": st.sampled_from([".", ","]),
            "header": st.one_of(st.integers(0, 10**12), st.sampled_from(["auto", "none"])),
            "comment": st.lists(WORD, max_size=3),
            "variable": st.text(max_size=4),
            "missing": st.sampled_from(["error", "drop"]),
            "serial": COLUMN,
            "format": st.sampled_from(["csv", "text", "parquet", "npy", "npz", "mat", "binary"]),
            "time": st.fixed_dictionaries(
                {"column": COLUMN, "unit": st.sampled_from(["s", "iso"])}
            ),
        },
    ),
    file=st.sampled_from(list(GOOD)),
)
def test_any_description(keys: dict[str, object], file: str, tmp_path: Path) -> None:
    try:
        description = described(file, **keys)
    except (FoucaultError, ValueError):  # pydantic's, which a campaign file puts in words
        return
    log = read(tmp_path, GOOD[file], description)
    if log is not None:
        believable(log)


@pytest.mark.thorough
@given(
    rows=st.lists(
        st.tuples(*[st.floats(-1e12, 1e12, allow_subnormal=True)] * 6), min_size=3, max_size=30
    ),
    start=st.floats(-1e6, 1e6),
    file=st.sampled_from(["log.csv", "log.csv.gz", "log.parquet", "log.npz"]),
)
def test_what_is_written_is_read_again(
    rows: list[tuple[float, ...]], start: float, file: str, tmp_path: Path
) -> None:
    x = np.array(rows)
    log = Log(start + 0.01 * np.arange(len(x)), x[:, :3].copy(), x[:, 3:].copy())
    own.write(log, tmp_path / file)
    again = logs.read(LogDescription.model_validate({"file": file}), tmp_path)
    for name in ("time", "gyro", "accel"):
        assert getattr(again, name).tobytes() == getattr(log, name).tobytes()


@given(data=st.data(), file=st.sampled_from(["log.csv", "log.txt", "log.parquet"]))
def test_titles_of_any_file(data: st.DataObject, file: str, tmp_path: Path) -> None:
    (tmp_path / file).write_bytes(data.draw(damaged(GOOD[file])))
    try:
        description, _ = description_of(tmp_path / file)
        logs.read(description, tmp_path)
    except FoucaultError as problem:
        assert problem.cure
