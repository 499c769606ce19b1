"""Cut the log of a north seeker into dwells: one mean per stop of the base, or piece of a turn.

A base that stops is still while its index angle stays within `STILL` for a second; a dwell is as
long as the angle stays so near its median, less the time to settle after a move. A set-up whose
base turned for longer than it stood is cut into pieces of the rotation instead, small enough that
their means lose next to nothing; the means of cosine and sine over each piece are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.rests import resolution
from foucault.errors import Finding, error, finding
from foucault.models.dwells import Dwells
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.tables import IndexedLog
from foucault.units import span

STILL = np.radians(0.1)
"""A base is still while its index angle stays within this [rad]."""

CREEP = np.radians(1.0)
"""A base whose angle changes by more between moves does turn, however slowly [rad]."""

WINDOW = 1.0
"""Time in which a base that turns is seen to turn [s]."""

PIECE = (np.radians(5.0), np.radians(30.0))
"""Smallest and largest piece of a rotation; at 30 deg its mean loses 1.1 % in sd [rad]."""

PIECES = 200
"""Pieces that a rotation is cut into where their size allows it [1]."""

GAP = 1.5
"""A dwell ends where the next sample comes later than so many intervals [1]."""

BLOCK = 1.0
"""Noise is measured by means over so long: shorter ones may be smoothed by the instrument [s]."""


PLACES = ("latitude", "latitude_sd")
"""What of a place a log can say set-up by set-up."""


@dataclass(frozen=True)
class _Cut:
    """A row of dwells: samples first .. last - 1, and whether the base turned."""

    first: int
    last: int
    turning: bool


def find_dwells(log: IndexedLog, *, settle: float = 1.0, shortest: float = 5.0) -> Dwells:
    """Cut a log into dwells.

    `log`: samples, or means, which are dwells already [SI]; `settle`: left out after each move
    [s]; `shortest`: shortest dwell of samples [s]. Returns one row per dwell, set-ups without any
    left out [SI].
    """
    if log.averaged is not None:
        return _as_they_are(log)
    cuts: list[_Cut] = []
    found: list[Finding] = []
    without, longest = [], 0.0
    for number, (first, last) in enumerate(_setups(log)):
        some, seen = _cut(log, first, last, settle, shortest)
        _require_samples(log, some, number)
        cuts += some
        longest = max(longest, seen)
        if not some:
            without.append(log.names[number])
        elif _both_ways(log, some):
            found.append(finding("north.both_ways", setup=log.names[number]))
    if not cuts:
        raise error("north.no_dwell", shortest=span(shortest), longest=span(longest),
                    settle=span(settle), rate=f"{log.rate:.4g}")  # fmt: skip
    if without:
        names = ", ".join(without[:5]) + ", ..." * (len(without) > 5)
        found.append(finding("north.setup_without", count=len(without), names=names,
                             shortest=span(shortest)))  # fmt: skip
    return _numbered(_means(log, cuts), tuple(found))


def _require_samples(log: IndexedLog, cuts: list[_Cut], setup: int) -> None:
    """Refuse means without their length, which would pass for samples of a base that turns."""
    turning = [c for c in cuts if c.turning]
    if turning:
        angle = np.unwrap(log.index[turning[0].first : turning[-1].last])
        step = float(np.median(np.abs(np.diff(angle)))) if len(angle) > 1 else 0.0
        if step > PIECE[1]:
            raise error("north.rows_apart", setup=log.names[setup], step=f"{np.degrees(step):.0f}")


def _setups(log: IndexedLog) -> Iterator[tuple[int, int]]:
    starts = np.flatnonzero(np.diff(log.setup, prepend=-1))
    for first, last in zip(starts, np.append(starts[1:], len(log)), strict=True):
        yield int(first), int(last)


def _as_they_are(log: IndexedLog) -> Dwells:
    assert log.averaged is not None
    return _numbered(
        Dwells(
            log.setup, log.names, log.time, log.averaged, log.index, np.cos(log.index),
            np.sin(log.index), log.gyro, log.accel, _headings(log), **_places(log),
        ),
        (),
    )  # fmt: skip


def _headings(log: IndexedLog) -> FloatArray:
    """Return the mean reference heading of each set-up, NaN where unknown."""
    out = np.full(len(log.names), np.nan)
    if log.heading is not None:
        known = np.isfinite(log.heading)
        turned = np.exp(1j * log.heading[known])
        setup, m = log.setup[known], len(log.names)
        real, imaginary = (np.bincount(setup, x, m) for x in (turned.real, turned.imag))
        there = np.bincount(setup, minlength=m) > 0
        out[there] = np.arctan2(imaginary, real)[there] % (2 * np.pi)
    return out


def _places(log: IndexedLog) -> dict[str, Any]:
    """Return latitude and its sd of each set-up, as far as the log has such columns."""
    out: dict[str, Any] = {}
    for name in PLACES:
        values = getattr(log, name)
        if values is not None:
            out[name] = np.full(len(log.names), np.nan)
            known = np.isfinite(values)
            out[name][log.setup[known]] = values[known]
    return out


def _numbered(dwells: Dwells, findings: tuple[Finding, ...]) -> Dwells:
    """Leave out set-ups without a row."""
    used, setup = np.unique(dwells.setup, return_inverse=True)
    return replace(
        dwells,
        setup=setup.astype(np.int64),
        names=tuple(dwells.names[i] for i in used),
        heading=dwells.heading[used],
        **{k: getattr(dwells, k)[used] for k in PLACES if getattr(dwells, k) is not None},
        findings=findings,
    )


# -- one set-up ----------------------------------------------------------------------------


def _cut(
    log: IndexedLog, first: int, last: int, settle: float, shortest: float
) -> tuple[list[_Cut], float]:
    """Return the cuts of one set-up, and its longest stop [s]."""
    time, dt = log.time[first:last], log.interval
    if len(time) < 2:
        return [], 0.0
    angle = np.unwrap(log.index[first:last])
    breaks = np.flatnonzero(np.diff(time) > GAP * dt) + 1
    moving = _moving(angle, max(1, round(WINDOW / dt)))
    for a, b in _runs(~moving, breaks):  # what creeps too slowly for the window
        moving[a:b] |= np.ptp(angle[a:b]) > CREEP
    stops: list[tuple[int, int]] = []
    turns: list[tuple[int, int]] = []
    for a, b in _runs(~moving, breaks):
        a, b = _widened(angle, a, b, breaks)
        if stops:
            a = max(a, stops[-1][1])
        if a > 0 and a not in breaks:
            a = int(np.searchsorted(time, time[a] + settle))
        if b > a:
            stops.append((a, b))
    for run in _runs(moving, breaks):
        turns += [(a, b) for a, b in _one_way(angle, *run) if (b - a) * dt >= shortest]
    seen = max(((b - a) * dt for a, b in stops), default=0.0)
    # Half an interval short is rounding of the samples.
    stops = [(a, b) for a, b in stops if (b - a + 0.5) * dt >= shortest]
    if sum(b - a for a, b in turns) > sum(b - a for a, b in stops):
        cuts = [c for a, b in turns for c in _pieces(angle, a, b, sum(_path(angle, turns)))]
    else:
        cuts = [_Cut(a, b, False) for a, b in stops]
    return [_Cut(first + c.first, first + c.last, c.turning) for c in cuts], seen


def _moving(angle: FloatArray, k: int) -> npt.NDArray[np.bool_]:
    """Tell the samples, shape (n,), within a window of k steps over which the angle changes."""
    n = len(angle)
    k = min(k, n - 1)
    far = np.abs(angle[k:] - angle[:-k]) > STILL
    edges = np.zeros(n + 1, np.int64)
    np.add.at(edges, np.flatnonzero(far), 1)
    np.add.at(edges, np.flatnonzero(far) + k + 1, -1)
    return np.asarray(np.cumsum(edges[:-1]) > 0)


def _runs(wanted: npt.NDArray[np.bool_], breaks: IntArray) -> list[tuple[int, int]]:
    """Return first and last + 1 of the runs of samples that are wanted, cut at the breaks."""
    step = np.diff(np.concatenate(([0], wanted.astype(np.int8), [0])))
    out = []
    for a, b in zip(np.flatnonzero(step == 1), np.flatnonzero(step == -1), strict=True):
        inside = breaks[(breaks > a) & (breaks < b)]
        edges = [int(a), *(int(i) for i in inside), int(b)]
        out += list(pairwise(edges))
    return out


def _widened(angle: FloatArray, a: int, b: int, breaks: IntArray) -> tuple[int, int]:
    """Take in what a window has hidden: samples beside the run at the same angle."""
    middle = float(np.median(angle[a:b]))
    before = breaks[breaks <= a]
    after = breaks[breaks >= b]
    low = int(before[-1]) if len(before) else 0
    high = int(after[0]) if len(after) else len(angle)
    off = np.flatnonzero(np.abs(angle[low:a] - middle) > STILL)
    a = low + (int(off[-1]) + 1 if len(off) else 0)
    off = np.flatnonzero(np.abs(angle[b:high] - middle) > STILL)
    return a, b + int(off[0]) if len(off) else high


def _one_way(angle: FloatArray, a: int, b: int) -> list[tuple[int, int]]:
    """Cut a run where the base turns back."""
    part = angle[a:b]
    low, high = sorted((float(part[0]), float(part[-1])))
    for k, beyond in ((int(part.argmax()), part.max() - high), (int(part.argmin()),
                                                               low - part.min())):  # fmt: skip
        if beyond > CREEP and 0 < k < len(part) - 1:
            return _one_way(angle, a, a + k) + _one_way(angle, a + k, b)
    return [(a, b)]


def _path(angle: FloatArray, runs: list[tuple[int, int]]) -> list[float]:
    return [abs(float(angle[b - 1] - angle[a])) for a, b in runs]


def _pieces(angle: FloatArray, a: int, b: int, whole: float) -> list[_Cut]:
    """Cut a rotation of which all that is like it covers the angle `whole` [rad]."""
    size = float(np.clip(whole / PIECES, *PIECE))
    count = max(1, round(abs(float(angle[b - 1] - angle[a])) / size))
    edges = np.unique(np.rint(np.linspace(a, b, count + 1)).astype(np.int64))
    return [_Cut(int(i), int(j), True) for i, j in pairwise(edges)]


def _both_ways(log: IndexedLog, cuts: list[_Cut]) -> bool:
    """Tell whether the base turned in both senses while it was measured."""
    if not cuts[0].turning:
        return False
    angle = np.unwrap(log.index[cuts[0].first : cuts[-1].last])
    start = cuts[0].first
    change = np.array([angle[c.last - 1 - start] - angle[c.first - start] for c in cuts])
    return bool((change > STILL).any() and (change < -STILL).any())


# -- means ---------------------------------------------------------------------------------


def _means(log: IndexedLog, cuts: list[_Cut]) -> Dwells:
    first = np.array([c.first for c in cuts])
    last = np.array([c.last for c in cuts])
    count = (last - first).astype(float)
    middle = (first + last - 1) // 2
    cosine, sine = (_mean(x, first, last) for x in (np.cos(log.index), np.sin(log.index)))
    turning = np.array([c.turning for c in cuts])
    index = np.where(~turning, np.arctan2(sine, cosine) % (2 * np.pi), log.index[middle])
    return Dwells(
        log.setup[first], log.names, log.time[first], count * log.interval, index, cosine, sine,
        _mean(log.gyro, first, last),
        None if log.accel is None else _mean(log.accel, first, last),
        _headings(log), log.interval, turning=turning, **_places(log),
    )  # fmt: skip


def _mean(x: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    # One by one: sums of a long log from its start would lose digits.
    return np.array([x[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)])


# -- noise ---------------------------------------------------------------------------------


UNSTIRRED = 1e-6
"""Noise of a signal that never leaves a step, in steps: next to none [1]."""

SPIKE = 6.0
"""A difference of successive means larger than this is no noise [sd]."""


def measured_noise(log: IndexedLog, dwells: Dwells) -> ImuNoise | None:
    """Measure the white noise of a log by differences of successive means within its dwells.

    ``white^2 = var(x_k+1 - x_k) tau / 2`` with means over `tau` of a second or so, what the
    index angle makes of them taken off before.

    `log`: the log [SI]; `dwells`: what it was cut into [SI]. Returns white noise of gyro and
    accelerometers [SI]; None for a log of means, or where the dwells are too short to tell.
    """
    if log.averaged is not None:
        return None
    dt = log.interval
    block = max(1, round(BLOCK / dt))
    if dwells.turning is None or not dwells.turning.any():
        block = max(1, min(block, int(np.median(dwells.time) / dt) // 4))
    blocks = [x for d in range(len(dwells.names)) for x in _blocks(log, dwells, d, block)]
    steps = [np.diff(x, axis=0) for x in blocks if len(x) > 1]
    if sum(len(x) for x in steps) < 10:
        return None
    size = _without_spikes(np.concatenate(steps)) * np.sqrt(block * dt / 2)
    columns = [log.gyro] if log.accel is None else [log.gyro, *log.accel.T]
    step = np.array([resolution(x) for x in columns])
    # Rounding that the noise does not stir leaves a constant error in every dwell; a signal that
    # never leaves a step says nothing of its noise: then it is taken for still.
    stirred = size / np.sqrt(dt) > step / 2
    white = np.where(stirred, np.maximum(size, step * np.sqrt(dt / 12)), UNSTIRRED * step)
    coarse = np.where(stirred, 0.0, step)
    gyro = TriadNoise(float(white[0]), quantisation=float(coarse[0]))
    if log.accel is None:
        return ImuNoise(gyro=gyro)
    accel = float(np.sqrt(np.mean(white[1:] ** 2)))
    return ImuNoise(TriadNoise(accel, quantisation=float(coarse[1:].max())), gyro)


def _without_spikes(x: FloatArray) -> FloatArray:
    """Return the root mean square of each column, without what no noise gives."""
    robust = np.median(np.abs(x), axis=0) / 0.6745
    # A coarse signal hardly ever moves: its median is zero, and nothing is left out.
    limit = np.where(robust > 0, SPIKE * robust, np.inf)
    kept = np.abs(x) <= limit
    return np.asarray(np.sqrt(np.sum(np.where(kept, x, 0.0) ** 2, axis=0) / kept.sum(axis=0)))


def _blocks(log: IndexedLog, dwells: Dwells, setup: int, block: int) -> list[FloatArray]:
    """Return means over blocks of samples, without what the index angle explains, by dwell."""
    of = dwells.of(setup)
    if not len(of):
        return []
    number = log.names.index(dwells.names[setup])
    lo, hi = np.searchsorted(log.setup, [number, number + 1])
    time = log.time[lo:hi]
    first = lo + np.searchsorted(time, of.start)
    last = first + np.rint(of.time / log.interval).astype(np.int64)
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    x = log.gyro[:, None] if log.accel is None else np.column_stack([log.gyro, log.accel])
    angle = log.index[rows]
    A = np.column_stack([np.ones(len(rows)), np.cos(angle), np.sin(angle)])
    left = x[rows] - A @ np.linalg.lstsq(A, x[rows], rcond=None)[0]
    if (
        of.turning is not None and of.turning.any()
    ):  # pieces follow one another: the blocks may pass from one to the next
        edges = np.flatnonzero(np.diff(rows) > 1) + 1
    else:
        edges = np.cumsum(last - first)[:-1]
    out = []
    for part in np.split(left, edges):
        count = len(part) // block
        out.append(part[: count * block].reshape(count, block, -1).mean(axis=1))
    return out
