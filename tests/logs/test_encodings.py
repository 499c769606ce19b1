"""One text, written as different programs write it, is one table."""

from __future__ import annotations

import codecs
import gzip
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from foucault.logs import LogDescription, description, read
from foucault.logs.follow import Follower
from foucault.logs.indexed_own import description_of as north_of
from foucault.logs.reading import by_serial
from foucault.tables import Log

TITLES = "time (s);gyro_x (°/s);gyro_y (°/s);gyro_z (°/s);accel_x (g);accel_y (g);accel_z (g)"


def row(i: int) -> str:
    return f"{0.01 * i:.2f};0.{i % 9};-0.2;0.3;0.01;0.02;{1 + 1e-4 * (i % 7):.4f}"


def text(count: int = 30) -> str:
    return "\n".join([TITLES, *map(row, range(count)), ""])


WRITTEN = {
    "UTF-8": lambda t: t.encode(),
    "with its mark": lambda t: t.encode("utf-8-sig"),
    "of Windows": lambda t: t.replace("\n", "\r\n").encode("utf-8-sig"),
    "Windows-1252": lambda t: t.replace("\n", "\r\n").encode("cp1252"),
    "UTF-16": lambda t: t.replace("\n", "\r\n").encode("utf-16"),
    "UTF-16, high byte first": lambda t: codecs.BOM_UTF16_BE + t.encode("utf-16-be"),
    "of an old Mac": lambda t: t.replace("\n", "\r").encode("cp1252"),
    "packed UTF-16": lambda t: gzip.compress(t.encode("utf-16")),
}


def own(path: Path) -> Log:
    """Read a log by its titles alone."""
    return read(description.description_of(path)[0], path.parent)


UNMARKED = {
    "UTF-16 without its mark": lambda t: t.encode("utf-16-le"),
    "the same, high byte first": lambda t: t.encode("utf-16-be"),
}
"""What only the first lines tell, which a growing log does not have at first."""


@pytest.mark.parametrize("name", [*WRITTEN, *UNMARKED])
def test_one_table(name: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes((WRITTEN | UNMARKED)[name](text()))
    (tmp_path / "plain.csv").write_text(text(), encoding="utf-8")
    log, plain = own(tmp_path / "log.csv"), own(tmp_path / "plain.csv")
    assert log.gyro[1, 0] == pytest.approx(np.radians(0.1))
    for one in ("time", "gyro", "accel"):
        assert np.array_equal(getattr(log, one), getattr(plain, one))


@pytest.mark.parametrize("name", ["UTF-16", "of an old Mac"])
def test_pieces_join(name: str, tmp_path: Path) -> None:
    """A text longer than what is decoded at once, and the progress told of it."""
    (tmp_path / "log.csv").write_bytes(WRITTEN[name](text(6000)))
    told: list[float] = []
    log = read(description.description_of(tmp_path / "log.csv")[0], tmp_path, told.append)
    assert len(log) == 6000 and log.time[-1] == pytest.approx(59.99)
    assert told and all(0 <= part <= 1 for part in told)


@pytest.mark.parametrize("name", WRITTEN)
def test_serial_numbers(name: str, tmp_path: Path) -> None:
    rows = [f"Nr. Ü{i % 2};{row(i)}" for i in range(20)]
    (tmp_path / "log.csv").write_bytes(WRITTEN[name]("\n".join(["serial;" + TITLES, *rows, ""])))
    described = LogDescription.model_validate({
        "file": "log.csv", "serial": "serial", "time": {"column": 1, "unit": "s"},
        "gyro": {"columns": [2, 3, 4], "unit": "deg/s"},
        "accel": {"columns": [5, 6, 7], "unit": "g"},
    })  # fmt: skip
    assert {serial for serial, _ in by_serial(described, tmp_path)} == {"Nr. Ü0", "Nr. Ü1"}


LIVE = [n for n in WRITTEN if n not in ("packed UTF-16", "of an old Mac")]


@pytest.mark.parametrize("name", LIVE)
@pytest.mark.parametrize("step", [1, 7, 10_000])
def test_a_log_that_grows(name: str, step: int) -> None:
    """However its bytes come: a mark or a letter may be cut in two."""
    content = WRITTEN[name](text())
    pieces = [content[i : i + step] for i in range(0, len(content), step)]
    tail: Any = SimpleNamespace(name="log.csv", restarts=0, ended=False, missing=False,
                                read=lambda: pieces.pop(0) if pieces else b"")  # fmt: skip
    described = LogDescription.model_validate({
        "file": "log.csv", "time": {"column": 0, "unit": "s"},
        "accel": {"columns": ["accel_x (g)", "accel_y (g)", "accel_z (g)"], "unit": "g"},
    })  # fmt: skip
    following = Follower(tail, described)
    parts = []
    while pieces:
        parts += [part for part in [following.poll()] if part is not None]
    assert sum(map(len, parts)) == 30
    assert parts[0].accel[0, 2] == pytest.approx(9.80665)


@pytest.mark.parametrize("name", WRITTEN)
def test_sentences(name: str, tmp_path: Path) -> None:
    numbers = "+00.1,-00.2,+00.4,+00.011,-00.019,-09.793,+00.001,-00.002,+00.003,+24.1,+101.3"
    (tmp_path / "vn.txt").write_bytes(WRITTEN[name](f"$VNIMU,{numbers}*XX\n" * 5))
    log = read(LogDescription.model_validate({"file": "vn.txt", "rate": "40 Hz"}), tmp_path)
    assert len(log) == 5 and log.accel[0].tolist() == [-0.019, 0.011, 9.793]


@pytest.mark.parametrize("name", WRITTEN)
def test_titles_of_a_north_seeker(name: str, tmp_path: Path) -> None:
    rows = ["index (°);gyro (°/h);dwell (s)", "0;10.1;60", "120;-3.2;60", "240;4.4;60", ""]
    (tmp_path / "stops.csv").write_bytes(WRITTEN[name]("\n".join(rows)))
    described, _ = north_of(tmp_path / "stops.csv")
    assert described.gyro is not None and described.gyro.unit == "°/h"
