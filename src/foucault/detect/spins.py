"""Which stretches of a log on a table become readings, and over which time each is averaged.

Where the log numbers its positions there is one reading per number, from the longest time without
change inside it. Otherwise every rest that is long enough is a reading, and every spin of at least
one turn; a table that goes to its next position at a constant rate turns by less.

Spins are averaged over whole turns: the horizontal part of the Earth's rotation, and what a leaning
outer axis adds, go round in the instrument and average to zero over whole turns, not over any
others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect.cells import CELL, Reduced, Source, held
from foucault.detect.table import Steadiness, Stretch, bias_across, mean, steadiness, stretches
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.tables import Log
from foucault.units import plain

OTHER_RATE = 1.2  # Rates that differ by more than this factor are not the same rate [1].

MOST_MOVING = 0.25
"""A numbered position that moves for longer than this part of its time is told [1]."""

SAME = np.radians(2.0)  # Directions of up in one position differ by less [rad].
CREEP = np.radians(1.0)  # No table moves so slowly from one position to the next [rad/s].

ATTEMPT = 0.55
"""A spin of so much of a turn was meant to be one: moves to other positions are shorter [1]."""

PAUSE = 0.3
"""A rest next to a spin, shorter than this part of the longest rest, is only a pause [1]."""

LEFT_OVER = 0.25  # Parts of a turn larger than this are worth telling; ramps leave less [1].

TURN = 2 * np.pi

NEARLY = 0.01  # Where no angle is logged, so much less than a turn still counts as one [1].
ROUNDED = 1e-3  # The same where an angle is: what stamps and angles are rounded by [1].

OFF_LINE = np.radians(0.02)
"""An outer angle this far from uniform rotation belongs to a ramp [rad]."""

OFF_GYRO = 2e-6  # The same for the angle that the gyros add up, beyond their noise [rad].


@dataclass(frozen=True)
class Reach:
    """Where uniform rotation begins and ends."""

    # start, end: first and last time of it [s]
    start: float
    end: float
    # time, angle: (k,) times beyond the cells of the spin, and the outer angle then, without jumps
    # [s], [rad]
    time: FloatArray = field(default_factory=lambda: np.empty(0))
    angle: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Window:
    """The time over which a reading is averaged."""

    # start, end: first and last time [s]
    start: float
    end: float
    rate: float = 0.0  # rate of the outer axis over it, 0 at rest [rad/s]
    turns: float = 0.0  # turns in it, whole; 0 at rest [1]
    whole: float = 0.0  # turns of the spin that it was taken from [1]


@dataclass(frozen=True)
class Choice:
    """The readings of a log before they are averaged."""

    runs: list[Stretch]  # the time without change that each reading is taken from
    windows: list[Window]  # the time over which each is averaged
    # (n,) which are rests next to a spin in the same position: they may be no more than pauses
    pauses: BoolArray
    findings: tuple[Finding, ...]  # what was left out


def choose(source: Source, data: Reduced, commanded: FloatArray, shortest: float) -> Choice:
    """Choose rests of `shortest` [s], and spins at `commanded` (k,), empty for unknown [rad/s]."""
    if "accel" not in data.has and "gyro" not in data.has:
        raise error("session.no_accel")
    how = steadiness(data)
    runs = stretches(data, how, float(commanded.min()) if len(commanded) else None)
    _same_rate(data, runs, commanded)
    labelled = "label" in data.has
    findings: list[Finding] = []
    if labelled:
        runs, findings = _by_label(data, runs, shortest)
    else:
        runs = [r for r in runs if r.rate != 0 or _time(data, r) >= shortest]
    spins = [run for run in runs if run.rate != 0]
    windows = dict(zip(spins, _windows(source, data, spins, commanded), strict=True))
    short = [run for run in spins if not windows[run].turns]
    good = [run for run in runs if run.rate == 0 or windows[run].turns]
    lost, told = _unused(data, how, good)
    findings += told
    short = [r for r in short if not any(a <= r.first < b for a, b in lost)]
    meant = [r for r in short if labelled or windows[r].whole >= ATTEMPT]
    if meant and (labelled or len(good) == sum(r.rate == 0 for r in good)):
        turns = f"{windows[meant[0]].whole:.2f}"
        raise error("spin.short", turns=turns, **_words(data, meant[0]))
    pauses = np.zeros(len(good), bool)
    if not labelled:
        findings += _creeping(data, short, good)
        good, pauses = _without_pauses(data, good)
    _rates_as_told(data, good, commanded)
    chosen = [windows.get(run) or Window(*_ends(data, run)) for run in good]
    if labelled:
        findings += _cut(chosen)
    findings += _unlogged(data, good)
    return Choice(good, chosen, pauses, tuple(findings))


def _ends(data: Reduced, run: Stretch) -> tuple[float, float]:
    """Return the time that the cells of a stretch cover [s]."""
    return float(data.cells.start[run.first]), float(data.cells.end[run.last - 1])


def _time(data: Reduced, run: Stretch) -> float:
    start, end = _ends(data, run)
    return end - start


def _longest(data: Reduced, runs: list[Stretch]) -> float:
    return max((_time(data, run) for run in runs if run.rate == 0), default=0.0)


def _words(data: Reduced, run: Stretch) -> dict[str, str]:
    label, zero = int(data.cells.label[run.first]), float(data.cells.first[0])
    start, end = (f"{max(0.0, t - zero):.1f}" for t in _ends(data, run))
    name = f"Position {label}" if label >= 0 else "The position"
    return {"position": name, "start": start, "end": end}


def _bias(data: Reduced, runs: list[Stretch]) -> FloatArray:
    """Return the mean rate of the rests, zero where there is none, (3,) [rad/s]."""
    rests = [mean(data.cells, data.cells.gyro, r) for r in runs if r.rate == 0]
    return np.asarray(np.mean(rests, axis=0)) if rests else np.zeros(3)


# -- what is no reading ----------------------------------------------------------------------------


def _by_label(
    data: Reduced, runs: list[Stretch], shortest: float
) -> tuple[list[Stretch], list[Finding]]:
    """Choose one stretch for each time that a number is given."""
    cells, label = data.cells, data.cells.label
    logged = cells.end - cells.start  # what the samples stand for, missing ones not counted
    edges = np.flatnonzero(np.diff(label, prepend=label[0] - 1, append=label[-1] + 1))
    chosen: list[Stretch] = []
    findings: list[Finding] = []
    for a, b in pairwise(edges.tolist()):
        if label[a] < 0:
            continue
        words = _words(data, Stretch(a, b))
        inside = [run for run in runs if a <= run.first < b]
        spins = [r for r in inside if r.rate != 0 and abs(r.rate) * _time(data, r) > 0.1 * TURN]
        other = [r for r in spins if (r.rate > 0) != (spins[0].rate > 0)]
        if other:
            raise error("spin.both_senses", at=_words(data, other[0])["start"], **words)
        rests = [r for r in inside if r.rate == 0 and _time(data, r) >= shortest]
        best = max(spins or rests, key=lambda r: _time(data, r), default=None)
        if best is None:
            findings.append(finding("position.moving", used="none of it", **words))
            continue
        chosen.append(best)
        still = [best]
        if cells.broken[a + 1 : b].any():  # what is between two gaps need not have moved
            still = [r for r in inside if r.rate == best.rate]
        moving = np.sum(logged[a:b]) - sum(_time(data, r) for r in still)
        if best.rate == 0 and moving > max(MOST_MOVING * _time(data, Stretch(a, b)), 2 * CELL):
            used = "only {start}-{end} s".format(**_words(data, best))
            findings.append(finding("position.moving", used=used, **words))
    return chosen, findings


def _unused(
    data: Reduced, how: Steadiness, good: list[Stretch]
) -> tuple[list[tuple[int, int]], list[Finding]]:
    """Name the steady turns of the gyros, of a whole turn or more, that are no reading."""
    lost: list[tuple[int, int]] = []
    out: list[Finding] = []
    if "gyro" not in data.has:
        return lost, out
    cells, bias = data.cells, _bias(data, good)
    for run in how.even_runs:
        a, b = run.first, run.last
        used = sum(min(r.last, b) - max(r.first, a) for r in good if r.first < b and r.last > a)
        speed = float(np.linalg.norm(mean(cells, cells.gyro, run) - bias))
        turns = speed * _time(data, run) / TURN
        if turns < 1 or 2 * used > b - a or speed < CREEP:
            continue
        lost.append((a, b))
        words = _words(data, run)
        change = "the accelerometers change meanwhile"
        why = change if "accel" in data.has else "it is no steady turn about the vertical"
        out.append(finding("spin.unused", turns=f"{turns:.2f}", start=words["start"],
                           end=words["end"], why=why))  # fmt: skip
    return lost, out


def _creeping(data: Reduced, short: list[Stretch], good: list[Stretch]) -> list[Finding]:
    """Name what would be a rest if it did not turn slowly; a move is faster or shorter."""
    longest = _longest(data, good)
    out = []
    for run in short:
        if abs(run.rate) < CREEP and 0.0 < PAUSE * longest < _time(data, run):
            words = _words(data, run)
            rate = plain(float(np.degrees(abs(run.rate))), 2)
            out.append(finding("rest.moving", start=words["start"], end=words["end"], rate=rate))
    return out


def _without_pauses(data: Reduced, runs: list[Stretch]) -> tuple[list[Stretch], BoolArray]:
    """Leave out the short rests before and after a spin; tell the longer ones."""
    pauses = np.zeros(len(runs), bool)
    for k, (a, b) in enumerate(pairwise(runs)):
        if (a.rate == 0) != (b.rate == 0) and _same_position(data, a, b):
            pauses[k if a.rate == 0 else k + 1] = True
    longest = _longest(data, runs)
    keep = [not (p and _time(data, r) < PAUSE * longest)
            for r, p in zip(runs, pauses, strict=True)]  # fmt: skip
    return [run for run, k in zip(runs, keep, strict=True) if k], pauses[keep]


def _same_position(data: Reduced, a: Stretch, b: Stretch) -> bool:
    """Tell whether the outer axis alone, or nothing, has turned between two stretches."""
    cells = data.cells
    between = slice(a.last, b.first)
    if "accel" in data.has:
        means = [mean(cells, cells.accel, run) for run in (a, b)]
        if a.last < b.first:
            means.append(cells.accel[between].mean(axis=0))
        up = [x / np.linalg.norm(x) for x in means]
        return all(float(np.linalg.norm(x - up[0])) < SAME for x in up)
    if "gyro" not in data.has:
        return False
    spin, rest = (mean(cells, cells.gyro, run) for run in ((a, b) if a.rate else (b, a)))
    axis = (spin - rest) / np.linalg.norm(spin - rest)
    ramp = (cells.gyro[between] - rest).sum(axis=0)
    across = float(np.linalg.norm(np.cross(ramp, axis)))
    return bool(across <= SAME * np.linalg.norm(ramp))


def _unlogged(data: Reduced, runs: list[Stretch]) -> list[Finding]:
    """Tell that moves were not logged, where every gap is between two positions."""
    gaps, label = np.flatnonzero(data.cells.broken), data.cells.label
    if np.any((label[gaps] >= 0) & (label[gaps] == label[gaps - 1])):
        return []
    for k in gaps.tolist():
        before = [r for r in runs if r.last <= k]
        after = [r for r in runs if r.first >= k]
        if not before or not after:
            continue
        a, b = before[-1], after[0]
        numbered = min(label[a.first], label[b.first]) >= 0
        if not numbered and (a.rate == 0) == (b.rate == 0) and _same_place(data, a, b):
            return []  # samples are missing inside a position
    return [finding("positions.unlogged", count=len(gaps))] if len(gaps) else []


def _same_place(data: Reduced, a: Stretch, b: Stretch) -> bool:
    """Tell whether two rests, or two spins, look as if the table had not moved between them."""
    cells = data.cells
    name = "accel" if "accel" in data.has else "gyro"
    x, y = (mean(cells, getattr(cells, name), run) for run in (a, b))
    turned = cells.from_angles[b.first] - cells.to_angles[a.last - 1]
    if name == "gyro" or (a.rate == 0 and np.any(np.abs(np.nan_to_num(turned)) > SAME)):
        return bool(np.all(np.abs(np.nan_to_num(turned)) <= SAME))
    return bool(np.linalg.norm(x - y) < SAME * np.linalg.norm(x))


def _cut(windows: list[Window]) -> list[Finding]:
    """Tell which numbered spins had a part of a turn more than was used."""
    spins = [w for w in windows if w.turns]
    cut = [w for w in spins if w.whole - w.turns > LEFT_OVER]
    if not cut:
        return []
    which = f"all {len(spins)}" if len(cut) == len(spins) else f"{len(cut)} of {len(spins)}"
    most = max(w.whole - w.turns for w in cut)
    return [finding("spin.cut", which=which, most=f"{most:.2f}")]


# -- rates that cannot be --------------------------------------------------------------------------


def nearest(rate: float, commanded: FloatArray) -> float | None:
    """Return the rate of `commanded` (k,) that is like `rate`; None where there is none [rad/s]."""
    if not len(commanded):
        return None
    ratio = np.abs(np.log(abs(rate) / commanded))
    best = int(np.argmin(ratio))
    return float(commanded[best]) if ratio[best] <= np.log(OTHER_RATE) else None


def rate_problem(
    code: str, ratio: float, told: float, measured: float, interval: float = np.nan
) -> FoucaultError | None:
    """Name a rate of the table that is not that of the gyros, or return None.

    `code`: what it is where no unit explains it, "table.rate_differs" blames the columns of the
    table, "spin.rate" the gyros; `ratio`: rate of the table over rate of the gyros [1]; `told`,
    `measured`: both rates, for the text [rad/s]; `interval`: of samples, NaN where rows are none
    [s].
    """
    if 1 / OTHER_RATE < ratio < OTHER_RATE:
        return None
    words = {"told": plain(np.degrees(told), 4), "measured": plain(np.degrees(measured), 4)}
    one = np.degrees(1.0)
    for factor, is_unit, says in ((one, "deg", "rad"), (1 / one, "rad", "deg")):
        if 1 / OTHER_RATE < ratio / factor < OTHER_RATE:
            if code == "table.rate_differs":
                return error("table.rate_unit", likely=is_unit, given=says, **words)
            # The other way round: what the plan says is not read from a file of raw numbers.
            return error("spin.rate_unit", likely=f"{says}/s", given=f"{is_unit}/s", **words)
    if 1 / OTHER_RATE < ratio * interval < OTHER_RATE:
        return error("spin.increments", rate=plain(1 / interval), **words)
    return error(code, **words)


def _refuse(code: str, ratio: float, told: float, measured: float, interval: float) -> None:
    problem = rate_problem(code, ratio, told, measured, interval)
    if problem is not None:
        raise problem


def _same_rate(data: Reduced, runs: list[Stretch], commanded: FloatArray) -> None:
    """Refuse angles of the table that turn at another rate than the gyros say."""
    spins = [run for run in runs if run.rate != 0]
    if not spins or "outer" not in data.has or "gyro" not in data.has:
        return
    bias = _bias(data, runs)
    time = np.array([_time(data, run) for run in spins])
    size = np.array([np.linalg.norm(mean(data.cells, data.cells.gyro, r) - bias) for r in spins])
    ratio = np.array([abs(run.rate) for run in spins]) / np.maximum(size, 1e-12)
    order = np.argsort(ratio)
    middle = order[np.searchsorted(np.cumsum(time[order]), 0.5 * time.sum())]
    told = abs(spins[middle].rate)
    # Where plan and table agree it is the gyros that are wrong.
    code = "table.rate_differs" if nearest(told, commanded) is None else "spin.rate"
    _refuse(code, float(ratio[middle]), told, float(size[middle]), data.interval)


def _rates_as_told(data: Reduced, runs: list[Stretch], commanded: FloatArray) -> None:
    """Refuse spins at another rate than commanded, where only the command tells the turns."""
    if "outer" in data.has or not len(commanded):
        return
    spins = [run for run in runs if run.rate != 0]
    if not spins and {"gyro", "accel"} <= data.has:
        _far_too_slow(data, [run for run in runs if run.rate == 0], commanded)
    other = [run for run in spins if nearest(run.rate, commanded) is None]
    if other:
        run = max(other, key=lambda r: _time(data, r))  # a move is shorter
        told = float(commanded[np.argmin(np.abs(np.log(abs(run.rate) / commanded)))])
        _refuse("spin.rate", told / abs(run.rate), told, abs(run.rate), data.interval)


def _far_too_slow(data: Reduced, rests: list[Stretch], commanded: FloatArray) -> None:
    """Refuse rests that turn at the rates of spins, but for the factor of a wrong unit."""
    if len(rests) < 3:
        return
    w, f = (np.array([mean(data.cells, x, r) for r in rests])
            for x in (data.cells.gyro, data.cells.accel))  # fmt: skip
    up = f / np.maximum(np.linalg.norm(f, axis=1), 1e-300)[:, None]
    bias = bias_across(w, up, np.array([_time(data, r) for r in rests]))
    along = np.abs(((w - bias) * up).sum(axis=1))
    for told in commanded:
        like = (along > np.radians(told) / OTHER_RATE) & (along < np.radians(told) * OTHER_RATE)
        if like.sum() >= max(3, len(rests) // 4):
            size = float(np.median(along[like]))
            _refuse("spin.rate", float(told) / size, float(told), size, data.interval)


# -- whole turns -----------------------------------------------------------------------------------


def _windows(
    source: Source, data: Reduced, spins: list[Stretch], commanded: FloatArray
) -> list[Window]:
    if not spins:
        return []
    inner = [Reach(*_ends(data, run)) for run in spins]
    rates = [nearest(run.rate, commanded) for run in spins]
    windows = [whole_turns(data, *each) for each in zip(spins, rates, inner, strict=True)]
    # Another turn may be there if the spin goes on for a part of the cells at its ends.
    more = any(
        np.floor(w.whole + 4 * CELL * abs(run.rate) / TURN) > w.turns
        for run, w in zip(spins, windows, strict=True)
    )
    if not more:
        return windows
    outer = reaches(source, data, spins)
    return [whole_turns(data, *each) for each in zip(spins, rates, outer, strict=True)]


def whole_turns(data: Reduced, run: Stretch, rate: float | None, reach: Reach) -> Window:
    """Choose the whole turns of a spin, as many as there are, from its middle.

    `rate` or None: size of the rate as commanded, where known [rad/s]; `reach`: where uniform
    rotation begins and ends [s].
    """
    start, end = reach.start, reach.end
    if "outer" in data.has:
        time, angle = _line(data, run, reach)
        total = float(angle[-1] - angle[0])
        turns = np.floor(abs(total) / TURN + ROUNDED)
        # Never beyond the samples, not even for the last thousandth of a turn.
        spare = max(0.0, 0.5 * (abs(total) - turns * TURN))
        sense = np.sign(total)
        at = np.array([angle[0] + sense * spare, angle[-1] - sense * spare])
        t0, t1 = np.interp(sense * at, sense * angle, time)
        mean_rate = (at[1] - at[0]) / (t1 - t0) if turns else run.rate
        return Window(float(t0), float(t1), float(mean_rate), float(turns), abs(total) / TURN)
    speed = run.rate if rate is None else float(np.copysign(rate, run.rate))
    whole = abs(speed) * (end - start) / TURN
    # Uniform rotation may begin and end anywhere between two samples.
    between = min(2 * data.interval * abs(speed) / TURN, NEARLY)
    turns = np.floor(whole + between + 1e-9 + (NEARLY if rate is None else 0.0))
    # What is beyond the samples is a ramp, or not in the log at all.
    half = min(0.5 * turns * TURN / abs(speed), 0.5 * (end - start))
    middle = 0.5 * (start + end)
    return Window(middle - half, middle + half, speed, float(turns), whole)


def _line(data: Reduced, run: Stretch, reach: Reach) -> tuple[FloatArray, FloatArray]:
    """Return the outer angle of a spin, without jumps, and its times, both shape (k,) [rad], [s].

    `reach`: where uniform rotation begins and ends, the first and last point are there [s].
    """
    cells, part = data.cells, run.cells
    time = np.stack([cells.first[part], cells.last[part]], axis=1).ravel()
    angle = np.stack([cells.from_angles[part, 0], cells.to_angles[part, 0]], axis=1).ravel()
    time, once = np.unique(np.concatenate([time, reach.time]), return_index=True)
    angle = np.concatenate([angle, reach.angle])[once]
    # A rate log stands for half an interval more than its samples.
    first = angle[0] - run.rate * (time[0] - reach.start)
    last = angle[-1] + run.rate * (reach.end - time[-1])
    time = np.concatenate([[reach.start], time, [reach.end]])
    angle = np.concatenate([[first], angle, [last]])
    keep = np.append(np.diff(time) > 0, True)
    return time[keep], angle[keep]


def reaches(source: Source, data: Reduced, runs: list[Stretch]) -> list[Reach]:
    """Find to the sample where uniform rotation begins and ends.

    A spin of exactly whole turns between its ramps would lose a turn by the length of a cell.

    `source`: gives the blocks of the log [SI].
    """
    cells = data.cells
    zones = []  # before and after the cells of each spin, as far as it may go on
    for run in runs:
        a, b, (start, end) = run.first, run.last, _ends(data, run)
        low, high = start, end
        if a > 0 and cells.label[a - 1] == cells.label[a] and not cells.broken[a]:
            low = max(float(cells.start[a - 1]), start - 2 * CELL)
        if b < len(cells) and cells.label[b] == cells.label[b - 1] and not cells.broken[b]:
            high = min(float(cells.end[b]), end + 2 * CELL)
        zones.append(((low, start), (end, high)))
    parts: list[tuple[list[Log], list[Log]]] = [([], []) for _ in runs]
    for log in source():
        for both, kept in zip(zones, parts, strict=True):
            for zone, some in zip(both, kept, strict=True):
                i, j = np.searchsorted(log.time, zone)
                if j > i:
                    some.append(held(log[int(i) : int(j)]))
    out = []
    for run, both, kept in zip(runs, zones, parts, strict=True):
        ends, time, angle = list(_ends(data, run)), [np.empty(0)], [np.empty(0)]
        for k, (way, some) in enumerate(zip((-1, 1), kept, strict=True)):
            if some:
                times, angles = _uniform(data, run, some, way)
                if len(times) == sum(len(p) for p in some):
                    ends[k] = both[k][k]  # to the end of what the last sample stands for
                elif len(times):
                    ends[k] = float(times[-1])
                time.append(times)
                angle.append(angles)
        if "outer" in data.has:
            out.append(Reach(ends[0], ends[1], np.concatenate(time), np.concatenate(angle)))
        else:
            out.append(Reach(ends[0], ends[1]))
    return out


def _uniform(
    data: Reduced, run: Stretch, parts: list[Log], way: int
) -> tuple[FloatArray, FloatArray]:
    """Return times and outer angles beyond the cells of a spin, as far as they are uniform."""
    time = np.concatenate([p.time for p in parts])[::way]
    tables = [p.table for p in parts if p.table is not None]
    outer = np.concatenate([t.angles[:, 0] for t in tables])[::way] if tables else np.empty(0)
    uniform = np.zeros(len(time))
    if "outer" in data.has:
        at, angle = _line(data, run, Reach(*_ends(data, run)))
        end = 0 if way < 0 else -1
        uniform = angle[end] + run.rate * (time - at[end])
    if len(outer) and np.isfinite(outer).all():
        off, allowed = np.angle(np.exp(1j * (outer - uniform))), np.full(len(time), OFF_LINE)
    else:
        off, allowed = _turned_more(data, run, parts, way)
    bad = np.flatnonzero(np.abs(off) > allowed)
    good = int(bad[0]) if len(bad) else len(time)
    return time[:good], (uniform + off)[:good]


def _turned_more(
    data: Reduced, run: Stretch, parts: list[Log], way: int
) -> tuple[FloatArray, FloatArray]:
    """Return the angle turned beyond that of uniform rotation, and how much noise makes of it."""
    least = OFF_GYRO
    if "outer" in data.has:
        rates = [p.table.rate for p in parts if p.table is not None and p.table.rate is not None]
        rate, sd, usual, least = np.concatenate(rates), 0.0, run.rate, OFF_LINE
    else:
        w = mean(data.cells, data.cells.gyro, run)
        usual = float(np.linalg.norm(w))
        rate = np.concatenate([p.gyro for p in parts if p.gyro is not None]) @ (w / usual)
        variance = data.cells.gyro_var[run.cells].sum(axis=1)
        sd = float(np.sqrt(np.median(variance)))
    # The first sample stands for the half interval to the cells, and half of the next.
    off = way * np.cumsum(rate[::way] - usual) * data.interval
    count = np.arange(1, len(off) + 1)
    return off, least + 4 * sd * np.sqrt(count) * data.interval
