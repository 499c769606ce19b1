"""Delimited and whitespace-separated text, plain or gzip, parsed by pyarrow.

pyarrow splits repeated spaces into empty columns and refuses comments, so the bytes are freed
of both on the way in. Where it stops, the file is scanned again slowly, to say which line and
which cell is wrong.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from itertools import islice
from operator import xor
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal

import numpy as np

from foucault.arrays import FloatArray, of_arrow
from foucault.errors import FoucaultError, error, finding
from foucault.files import decoded
from foucault.logs.dialect import (
    EMPTY,
    LONGEST,
    LOOK_AHEAD,
    SPACE,
    STAMP,
    Dialect,
    dialect_of,
    endless,
    lines,
    number_in,
    open_text,
    position,
    split,
    text_lines,
    uncomment,
)
from foucault.logs.raw import Progress, RawTable, unreadable

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout


BLOCK_BYTES = 4 << 20
BYTE_ORDER = "\ufeff"
"""The mark of a byte order: no part of the text that it stands before."""

_COMMA_IN_TIME = re.compile(rb"(:\d\d),(?=\d)")
"""ISO 8601 allows it before a part of a second; Arrow does not."""

_BLANKS = bytes.maketrans(b"\t\v\f\r", b"    ")
_BLANK_LINE = re.compile(rb"(?m)^[ \t]+(?=\r?$)")


def open_delimited(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a text file: look at its first lines, and parse the rest when asked to."""
    with open_text(path) as stream:
        dialect = dialect_of(stream, description, path.name)

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        return _blocks(path, dialect, columns, progress)

    def words(column: int) -> Iterator[Any]:
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
    """Say which line cannot be read where pyarrow cannot; count the bytes of those that could."""
    import pyarrow as pa

    good = [0]
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
    what of the data could be read [bytes].
    """
    types = {c: _arrow_type(dialect, c) for c in columns}
    for batch in _batches(stream, dialect, types, size, progress, good or [0]):
        yield np.array([_floats(batch.column(f"c{c}")) for c in columns]).T


def _words(
    stream: IO[bytes], dialect: Dialect, column: int, size: int, good: list[int]
) -> Iterator[Any]:
    import pyarrow as pa

    for batch in _batches(stream, dialect, {column: pa.binary()}, size, None, good):
        cells = batch.column(0).combine_chunks()
        yield _decoded(cells.fill_null(b"") if cells.null_count else cells)  # which takes pandas


def _decoded(cells: Any) -> Any:
    """Return an array of cells as text: at once where all are UTF-8."""
    import pyarrow as pa
    from pyarrow import compute

    try:
        text = cells.cast(pa.string())
        plain = not compute.any(compute.match_substring(text, BYTE_ORDER)).as_py()
    except pa.ArrowInvalid:
        plain = False
    return text if plain else pa.array([decoded(cell) for cell in cells.to_pylist()])


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
    for read, pieces in _data_blocks(stream, dialect, size, progress):
        if not all(piece.isspace() or not piece for piece in pieces):
            memory = pa.allocate_buffer(sum(map(len, pieces)))
            room, start = np.frombuffer(memory, np.uint8), 0
            for piece in pieces:
                room[start : start + len(piece)] = np.frombuffer(piece, np.uint8)
                start += len(piece)
            reading = csv.ReadOptions(column_names=keys, block_size=start)
            yield csv.read_csv(pa.BufferReader(memory), reading, parsing, converting)
        good[0] += read


def _arrow_type(dialect: Dialect, column: int) -> Any:
    import pyarrow as pa

    if column not in dialect.stamps:
        return pa.float64()
    return pa.timestamp("ns", tz="UTC" if column in dialect.zoned else None)


def _floats(column: Any) -> FloatArray:
    values = of_arrow(column)
    if values.dtype.kind != "M":
        return values
    seconds = values.astype(np.int64) * 1e-9
    return np.where(np.isnat(values), np.nan, seconds)


def _data_blocks(
    stream: IO[bytes], dialect: Dialect, size: int, progress: Progress | None
) -> Iterator[tuple[int, list[bytes]]]:
    """Yield whole lines of data without comments and repeated spaces, and their length as read."""
    import pyarrow as pa

    for _ in islice(lines(stream), dialect.skip):
        pass
    marks = [mark.encode() for mark in dialect.comment]
    comment = re.compile(rb"[ \t]*(?:" + b"|".join(map(re.escape, marks)) + rb")[^\n]*")
    always = dialect.delimiter == SPACE or (dialect.stamps and dialect.delimiter != ",")
    while chunk := stream.read(BLOCK_BYTES):
        pieces = [chunk]
        if b"\0" not in chunk and not chunk.endswith(b"\n") and (rest := stream.readline(LONGEST)):
            endless(rest)
            pieces.append(rest)
        if any(b"\0" in piece for piece in pieces):
            raise pa.ArrowInvalid("it holds zero bytes")
        read = sum(map(len, pieces))
        # One letter is looked for ten times as fast as two: most files hold none of these.
        if always or any(mark in piece for mark in (*marks, b" ", b"\t") for piece in pieces):
            pieces = [_cleaned(b"".join(pieces), dialect, marks, comment)]
        if progress:
            progress(min(1.0, position(stream) / size))
        yield read, pieces


def _cleaned(
    chunk: bytes, dialect: Dialect, marks: list[bytes], comment: re.Pattern[bytes]
) -> bytes:
    """Return whole lines without comments, blank lines with blanks and repeated spaces."""
    if any(mark in chunk for mark in marks):
        chunk = comment.sub(b"", chunk)
    if dialect.delimiter == SPACE:
        chunk = _single_spaced(chunk)
    elif _starts_blank(chunk):
        chunk = _BLANK_LINE.sub(b"", chunk)
    if dialect.stamps and dialect.delimiter != ",":
        chunk = _COMMA_IN_TIME.sub(rb"\1.", chunk)
    return chunk


def _starts_blank(chunk: bytes) -> bool:
    """Tell whether a line begins with a blank."""
    letters = np.frombuffer(chunk, np.uint8)
    first = letters[1:][letters[:-1] == ord("\n")]
    return chunk[:1] in (b" ", b"\t") or bool(((first == ord(" ")) | (first == ord("\t"))).any())


def _single_spaced(chunk: bytes) -> bytes:
    """Return whole lines with one space between their words, and none at their ends."""
    chunk = chunk.translate(_BLANKS)
    while b"  " in chunk:
        chunk = chunk.replace(b"    ", b" ").replace(b"  ", b" ")
    return chunk.replace(b" \n", b"\n").replace(b"\n ", b"\n").strip(b" ")


def _first_fault(
    path: Path, dialect: Dialect, columns: Sequence[int], good: int
) -> FoucaultError | None:
    """Find the first line that cannot be read after `good` bytes of data, and say what is wrong."""
    with open_text(path) as stream:
        before = dialect.skip
        for _ in islice(lines(stream), dialect.skip):
            pass
        while good > 0 and (passed := stream.read(min(good, BLOCK_BYTES))):
            before, good = before + passed.count(b"\n"), good - len(passed)
        rest = enumerate(text_lines(stream), start=before + 1)
        for number, line in rest:
            if not uncomment(line, dialect.comment).strip():
                continue
            wrong = fault(path.name, dialect, columns, number, line)
            if wrong is None:
                continue
            if wrong.code in ("log.zero_bytes", "log.binary_bytes", "log.begins_again"):
                return wrong
            more = any(
                uncomment(text, dialect.comment).strip() for _, text in islice(rest, LOOK_AHEAD)
            )
            have, want = len(dialect.cells(line)), len(dialect.names)
            if not more and (have < want or not line.endswith("\n")):
                return error("log.truncated", file=path.name, line=number, have=have, want=want)
            return wrong
    return None


BINARY = re.compile(r"[\0-\x08\x0e-\x1f\x7f\ufffd]")
"""What no line of a text log holds."""

WORD = re.compile(r"[^\W\d_]")
"""What every title holds."""


def fault(
    name: str, dialect: Dialect, columns: Sequence[int], number: int, line: str
) -> FoucaultError | None:
    """Say what is wrong with one line of data, or return None.

    `columns`: numbers of the columns that must hold a number [1]; `number`: number of the line,
    from 1 [1].
    """
    if binary := BINARY.search(line):
        code = "log.zero_bytes" if binary[0] == "\0" else "log.binary_bytes"
        return error(code, file=name, line=number, before=number - 1)
    cells, want = dialect.cells(line), len(dialect.names)
    words = all(number_in(c, dialect.decimal) is None and WORD.search(c) for c in cells)
    if words and want > 1 and 3 * len(cells) >= want:  # fewer are no titles, but a logger's remark
        return error("log.begins_again", file=name, line=number, before=number - 1)
    if len(cells) != want:
        # What a spreadsheet or a C library writes for no number, "#N/A" or "1.#QNAN", looks as if a
        # comment began in it.
        whole = split(line.strip(), dialect.delimiter)
        marked = [i for i, c in enumerate(whole) if uncomment(c, dialect.comment) != c]
        if len(whole) == want and marked:
            return error("log.not_numeric", file=name, line=f"line {number}", cell=whole[marked[0]],
                         column=dialect.names[marked[0]], hint="")  # fmt: skip
        return error("log.ragged", file=name, line=number, have=len(cells), want=want)
    for column in columns:
        if column in dialect.stamps:
            match = STAMP.fullmatch(cells[column])
            good = match and bool(match[1]) == (column in dialect.zoned)
            if not good and cells[column] not in EMPTY:
                return error("log.not_a_date", file=name, line=number, cell=cells[column],
                             column=dialect.names[column])  # fmt: skip
        elif number_in(cell := cells[column], dialect.decimal) is None or (
            dialect.decimal == "," and "." in cell
        ):
            other = "," if dialect.decimal == "." else "."
            hint = ""
            if dialect.decimal in cell and number_in(cell.replace(other, ""), dialect.decimal):
                hint = f" Write thousands without '{other}'."
            elif other == "," and other in cell:
                hint = ' If the comma is the decimal sign, write decimal = "," in [log].'
            elif other == "." and other in cell:
                hint = " The comma is taken for the decimal sign, as other cells have one."
            return error("log.not_numeric", file=name, line=f"line {number}", cell=cell,
                         column=dialect.names[column], hint=hint)  # fmt: skip
    return None


# -- Logs of receivers that write one sentence a line, with a checksum, among sentences of others
# NovAtel ``RAWIMU``, ``RAWIMUS``, ``RAWIMUX``, ``RAWIMUSX`` in ASCII: increments over each interval
# in counts, z, minus y, x, of the axes marked on the IMU, x right, y forward, z up. What one count
# is depends on the IMU, so the units are asked for.
#
# VectorNav ``$VNIMU``: rad/s, m/s^2 (-1 g along down at rest) and degC, not compensated, axes
# forward-right-down. It has no time, so the rate is asked for.
#
# References
# ----------
# .. [1] NovAtel, OEM7 Commands and Logs Reference Manual, "RAWIMUX", "32-bit CRC".
# .. [2] VectorNav, VN-100 User Manual, "IMU Measurements" (register 54), "Checksum / CRC".

_ROWS = 1 << 14
_WEEK = 7 * 86400.0


@dataclass(frozen=True)
class _Format:
    """How the sentences of one maker are read.

    `tag` matches the name at the start of a line; `sum` gives the checksum of what stands between
    the first letter and the star, `blank` that of a sentence sent without one; `row` makes the
    numbers of one line of its fields.
    """

    tag: re.Pattern[bytes]
    sum: Callable[[bytes], int]
    blank: bytes
    names: tuple[str, ...]
    row: Callable[[list[bytes]], list[float]]
    declared: dict[str, Any]
    sampled: Literal["rate", "increment"]
    words: dict[str, str]


def open_sentences(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a log of sentences; lines of other sentences are passed over."""
    with open_text(path) as stream:
        found = next(
            ((n, f) for line in lines(stream) for n, f in _FORMATS.items() if f.tag.match(line)),
            None,
        )
    if found is None:
        raise error("log.no_topic", file=path.name, what="no sentence RAWIMU or $VNIMU",
                    have="other lines; of CORRIMUDATA gravity and errors are taken off, so that no "
                    "sensor can be calibrated from it")  # fmt: skip
    form = found[1]

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        size, rows = max(1, path.stat().st_size), list[list[float]]()
        dated = _Weeks(form.names)
        with open_text(path) as stream:
            for number, line in enumerate(lines(stream), start=1):
                if not form.tag.match(line):
                    continue
                rows.append(_numbers(form, line, number, description, path.name))
                if len(rows) == _ROWS:
                    if progress:
                        progress(min(1.0, position(stream) / size))
                    yield dated.counted(np.array(rows))[:, list(columns)]
                    rows = []
        if progress:
            progress(1.0)
        if rows:
            yield dated.counted(np.array(rows))[:, list(columns)]

    told = finding("log.declared", file=path.name, **form.words)
    return RawTable(form.names, True, blocks, findings=(told,), declared=form.declared,
                    sampled=form.sampled)  # fmt: skip


class _Weeks:
    """Counts time on from the first week seen; since 1980 it would lose its last digits."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._at = names.index("week") if "week" in names else None
        self._first = np.nan

    def counted(self, rows: FloatArray) -> FloatArray:
        if self._at is not None:
            weeks, time = rows[:, self._at], rows[:, self._at + 1]
            if np.isnan(self._first) and np.isfinite(weeks).any():
                self._first = float(weeks[np.isfinite(weeks)][0])
            time += (weeks - self._first) * _WEEK
        return rows


def _numbers(
    form: _Format, line: bytes, number: int, description: FileLayout, file: str
) -> list[float]:
    """Return the numbers of a sentence; NaN where it is damaged and may be left out."""
    said, star, tail = line[1:].rstrip().partition(b"*")
    try:
        if not star or (tail.upper() != form.blank and int(tail, 16) != form.sum(said)):
            raise ValueError("its checksum is wrong" if star else "it is cut off")
        row = form.row(said.replace(b";", b",").split(b","))
        if len(row) != len(form.names):
            raise ValueError(f"it has {len(row)} numbers instead of {len(form.names)}")
    except (ValueError, IndexError) as problem:
        if description.missing == "drop":
            return [float("nan")] * len(form.names)
        raise error("log.sentence", file=file, line=number, reason=problem) from None
    return row


def _novatel_sum(said: bytes) -> int:
    return zlib.crc32(said, 0xFFFFFFFF) ^ 0xFFFFFFFF  # begins with 0 and is not inverted


def _vectornav_sum(said: bytes) -> int:
    return reduce(xor, said, 0)


def _novatel_row(fields: list[bytes]) -> list[float]:
    # The last nine fields are alike in all four: week, seconds, status, then the six counts.
    week, seconds, _status, *counts = fields[-9:]
    z, y, x, wz, wy, wx = (float(int(count)) for count in counts)
    return [int(week), float(seconds), wx, wy, wz, x, y, z]


def _vectornav_row(fields: list[bytes]) -> list[float]:
    return [float(field) for field in fields[1:12]]


_FORMATS = {
    "novatel": _Format(
        re.compile(rb"[#%]RAWIMU\w*A,"), _novatel_sum, b"",
        ("week", "time", "gyro_x", "minus_gyro_y", "gyro_z", "accel_x", "minus_accel_y", "accel_z"),
        _novatel_row,
        {
            "time": {"column": "time", "unit": "s"},
            "clock": "disciplined",  # the time of GPS
            **{name: {"columns": [f"{name}_x", f"-minus_{name}_y", f"{name}_z"],
                      "kind": "increment"} for name in ("gyro", "accel")},
        },
        "increment",
        {"what": "sentences RAWIMU of NovAtel", "axes": "those marked on the IMU, right-forward-up",
         "units": "counts of increments, seconds of the week of GPS", "turned": "y = -(minus y)"},
    ),
    "vectornav": _Format(
        re.compile(rb"\$VNIMU,"), _vectornav_sum, b"XX",
        ("mag_x", "mag_y", "mag_z", "accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z",
         "temperature", "pressure"),
        _vectornav_row,
        {
            **{name: {"columns": [f"{name}_y", f"{name}_x", f"-{name}_z"], "unit": unit}
               for name, unit in (("gyro", "rad/s"), ("accel", "m/s^2"))},
            "temperature": {"column": "temperature", "unit": "degC"},
        },
        "rate",
        {"what": "sentences $VNIMU of VectorNav", "axes": "forward-right-down",
         "units": "rad/s, m/s^2, -1 g along down at rest, no time",
         "turned": "x = y, y = x, z = -z"},
    ),
}  # fmt: skip
