"""Delimited and whitespace-separated text, plain or gzip, parsed by pyarrow.

pyarrow splits repeated spaces into empty columns and refuses comments, so the bytes are freed
of both on the way in. Where it stops, the file is scanned again slowly, to say which line and
which cell is wrong.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error
from foucault.files import decoded
from foucault.logs.dialect import (
    EMPTY,
    LOOK_AHEAD,
    SPACE,
    STAMP,
    Dialect,
    dialect_of,
    number_in,
    text_lines,
    uncomment,
)
from foucault.logs.encoding import LONGEST, endless, lines, open_text, position
from foucault.logs.raw import Progress, RawTable, unreadable

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

BLOCK_BYTES = 4 << 20
_COMMA_IN_TIME = re.compile(rb"(:\d\d),(?=\d)")
"""ISO 8601 allows it before a part of a second; Arrow does not."""

_BLANK_LINE = re.compile(rb"(?m)^[ \t]+(?=\r?$)")


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a text file: look at its first lines, and parse the rest when asked to."""
    with open_text(path) as stream:
        dialect = dialect_of(stream, description, path.name)

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        return _blocks(path, dialect, columns, progress)

    def words(column: int) -> Iterator[list[str]]:
        with open_text(path) as stream, _told(path, dialect, ()) as good:
            yield from _words(stream, dialect, column, path.stat().st_size, good)

    known = dialect.marker, dialect.stamps, dialect.findings
    return RawTable(dialect.names, dialect.named, blocks, *known, words)


def _blocks(
    path: Path, dialect: Dialect, columns: Sequence[int], progress: Progress | None
) -> Iterator[FloatArray]:
    with open_text(path) as stream, _told(path, dialect, columns) as good:
        yield from parse(stream, dialect, columns, path.stat().st_size, progress, good)


@contextmanager
def _told(path: Path, dialect: Dialect, columns: Sequence[int]) -> Iterator[list[int]]:
    """Say which line cannot be read, where pyarrow says that one cannot; count those that could."""
    import pyarrow as pa

    good = [dialect.skip]
    try:
        yield good
    except pa.ArrowInvalid as problem:
        wrong = _first_fault(path, dialect, columns, good[0])
        raise wrong or unreadable(path, "text", problem) from problem


def parse(
    stream: IO[bytes],
    dialect: Dialect,
    columns: Sequence[int],
    size: int,
    progress: Progress | None = None,
    good: list[int] | None = None,
) -> Iterator[FloatArray]:
    """Yield the rows of a text; pyarrow raises ArrowInvalid where it cannot read on.

    `columns`: numbers of the columns wanted [1]; `size`: length of the text [bytes]; `progress`
    or None: called with the fraction read, from 0 to 1; `good` or None: its first is raised by
    the number of lines that could be read [1].
    """
    types = {c: _arrow_type(dialect, c) for c in columns}
    for batch in _batches(stream, dialect, types, size, progress, good or [0]):
        yield np.column_stack([_floats(batch.column(f"c{c}")) for c in columns])


def _words(
    stream: IO[bytes], dialect: Dialect, column: int, size: int, good: list[int]
) -> Iterator[list[str]]:
    import pyarrow as pa

    for batch in _batches(stream, dialect, {column: pa.binary()}, size, None, good):
        yield [decoded(word or b"") for word in batch.column(0).to_pylist()]


def _batches(
    stream: IO[bytes],
    dialect: Dialect,
    types: dict[int, Any],
    size: int,
    progress: Progress | None,
    good: list[int],
) -> Iterator[Any]:
    import pyarrow as pa
    from pyarrow import csv

    keys = [f"c{i}" for i in range(len(dialect.names))]  # names in files may repeat
    parsing = csv.ParseOptions(delimiter=dialect.delimiter)
    converting = csv.ConvertOptions(
        include_columns=[keys[c] for c in types],
        column_types={keys[c]: kind for c, kind in types.items()},
        timestamp_parsers=[csv.ISO8601],
        null_values=EMPTY,
        strings_can_be_null=True,
        decimal_point=dialect.decimal,
    )
    # Blocks in memory that is Arrow's: a thread of its reads ahead, and after a fault it outlives
    # the call; a file or bytes of Python may then be gone, or the whole interpreter.
    for block in _data_blocks(stream, dialect, size, progress):
        if block.isspace():
            good[0] += block.count(b"\n")
            continue
        reading = csv.ReadOptions(column_names=keys, block_size=len(block))
        memory = pa.allocate_buffer(len(block))
        np.frombuffer(memory, np.uint8)[:] = np.frombuffer(block, np.uint8)
        yield csv.read_csv(pa.BufferReader(memory), reading, parsing, converting)
        good[0] += block.count(b"\n")


def _arrow_type(dialect: Dialect, column: int) -> Any:
    import pyarrow as pa

    if column not in dialect.stamps:
        return pa.float64()
    return pa.timestamp("ns", tz="UTC" if column in dialect.zoned else None)


def _floats(column: Any) -> FloatArray:
    values: Any = column.to_numpy(zero_copy_only=False)
    if values.dtype.kind != "M":
        return cast(FloatArray, values)
    seconds = values.astype(np.int64) * 1e-9
    return np.where(np.isnat(values), np.nan, seconds)


def _data_blocks(
    stream: IO[bytes], dialect: Dialect, size: int, progress: Progress | None
) -> Iterator[bytes]:
    """Yield whole lines of data as bytes, without comments and repeated spaces."""
    import pyarrow as pa

    for _ in islice(lines(stream), dialect.skip):
        pass
    marks = [mark.encode() for mark in dialect.comment]
    comment = re.compile(rb"[ \t]*(?:" + b"|".join(map(re.escape, marks)) + rb")[^\n]*")
    while chunk := stream.read(BLOCK_BYTES):
        if b"\0" not in chunk and not chunk.endswith(b"\n"):
            rest = stream.readline(LONGEST)
            endless(rest)
            chunk += rest
        if b"\0" in chunk:
            raise pa.ArrowInvalid("it holds zero bytes")
        if any(mark in chunk for mark in marks):
            chunk = comment.sub(b"", chunk)
        if dialect.delimiter == SPACE:
            chunk = b"\n".join([b" ".join(line.split()) for line in chunk.split(b"\n")])
        elif chunk[:1].isspace() or b"\n " in chunk or b"\n\t" in chunk:
            chunk = _BLANK_LINE.sub(b"", chunk)
        if dialect.stamps and dialect.delimiter != ",":
            chunk = _COMMA_IN_TIME.sub(rb"\1.", chunk)
        if progress:
            progress(min(1.0, position(stream) / size))
        yield chunk


def _first_fault(
    path: Path, dialect: Dialect, columns: Sequence[int], good: int
) -> FoucaultError | None:
    """Find the first line after `good` ones that cannot be read, and say what is wrong with it."""
    with open_text(path) as stream:
        for _ in islice(lines(stream), good):
            pass
        rest = enumerate(text_lines(stream), start=good + 1)
        for number, line in rest:
            if not uncomment(line, dialect.comment).strip():
                continue
            wrong = fault(path.name, dialect, columns, number, line)
            if wrong is None:
                continue
            if wrong.code == "log.zero_bytes":
                return wrong
            more = any(
                uncomment(text, dialect.comment).strip() for _, text in islice(rest, LOOK_AHEAD)
            )
            have, want = len(dialect.cells(line)), len(dialect.names)
            if not more and (have < want or not line.endswith("\n")):
                return error("log.truncated", file=path.name, line=number, have=have, want=want)
            return wrong
    return None


def fault(
    name: str, dialect: Dialect, columns: Sequence[int], number: int, line: str
) -> FoucaultError | None:
    """Say what is wrong with one line of data, or return None.

    `columns`: numbers of the columns that must hold a number [1]; `number`: number of the line,
    from 1 [1].
    """
    if "\0" in line:
        return error("log.zero_bytes", file=name, line=number, before=number - 1)
    cells, want = dialect.cells(line), len(dialect.names)
    if len(cells) != want:
        return error("log.ragged", file=name, line=number, have=len(cells), want=want)
    for column in columns:
        if column in dialect.stamps:
            match = STAMP.fullmatch(cells[column])
            good = match and bool(match[1]) == (column in dialect.zoned)
            if not good and cells[column] not in EMPTY:
                return error("log.not_a_date", file=name, line=number, cell=cells[column],
                             column=dialect.names[column])  # fmt: skip
        elif number_in(cells[column], dialect.decimal) is None:
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
