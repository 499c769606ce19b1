"""A session that is written as it is heard, so that it survives whatever ends the program.

A folder holds::

    raw.bin         every byte, as it came
    arrivals.bin    how many bytes there were and when they were heard, pairs of float64
    log.bin         a row of float64 for every frame, the time it was heard last
    frame.toml      the description of the frames
    campaign.toml   describes log.bin: the session can be calibrated from the first second on
    capture.json    what was heard, at the end

raw.bin is written before log.bin, both several times a second: a program that is killed loses less.
`again` makes log.bin once more from raw.bin, to the same bytes.
"""

from __future__ import annotations

import json
import os
import time
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from foucault.arrays import FloatArray
from foucault.campaign import running, writing
from foucault.capture.clock import HOST_SD, STOOD, Clocks, compared
from foucault.capture.frame import Frame, Heard, decoder_of, parsed
from foucault.capture.source import Source, together
from foucault.errors import error
from foucault.files import atomic, make_folder, unwritable, write_text
from foucault.logs.layout import scaled_unit

RAW, ARRIVALS, LOG, FRAME = "raw.bin", "arrivals.bin", "log.bin", "frame.toml"
CAMPAIGN, SAID = "campaign.toml", "capture.json"

EVERY = 0.25
"""What was heard is written so often at least [s]."""

SAFE = 1.0
"""And brought to the disk so often [s]."""

BATCH = 1000
"""So many pieces of what came are read again at once [1]."""

BEGIN = 2000
"""So much of what comes first is kept at hand [bytes]."""

POSSIBLE = 0.05, 500.0
"""What accelerometers read is within these most of the time [m/s^2]."""


@dataclass
class Recording:
    """A session being recorded."""

    folder: Path
    frame: Frame
    heard: Heard = field(default_factory=Heard)
    rows: int = 0  # written [1]
    size: int = 0  # heard [bytes]
    start: bytes = b""  # what came first
    slept: float = 0.0  # how long this computer's clock stood while the instrument's went on [s]
    absurd: float | None = None  # size of what accelerometers read, where it cannot be [m/s^2]
    serial: int | None = None  # of the instrument, where its frames say it [1]

    def __post_init__(self) -> None:
        """Open its files, none of which may be there."""
        make_folder(self.folder)
        if any((self.folder / name).exists() for name in (RAW, LOG)):
            raise error("capture.there", folder=self.folder)
        self._reader = Reader(self.frame, self.heard)
        self._files = {name: self._open(name) for name in (RAW, ARRIVALS, LOG)}
        self._waiting: list[FloatArray] = []
        self._last = np.zeros((0, 2))  # when the last row was made, and heard [s]
        self._written = self._safe = time.monotonic()

    def _open(self, name: str) -> IO[bytes]:
        try:
            return (self.folder / name).open("xb", buffering=0)
        except OSError as problem:
            raise unwritable(self.folder / name, problem) from None

    def take(self, data: bytes, now: float) -> FloatArray:
        """Take bytes that were heard at `now` [s]; return the rows that they complete, (n, k)."""
        return self.take_all([(data, now)])

    def take_all(self, pieces: Sequence[tuple[bytes, float]]) -> FloatArray:
        """Take bytes as `take` does; `pieces` (m,): bytes, and when they were heard [s]."""
        pieces = [(data, now) for data, now in pieces if data]
        rows = np.zeros((0, len(self.frame.columns) + 1))
        if pieces:
            data = b"".join(data for data, _ in pieces)
            self.size += len(data)
            self.start += data[: max(0, BEGIN - len(self.start))]
            self._write(RAW, data)
            self._write(ARRIVALS, np.array([(len(data), now) for data, now in pieces]).tobytes())
            rows = self._reader.take(pieces)
            self._waiting += [rows] * bool(len(rows))
        if time.monotonic() - self._written > EVERY:
            self.flush()
        return rows

    def flush(self) -> None:
        """Write the rows that wait."""
        if self._waiting:
            rows = np.concatenate(self._waiting)
            self._write(LOG, rows.astype("<f8").tobytes())
            self._watch(rows)
            self.rows += len(rows)
            self._waiting = []
        self._written = time.monotonic()
        if self._written - self._safe > SAFE:
            for file in self._files.values():
                os.fsync(file.fileno())
            self._safe = time.monotonic()

    def _watch(self, rows: FloatArray) -> None:
        """Look whether a clock stood, and whether what is read can be; `rows` (n, columns)."""
        columns, accel = self.frame.columns, self.frame.field_of("accel")
        if "serial" in columns and np.isfinite(told := rows[-1, columns.index("serial")]):
            self.serial = int(told)
        if (time_ := self.frame.field_of("time")) is not None:
            own = rows[:, columns.index("time")] * SECONDS[time_.unit or "s"]
            both = np.vstack([self._last, np.column_stack([own, rows[:, -1]])])
            steps = np.diff(both, axis=0)
            ahead = steps[:, 0] - steps[:, 1]
            self.slept += float(ahead[ahead > STOOD].sum())
            self._last = both[-1:]
        if accel is not None and self.frame.kind == "rate" and accel.unit not in ("", "count"):
            at = columns.index("accel_x")
            with np.errstate(over="ignore", invalid="ignore"):
                size = np.linalg.norm(rows[:, at : at + 3], axis=1)
                middle = float(np.median(size)) * scaled_unit(accel.unit, "specific force")
            self.absurd = None if POSSIBLE[0] < middle < POSSIBLE[1] else middle

    def _write(self, name: str, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[self._files[name].write(view) :]
        except OSError as problem:
            raise unwritable(self.folder / name, problem) from None

    def close(self, text: str | None = None) -> dict[str, Any]:
        """End it, and return what there is to say of it; `text`: as of `campaign_of`."""
        self.flush()
        for file in self._files.values():
            file.close()
        return concluded(self.folder, self.frame, self.heard, text, self.slept)


class Reader:
    """Rows of bytes as they come, each with when its last byte was heard.

    That does not hang on how many pieces are read at once.
    """

    def __init__(self, frame: Frame, heard: Heard) -> None:
        """Begin with nothing; `heard`: counts what is no row."""
        self._decoder = decoder_of(frame, heard)
        self._ends: list[int] = []  # of the pieces that may still end a row [bytes of all]
        self._times: list[float] = []  # when each of them was heard [s]
        self._size = 0  # taken [bytes]

    def take(self, pieces: Iterable[tuple[bytes, float]]) -> FloatArray:
        """Take bytes, and return rows, shape (n, k + 1) [units of the frame].

        `pieces` (m,): bytes, and when they were heard, as the last column then says [s].
        """
        held = list[bytes]()
        for data, now in pieces:
            held.append(data)
            self._size += len(data)
            self._ends.append(self._size)
            self._times.append(now)
        rows = self._decoder.rows(b"".join(held))
        out = np.empty((len(rows), rows.shape[1] + 1))
        out[:, :-1] = rows
        if len(rows):
            out[:, -1] = np.take(self._times, np.searchsorted(self._ends, self._decoder.ended))
        gone = bisect_right(self._ends, self._decoder.begun)
        del self._ends[:gone], self._times[:gone]
        return out


class Plug(NamedTuple):
    """A source, and what its bytes mean."""

    source: Source
    frame: Frame
    text: str  # the description of the frames as it was written


def record(
    plugs: Sequence[Plug],
    folders: Sequence[Path],
    *,
    seconds: float | None = None,
    silent: float | None = None,
    tell: Callable[[Sequence[tuple[Recording, float]]], None] = lambda _now: None,
) -> list[dict[str, Any]]:
    """Record sources until they end, and return what there is to say of each session.

    `folders`: of each source its own; `seconds` or None: how long [s]; `silent` or None: end where
    nothing comes of any for so long [s]; `tell`: called several times a second with each session
    and the time since something of it was heard [s].
    """
    held = [Recording(folder, plug.frame) for plug, folder in zip(plugs, folders, strict=True)]
    for plug, folder in zip(plugs, folders, strict=True):
        write_text(folder / FRAME, plug.text)
        if plug.frame.imu:
            write_text(folder / CAMPAIGN, campaign_of(plug.frame, folder.name))
    begun = time.monotonic()
    heard = [begun] * len(held)
    try:
        with closing(together([plug.source for plug in plugs])) as coming:
            for parts in coming:
                now = time.monotonic()
                for k, one in enumerate(held):
                    mine = [(data, at - begun) for source, data, at in parts if source == k]
                    heard[k] = begun + mine[-1][1] if mine else heard[k]
                    one.heard.reopened = getattr(plugs[k].source, "lost", 0)
                    one.take_all(mine)
                tell([(one, now - last) for one, last in zip(held, heard, strict=True)])
                if seconds is not None and now - begun >= seconds:
                    break
                if silent is not None and now - max(heard) >= silent:
                    break
    except KeyboardInterrupt:
        pass
    finally:
        for one, plug in zip(held, plugs, strict=True):
            plug.source.close()
            one.heard.reopened = getattr(plug.source, "lost", 0)
        said = [one.close() for one in held]
    return said


def again(folder: Path) -> dict[str, Any]:
    """Make the rows of a session once more from its bytes, as after a program that was killed."""
    if not (folder / RAW).is_file() or not (folder / FRAME).is_file():
        raise error("capture.none", folder=folder)
    frame = parsed((folder / FRAME).read_text(), FRAME)
    raw, arrivals = (folder / RAW).read_bytes(), (folder / ARRIVALS).read_bytes()
    pairs = np.frombuffer(arrivals[: len(arrivals) // 16 * 16]).reshape(-1, 2)
    heard, at, rows, pieces = Heard(), 0, list[FloatArray](), list[tuple[bytes, float]]()
    for size, now in pairs.tolist():
        pieces.append((raw[at : at + int(size)], now))
        at += int(size)
    pieces.append((raw[at:], pairs[-1, 1] if len(pairs) else 0.0))
    reader = Reader(frame, heard)
    for k in range(0, len(pieces), BATCH):
        rows.append(reader.take(pieces[k : k + BATCH]))
    with atomic(folder / LOG) as temporary:
        temporary.write_bytes(np.concatenate(rows).astype("<f8").tobytes())
    told = folder / CAMPAIGN  # of a guided session it says more than how by hand
    return concluded(folder, frame, heard, told.read_text() if told.is_file() else None)


def rows_of(folder: Path, frame: Frame) -> FloatArray:
    """Return the rows of a session, shape (n, columns); the last column is when each was heard."""
    data, wide = (folder / LOG).read_bytes(), len(frame.columns) + 1
    return np.frombuffer(data[: len(data) // (8 * wide) * 8 * wide], "<f8").reshape(-1, wide)


SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of a time [s]."""


def concluded(
    folder: Path, frame: Frame, heard: Heard, text: str | None = None, slept: float = 0.0
) -> dict[str, Any]:
    """Say what was heard, compare the clocks, and describe the log with what they say.

    `slept`: how long the clock of this computer stood [s].
    """
    rows, clocks = rows_of(folder, frame), None
    told = frame.field_of("time")
    said: dict[str, Any] = {"rows": len(rows), **asdict(heard)} | (
        {"slept": slept} if slept else {}
    )
    rate = None
    if len(rows) > 1 and np.nanmax(rows[:, -1]) > np.nanmin(rows[:, -1]):
        said["rate"] = rate = float((len(rows) - 1) / (np.nanmax(rows[:, -1]) - rows[0, -1]))
    if told is not None and len(rows):
        clocks = compared(rows[:, -1], times_of(frame, rows))
    elif told is None and rate is not None:  # rows are their own clock
        clocks = compared(rows[:, -1], np.arange(len(rows)) / rate)
        rate = rate if clocks is None else rate * (1 + clocks.rate)
    if clocks is not None:
        said["clock"] = clocks._asdict()
    write_text(folder / SAID, json.dumps(said, indent=1) + "\n")
    if frame.imu:
        campaign = campaign_of(frame, folder.name, clocks, rate, text, warm_in(frame, rows))
        write_text(folder / CAMPAIGN, campaign)
    return said


def times_of(frame: Frame, rows: FloatArray) -> FloatArray:
    """Return when each row was made by the clock of its log, shape (n,) [s].

    `rows` (n, columns): as of `rows_of`. Rows without a time of their own count.
    """
    told = frame.field_of("time")
    if told is not None:
        return np.asarray(rows[:, frame.columns.index("time")] * SECONDS[told.unit or "s"])
    number, spans = np.arange(len(rows), dtype=float), rows[-1, -1] - rows[0, -1]
    if not spans > 0:
        return np.asarray(rows[:, -1])
    rate = (len(rows) - 1) / spans
    clocks = compared(rows[:, -1], number / rate)
    return np.asarray(number / (rate if clocks is None else rate * (1 + clocks.rate)))


def warm_in(frame: Frame, rows: FloatArray) -> bool:
    """Tell whether every frame came with its temperature; `rows` (n, columns): as of `rows_of`."""
    if frame.field_of("temperature") is None:
        return False
    lost = np.isnan(rows[:, :-1]).all(axis=1)
    return not np.isnan(rows[~lost, frame.columns.index("temperature")]).any()


def campaign_of(
    frame: Frame, name: str, clocks: Clocks | None = None, rate: float | None = None,
    text: str | None = None, warm: bool = True,
) -> str:  # fmt: skip
    """Write the campaign of a session: `text` or None, by hand until somebody says otherwise.

    `clocks` or None: how its clock runs against that of the computer, which is then trusted;
    `rate` or None: of the frames, where they have no time of their own [Hz]; `warm`: whether each
    of them has a temperature, where they can have one.
    """
    columns = frame.columns
    time_ = frame.field_of("time")
    lines = [
        f'file = "{LOG}"', f'record = {{ columns = {len(columns) + 1}, type = "float64" }}',
    ]  # fmt: skip
    if time_ is not None:
        lines.append(f'time = {{ column = {columns.index("time")}, unit = "{time_.unit or "s"}" }}')
    elif rate is not None:  # frames that were lost are rows of nothing
        lines += [f'rate = "{rate!r} Hz"', 'missing = "drop"']
    else:  # when it was heard
        lines.append(f'time = {{ column = {len(columns)}, unit = "s" }}')
    for triad in ("gyro", "accel"):
        told = frame.field_of(triad)
        if told is not None:
            axes = told.axes or frame.axes
            numbers = [(a[:-1], columns.index(f"{triad}_{a[-1]}")) for a in axes]
            at = [f"{sign}{number}" if sign else number for sign, number in numbers]
            kind = ', kind = "increment"' if frame.kind == "increment" else ""
            lines.append(f'{triad} = {{ columns = {json.dumps(at)}, unit = "{told.unit}"{kind} }}')
    if warm and (told := frame.field_of("temperature")) is not None and told.unit:
        at_ = columns.index("temperature")
        lines.append(f'temperature = {{ column = {at_}, unit = "{told.unit}" }}')
    if clocks is not None:
        sd = float(np.hypot(clocks.rate_sd, HOST_SD))
        fast = f"It is that of this computer, sd {1e6 * clocks.rate_sd:.1f} ppm"
        if time_ is not None:
            sd += abs(clocks.rate)
            fast = (f"Against this computer it runs {1e6 * clocks.rate:+.1f} ppm fast, "
                    f"sd {1e6 * clocks.rate_sd:.1f} ppm")  # fmt: skip
        lines += [
            f"# {fast}; the computer's clock is taken for {1e6 * HOST_SD:.0f} ppm.",
            'clock = "sensor"', f'clock_sd = "{1e6 * sd:.1f} ppm"',
        ]  # fmt: skip
    own = "[log]\n" + "\n".join(lines) + "\n"
    text = writing.template("hand_rotated") if text is None else text
    return running.with_own_log(text, own).replace(writing.EXAMPLE, name)
