"""Text as the programs that write it encode it, handed on as UTF-8 with newlines.

UTF-16 is what spreadsheets call "Unicode text" and what a redirection of Windows PowerShell writes;
Windows-1252 is read line by line (`foucault.files.decoded`), so that numbers stay bytes.
"""

from __future__ import annotations

import codecs
import gzip
from collections.abc import Iterator
from io import BufferedReader, IncrementalNewlineDecoder, RawIOBase
from pathlib import Path
from typing import IO, Any, cast

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
        inner = codecs.getincrementaldecoder("utf-16")("replace")
    elif b"\r" in start and b"\n" not in start:  # lines as spreadsheets end them for old Macs
        inner = codecs.getincrementaldecoder("utf-8")("surrogateescape")
    else:
        return None
    return IncrementalNewlineDecoder(inner, translate=True)


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
        while left > 0 and (piece := super().read(int(min(left, _PIECE << 4)))):
            pieces.append(piece)
            left -= len(piece)
            self._watch()
        return b"".join(pieces)

    def readline(self, size: int | None = -1) -> bytes:
        line = super().readline(LONGEST if size is None or size < 0 else size)
        self._watch()
        return line

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
