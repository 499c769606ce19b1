"""A log block by block, for work that needs no more than one block at a time.

The blocks together are the log that `read` returns. Only what is told from the samples differs
where a log is longer than one block: increments after a gap are divided by the nominal interval
of the first block, and a stuck axis is not looked for, because a block may be one long rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, error
from foucault.files import sha256
from foucault.logs import axes, checks
from foucault.logs.declared import complete
from foucault.logs.raw import Progress, open_raw
from foucault.logs.reading import (
    converted,
    finished,
    implausible,
    limits_si,
    read,
)
from foucault.logs.table_rows import table_of
from foucault.tables import Clock, Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

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
            nominal = float(np.median(np.diff(time))) if len(time) > 1 else nominal
        seen = np.concatenate((before, time))
        findings += checks.timing(seen, start - len(before), zero, shared=used.shared_clock)
        for name, block in triads.items():
            if block is not None:
                told = axes.check(time, data[name], name, limits_si(block), zero)
                findings += tuple(item for item in told if item.code != "log.stuck")
        if kind == "increment":
            dt = np.diff(seen, prepend=[np.nan] * (1 - len(before)))
            dt[~(dt <= checks.GAP * nominal)] = nominal
            for name in triads.keys() & data.keys():
                data[name] /= dt[:, None]
        log = Log(time, data.get("gyro"), data.get("accel"), sampled or kind,
                  data.get("temperature"), findings, table=table_of(data))  # fmt: skip
        yield replace(log, findings=findings + implausible(log, used), clock=used.time_base)
        before, start = time[-1:], start + len(time)
