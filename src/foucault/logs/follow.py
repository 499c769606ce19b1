"""Follow a delimited text log while another program writes it, from a file or from a pipe.

A tail hands out the bytes that are new; the `Follower` makes rows of them, complete lines only.
A line that cannot be read is left out and told: the logger goes on, and so does the watching.

A log block by block, for work that needs no more than one block at a time.

The blocks together are the log that `read` returns. Only what is told from the samples differs
where a log is longer than one block: increments after a gap are divided by the nominal interval
of the first block, and a stuck axis is not looked for, because a block may be one long rest.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO, IncrementalNewlineDecoder
from itertools import chain, islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.files import decoded, sha256
from foucault.logs import axes, checks
from foucault.logs import text as delimited
from foucault.logs.description import complete
from foucault.logs.dialect import decoder, dialect_of, encoded, is_text
from foucault.logs.own import table_of
from foucault.logs.raw import Progress, RawTable, of_own, open_raw, unreadable
from foucault.logs.reading import converted, finished, implausible, limits_si, read
from foucault.tables import Clock, Log, gaps, usual_step

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
    """The bytes that another program appends to a file `name`, which need not exist yet.

    `restarts`: how often it was emptied, replaced or written anew [1]; `ended`: whether nothing
    more can come: never; `missing`: whether there is no such file now.
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

    `name`: what to call it; `restarts`: always 0 [1]; `ended`: whether the writer has closed it and
    all was read; `missing`: always False.
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
            try:
                block = os.read(number, 1 << 16) if number >= 0 else stream.read(1 << 16)
            except OSError:  # a line that hangs up, as a terminal does
                block = b""
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
    """The rows of a log, as they come from its `tail`.

    `behind`: whether more bytes are waiting already; `used`: the complete description, once the
    first line of data has come.
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
        log = self._log(self._raw(text))
        self._line += text.count(b"\n")
        return log

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
        self._describe(self._raw(b""), path)
        return data

    def _describe(self, raw: RawTable, path: Path) -> None:
        self.used, self._blocks = complete(self._description, self._wanted, raw, path)
        if self.used.accel is None:
            raise error("watch.no_accel", file=path.name)
        own = raw.sampled if self.used is not self._description else None
        self._kind = self.used.accel.kind
        self._sampled = own or self._kind
        self._source = {
            "file": path.name,
            "marker": raw.marker,
            "description": self.used.model_dump(mode="json", exclude_none=True),
        }

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

    def _log(self, raw: RawTable) -> Log | None:
        used = self.used
        assert used is not None
        parts = list(converted(used, self._blocks, raw, Path(self.tail.name)))
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
        seen = np.concatenate([self._times, time])
        self._times, step = seen[-1000:], np.diff(seen)
        step[gaps(step)] = usual = usual_step(step)
        return np.concatenate([[usual], step])[-len(time) :]


class RowFollower(Follower):
    """Rows of numbers that somebody else has read, as they come."""

    def __init__(self, description: LogDescription, columns: int) -> None:
        """Take rows of so many `columns` [1]."""
        super().__init__(StreamTail(BytesIO(), "rows"), description)
        self._columns = tuple(map(str, range(columns)))
        self._describe(self._table(np.zeros((0, columns))), Path(self.tail.name))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed of the rows."""
        told = finding("watch.lines", count=self._left_out, reason=self._reason)
        return (told,) * bool(self._left_out)

    def _table(self, rows: FloatArray) -> RawTable:
        return RawTable(self._columns, False, lambda some: iter([rows[:, list(some)]]))

    def take(self, rows: FloatArray) -> Log | None:
        """Return the log of `rows` (n, columns) [as described]; None where it holds none [SI]."""
        return self._log(self._table(rows)) if len(rows) else None


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


BLOCK_ROWS = 1 << 16
"""Rows per block: the work on a block holds about ten copies of it."""

Part = dict[str, FloatArray]
Checked = tuple[Part, tuple[Finding, ...]]


@dataclass(frozen=True)
class OnDisk:
    """A log that stays where it is: what a procedure that needs no more than blocks is given."""

    description: LogDescription  # file, columns and units
    folder: Path  # folder that relative file names start from
    findings: tuple[Finding, ...] = ()  # what was noticed before it is read

    @property
    def size(self) -> int:
        """Size of its files together, 0 where one is missing, shape () [1]."""
        files = [self.folder / name for name in self.description.files()]
        return sum(f.stat().st_size for f in files) if all(f.is_file() for f in files) else 0

    @cached_property
    def clock(self) -> Clock:
        """What counts its time: as described, else as its format has it."""
        name, wanted = next(iter(self.description.files().items()))
        raw = open_raw(self.folder / name, self.description)
        return complete(self.description, wanted, raw, self.folder / name)[0].time_base

    @property
    def source(self) -> dict[str, Any]:
        """What a result remembers of the log, as `Log.source` does."""
        names = list(self.description.files())
        return {
            "file": " + ".join(Path(name).name for name in names),
            "sha256": " + ".join(sha256(self.folder / name) for name in names),
            "size": self.size,
            "description": self.description.model_dump(exclude_none=True),
        }


def blocks(
    description: LogDescription, folder: str | Path = ".", progress: Progress | None = None
) -> Iterator[Log]:
    """Read a log in blocks of about `BLOCK_ROWS` rows.

    A log in several files is joined first and handed out in blocks from memory.

    `progress` or None: called with the fraction done, from 0 to 1. Returns the next rows;
    `findings` tells what looks wrong in them [SI].
    """
    files = description.whole().files()  # more of them are read as a whole
    whole = description.averaged is not None or description.serial is not None
    if len(files) != 1 or whole or description.stamped == "start" or description.apart:
        yield from _slices(read(description, folder, progress))
        return
    ((name, wanted),) = files.items()
    path = Path(folder) / name
    raw = open_raw(path, description, progress)
    used, columns = complete(description, wanted, raw, path)
    if used.averaged is not None:  # one of our own files: it says so only now
        yield from _slices(read(description, folder, progress))
        return
    sampled = raw.sampled if used is not description else None
    parts = _checked(_joined(converted(used, columns, raw, path)), used, path)
    source = {"file": path.name, "marker": raw.marker}
    pair = list(islice(parts, 2))
    if not pair:
        raise error("log.empty", file=path.name)
    if len(pair) == 1:
        yield finished(pair[0][0], used, sampled, raw.findings + pair[0][1], source)
        return
    before = raw.findings
    for log in _logs(chain(_emptying(pair), parts), used, sampled):
        yield replace(log, source=source, findings=before + log.findings)
        before = ()


def merged(blocks_findings: Iterable[tuple[Finding, ...]]) -> tuple[Finding, ...]:
    """Join the findings of the blocks of a log: the first of each code, and how often it recurs.

    `blocks_findings`: what was found in each block, in order.
    """
    first: dict[str, list[Finding]] = {}
    again: dict[str, int] = {}
    for found in blocks_findings:
        codes = list(dict.fromkeys(item.code for item in found))
        for code in codes:
            if code in first:
                again[code] = again.get(code, 0) + 1
            else:
                first[code] = [item for item in found if item.code == code]
    for code, count in again.items():
        last = first[code][-1]
        words = f"{last.message} The like is found in {count} later parts of the log."
        first[code][-1] = replace(last, message=words)
    return tuple(item for items in first.values() for item in items)


def _slices(log: Log) -> Iterator[Log]:
    for start in range(0, len(log), BLOCK_ROWS):
        part = log[start : start + BLOCK_ROWS]
        yield part if start == 0 else replace(part, findings=())


def _emptying(held: list[Checked]) -> Iterator[Checked]:
    while held:  # a block that is handed on is not to be kept here
        yield held.pop(0)


def _joined(parts: Iterator[Part]) -> Iterator[Part]:
    """Cut and join what a format hands out (4 MB of text, 260 000 rows) into blocks."""
    held: list[Part] = []
    rows = 0
    for part in parts:
        count, start = len(next(iter(part.values()))), 0
        while start < count:
            end = min(count, start + BLOCK_ROWS - rows)
            held.append({name: values[start:end] for name, values in part.items()})
            rows, start = rows + end - start, end
            if rows == BLOCK_ROWS:
                yield _one(held)
                held, rows = [], 0
    if rows:
        yield _one(held)


def _one(held: list[Part]) -> Part:
    if len(held) == 1:
        return held[0]
    return {name: np.concatenate([part[name] for part in held]) for name in held[0]}


def _checked(parts: Iterator[Part], used: LogDescription, path: Path) -> Iterator[Checked]:
    """Drop or refuse rows that are not numbers; give rows without a time column theirs."""
    start = 0
    last: Part | None = None
    for part in parts:
        rows = len(next(iter(part.values())))
        if used.rate is not None:
            part = {"time": np.arange(start, start + rows) / used.rate, **part}
        keep, told = checks.finite(part, used.missing, path.name, start)
        start += rows
        if keep is not None:
            part = {name: values[keep] for name, values in part.items()}
        if not len(part["time"]):
            continue
        keep, doubled = checks.doubled(part, last)
        if keep is not None:
            part = {name: values[keep] for name, values in part.items()}
        if len(part["time"]):
            last = {name: values[-1:].copy() for name, values in part.items()}
            yield part, told + doubled


def _logs(parts: Iterator[Checked], used: LogDescription, sampled: Any) -> Iterator[Log]:
    """Make a log of each block, the last sample of the one before at hand."""
    triads = {"gyro": used.gyro, "accel": used.accel}
    kind = next(block.kind for block in triads.values() if block is not None)
    before, nominal, start, zero = np.empty(0), float("nan"), 0, float("nan")
    for data, findings in parts:
        time = data["time"]
        if not start:
            zero = float(time[0])
            nominal = usual_step(np.diff(time)) if len(time) > 1 else nominal
        seen = np.concatenate((before, time))
        findings += checks.timing(seen, start - len(before), zero, shared=used.shared_clock)
        for name, block in triads.items():
            if block is not None:
                told = axes.check(time, data[name], name, limits_si(block), zero)
                findings += tuple(item for item in told if item.code != "log.stuck")
        if kind == "increment":
            dt = np.diff(seen, prepend=[np.nan] * (1 - len(before)))
            dt[np.isnan(dt)] = nominal
            dt[gaps(dt)] = nominal
            for name in triads.keys() & data.keys():
                data[name] /= dt[:, None]
        log = Log(time, data.get("gyro"), data.get("accel"), sampled or kind,
                  data.get("temperature"), findings, table=table_of(data),
                  mag=data.get("mag"))  # fmt: skip
        yield replace(log, findings=findings + implausible(log, used), clock=used.time_base)
        before, start = time[-1:], start + len(time)
