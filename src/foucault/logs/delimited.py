"""Delimited and whitespace-separated text, plain or gzip, parsed by pyarrow.

pyarrow splits repeated spaces into empty columns and refuses comments, so the bytes are freed
of both on the way in. Where it stops, the file is scanned again slowly, to say which line and
which cell is wrong.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from foucault.errors import FoucaultError, error
from foucault.logs.own import MARKER
from foucault.logs.raw import Progress, RawTable, open_bytes, unreadable
from foucault.tables import FloatArray

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

BLOCK_BYTES = 4 << 20
SPACE = " "
_BLANK_LINE = re.compile(rb"(?m)^[ \t]+(?=\r?$)")
EMPTY = ("", "NA", "N/A", "n/a", "null", "NULL", "None", "nan", "NaN", "NAN", "-nan")
"""Cells that mean "no value"."""


@dataclass(frozen=True)
class Dialect:
    """How the lines of one file are to be read.

    `skip`, shape (), counts every line before the data, comment and blank lines included.
    """

    skip: int
    delimiter: str
    decimal: str
    comment: tuple[str, ...]
    names: tuple[str, ...]
    named: bool
    marker: str

    def cells(self, line: str) -> list[str]:
        """Split one line into its cells."""
        return _split(_uncomment(line, self.comment), self.delimiter)


def open_raw(path: Path, description: LogDescription, progress: Progress | None) -> RawTable:
    """Open a text file: look at its first lines, and parse the rest when asked to."""
    with open_bytes(path) as stream:
        dialect = dialect_of(stream, description, path.name)

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        return _blocks(path, dialect, columns, progress)

    return RawTable(dialect.names, dialect.named, blocks, dialect.marker)


def _blocks(
    path: Path, dialect: Dialect, columns: Sequence[int], progress: Progress | None
) -> Iterator[FloatArray]:
    import pyarrow as pa

    with open_bytes(path) as stream:
        try:
            yield from parse(stream, dialect, columns, path.stat().st_size, progress)
        except pa.ArrowInvalid as problem:
            raise _first_fault(path, dialect, columns) or unreadable(
                path, "text", problem
            ) from problem


def parse(
    stream: IO[bytes],
    dialect: Dialect,
    columns: Sequence[int],
    size: int,
    progress: Progress | None = None,
) -> Iterator[FloatArray]:
    """Yield the rows of a text; pyarrow raises ArrowInvalid where it cannot read on.

    Parameters
    ----------
    stream : file
        The text, from its first line.
    dialect : Dialect
        How its lines are to be read.
    columns : sequence of int
        Numbers of the columns wanted [1].
    size : int, shape ()
        Length of the text [bytes].
    progress : callable or None
        Called with the fraction read, from 0 to 1.
    """
    import pyarrow as pa
    from pyarrow import csv

    keys = [f"c{i}" for i in range(len(dialect.names))]  # names in files may repeat
    wanted = [keys[c] for c in columns]
    reader = csv.open_csv(
        pa.PythonFile(_DataLines(stream, dialect, size, progress), mode="r"),
        read_options=csv.ReadOptions(column_names=keys, block_size=BLOCK_BYTES),
        parse_options=csv.ParseOptions(delimiter=dialect.delimiter),
        convert_options=csv.ConvertOptions(
            include_columns=list(dict.fromkeys(wanted)),
            column_types={key: pa.float64() for key in wanted},
            null_values=EMPTY,
            strings_can_be_null=True,
            decimal_point=dialect.decimal,
        ),
    )
    for batch in reader:
        yield np.column_stack([batch.column(k).to_numpy(zero_copy_only=False) for k in wanted])


class _DataLines:
    """The data lines of a text file as bytes, without comments and repeated spaces."""

    closed = False

    def __init__(
        self, stream: IO[bytes], dialect: Dialect, size: int, progress: Progress | None
    ) -> None:
        for _ in islice(stream, dialect.skip):
            pass
        self._stream, self._size, self._progress = stream, size, progress
        self._raw: Any = getattr(stream, "fileobj", stream)  # of gzip: the packed bytes
        self._squeeze = dialect.delimiter == SPACE
        self._marks = [mark.encode() for mark in dialect.comment]
        self._comment = re.compile(
            rb"[ \t]*(?:" + b"|".join(map(re.escape, self._marks)) + rb")[^\n]*"
        )
        self._rest = b""

    def read(self, size: int = -1) -> bytes:
        """Return up to `size` bytes, empty at the end."""
        while not self._rest:
            chunk = self._stream.read(max(size, 1 << 16))
            if not chunk:
                return b""
            self._rest = self._clean(chunk + self._stream.readline())
            if self._progress:
                self._progress(min(1.0, self._raw.tell() / self._size))
        out, self._rest = self._rest[:size], self._rest[size:]
        return out

    def _clean(self, chunk: bytes) -> bytes:
        if any(mark in chunk for mark in self._marks):
            chunk = self._comment.sub(b"", chunk)
        if self._squeeze:
            chunk = b"\n".join([b" ".join(line.split()) for line in chunk.split(b"\n")])
        elif chunk[:1].isspace() or b"\n " in chunk or b"\n\t" in chunk:
            chunk = _BLANK_LINE.sub(b"", chunk)
        return chunk

    def close(self) -> None:
        """Do nothing: the stream is closed by the one who opened it."""


def dialect_of(stream: IO[bytes], description: LogDescription, name: str) -> Dialect:
    """Tell from the first lines of a text how to read it.

    Parameters
    ----------
    stream : file
        The text, from its first line.
    description : LogDescription
        What is known of it.
    name : str
        Name of the file, for the texts.
    """
    comment = description.comment
    marker, remark, heads, skip = "", "", list[str](), 0
    for line in _lines(stream):
        if "\0" in line:
            raise ValueError("it is not UTF-8 text (saved as UTF-16?)")
        text = line.strip()
        remark = text if _is_comment(text, comment) else remark
        marker = text if MARKER in remark and not marker else marker
        content = _uncomment(text, comment).strip()
        if content and not _is_head(content, len(heads), description):
            break
        heads += [content] if content else []
        skip += 1
    else:
        raise error("log.empty", file=name)
    delimiter = _delimiter(content, description)
    count = len(_split(content, delimiter))
    names = _names(heads, remark, delimiter, count, comment)
    head = next((h for h in heads if not _any_number(_split(h, delimiter))), None)
    if names is None and head and delimiter != SPACE and description.header == "auto":
        have = len(_split(head, delimiter))
        raise error("log.header_count", file=name, names=have, line=skip + 1, cells=count)
    numbers = tuple(str(i) for i in range(count))
    return Dialect(
        skip, delimiter, description.decimal, comment, names or numbers, names is not None, marker
    )


def _is_head(content: str, seen: int, description: LogDescription) -> bool:
    if isinstance(description.header, int):
        return seen < description.header
    if description.header == "none":
        return False
    # Titles and units are lines without a single number, before the first line that has one.
    return not _any_number(_split(content, _delimiter(content, description)))


def _names(
    heads: list[str], remark: str, delimiter: str, count: int, comment: tuple[str, ...]
) -> tuple[str, ...] | None:
    # The first title line that fits; "# t gx gy gz" counts as one where there is no other.
    for mark in comment:
        remark = remark.removeprefix(mark)
    for line in [*heads, remark]:
        cells = _split(line, delimiter)
        if len(cells) == count and not _any_number(cells):
            return tuple(cells)
    return None


def _delimiter(content: str, description: LogDescription) -> str:
    if description.delimiter != "auto":
        spaces = ("space", "spaces", "whitespace", " ")
        return SPACE if description.delimiter in spaces else description.delimiter
    for candidate in (";", "\t", "|") if description.decimal == "," else (";", ",", "\t", "|"):
        if candidate in content:
            return candidate
    return SPACE


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == SPACE:
        return line.split()
    return [cell.strip().strip('"') for cell in line.rstrip("\r\n").split(delimiter)]


def _is_comment(text: str, comment: tuple[str, ...]) -> bool:
    return any(text.startswith(mark) for mark in comment)


def _uncomment(line: str, comment: tuple[str, ...]) -> str:
    for mark in comment:
        line = line.partition(mark)[0]
    return line


def _number(cell: str, decimal: str) -> float | None:
    if cell in EMPTY:
        return float("nan")
    try:
        return None if "_" in cell else float(cell.replace(decimal, "."))
    except ValueError:
        return None


def _any_number(cells: list[str]) -> bool:
    # A decimal comma counts, declared or not: such a line is data, not a title.
    return any(cell and _number(cell, ",") is not None for cell in cells)


def _lines(stream: IO[bytes]) -> Iterator[str]:
    for line in stream:
        yield line.decode("utf-8", errors="replace").removeprefix("\ufeff")


def _first_fault(path: Path, dialect: Dialect, columns: Sequence[int]) -> FoucaultError | None:
    """Find the first line that cannot be read, and say what is wrong with it."""
    with open_bytes(path) as stream:
        lines = enumerate(_lines(stream), start=1)
        for number, line in islice(lines, dialect.skip, None):
            if not _uncomment(line, dialect.comment).strip():
                continue
            wrong = fault(path.name, dialect, columns, number, line)
            if wrong is None:
                continue
            more = any(_uncomment(text, dialect.comment).strip() for _, text in lines)
            have, want = len(dialect.cells(line)), len(dialect.names)
            if not more and (have < want or not line.endswith("\n")):
                return error("log.truncated", file=path.name, line=number, have=have, want=want)
            return wrong
    return None


def fault(
    name: str, dialect: Dialect, columns: Sequence[int], number: int, line: str
) -> FoucaultError | None:
    """Say what is wrong with one line of data, or return None.

    Parameters
    ----------
    name : str
        Name of the file, for the text.
    dialect : Dialect
        How its lines are to be read.
    columns : sequence of int
        Numbers of the columns that must hold a number [1].
    number : int, shape ()
        Number of the line, from 1 [1].
    line : str
        The line.
    """
    cells, want = dialect.cells(line), len(dialect.names)
    if len(cells) != want:
        return error("log.ragged", file=name, line=number, have=len(cells), want=want)
    for column in columns:
        if _number(cells[column], dialect.decimal) is None:
            comma = "," in cells[column] and dialect.decimal == "."
            return error(
                "log.not_numeric",
                file=name,
                line=f"line {number}",
                column=dialect.names[column],
                cell=cells[column],
                hint=' If the comma is the decimal sign, write decimal = "," in [log].'
                if comma
                else "",
            )
    return None
