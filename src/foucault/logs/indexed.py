"""The log of a north seeker, of any format, in SI units.

What the sizes of the readings of a north seeker say about the units declared for them.

What the index angle changes in the readings is what is measured: at most the Earth's rate for the
gyro, at most gravity for an accelerometer. Biases that stay the same do not count.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from foucault.arrays import (
    FloatArray,
    IntArray,
    Names,
    begins,
    chosen,
    of_arrow,
    repeating,
    runs_of,
    to_arrow,
)
from foucault.errors import Finding, error, finding
from foucault.files import sha256
from foucault.logs import checks
from foucault.logs import description as columns
from foucault.logs.layout import COUNTS
from foucault.logs.raw import Progress, RawTable, kept, open_raw, together
from foucault.models.earth import EARTH_RATE
from foucault.models.rotation import turned
from foucault.tables import IndexedLog, gaps
from foucault.units import STANDARD_GRAVITY, factor, plain

if TYPE_CHECKING:
    from foucault.logs.indexed_own import IndexedDescription

RATES = ("deg/h", "deg/s", "rad/s", "mrad/s", "arcsec/s")
"""Units people log slow rates in; arcsec/s and deg/h are the same."""

FORCES = ("m/s^2", "g", "mg")

FEW = 4
"""Fewer rows may well read the same [1]."""

ROUND = np.radians(15.0)
"""Base stops are usually at multiples of this [rad]."""

AT_ONCE = 1 << 14
"""Set-ups that are looked at together: the cache holds them, and each core takes some [1]."""


def implausible(log: IndexedLog, used: IndexedDescription) -> tuple[Finding, ...]:
    """Return what the sizes of the numbers in `log` say about the units declared in `used`."""
    found = _index(log, used)
    if not found:
        single = log.accel is not None and log.accel.shape[1] == 1
        columns = [log.gyro, log.accel[:, 0]] if single and log.accel is not None else [log.gyro]
        swings = _swings(log, columns)
        found = (*_gyro(used, *swings[0]), *_accel(log, used, swings[-1][0]))
    return (*_stuck(log), *found)


def _stuck(log: IndexedLog) -> tuple[Finding, ...]:
    """Tell a sensor that turns with the base and reads one value at every stop."""
    turning = {"gyro": log.gyro}
    if log.accel is not None and log.accel.shape[1] == 1:
        turning["accel"] = log.accel[:, 0]
    if len(log.gyro) < FEW or np.ptp(log.index) == 0:
        return ()
    last = f"{float(log.time[-1] - log.time[0]):.9g}"
    return tuple(
        finding("log.stuck", triad=name, axis="column", start="0", end=last)
        for name, x in turning.items()
        if np.ptp(x) == 0
    )


def _index(log: IndexedLog, used: IndexedDescription) -> tuple[Finding, ...]:
    """Tell degrees read as radians and the reverse: stops are at round angles in one of them."""
    angle = repeating(log.index, len(log.names))
    if np.mean(np.abs(np.sin(12 * (angle - angle[0]))) < 0.05) >= 0.9:
        return ()  # round as they are read
    said = log.index / used.index.one()
    for unit, likely, one in (("deg", "rad", 1.0), ("rad", "deg", np.radians(1.0))):
        if used.index.unit != unit:
            continue
        shift = said - said[0]
        near = np.abs(shift * one / ROUND - np.rint(shift * one / ROUND)) < 0.01
        same = np.abs(log.index - log.index[0]) < np.radians(0.1)
        covers = float(np.ptp(shift) * one)
        whole = covers < 2.1 * np.pi if unit == "deg" else covers > ROUND / 2
        if whole and np.mean(near) > 0.9 and not same.all():
            seen = f"they reach from {said.min():.4g} to {said.max():.4g}"
            return (finding("north.index_unit", unit=unit, seen=seen, likely=likely),)
    return ()


def _swings(log: IndexedLog, columns: list[FloatArray]) -> list[tuple[float, float]]:
    """Return of columns (n,) the largest half-swing over the index angles of a set-up, its sd."""
    first = np.flatnonzero(begins(log.setup))[::AT_ONCE].tolist()

    def of(start: int, end: int) -> list[tuple[float, float]]:
        rows = slice(start, end)
        return _swings_of(log.setup[rows] - log.setup[start], log.index[rows],
                          [x[rows] for x in columns])  # fmt: skip

    with ThreadPoolExecutor(min(len(first), os.cpu_count() or 1)) as pool:
        found = [*pool.map(of, first, [*first[1:], len(log)])]
    return [max(each, key=lambda one: one[0]) for each in zip(*found, strict=True)]


def _swings_of(
    number: IntArray, index: FloatArray, columns: list[FloatArray]
) -> list[tuple[float, float]]:
    """Return the same of some set-ups, by their `number` (n,), from 0 [1], and `index` (n,)."""
    first = np.flatnonzero(np.diff(number, prepend=-1))
    m = len(first)
    rows = np.diff(first, append=len(number)).astype(float)
    at = repeating(index, m) if (rows == rows[0]).all() else index
    alike = len(at) * m == len(index)

    def sums(y: FloatArray) -> FloatArray:
        return np.asarray(y @ np.ones(y.shape[1]) if alike else np.add.reduceat(y, first), float)

    A = np.stack([np.ones(len(at)), np.cos(at), np.sin(at)])
    A = A[:, None] if alike else A  # a row for each set-up, or one row
    normal = np.empty((1 if alike else m, 3, 3))
    for i, k in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)):
        normal[:, i, k] = normal[:, k, i] = sums(A[i] * A[k]) / rows[: len(normal)]
    values, vectors = np.linalg.eigh(normal)
    seen = values > 1e-12 * values[:, 2:]
    rank = seen.sum(axis=1)
    out = []
    for x in columns:
        x = x.reshape(m, -1) if alike else x
        mean = sums(x) / rows
        y = x - (mean[:, None] if alike else mean[number])
        right = y @ A[:, 0].T if alike else np.stack([sums(a * y) for a in A], 1)
        right /= rows[:, None]
        inverse = np.where(seen, 1 / np.where(seen, values, 1), 0)[:, None] * vectors
        fit = _each(right, inverse @ np.swapaxes(vectors, 1, 2))
        size = np.where(rank < 2, 0.0, np.hypot(*fit[:, 1:].T))  # one stop: nothing but the offset
        best = int(np.argmax(size))
        some = slice(first[best], first[best] + int(rows[best]))
        left = (y[best] if alike else y[some]) - fit[best] @ (A[:, 0] if alike else A[:, some])
        spent = rank[best if len(rank) > 1 else 0]
        sd = np.sqrt(np.sum(left**2) / max(rows[best] - spent, 1) * 2 / rows[best])
        out.append((float(size[best]), float(sd) if size[best] > 0 else np.inf))
    return out


def _each(x: FloatArray, matrices: FloatArray) -> FloatArray:
    """Return every row of x (m, 3) times its matrix, symmetric, or times the one of all."""
    return x @ matrices[0] if len(matrices) == 1 else np.asarray((matrices @ x[..., None])[..., 0])


def _gyro(used: IndexedDescription, size: float, sd: float) -> tuple[Finding, ...]:
    small = 0.003 * EARTH_RATE > size > 10 * sd
    if not small and not (size > 1.5 * EARTH_RATE and size > 10 * sd):
        return ()
    unit = used.gyro.unit
    likely = [
        other
        for other in RATES[:4]
        if unit not in COUNTS
        and 0.05 * EARTH_RATE
        < size / used.gyro.conversion()[1][0] * factor(other, "angular rate")
        < 1.1 * EARTH_RATE
    ]
    if small and not likely:  # near a pole, or a gyro that was not turned
        return ()
    if likely:
        cure = f'The unit is probably wrong; write unit = "{likely[0]}" in [log.gyro].'
    else:
        cure = "Check unit, scale and column in [log.gyro]."
    rate = plain(np.degrees(size) * 3600)
    return (finding("north.gyro_unit", size=rate, unit=unit, cure=cure),)


def _accel(log: IndexedLog, used: IndexedDescription, size: float) -> tuple[Finding, ...]:
    if log.accel is None or used.accel is None:
        return ()
    if log.accel.shape[1] == 2:
        size = float(np.quantile(np.hypot(*log.accel.T), 0.9))
    if size <= 1.05 * STANDARD_GRAVITY:
        return ()
    unit = used.accel.unit
    raw = size / abs(float(used.accel.conversion()[1][0]))
    likely = [u for u in FORCES if unit not in COUNTS and u != unit
              and raw * factor(u, "specific force") <= STANDARD_GRAVITY]  # fmt: skip
    if likely:
        cure = f'The unit is probably wrong; write unit = "{likely[0]}" in [log.accel].'
    else:
        cure = "Check unit, scale, zero and columns in [log.accel]."
    return (
        finding("north.accel_unit", size=f"{size / STANDARD_GRAVITY:.4g}", unit=unit, cure=cure),
    )


MOVED = np.radians(1.0)
"""A base that stands at another angle after a gap has moved in it [rad]."""

SAME_HEADING = np.radians(0.1)
"""Reference headings within this are those of one set-up [rad]."""

SAME_LATITUDE = np.radians(1e-6)
"""Latitudes within this, some 0.1 m, are those of one set-up [rad]."""

BLANK = ("heading", "latitude", "latitude_sd")
"""Columns whose cells may be empty."""

Data = dict[str, FloatArray]


def read(
    description: IndexedDescription, folder: str | Path = ".", progress: Progress | None = None
) -> IndexedLog:
    """Read the log of a north seeker.

    `folder`: folder that a relative file name starts from; `progress` or None: called with the
    fraction done, from 0 to 1. Returns rows by set-up; `findings` tells what looks wrong,
    `source` where they came from [SI].
    """
    assert description.file is not None
    path = Path(folder) / description.file
    raw = open_raw(path, description, progress)
    with ThreadPoolExecutor(2) as pool:  # numbers, names and fingerprint at the same time
        digest = pool.submit(sha256, path)
        words = pool.submit(_labels, description, raw, path) if raw.words is not None else None
        data = _columns(description, raw, path)
        labels = _labels(description, raw, path) if words is None else words.result()
    if labels is not None:
        import pyarrow as pa

        pa.default_memory_pool().release_unused()  # what the columns were made of
    if description.rate is not None:
        data["time"] = np.arange(len(data["gyro"])) / description.rate
    data, labels, dropped = _usable(data, labels, description, path)
    if "time" not in data:  # means: one begins where the one before has ended
        data["time"] = np.cumsum(data["averaged"]) - data["averaged"]
    setup, names, again = _setups(data, labels)
    log = IndexedLog(
        data["time"], data["index"], data["gyro"], data.get("accel"), setup, names,
        data.get("heading"), data.get("temperature"), data.get("averaged"),
        latitude=data.get("latitude"), latitude_sd=data.get("latitude_sd"),
        source={
            "file": path.name,
            "sha256": digest.result(),
            "rows": len(data["time"]),
            "description": description.model_dump(mode="json", exclude_none=True),
        },
    )  # fmt: skip
    _one_heading(log)
    _one_place(log)
    found = (*raw.findings, *dropped, *again, *_timing(log))
    told = (*found, *implausible(log, description))
    return replace(log, findings=told, clock=description.time_base)


def _columns(used: IndexedDescription, raw: RawTable, path: Path) -> Data:
    """Read all columns of numbers, converted to SI; accel has two dimensions."""
    picks = list(_picks(used, raw, path))
    numbers = [number for _, some, _, _ in picks for number in some]
    raw = kept(raw, path)

    def parts() -> Iterator[Data]:
        for rows in raw.blocks(numbers):  # while the cache holds them
            part, start = Data(), 0
            for name, some, zero, unit in picks:
                values = (rows[:, start : start + len(some)] - zero) * unit
                part[name] = values if name == "accel" else values[:, 0]
                start += len(some)
            yield part

    return together(parts(), raw, path)


_Pick = tuple[str, list[int], FloatArray, FloatArray]


def _picks(used: IndexedDescription, raw: RawTable, path: Path) -> Iterator[_Pick]:
    """Yield name, numbers of columns, zero and factor: SI = (raw - zero) * factor."""
    none = np.zeros(1)
    if used.time is not None:
        numbers, one = columns.find_time(raw, used.time, path)
        yield "time", numbers, none, one
    wanted: dict[str, tuple[int | str, ...]] = {
        "index": (used.index.column,),
        "gyro": (used.gyro.column,),
        "accel": () if used.accel is None else used.accel.wanted,
    }
    for name, some in wanted.items():
        if some:
            numbers, sign = _found(raw, some, name, path)
            zero, factor = getattr(used, name).conversion()
            yield name, numbers, zero, factor * sign
    single = ("heading", "latitude", "latitude_sd", "averaged")
    for name, one_column in ((name, getattr(used, name)) for name in single):
        if one_column is not None:
            numbers, sign = _found(raw, (one_column.column,), name, path)
            yield name, numbers, none, one_column.one() * sign
    if used.temperature is not None:
        column = used.temperature.column
        numbers, _ = _found(raw, (column,), "temperature", path)
        yield "temperature", numbers, *used.temperature.conversion()


def _found(
    raw: RawTable, wanted: tuple[int | str | None, ...], block: str, path: Path
) -> tuple[list[int], FloatArray]:
    numbers, sign = columns.find_all(raw, wanted, path, block)
    columns.no_dates(raw, numbers, path)
    return numbers, sign


class _Labels(NamedTuple):
    """The name of the set-up of each row."""

    words: Any  # all names, an array of strings of pyarrow
    of: IntArray  # (n,) number of that of each row, negative for rows without one [1]


def _labels(used: IndexedDescription, raw: RawTable, path: Path) -> _Labels | None:
    """Return the name of the set-up of each row, where a column has them."""
    if used.setup is None:
        return None
    import pyarrow as pa
    from pyarrow import compute

    number, _ = columns.find(raw, used.setup, path, "setup")
    if raw.words is not None:
        blocks = raw.words(number)
    else:
        numbers = (block[:, 0] for block in kept(raw, path).blocks([number]))
        words = (["" if np.isnan(x) else f"{x:.12g}" for x in some.tolist()] for some in numbers)
        blocks = (to_arrow(np.array(some, object)) for some in words)
    runs, count = [pa.nulls(0, pa.string())], [np.empty(0, np.int64)]
    for cells in blocks:
        first = runs_of(cells)
        runs.append(cells.take(to_arrow(first)))
        count.append(np.diff(first, append=len(cells)))
    coded = compute.utf8_trim_whitespace(pa.concat_arrays(runs)).dictionary_encode()
    code, length = of_arrow(coded.indices), of_arrow(compute.binary_length(coded.dictionary))
    each = np.where(length[code] == 0, -1, code.astype(np.int64))
    return _Labels(coded.dictionary, np.repeat(each, np.concatenate(count)))


def _usable(
    data: Data, labels: _Labels | None, used: IndexedDescription, path: Path
) -> tuple[Data, _Labels | None, tuple[Finding, ...]]:
    """Leave out rows between set-ups, refuse or leave out those without a number."""

    def kept(rows: IntArray) -> None:
        nonlocal data, labels
        data = {name: values[rows] for name, values in data.items()}
        labels = labels and labels._replace(of=labels.of[rows])

    if labels is not None and labels.of.min(initial=0) < 0:
        kept(np.flatnonzero(labels.of >= 0))
    needed = {name: values for name, values in data.items() if name not in BLANK}
    keep, found = checks.finite(needed, used.missing, path.name)
    if keep is not None:
        kept(np.flatnonzero(keep))
    if "averaged" in data:
        wrong = np.flatnonzero(~(data["averaged"] > 0))
        if len(wrong):
            value = f"{data['averaged'][wrong[0]]:g}"
            raise error("log.averaged", file=path.name, row=wrong[0], value=value)
    elif len(data["gyro"]):
        keep, doubled = checks.doubled(data)
        found += doubled
        if keep is not None:
            kept(np.flatnonzero(keep))
    if not len(data["gyro"]):
        raise error("log.empty", file=path.name)
    return data, labels, found


def _setups(
    data: Data, labels: _Labels | None
) -> tuple[IntArray, Sequence[str], tuple[Finding, ...]]:
    """Number the set-ups: runs of one name, else of one reference heading."""
    n = len(data["gyro"])
    heading, latitude = data.get("heading"), data.get("latitude")
    if labels is not None:
        new = begins(labels.of)
    elif heading is not None:
        moved = ~(np.abs(turned(np.diff(heading))) <= SAME_HEADING)
        unknown = np.isnan(heading)
        new = np.append(True, moved & ~(unknown[1:] & unknown[:-1]))
    else:
        new = np.arange(n) == 0
    if labels is None and latitude is not None:
        new[1:] |= np.abs(np.diff(latitude)) > SAME_LATITUDE
    first = np.flatnonzero(new)
    setup: IntArray = np.cumsum(new, dtype=np.int64)
    setup -= 1
    if labels is not None:
        code = labels.of[first]
        different = chosen(Names(labels.words), code)
        if np.bincount(code).max() == 1:
            return setup, different, ()
        plain = [*different]
    elif heading is not None:
        plain = [f"{np.degrees(heading[i]):.6g} deg" for i in first]
    else:
        plain = [f"{k + 1}" for k in range(len(first))]
    if len({*plain}) == len(plain):
        return setup, tuple(plain), ()
    names: list[str] = []
    found = []
    times: Counter[str] = Counter()
    for row, name in zip(first, plain, strict=True):
        count = times[name]
        times[name] += 1
        new_name = f"{name} ({count + 1})" if count else name
        if count:
            words = {"name": name, "row": row, "new": new_name}
            found.append(finding("north.setup_again", **words))
        names.append(new_name)
    return setup, tuple(names), tuple(found)


def _timing(log: IndexedLog) -> tuple[Finding, ...]:
    """Check the time of each set-up; a clock may start anew with every one."""
    found: list[Finding] = []
    numbers = np.arange(len(log.names))
    if log.averaged is not None:  # means may well be far apart, but not run backward
        back = (log.time[1:] <= log.time[:-1]) & ~begins(log.setup)[1:]
        numbers = np.unique(log.setup[1:][back])
    for number in numbers:
        lo, hi = np.searchsorted(log.setup, [number, number + 1])
        told = checks.timing(log.time[lo:hi], start=int(lo))
        if _only_moves(log, int(lo), int(hi)):
            told = tuple(f for f in told if f.code != "log.gap")
        if log.averaged is None:
            found += [f for f in told if f.code not in {g.code for g in found}]
    return tuple(found)


def _only_moves(log: IndexedLog, lo: int, hi: int) -> bool:
    """Tell whether nothing is missing but the moves of the base, which need not be logged."""
    wide = gaps(np.diff(log.time[lo:hi]))
    return bool(np.all(np.abs(np.diff(log.index[lo:hi])[wide]) > MOVED))


def _one_heading(log: IndexedLog) -> None:
    """Refuse a reference heading that changes within a set-up."""
    if log.heading is None:
        return
    starts = np.flatnonzero(np.diff(log.setup, prepend=-1))
    for number, (lo, hi) in enumerate(pairwise([*starts, len(log)])):
        some = log.heading[lo:hi][np.isfinite(log.heading[lo:hi])]
        change = np.abs(turned(some - some[:1])).max(initial=0.0)
        if change > SAME_HEADING:
            words = {"setup": log.names[number], "change": f"{np.degrees(change):.3g}"}
            raise error("north.heading_moves", **words)


def _one_place(log: IndexedLog) -> None:
    """Refuse a latitude that cannot be, or that changes within a set-up."""
    for values, what in ((log.latitude, "latitude"), (log.latitude_sd, "latitude_sd")):
        if values is None:
            continue
        known = np.flatnonzero(np.isfinite(values))
        low = 0.0 if what == "latitude_sd" else -np.pi / 2
        wrong = known[(values[known] < low) | (values[known] > np.pi / 2)]
        if len(wrong):
            given = f"{np.degrees(values[wrong[0]]):.6g}"
            raise error("north.place", setup=log.names[log.setup[wrong[0]]], what=what, given=given)
        within = np.diff(log.setup[known]) == 0
        change = np.abs(np.diff(values[known])) * within
        if change.max(initial=0.0) > SAME_LATITUDE:
            row = known[int(np.argmax(change))]
            raise error("north.place_moves", setup=log.names[log.setup[row]], what=what,
                        change=f"{np.degrees(change.max()):.3g}")  # fmt: skip
