"""What is heard at a source: which baud rate, text or bytes, whose frames, and what they mean.

Frames fit where their checksums are right many times in a row and what they say is possible; what
they mean is then held against gravity by `recognise`, as every log is. Nothing is guessed: what
fits none of what is known is told with what was seen of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.capture import frame as frames
from foucault.capture import prints
from foucault.capture.frame import Frame, Heard, decoder_of
from foucault.capture.recording import FRAME, SECONDS, Recording
from foucault.capture.source import Growing, Serial, Source, opened
from foucault.errors import FoucaultError, library
from foucault.files import write_text
from foucault.recognise.reading import FEWEST, Line, Question, recognise

BAUDS = (115200, 921600, 460800, 230400, 57600, 38400, 9600, 19200, 1_000_000, 2_000_000,
         3_000_000, 500_000, 250_000, 4800)  # fmt: skip
"""Rates of serial ports, the usual ones first [Hz]."""

EACH, AGAIN = 0.6, 2.4
"""Each of them is tried so long, and so long once more where nothing fits: few messages come from a
slow instrument, and few to a busy computer [s]."""

MANY = 6000
"""So many bytes tell whether a rate is right [bytes]."""

SILENT, END = 3.0, 0.5
"""A port from which nothing has come for so long is silent, and a file has ended [s]."""

LONG = 5.0
"""What fits is then listened to so long, where nothing else is said [s]."""

MOST = 1 << 23
"""No more is kept of what is heard [bytes]."""

LEAST = 5
"""Frames of which it is told that they fit [1]."""

SURE_BITS = 32
"""Bits of sync, message and checksum together that fit five times by no chance [1]."""

PART = 0.6
"""Part of the bytes that frames with fewer bits must make [1]."""

EVEN = 0.5
"""Steps of a clock are even where most are within this part of their median [1]."""


@dataclass(frozen=True)
class Fit:
    """Frames that fit what was heard."""

    name: str  # of the description, "" where it was made of what was heard
    text: str  # of the description
    frame: Frame
    heard: Heard
    rows: FloatArray  # (n, columns) [units of the frame]
    rate: float | None = None  # of the frames [Hz]
    doubts: tuple[str, ...] = ()  # what speaks against it
    notes: tuple[str, ...] = ()
    lines: tuple[Line, ...] = ()  # what `recognise` says of it

    @property
    def wanted(self) -> tuple[int, int]:
        """Of several that fit, the one with the finest numbers, then with the most frames."""
        told = self.frame.field_of("accel") or self.frame.field_of("gyro")
        assert told is not None
        return frames.SIZE[told.type], self.heard.frames


@dataclass
class Listened:
    """What was heard at a source."""

    name: str  # as a command takes it
    size: int = 0  # [bytes]
    seconds: float = 0.0  # [s]
    text: float = 0.0  # readable part of the bytes [1]
    fits: list[Fit] = field(default_factory=list)  # the best first
    others: dict[str, int] = field(default_factory=dict)  # description -> whole other messages [1]
    # baud [Hz], bytes heard, and how much of them is readable [1]
    tried: list[tuple[int, int, float]] = field(default_factory=list)
    period: tuple[bytes, int] | None = None  # bytes that come again, and after how many [bytes]
    sample: bytes = b""
    lost: str = ""  # why lines of text are not described

    @property
    def best(self) -> Fit | None:
        """What it is; None where nothing fits, or something speaks against what fits best."""
        return self.fits[0] if self.fits and not self.fits[0].doubts else None


def heard(source: Source, seconds: float, most: int = MOST) -> tuple[bytes, FloatArray]:
    """Listen for `seconds` [s], to `most` [bytes]; return the bytes, and sizes and times (n, 2)."""
    begun, parts, when = time.monotonic(), list[bytes](), list[tuple[float, float]]()
    size, quiet, patience = 0, 0.0, END if isinstance(source, Growing) else SILENT
    while not source.ended and size < most and (now := time.monotonic() - begun) < seconds:
        data = source.read(min(0.1, seconds - now))
        now = time.monotonic() - begun
        if data:
            parts.append(data)
            when.append((len(data), now))
            size, quiet = size + len(data), now
        elif now - quiet > patience:
            break
    return b"".join(parts), np.array(when).reshape(-1, 2)


def listen(
    name: str,
    seconds: float = LONG,
    own: Sequence[str] = (),
    said: Mapping[str, Any] | None = None,
    tell: Callable[[str], None] = lambda _line: None,
) -> tuple[Listened, bytes, FloatArray]:
    """Say what is heard at a source, and return the bytes, and sizes and times (n, 2) of them.

    `name`: as of `opened`; `seconds`: how long [s]; `own`: files that describe frames, beside those
    of the program; `said`: keys of [log] that are known; `tell`: told what is being done.
    """
    texts = {one: frames.text_of(one) for one in (*own, *frames.shipped())}
    known = {one: (text, frames.parsed(text, one)) for one, text in texts.items()}
    first = opened(name)
    out = Listened(name)
    if isinstance(first, Serial) and first.chosen:
        first.close()
        baud = _baud(first.port, known, out, tell)
        if baud is None:
            return out, b"", np.zeros((0, 2))
        out.name = f"serial:{first.port}:{baud}"
        first = opened(out.name)
    tell(f"{out.name}: listening")
    data, when = heard(first, seconds)
    first.close()
    out.size, out.text = len(data), prints.text_in(data)
    if len(when) > 1 and not isinstance(first, Growing):  # which may have been there before
        out.seconds = float(when[-1, 1] - when[0, 1])
    tell(f"{out.name}: looking for frames")
    _judge(out, data, known, said or {})
    return out, data, when


def _baud(
    port: str, known: Mapping[str, tuple[str, Frame]], out: Listened, tell: Callable[[str], None]
) -> int | None:
    """Return the baud rate at which something fits, None where none does."""
    tried = dict[int, tuple[int, int, float]]()
    for wait, baud in product((EACH, AGAIN), BAUDS):
        if wait == AGAIN and baud not in tried:
            continue
        tell(f"{port}: {baud} baud")
        try:
            source = Serial(port, baud)
        except FoucaultError:
            if tried:  # not every port can do every rate
                continue
            raise
        try:
            data, _ = heard(source, wait if tried else SILENT, MANY)
        finally:
            source.close()
        tried[baud] = baud, len(data), prints.text_in(data)
        out.tried = list(tried.values())
        out.size, out.sample = max(out.size, len(data)), data or out.sample
        if not data and len(tried) == 1:
            return None  # a wrong rate hears something else, but it hears
        if prints.print_of(data) is not None:
            return baud
        if any(_fit(one, *known[one], data) is not None for one in known):
            return baud
        # A wrong rate makes no whole frames of anyone.
        if any(told.line is None and _others(told, data) >= LEAST for _, told in known.values()):
            return baud
    return None


def _decoded(told: Frame, data: bytes) -> tuple[Heard, list[tuple[float, ...]]]:
    counted = Heard()
    return counted, decoder_of(told, counted).feed(data)


def _others(told: Frame, data: bytes) -> int:
    """Return how many whole messages of the same protocol there are, whose sums are right [1]."""
    if told.checksum is None or told.checksum.extra or _bits(told) < SURE_BITS:
        return 0
    counted, _ = _decoded(told, data)
    return counted.others


def _bits(told: Frame) -> int:
    """Return how many bits of a frame are as they must be [1]."""
    match = min((len(b) for b in told.match.bytes), default=0) if told.match else 0
    sums = told.checksum.size if told.checksum else 0
    return 8 * (len(told.sync) + match + sums)


def _fit(name: str, text: str, told: Frame, data: bytes) -> Fit | None:
    """Return frames of one description in what was heard, None where they do not fit."""
    counted, rows = _decoded(told, data)
    if counted.frames < LEAST or counted.broken > counted.frames:
        return None
    explained = 1.0 - counted.junk / max(len(data), 1)
    if _bits(told) < SURE_BITS and explained < PART:
        return None
    x = np.array(rows)
    x = x[np.isfinite(x).any(axis=1)]
    clock = told.field_of("time") or told.field_of("counter")
    if clock is not None:
        steps = np.diff(x[:, told.columns.index(clock.name)])
        steps = steps[np.isfinite(steps)]
        middle = float(np.median(steps)) if len(steps) else 0.0
        even = np.abs(steps - middle) <= EVEN * abs(middle)
        if not middle > 0 or even.mean() < 0.5:
            return None
    return Fit(name, text, told, counted, x)


def _judge(
    out: Listened, data: bytes, known: Mapping[str, tuple[str, Frame]], said: Mapping[str, Any]
) -> None:
    found = [fit for one in known if (fit := _fit(one, *known[one], data)) is not None]
    found.sort(key=lambda fit: fit.wanted, reverse=True)
    with TemporaryDirectory() as folder:
        if found:
            out.fits = [_meant(fit, out.seconds, Path(folder)) for fit in found]
            out.fits.sort(key=lambda fit: bool(fit.doubts))
        elif (told := prints.print_of(data)) is not None:
            _lines(out, data, told, said, Path(folder))
    if out.fits:
        return
    out.others = {one: n for one, (_, told) in known.items()
                  if told.line is None and (n := _others(told, data)) >= LEAST}  # fmt: skip
    out.period, out.sample = repeated(data), data[-256:]


def _meant(fit: Fit, seconds: float, folder: Path) -> Fit:
    """Hold the readings of frames against gravity."""
    told, x = fit.frame, fit.rows
    names, units = list[str](), list[str]()
    columns, rate = list[FloatArray](), _rate(fit, seconds)
    if (clock := told.field_of("time")) is not None:
        own = x[:, told.columns.index("time")] * SECONDS[clock.unit or "s"]
        names, units, columns = ["time"], ["s"], [own - own[0]]
    for triad in ("accel", "gyro"):
        if (one := told.field_of(triad)) is None:
            continue
        word = {"rate": triad, "increment": {"accel": "dvel", "gyro": "dtheta"}[triad]}[told.kind]
        for here, axis in zip("xyz", one.axes or told.axes, strict=True):
            sign = -1.0 if axis.startswith("-") else 1.0
            columns.append(sign * x[:, told.columns.index(f"{triad}_{axis[-1]}")])
            names.append(f"{word}_{here}")
            units.append(one.unit)
    rows = np.stack(columns, axis=1)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < FEWEST:
        short = f"{len(rows)} frames are too few to hold them against gravity: listen longer"
        return replace(fit, rate=rate, notes=(short,))
    path = folder / f"{fit.name.replace('/', '_') or 'lines'}.csv"
    head = f"{','.join(names)}\n{','.join(units)}"
    np.savetxt(path, rows, "%.12g", ",", header=head, comments="")
    said = {} if clock is not None or rate is None else {"rate": f"{rate:.6g} Hz"}
    try:
        held = recognise([path], said)
    except FoucaultError as problem:
        return replace(fit, rate=rate, doubts=(problem.message,))
    doubts = [_asked(question) for question in held.questions]
    for triad in ("accel", "gyro"):
        one, block = told.field_of(triad), held.log.get(triad)
        if one is None or block is None:
            continue
        turned = [str(c) for c in block["columns"]]
        if any(c.startswith("-") for c in turned) or turned != sorted(turned):
            doubts.append(f"its turns say that {triad} is not in these axes: {', '.join(turned)}")
        if block["unit"] != one.unit:
            unit = block.get("scale", block["unit"])
            doubts.append(f"gravity and turns say that {triad} is in {unit}, not in {one.unit}")
    return replace(fit, rate=rate, doubts=tuple(doubts), lines=held.lines)


def _asked(one: Question) -> str:
    return f"{one.what} Either {one.one} ({one.why_one}), or {one.other} ({one.why_other})."


def _rate(fit: Fit, seconds: float) -> float | None:
    """Return how often frames come, by their own clock, else by that of this computer [Hz]."""
    clock = fit.frame.field_of("time")
    if clock is not None and len(fit.rows) > 1:
        own = fit.rows[:, fit.frame.columns.index("time")] * SECONDS[clock.unit or "s"]
        span = float(own[-1] - own[0])
        return (len(own) - 1) / span if span > 0 else None
    return (len(fit.rows) - 1) / seconds if seconds > 0 else None


def _lines(
    out: Listened, data: bytes, told: prints.Print, said: Mapping[str, Any], folder: Path
) -> None:
    """Describe lines of text by what their numbers are."""
    count = len(told.rows)
    rate = (count - 1) / out.seconds if out.seconds > 0 else None
    try:
        held, log = prints.known(told, folder, rate, said)
        text, lost = prints.description(told, log, f"lines heard at {out.name}")
        frame = frames.parsed(text, "what was heard")
    except FoucaultError as problem:
        out.lost = f"{problem.message} {problem.cure}"
        return
    counted, rows = _decoded(frame, data)
    doubts = tuple(f"in the campaign has to be said: {one}" for one in lost)
    doubts += tuple(map(_asked, held.questions))
    fit = Fit("", text, frame, counted, np.array(rows), None, doubts, (), held.lines)
    out.fits = [replace(fit, rate=_rate(fit, out.seconds))]


def repeated(data: bytes) -> tuple[bytes, int] | None:
    """Return two bytes that come again after as many bytes most of the time, None for none.

    Such bytes begin the frames of most instruments; this is no more than a hint.
    """
    x = np.frombuffer(data[:MANY], np.uint8).astype(np.int64)
    if len(x) < 200:
        return None
    pairs = x[:-1] << 8 | x[1:]
    best: tuple[int, bytes, int] | None = None
    values, counts = np.unique(pairs, return_counts=True)
    for value in values[np.argsort(-counts)[:20]]:
        at = np.flatnonzero(pairs == value)
        steps = np.diff(at)
        if len(steps) < 8:
            continue
        period = int(np.bincount(steps).argmax())
        often = int(np.sum(steps == period))
        if period > 5 and often > 0.7 * len(x) / period and (best is None or often > best[0]):
            best = often, bytes([int(value) >> 8, int(value) & 255]), period
    return None if best is None else best[1:]


def kept(fit: Fit, data: bytes, when: FloatArray, folder: Path) -> None:
    """Keep what was heard as a session; `when` (n, 2): sizes and times of the parts."""
    session, at = Recording(folder, fit.frame), 0
    write_text(folder / FRAME, fit.text)
    for size, now in when.tolist():
        session.take(data[at : at + int(size)], now)
        at += int(size)
    session.close()


def ports() -> list[str]:
    """Return the serial ports of this computer, as commands take them."""
    with library("capture.no_serial"):
        from serial.tools import list_ports
    return [f"serial:{one.device}" for one in sorted(list_ports.comports())]
