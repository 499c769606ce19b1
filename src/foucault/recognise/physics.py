"""What columns of numbers say of themselves: which rest, which turn gravity, in which unit.

A log is cut into short blocks. Where nothing moves, the means of accelerometers lie on a sphere
about their zero, ``|m - c| = r``, and those of gyros all at one place, their bias. In between the
direction of gravity turns in the body as the gyros say, ``du/dt = u x M y``: a least-squares fit
of M over the log gives order, signs and scale of the gyros' columns y, and integrating them from
rest to rest proves it. All this holds up to a rotation common to both triads, and up to their
mirror image; and ``f`` may be gravity instead of specific force.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect.steady import Spin, find_spins, frequency
from foucault.detect.stretches import runs, split
from foucault.guard.mistakes import exchanges
from foucault.kernels.rotation import integrate_turns
from foucault.tables import Log

BLOCKS = 6_000
"""A long log is cut into no more blocks [1]."""

LEAST = 8
"""Samples of a block at least [1]."""

MOVED = 3
"""Columns that a turn moves [1]."""

RESTS_LIKE = 0.12
"""Means of a gyro's column at rest scatter by less than this part of all its readings [1]."""

NORM = 0.06
"""Norms of accelerometers at rest scatter by less than this part of themselves [1]."""

PROVED = np.radians(6.0)
"""Gyros that predict gravity within this have order, signs and scale that are right, rms [rad]."""

APART = 3.0
"""The next best order of columns misses by so many times as much, or it is not told [1]."""

SURELY = np.radians(1.0)
"""What fits within this is not told from what fits better, rms [rad]."""

SHAKEN, ON_THE_WAY = np.radians(2.0), np.radians(25.0)
"""While it is turned, gravity is told so badly by accelerometers at least, and at most [rad]."""

SPUN = 0.02
"""Part of the way that is turned by which gyros before their calibration may miss it [1]."""

MOST_TURNS = 60
"""Turns that are looked at [1]."""

TELL = 5.0
"""Sd by which gravity turns with what gyros read, or it does not [1]."""

FEWEST = 12
"""Blocks in which gravity turns, to tell by which gyros [1]."""

SHOWS = 0.02
"""Turn of gravity from one block to the next that is no noise [rad]."""

TURNED = np.radians(8.0)
"""Rests whose gravity differs by less do not tell a turn [rad]."""

FASTEST, SLOWEST = 100.0, 2.0
"""Rates of the fastest sample and of the slowest spin, of a made-up scale, for samples of a made-up
interval of a hundredth [1]."""

ASLANT = 0.2
"""Gravity turns in a spin if so much of it does, which is the sine of the tilt of its axis [1]."""

INSTANTS = 6
"""Of each spin that are looked at, each with the one a quarter of a turn later [1]."""


@dataclass(frozen=True)
class Blocks:
    """Short pieces of a log: the mean and the scatter of each column in each."""

    size: int  # samples of a block [1]
    mean: FloatArray  # (b, k) [raw]
    sd: FloatArray  # (b, k) [raw]
    quiet: BoolArray  # (b,) whether nothing moves
    rests: tuple[IntArray, IntArray]  # first block of each rest, and the one after [1]

    def of_rests(self, columns: Sequence[int]) -> FloatArray:
        """Return the mean of `columns` over each rest, (r, k) [raw]."""
        pairs = zip(*self.rests, strict=True)
        return np.array([self.mean[a:b][:, list(columns)].mean(axis=0) for a, b in pairs])


def blocks(x: FloatArray, active: Sequence[int]) -> Blocks:
    """Cut readings `x` (n, k) [raw] into blocks and find the quiet ones.

    `active`: columns that motion changes [1].
    """
    size = max(LEAST, len(x) // BLOCKS)
    if len(x) < 40 * size:
        size = max(2, len(x) // 40)
    count = len(x) // size
    cut = x[: count * size].reshape(count, size, -1)
    mean, sd = cut.mean(axis=1), cut.std(axis=1)
    level = _levels(sd, active)
    quiet = level < split(level)
    quiet[:-1] &= (still := ~_jumps(mean, sd, active))
    quiet[1:] &= still
    first, last = runs(quiet, 3)
    # A rest that turns steadily is quiet, and no rest: the caller sees it by the means.
    return Blocks(size, mean, sd, quiet, (first + 1, last - 1))


def _jumps(mean: FloatArray, sd: FloatArray, active: Sequence[int]) -> BoolArray:
    """Tell where one rest ends and another begins without a move, as where a file was cut, (b-1,).

    `mean`, `sd` (b, k): of each block [raw].
    """
    columns = list(active)
    least = np.maximum(6.0 * np.median(sd[:, columns], axis=0), 0.1 * np.ptp(mean[:, columns], 0))
    return np.asarray((np.abs(np.diff(mean[:, columns], axis=0)) > least).any(axis=1))


def _levels(sd: FloatArray, active: Sequence[int]) -> FloatArray:
    """Return how much moves in each block, 1 where nothing does, (b,) [1]."""
    logs = []
    for c in active:
        seen = sd[:, c][sd[:, c] > 0]
        if len(seen) < 0.2 * len(sd):
            continue
        quiet = float(np.percentile(seen, 10))
        logs.append(np.log(np.maximum(sd[:, c], 0.3 * quiet) / quiet))
    if not logs:
        return np.ones(len(sd))
    # A turn moves gravity along two axes and turns a third; which, differs from turn to turn, and
    # columns that motion does not change, such as temperatures, say nothing.
    return np.asarray(np.exp(np.mean(np.sort(logs, axis=0)[-MOVED:], axis=0)))


@dataclass(frozen=True)
class Sphere:
    """Three columns whose readings at rest have one length."""

    columns: tuple[int, int, int]  # their numbers [1]
    centre: FloatArray  # (3,) [raw]
    radius: float  # [raw]
    scatter: float  # of the length, part of it [1]
    spread: float  # of the directions: 0 for one, 1 for all [1]


def sphere(m: FloatArray, columns: Sequence[int]) -> Sphere | None:
    """Fit a sphere to means at rest `m` (r, 3) [raw] of `columns` (3,) [1]; None where none is."""
    if not len(m):
        return None
    found = [_about(m, np.zeros(3))]
    if len(m) >= 5:
        A = np.column_stack([2 * m, np.ones(len(m))])
        scale = np.abs(m).max() or 1.0
        solved, _, rank, sv = np.linalg.lstsq(A / [scale, scale, scale, 1.0], (m**2).sum(axis=1),
                                              rcond=1e-9)  # fmt: skip
        if rank == 4 and sv[-1] > 1e-3 * sv[0] / 10:
            found.append(_about(m, solved[:3] / scale))
    at_zero, *fitted = found
    best = at_zero
    # A zero that is not nought explains counts about the middle of a converter.
    if (
        fitted
        and fitted[0][2] < 0.3 * at_zero[2]
        and (at_zero[2] > 0.02 or np.linalg.norm(fitted[0][0]) < 0.3 * fitted[0][1])
    ):
        best = fitted[0]
    centre, radius, scatter = best
    if not radius > 0:
        return None
    u = (m - centre) / radius
    spread = float(np.sqrt(max(0.0, 1.0 - float(np.linalg.norm(u.mean(axis=0))) ** 2)))
    a, b, c = (int(i) for i in columns)
    return Sphere((a, b, c), centre, radius, scatter, spread)


def _about(m: FloatArray, centre: FloatArray) -> tuple[FloatArray, float, float]:
    norm = np.linalg.norm(m - centre, axis=1)
    radius = float(np.median(norm))
    return centre, radius, float(np.sqrt(np.mean((norm - radius) ** 2)) / radius) if radius else 1.0


def rest_scatter(x: FloatArray, cut: Blocks, part: float = 50.0) -> FloatArray:
    """Return how much the means at rest of each column scatter, part of all its scatter, (k,).

    `x` (n, k): readings [raw]; `part`: percentile of the rests that do [1]; the median does not
    see a few that spin.
    """
    if len(cut.rests[0]) < 2:
        return np.full(x.shape[1], np.nan)
    means = cut.of_rests(range(x.shape[1]))
    middle = np.median(means, axis=0)
    whole = np.sqrt(np.mean((x - middle) ** 2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.percentile(np.abs(means - middle), part, axis=0) * 1.5 / whole)


def spheres(cut: Blocks, columns: Sequence[int], most: int = 14) -> list[Sphere]:
    """Return the triples of `columns` (k,) [1] whose length is one at rest, the best first.

    `most`: of the columns are tried [1].
    """
    found = []
    columns = list(columns)[:most]
    for three in combinations(columns, 3):
        one = sphere(cut.of_rests(three), three)
        if one is not None and one.scatter < NORM and one.spread > 0.05:
            found.append(one)
    return sorted(found, key=lambda s: s.scatter)


# -- gyros against gravity -----------------------------------------------------------------------


@dataclass(frozen=True)
class Turns:
    """What turns between rests say of three columns of gyros, given those of accelerometers."""

    exchange: FloatArray  # (3, 3) signed permutation: column -> axis of the accelerometers [1]
    scale: float  # of a column's unit times that of time [rad/raw]
    miss: float  # of the direction of gravity after a turn, rms [rad]
    other: float  # the same of the next best order or sign [rad]
    turns: int  # that tell [1]
    bias: FloatArray  # (3,) columns at rest [raw]
    fitting: tuple[FloatArray, ...]  # signed permutations that fit, the best first [1]

    @property
    def proved(self) -> bool:
        """Whether order and signs are told."""
        return bool(self.fits and len(self.fitting) == 1 and self.turns >= 3)

    @property
    def fits(self) -> bool:
        """Whether these columns can be gyros at all."""
        return bool(self.miss < PROVED)


def turns(x: FloatArray, time: FloatArray, cut: Blocks, accel: Sphere,
          gyro: Sequence[int], *, summed: bool = False) -> Turns | None:  # fmt: skip
    """Fit columns of gyros to how gravity turns; None where nothing turns.

    `x` (n, k): readings [raw]; `time` (n,): of each [raw]; `gyro` (3,): columns [1]; `summed`:
    they are sums over the interval before, and `time` counts samples.
    """
    y = np.ascontiguousarray(x[:, list(gyro)])
    bias = np.median(cut.of_rests(gyro), axis=0) if len(cut.rests[0]) else np.zeros(3)
    found = _between_rests(x, time, cut, accel, y - bias, bias, summed)
    if found is not None and found.proved:
        return found
    spun = _in_spins(x, time, accel, y - bias, bias, summed)
    if spun is None or not spun.fits:
        return found
    if found is None or not found.fits:
        return spun
    both = tuple(E for E in found.fitting if any(np.array_equal(E, S) for S in spun.fitting))
    return replace(found, exchange=both[0], fitting=both) if both else found


def _between_rests(
    x: FloatArray, time: FloatArray, cut: Blocks, accel: Sphere, y: FloatArray, bias: FloatArray,
    summed: bool,
) -> Turns | None:  # fmt: skip
    """Fit gyros to how gravity turns from one rest to the next; `y` (n, 3): without bias [raw]."""
    first, last = cut.rests
    if len(first) < 2:
        return None
    up = _unit(cut.of_rests(accel.columns) - accel.centre)
    seed = _seed(x, time, cut, accel, y)
    if seed is None:
        return None
    begin = (last[:-1] * cut.size - cut.size // 2).astype(np.int64)
    end = np.minimum(first[1:] * cut.size + cut.size // 2, len(x) - 1).astype(np.int64)
    told = np.arccos(np.clip(np.sum(up[:-1] * up[1:], axis=1), -1, 1)) > TURNED
    # A gap, or a turn by table time, of a clock that stood.
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    whole = np.array([np.all((d := steps[a:b]) >= 0) and d.max(initial=0.0) < 20 * usual
                      for a, b in zip(begin, end, strict=True)])  # fmt: skip
    told &= whole
    if not told.any():
        return None
    few = np.flatnonzero(told)[:MOST_TURNS]
    work = _Work(time, y, up[few], up[few + 1], begin[few], end[few], summed)
    found = work.fitted(seed, len(few), bias)
    if len(found.fitting) > 1:
        some = np.flatnonzero(whole)[:MOST_TURNS]
        way = _way(x, time, y, accel, up[some], begin[some], end[some], summed)
        fitting = found.fitting if way is None else way.likely(found.fitting, found.scale)
        found = replace(found, exchange=fitting[0], fitting=fitting)
    return found


def _in_spins(
    x: FloatArray, time: FloatArray, accel: Sphere, y: FloatArray, bias: FloatArray, summed: bool
) -> Turns | None:
    """Fit gyros to how gravity turns while they turn steadily; None where none does.

    ``df/dt = -w x (f - c)``, and what stays, c, is the mean over whole turns: bias, lever arm and
    what of gravity is along the axis. How fast it turns the accelerometers tell by themselves.
    """
    before, after, starts, stops, sizes, many = [], [], [], [], [], 0
    for spin, begin in steady_spins(x, accel.columns, y):
        f = spin.readings[:, :3]
        round_ = 2 * np.pi / (frequency(spin) * spin.step)  # readings of a turn
        whole = int(len(f) // round_ * round_)
        if round_ < 8 or whole < round_:
            continue
        v = _moving(f - f[:whole].mean(axis=0), max(1, int(round_ / 20)))
        length = np.linalg.norm(v, axis=1)
        quarter = round(round_ / 4)
        if np.median(length) < ASLANT * accel.radius:
            continue
        many += 1
        row = begin + spin.many // 2
        step = (time[row + (len(f) - 1) * spin.many] - time[row]) / ((len(f) - 1) * spin.many)
        size = np.linalg.norm(spin.readings[:, 3:].mean(axis=0)) * (1.0 if summed else step)
        sizes.append(2 * np.pi / (round_ * spin.many) / size)
        for a in np.linspace(quarter, len(f) - 2 * quarter - 1, INSTANTS).astype(int).tolist():
            before.append(v[a] / length[a])
            after.append(v[a + quarter] / length[a + quarter])
            starts.append(row + a * spin.many)
            stops.append(row + (a + quarter) * spin.many)
    if not starts:
        return None
    first, last = np.array(starts, np.int64), np.array(stops, np.int64)
    work = _Work(time, y, np.array(before), np.array(after), first, last, summed)
    return work.fitted(float(np.median(sizes)), many, bias)


def steady_spins(x: FloatArray, accel: Sequence[int], y: FloatArray) -> Iterator[tuple[Spin, int]]:
    """Yield what turns steadily, no more than are looked at, and the first row of each.

    `x` (n, k): readings [raw]; `accel` (3,): columns [1]; `y` (n, 3): gyros without bias [raw].
    """
    fastest = float(np.percentile(np.linalg.norm(y, axis=1), 99.5))
    if not fastest > 0:
        return
    even, scale = np.asarray(0.01 * np.arange(len(y)), float), FASTEST / fastest
    found = find_spins(Log(time=even, accel=x[:, list(accel)], gyro=scale * y), 0.5, SLOWEST)
    for spin in found[:: max(1, len(found) // (MOST_TURNS // INSTANTS))]:
        readings = spin.readings / np.repeat([1.0, scale], 3)
        yield replace(spin, readings=readings), round(spin.time[0] / 0.01 - (spin.many - 1) / 2)


def _moving(v: FloatArray, width: int) -> FloatArray:
    """Return the mean of `v` (n, 3) over `width` readings about each, an odd number of them."""
    half = width // 2
    total = np.cumsum(np.pad(v, ((half + 1, half), (0, 0)), mode="edge"), axis=0)
    return np.asarray((total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1))


@dataclass
class _Work:
    """Turns between rests, integrated once for all orders of columns of one scale and sense."""

    time: FloatArray
    y: FloatArray
    before: FloatArray  # (t, 3) up at the rest before [1]
    after: FloatArray
    first: IntArray
    last: IntArray
    summed: bool

    def fitted(self, seed: float, many: int, bias: FloatArray) -> Turns:
        """Return what `many` turns say, with a scale about `seed` [rad/raw]."""
        start = self.best_scale(seed)
        scale, miss = self.refined(self.ranked(start)[0][1], start)
        ranked = self.ranked(scale)
        fitting = tuple(E for off, E in ranked if off < max(APART * miss, SURELY))
        return Turns(fitting[0], scale, miss, ranked[1][0], many, bias, fitting)

    def likely(self, tried: tuple[FloatArray, ...], scale: float) -> tuple[FloatArray, ...]:
        """Return those of several signed orders of the columns that fit much as the best does."""
        turned = {sense: self.rotations(sense * scale) for sense in (1.0, -1.0)}
        senses = [float(np.sign(np.linalg.det(E))) for E in tried]
        missed = [
            self.miss(turned[sense], sense * E, shaken=True)
            for sense, E in zip(senses, tried, strict=True)
        ]
        least = min(missed)
        kept = sorted((off, i) for i, off in enumerate(missed) if off < 1.6 * least + SHAKEN)
        return tuple(tried[i] for _, i in kept) if least < ON_THE_WAY else tried

    def rotations(self, scale: float) -> FloatArray:
        w, zero, none = np.ascontiguousarray(scale * self.y), np.zeros((3, 3)), np.empty((0, 3))
        C, *_ = integrate_turns(self.time, w, none, zero, self.first, self.last, self.summed)
        return np.asarray(C)

    def miss(self, C: FloatArray, E: FloatArray, *, shaken: bool = False) -> float:
        return float(self._misses(C, E[None], shaken=shaken)[0])

    def _misses(self, C: FloatArray, E: FloatArray, *, shaken: bool = False) -> FloatArray:
        """Return how much each of the orders E (k, 3, 3) misses, shape (k,)."""
        predicted = np.einsum("nji,knj->kni", C, self.before @ E) @ np.swapaxes(E, 1, 2)
        angle = np.arccos(np.clip(np.sum(predicted * self.after, axis=2), -1, 1))
        if shaken:  # where one turn in five tells the sign of an axis
            return np.asarray(np.mean(angle, axis=1))
        if (n := angle.shape[1]) > 4:
            # One in five may be spoiled; more may not, for few turns tell the sign of an axis.
            worst = n - 1 - n // 5
            return np.asarray(np.partition(angle, worst, axis=1)[:, worst] * 0.8)
        return np.asarray(np.sqrt(np.mean(angle**2, axis=1)))

    def ranked(self, scale: float) -> list[tuple[float, FloatArray]]:
        """Return how much each signed order of the columns misses, the best first."""
        every = np.array(list(exchanges()))
        senses, missed = np.sign(np.linalg.det(every)), np.empty(len(every))
        for sense in (1.0, -1.0):
            some = senses == sense
            missed[some] = self._misses(self.rotations(sense * scale), sense * every[some])
        found = zip(missed.tolist(), every, strict=True)
        return sorted(found, key=lambda pair: pair[0])

    def best_scale(self, seed: float) -> float:
        """Return the scale about `seed` with which some order fits best."""
        tried = seed * np.geomspace(0.6, 1.8, 23)
        return min((self.ranked(s)[0][0], float(s)) for s in tried)[1]

    def refined(self, E: FloatArray, scale: float) -> tuple[float, float]:
        """Return the scale that fits one order best, and how much it misses."""
        sense = float(np.sign(np.linalg.det(E)))
        step, best = 0.03, (self.miss(self.rotations(sense * scale), sense * E), scale)
        while step > 5e-4:
            here = best[1]
            for s in (here * (1 - step), here * (1 + step)):
                best = min(best, (self.miss(self.rotations(sense * s), sense * E), s))
            if best[1] == here:
                step /= 2
        return best[1], best[0]


def _way(
    x: FloatArray, time: FloatArray, y: FloatArray, accel: Sphere, up: FloatArray,
    begin: IntArray, end: IntArray, summed: bool,
) -> _Work | None:  # fmt: skip
    """Return the ways from rests to instants on the turns after them; None where none turn.

    Turned upside down one way or the other, gravity ends in one place, but takes other ways.
    """
    f = x[:, list(accel.columns)] - accel.centre
    starts, stops, before, after = [], [], [], []
    for u, a, b in zip(up, begin.tolist(), end.tolist(), strict=True):
        path = np.cumsum(np.linalg.norm(y[a:b], axis=1))
        for part in (0.3, 0.4, 0.5, 0.6, 0.7):
            k = a + int(np.searchsorted(path, part * path[-1])) if len(path) else a
            near = f[max(a, k - 1) : k + 2].mean(axis=0)
            size = float(np.linalg.norm(near))
            if a < k < b and abs(size / accel.radius - 1.0) < 0.3:
                starts.append(a)
                stops.append(k)
                before.append(u)
                after.append(near / size)
    if not starts:
        return None
    first, last = np.array(starts, np.int64), np.array(stops, np.int64)
    return _Work(time, y, np.array(before), np.array(after), first, last, summed)


def _seed(
    x: FloatArray, time: FloatArray, cut: Blocks, accel: Sphere, y: FloatArray
) -> float | None:
    """Return the size s of M = s E in ``du = u x M int y dt`` over blocks that move [rad/raw]."""
    f = cut.mean[:, list(accel.columns)] - accel.centre
    norm = np.linalg.norm(f, axis=1)
    u = f / np.where(norm > 0, norm, 1.0)[:, None]
    step = np.diff(time, prepend=time[0])
    path = np.cumsum(y * step[:, None], axis=0)
    at = (np.arange(len(u)) * cut.size + cut.size // 2).astype(int)
    theta = np.diff(path[at], axis=0)
    du, mid = np.diff(u, axis=0), u[1:] + u[:-1]
    mid /= np.maximum(np.linalg.norm(mid, axis=1), 1e-9)[:, None]
    fine = (np.abs(norm[1:] / accel.radius - 1) < 0.4) & (
        np.abs(norm[:-1] / accel.radius - 1) < 0.4
    )
    fine &= ~(cut.quiet[1:] & cut.quiet[:-1])
    fine &= np.linalg.norm(du, axis=1) < 0.8
    if fine.sum() < FEWEST:
        return None
    du, mid, theta = du[fine], mid[fine], theta[fine]
    # What turns about one axis alone, or spins about gravity, says nothing of some of M: of its
    # size alone, for each order of the columns, it always does.
    turned = np.cross(mid, np.einsum("kij,nj->kni", np.array(list(exchanges())), theta))
    along, square = np.einsum("kni,ni->k", turned, du), np.einsum("kni,kni->k", turned, turned)
    with np.errstate(divide="ignore", invalid="ignore"):
        told = np.where((square > 0) & (along > 0), along**2 / square, 0.0)
    best = int(np.argmax(told))
    rest = (float(np.sum(du**2)) - float(told[best])) / du.size
    shows = int((np.linalg.norm(du, axis=1) > SHOWS).sum())
    # Gravity that turned where nothing was logged says nothing of the gyros.
    if not told[best] > TELL**2 * rest and shows < FEWEST:
        return None
    return float(along[best] / square[best]) if told[best] > 0 else None


def _unit(x: FloatArray) -> FloatArray:
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-300))
