"""Follow a delimited text log while another program writes it, from a file or from a pipe.

A tail hands out the bytes that are new; the `Follower` makes rows of them, complete lines only.
A line that cannot be read is left out and told: the logger goes on, and so does the watching.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO, IncrementalNewlineDecoder
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.files import decoded
from foucault.logs import checks, delimited
from foucault.logs.declared import complete
from foucault.logs.dialect import dialect_of
from foucault.logs.encoding import decoder, encoded, is_text
from foucault.logs.raw import RawTable, of_own, unreadable
from foucault.logs.reading import converted
from foucault.tables import Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

READ_BYTES = 1 << 20
"""Most bytes taken at once, so that a long log is shown while it is caught up with."""

_FINGERPRINT = 64  # bytes before the end that tell whether a file was written anew
_LONGEST_LINE = 1 << 16


class Tail(Protocol):
    """Where new bytes come from."""

    name: str
    restarts: int
    ended: bool
    missing: bool

    def read(self) -> bytes:
        """Return the bytes that are new, empty where there are none; never wait."""


class FileTail:
    """The bytes that another program appends to a file, which need not exist yet.

    Attributes
    ----------
    name : str
        Name of the file.
    restarts : int, shape ()
        How often the file was emptied, replaced or written anew [1].
    ended : bool
        Whether nothing more can come: never.
    missing : bool
        Whether there is no such file now.
    """

    ended = False

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self.restarts = 0
        self.missing = True
        self._path = path
        self._position = 0
        self._last = b""
        self._file = 0

    def read(self) -> bytes:
        """Return the bytes that are new, from the start where the file was written anew."""
        try:
            stream = self._path.open("rb")
        except FileNotFoundError:
            self.missing = True
            return b""
        except OSError as problem:
            raise unreadable(self._path, "text", problem) from None
        with stream:
            self.missing = False
            state = os.fstat(stream.fileno())
            if self._position and self._is_new(stream, state):
                self._position, self._last = 0, b""
                self.restarts += 1
            self._file = state.st_ino
            stream.seek(self._position)
            chunk = stream.read(READ_BYTES)
        self._position += len(chunk)
        self._last = (self._last + chunk)[-_FINGERPRINT:]
        return chunk

    def _is_new(self, stream: IO[bytes], state: os.stat_result) -> bool:
        if state.st_size < self._position or state.st_ino != self._file:
            return True
        if state.st_size == self._position:
            return False
        # Emptied and filled beyond the old end since we last looked: other bytes before it.
        stream.seek(self._position - len(self._last))
        return stream.read(len(self._last)) != self._last


class StreamTail:
    """The bytes of a pipe; a thread waits for them, so that nobody else must.

    Attributes
    ----------
    name : str
        What to call it.
    restarts : int, shape ()
        Always 0 [1].
    ended : bool
        Whether the writer has closed the pipe and all was read.
    missing : bool
        Always False.
    """

    restarts = 0
    missing = False

    def __init__(self, stream: IO[bytes], name: str = "standard input") -> None:
        self.name = name
        self.ended = False
        self._blocks: queue.Queue[bytes] = queue.Queue(maxsize=64)
        threading.Thread(target=self._pump, args=(stream,), daemon=True).start()

    def _pump(self, stream: IO[bytes]) -> None:
        try:
            number = stream.fileno()
        except (OSError, AttributeError):
            number = -1
        while True:
            # Not the buffered stream: its lock, held here, would disturb the end of the program.
            block = os.read(number, 1 << 16) if number >= 0 else stream.read(1 << 16)
            self._blocks.put(block)
            if not block:
                return

    def read(self) -> bytes:
        """Return the bytes that are new."""
        blocks: list[bytes] = []
        while not self.ended and len(blocks) < READ_BYTES >> 16:
            try:
                block = self._blocks.get_nowait()
            except queue.Empty:
                break
            self.ended = not block
            blocks.append(block)
        return b"".join(blocks)


class Follower:
    """The rows of a log, as they come.

    Attributes
    ----------
    tail : Tail
        Where the bytes come from.
    behind : bool
        Whether more bytes are waiting already.
    used : LogDescription or None
        The complete description, once the first line of data has come.
    """

    def __init__(self, tail: Tail, description: LogDescription) -> None:
        files = description.files()
        if len(files) != 1:
            names = ", ".join(files)
            raise error("watch.several_files", count=len(files), files=names)
        ((_, self._wanted),) = files.items()
        self.tail = tail
        self.behind = False
        self.used: LogDescription | None = None
        self._description = description
        self._restarts = 0
        self._start()

    def _start(self) -> None:
        self.used = None
        self._begun: bytes | None = b""
        self._decoding: IncrementalNewlineDecoder | None = None
        self._text = b""  # bytes not used yet: an incomplete line, or titles without data
        self._line = self._row = 0  # lines and rows so far
        self._left_out = 0
        self._reason = ""
        self._times = np.empty(0)
        self._last: dict[str, FloatArray] | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed of the lines; what the samples show is for others."""
        told = list(self._dialect.findings) if self.used is not None else []
        if self._restarts:
            told.append(finding("watch.restarted", file=self.tail.name))
        if self._left_out:
            told.append(finding("watch.lines", count=self._left_out, reason=self._reason))
        return tuple(told)

    @property
    def restarts(self) -> int:
        """How often the log began anew, shape () [1]."""
        return self._restarts

    def poll(self) -> Log | None:
        """Return the rows that have come since, or None; `findings` of them stays empty [SI]."""
        chunk = self.tail.read()
        self.behind = len(chunk) >= READ_BYTES // 2
        if self.tail.restarts != self._restarts:
            self._restarts = self.tail.restarts
            self._start()
        self._text += self._as_utf8(chunk)
        cut = self._text.rfind(b"\n") + 1
        if not self._line and not is_text(self._text[:4096]):
            raise error("watch.format", file=self.tail.name, format="not text")
        if len(self._text) - cut > _LONGEST_LINE:
            reason = ValueError(f"no end of line in {len(self._text) - cut} bytes")
            raise unreadable(Path(self.tail.name), "text", reason)
        if not cut:
            return None
        text, rest = self._text[:cut], self._text[cut:]
        if self.used is None:
            opened = self._open(text)
            if opened is None:
                return None
            text = opened
        self._text = rest
        return self._log(text)

    def _as_utf8(self, chunk: bytes) -> bytes:
        if self._begun is not None:  # the first two bytes tell the encoding
            self._begun += chunk
            if len(self._begun) < 2:
                return b""
            chunk, self._begun = self._begun, None
            self._decoding = decoder(chunk)
        return chunk if self._decoding is None else encoded(self._decoding, chunk)

    def _open(self, text: bytes) -> bytes | None:
        """Look at the first lines; return the data after the titles, None before they come."""
        path = Path(self.tail.name)
        try:
            dialect = dialect_of(BytesIO(text), self._description, path.name)
        except FoucaultError as problem:
            if problem.code == "log.empty":
                return None
            raise
        except ValueError as problem:
            raise unreadable(path, "text", problem) from None
        stream = BytesIO(text)
        skipped = sum(1 for _ in islice(stream, dialect.skip))
        data = stream.read()
        if data.count(b"\n") < 3:  # enough to know the interval
            return None
        self._line = skipped
        self._dialect = replace(dialect, skip=0)
        raw = self._raw(b"")
        self.used, self._blocks = complete(self._description, self._wanted, raw, path)
        if self.used.accel is None:
            raise error("watch.no_accel", file=path.name)
        own = raw.sampled if self.used is not self._description else None
        self._kind = self.used.accel.kind
        self._sampled = own or self._kind
        self._source = {
            "file": path.name,
            "description": self.used.model_dump(mode="json", exclude_none=True),
        }
        return data

    def _raw(self, text: bytes) -> RawTable:
        known = self._dialect

        def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
            return self._parsed(text, columns)

        table = RawTable(known.names, known.named, blocks, known.marker, known.stamps)
        return of_own(table)

    def _parsed(self, text: bytes, columns: Sequence[int]) -> Iterator[FloatArray]:
        import pyarrow as pa

        try:
            yield np.concatenate(
                [*delimited.parse(BytesIO(text), self._dialect, columns, len(text))]
            )
        except (pa.ArrowInvalid, ValueError):  # a bad line, or none at all
            good = b"".join(self._good_lines(text, columns))
            if good:
                yield from delimited.parse(BytesIO(good), self._dialect, columns, len(good))

    def _good_lines(self, text: bytes, columns: Sequence[int]) -> Iterator[bytes]:
        for number, line in enumerate(BytesIO(text), start=self._line + 1):
            words = decoded(line)
            if not "".join(self._dialect.cells(words)).strip():
                continue
            wrong = delimited.fault(self.tail.name, self._dialect, columns, number, words)
            if wrong is None:
                yield line
            else:
                self._leave_out(1, wrong.message)

    def _leave_out(self, count: int, reason: str) -> None:
        self._left_out += count
        self._reason = self._reason or reason

    def _log(self, text: bytes) -> Log | None:
        used = self.used
        assert used is not None
        parts = list(converted(used, self._blocks, self._raw(text), Path(self.tail.name)))
        self._line += text.count(b"\n")
        if not parts:
            return None
        data = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        rows = len(data["accel"])
        if used.rate is not None:
            data["time"] = (self._row + np.arange(rows)) / used.rate
        keep, told = checks.finite(data, "drop", self.tail.name, self._row)
        self._row += rows
        if keep is not None:
            self._leave_out(int(np.sum(~keep)), told[0].message)
            data = {name: values[keep] for name, values in data.items()}
        if not len(data["time"]):
            return None
        keep, told = checks.doubled(data, self._last)
        if keep is not None:
            self._leave_out(int(np.sum(~keep)), told[0].message)
            data = {name: values[keep] for name, values in data.items()}
        if not len(data["time"]):
            return None
        self._last = {name: values[-1:].copy() for name, values in data.items()}
        if self._kind == "increment":
            interval = self._intervals(data["time"])[:, None]
            if len(self._times) < 2:
                return None
            data |= {n: data[n] / interval for n in ("gyro", "accel") if n in data}
        return Log(data["time"], data.get("gyro"), data["accel"], self._sampled,
                   data.get("temperature"), (), self._source)  # fmt: skip

    def _intervals(self, time: FloatArray) -> FloatArray:
        """Return the interval that ends at each sample; after a gap and at first the usual one."""
        before = self._times[-1:]
        self._times = np.concatenate([self._times, time])[-1000:]
        usual = np.median(np.diff(self._times)) if len(self._times) > 1 else np.nan
        step = np.diff(time, prepend=before if len(before) else np.nan)
        return np.where(step <= checks.GAP * usual, step, usual)


def open_tail(path: Path, description: LogDescription) -> FileTail:
    """Follow a file, if it is of a kind that can be followed."""
    named: Any = {".gz": "gzip", ".parquet": "Parquet", ".pq": "Parquet", ".npy": "NumPy",
                  ".npz": "NumPy", ".mat": "MATLAB", ".bin": "binary"}  # fmt: skip
    known = named.get(path.suffix.lower()) if description.format == "auto" else None
    if description.format not in ("auto", "csv", "text"):
        known = description.format
    if description.record is not None:
        known = "binary"
    if known is not None:
        raise error("watch.format", file=path.name, format=known)
    if path.is_dir():
        raise error("log.missing_file", path=path, what="is a folder, not a file", hint="")
    return FileTail(path)
