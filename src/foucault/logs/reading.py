"""One file or several, of any format, into one log in SI units and body axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray, IntArray, runs_of, to_arrow
from foucault.errors import Finding, FoucaultError, error, require
from foucault.files import sha256
from foucault.logs import axes, checks
from foucault.logs import description as columns
from foucault.logs.description import complete
from foucault.logs.merged import on_one_clock
from foucault.logs.own import (
    ANGLES,
    angles_at_times,
    joined_tables,
    means_log,
    table_of,
    whole_numbers,
)
from foucault.logs.raw import Progress, RawTable, kept, open_raw, together
from foucault.tables import Log, gaps, usual_step
from foucault.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription, Triad


@dataclass(frozen=True)
class _Pick:
    """Columns of one block: SI = (raw - zero) * factor, each shape (k,)."""

    block: str
    numbers: list[int]
    zero: FloatArray
    factor: FloatArray


def read(
    description: LogDescription, folder: str | Path = ".", progress: Progress | None = None
) -> Log:
    """Read a log.

    Parameters
    ----------
    description : LogDescription
        Files, columns and units.
    folder : str or Path
        Folder that relative file names start from.
    progress : callable or None
        Called with the fraction done, from 0 to 1.

    Returns
    -------
    Log
        The samples in body axes; `findings` tells what looks wrong, `source` where they came
        from [SI].

    Notes
    -----
    Increments are divided by the interval that ends at their sample, so that integrating the
    log gives them back; after a gap, and for the first sample, by the nominal interval.
    """
    from foucault.logs.description import LogDescription

    require("description", description, LogDescription)
    if description.serial is not None:
        return _only(description, folder, progress)
    if description.more:
        return _one_after_the_other(description, folder, progress)
    parts: list[dict[str, FloatArray]] = []
    names, prints, used = [], [], description
    told: tuple[Finding, ...] = ()
    files = list(description.files().items())
    for i, (name, wanted) in enumerate(files):
        path = Path(folder) / name
        raw = open_raw(path, description, _part_of(progress, i, len(files)))
        used, blocks = complete(description, wanted, raw, path)
        parts.append(_columns(used, blocks, raw, path))
        told += raw.findings
        names.append(path.name)
        prints.append(sha256(path))
    sampled = raw.sampled if used is not description else None
    if description.join == "times" and len(parts) > 1:
        for i, name in enumerate(names):
            parts[i], left_out = usable(parts[i], used, name)
            told += left_out
        data, left_out = on_one_clock(parts, names)
    else:
        data = _joined(parts, names, used)
        data, left_out = usable(data, used, names[0])
    told += left_out
    source = {
        "file": " + ".join(names),
        "sha256": " + ".join(prints),
        "rows": len(data["time"]),
        "description": used.model_dump(mode="json", exclude_none=True),
    }
    log = finished(data, used, sampled, told, source)
    return replace(log, rests=_rests(log.time, used))


TRIADS = ("gyro", "accel", "mag")
"""Blocks of a log that have an axis for each column."""

BETWEEN = 10.0
"""Between two files whose times do not say what was between them [s]."""


def _one_after_the_other(
    description: LogDescription, folder: str | Path, progress: Progress | None
) -> Log:
    """Read files that were recorded one by one into one log with gaps between them.

    Times that go on from file to file stay; a file whose times begin before the end of the last
    one, as those of each file that begins at zero do, is taken to follow it.
    """
    each = description.each()
    logs: list[Log] = []
    for i, one in enumerate(each):
        log = read(one, folder, _part_of(progress, i, len(each)))
        if logs:
            _alike(logs[0], log, str(each[0].file), str(one.file))
            last = logs[-1]
            end = float(last.time[-1] + (0.0 if last.averaged is None else last.averaged[-1]))
            if log.time[0] < end + BETWEEN:
                log = replace(log, time=log.time + (end + BETWEEN - log.time[0]))
        logs.append(log)

    def joined(parts: list[Any]) -> Any:
        return None if parts[0] is None else np.concatenate(parts)

    source = {
        "file": " + ".join(log.source["file"] for log in logs),
        "sha256": " + ".join(log.source["sha256"] for log in logs),
        "rows": sum(len(log) for log in logs),
        "description": description.model_dump(mode="json", exclude_none=True),
    }
    tables = [log.table for log in logs if log.table is not None]
    return replace(
        logs[0],
        findings=tuple(dict.fromkeys(f for log in logs for f in log.findings)),
        source=source,
        begins=tuple(np.cumsum([len(log) for log in logs[:-1]]).tolist()),
        rests=_rests(np.concatenate([log.time for log in logs]), description),
        table=joined_tables(tables) if tables else None,
        **{
            name: joined([getattr(log, name) for log in logs])
            for name in ("time", "gyro", "accel", "mag", "temperature", "averaged")
        },
    )


def _alike(one: Log, other: Log, first: str, second: str) -> None:
    """Refuse files of one log that do not hold the same."""

    def said(log: Log) -> str:
        table = log.table
        has = {
            "gyros": log.gyro, "accelerometers": log.accel, "magnetometers": log.mag,
            "temperature": log.temperature,
            "angles of a table": table, "its rate": table and table.rate,
            "position numbers": table and table.position,
        }  # fmt: skip
        words = ", ".join(name for name, value in has.items() if value is not None)
        return f"{'means' if log.averaged is not None else 'samples'} of {words}"

    same_rate = one.averaged is not None or abs(one.interval / other.interval - 1.0) < RATES_DIFFER
    what = [said(log) if same_rate else f"{log.rate:.6g} Hz" for log in (one, other)]
    if what[0] != what[1]:
        raise error("log.more_differs", first=first, one=what[0], second=second, other=what[1])


RATES_DIFFER = 0.02
"""Two files whose sample rates differ by more are not of one logger [1]."""


def usable(
    data: dict[str, FloatArray], used: LogDescription, name: str
) -> tuple[dict[str, FloatArray], tuple[Finding, ...]]:
    """Drop or refuse rows that are not numbers, and drop rows written twice.

    `data`: blocks by name, each shape (n,) or (n, 3) [SI].
    """
    keep, found = checks.finite(data, used.missing, name)
    if keep is not None:
        data = {block: values[keep] for block, values in data.items()}
        if not keep.any():
            raise error("log.empty", file=name)
    if used.averaged is not None:  # two positions may well read the same
        return data, found
    keep, doubled = checks.doubled(data)
    if keep is not None:
        data = {block: values[keep] for block, values in data.items()}
    return data, found + doubled


def _only(description: LogDescription, folder: str | Path, progress: Progress | None) -> Log:
    """Read a file with a column of serial numbers that holds one instrument."""

    names = serials(description, folder)
    file = next(iter(description.files()))
    if len(names) > 1:
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        raise error("log.several_serials", file=file, serials=", ".join(names[:5]) + more)
    _, log = next(by_serial(description, folder, progress))
    if isinstance(log, FoucaultError):
        raise log
    return replace(log, source=log.source | {"sha256": sha256(Path(folder) / file)})


def _part_of(progress: Progress | None, i: int, n: int) -> Progress | None:
    return progress and (lambda done: progress((i + done) / n))


def _columns(
    used: LogDescription, blocks: tuple[str, ...], raw: RawTable, path: Path
) -> dict[str, FloatArray]:
    """Read the blocks of one file, converted to SI as they come in."""
    raw = kept(raw, path)
    return together(converted(used, blocks, raw, path), raw, path)


def converted(
    used: LogDescription, blocks: tuple[str, ...], raw: RawTable, path: Path
) -> Iterator[dict[str, FloatArray]]:
    """Yield the rows of one file piece by piece, in SI: time, gyro, accel, temperature.

    They may be views of one array that is made anew for each piece.
    """
    picks = list(_picks(used, blocks, raw, path))
    numbers = [number for pick in picks for number in pick.numbers]
    for rows in raw.blocks(numbers):
        part, start = {}, 0
        for pick in picks:
            end = start + len(pick.numbers)
            values = np.asarray(rows[:, start:end], float)
            with np.errstate(invalid="ignore", over="ignore"):  # found by `checks.finite`
                if pick.zero.any():
                    values = values - pick.zero
                if (pick.factor != 1.0).any():
                    values = values * pick.factor
            flat = pick.block not in TRIADS
            part[pick.block] = values[:, 0] if flat else values
            start = end
        if "position" in part:
            part["position"] = whole_numbers(part["position"], path)
        yield part


def _picks(
    used: LogDescription, blocks: tuple[str, ...], raw: RawTable, path: Path
) -> Iterator[_Pick]:
    if used.time is not None:
        numbers, one = columns.find_time(raw, used.time, path)
        yield _Pick("time", numbers, np.zeros(1), one)
    elif used.rate is None and used.averaged is None:
        raise error("log.no_time", file=path.name)
    for name in blocks:
        block = getattr(used, name)
        if name in ("table", "averaged"):
            single = block.numbers() if name == "table" else {name: (block.column, block.one())}
            for what, (column, unit) in single.items():
                numbers, sign = columns.find_all(raw, [column], path, name)
                yield _Pick(what, numbers, np.zeros(1), unit * sign)
            continue
        if name == "temperature":
            wanted = [block.column]
        else:
            named = block.columns
            wanted = [None] if named is None else [c for c in named if c is not None]
        numbers, sign = columns.find_all(raw, wanted, path, name)
        columns.no_dates(raw, numbers, path)
        zero, factor = block.conversion()
        if name in TRIADS:
            zero, factor = zero[list(block.logged)], factor[list(block.logged)]
        yield _Pick(name, numbers, zero, factor * sign)


def _joined(
    parts: list[dict[str, FloatArray]], names: list[str], used: LogDescription
) -> dict[str, FloatArray]:
    """Put the blocks of several files side by side; the first file's time counts."""
    data = {block: values for part in reversed(parts) for block, values in part.items()}
    lengths = [len(next(iter(part.values()))) for part in parts]
    for name, length in zip(names, lengths, strict=True):
        if length != lengths[0]:
            raise error("log.join_length", first=names[0], second=name, n_first=lengths[0],
                        n_second=length)  # fmt: skip
    if used.rate is not None or used.time is None:
        return timed(data, used)
    data = {"time": parts[0]["time"], **data}
    for name, part in zip(names[1:], parts[1:], strict=True):
        half = 0.5 * float(np.median(np.diff(data["time"]))) if lengths[0] > 1 else np.inf
        apart = np.abs(part["time"] - data["time"])
        if np.nanmax(apart) > half:
            row = int(np.argmax(apart > half))
            raise error("log.join_time", first=names[0], second=name, row=row,
                        t_first=f"{data['time'][row]:.9g}", t_second=f"{part['time'][row]:.9g}",
                        half=f"{half:.4g}")  # fmt: skip
    return data


def timed(data: dict[str, FloatArray], used: LogDescription) -> dict[str, FloatArray]:
    """Give rows without a time column their time.

    `data`: blocks by name, each shape (n,) or (n, 3) [SI].
    """
    if used.rate is not None:
        return {"time": np.arange(len(next(iter(data.values())))) / used.rate, **data}
    if used.time is None:  # means: one begins where the one before has ended
        return {"time": np.cumsum(data["averaged"]) - data["averaged"], **data}
    return data


def finished(
    data: dict[str, FloatArray],
    used: LogDescription,
    sampled: Any,
    findings: tuple[Finding, ...],
    source: dict[str, Any],
) -> Log:
    """Check the samples, turn increments into means, and make the log of them.

    `data`: blocks by name, each shape (n,) or (n, 3) [SI]; `sampled` or None: what one of our own
    files says of itself.
    """
    time = data["time"]
    triads = {"gyro": used.gyro, "accel": used.accel}
    kind = next(block.kind for block in triads.values() if block is not None)
    data = data | {
        name: _spread(data[name], block.logged)
        for name, block in triads.items()
        if block is not None and len(block.logged) < 3
    }
    if used.averaged is not None:
        log = means_log(data, kind, findings, source)
        return replace(log, findings=findings + implausible(log, used), clock=used.time_base)
    findings += checks.timing(time, shared=used.shared_clock)
    for name, block in triads.items():
        if block is not None:
            findings += axes.check(time, data[name], name, limits_si(block))
    to_ends = kind == "increment" and used.stamped == "start"
    if apart := used.apart + to_ends:
        data = data | angles_at_times(data, apart)
    if kind == "increment":
        if to_ends:
            data = _at_ends(data)
            time = data["time"]
        dt = _intervals(time)[:, None]
        for name in triads.keys() & data.keys():
            data[name] /= dt
    log = Log(time, data.get("gyro"), data.get("accel"), sampled or kind, data.get("temperature"),
              findings, source, table_of(data), mag=data.get("mag"))  # fmt: skip
    findings += (*axes.unmoved(log), *implausible(log, used))
    return replace(log, findings=findings, clock=used.time_base)


def _rests(time: FloatArray, used: LogDescription) -> tuple[tuple[float, float], ...] | None:
    """Return the times of the rests that were said, None for none; `time` (n,): of the log [s]."""
    if used.rests is None:
        return None
    lasts = float(time[-1] - time[0])
    for a, b in used.rests:
        if b > lasts + 0.5 * float(np.median(np.diff(time))):
            raise error("log.rests_beyond", given=f"{a:.6g}-{b:.6g} s", lasts=f"{lasts:.6g}")
    return tuple((float(time[0]) + a, float(time[0]) + b) for a, b in used.rests)


def _spread(x: FloatArray, axes: tuple[int, ...]) -> FloatArray:
    """Return columns of some axes as those of x, y, z; an axis that is not logged is NaN."""
    out = np.full((len(x), 3), np.nan)
    out[:, list(axes)] = x
    return out


def _at_ends(data: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Give every row of increments the end of its interval, where the next begins.

    The last row is left out, as nothing says where it ends; what is no increment is read at the
    end too. Table angles are those of the end already.
    """
    time = data["time"]
    step = np.diff(time)
    nominal, whole = usual_step(step), ~gaps(step)
    rows = np.arange(len(step)) + whole  # before a gap the next row is too late
    out = {
        name: values[:-1] if name in ("gyro", "accel", *ANGLES) else values[rows]
        for name, values in data.items()
    }
    return out | {"time": np.where(whole, time[1:], time[:-1] + nominal)}


def limits_si(block: Triad) -> FloatArray | None:
    """Return the declared range of each axis of `block`, shape (3, 2) [SI], or None."""
    limits = block.limits()
    if limits is None:
        return None
    zero, factor = block.conversion()
    return np.sort((limits[None, :] - zero[:, None]) * factor[:, None], axis=1)


def _intervals(time: FloatArray) -> FloatArray:
    """Return the interval that ends at each sample, shape (n,) [s]."""
    step = np.diff(time)
    nominal = usual_step(step)
    return np.concatenate([[nominal], np.where(gaps(step), nominal, step)])


def implausible(log: Log, used: LogDescription) -> tuple[Finding, ...]:
    """Return what the sizes of the numbers in `log` say about the units declared in `used`."""
    found: tuple[Finding, ...] = ()
    log = log.filled()
    if log.accel is not None and used.accel is not None and len(used.accel.logged) == 3:
        block = used.accel
        counts = block.scale is not None
        one = None if counts else abs(float(block.conversion()[1][0]))
        each = log.interval if log.averaged is None else float(np.median(log.averaged))
        if log.gyro is not None and used.gyro is not None:
            ratio = np.abs(block.conversion()[1] / used.gyro.conversion()[1])
            found += checks.exchanged_triads(log.gyro, log.accel, ratio, STANDARD_GRAVITY)
        if not found:
            units = ", ".join(block.units)
            found += checks.accel_scale(log.accel, each, units, one, block.kind)
        if counts:
            found += checks.standard_gravity(block.scale)
    if used.time is not None and log.averaged is None and len(log) > 2:
        found += checks.time_scale(log.interval, used.time.unit, used.time.one())
    if log.gyro is not None and used.gyro is not None:
        found += checks.gyro_scale(log.gyro, ", ".join(used.gyro.units), used.gyro.kind)
        if used.table is None and log.averaged is None and used.gyro.scale is None:
            one = float(np.abs(used.gyro.conversion()[1]).mean())
            told = (", ".join(used.gyro.units), one, used.gyro.kind)
            found += checks.earth_scale(log.gyro, log.interval, *told)
    if log.temperature is not None:
        found += checks.temperature_scale(log.temperature)
    return found


# -- Logs of several instruments in one file, told apart by a column of serial numbers -----------
# The column is read first. Then the rows of an instrument are held until its last one has come,
# and handed on as a log of its own: one instrument at a time is in memory where the file holds one
# after the other, all of them where their rows are mixed.


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
    from foucault.logs.description import complete

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


@dataclass(frozen=True)
class ManyLogs:
    """The rows of a file with a column of serial numbers, instrument after instrument."""

    names: list[str]  # serial numbers, in the order in which they first appear
    first: IntArray  # (len(names) + 1,) first row of each, and the number of rows [1]
    data: dict[str, FloatArray]  # blocks by name, each shape (n,) or (n, 3) [SI]
    # ``i -> log`` of one of them, checked as `by_serial` does, or the reason why it is none
    log: Callable[[int], Log | FoucaultError]


def of_many(
    description: LogDescription, folder: str | Path = ".", progress: Progress | None = None
) -> ManyLogs:
    """Read all instruments of a file at once, as `by_serial` reads one after the other.

    Nothing is checked but by `ManyLogs.log`. `description`: file, columns and units, `serial` names
    the column; `folder`: folder that a relative file name starts from; `progress` or None: called
    with the fraction done, from 0 to 1.
    """
    from foucault.logs.description import complete

    raw, path, runs = _opened(description, folder, progress)
    ((_, wanted),) = description.files().items()
    used, blocks = complete(description, wanted, raw, path)
    sampled = raw.sampled if used is not description else None
    data = _columns(used, blocks, raw, path)
    rows = len(next(iter(data.values())))
    code = np.repeat(runs.code, np.diff(runs.start, append=rows))
    if len(runs.start) > len(runs.names):  # their rows are mixed
        order = np.argsort(code, kind="stable")
        data = {block: values[order] for block, values in data.items()}
    first = np.concatenate(([0], np.cumsum(np.bincount(code, minlength=len(runs.names)))))

    def log(i: int) -> Log | FoucaultError:
        piece = {block: x[first[i] : first[i + 1]].copy() for block, x in data.items()}
        return _log([piece], runs.names[i], used, sampled, path)

    return ManyLogs(runs.names, first, data, log)


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
    for cells in _words(raw, number):
        first = runs_of(cells)
        words = cells.take(to_arrow(first)).to_pylist()
        code = np.array([known.setdefault(word.strip(), len(known)) for word in words])
        new = np.flatnonzero(np.diff(code, prepend=before))
        starts.append(row + first[new])
        codes.append(code[new])
        last += [0] * (len(known) - len(last))
        for c, end in zip(code.tolist(), [*first[1:].tolist(), len(cells)], strict=True):
            last[c] = row + end
        row, before = row + len(cells), int(code[-1])
    return _Runs(list(known), np.concatenate(starts), np.concatenate(codes), np.array(last))


def _words(raw: RawTable, number: int) -> Iterator[Any]:
    """Yield the words of a column, as arrays of strings of pyarrow."""
    if raw.words is not None:
        yield from (words for words in raw.words(number) if len(words))
        return
    for block in raw.blocks([number]):
        if len(block):
            yield to_arrow(np.array([f"{value:g}" for value in block[:, 0]], object))


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
