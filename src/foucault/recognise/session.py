"""What was done with the instrument while the log was taken, and which procedure calibrates it.

Rests, the directions of gravity in them, and what was turned in between tell a session: at rest all
the time, on the six faces of a cube, in free orientations, on a table whose angles are logged, in
steady spins, at a list of rates about one axis after another, or in a vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.detect.steady import find_spins, grouped, turning
from foucault.detect.stretches import FEW, HAND, Rests, find_rests, means_of, runs, slowest
from foucault.models.earth import EARTH_RATE
from foucault.recognise.physics import sphere
from foucault.recognise.units import USUAL
from foucault.tables import AXES, Log

TODO: dict[str, str] = USUAL["todo"]
"""What to do with a session that no procedure calibrates."""

ON_FACE = np.radians(8.0)
"""A rest is on a face within this, bias and placement included [rad]."""

SAME = np.radians(12.0)
"""Directions that differ by less are one [rad]."""

NEEDED = 9
"""Orientations that calibrate accelerometers by gravity alone [1]."""

SEQUENCE = 12
"""Rests of a sequence on a table at least [1]."""

TWICE_EARTH = 2.2 * EARTH_RATE
"""Means at rest of gyros differ by no more, turned round against the Earth [rad/s]."""

STEADY = np.radians(2.0)
"""A quiet time that turns so fast or faster is a spin [rad/s]."""

SPIN, FEWEST_SPINS = (2.0, np.radians(35.0)), 4
"""Shortest [s] and slowest [rad/s] spin about a level axis, and the fewest of them [1]."""

TUMBLING = 0.3  # A body that is tumbled turns faster [rad/s].

SURELY, LIKELY = (0.7, 0.6, 0.0), (0.2, 0.4, 4 * np.pi)
"""So much of the time [1], and the field goes along each axis by so much of what it does along
another [1], and it turns by so much [rad]; the latter where nothing else could be calibrated, for
breaks and a magnet that is taken away."""

WHOLE = np.radians(25.0)
"""A turn on the spot is a whole one within this [rad]."""


@dataclass(frozen=True)
class Session:
    """What a log holds, and what to do with it."""

    what: str  # in words
    why: str
    procedure: str | None  # that calibrates it, None where none does
    settings: dict[str, Any] = field(default_factory=dict)  # of [procedure]
    sure: str = "sure"
    todo: str = ""  # where no procedure does
    rests: int = 0  # of the log [1]


def session(log: Log) -> Session:
    """Tell what a log holds; `log`: readings [SI]."""
    found = _session(log)
    return found if found.procedure else _tumbled(log, *LIKELY) or found


def _session(log: Log) -> Session:
    if log.table is not None:
        return _on_table(log)
    if log.averaged is not None:
        return Session(f"{len(log)} means, each of one position", "the file has a length of each",
                       "norm_observation" if _spins_of(log) else "hand_rotated")  # fmt: skip
    if log.accel is None:
        return Session("gyros alone", "no accelerometers", None, todo=TODO["noise"])
    level = _level_spins(log) or _tumbled(log, *SURELY)
    if level is not None:
        return level
    rests = find_rests(log.filled())
    spins = _spins(log, rests)
    if len(spins) >= 4:
        return _spun(log, rests, spins)
    if not len(rests):
        return Session("motion all the time", "nothing rests", None, todo=TODO["rest_first"])
    up, tilt, around = _directions(log, rests)
    at_rest = float(np.sum(rests.last - rests.first)) / len(log)
    count = len(around)
    said = f"{len(rests)} rest{'s' * (len(rests) != 1)} in {count} " \
        f"orientation{'s' * (count != 1)}"  # fmt: skip
    if count == 1 and at_rest > 0.7 and _moves(log):
        return Session("motion all the time", "nothing rests", None, todo=TODO["rest_first"])
    if count == 1 and at_rest > 0.7:
        return Session("one rest", f"{100 * at_rest:.0f} % of it, gravity from one side", None,
                       todo=TODO["one_rest"], rests=len(rests))  # fmt: skip
    faces = _faces(up)
    on_faces = float(np.mean(tilt < ON_FACE))
    if len(faces) == 6 and on_faces > 0.85:
        return _of_faces(log, rests, up, said)
    if count >= NEEDED:
        why = f"gravity from {count} sides, {100 * at_rest:.0f} % of the time at rest"
        return Session(f"{said}, turned in between", why, "hand_rotated", rests=len(rests))
    if len(faces) == 6:
        return Session(f"{said}, near the six faces", f"tilted by {np.degrees(np.median(tilt)):.0f}"
                       " deg", "six_position", sure="likely", rests=len(rests))  # fmt: skip
    return Session(said, f"a calibration needs gravity from {NEEDED} sides, or on all six faces",
                   None, todo=TODO["more_rest"] if len(rests) > 2 else TODO["rest_first"],
                   rests=len(rests))  # fmt: skip


def _tumbled(log: Log, most: float, around: float, least: float) -> Session | None:
    """Return that of a magnetometer that was turned about all axes, if it is one.

    `most`: share of the time that it turns, `around`: of the field along each axis [1]; `least`:
    angle that it turns by [rad].
    """
    if log.mag is None or log.gyro is None or np.isnan(log.gyro).any() or not len(log):
        return None
    rate = np.linalg.norm(log.gyro - slowest(log.gyro), axis=1)
    size = np.ptp(np.percentile(log.mag, (2, 98), axis=0), axis=0)
    moving = rate > TUMBLING
    turning, angle = float(np.mean(moving)), float(np.mean(rate * moving)) * log.duration
    if turning < most or not size.min() > around * size.max() or angle < least:
        return None
    turned = np.degrees(rate.mean() * log.duration)
    return Session(f"turned about all axes, by {turned:.0f} deg in all, beside a magnetometer",
                   f"the field came along all axes, {100 * turning:.0f} % of the time it turned",
                   "magnetometer", sure="likely" if least else "sure")  # fmt: skip


def _moves(log: Log) -> bool:
    """Tell whether gravity or the mean rate changes though no part of a log is quieter."""
    assert log.accel is not None
    step = max(1, round(log.rate))
    rows = len(log) // step * step
    force = log.accel[:rows].reshape(-1, step, 3).mean(axis=1)
    if len(force) < 3:
        return False
    return bool(force.std(axis=0).max() > 0.03 * np.linalg.norm(force, axis=1).mean())


def _directions(log: Log, rests: Rests) -> tuple[FloatArray, FloatArray, list[int]]:
    """Return up at each rest (n, 3), its tilt from the nearest face, and one rest of each side."""
    assert log.accel is not None
    f = means_of(log.accel, rests.spans)
    ball = sphere(f, (0, 1, 2))
    centre = np.zeros(3)
    if ball is not None and ball.spread > 0.7 and np.linalg.norm(ball.centre) < 0.3 * ball.radius:
        centre = ball.centre
    up = (f - centre) / np.linalg.norm(f - centre, axis=1, keepdims=True)
    tilt = np.arccos(np.clip(np.abs(up).max(axis=1), 0.0, 1.0))
    apart: list[int] = []
    for i, u in enumerate(up):
        if all(np.arccos(np.clip(u @ up[j], -1, 1)) > SAME for j in apart):
            apart.append(i)
    return up, tilt, apart


def _faces(up: FloatArray) -> set[tuple[int, int]]:
    axis = np.abs(up).argmax(axis=1)
    return {(int(a), int(np.sign(u[a]))) for a, u in zip(axis, up, strict=True)}


def _of_faces(log: Log, rests: Rests, up: FloatArray, said: str) -> Session:
    """Tell rests on faces from those with whole turns about each axis between them."""
    turned = _whole_turns(log, rests, up)
    if len(turned) == 3:
        angles = [turned[i] for i in range(3)]
        one = angles[0] if len(set(angles)) == 1 else None
        degrees = [f"{np.degrees(a):.0f} deg" for a in angles]
        told = degrees[0] if one is not None else ", ".join(degrees)
        return Session(
            f"{said} on the six faces, and a turn of {told} about each axis",
            "a rest before and after each turn has gravity from one side", "ferraris",
            {"angle": degrees[0] if one is not None else degrees}, rests=len(rests),
        )  # fmt: skip
    if len(rests) >= SEQUENCE and _sees_earth(log, rests):
        return Session(f"{said} on the six faces, turned by a table",
                       "gyros whose means at rest agree to the rate of the Earth", "systematic",
                       sure="likely", rests=len(rests))  # fmt: skip
    return Session(f"{said} on the six faces", "gravity along each axis, both ways",
                   "six_position", rests=len(rests))  # fmt: skip


def _sees_earth(log: Log, rests: Rests) -> bool:
    """Tell whether rests are long, and the gyros' means in them those of a good instrument."""
    if log.gyro is None or float(np.median(rests.last - rests.first)) * log.interval < 15.0:
        return False
    rate = means_of(log.gyro, rests.spans)
    return bool(np.linalg.norm(rate - np.median(rate, axis=0), axis=1).max() < TWICE_EARTH)


def _whole_turns(log: Log, rests: Rests, up: FloatArray) -> dict[int, float]:
    """Return the axes about which it was turned on the spot, and by which whole turns [rad]."""
    if log.gyro is None or len(rests) < 2:
        return {}
    bias = np.median(means_of(log.gyro, rests.spans), axis=0)
    found: dict[int, float] = {}
    steps = np.diff(log.time, append=log.time[-1])
    for j in range(len(rests) - 1):
        if up[j] @ up[j + 1] < np.cos(SAME):
            continue
        rows = slice(int(rests.last[j]) - 1, int(rests.first[j + 1]) + 1)
        angle = ((log.gyro[rows] - bias) * steps[rows, None]).sum(axis=0)
        axis = int(np.abs(up[j]).argmax())
        # About the positive axis, whichever way up it is.
        turns = angle[axis] / (2 * np.pi)
        across = np.abs(np.delete(angle, axis)).max()
        whole = round(float(turns))
        if whole and abs(turns - whole) * 2 * np.pi < WHOLE * abs(whole) and across < 0.5:
            found.setdefault(axis, 2 * np.pi * whole)
    return found


# -- spins and rates -----------------------------------------------------------------------------


def _spins(log: Log, rests: Rests) -> list[tuple[int, int, FloatArray]]:
    """Return quiet times of steady rotation: first row, the one after the last, mean rate."""
    if log.gyro is None or not np.isfinite(log.gyro).all():
        return []
    fewest = HAND.fewest(log.rate) * 3
    quiet, last = runs(rests.level < 4 * max(rests.threshold, 1.0), fewest)
    out = []
    still = means_of(log.gyro, rests.spans) if len(rests) else np.zeros((1, 3))
    bias = np.median(still, axis=0)
    for a, b in zip(quiet.tolist(), last.tolist(), strict=True):
        rate = log.gyro[a:b].mean(axis=0) - bias
        ends = (
            log.gyro[a : a + fewest // 3].mean(axis=0),
            log.gyro[b - fewest // 3 : b].mean(axis=0),
        )
        steady = np.linalg.norm(ends[0] - ends[1]) < 0.05 * np.linalg.norm(rate)
        turned = np.linalg.norm(rate) * (b - a) * log.interval
        if np.linalg.norm(rate) > STEADY and steady and turned > np.pi:
            out.append((a, b, np.asarray(rate)))
    return out if len(rests.level) >= FEW else []


def _level_spins(log: Log) -> Session | None:
    """Tell spins about a level axis, in which gravity turns as fast as the gyros say."""
    both = log.gyro, log.accel
    if any(x is None or not np.isfinite(x).all() for x in both):
        return None
    spins = [s for s in find_spins(log, *SPIN) if 0.8 < turning(s) < 1.25]
    spins, axes = grouped(spins, SAME / 2)
    if len(spins) < FEWEST_SPINS:
        return None
    rates = ", ".join(f"{s.rate:.2g}" for s in spins[:6]) + " ..." * (len(spins) > 6)
    many = f"{len(axes)} ax{'es' if len(axes) > 1 else 'is'} of the instrument"
    return Session(f"{len(spins)} spins about {many}, level ({rates} rad/s)",
                   "gravity turns in the accelerometers as fast as the gyros say",
                   "continuous_spin")  # fmt: skip


def _spun(log: Log, rests: Rests, spins: list[tuple[int, int, FloatArray]]) -> Session:
    """Tell a rate staircase from spins in many positions; the table's rates are round ones."""
    assert log.accel is not None
    up = np.array([log.accel[a:b].mean(axis=0) for a, b, _ in spins])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    along = np.array([rate @ u for (_, _, rate), u in zip(spins, up, strict=True)])
    told = [_round(np.degrees(rate)) for rate in along]
    levels = sorted({abs(rate) for rate in told})
    shown = ", ".join(f"{v:g}" for v in levels[:6]) + (" ..." * (len(levels) > 6))
    seen = f"quiet times that turn, rounded: gyros say {np.degrees(np.abs(along[0])):.4g} first"
    if len(levels) < 3:
        up, tilt, around = _directions(log, rests)
        on_faces = len(_faces(up)) == 6 and float(np.mean(tilt < ON_FACE)) > 0.85
        if on_faces and len(spins) < NEEDED and len(_whole_turns(log, rests, up)) == 3:
            return _of_faces(log, rests, up, f"{len(rests)} rests in {len(around)} orientations")
        return Session(
            f"{len(rests)} rests, and {len(spins)} spins at {shown} deg/s", seen,
            "norm_observation", {"spin_rate": f"{told[0]:g} deg/s"}, "assumed", rests=len(rests),
        )  # fmt: skip
    placed = _placements(told, up)
    if isinstance(placed, str):
        return Session(f"{len(spins)} steady rates ({shown} deg/s)", seen, None, todo=placed,
                       rests=len(rests))  # fmt: skip
    rates, axes = placed
    return Session(
        f"{len(axes)} placements at {len(rates)} rates each ({shown} deg/s)", seen, "rate_table",
        {"rates": [f"{rate:g} deg/s" for rate in rates], "axes": axes}, "assumed",
        rests=len(rests),
    )  # fmt: skip


def _placements(told: list[float], up: FloatArray) -> tuple[list[float], list[str]] | str:
    """Return the rates of each placement and which axis is up in each; what to do if they differ.

    `told` (n,): rate of each spin about what is up [deg/s]; `up` (n, 3): that [1].
    """
    axis = np.abs(up).argmax(axis=1)
    names = [f"{AXES[a]} {'up' if u[a] > 0 else 'down'}" for a, u in zip(axis, up, strict=True)]
    begins = [0, *(i for i in range(1, len(names)) if names[i] != names[i - 1]), len(names)]
    lists = [told[a:b] for a, b in pairwise(begins)]
    placed = [names[a] for a in begins[:-1]]
    round_ = [name for name, one in zip(placed, lists, strict=True)
              if one != lists[0] and one == [-rate for rate in lists[0]]]  # fmt: skip
    if round_ and all(one == lists[0] or name in round_
                      for name, one in zip(placed, lists, strict=True)):  # fmt: skip
        return TODO["signs"].format(axes=", ".join(round_))
    if any(one != lists[0] for one in lists):
        return TODO["rates"]
    return lists[0], placed


def _round(rate: float) -> float:
    """Return the roundest number near a rate that gyros tell [deg/s]."""
    size = abs(rate)
    top = 10.0 ** np.floor(np.log10(size))
    for step in (5.0, 2.5, 2.0, 1.0, 0.5, 0.25, 0.1):
        near = max(1.0, round(size / (step * top))) * step * top
        if abs(near / size - 1.0) < 0.03:
            return float(np.copysign(near, rate))
    return float(f"{rate:.4g}")


def _levels(size: FloatArray) -> list[float]:
    out: list[float] = []
    for value in np.sort(size):
        if not out or value > 1.1 * out[-1]:
            out.append(float(value))
    return out


def _spins_of(log: Log) -> bool:
    """Tell whether means hold spins."""
    return log.gyro is not None and bool((np.linalg.norm(log.gyro, axis=1) > STEADY).sum() >= 4)


def _on_table(log: Log) -> Session:
    """Tell a list of rates from positions, where the angles or the rate of a table are logged."""
    table = log.table
    assert table is not None
    rate = table.rate
    if rate is not None:
        steady = rate[np.isfinite(rate) & (np.abs(rate) > STEADY)]
        levels = _levels(np.round(np.abs(steady), 4)) if len(steady) else []
        often = [v for v in levels if np.mean(np.abs(np.abs(steady) / v - 1) < 0.03) > 0.02]
        if len(often) >= 3:
            return Session(f"{len(often)} rates of a table", "its rate is logged", "rate_table")
    if np.isfinite(table.angles).any(axis=0).sum() >= 2:
        return Session("positions of a table", "its angles are logged", "turntable")
    return Session("positions on a table", "its rate or position is logged", "norm_observation")
