"""How a text file is written: its titles, its delimiter, and where the samples begin.

Text as the programs that write it encode it, handed on as UTF-8 with newlines.

UTF-16 is what spreadsheets call "Unicode text" and what a redirection of Windows PowerShell writes;
Windows-1252 is read line by line (`foucault.files.decoded`), so that numbers stay bytes.
"""

from __future__ import annotations

import codecs
import gzip
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BufferedReader, IncrementalNewlineDecoder, RawIOBase
from itertools import chain, islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from foucault.errors import Finding, error, finding
from foucault.files import decoded
from foucault.logs.layout import SPACES
from foucault.logs.own import MARKER

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

LONGEST = 4 << 20
"""A line of text is no longer than this [bytes]."""

SMALL = 64 << 20
"""What unpacks to no more than this is unpacked, whatever its size was [bytes]."""

PACKED = 200
"""Nothing that was measured packs smaller than by this factor [1]."""

_START = 4096  # bytes from which the encoding is told
_PIECE = 1 << 16


def decoder(start: bytes) -> IncrementalNewlineDecoder | None:
    """Return what decodes a text, None where its bytes can be read as they are."""
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        inner: codecs.IncrementalDecoder = codecs.getincrementaldecoder("utf-16")("replace")
    elif wide := _unmarked(start):
        inner = codecs.getincrementaldecoder(wide)("replace")
    elif b"\r" in start and b"\n" not in start:  # lines as spreadsheets end them for old Macs
        inner = codecs.getincrementaldecoder("utf-8")("surrogateescape")
    else:
        return None
    return IncrementalNewlineDecoder(inner, translate=True)


def _unmarked(start: bytes) -> str:
    """Return which UTF-16 the first bytes of a text are where no mark says so, "" for none."""
    letters = len(start) // 2
    for name, one, other in (("utf-16-le", 0, 1), ("utf-16-be", 1, 0)):
        said = start[one::2]
        zeros = start[other::2].count(0)
        if letters > 8 and zeros > 0.9 * letters and 0 not in said and is_text(said):
            return name
    return ""


def encoded(decoding: IncrementalNewlineDecoder, chunk: bytes, final: bool = False) -> bytes:
    """Return the next bytes of a text as UTF-8."""
    return decoding.decode(chunk, final).encode("utf-8", "surrogateescape")


def is_text(start: bytes) -> bool:
    """Tell whether the first bytes of a file look like text."""
    return not any(byte < 9 or 13 < byte < 32 for byte in start)


def open_bytes(path: Path) -> IO[bytes]:
    """Open a file for reading, unpacked if it is gzip by content, whatever its suffix."""
    stream = path.open("rb")
    magic = stream.read(2)
    stream.seek(0)
    if magic != b"\x1f\x8b":
        return stream
    stream.close()
    return cast(IO[bytes], _Unpacked(path, "rb"))


def lines(stream: IO[bytes]) -> Iterator[bytes]:
    """Yield the lines of a text, in pieces where one with zero bytes in it never ends."""
    while line := stream.readline(LONGEST):
        endless(line)
        yield line


def endless(line: bytes) -> None:
    """Refuse a line that is longer than any is, but for one of zero bytes, told elsewhere."""
    if len(line) >= LONGEST and not line.endswith(b"\n") and b"\0" not in line:
        raise ValueError(f"one of its lines is longer than {LONGEST >> 20} MB")


def not_a_bomb(unpacked: float, packed: float) -> None:
    """Refuse what unpacks to far more than any readings do.

    `unpacked`: its length as it is used [bytes]; `packed`: its length in the file [bytes].
    """
    if unpacked > max(SMALL, PACKED * packed):
        raise ValueError(
            f"{packed / 1e6:.3g} MB of it unpack to more than {unpacked / 1e6:.3g} MB; readings do "
            f"not pack by a factor of {PACKED}"
        )


class _Unpacked(gzip.GzipFile):
    """A packed file that is read no further once it unpacks to what cannot be readings."""

    def read(self, size: int | None = -1) -> bytes:
        left = float("inf") if size is None or size < 0 else size
        pieces: list[bytes] = []
        while left > 0 and (piece := self._piece(super().read, int(min(left, _PIECE << 4)))):
            pieces.append(piece)
            left -= len(piece)
            self._watch()
        return b"".join(pieces)

    def readline(self, size: int | None = -1) -> bytes:
        line = self._piece(super().readline, LONGEST if size is None or size < 0 else size)
        self._watch()
        return line

    @staticmethod
    def _piece(read: Callable[[int], bytes], size: int) -> bytes:
        try:
            return read(size)
        except zlib.error as problem:  # damaged inside; the rest of its faults are of the system
            raise gzip.BadGzipFile(str(problem)) from problem

    def _watch(self) -> None:
        not_a_bomb(self.tell(), position(self))


def position(stream: Any) -> int:
    """Return how much of its file a stream has read [bytes]; packed bytes where it is gzip."""
    below = getattr(stream, "fileobj", None) or getattr(stream, "raw", stream)
    return cast(int, below.tell())


def open_text(path: Path) -> IO[bytes]:
    """Open a text, packed or not, as lines of bytes that `foucault.files.decoded` can read."""
    stream = open_bytes(path)
    try:
        start = stream.read(_START)
        stream.seek(len(codecs.BOM_UTF8) if start.startswith(codecs.BOM_UTF8) else 0)
    except BaseException:  # packed, and damaged
        stream.close()
        raise
    decoding = decoder(start)
    return stream if decoding is None else BufferedReader(_Recoded(stream, decoding), _PIECE)


class _Recoded(RawIOBase):
    """The bytes of a text, as UTF-8."""

    def __init__(self, stream: IO[bytes], decoding: IncrementalNewlineDecoder) -> None:
        self._stream, self._decoding = stream, decoding
        self._ready = b""

    def readable(self) -> bool:
        return True

    def readinto(self, room: Any) -> int:
        while not self._ready and not self._stream.closed:
            chunk = self._stream.read(_PIECE)
            self._ready = encoded(self._decoding, chunk, final=not chunk)
            if not chunk:
                break
        count = min(len(room), len(self._ready))
        room[:count], self._ready = self._ready[:count], self._ready[count:]
        return count

    def tell(self) -> int:
        return position(self._stream)

    def close(self) -> None:
        self._stream.close()
        super().close()


SPACE = " "

EMPTY = ("", "NA", "N/A", "n/a", "null", "NULL", "None", "nan", "NaN", "NAN", "-nan")
"""Cells that mean "no value"."""

STAMP = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:[.,]\d{1,9})?)?(Z|[-+]\d\d:?(?:\d\d)?)?"
)
"""A date and time of day as ISO 8601 writes it; the group is the time zone."""

LONGEST_HEAD = 4 << 20
"""Titles and remarks before the samples are no longer than this [characters]."""

LOOK_AHEAD = 200
"""Lines looked at to find where the samples begin [1]."""


@dataclass(frozen=True)
class Dialect:
    """How the lines of one file are to be read.

    `skip`, shape (), counts every line before the data, comment and blank lines included;
    `stamps` are the numbers of the columns of dates, and `zoned` those that name a time zone.
    """

    skip: int
    delimiter: str
    decimal: str
    comment: tuple[str, ...]
    names: tuple[str, ...]
    named: bool
    marker: str
    stamps: tuple[int, ...] = ()
    zoned: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()

    def cells(self, line: str) -> list[str]:
        """Split one line into its cells."""
        return split(uncomment(line, self.comment), self.delimiter)


def dialect_of(stream: IO[bytes], description: FileLayout, name: str) -> Dialect:
    """Tell from the first lines of a text how to read it."""
    comment = description.comment
    marker, remark, heads, skip = "", "", list[str](), 0
    seen: list[str] = []
    rest, size = text_lines(stream), 0
    for line in rest:
        if "\0" in line:
            raise error("log.encoding", file=name)
        seen.append(line)
        size += len(line)
        if size > LONGEST_HEAD:
            raise ValueError(f"its first {LONGEST_HEAD >> 20} MB hold no sample")
        text = line.strip()
        remark = text if text.startswith(comment) else remark
        marker = text if MARKER in remark and not marker else marker
        content = uncomment(text, comment).strip()
        if content and not _is_head(content, skip, description):
            break
        heads += [content] if content else []
        skip += 1
    else:
        raise error("log.empty", file=name)
    delimiter = _delimiter(content, description)
    count = len(split(content, delimiter))
    names = _names(heads, remark, delimiter, count, comment)
    head = next((h for h in heads if not _any_number(split(h, delimiter))), None)
    if description.header == "auto":
        _no_preamble(list(chain(seen, islice(rest, LOOK_AHEAD))), skip, description, name)
    if names is None and head and delimiter != SPACE and description.header == "auto":
        have = len(split(head, delimiter))
        raise error("log.header_count", file=name, names=have, line=skip + 1, cells=count,
                    header=skip)  # fmt: skip
    numbers = tuple(str(i) for i in range(count))
    zones = {i: m[1] for i, c in enumerate(split(content, delimiter)) if (m := STAMP.fullmatch(c))}
    return Dialect(
        skip, delimiter, description.decimal, comment, names or numbers, names is not None, marker,
        tuple(zones), tuple(i for i, zone in zones.items() if zone),
        _numbers_skipped(seen[:skip], description, delimiter, count, name),
    )  # fmt: skip


def _no_preamble(lines: list[str], skip: int, description: FileLayout, name: str) -> None:
    """Refuse a file whose first line with a number belongs to no sample; say where they begin."""

    def cells(line: str) -> list[str]:
        content = uncomment(line, description.comment).strip()
        return split(content, _delimiter(content, description)) if content else []

    if all(_is_sample(cell) for cell in cells(lines[skip])):
        return
    rows = [(i, cells(line)) for i, line in enumerate(lines) if i >= skip]
    rows = [(i, row) for i, row in rows if row]
    for (i, first), *others in zip(rows, rows[1:], rows[2:], strict=False):
        if all(len(row) == len(first) > 1 for _, row in others) and all(map(_is_sample, first)):
            if len(first) != len(cells(lines[skip])):
                raise error("log.preamble", file=name, line=skip + 1, header=i,
                            text=_shown(lines[skip]))  # fmt: skip
            return


def _is_sample(cell: str) -> bool:
    return number_in(cell, ",") is not None or STAMP.fullmatch(cell) is not None


def _numbers_skipped(
    lines: list[str], description: FileLayout, delimiter: str, count: int, name: str
) -> tuple[Finding, ...]:
    """Tell the last line of a declared header that looks like a sample."""
    found: tuple[Finding, ...] = ()
    for i, line in enumerate(lines, start=1):
        cells = split(uncomment(line, description.comment).strip(), delimiter)
        if len(cells) == count and all(c and _is_sample(c) for c in cells):
            words = {"line": i, "header": description.header, "text": _shown(line)}
            found = (finding("log.header_numbers", file=name, **words),)
    return found


def _shown(line: str) -> str:
    text = line.strip()
    return text if len(text) <= 60 else text[:57] + "..."


def _is_head(content: str, seen: int, description: FileLayout) -> bool:
    if isinstance(description.header, int):
        return seen < description.header
    if description.header == "none":
        return False
    # Titles and units are lines without a single number, before the first line that has one.
    return not _any_number(split(content, _delimiter(content, description)))


def _names(
    heads: list[str], remark: str, delimiter: str, count: int, comment: tuple[str, ...]
) -> tuple[str, ...] | None:
    # Of the lines that fit the one that tells most columns apart, the first of several: groups
    # stand above titles. "# t gx gy gz" counts as one where there is no other.
    for mark in comment:
        remark = remark.removeprefix(mark)
    rows = [split(line, delimiter) for line in heads]
    fit = [row for row in rows if len(row) == count and not _any_number(row)]
    last = split(remark, delimiter)
    fit = fit or [last] * (len(last) == count and not _any_number(last))
    return tuple(max(fit, key=lambda row: len(set(row)))) if fit else None


def _delimiter(content: str, description: FileLayout) -> str:
    if description.delimiter != "auto":
        return SPACE if description.delimiter in SPACES else description.delimiter
    for candidate in (";", "\t", "|") if description.decimal == "," else (";", ",", "\t", "|"):
        if candidate in content:
            return candidate
    return SPACE


def split(line: str, delimiter: str) -> list[str]:
    """Split one line at its delimiter; quotes around a cell are taken off."""
    if delimiter == SPACE:
        return line.split()
    cells = line.rstrip("\r\n").split(delimiter)
    if '"' in line:
        cells = _quoted(cells, delimiter)
    return [cell.strip().strip('"') for cell in cells]


def _quoted(cells: list[str], delimiter: str) -> list[str]:
    """Join the pieces of cells whose quotes hold a delimiter, as in "9,81"."""
    out: list[list[str]] = []
    inside = False
    for cell in cells:
        if inside:
            out[-1].append(cell)
        else:
            out.append([cell])
        if inside or cell.startswith('"'):
            inside ^= cell.count('"') % 2 == 1
    return [delimiter.join(pieces) for pieces in out]


def uncomment(line: str, comment: tuple[str, ...]) -> str:
    """Return a line up to its first remark."""
    for mark in comment:
        line = line.partition(mark)[0]
    return line


def number_in(cell: str, decimal: str) -> float | None:
    """Return the number in a cell, NaN for a missing one, None where it holds none."""
    if cell in EMPTY:
        return float("nan")
    try:
        return None if "_" in cell else float(cell.replace(decimal, "."))
    except ValueError:
        return None


def _any_number(cells: list[str]) -> bool:
    # A decimal comma counts, declared or not: such a line is data, not a title.
    return any(cell and number_in(cell, ",") is not None for cell in cells)


def text_lines(stream: IO[bytes]) -> Iterator[str]:
    """Yield the lines of a text."""
    for line in lines(stream):
        yield decoded(line)
