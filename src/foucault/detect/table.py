"""Where the rests and the spins of a session on a table are.

A stretch is a run of cells that do not change: the instrument turns at a constant rate about the
vertical, or not at all. Moves from one position to the next and the ramps at both ends of a spin
change from cell to cell. What is called constant is learned from the log: a step between the
means of neighbouring cells counts when it is five times the usual one. A table that turns may
shake the accelerometers, while the gyros show that it turns evenly; and outputs may come in coarse
steps. Neither is a change of the means.

The rate of a rest is the bias of the gyros, that of a spin has a part along up besides. Across up
both show the bias only, so that the bias is found from all means together, and what is left along
up tells spins from rests.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect.cells import CELL, Cells, Reduced
from foucault.detect.stretches import (
    LOWEST,
    TABLE,
    level_of,
    limit_of,
    quiet_sd,
    runs,
    split,
    trimmed,
    turning,
)

STEP = 5.0  # Cells belong together when their means differ by less than this many usual steps [1].
OF_QUARTER = 1.4  # Median over lower quartile of the length of a vector of three noises [1].
FEW = 10  # Cells of fewer samples say too little of their own noise [1].
STEADY = 0.003  # A rate is constant when it changes by less than this part of itself per cell [1].
QUIET_SPIN = 0.2  # In a spin the samples scatter by less than this part of the rate [1].
ALIKE = 0.02  # Two stretches at rates that differ by less than this part may be one [1].
LEAN = 0.1  # A spin whose axis leans by less than this is a spin about the vertical [rad].
LEAST_STEP = {"accel": 2e-4, "gyro": 1e-5}  # Least step between cells that is looked at [SI].
LEAST_TABLE = 1e-4  # Least step of the rate that the table tells [rad/s].
HELD = 3e-4  # Middle and inner angle stand still when they change by less per cell [rad].
PAUSE = 2.0  # Two stretches in the same position are one, if no more than this lies in between [s].

SAME = np.radians(0.3), np.radians(0.5)
"""And if up, or the table, has turned by less than the first, and the gyros by less than the
second, which their noise adds up to [rad]."""

SLOWEST = np.radians(0.01)
"""No spin is slower, unless it is told so; the Earth turns at 0.004 deg/s [rad/s]."""

LONG = 8  # Fewer cells than this do not tell noise from a change [1].

SLOW_TURN = 0.25
"""Beyond this angle per cell a turn about a horizontal axis has second differences too [rad]."""

SHAKEN = 0.1  # An instrument that is shaken by more of gravity than this is not at one place [1].
BLURRED = 0.7  # Steps of the output are blurred by noise of so many of them [1].


@dataclass(frozen=True)
class Stretch:
    """A time without change."""

    # first, last: first cell and the cell after the last [1]
    first: int
    last: int
    # rate of the outer axis, counter-clockwise from above; 0 at rest, NaN where the log cannot tell
    # [rad/s]
    rate: float = float("nan")

    @property
    def cells(self) -> slice:
        """Its cells."""
        return slice(self.first, self.last)


@dataclass(frozen=True)
class Steadiness:
    """How steady each cell is, and which neighbours belong together."""

    level: FloatArray  # (m,) scatter of the samples, relative to the quiet cells [1]
    # (m,) whether the cell is quiet, or turns so that its scatter is small against its rate
    quiet: BoolArray
    linked: BoolArray  # (m - 1,) whether the cell and the next one belong together
    # (m,) rate of the outer axis as the table tells it, NaN where it does not [rad/s]
    table_rate: FloatArray
    table_step: float  # largest step of it that counts as no change [rad/s]
    gyro_rounding: float  # step of means that rounding alone may make [rad/s]
    # (m - 1,) where the gyros turn, and do not change from a cell to the next; none without gyros
    even: BoolArray

    @property
    def even_runs(self) -> list[Stretch]:
        """The runs of cells over which the gyros turn evenly."""
        return _linked_runs(self.even)


def _linked_runs(linked: BoolArray) -> list[Stretch]:
    """Return the runs of cells in which each belongs to the next, `linked` (m - 1,)."""
    first, last = runs(np.ones(len(linked) + 1, bool), 2, linked)
    return [Stretch(a, b) for a, b in zip(first.tolist(), last.tolist(), strict=True)]


def mean(cells: Cells, x: FloatArray, run: Stretch) -> FloatArray:
    """Return the mean of `x` (m,) or (m, 3), means of the cells, over a stretch [unit]."""
    return np.asarray(np.average(x[run.cells], axis=0, weights=cells.count[run.cells]))


# -- which cells are steady ------------------------------------------------------------------------


def steadiness(data: Reduced) -> Steadiness:
    """Judge how steady the cells are."""
    cells = data.cells
    rounded = {name: rounding(name, data) for name in ("accel", "gyro") if name in data.has}
    scatter = {name: np.sqrt(getattr(cells, f"{name}_var").sum(axis=1)) for name in rounded}
    levels = [level_of(sd, quiet_sd(sd), TABLE.least[k], rounded[k]) for k, sd in scatter.items()]
    level = np.asarray(np.maximum.reduce(levels))
    calm = level < limit_of(level, TABLE, LOWEST)
    table_rate = _table_rate(cells)
    turn = np.nan_to_num(np.abs(table_rate))
    if "gyro" in data.has:
        turn = np.linalg.norm(cells.gyro, axis=1)
    pair = np.maximum(turn[1:], turn[:-1])
    both = calm[1:] & calm[:-1]
    linked = (cells.broken[1:] == 0) & (cells.label[1:] == cells.label[:-1])
    # How much noisier a step is than between full cells.
    full = float(np.median(cells.count))
    coarse = np.sqrt(0.5 * full * (1 / cells.count[1:] + 1 / cells.count[:-1]))
    turns = np.zeros(len(cells), bool)
    if "gyro" in data.has:
        step, usual = _steps(cells, "gyro", both)
        allowed = np.maximum(usual * coarse, _own(cells, cells.gyro_var))
        linked &= step <= np.maximum(np.maximum(allowed, STEADY * pair), rounded["gyro"])
        turns = scatter["gyro"] < QUIET_SPIN * turn
    elif "outer" in data.has:
        turns = turn > SLOWEST
    table_step = np.abs(np.diff(table_rate))
    known = table_step[np.isfinite(table_step)]
    table_limit = STEP * max(float(np.median(known)) if len(known) else 0.0, LEAST_TABLE)
    if "outer" in data.has:
        slow = np.minimum(np.abs(table_rate[1:]), np.abs(table_rate[:-1]))
        linked &= table_step <= np.maximum(table_limit, STEADY * slow)
    linked &= _held(cells)
    even = linked & turns[1:] & turns[:-1]
    if "accel" in data.has:
        step, usual = _steps(cells, "accel", both)
        shaken = np.maximum(usual, STEP * noise_steps(cells, even, turn))
        allowed = np.maximum(shaken * coarse, _own(cells, cells.accel_var))
        allowed = np.maximum(allowed, rounded["accel"])
        size = float(np.median(np.linalg.norm(cells.accel, axis=1)))
        linked &= step <= np.maximum(allowed, LEAN * size * pair * CELL)
    even = even if "gyro" in data.has else np.zeros_like(even)
    rounding_of_gyro = rounded.get("gyro", 0.0)
    return Steadiness(level, calm | turns, linked, table_rate, table_limit, rounding_of_gyro, even)


def rounding(name: str, data: Reduced) -> float:
    """Return by how much cells that follow may differ by the steps of the output alone [unit]."""
    sd, step = np.sqrt(np.median(getattr(data.cells, f"{name}_var"), axis=0)), data.steps(name)
    return float(np.linalg.norm(np.where(sd < BLURRED * step, step, 0.0)))


def _steps(cells: Cells, name: str, both: BoolArray) -> tuple[FloatArray, float]:
    """Return the steps between the means of neighbours, and the largest that is no change."""
    step = np.linalg.norm(np.diff(getattr(cells, name), axis=0), axis=1)
    chosen = step[both] if both.any() else step
    # The median step of steady cells, from the lower quarter: ramps may be many.
    quarter = float(np.percentile(chosen, 25)) if len(chosen) else 0.0
    return step, STEP * max(OF_QUARTER * quarter, LEAST_STEP[name])


def _own(cells: Cells, variance: FloatArray) -> FloatArray:
    """Return the step that the scatter inside two cells explains, shape (m - 1,).

    A steady change scatters inside a cell too, but explains only a part of its own step; not so in
    cells of a few samples.
    """
    of_mean = variance.sum(axis=1) / np.maximum(cells.count, 1)
    of_mean[cells.count < FEW] = 0.0
    return np.asarray(STEP * np.sqrt(of_mean[1:] + of_mean[:-1]))


def noise_steps(cells: Cells, even: BoolArray, turn: FloatArray) -> FloatArray:
    """Return the usual step of accelerometer means while the table turns evenly, shape (m - 1,).

    Noise jumps from cell to cell, a tilt goes on: the second differences of the means tell the
    noise alone. `even` (m - 1,): where gyros or table turn evenly from a cell to the next; `turn`
    (m,): size of the rate [rad/s].
    """
    out = np.zeros(len(even))
    for run in _linked_runs(even):
        a, b = run.first, run.last
        if b - a >= LONG and float(np.median(turn[a:b])) * CELL < SLOW_TURN:
            second = np.linalg.norm(np.diff(cells.accel[a:b], n=2, axis=0), axis=1)
            step = float(np.median(second)) / np.sqrt(3)  # variances 6 and 2
            size = float(np.median(np.linalg.norm(cells.accel[a:b], axis=1)))
            out[a : b - 1] = step if step < SHAKEN * size else 0.0
    return out


def _table_rate(cells: Cells) -> FloatArray:
    span = cells.last - cells.first
    turned = cells.to_angles[:, 0] - cells.from_angles[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(span > 0, turned / span, np.nan)
    if len(cells) < 2:
        return rate
    # Cells of one sample: the neighbours tell, from the side on which the rate changes less. The
    # first and the last sample of a spin are angles of it too, whatever comes before and after.
    between = np.diff(cells.from_angles[:, 0]) / np.diff(cells.first)
    between[cells.broken[1:] != 0] = np.nan
    change = np.nan_to_num(np.abs(np.diff(between)), nan=np.inf)
    before, after = np.full((2, len(cells)), np.inf)
    before[2:], after[:-2] = change, change
    behind, ahead = np.append(np.nan, between), np.append(between, np.nan)
    use_behind = np.isnan(ahead) | (~np.isnan(behind) & (before < after))
    return np.where(np.isnan(rate), np.where(use_behind, behind, ahead), rate)


def _held(cells: Cells) -> BoolArray:
    """Tell where middle and inner angle do not change from a cell to the next."""
    out = np.ones(max(len(cells) - 1, 0), bool)
    for k in (1, 2):
        step = np.abs(np.diff(cells.from_angles[:, k]))
        within = np.abs(cells.to_angles[:, k] - cells.from_angles[:, k])
        worst = np.maximum(step, np.maximum(within[1:], within[:-1]))
        if np.isfinite(worst).all() and len(worst):
            out &= worst <= max(HELD, STEP * float(np.median(worst)))
    return out


# -- stretches -------------------------------------------------------------------------------------


def stretches(data: Reduced, how: Steadiness, slowest: float | None) -> list[Stretch]:
    """Find rests and spins, of which the slowest was commanded at `slowest` [rad/s]."""
    first, last = runs(how.quiet, 2, how.linked)
    found = [Stretch(a, b) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
    if not found:
        return []
    rates = _rates(data, how, found, slowest)
    found = [replace(run, rate=float(rate)) for run, rate in zip(found, rates, strict=True)]
    # Runs that a bump has parted are one: nothing has turned in between.
    out: list[Stretch] = []
    for run in (_trimmed(run, data, how) for run in found):
        if out and _same(data, out[-1], run):
            out[-1] = replace(out[-1], last=run.last)
        else:
            out.append(run)
    return out


def _rates(
    data: Reduced, how: Steadiness, found: list[Stretch], slowest: float | None
) -> FloatArray:
    """Return the rate of each run, 0 where it is a rest."""
    cells = data.cells
    if "outer" in data.has:
        rate = np.array([_slope(cells, r) for r in found])
        limit = max(SLOWEST, how.table_step / STEP)
        limit = limit if slowest is None else min(limit, 0.3 * slowest)
        return np.where(np.abs(rate) > limit, rate, 0.0)
    if "gyro" not in data.has:
        return np.zeros(len(found))
    time = np.array([cells.end[r.last - 1] - cells.start[r.first] for r in found])
    w = np.array([mean(cells, cells.gyro, r) for r in found])
    f = np.array([mean(cells, cells.accel, r) for r in found]) if "accel" in data.has else None
    return spin_rates(w, f, time, slowest)


def _slope(cells: Cells, run: Stretch) -> float:
    a, b = run.first, run.last - 1
    turned = cells.to_angles[b, 0] - cells.from_angles[a, 0]
    return float(turned / (cells.last[b] - cells.first[a]))


def _trimmed(run: Stretch, data: Reduced, how: Steadiness) -> Stretch:
    """Cut off what belongs to the move or ramp before and after."""
    cells, part = data.cells, run.cells
    if run.rate == 0.0:
        first, last = trimmed(how.level, np.array([run.first]), np.array([run.last]))
        return replace(run, first=int(first[0]), last=int(last[0]))
    # A cell that holds the end of a ramp is off by little, but by more than the others.
    calm = np.ones(run.last - run.first, bool)
    noise = np.sqrt(np.median(cells.count) / cells.count[part])
    if "gyro" in data.has:
        off = np.linalg.norm(cells.gyro[part] - np.median(cells.gyro[part], axis=0), axis=1)
        least = max(LEAST_STEP["gyro"], how.gyro_rounding)
        calm &= off <= max(STEP * float(np.median(off)), least) * noise
    if "outer" in data.has:
        off = np.abs(how.table_rate[part] - np.median(how.table_rate[part]))
        calm &= off <= max(STEP * float(np.median(off)), LEAST_TABLE) * noise
    where = np.flatnonzero(calm)
    if not len(where):
        return run
    cut = replace(run, first=run.first + int(where[0]), last=run.first + int(where[-1]) + 1)
    if "outer" in data.has and cells.last[cut.last - 1] > cells.first[cut.first]:
        cut = replace(cut, rate=_slope(cells, cut))
    return cut


def _same(data: Reduced, a: Stretch, b: Stretch) -> bool:
    """Tell whether nothing but a bump is between two stretches."""
    cells, gap = data.cells, slice(a.last, b.first)
    up_turned, gyro_turned = SAME
    pause = cells.start[b.first] - cells.end[a.last - 1]
    if pause > PAUSE or cells.label[a.first] != cells.label[b.first]:
        return False
    if cells.broken[a.last : b.first + 1].any():
        return False
    if (a.rate == 0) != (b.rate == 0) or abs(a.rate - b.rate) > ALIKE * abs(a.rate):
        return False
    if "accel" in data.has:
        up = [x / np.linalg.norm(x) for x in (mean(cells, cells.accel, r) for r in (a, b))]
        if np.linalg.norm(up[1] - up[0]) > up_turned:
            return False
    if "outer" in data.has:
        turned = cells.from_angles[b.first, 0] - cells.to_angles[a.last - 1, 0]
        between = cells.first[b.first] - cells.last[a.last - 1]
        return bool(abs(turned - a.rate * between) < up_turned)
    if "gyro" in data.has:
        time = (cells.end - cells.start)[gap]
        more = ((cells.gyro[gap] - mean(cells, cells.gyro, a)) * time[:, None]).sum(axis=0)
        return bool(np.linalg.norm(more) < max(gyro_turned, ALIKE * abs(a.rate * time.sum())))
    return True


# -- rests and spins by the gyros alone ------------------------------------------------------------


def spin_rates(
    w: FloatArray, f: FloatArray | None, time: FloatArray, slowest: float | None
) -> FloatArray:
    """Return the rate of each spin, without bias, shape (n,) [rad/s]; 0 at rest.

    `w` (n, 3): mean rates [rad/s]; `f` (n, 3) or None: mean specific forces, without them the
    rate of a spin has no sign [m/s^2]; `time` (n,): length of each mean [s]; `slowest` or None:
    slowest rate that was commanded, where known [rad/s].
    """
    if f is None:
        rate = np.linalg.norm(w, axis=1)
    else:
        up = f / np.maximum(np.linalg.norm(f, axis=1), 1e-300)[:, None]
        rate = ((w - bias_across(w, up, time)) * up).sum(axis=1)
    rate = np.where(np.abs(rate) > _threshold(rate, time, slowest), rate, 0.0)
    rest = rate == 0
    if not rest.any() or not rate.any():
        return np.asarray(rate)
    # Rests tell the bias better, and so the size does not depend on where up is.
    bias = np.median(w[rest], axis=0)
    off = np.linalg.norm(w - bias, axis=1)
    rate = np.sign(rate) * off
    if slowest is not None and f is not None and rest.sum() > 4:
        # Slower than commanded is no rest either, but a move about the outer axis.
        moving = np.zeros(len(rate), bool)
        moving[rest] = turning(w[rest])[0]
        sense = np.sign(((w - bias) * f).sum(axis=1))
        rate = np.where(moving, sense * off, rate)
    return np.asarray(rate)


def bias_across(w: FloatArray, up: FloatArray, time: FloatArray) -> FloatArray:
    """Fit the bias to the rates across up, which no spin about the vertical has.

    `w` (n, 3): mean rates at rest and in spins [rad/s]; `up` (n, 3): directions of up [1]; `time`
    (n,): length of each mean [s]. Returns (3,): bias; its part along up is zero where up has but
    one direction [rad/s].
    """
    across = np.eye(3) - up[:, :, None] * up[:, None, :]
    weight = np.minimum(time, 30.0)
    for _ in range(10):
        N = np.einsum("n,nij->ij", weight, across)
        b = np.linalg.pinv(N, rcond=1e-3) @ np.einsum("n,nij,nj->i", weight, across, w)
        off = np.linalg.norm(np.einsum("nij,nj->ni", across, w - b), axis=1)
        # A turn that is no spin counts less.
        weight = np.minimum(time, 30.0) / (1 + (off / max(3 * np.median(off), 1e-6)) ** 2)
    return np.asarray(b)


def _threshold(rate: FloatArray, time: FloatArray, slowest: float | None) -> float:
    """Return the rate that tells spins from rests [rad/s]."""
    if slowest is not None:
        return 0.4 * slowest
    size = np.maximum(np.abs(rate), SLOWEST / 10)
    if size.max() < 3 * size.min():  # all rests or all spins
        return 0.0 if float(np.median(size)) > np.radians(0.5) else np.inf
    # Each second counts alike, not each run: moves leave many short ones.
    seconds = np.repeat(size, np.maximum(1, np.round(time).astype(int)))
    return float(max(split(seconds / SLOWEST) * SLOWEST, SLOWEST))
