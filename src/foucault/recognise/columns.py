"""Which columns are the clock, the accelerometers, the gyros and the temperature.

Titles are believed where they name three axes of a triad; where they do not, or where the numbers
of what they name cannot be, the numbers tell.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.logs.merged import means_at, within
from foucault.recognise import physics
from foucault.recognise.opening import Opened
from foucault.recognise.titles import Meaning, meaning

Three = tuple[int, int, int]
"""Numbers of the columns of a triad."""


@dataclass(frozen=True)
class Column:
    """One column of numbers of one of the files."""

    # file, number: which file, and which column of it [1]
    file: int
    number: int
    title: str
    means: Meaning


@dataclass(frozen=True)
class Data:
    """The columns of all files beside one another."""

    files: tuple[Opened, ...]
    columns: tuple[Column, ...]
    x: FloatArray  # (n, k) rows without holes in what is used [raw]
    joined: bool = False  # whether rows of several files belong together by their times

    @classmethod
    def of(cls, files: Sequence[Opened]) -> Data:
        """Put the columns of files beside one another, by their rows or else by their times."""
        each = [
            cls(tuple(files), tuple(Column(i, c, one.raw.names[c], meaning_of(one, c))
                              for c in one.columns), one.x)
            for i, one in enumerate(files)
        ]  # fmt: skip
        columns = tuple(column for one in each for column in one.columns)
        by_times = _by_times(each)
        x = np.hstack([one.x for one in each]) if by_times is None else by_times
        return cls(tuple(files), columns, x, by_times is not None)

    def called(self, k: int, sign: float = 1.0) -> int | str:
        """Return what [log] calls column `k` [1]; `sign`: -1 turns it round [1]."""
        name = self.files[self.columns[k].file].name(self.columns[k].number)
        return name if sign > 0 else f"-{name}"

    def shown(self, k: int, sign: float = 1.0) -> str:
        """Return what people call column `k` [1]; `sign`: -1 turns it round [1]."""
        name = self.called(k)
        word = name if isinstance(name, str) else f"column {name}"
        return word if sign > 0 else f"-{word}"

    def file(self, k: int) -> Path:
        """Return the file of column `k` [1]."""
        return self.files[self.columns[k].file].path


def _by_times(each: Sequence[Data]) -> FloatArray | None:
    """Return the rows of files at the instants of the slowest; None where they are rows of one."""
    if len(each) < 2:
        return None
    known = [{one.columns[c.column].title.strip(): c for c in clocks(one)} for one in each]
    common = [title for title in known[0] if all(title in k for k in known[1:])]
    same = len({len(one.x) for one in each}) == 1
    if not common:
        if same:
            return None
        said = ", ".join(f"'{one.file(0).name}' has {len(one.x)}" for one in each)
        raise error("recognise.rows", said=said)
    spots = [k[common[0]].column for k in known]
    # A reading that is missing in one file is no reason to leave out rows of the others.
    tables = [one.x[np.isfinite(one.x[:, k])] for one, k in zip(each, spots, strict=True)]
    tables = [x[np.diff(x[:, k], prepend=-np.inf) > 0] for x, k in zip(tables, spots, strict=True)]
    times = [x[:, k] for x, k in zip(tables, spots, strict=True)]
    steps = [float(np.median(np.diff(t))) for t in times]
    slow = int(np.argmax(steps))
    h = steps[slow]
    if same and max(np.abs(one.x[:, k] - each[0].x[:, spots[0]]).max()
                    for one, k in zip(each, spots, strict=True)) <= h / 2:  # fmt: skip
        return None
    keep = np.all([within(times[slow], h, t) for t in times if t is not times[slow]], axis=0)
    grid = times[slow][keep]
    if len(grid) < 2:
        raise error("log.join_apart", files=", ".join(one.file(0).name for one in each))
    out = []
    for x, t, k in zip(tables, times, spots, strict=True):
        at = x[keep] if t is times[slow] else means_at(grid, h, t, x)
        at[:, k] = grid
        out.append(at)
    return np.hstack(out)


def meaning_of(file: Opened, c: int) -> Meaning:
    """Return what the title of column `c` [1] says, or with the file's name: "x" of "Gyroscope"."""
    if not file.raw.named:
        return meaning("", file.units[c])
    title = file.raw.names[c]
    if (spread := _spread(file, c)) is not None:
        return spread
    said = meaning(title, file.units[c])
    alone = [meaning(name).axis for name in file.raw.names].count(said.axis) == 1
    if said.role or said.axis is None or not alone:
        return said
    named = meaning(f"{file.path.name.partition('.')[0]} {title}", file.units[c])
    return named if named.role in ("accel", "gyro", "mag") else said


_NO_TITLE = re.compile(r"\d?|Unnamed: \d+")


def _spread(file: Opened, c: int) -> Meaning | None:
    """Return what column `c` [1] is if one title stands over three: "Gyro (deg/s)", "1", "2"."""
    names = [name.strip() for name in file.raw.names]
    bare = [_NO_TITLE.fullmatch(name) is not None for name in names]
    first = max((k for k in range(c + 1) if not bare[k]), default=c)
    if bare[first : first + 3] != [False, True, True] or c > first + 2:
        return None
    said = meaning(names[first], file.units[first])
    triad = said.role in ("accel", "gyro", "mag", "linear", "dvel", "dtheta")
    return replace(said, axis=c - first) if triad and said.axis is None else None


@dataclass(frozen=True)
class Clock:
    """The time column."""

    column: int  # its number [1]
    dates: bool  # whether it holds dates, in seconds
    titled: bool  # whether its title says that it is one
    interval: float  # median step [raw]


@dataclass(frozen=True)
class Triads:
    """Columns of the triads, in the order x, y, z or that of the file."""

    accel: Three | None
    gyro: Three | None
    titled: tuple[bool, bool]  # whether titles name the axes of each
    increments: bool | None  # what titles say of them
    several: tuple[tuple[str, tuple[int, ...]], ...] = ()  # further triads of a kind [1]
    why: tuple[str, str] = ("", "")


# -- the clock -----------------------------------------------------------------------------------


def clocks(data: Data) -> list[Clock]:
    """Return the columns that may be time, the likeliest first."""
    found: list[tuple[float, Clock]] = []
    for k, column in enumerate(data.columns):
        t = unwrapped(data.x[:, k])
        step = np.diff(t[np.isfinite(t)])
        if len(step) < 10 or not _onward(step):
            continue
        role, unit = column.means.role, column.means.unit
        titled = role == "time"
        usual = float(np.median(step[step > 0]))
        steady = float(np.mean(np.abs(step - usual) < 0.5 * usual))
        if role not in ("", "time", "counter", "other") or (steady < 0.5 and not titled):
            continue
        if not titled and not _even(t, step):
            continue
        dates = column.number in data.files[column.file].raw.stamps
        counter = role == "counter" or (not titled and bool(np.all(step == np.round(step)))
                                        and usual == 1.0)  # fmt: skip
        worth = 4.0 * titled + 2.0 * bool(unit and titled) + 1.0 * dates + steady
        worth -= 3.0 * counter + 2.0 * bool(np.any(step < 0)) + 1.0 * (column.file > 0)
        worth -= 1.5 * float(np.mean(step == 0) > 0.01) + 3.0 * (role == "other")
        # A clock since 1970 in seconds loses digits beside one that starts with the log.
        worth -= 0.2 * bool(t[0] > 1e9)
        if counter:
            continue
        found.append((worth, Clock(k, dates, titled, usual)))
    return [clock for _, clock in sorted(found, key=lambda pair: -pair[0])]


def shuffled(data: Data) -> tuple[int, float] | None:
    """Return a column of times whose rows are not in their order, and how many of them fall [1].

    A clock that begins again each second or minute tells the same times more than once.
    """
    for k, column in enumerate(data.columns):
        t = data.x[np.isfinite(data.x[:, k]), k]
        falls = float(np.mean(np.diff(t) < 0)) if len(t) > 1 else 0.0
        if column.means.role == "time" and falls > 0.25 and len(np.unique(t)) > 0.9 * len(t):
            return k, falls
    return None


def in_turns(x: FloatArray) -> int:
    """Return how many instruments the rows are of in turn, by their biases, 1 of one [1].

    `x` (n, k): columns of triads [raw].
    """
    for number in (2, 3, 4):
        y = x[: len(x) // number * number].reshape(-1, number, x.shape[1])
        for i in range(1, number):  # beside what the log itself changes by from row to row
            step = (y[:-1, i] - y[:-1, 0]) - i / number * (y[1:, 0] - y[:-1, 0])
            usual = np.median(step, axis=0)
            noise = 1.4826 * np.median(np.abs(step - usual), axis=0)
            if (np.abs(usual) > 2.0 * noise + 1e-9 * np.abs(x).max(axis=0)).sum() > 1:
                return number
    return 1


def counters(data: Data) -> list[int]:
    """Return the columns that count rows."""
    out = []
    for k, column in enumerate(data.columns):
        step = np.diff(data.x[:, k])
        if column.means.role == "counter" or (
            len(step) and float(np.mean(step == 1.0)) > 0.99 and column.means.role in ("", "time")
        ):
            out.append(k)
    return out


def unwrapped(t: FloatArray) -> FloatArray:
    """Return a clock without the falls of a counter that begins again at 2^16, 2^24 or 2^32 [raw].

    `t` (n,) [raw]; one that does not fall, or by another number, comes back as it is.
    """
    step = np.diff(t)
    down = np.flatnonzero(step < 0)
    if not len(down) or not bool(np.all(t == np.round(t))):
        return t
    usual = float(np.median(step))
    for bits in (16, 24, 32):
        if (np.abs(step[down] + 2.0**bits - usual) < 0.5 * usual).all():
            return t + 2.0**bits * np.concatenate([[0.0], np.cumsum(step < 0)])
    return t


OF_DAY = re.compile(r"(?:^|[T ,])(\d{1,2}):(\d\d):(\d\d(?:[.,:]\d+)?)(?:Z| ?([AP])M)?$", re.I)
"""How a time of day ends a cell, whatever date stands before it."""


def rate_of_day(file: Opened, column: int) -> float | None:
    """Return the mean rate of rows with times of day [Hz]; None where they are not even.

    `column`: its number [1].
    """
    cells = [word.strip() for part in file.raw.words(column) for word in part.to_pylist()] \
        if file.raw.words else []  # fmt: skip
    found = [OF_DAY.search(cell) for cell in cells]
    if len(found) < 10 or not all(found):
        return None
    parts = [m.groups() for m in found if m is not None]
    t = np.array([3600.0 * (int(h) % 12 + 12 * (half in "Pp") if half else int(h)) + 60 * int(m)
                  + float(re.sub("[,:]", ".", s)) for h, m, s, half in parts])  # fmt: skip
    t += 86400.0 * np.concatenate([[0], np.cumsum(np.diff(t) < -43200.0)])
    step = np.diff(t)
    if (not _onward(step) and not (step >= 0).all()) or t[-1] == t[0]:
        return None
    rounded = float(np.min(step[step > 0]))
    off = np.abs(t - np.linspace(t[0], t[-1], len(t))).max()
    return float((len(t) - 1) / (t[-1] - t[0])) if off < 2.0 * rounded else None


def wrapped(x: FloatArray) -> bool:
    """Tell whether signed counts of 16 bits are written without a sign; `x` (n, 3) [raw]."""
    if not (x.min() >= 0 and 60_000 < x.max() < 65_536 and bool(np.all(x == np.round(x)))):
        return False
    jumps = np.abs(np.diff(x, axis=0)) > 49_152
    return bool(jumps.sum() > 4)


def _even(t: FloatArray, step: FloatArray) -> bool:
    """Tell whether a column runs on evenly from its first row to its last, as no temperature does.

    A gap is no unevenness.
    """
    usual = float(np.median(step[step > 0]))
    near = step[np.abs(step) < 20 * usual]
    path = np.cumsum(near)
    line = np.linspace(path[0], path[-1], len(path))
    return bool(np.mean(step > 0) > 0.95 and np.abs(path - line).max() < 0.02 * np.ptp(path))


def _onward(step: FloatArray) -> bool:
    return bool(np.mean(step > 0) > 0.5 and np.mean(step < 0) < 0.001)


# -- the triads ----------------------------------------------------------------------------------


def named(data: Data, role: str) -> list[tuple[str, Three]]:
    """Return the triads that titles name: what tells them apart, and the columns x, y, z."""
    found: dict[tuple[int, str], dict[int, list[int]]] = {}
    for k, column in enumerate(data.columns):
        m = column.means
        if m.role == role and m.axis is not None:
            found.setdefault((column.file, m.sensor), {}).setdefault(m.axis, []).append(k)
    out = []
    for (_, sensor), axes in found.items():
        if set(axes) != {0, 1, 2}:
            continue
        for x, y, z in zip(*(axes[i] for i in range(3)), strict=False):  # titles that repeat
            out.append((sensor, (x, y, z)))
    return out


def triads(data: Data, used: Sequence[int]) -> Triads:
    """Find the columns of accelerometers and gyros; `used`: other columns [1]."""
    rate = named(data, "accel"), named(data, "gyro")
    sums = named(data, "dvel"), named(data, "dtheta")
    if not rate[0] and _some_gravity(data, named(data, "linear")):
        rate = named(data, "linear"), rate[1]
    # Increments are taken where there are no rates: both say the same.
    chosen, increments = (rate, False) if any(rate) or not any(sums) else (sums, True)
    accel, gyro = (one[0][1] if one else None for one in chosen)
    several = tuple(
        (kind, columns)
        for kind, found in zip(("accel", "gyro"), chosen, strict=True)
        for _, columns in found[1:]
    )
    titled = accel is not None, gyro is not None
    if accel is None and gyro is not None and _of_one_length(data, gyro):
        # The name of its file may call it gyros; gyros rest near zero, whichever side is up.
        told = ("numbers: its titles say gyros", "numbers")
        return Triads(gyro, None, (False, False), increments or None, several, told)
    if accel is not None and gyro is not None:
        why = ("titles", "titles")
        if _exchanged(data, accel, gyro):
            accel, gyro, why = gyro, accel, ("numbers: its titles say gyros",
                                             "numbers: its titles say accelerometers")  # fmt: skip
        return Triads(accel, gyro, titled, increments or None, several, why)
    field = {k for _, three in named(data, "mag") for k in three}
    # "b" of a, b, c is no magnetometer's.
    lone = {k for k, c in enumerate(data.columns) if c.means.role == "mag"} - field
    rest = [
        k for k, column in enumerate(data.columns)
        if k not in used and k not in (*(accel or ()), *(gyro or ()))
        and (column.means.role in ("", "accel", "gyro", "linear", "dvel", "dtheta", "table")
             or k in lone)
        and float(np.ptp(data.x[:, k])) > 0
    ]  # fmt: skip
    known = (accel, gyro)
    accel, gyro, more = _by_numbers(data, rest, accel, gyro)
    accel, gyro = _in_order(data, accel), _in_order(data, gyro)
    why = ("titles" if titled[0] else "numbers", "titles" if titled[1] else "numbers")
    order = increments if any(known) else None
    return Triads(accel, gyro, titled, order or None, (*several, *more), why)


def _in_order(data: Data, three: Three | None) -> Three | None:
    """Return a triad in the order x, y, z where its titles name the axes, if not the sensor."""
    axes = [data.columns[k].means.axis for k in three or ()]
    if three is None or set(axes) != {0, 1, 2}:
        return three
    x, y, z = (three[axes.index(i)] for i in range(3))
    return x, y, z


def _exchanged(data: Data, accel: Three, gyro: Three) -> bool:
    """Tell whether what is titled accelerometers rests near zero, and gyros have one length."""
    scatter = physics.rest_scatter(data.x, physics.blocks(data.x, [*accel, *gyro]))
    still = bool((scatter[list(accel)] < physics.RESTS_LIKE).all())
    return still and _of_one_length(data, gyro, accel)


def _of_one_length(data: Data, three: Three, beside: Three | tuple[()] = ()) -> bool:
    """Tell whether readings rest at one length on many sides; `beside`: columns that move too."""
    cut = physics.blocks(data.x, [*three, *beside])
    if len(cut.rests[0]) < 4:
        return False
    scatter = physics.rest_scatter(data.x, cut)
    ball = physics.sphere(cut.of_rests(three), three)
    return bool(
        ball is not None and ball.scatter < physics.NORM and ball.spread > 0.5
        and (scatter[list(three)] > 2 * physics.RESTS_LIKE).any()
    )  # fmt: skip


def _some_gravity(data: Data, found: list[tuple[str, Three]]) -> bool:
    """Tell whether readings called linear acceleration hold gravity after all, as those of ROS."""
    for _, columns in found:
        size = np.linalg.norm(data.x[:, list(columns)], axis=1)
        middle = float(np.nanmedian(size))
        if middle > 0 and float(np.nanmedian(np.abs(size - middle))) < 0.2 * middle:
            return True
    return False


def _by_numbers(
    data: Data, rest: list[int], accel: Three | None, gyro: Three | None
) -> tuple[Three | None, Three | None, tuple[tuple[str, Three], ...]]:
    """Find the triads that no title names among the columns `rest`, and further ones like them."""
    every = [*rest, *(accel or ()), *(gyro or ())]
    if len(every) < 3:
        return accel, gyro, ()
    cut = physics.blocks(data.x, every)
    scatter = physics.rest_scatter(data.x, cut)
    still = [k for k in rest if scatter[k] < physics.RESTS_LIKE and _lively(cut, k)]
    most = physics.rest_scatter(data.x, cut, 90.0)
    # A side that few rests have up is still in most; that gyros spin in some is no tilt.
    quiet = [k for k in still if most[k] < physics.RESTS_LIKE]
    tilted = [k for k in rest if not most[k] < physics.RESTS_LIKE / 3]
    more: list[tuple[str, Three]] = []
    if accel is None:
        found = physics.spheres(cut, [k for k in tilted if k not in quiet])
        found = found or physics.spheres(cut, tilted)
        ranked = _likeliest(data, cut, found)
        accel = ranked[0] if ranked else _one_side(data, rest)
        more += [("accel", one) for one in ranked[1:2]]
    if gyro is None:
        left = [k for k in still if k not in (accel or ())]
        if len(left) < 3:
            left = [k for k in rest if k not in (accel or ()) and _lively(cut, k)]
        turned = _rates(data, cut, accel, left)
        gyro = turned[0] if turned else _beside(rest, accel)
        more += [("gyro", one) for one in turned[1:2]]
    return accel, gyro, tuple(more)


USUAL = (9.81, 1.0, 1000.0, 981.0, 16384.0, 8192.0, 4096.0, 2048.0)
"""Lengths that accelerometers' readings usually have at rest [raw]."""


def _threes(rest: list[int]) -> list[Three]:
    """Return the columns in threes as they stand, where they are whole triads side by side."""
    if len(rest) % 3 or (rest and rest[-1] - rest[0] != len(rest) - 1):
        return []
    return [(a, b, c) for a, b, c in zip(rest[::3], rest[1::3], rest[2::3], strict=True)]


def _one_side(data: Data, rest: list[int]) -> Three | None:
    """Return three columns side by side whose length is a usual one, of a log that only rests."""
    fitting = []
    for three in _threes(rest):
        size = np.linalg.norm(np.median(data.x[:, list(three)], axis=0))
        if size > 0 and min(abs(np.log(size / r)) for r in USUAL) < 0.05:
            fitting.append(three)
    return fitting[0] if len(fitting) == 1 else None


def _beside(rest: list[int], accel: Three | None) -> Three | None:
    """Return the other triad of two that stand side by side."""
    threes = _threes(rest)
    if len(threes) != 2 or accel not in threes:
        return None
    return threes[1 - threes.index(accel)]


def _lively(cut: physics.Blocks, k: int) -> bool:
    """Tell whether motion makes a column scatter, or differ from what it is at rest."""
    sd, mean = cut.sd[:, k], cut.mean[:, k]
    if cut.quiet.all() or not cut.quiet.any():
        return False
    noise = float(np.median(sd[cut.quiet]))
    away = float(np.median(np.abs(mean[~cut.quiet] - np.median(mean[cut.quiet]))))
    return max(float(np.median(sd[~cut.quiet])) / 2.0, away / AWAY) > noise


AWAY = 10.0
"""Means of a column in a steady spin are away from those at rest by so much of its noise [1]."""


def _likeliest(data: Data, cut: physics.Blocks, found: list[physics.Sphere]) -> list[Three]:
    """Of triples of one length at rest return those that may be accelerometers."""
    apart = [s for s in found if s.spread > 0.3] or found

    def oddness(s: physics.Sphere) -> float:
        size = np.linalg.norm(data.x[:, list(s.columns)] - s.centre, axis=1)
        moving = np.repeat(~cut.quiet, cut.size)[: len(size)]
        shaken = float(np.std(size[: len(moving)][moving]) / s.radius) if moving.any() else 0.0
        usual = min(abs(np.log(s.radius / r)) for r in USUAL)
        a, _, c = s.columns
        zero = float(np.linalg.norm(s.centre) / s.radius)
        # A magnetometer's length stays the same when it is shaken; that of gyros is another.
        odd = 20 * s.scatter + 1.2 * (usual > 0.08) + min(zero, 1.0) + 0.3 * (c - a > 2)
        return float(odd - 3 * min(shaken, 0.15) + 3 * max(0.0, shaken - 0.35))

    ranked = sorted(((oddness(s), s.columns) for s in apart[:200]), key=lambda one: one[0])
    return _apart([one for odd, one in ranked if odd < ranked[0][0] + 0.25])


def _apart(ranked: list[Three]) -> list[Three]:
    """Return the first, and those that share no column with it."""
    return [one for i, one in enumerate(ranked) if i == 0 or not set(one) & set(ranked[0])]


def _rates(data: Data, cut: physics.Blocks, accel: Three | None, left: list[int]) -> list[Three]:
    """Return those threes of the columns `left` that turn gravity as the accelerometers say."""
    if len(left) < 3 or accel is None:  # what rests near zero may be anything
        return []
    if len(left) == 3:
        return [(left[0], left[1], left[2])]
    ball = physics.sphere(cut.of_rests(accel), accel)
    time = np.arange(len(data.x), dtype=float)
    found: list[tuple[float, Three]] = []
    for three in list(combinations(left[:9], 3))[:84]:
        turned = ball and physics.turns(data.x, time, cut, ball, three)
        if turned and turned.fits:
            # Of two instruments each has its columns side by side.
            found.append(
                (turned.miss + (0.0 if three[2] - three[0] == 2 else physics.PROVED), three)
            )
    found.sort(key=lambda one: one[0])
    return _apart([one for off, one in found if off < found[0][0] + physics.PROVED])


CLIMATE = {"degC": (-80.0, 150.0), "K": (190.0, 430.0), "degF": (-110.0, 300.0)}
"""What instruments are as warm as [as named]."""


def temperature(data: Data) -> tuple[int, str, bool] | None:
    """Return the column of temperature, its unit and whether its title gives that.

    None where titles and numbers do not agree.
    """
    for k, column in enumerate(data.columns):
        if column.means.role != "temperature":
            continue
        middle = float(np.median(data.x[:, k]))
        unit = column.means.unit
        if told := unit in CLIMATE:
            fine = CLIMATE[unit][0] < middle < CLIMATE[unit][1]
        else:
            unit = "degC" if -60 < middle < 130 else "K"
            fine = unit == "degC" or 210 < middle < 400
        if fine:
            return k, unit, told
    return None


FIELD, FIELDS = 48.0, {"T": 1e-6, "nT": 1e3, "uT": 1.0, "G": 1e-2, "mG": 10.0}
"""Usual field of the Earth [uT], and units by what it is in each, that of 1 uT."""


def magnetometer(data: Data) -> tuple[tuple[int, ...], str, bool] | None:
    """Return the columns of a magnetometer, their unit, and whether a title says it."""
    axis = {k: c.means.axis for k, c in enumerate(data.columns) if c.means.role == "mag"}
    first = [k for k in axis if data.file(k) == data.file(next(iter(axis)))][:3]
    first.sort(key=lambda k: axis[k] or 0)
    if [axis[k] for k in first] != [0, 1, 2]:
        return None
    told = data.columns[first[0]].means.unit
    if told in FIELDS:
        return tuple(first), told, True
    # Half of what each axis goes through is the field, whatever the hard iron.
    radius = float(np.median(np.ptp(np.percentile(data.x[:, first], (1, 99), axis=0), axis=0))) / 2
    off = {unit: abs(np.log(max(radius, 1e-12) / size / FIELD)) for unit, size in FIELDS.items()}
    best = min(off, key=lambda unit: off[unit])
    return (tuple(first), best, False) if off[best] < np.log(3.0) else None
