"""Whether the readings of a tumble are gravity, and move as its command says.

The specific force keeps its direction in n, so that in the cluster it turns against the command:
``f' = f x (w - w_ie)``. Over windows in which the cluster turns a little both sides are known
without any calibration to a few percent, which is enough to see a wrong unit, swapped axes, a
reversed sense, or readings that are seconds late.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, finding
from foucault.guard.mistakes import (
    DEGREE,
    SUMS,
    Mistake,
    columns,
    exchanges,
    explain,
    factors,
    likely,
)
from foucault.models.cluster import attitude_of
from foucault.models.earth import EARTH_RATE, Site
from foucault.tables import AXES, Log

WRONG_SIZE = 0.05
"""Readings whose mean size is this far from gravity have a wrong unit [1]."""

WRONG_WAY = np.radians(120.0)
"""First readings that point this far from where the start puts up are reversed [rad]."""

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

EXPLAINED, MORE = 0.9, 0.3
"""Share of the motion that a right command explains at least, and more than a wrong one [1]."""

OTHER_UNIT = 1.25
"""A command is of its unit within this factor [1]."""


def require_readings(log: Log, site: Site, rate_limit: float | None) -> None:
    """Refuse a log without command, accelerometers, latitude, or with impossible values.

    `log`: command in the gyro columns, and readings [SI]; `rate_limit` or None: largest rate
    about an axis that the rig allows [rad/s].
    """
    if log.accel is None:
        raise error("tumble.no_accel")
    if log.gyro is None:
        raise error("tumble.no_command", what="[log.gyro] is missing")
    lost = ~np.isfinite(log.gyro).all(axis=1)
    if lost.any():
        first = int(np.argmax(lost))
        what = f"{int(lost.sum())} rows, the first at {log.time[first]:.6g} s"
        raise error("tumble.no_command", what=what)
    if site.latitude is None:
        raise error("tumble.no_latitude")
    fastest = float(np.abs(log.gyro).max(initial=0.0))
    if fastest < 3 * EARTH_RATE:
        raise error("tumble.still", given=f"{np.degrees(fastest) * 3600:.3g}")
    if rate_limit is not None and fastest > rate_limit * 1.05:
        row, axis = divmod(int(np.argmax(np.abs(log.gyro))), 3)
        raise error(
            "tumble.rate_limit", time=f"{log.time[row]:.6g}", axis=AXES[axis],
            given=f"{np.degrees(fastest):.4g}", limit=f"{np.degrees(rate_limit):.4g}",
        )  # fmt: skip


def require_gravity(log: Log, site: Site, start: FloatArray) -> None:
    """Refuse readings unlike gravity [SI], or down; `start` (3,): angles at first [rad]."""
    assert log.accel is not None
    good = log.accel[np.isfinite(log.accel).all(axis=1)]
    if len(good) == 0:
        return  # too short, which is said elsewhere
    size = float(np.median(np.linalg.norm(good, axis=1)))
    if abs(size / site.gravity - 1) > WRONG_SIZE:
        cause = likely(size / site.gravity, factors("accel", log.interval))
        raise error("tumble.gravity", given=f"{size:.5g}", gravity=f"{site.gravity:.5f}",
                    likely=cause or "the unit or the count scale")  # fmt: skip
    up = attitude_of(start)[:, 2]
    first = good[: max(1, round(1.0 / log.interval))].mean(axis=0)
    away = float(np.arccos(np.clip(up @ first / np.linalg.norm(first), -1, 1)))
    if away > WRONG_WAY:
        raise error("tumble.sign", angle=f"{np.degrees(away):.0f}")


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

    def left(self, mistake: Mistake) -> float:
        """Return the share of the motion that the command without a mistake leaves unexplained."""
        predicted = np.cross(self.middle, mistake.right(self.turned))
        whole = float(np.sum(self.moved**2))
        return float(np.sum((self.moved - predicted) ** 2)) / whole if whole > 0 else 1.0

    @property
    def factor(self) -> float:
        """The factor by which the command explains most."""
        predicted = np.cross(self.middle, self.turned)
        own = float(np.sum(predicted**2))
        return float(np.sum(predicted * self.moved)) / own if own > 0 else 0.0


def _most(steps: FloatArray) -> float:
    return float(np.quantile(np.linalg.norm(steps, axis=1), 0.9))


def motion_findings(log: Log, from_its_time: bool, delay_sd: float = 0.0) -> list[Finding]:
    """Compare how the readings move with the command; refuse wrong units, senses and axes.

    `log`: command and readings [SI]; `from_its_time`: whether the command of a row begins at its
    time; `delay_sd`: sd of a delay that is estimated later, 0 for none [s].
    """
    assert log.gyro is not None
    # It does not know the Earth's rate.
    right = 1 - EXPLAINED + EARTH_RATE**2 / float(np.mean(np.sum(log.gyro**2, axis=1)))
    # Windows short enough for the rule above by the command, or whatever the command says.
    motion = next((m for m in _windows(log, from_its_time) if m.within(TURN, np.inf)), None)
    if motion is not None:
        if max(_most(motion.moved), _most(np.cross(motion.middle, motion.turned))) < STILL:
            return []  # up turns about itself
        late = _late(log, from_its_time)
        if late is not None:
            given, sd = (f"{1e3 * value:.0f}" for value in late)
            said = finding("tumble.delay", given=given, sd=sd, believed="0")
            return [said] if abs(late[0]) > 3 * delay_sd else []
        if motion.left(Mistake()) < right:
            _check_parts(log, motion)
            return []
    by_readings = next((m for m in _windows(log, from_its_time) if m.within(np.inf, TURN)), None)
    if by_readings is not None:
        factor = by_readings.factor
        if factor > 0 and not 1 / OTHER_UNIT < factor < OTHER_UNIT and (
            by_readings.left(Mistake(factor=factor)) < 1 - EXPLAINED
        ):  # fmt: skip
            raise error("tumble.unit", factor=f"{factor:.4g}", likely=_likely_rate(factor, log))
    if motion is None:
        return []  # it turns too far from row to row to say more
    now = min(motion.left(Mistake()), 1.0)
    tried = [Mistake(exchange=exchange) for exchange in exchanges()]
    seen = explain(motion.left, tried, wrong=MORE, fits=min(right, now - MORE), now=now)
    own = f"{100 * (1 - now):.0f}"
    if seen.by:
        E = seen.by[0].exchange
        raise error("tumble.axes", seen=_named(E), share=f"{100 * (1 - seen.least):.0f}", own=own,
                    more=_as_readings(E))  # fmt: skip
    _check_parts(log, motion)
    return [finding("tumble.motion", own=own)]


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
    first, last = motion.rows[:-1][told], motion.rows[1:][told]
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


def _likely_rate(factor: float, log: Log) -> str:
    """Say what makes a command too small by a factor: unit, increments, or both."""
    known = factors("gyro", log.interval)
    known[log.interval / DEGREE] = f"{SUMS}, and deg as rad"
    known[log.interval * DEGREE] = f"{SUMS}, and rad as deg"
    return likely(1 / factor, known) or "unit or scale"


def _named(exchange: FloatArray) -> str:
    return f"({', '.join(columns(exchange))})"


def _as_readings(exchange: FloatArray) -> str:
    """Say which columns of the accelerometers would look the same.

    ``M f`` turns as ``det(M) M w`` says, so that no mirrored command does.
    """
    if np.linalg.det(exchange) < 0:
        return ""
    return f", or the readings were {_named(exchange.T)} or {_named(-exchange.T)}"
