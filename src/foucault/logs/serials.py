"""Logs of several instruments in one file, told apart by a column of serial numbers.

The column is read first. Then the rows of an instrument are held until its last one has come, and
handed on as a log of its own: one instrument at a time is in memory where the file holds one after
the other, all of them where their rows are mixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import FoucaultError, error
from foucault.logs import columns
from foucault.logs.raw import Progress, RawTable, open_raw
from foucault.tables import Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription


@dataclass(frozen=True)
class _Runs:
    """Which rows belong to whom: runs of rows with the same serial number.

    `start` and `code`, shape (k,), are the first row of each run and the number of its instrument
    in `names`; `last`, shape (len(names),), is the row after the last of each instrument.
    """

    names: list[str]
    start: IntArray
    code: IntArray
    last: IntArray


def by_serial(
    description: LogDescription, folder: str | Path = ".", progress: Progress | None = None
) -> Iterator[tuple[str, Log | FoucaultError]]:
    """Read the log of each instrument of a file with a column of serial numbers.

    `description`: file, columns and units, `serial` names the column; `folder`: folder that a
    relative file name starts from; `progress` or None: called with the fraction done, from 0 to
    1. Returns serial number and log, in the order in which the instruments end [SI]; where the
    rows of one cannot be a log, the reason, and the others go on.
    """
    from foucault.logs.declared import complete
    from foucault.logs.reading import converted

    raw, path, runs = _opened(description, folder, progress)
    ((_, wanted),) = description.files().items()
    used, blocks = complete(description, wanted, raw, path)
    sampled = raw.sampled if used is not description else None
    held: dict[int, list[dict[str, FloatArray]]] = {}
    row = 0
    for part in converted(used, blocks, raw, path):
        count = len(next(iter(part.values())))
        for code, rows in _split(runs, row, count):
            piece = {key: values[rows].copy() for key, values in part.items()}
            held.setdefault(code, []).append(piece)
            if runs.last[code] <= row + int(rows.stop):
                pieces = held.pop(code)
                yield runs.names[code], _log(pieces, runs.names[code], used, sampled, path)
        row += count


def serials(description: LogDescription, folder: str | Path = ".") -> list[str]:
    """Return the serial numbers in a file, in the order in which they first appear.

    `description`: file, columns and units, `serial` names the column; `folder`: folder that a
    relative file name starts from.
    """
    return _opened(description, folder, None)[2].names


def _opened(
    description: LogDescription, folder: str | Path, progress: Progress | None
) -> tuple[RawTable, Path, _Runs]:
    files = description.files()
    if len(files) != 1:
        raise error("log.serial_files", count=len(files), files=", ".join(files))
    path = Path(folder) / next(iter(files))
    raw = open_raw(path, description, progress)
    if description.serial is None:
        raise error("log.no_serial", file=path.name)
    number, _ = columns.find(raw, description.serial, path, "serial")
    runs = _runs(raw, number)
    if not runs.names:
        raise error("log.empty", file=path.name)
    return raw, path, runs


def _runs(raw: RawTable, number: int) -> _Runs:
    known: dict[str, int] = {}
    starts, codes = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    last: list[int] = []
    row, before = 0, -1
    for words in _words(raw, number):
        code = np.array([known.setdefault(word.strip(), len(known)) for word in words])
        new = np.flatnonzero(np.diff(code, prepend=before))
        starts.append(row + new)
        codes.append(code[new])
        last += [0] * (len(known) - len(last))
        seen, back = np.unique(code[::-1], return_index=True)
        for c, k in zip(seen.tolist(), back.tolist(), strict=True):
            last[c] = row + len(code) - k
        row, before = row + len(code), int(code[-1])
    return _Runs(list(known), np.concatenate(starts), np.concatenate(codes), np.array(last))


def _words(raw: RawTable, number: int) -> Iterator[list[str]]:
    if raw.words is not None:
        yield from (words for words in raw.words(number) if words)
        return
    for block in raw.blocks([number]):
        if len(block):
            yield [f"{value:g}" for value in block[:, 0]]


def _split(runs: _Runs, row: int, count: int) -> Iterator[tuple[int, slice]]:
    """Yield the runs that a block of `count` rows from `row` holds, as slices of the block."""
    first = int(np.searchsorted(runs.start, row, side="right")) - 1
    last = int(np.searchsorted(runs.start, row + count, side="left"))
    for k in range(first, last):
        start = max(int(runs.start[k]) - row, 0)
        end = int(runs.start[k + 1]) - row if k + 1 < len(runs.start) else count
        yield int(runs.code[k]), slice(start, min(end, count))


def _log(
    pieces: list[dict[str, FloatArray]],
    serial: str,
    used: LogDescription,
    sampled: Any,
    path: Path,
) -> Log | FoucaultError:
    try:
        return _made(pieces, serial, used, sampled, path)
    except FoucaultError as problem:
        return problem


def _made(
    pieces: list[dict[str, FloatArray]],
    serial: str,
    used: LogDescription,
    sampled: Any,
    path: Path,
) -> Log:
    """Make the log of one instrument from its rows."""
    from foucault.logs.reading import finished, timed, usable

    data = {key: np.concatenate([piece[key] for piece in pieces]) for key in pieces[0]}
    data = timed(data, used)
    data, told = usable(data, used, f"{path.name}, {serial}")
    source = {
        "file": path.name,
        "serial": serial,
        "rows": len(data["time"]),
        "description": used.model_dump(mode="json", exclude_none=True),
    }
    return finished(data, used, sampled, told, source)
