"""Cut the log of a north seeker into dwells: one mean per stop of the base, or piece of a turn.

A base that stops is still while its index angle stays within `STILL` for a second; a dwell is as
long as the angle stays so near its median, less the time to settle after a move. A set-up whose
base turned for longer than it stood is cut into pieces of the rotation instead, small enough that
their means lose next to nothing; the means of cosine and sine over each piece are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, begins, chosen, repeating
from foucault.detect.noise import resolution
from foucault.detect.stretches import means_of, runs
from foucault.errors import Finding, error, finding
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import Dwells
from foucault.tables import IndexedLog, gaps
from foucault.units import span

STILL = np.radians(0.1)  # A base is still while its index angle stays within this [rad].

CREEP = np.radians(1.0)
"""A base whose angle changes by more between moves does turn, however slowly [rad]."""

WINDOW = 1.0  # Time in which a base that turns is seen to turn [s].

PIECE = (np.radians(5.0), np.radians(30.0))
"""Smallest and largest piece of a rotation; at 30 deg its mean loses 1.1 % in sd [rad]."""

PIECES = 200  # Pieces that a rotation is cut into where their size allows it [1].

BLOCK = 1.0
"""Noise is measured by means over so long: shorter ones may be smoothed by the instrument [s]."""


PLACES = ("latitude", "latitude_sd")  # What of a place a log can say set-up by set-up.


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
        part = repeating(log.index, len(log.names))
        times = len(log.index) // max(len(part), 1)
        cosine, sine = np.tile(np.cos(part), times), np.tile(np.sin(part), times)
        index, rows = (log.index, cosine, sine), (log.gyro, log.accel)
        return _numbered(Dwells(log.setup, log.names, log.time, log.averaged, *index, *rows,
                                _headings(log), **_places(log)))  # fmt: skip
    cuts: list[_Cut] = []
    found: list[Finding] = []
    without, longest = [], 0.0
    starts = np.flatnonzero(np.diff(log.setup, prepend=-1)).tolist()
    for number, (first, last) in enumerate(pairwise([*starts, len(log)])):
        some, seen = _cut(log, first, last, settle, shortest)
        cuts += some
        longest = max(longest, seen)
        if not some:
            without.append(log.names[number])
        elif some[0].turning:
            angle = np.unwrap(log.index[some[0].first : some[-1].last])
            step = float(np.median(np.abs(np.diff(angle)))) if len(angle) > 1 else 0.0
            if step > PIECE[1]:  # means without their length would pass for samples of a base
                raise error("north.rows_apart", setup=log.names[number],
                            step=f"{np.degrees(step):.0f}")  # fmt: skip
            ends = np.array([[c.first, c.last - 1] for c in some]) - some[0].first
            change = angle[ends[:, 1]] - angle[ends[:, 0]]
            if (change > STILL).any() and (change < -STILL).any():
                found.append(finding("north.both_ways", setup=log.names[number]))
    if not cuts:
        raise error("north.no_dwell", shortest=span(shortest), longest=span(longest),
                    settle=span(settle), rate=f"{log.rate:.4g}")  # fmt: skip
    if without:
        names = ", ".join(without[:5]) + ", ..." * (len(without) > 5)
        found.append(finding("north.setup_without", count=len(without), names=names,
                             shortest=span(shortest)))  # fmt: skip
    return _numbered(_means(log, cuts), tuple(found))


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


def _numbered(dwells: Dwells, findings: tuple[Finding, ...] = ()) -> Dwells:
    """Leave out set-ups without a row."""
    new = begins(dwells.setup)
    used = dwells.setup[new]
    if len(used) == len(dwells.names):
        return replace(dwells, findings=findings)
    return replace(
        dwells,
        setup=np.cumsum(new) - 1,
        names=chosen(dwells.names, used),
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
    linked = ~gaps(np.diff(time))
    moving = _moving(angle, max(1, round(WINDOW / dt)))
    for a, b in _runs(~moving, linked):  # what creeps too slowly for the window
        moving[a:b] |= np.ptp(angle[a:b]) > CREEP
    stops: list[tuple[int, int]] = []
    turns: list[tuple[int, int]] = []
    for a, b in _runs(~moving, linked):
        a, b = _widened(angle, a, b, linked)
        if stops:
            a = max(a, stops[-1][1])
        if a > 0 and linked[a - 1]:
            a = int(np.searchsorted(time, time[a] + settle))
        if b > a:
            stops.append((a, b))
    for run in _runs(moving, linked):
        turns += [(a, b) for a, b in _one_way(angle, *run) if (b - a) * dt >= shortest]
    seen = max(((b - a) * dt for a, b in stops), default=0.0)
    # Half an interval short is rounding of the samples.
    stops = [(a, b) for a, b in stops if (b - a + 0.5) * dt >= shortest]
    if sum(b - a for a, b in turns) > sum(b - a for a, b in stops):
        whole = sum(abs(float(angle[b - 1] - angle[a])) for a, b in turns)
        size = float(np.clip(whole / PIECES, *PIECE))
        cuts = [c for a, b in turns for c in _pieces(angle, a, b, size)]
    else:
        cuts = [_Cut(a, b, False) for a, b in stops]
    return [_Cut(first + c.first, first + c.last, c.turning) for c in cuts], seen


def _runs(wanted: BoolArray, linked: BoolArray) -> list[tuple[int, int]]:
    """Return first and last + 1 of the runs of samples that are wanted, parted by gaps."""
    first, last = runs(wanted, 1, linked)
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _moving(angle: FloatArray, k: int) -> BoolArray:
    """Tell the samples, shape (n,), within a window of k steps over which the angle changes."""
    n = len(angle)
    k = min(k, n - 1)
    far = np.abs(angle[k:] - angle[:-k]) > STILL
    edges = np.zeros(n + 1, np.int64)
    np.add.at(edges, np.flatnonzero(far), 1)
    np.add.at(edges, np.flatnonzero(far) + k + 1, -1)
    return np.asarray(np.cumsum(edges[:-1]) > 0)


def _widened(angle: FloatArray, a: int, b: int, linked: BoolArray) -> tuple[int, int]:
    """Take in what a window has hidden: samples beside the run at the same angle."""
    near = np.abs(angle - np.median(angle[a:b])) <= STILL
    while a > 0 and linked[a - 1] and near[a - 1]:
        a -= 1
    while b < len(angle) and linked[b - 1] and near[b]:
        b += 1
    return a, b


def _one_way(angle: FloatArray, a: int, b: int) -> list[tuple[int, int]]:
    """Cut a run where the base turns back."""
    part = angle[a:b]
    low, high = sorted((float(part[0]), float(part[-1])))
    for k, beyond in ((int(part.argmax()), part.max() - high), (int(part.argmin()),
                                                               low - part.min())):  # fmt: skip
        if beyond > CREEP and 0 < k < len(part) - 1:
            return _one_way(angle, a, a + k) + _one_way(angle, a + k, b)
    return [(a, b)]


def _pieces(angle: FloatArray, a: int, b: int, size: float) -> list[_Cut]:
    """Cut a rotation into pieces of about a `size` [rad]."""
    count = max(1, round(abs(float(angle[b - 1] - angle[a])) / size))
    edges = np.unique(np.rint(np.linspace(a, b, count + 1)).astype(np.int64))
    return [_Cut(int(i), int(j), True) for i, j in pairwise(edges)]


# -- means ---------------------------------------------------------------------------------


def _means(log: IndexedLog, cuts: list[_Cut]) -> Dwells:
    first = np.array([c.first for c in cuts])
    last = np.array([c.last for c in cuts])
    count = (last - first).astype(float)
    middle = (first + last - 1) // 2

    spans = [(c.first, c.last) for c in cuts]
    cosine, sine = (means_of(x, spans) for x in (np.cos(log.index), np.sin(log.index)))
    turning = np.array([c.turning for c in cuts])
    index = np.where(~turning, np.arctan2(sine, cosine) % (2 * np.pi), log.index[middle])
    return Dwells(
        log.setup[first], log.names, log.time[first], count * log.interval, index, cosine, sine,
        means_of(log.gyro, spans),
        None if log.accel is None else means_of(log.accel, spans),
        _headings(log), log.interval, turning=turning, **_places(log),
    )  # fmt: skip


# -- noise ---------------------------------------------------------------------------------


UNSTIRRED = 1e-6  # Noise of a signal that never leaves a step, in steps: next to none [1].
SPIKE = 6.0  # A difference of successive means larger than this is no noise [sd].


def measured_noise(log: IndexedLog, dwells: Dwells) -> ImuNoise | None:
    """Measure the white noise of a log by differences of successive means within its dwells.

    ``white^2 = var(x_k+1 - x_k) tau / 2`` with means over `tau` of a second or so, what the index
    angle makes of them taken off before.

    `dwells`: what it was cut into [SI]. Returns white noise of gyro and accelerometers [SI]; None
    for a log of means, or where the dwells are too short to tell.
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
