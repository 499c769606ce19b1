"""Whether the readings of a tumble move as its command says, seen before anything is estimated.

The specific force keeps its direction in n, so that in the cluster it turns against the command:
``f' = f x (w - w_ie)``. Over windows in which the cluster turns a little both sides are known
without any calibration to a few percent, which is enough to see a wrong unit, swapped axes, a
reversed sense, or readings that are seconds late.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, finding
from foucault.models.earth import EARTH_RATE
from foucault.tables import AXES, Log

TURN = 0.2
"""Windows in which the cluster turns by less than this tell how it moves [rad]."""

STILL = 1e-3
"""Up that moves less than this in such a window tells nothing [rad]."""

GRAIN, LATEST = 1.0, 60.0
"""Delays that are looked for beforehand [s]: shorter ones are for the estimate to tell."""

TOGETHER = 100_000
"""Delays times rows that are tried at once [1]."""

ROUGHLY = 0.3
"""Over a window a command is right within this part of it [1]."""

EXPLAINED = 0.9
"""Share of the motion that a right command explains at least [1]."""


@dataclass(frozen=True)
class _Motion:
    """Windows of the log: how the direction of up moved, and what was commanded."""

    moved: FloatArray
    middle: FloatArray
    turned: FloatArray
    rows: npt.NDArray[np.int64]

    def within(self, turned: float, moved: float) -> bool:
        """Whether nearly all windows turn and move less far than this [rad]."""
        return _most(self.turned) < turned and _most(self.moved) < moved

    def explained(self, turned: FloatArray) -> tuple[float, float]:
        """Return the share of the motion that `turned` explains, and the factor that fits best."""
        predicted = np.cross(self.middle, turned)
        whole = float(np.sum(self.moved**2))
        own = float(np.sum(predicted**2))
        factor = float(np.sum(predicted * self.moved)) / own if own > 0 else 0.0
        left = float(np.sum((self.moved - predicted) ** 2))
        return 1 - left / whole if whole > 0 else 0.0, factor


def _most(steps: FloatArray) -> float:
    return float(np.quantile(np.linalg.norm(steps, axis=1), 0.9))


def motion_findings(log: Log, from_its_time: bool, delay_sd: float = 0.0) -> list[Finding]:
    """Compare how the readings move with the command; refuse wrong units, senses and axes.

    `log`: command and readings [SI]; `from_its_time`: whether the command of a row begins at its
    time; `delay_sd`: sd of a delay that is estimated later, 0 for none [s].
    """
    # Windows short enough for the rule above by the command, or whatever the command says.
    motion = next((m for m in _windows(log, from_its_time) if m.within(TURN, np.inf)), None)
    own = 0.0
    if motion is not None:
        if max(_most(motion.moved), _most(np.cross(motion.middle, motion.turned))) < STILL:
            return []  # up turns about itself
        own, _ = motion.explained(motion.turned)
        late = _late(log, from_its_time)
        if late is not None:
            given, sd = (f"{1e3 * value:.0f}" for value in late)
            said = finding("tumble.delay", given=given, sd=sd, believed="0")
            return [said] if abs(late[0]) > 3 * delay_sd else []
        if own > _expected(log):
            _check_parts(log, motion)
            return []
    by_readings = next((m for m in _windows(log, from_its_time) if m.within(np.inf, TURN)), None)
    if by_readings is not None:
        _, factor = by_readings.explained(by_readings.turned)
        scaled, _ = by_readings.explained(factor * by_readings.turned)
        if scaled > EXPLAINED and not 0.8 < factor < 1.25 and factor > 0:
            raise error("tumble.unit", factor=f"{factor:.4g}", likely=_likely_rate(factor, log))
    if motion is None:
        return []  # it turns too far from row to row to say more
    own = max(own, 0.0)
    words, M = max(_turned_axes(), key=lambda way: motion.explained(motion.turned @ way[1].T)[0])
    share, _ = motion.explained(motion.turned @ M.T)
    if share > _expected(log) and share > own + 0.3:
        raise error(
            "tumble.axes", seen=words, share=f"{100 * share:.0f}", own=f"{100 * own:.0f}",
            more=_as_readings(M),
        )  # fmt: skip
    _check_parts(log, motion)
    return [finding("tumble.motion", own=f"{100 * own:.0f}")]


def _check_parts(log: Log, motion: _Motion) -> None:
    """Refuse a log of which one part was not turned as its command says, and the others were."""
    assert log.gyro is not None
    predicted = np.cross(motion.middle, motion.turned)
    size = np.sum(predicted**2, axis=1)
    told = size > np.median(size) / 100  # where up does not turn about itself
    factor = np.sum(predicted * motion.moved, axis=1)[told] / size[told]
    left = np.linalg.norm(motion.moved[told] - factor[:, None] * predicted[told], axis=1)
    # Of windows that the command explains but for its rate; those across a step are neither.
    clear = left < (1 - EXPLAINED) * np.maximum(np.sqrt(size[told]), STILL)
    # The Earth turns it besides.
    band = ROUGHLY + float(EARTH_RATE / np.sqrt(np.mean(np.sum(log.gyro**2, axis=1))))
    right = np.abs(factor - 1) < band
    wrong = clear & ~right
    if not wrong.any() or not right.sum() > max(wrong.sum(), 2):
        return
    rows = motion.rows
    first, last = rows[:-1][told], rows[1:][told]
    # The longest run without a window that is right.
    runs = np.split(np.arange(len(right)), np.flatnonzero(right))
    run = max(([k for k in part if wrong[k]] for part in runs), key=len)
    if len(run) < 2 or np.ptp(factor[run]) > band:
        return
    raise error(
        "tumble.part", start=f"{log.time[first[run[0]]]:.4g}", end=f"{log.time[last[run[-1]]]:.4g}",
        factor=f"{float(np.median(factor[run])):.2f}",
    )  # fmt: skip


def _late(log: Log, from_its_time: bool) -> tuple[float, float] | None:
    """Return by how much readings are late, and the sd of that, where it is seconds [s].

    A delay changes the motion where the command steps, and nowhere else.
    """
    angle, f, good = _path(log, from_its_time)
    latest = min(LATEST, log.duration / 8)
    inside = np.abs(2 * (log.time[good] - log.time[0]) - log.duration) < log.duration - 2 * latest
    rows = good[inside][:: max(1, round(GRAIN / log.interval))]
    if len(rows) < 3:
        return None
    time, middle = log.time[rows], (f[rows[1:]] + f[rows[:-1]]) / 2
    if log.sampled == "increment":
        time = time - log.interval / 2  # of the middle of a mean

    def predicted(late: FloatArray) -> FloatArray:
        turned = [np.interp(time - late[:, None], log.time, column) for column in angle.T]
        return np.cross(middle, np.diff(np.stack(turned, axis=-1), axis=1))

    now = predicted(np.zeros(1))[0]
    left = np.diff(f[rows], axis=0) - now
    jump = np.diff(angle[rows], n=2, axis=0)
    if np.linalg.norm(left, axis=1).max() < 0.3 * np.linalg.norm(jump, axis=1).max():
        return None

    def best(tried: FloatArray) -> float:
        gain = []
        for some in np.array_split(tried, 1 + tried.size * len(time) // TOGETHER):
            change = predicted(some) - now
            gain.append(np.sum((2 * left - change) * change, axis=(1, 2)))
        return float(tried[np.argmax(np.concatenate(gain))])

    late = best(np.arange(-latest, latest, GRAIN))
    late = best(late + GRAIN * np.linspace(-1, 1, 41))
    change = predicted(np.array([late]))[0] - now
    there = np.linalg.norm(change, axis=1) > 0.1 * np.linalg.norm(change, axis=1).max()
    square = float(np.sum((left - change)[there] ** 2))
    if abs(late) < GRAIN or square > (1 - EXPLAINED) * float(np.sum(left[there] ** 2)):
        return None
    return late, abs(late) * float(np.sqrt(square / np.sum(change**2)))


def _expected(log: Log) -> float:
    """Return the share that a right command explains at least: it does not know the Earth's."""
    assert log.gyro is not None
    return EXPLAINED - EARTH_RATE**2 / float(np.mean(np.sum(log.gyro**2, axis=1)))


def _windows(log: Log, from_its_time: bool) -> Iterator[_Motion]:
    """Divide the log into windows, ever shorter ones."""
    angle, f, good = _path(log, from_its_time)
    each = len(good) // 8
    while each > 0:
        rows = good[::each]
        middle = (f[rows[1:]] + f[rows[:-1]]) / 2
        yield _Motion(np.diff(f[rows], axis=0), middle, np.diff(angle[rows], axis=0), rows)
        each //= 2


def _path(log: Log, from_its_time: bool) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
    """Return the integral of the command, the direction of up, and the rows that have one."""
    assert log.gyro is not None and log.accel is not None
    command = log.gyro[:-1] if from_its_time else log.gyro[1:]
    angle = np.cumsum(command * np.diff(log.time)[:, None], axis=0)
    size = np.linalg.norm(log.accel, axis=1, keepdims=True)
    f = log.accel / np.where(size > 0, size, np.nan)
    good = np.flatnonzero(np.isfinite(f).all(axis=1))
    return np.concatenate([np.zeros((1, 3)), angle]), f, good


_DEGREE = float(np.degrees(1.0))
_RATES = {
    _DEGREE: "rad/s was logged and deg/s said",
    1 / _DEGREE: "deg/s was logged and rad/s said",
    3600.0: "deg/s was logged and deg/h said",
    1 / 3600.0: "deg/h was logged and deg/s said",
    3600.0 * _DEGREE: "rad/s was logged and deg/h said",
    1 / 3600.0 / _DEGREE: "deg/h was logged and rad/s said",
}


def _likely_rate(factor: float, log: Log) -> str:
    many = 'increments are no rates: give kind = "increment"'
    each = 1 / log.interval
    known = {each: many, each / _DEGREE: many + " and their unit"} | _RATES
    return nearest(known, factor, "unit or scale")


def _turned_axes() -> Iterator[tuple[str, FloatArray]]:
    """All ways to exchange and reverse three axes, with their words."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[np.arange(3), order] = signs
            yield _words(matrix), matrix


def _words(matrix: FloatArray) -> str:
    named = (f"{'-' if row.sum() < 0 else ''}{AXES[int(np.argmax(abs(row)))]}" for row in matrix)
    return f"({', '.join(named)})"


def _as_readings(matrix: FloatArray) -> str:
    """Say which columns of the accelerometers would look the same.

    ``M f`` turns as ``det(M) M w`` says, so that no mirrored command does.
    """
    if np.linalg.det(matrix) < 0:
        return ""
    return f", or the readings were {_words(matrix.T)} or {_words(-matrix.T)}"


def nearest(known: dict[float, str], factor: float, otherwise: str) -> str:
    """Return the words of the known factor that is within a tenth of this one.

    `known`: words of factors [1]; `factor`: the factor [1].
    """
    near = min(known, key=lambda size: abs(np.log(factor / size)))
    return known[near] if abs(np.log(factor / near)) < 0.1 else otherwise
