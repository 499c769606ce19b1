"""Which stretches of a log become readings, and over which time each is averaged.

Where the log numbers its positions there is one reading per number, from the longest time without
change inside it. Otherwise every rest that is long enough is a reading, and every spin of at least
one turn; a table that goes to its next position at a constant rate turns by less.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.diagnose.positions.cells import CELL, Reduced, Source
from foucault.diagnose.positions.rates import bias_across
from foucault.diagnose.positions.shaken import runs_of
from foucault.diagnose.positions.stretches import (
    Steadiness,
    Stretch,
    mean,
    steadiness,
    stretches,
)
from foucault.diagnose.positions.turns import TURN, Window, cells_of, reaches, whole_turns
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.units import plain

OTHER_RATE = 1.2
"""Rates that differ by more than this factor are not the same rate [1]."""

MOST_MOVING = 0.25
"""A numbered position that moves for longer than this part of its time is told [1]."""

SAME = np.radians(2.0)
"""Directions of up in one position differ by less [rad]."""

CREEP = np.radians(1.0)
"""No table moves so slowly from one position to the next [rad/s]."""

ATTEMPT = 0.55
"""A spin of so much of a turn was meant to be one: moves to other positions are shorter [1]."""

PAUSE = 0.3
"""A rest next to a spin, shorter than this part of the longest rest, is only a pause [1]."""

LEFT_OVER = 0.25
"""Parts of a turn larger than this are worth telling; ramps leave less [1]."""


@dataclass(frozen=True)
class Choice:
    """The readings of a log before they are averaged."""

    runs: list[Stretch]  # the time without change that each reading is taken from
    windows: list[Window]  # the time over which each is averaged
    # (n,) which are rests next to a spin in the same position: they may be no more than pauses
    pauses: BoolArray
    findings: tuple[Finding, ...]  # what was left out


def choose(source: Source, data: Reduced, commanded: FloatArray, shortest: float) -> Choice:
    """Choose the rests and spins of a log.

    `source`: gives the blocks of the log [SI]; `commanded` (k,): sizes of the rates that the
    table was told, empty where unknown [rad/s]; `shortest`: shortest rest [s].
    """
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
        raise _short(data, meant[0], windows[meant[0]])
    pauses = np.zeros(len(good), bool)
    if not labelled:
        findings += _creeping(data, short, good)
        good, pauses = _without_pauses(data, good)
    resting = [run for run in good if run.rate == 0]
    _rates_as_told(data, [run for run in good if run.rate != 0], resting, commanded)
    chosen = [windows.get(run) or _rest(data, run) for run in good]
    if labelled:
        findings += _cut(data, good, chosen)
    findings += _unlogged(data, good)
    return Choice(good, chosen, pauses, tuple(findings))


def _unused(
    data: Reduced, how: Steadiness, good: list[Stretch]
) -> tuple[list[tuple[int, int]], list[Finding]]:
    """Name the steady turns of the gyros, of a whole turn or more, that are no reading."""
    cells, lost, out = data.cells, [], []
    rests = [run for run in good if run.rate == 0]
    bias = np.mean([mean(cells, cells.gyro, r) for r in rests], axis=0) if rests else np.zeros(3)
    for a, b in runs_of(how.even):
        run = Stretch(a, b, np.nan)
        used = sum(min(r.last, b) - max(r.first, a) for r in good if r.first < b and r.last > a)
        speed = float(np.linalg.norm(mean(cells, cells.gyro, run) - bias))
        turns = speed * _time(data, run) / TURN
        if turns < 1 or 2 * used > b - a or speed < CREEP:
            continue
        lost.append((a, b))
        words = _words(data, run)
        change = "the accelerometers change meanwhile"
        why = change if "accel" in data.has else "it is no steady turn about the vertical"
        out.append(
            finding(
                "spin.unused", turns=f"{turns:.2f}", start=words["start"], end=words["end"], why=why
            )
        )  # fmt: skip
    return lost, out


def _creeping(data: Reduced, short: list[Stretch], good: list[Stretch]) -> list[Finding]:
    """Name what would be a rest if it did not turn slowly; a move is faster or shorter."""
    longest = max((_time(data, run) for run in good if run.rate == 0), default=0.0)
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
    longest = max((_time(data, run) for run in runs if run.rate == 0), default=0.0)
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


def _time(data: Reduced, run: Stretch) -> float:
    reach = cells_of(data, run)
    return reach.end - reach.start


def _logged(data: Reduced, run: Stretch) -> float:
    """Return how long the samples of a stretch stand for, missing ones not counted [s]."""
    part = slice(run.first, run.last)
    return float(np.sum(data.cells.end[part] - data.cells.start[part]))


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


def _rest(data: Reduced, run: Stretch) -> Window:
    reach = cells_of(data, run)
    return Window(reach.start, reach.end)


def _words(data: Reduced, run: Stretch) -> dict[str, str]:
    cells = data.cells
    label = int(cells.label[run.first])
    zero = float(cells.first[0])
    reach = cells_of(data, run)
    start, end = (f"{max(0.0, t - zero):.1f}" for t in (reach.start, reach.end))
    name = f"Position {label}" if label >= 0 else "The position"
    return {"position": name, "start": start, "end": end}


def _windows(
    source: Source, data: Reduced, spins: list[Stretch], commanded: FloatArray
) -> list[Window]:
    if not spins:
        return []
    inner = [cells_of(data, run) for run in spins]
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


def nearest(rate: float, commanded: FloatArray) -> float | None:
    """Return the commanded rate nearest to a measured one, None where none is like it [rad/s].

    `rate`: rate as measured [rad/s]; `commanded` (k,): sizes of the rates that the table was told
    [rad/s].
    """
    if not len(commanded):
        return None
    ratio = np.abs(np.log(abs(rate) / commanded))
    best = int(np.argmin(ratio))
    return float(commanded[best]) if ratio[best] <= np.log(OTHER_RATE) else None


def _same_rate(data: Reduced, runs: list[Stretch], commanded: FloatArray) -> None:
    """Refuse angles of the table that turn at another rate than the gyros say."""
    spins = [run for run in runs if run.rate != 0]
    if not spins or "outer" not in data.has or "gyro" not in data.has:
        return
    rests = [run for run in runs if run.rate == 0]
    cells = data.cells
    bias = np.mean([mean(cells, cells.gyro, r) for r in rests], axis=0) if rests else np.zeros(3)
    time = np.array([_time(data, run) for run in spins])
    size = np.array([np.linalg.norm(mean(cells, cells.gyro, r) - bias) for r in spins])
    ratio = np.array([abs(run.rate) for run in spins]) / np.maximum(size, 1e-12)
    order = np.argsort(ratio)
    middle = order[np.searchsorted(np.cumsum(time[order]), 0.5 * time.sum())]
    told = abs(spins[middle].rate)
    # Where plan and table agree it is the gyros that are wrong.
    code = "table.rate_differs" if nearest(told, commanded) is None else "spin.rate"
    problem = rate_problem(code, float(ratio[middle]), told, float(size[middle]))
    if problem is not None:
        raise problem


def rate_problem(code: str, ratio: float, told: float, measured: float) -> FoucaultError | None:
    """Name a rate of the table that is not that of the gyros, or return None.

    `code`: what it is where no unit explains it, "table.rate_differs" blames the columns of the
    table, "spin.rate" the gyros; `ratio`: rate of the table over rate of the gyros [1]; `told`,
    `measured`: both rates, for the text [rad/s].
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
    return error(code, **words)


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
            problem = rate_problem("spin.rate", float(told) / size, float(told), size)
            if problem is not None:
                raise problem


def _rates_as_told(
    data: Reduced, spins: list[Stretch], rests: list[Stretch], commanded: FloatArray
) -> None:
    """Refuse spins at another rate than commanded, where only the command tells the turns."""
    if "outer" in data.has or not len(commanded):
        return
    if not spins and {"gyro", "accel"} <= data.has:
        _far_too_slow(data, rests, commanded)
    other = [run for run in spins if nearest(run.rate, commanded) is None]
    if not other:
        return
    run = max(other, key=lambda r: _time(data, r))  # a move is shorter
    told = float(commanded[np.argmin(np.abs(np.log(abs(run.rate) / commanded)))])
    problem = rate_problem("spin.rate", told / abs(run.rate), told, abs(run.rate))
    if problem is not None:
        raise problem


def _short(data: Reduced, run: Stretch, window: Window) -> FoucaultError:
    return error("spin.short", turns=f"{window.whole:.2f}", **_words(data, run))


def _by_label(
    data: Reduced, runs: list[Stretch], shortest: float
) -> tuple[list[Stretch], list[Finding]]:
    """Choose one stretch for each time that a number is given."""
    label = data.cells.label
    edges = np.flatnonzero(np.diff(label, prepend=label[0] - 1, append=label[-1] + 1))
    chosen, findings = [], []
    for a, b in pairwise(edges.tolist()):
        if label[a] < 0:
            continue
        whole = Stretch(a, b, 0.0)
        inside = [run for run in runs if a <= run.first < b]
        spins = [r for r in inside if r.rate != 0 and abs(r.rate) * _time(data, r) > 0.1 * TURN]
        if spins:
            _one_sense(data, whole, spins)
        rests = [r for r in inside if r.rate == 0 and _time(data, r) >= shortest]
        best = max(spins or rests, key=lambda r: _time(data, r), default=None)
        if best is None:
            words = _words(data, whole)
            findings.append(finding("position.moving", used="none of it", **words))
            continue
        chosen.append(best)
        moving = _logged(data, whole) - _time(data, best)
        if data.cells.broken[a + 1 : b].any():  # what is between two gaps need not have moved
            still = [r for r in inside if r.rate == best.rate]
            moving = _logged(data, whole) - sum(_time(data, r) for r in still)
        if best.rate == 0 and moving > max(MOST_MOVING * _time(data, whole), 2 * CELL):
            used = "only {start}-{end} s".format(**_words(data, best))
            findings.append(finding("position.moving", used=used, **_words(data, whole)))
    return chosen, findings


def _one_sense(data: Reduced, whole: Stretch, spins: list[Stretch]) -> None:
    ways = {bool(run.rate > 0) for run in spins}
    if len(ways) > 1:
        first = next(r for r in spins if (r.rate > 0) != (spins[0].rate > 0))
        at = _words(data, first)["start"]
        raise error("spin.both_senses", at=at, **_words(data, whole))


def _cut(data: Reduced, runs: list[Stretch], windows: list[Window]) -> list[Finding]:
    """Tell which numbered spins had a part of a turn more than was used."""
    spins = [w for w in windows if w.turns]
    cut = [w for w in spins if w.whole - w.turns > LEFT_OVER]
    if not cut:
        return []
    which = f"all {len(spins)}" if len(cut) == len(spins) else f"{len(cut)} of {len(spins)}"
    most = max(w.whole - w.turns for w in cut)
    return [finding("spin.cut", which=which, most=f"{most:.2f}")]
