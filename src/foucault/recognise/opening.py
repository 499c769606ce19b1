"""A file of any format as columns of numbers, with how it is laid out; what is no log is told.

A text is laid out as its most regular lines say: the delimiter and the decimal sign that make the
most columns of numbers, the first line of a run of such rows, the titles and the units above it.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error
from foucault.logs.description import LogDescription
from foucault.logs.dialect import (
    EMPTY,
    SPACE,
    STAMP,
    is_text,
    number_in,
    open_bytes,
    open_text,
    split,
    text_lines,
)
from foucault.logs.raw import RawTable, format_of, must_exist, open_raw, unreadable
from foucault.recognise.titles import units_row

ROWS = 400_000
"""So many rows are looked at [1]."""

LOOK = 600
"""So many lines of a text tell how it is laid out [1]."""

RUN = 5
"""So many rows alike are no preamble [1]."""

_NO_LOGS = {
    b"\x89PNG": "a picture (PNG)", b"\xff\xd8\xff": "a picture (JPEG)", b"GIF8": "a picture (GIF)",
    b"BM": "a picture (BMP)", b"II*\0": "a picture (TIFF)", b"MM\0*": "a picture (TIFF)",
    b"%PDF": "a PDF", b"\xd0\xcf\x11\xe0": "a spreadsheet (XLS) or another office document",
    b"\x7fELF": "a program", b"MZ": "a program", b"RIFF": "sound or a film", b"ID3": "sound",
    b"\x1aE\xdf\xa3": "a film", b"OggS": "sound or a film", b"7z\xbc\xaf": "a packed archive (7z)",
    b"Rar!": "a packed archive (RAR)", b"SQLite format": "a data base (SQLite)",
    b"\x89HDF": "an HDF5 file", b"ARROW1": "an Arrow (Feather) file",
    b"BZh": "a packed file (bzip2)", b"\xfd7zXZ\0": "a packed file (xz)",
    b"\x28\xb5\x2f\xfd": "a packed file (zstd)", b"\x80\x04\x95": "a pickle of Python",
    b"\x80\x05\x95": "a pickle of Python",
}  # fmt: skip
"""How files begin that hold no log."""

_JSON = re.compile(rb"\{|\[\s*(?:[\[{\"]|-?[\d.]+(?:[eE][+-]?\d+)?\s*,)")
_NUMBERS = "Give the log itself: a table of numbers in CSV or text, one row a sample, or one of " \
    "the formats in docs/logs.md."  # fmt: skip
_SAVE_AS = "Save its sheet of readings as CSV, then give that file."
_UNPACK = "Unpack it, then give the file of readings, or several: accelerometers and gyros."


@dataclass(frozen=True)
class Opened:
    """Columns of a file, and how [log] of a campaign says where they are."""

    path: Path
    layout: dict[str, Any]  # keys of [log] that the file needs beside its name
    raw: RawTable
    units: tuple[str, ...]  # what a row of units says of each column
    columns: tuple[int, ...]  # numbers of the columns that hold numbers [1]
    x: FloatArray  # (n, len(columns)) the first rows of them
    whole: bool = True  # whether these are all rows
    left_out: tuple[int, ...] = ()  # numbers of columns that hold words or nothing [1]
    rate: float | None = None  # that the lines above the data say [Hz]

    def name(self, column: int) -> int | str:
        """Return what [log] calls a `column` [1]: its title where no other has it, else that."""
        title = self.raw.names[column]
        alone = self.raw.named and [n.strip() for n in self.raw.names].count(title.strip()) == 1
        # "-gy" would be "gy" turned round, and "3" the fourth column.
        fine = alone and title.strip() and title[0] != "-" and not title.strip().isdecimal()
        return title if fine else column

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed while it was opened."""
        return self.raw.findings


def opened(path: Path, topic: str | None = None) -> Opened:
    """Open a file and read the columns of it that hold numbers; raises what it is instead.

    `topic` or None: of which instrument, in the file of a vehicle.
    """
    try:
        return _opened(path, topic)
    except (FoucaultError, MemoryError, ImportError):
        raise
    except Exception as problem:  # each library raises its own types for a damaged file
        raise unreadable(path, "text", problem) from problem


def _opened(path: Path, topic: str | None) -> Opened:
    refuse_no_log(path)
    layout: dict[str, Any] = {}
    units: tuple[str, ...] = ()
    numeric: tuple[int, ...] | None = None
    rate: float | None = None
    if path.is_file() and format_of(path) in ("csv", "text"):
        seen = _lines(path)
        found = None if _taking_turns(seen) or _stamped(seen) else _laid_out(seen)
        if found is None:
            raise error("recognise.no_table", file=path.name, why=_why(seen))
        layout, units, numeric = found
        rate = _rate_in(seen[: layout["header"]])
    elif path.is_file() and (record := _record(path)) is not None:
        layout = {"format": "binary", "record": record}
    elif topic is not None:
        layout = {"topic": topic}
    raw = _open(path, layout)
    if raw is None and layout:
        raise error("recognise.no_table", file=path.name, why=_why(_lines(path)))
    assert raw is not None
    numbers = tuple(range(len(raw.names))) if numeric is None else numeric
    numbers = tuple(c for c in numbers if c < len(raw.names))
    columns, x, whole = _values(raw, numbers)
    if "record" not in layout:
        layout = _needed(path, layout, raw, columns)
    if not len(x):
        raise error("log.empty", file=path.name)
    words = tuple(c for c in range(len(raw.names)) if c not in columns)
    padded = (*units, *[""] * len(raw.names))[: len(raw.names)]
    return Opened(path, layout, raw, padded, columns, x, whole, words, rate)


def refuse_no_log(path: Path) -> None:
    """Refuse what holds no log, by how it begins."""
    must_exist(path)
    if not path.is_file():  # but the folder of a bag
        return
    if path.stat().st_size == 0:
        raise error("recognise.no_log", file=path.name, what="empty", todo="Record it again, or "
                    "copy it again from the logger.")  # fmt: skip
    try:
        with open_bytes(path) as stream:
            start = stream.read(4096)
    except (OSError, EOFError, ValueError, zlib.error):
        return  # packed, and damaged: the reader says it
    what = next((said for magic, said in _NO_LOGS.items() if start.startswith(magic)), None)
    todo = _SAVE_AS if what and "XLS" in what else _NUMBERS
    todo = _UNPACK if what and "packed" in what else todo
    if start.startswith(b"PK\x03\x04") and path.suffix.lower() != ".npz":
        book = b"xl/" in start or b"[Content_Types]" in start or path.suffix.lower() in (
            ".xlsx", ".xlsm", ".ods",
        )  # fmt: skip
        book = book or b"opendocument" in start
        what = "a spreadsheet or another office document" if book else "a packed archive"
        todo = _SAVE_AS if book else _UNPACK
    text = start.lstrip(b"\xef\xbb\xbf \t\r\n")
    if what is None and is_text(start):
        if _JSON.match(text):
            what, todo = "JSON", "Write it as CSV: a line of titles, then one row a sample."
        elif text[:1] == b"<":
            what, todo = "HTML or XML", _NUMBERS
        elif not text:
            what, todo = "empty but for spaces", "Record it again, or copy it again."
    if what is not None:
        raise error("recognise.no_log", file=path.name, what=what, todo=todo)


# -- how a text is laid out ----------------------------------------------------------------------


def _lines(path: Path) -> list[str]:
    with open_text(path) as stream:
        return [line.rstrip("\r\n") for line in islice(text_lines(stream), LOOK)]


@dataclass(frozen=True)
class _Table:
    """One way to read the lines of a text."""

    delimiter: str
    decimal: str
    start: int  # lines before the data
    cells: int  # of a row
    numeric: tuple[int, ...]

    @property
    def worth(self) -> tuple[int, int]:
        """Of several ways the one with the most columns of numbers, then from the first line."""
        return len(self.numeric), -self.start


def _laid_out(lines: list[str]) -> tuple[dict[str, Any], tuple[str, ...], tuple[int, ...]] | None:
    """Return keys of [log], the row of units, and the columns of numbers of a text."""
    ways = [
        table
        for delimiter, decimal in ((";", "."), (",", "."), ("\t", "."), ("|", "."), (SPACE, "."),
                                   (";", ","), ("\t", ","), ("|", ","), (SPACE, ","), (",", ","))
        if (table := _table(lines, delimiter, decimal)) is not None
    ]  # fmt: skip
    if not ways:
        return None
    best = max(ways, key=lambda table: table.worth)
    if len(best.numeric) < 3 or _comma_twice(lines, best):
        return None
    heads = _heads(lines[: best.start], best)
    units = next((tuple(row) for row in heads if units_row(row)), ())
    layout = {
        "delimiter": "space" if best.delimiter == SPACE else best.delimiter,
        "decimal": best.decimal,
        "header": best.start,
    }
    return layout, units, best.numeric


def _table(lines: Sequence[str], delimiter: str, decimal: str) -> _Table | None:
    apart = None if delimiter == SPACE else delimiter
    if sum(len(line.split(apart, 2)) == 3 for line in lines) < 2:
        return None  # two rows of three numbers are the least
    rows = [_cells(line, delimiter) for line in lines]
    kinds = [tuple(_number(c, decimal) for c in row) if row else () for row in rows]
    for i in range(len(rows)):
        run = [k for k in range(i, min(i + 4 * RUN, len(rows))) if rows[k]][: RUN + 1]
        if len(run) < 2 or run[0] != i or len({len(rows[k]) for k in run}) != 1:
            continue
        # A cell may be empty in one row or another, but a column of numbers begins with none.
        numeric = [c for c in range(len(rows[i])) if all(kinds[k][c] is not False for k in run)]
        filled = [c for c in numeric if any(kinds[k][c] for k in run)]
        if len(filled) < 3:
            continue
        if any(k is False and all(kinds[r][c] for r in run[1:]) for c, k in enumerate(kinds[i])):
            continue  # titles, some of which are numbers
        every = [k for k in range(i, len(rows)) if len(rows[k]) == len(rows[i])]
        kept = [
            c for c in numeric
            if sum(kinds[k][c] is False for k in every) == 0 and any(kinds[k][c] for k in every)
        ]  # fmt: skip
        if len(kept) >= 3:
            return _Table(delimiter, decimal, i, len(rows[i]), tuple(kept))
    return None


def _cells(line: str, delimiter: str) -> list[str]:
    content = line.partition("#")[0].partition("%")[0]
    return split(content, delimiter) if content.strip() else []


def _number(cell: str, decimal: str) -> bool | None:
    """Tell whether a cell holds a number or a date, None for nothing."""
    if cell in EMPTY:
        return None
    return number_in(cell, decimal) is not None or STAMP.fullmatch(cell) is not None


def _heads(lines: Sequence[str], table: _Table) -> list[list[str]]:
    """Return the lines above the data that have a cell for each column."""
    out = []
    for line in lines:
        cells = split(line.strip().lstrip("#%/ "), table.delimiter)
        if len(cells) == table.cells and not any(_number(c, ",") for c in cells):
            out.append(cells)
    return out


def _taking_turns(lines: Sequence[str]) -> bool:
    """Tell whether rows of accelerometers and of gyros take turns, by a word in each."""
    words = [re.sub(r"[^a-z]+", " ", line.lower()) for line in lines[1:60]]
    acc, gyr = (sum(w in line and o not in line for line in words)
                for w, o in (("acc", "gyr"), ("gyr", "acc")))  # fmt: skip
    return acc > 5 and gyr > 5


_STAMPED = re.compile(r"\s*[\[(<]\s*\d[^\])>]*[\])>]\s*[-+.\d]")


def _stamped(lines: Sequence[str]) -> bool:
    """Tell whether a terminal wrote a time in brackets before each row."""
    return sum(_STAMPED.match(line) is not None for line in lines) > len(lines) / 2


def _comma_twice(lines: Sequence[str], table: _Table) -> bool:
    """Tell whether each number is cut in two at its decimal comma."""
    if table.delimiter != ",":
        return False
    rows = [_cells(line, ",") for line in lines[table.start : table.start + 40]]
    rows = [row for row in rows if len(row) == table.cells]
    if any("." in cell for row in rows for cell in row):
        return False
    heads = [len(split(line, ",")) for line in lines[: table.start] if line.strip()]
    if table.cells in heads:
        return False
    if any(2 * n in (table.cells, table.cells + 1) and n > 2 for n in heads[-1:]):
        return True
    tails = [[row[c] for row in rows] for c in range(1, table.cells, 2)]
    return len(rows) > 10 and len(tails) > 2 and all(
        len({len(cell) for cell in tail}) == 1 and len(tail[0]) > 2 and "".join(tail).isdigit()
        for tail in tails
    )  # fmt: skip


_RATE = re.compile(
    r"(?:rate|frequency|freq|odr|fs|abtastrate)\b[^\d\n]{0,20}?(\d+(?:[.,]\d+)?)\s*(k?)hz\b", re.I
)


def _rate_in(heads: Sequence[str]) -> float | None:
    """Return the one sample rate that lines above the data say [Hz]."""
    found = {
        float(m[1].replace(",", ".")) * (1000.0 if m[2] else 1.0)
        for line in heads
        for m in _RATE.finditer(line)
    }
    return found.pop() if len(found) == 1 else None


def _why(lines: Sequence[str]) -> str:
    """Say why lines of a text are no table."""
    cells = [c for line in lines[:20] for c in line.replace(";", ",").replace("\t", ",").split(",")]
    labelled = sum(":" in c or "=" in c for c in cells)
    if cells and 2 * labelled > len(cells):
        return "its cells carry their titles, such as 'ax:0.12'; write the numbers alone"
    if _taking_turns(lines):
        return "rows of several sensors take turns; export one row a sample, all sensors beside "\
            "one another"  # fmt: skip
    if _stamped(lines):
        return "each line begins with a time in brackets; write it without them, as a column"
    if sum(re.search(r"\d[dD][+-]?\d+\b", line) is not None for line in lines) > len(lines) / 2:
        return "its exponents are written with a D; write E, as in 9.81E+00"
    way = _table(lines, ",", ".")
    if way is not None and _comma_twice(lines, way):
        return "the comma stands both between the columns and in the numbers; export it with " \
            "semicolons, or with points in the numbers"  # fmt: skip
    if sum(re.fullmatch(r"\s*0[xX][0-9a-fA-F]+\s*", c) is not None for c in cells) > len(cells) / 2:
        return "its numbers are hexadecimal; write them as decimals"
    if len(lines) < 3:
        return "it has fewer than three lines"
    return "no five lines in a row hold three or more columns of numbers"


def _open(path: Path, layout: dict[str, Any]) -> RawTable | None:
    description = LogDescription.model_validate({"file": path.name, **layout})
    if layout.keys() <= {"topic"}:
        return open_raw(path, description)
    try:
        return open_raw(path, description)
    except FoucaultError:
        return None


def _needed(
    path: Path, layout: dict[str, Any], raw: RawTable, columns: tuple[int, ...]
) -> dict[str, Any]:
    """Return the keys of [log] that the reader would not find by itself."""
    if layout.keys() <= {"topic"}:
        return layout
    told = next(raw.blocks(columns))
    for keys in ((), ("decimal",), ("decimal", "delimiter"), ("decimal", "header")):
        some = {k: layout[k] for k in keys}
        some = {k: v for k, v in some.items() if (k, v) != ("decimal", ".")}
        try:
            alone = open_raw(path, LogDescription.model_validate({"file": path.name, **some}))
            if alone.names != raw.names or alone.stamps != raw.stamps:
                continue
            read = next(alone.blocks(columns), None)
        except FoucaultError:
            continue
        if read is not None and np.array_equal(read, told, equal_nan=True):
            return some
    return layout


# -- plain records -------------------------------------------------------------------------------

TYPES = ("float64", "float32")
"""Numbers of plain records that are looked for."""

MOST_COLUMNS = 20
"""Numbers of a record at most [1]."""

MANY = 4_000
"""Records that tell how many numbers each has [1]."""


def _record(path: Path) -> dict[str, Any] | None:
    """Return the layout of plain records one of whose numbers runs on evenly, as a clock does."""
    if format_of(path) not in ("binary", ""):
        return None
    size = path.stat().st_size
    content = np.fromfile(path, np.uint8, min(size, MANY * MOST_COLUMNS * 8))
    for kind in TYPES:
        for order in ("<", ">"):
            width = int(kind[-2:]) // 8
            with np.errstate(invalid="ignore"):
                x = content[: len(content) // width * width].view(f"{order}f{width}").astype(float)
            if not np.isfinite(x).all() or np.abs(x).max(initial=0.0) > 1e15:
                continue
            for columns in range(4, MOST_COLUMNS + 1):
                if size % (width * columns) or len(x) < 50 * columns:
                    continue
                rows = x[: len(x) // columns * columns].reshape(-1, columns)
                if _has_clock(rows):
                    big = {"byte_order": "big"} if order == ">" else {}
                    return {"type": kind, "columns": columns} | big
    return None


def _has_clock(rows: FloatArray) -> bool:
    step = np.diff(rows, axis=0)
    usual = np.median(step, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = np.mean(np.abs(step / usual - 1.0) < 0.3, axis=0) > 0.95
    return bool(np.any(even & (usual > 1e-9)))


# -- the numbers ---------------------------------------------------------------------------------


def _values(raw: RawTable, numbers: tuple[int, ...]) -> tuple[tuple[int, ...], FloatArray, bool]:
    """Return the columns that can be read, their first rows, and whether these are all."""
    try:
        x, whole = _read(raw, numbers)
    except FoucaultError as problem:
        if problem.code != "log.not_numeric":
            raise
        kept = tuple(c for c in numbers if _readable(raw, c))
        if len(kept) < 3:
            raise
        numbers, (x, whole) = kept, _read(raw, kept)
    full = np.isfinite(x).any(axis=0) if len(x) else np.ones(len(numbers), bool)
    return tuple(np.array(numbers)[full].tolist()), x[:, full], whole


def _readable(raw: RawTable, column: int) -> bool:
    try:
        _read(raw, (column,))
    except FoucaultError:
        return False
    return True


def _read(raw: RawTable, numbers: tuple[int, ...]) -> tuple[FloatArray, bool]:
    parts, rows = [], 0
    for part in raw.blocks(numbers):
        parts.append(part)
        rows += len(part)
        if rows >= ROWS:
            return np.concatenate(parts)[:ROWS], False
    return (np.concatenate(parts) if parts else np.empty((0, len(numbers)))), True
