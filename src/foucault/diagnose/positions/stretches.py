"""Where the rests and the spins of a session on a table are.

A stretch is a run of cells that do not change: the instrument turns at a constant rate about the
vertical, or not at all. Moves from one position to the next and the ramps at both ends of a spin
change from cell to cell. What is called constant is learned from the log: a step between the
means of neighbouring cells counts when it is five times the usual one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.diagnose.positions.cells import CELL, Cells, Reduced
from foucault.diagnose.positions.rates import SLOWEST, spin_rates
from foucault.diagnose.positions.shaken import noise_steps, rounding, runs_of
from foucault.diagnose.rests import EDGE, quiet_sd, split

STEP = 5.0
"""Cells belong together when their means differ by less than this many usual steps [1]."""

OF_QUARTER = 1.4
"""Median over lower quartile of the length of a vector of three noises [1]."""

FEW = 10
"""Cells of fewer samples say too little of their own noise [1]."""

STEADY = 0.003
"""A rate is constant when it changes by less than this part of itself per cell [1]."""

QUIET_SPIN = 0.2
"""In a spin the samples scatter by less than this part of the rate [1]."""

ALIKE = 0.02
"""Two stretches at rates that differ by less than this part may be one [1]."""

LEAN = 0.1
"""A spin whose axis leans by less than this is a spin about the vertical [rad]."""

LEAST_GYRO = (2e-5, 1e-5)
"""Least scatter of samples and least step between cells that are looked at [rad/s]."""

LEAST_ACCEL = (1e-4, 2e-4)
"""The same for the accelerometers [m/s^2]."""

LEAST_TABLE = 1e-4
"""Least step of the rate that the table tells [rad/s]."""

HELD = 3e-4
"""Middle and inner angle stand still when they change by less per cell [rad]."""

PAUSE = 2.0
"""Two stretches in the same position are one, if no more than this lies in between [s]."""


@dataclass(frozen=True)
class Stretch:
    """A time without change."""

    # first, last: first cell and the cell after the last [1]
    first: int
    last: int
    # rate of the outer axis, counter-clockwise from above; 0 at rest, NaN where the log cannot tell
    # [rad/s]
    rate: float


@dataclass(frozen=True)
class Steadiness:
    """How steady each cell is, and which neighbours belong together."""

    level: FloatArray  # (m,) scatter of the samples, relative to the quiet cells [1]
    # (m,) whether the cell is quiet, or turns so that its scatter is small against its rate
    quiet: BoolArray
    linked: BoolArray  # (m - 1,) whether the cell and the next one belong together
    # (m,) rate of the outer axis as the table tells it, NaN where it does not [rad/s]
    table_rate: FloatArray
    # gyro_step, table_step: largest step of means that counts as no change [rad/s]
    gyro_step: float
    table_step: float
    gyro_rounding: float  # step of means that rounding alone may make [rad/s]
    # (m - 1,) where the gyros turn, and do not change from a cell to the next; none without gyros
    even: BoolArray


def steadiness(data: Reduced) -> Steadiness:
    """Judge how steady the cells are."""
    cells = data.cells
    rounded = {name: rounding(name, data) for name in ("accel", "gyro") if name in data.has}
    least = {"accel": LEAST_ACCEL[0], "gyro": LEAST_GYRO[0]}
    level = np.maximum.reduce([_level(getattr(cells, f"{name}_var"), least[name], step)
                               for name, step in rounded.items()])  # fmt: skip
    limit = max(split(level), 2.0)
    calm = level < limit
    table_rate = _table_rate(cells)
    turn = np.nan_to_num(np.abs(table_rate))
    if "gyro" in data.has:
        turn = np.linalg.norm(cells.gyro, axis=1)
    pair = np.maximum(turn[1:], turn[:-1])
    both = calm[1:] & calm[:-1]
    linked = (cells.broken[1:] == 0) & (cells.label[1:] == cells.label[:-1])
    coarse = _coarse(cells)
    gyro_step, quiet, turning = np.inf, calm, np.zeros(len(cells), bool)
    if "gyro" in data.has:
        step = np.linalg.norm(np.diff(cells.gyro, axis=0), axis=1)
        gyro_step = STEP * _usual(step, both, LEAST_GYRO[1])
        allowed = np.maximum(gyro_step * coarse, _own(cells, cells.gyro_var))
        linked &= step <= np.maximum(np.maximum(allowed, STEADY * pair), rounded["gyro"])
        turning = np.sqrt(cells.gyro_var.sum(axis=1)) < QUIET_SPIN * turn
    elif "outer" in data.has:
        turning = turn > SLOWEST
    quiet = quiet | turning
    linked, table_step = _by_table(data, linked, table_rate)
    even = linked & turning[1:] & turning[:-1]
    if "accel" in data.has:
        step = np.linalg.norm(np.diff(cells.accel, axis=0), axis=1)
        accel_step = STEP * _usual(step, both, LEAST_ACCEL[1])
        usual = np.maximum(accel_step, STEP * noise_steps(cells, even, turn))
        allowed = np.maximum(usual * coarse, _own(cells, cells.accel_var))
        allowed = np.maximum(allowed, rounded["accel"])
        size = float(np.median(np.linalg.norm(cells.accel, axis=1)))
        linked &= step <= np.maximum(allowed, LEAN * size * pair * CELL)
    even = even if "gyro" in data.has else np.zeros_like(even)
    return Steadiness(
        level, quiet, linked, table_rate, gyro_step, table_step, rounded.get("gyro", 0.0), even
    )


def _by_table(data: Reduced, linked: BoolArray, table_rate: FloatArray) -> tuple[BoolArray, float]:
    """Part cells between which the table says that something changed; also return its step."""
    table_step = _table_step(table_rate)
    if "outer" in data.has:
        slow = np.minimum(np.abs(table_rate[1:]), np.abs(table_rate[:-1]))
        linked = linked & (np.abs(np.diff(table_rate)) <= np.maximum(table_step, STEADY * slow))
    return linked & _held(data.cells), table_step


def _level(variance: FloatArray, least: float, step: float) -> FloatArray:
    sd = np.sqrt(variance.sum(axis=1))
    level = sd / max(quiet_sd(sd), least, 0.5 * step)
    # An output in coarse steps is as quiet where it happens not to jump as where it does.
    return np.asarray(np.maximum(level, 1.0) if step > 0 else level)


def _coarse(cells: Cells) -> FloatArray:
    """Return how much noisier a step is than between full cells, shape (m - 1,)."""
    full = float(np.median(cells.count))
    return np.asarray(np.sqrt(0.5 * full * (1 / cells.count[1:] + 1 / cells.count[:-1])))


def _own(cells: Cells, variance: FloatArray) -> FloatArray:
    """Return the step that the scatter inside two cells explains, shape (m - 1,).

    A steady change scatters inside a cell too, but explains only a part of its own step; not so in
    cells of a few samples.
    """
    of_mean = variance.sum(axis=1) / np.maximum(cells.count, 1)
    of_mean[cells.count < FEW] = 0.0
    return np.asarray(STEP * np.sqrt(of_mean[1:] + of_mean[:-1]))


def _usual(step: FloatArray, both: BoolArray, least: float) -> float:
    """Return the median step of steady cells, from the lower quarter: ramps may be many."""
    chosen = step[both] if both.any() else step
    quarter = float(np.percentile(chosen, 25)) if len(chosen) else 0.0
    return max(OF_QUARTER * quarter, least)


def _table_rate(cells: Cells) -> FloatArray:
    span = cells.last - cells.first
    turned = cells.to_angles[:, 0] - cells.from_angles[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(span > 0, turned / span, np.nan)
    if len(cells) > 1:  # cells of one sample: the neighbours tell
        rate = np.where(np.isnan(rate), _rate_of_points(cells), rate)
    return np.asarray(rate)


def _rate_of_points(cells: Cells) -> FloatArray:
    """Return the rate at single samples, from the side on which it changes less.

    The first and the last sample of a spin are angles of it too, whatever comes before and after.
    """
    between = np.diff(cells.from_angles[:, 0]) / np.diff(cells.first)
    between[cells.broken[1:] != 0] = np.nan
    change = np.nan_to_num(np.abs(np.diff(between)), nan=np.inf)
    before, after = np.full((2, len(cells)), np.inf)
    before[2:], after[:-2] = change, change
    behind, ahead = np.append(np.nan, between), np.append(between, np.nan)
    use_behind = np.isnan(ahead) | (~np.isnan(behind) & (before < after))
    return np.where(use_behind, behind, ahead)


def _table_step(rate: FloatArray) -> float:
    step = np.abs(np.diff(rate))
    step = step[np.isfinite(step)]
    return STEP * max(float(np.median(step)) if len(step) else 0.0, LEAST_TABLE)


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


def stretches(data: Reduced, how: Steadiness, slowest: float | None) -> list[Stretch]:
    """Find the rests and spins.

    `slowest` or None: slowest rate that was commanded, where known [rad/s].
    """
    cells = data.cells
    good = how.quiet[1:] & how.quiet[:-1] & how.linked
    runs = [Stretch(a, b, np.nan) for a, b in runs_of(good)]
    if not runs:
        return []
    rates = _rates(data, how, runs, slowest)
    runs = [replace(run, rate=float(rate)) for run, rate in zip(runs, rates, strict=True)]
    runs = [_trimmed(run, data, how) for run in runs]
    return _merged(cells, data, runs)


def mean(cells: Cells, x: FloatArray, run: Stretch) -> FloatArray:
    """Return the mean of `x` over a stretch.

    `x` (m,) or (m, 3): means of the cells [unit].
    """
    part = slice(run.first, run.last)
    return np.asarray(np.average(x[part], axis=0, weights=cells.count[part]))


def _rates(
    data: Reduced, how: Steadiness, runs: list[Stretch], slowest: float | None
) -> FloatArray:
    """Return the rate of each run, 0 where it is a rest."""
    cells = data.cells
    time = np.array([cells.end[r.last - 1] - cells.start[r.first] for r in runs])
    if "outer" in data.has:
        rate = np.array([_slope(cells, r) for r in runs])
        limit = max(SLOWEST, how.table_step / STEP)
        limit = limit if slowest is None else min(limit, 0.3 * slowest)
        return np.where(np.abs(rate) > limit, rate, 0.0)
    if "gyro" not in data.has:
        return np.zeros(len(runs))
    w = np.array([mean(cells, cells.gyro, r) for r in runs])
    f = np.array([mean(cells, cells.accel, r) for r in runs]) if "accel" in data.has else None
    return spin_rates(w, f, time, slowest)


def _slope(cells: Cells, run: Stretch) -> float:
    a, b = run.first, run.last - 1
    turned = cells.to_angles[b, 0] - cells.from_angles[a, 0]
    return float(turned / (cells.last[b] - cells.first[a]))


def _trimmed(run: Stretch, data: Reduced, how: Steadiness) -> Stretch:
    """Cut off what belongs to the move or ramp before and after."""
    cells, part = data.cells, slice(run.first, run.last)
    calm = np.ones(run.last - run.first, bool)
    if run.rate == 0.0:
        calm = how.level[part] <= EDGE * np.median(how.level[part])
    else:
        # A cell that holds the end of a ramp is off by little, but by more than the others.
        noise = np.sqrt(np.median(cells.count) / cells.count[part])
        if "gyro" in data.has:
            off = np.linalg.norm(cells.gyro[part] - np.median(cells.gyro[part], axis=0), axis=1)
            least = max(LEAST_GYRO[1], how.gyro_rounding)
            calm &= off <= max(STEP * float(np.median(off)), least) * noise
        if "outer" in data.has:
            off = np.abs(how.table_rate[part] - np.median(how.table_rate[part]))
            calm &= off <= max(STEP * float(np.median(off)), LEAST_TABLE) * noise
    where = np.flatnonzero(calm)
    if not len(where):
        return run
    cut = replace(run, first=run.first + int(where[0]), last=run.first + int(where[-1]) + 1)
    if (
        run.rate != 0.0
        and "outer" in data.has
        and cells.last[cut.last - 1] > cells.first[cut.first]
    ):
        cut = replace(cut, rate=_slope(cells, cut))
    return cut


def _merged(cells: Cells, data: Reduced, runs: list[Stretch]) -> list[Stretch]:
    """Join runs that a bump has parted: nothing has turned in between."""
    out: list[Stretch] = []
    for run in runs:
        if out and _same(cells, data, out[-1], run):
            out[-1] = replace(out[-1], last=run.last)
        else:
            out.append(run)
    return out


def _same(cells: Cells, data: Reduced, a: Stretch, b: Stretch) -> bool:
    gap = slice(a.last, b.first)
    pause = cells.start[b.first] - cells.end[a.last - 1]
    if pause > PAUSE or cells.label[a.first] != cells.label[b.first]:
        return False
    if cells.broken[a.last : b.first + 1].any():
        return False
    if (a.rate == 0) != (b.rate == 0) or abs(a.rate - b.rate) > ALIKE * abs(a.rate):
        return False
    if "accel" in data.has:
        up = [x / np.linalg.norm(x) for x in (mean(cells, cells.accel, r) for r in (a, b))]
        if np.linalg.norm(up[1] - up[0]) > np.radians(0.3):
            return False
    time = (cells.end - cells.start)[gap]
    expected = a.rate * float(time.sum())
    if "outer" in data.has:
        turned = cells.from_angles[b.first, 0] - cells.to_angles[a.last - 1, 0]
        between = cells.first[b.first] - cells.last[a.last - 1]
        return bool(abs(turned - a.rate * between) < np.radians(0.3))
    if "gyro" in data.has:
        w = mean(cells, cells.gyro, a)
        turned = np.linalg.norm(((cells.gyro[gap] - w) * time[:, None]).sum(axis=0))
        return bool(turned < max(np.radians(0.5), ALIKE * abs(expected)))
    return True
