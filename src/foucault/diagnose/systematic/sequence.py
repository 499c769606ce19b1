"""Compare the rests and turns of a log with the sequence that was to be done.

Turns are compared by axis in the body and by angle, one by one. Where they do not agree, all ways
to exchange the axes that the sequence names, and to turn them the other way, are tried; if one
explains every turn, it is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.systematic.rests import FoundSequence, Move
from foucault.errors import Finding, error, finding
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import TABLE_AXES, Rotate
from foucault.plans.systematic.built_in import BUILT_IN
from foucault.plans.systematic.sequence import CalibrationSequence, Position, pointing
from foucault.tables import AXES

START = np.radians(20.0)
"""The first rest may lean this far from its declared orientation [rad]."""

AXIS = np.radians(8.0)
"""The axis of a turn may be this far from its declared one [rad]."""

ANGLE = (np.radians(1.5), 0.03)
"""Its angle may be off by this, and by this part of it [rad], [1]."""

HEADING = np.radians(5.0)
"""A declared heading may be this far off before it is said [rad]."""


@dataclass(frozen=True)
class Matched:
    """A log against its sequence."""

    positions: tuple[Position, ...]  # the rests of the sequence that the log has
    rests: npt.NDArray[np.int64]  # (m,) the number of the rest of the log that each of them is
    # (k,) angle of each turn as the gyros say, minus the one of the sequence [rad]
    angle_err: FloatArray
    # (k,) angle between the axis of each turn and the one of the sequence [rad]
    axis_err: FloatArray
    findings: tuple[Finding, ...]

    @classmethod
    def joined(cls, parts: Sequence[Matched]) -> Matched | None:
        """Return recordings against their sequences as one; None for none."""
        if len(parts) < 2:
            return parts[0] if parts else None
        return cls(
            tuple(p for part in parts for p in part.positions),
            np.concatenate([part.rests for part in parts]),
            np.concatenate([part.angle_err for part in parts]),
            np.concatenate([part.axis_err for part in parts]),
            tuple(f for part in parts for f in part.findings),
        )  # fmt: skip


def match_sequence(found: FoundSequence, sequence: CalibrationSequence) -> Matched:
    """Check that a log is one of `sequence`, and say which rest is which.

    Raises the start, the number of turns, their axes or their angles are not those of the
    sequence.
    """
    _check_start(found, sequence)
    _check_moves(found, sequence)
    axis_err, angle_err = _misses(found.moves, *_told(sequence))
    positions, rests, notes = _rests(found, sequence)
    return Matched(positions, rests, angle_err, axis_err, (*_heading(found, sequence), *notes))


def recognised(found: FoundSequence) -> str | None:
    """Return the name of the built-in sequence whose turns a log has, None if there is none."""
    for name, make in BUILT_IN.items():
        if _fits(found.moves, make()):
            return name
    return None


def _check_start(found: FoundSequence, sequence: CalibrationSequence) -> None:
    up, declared = found.accel[0] / np.linalg.norm(found.accel[0]), sequence.start[2]
    angle = float(np.arccos(np.clip(up @ declared, -1.0, 1.0)))
    if angle > START:
        raise error(
            "systematic.start", name=sequence.name, declared=", ".join(pointing(sequence.start)),
            up=_along(declared), measured=_along(up), angle=f"{np.degrees(angle):.0f}",
        )  # fmt: skip


def _check_moves(found: FoundSequence, sequence: CalibrationSequence) -> None:
    moves = found.moves
    if _fits(moves, sequence):
        return
    off_by = _heading_off(found, sequence)
    if off_by is not None:
        turned = replace(sequence, start=exp(np.array([0.0, 0.0, -off_by[0]])) @ sequence.start)
        if _fits(moves, turned):
            more, sd = (np.degrees(x) for x in off_by)
            raise error("systematic.heading_start", name=sequence.name, angle=f"{more:+.1f}",
                        sd=f"{sd:.2g}")  # fmt: skip
    for words, other in _relabelled(sequence) if len(moves) == len(sequence.moves) else ():
        if _fits(moves, other):
            raise error("systematic.axes", name=sequence.name, words=words)
    axis, angle = _told(sequence)
    n = min(len(angle), len(moves))
    off = np.flatnonzero(_off(*_misses(moves[:n], axis[:n], angle[:n]), angle[:n]))
    number = int(off[0]) if len(off) else n
    if len(moves) != len(angle):
        first = "Up to the end of the shorter one they agree."
        if len(off):
            at = moves[number]
            first = (
                f"The first that differs is turn {number + 1}, at {at.start:.1f} s in the log: "
                f"{_said(at.axis_b, at.angle)}."
            )
        raise error(
            "systematic.count", name=sequence.name, declared=len(angle), given=len(moves),
            first=first,
        )  # fmt: skip
    at, k = moves[number], sequence.moves[number]
    action = sequence.actions[k]
    assert isinstance(action, Rotate)
    raise error(
        "systematic.move", number=number + 1, name=sequence.name, time=f"{at.start:.1f}",
        action=f"action {k + 1}, {np.degrees(action.angle):.5g} deg about {action.axis}",
        declared=_said(axis[number], angle[number]), measured=_said(at.axis_b, at.angle),
    )  # fmt: skip


def _told(sequence: CalibrationSequence) -> tuple[FloatArray, FloatArray]:
    """Return axes of the turns, counter-clockwise, shape (k, 3), and angles, (k,) [rad]."""
    some = [(sequence.axis_b[k], sequence.actions[k]) for k in sequence.moves]
    turns = [(axis, a.angle) for axis, a in some if isinstance(a, Rotate)]
    axes = np.array([np.sign(angle) * axis for axis, angle in turns]).reshape(-1, 3)
    return axes, np.array([abs(angle) for _, angle in turns])


def _misses(
    moves: tuple[Move, ...], axis: FloatArray, angle: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return by how much axes and angles of turns miss, shape (k,) each [rad]."""
    found = np.array([m.axis_b for m in moves]).reshape(-1, 3)
    cosine = np.einsum("ki,ki->k", axis, found)
    return np.arccos(np.clip(cosine, -1.0, 1.0)), np.array([m.angle for m in moves]) - angle


def _off(axis: FloatArray, angle: FloatArray, declared: FloatArray) -> npt.NDArray[np.bool_]:
    limit = ANGLE[0] + ANGLE[1] * np.abs(declared)
    return np.asarray((axis > AXIS) | (np.abs(angle) > limit))


def _fits(moves: tuple[Move, ...], sequence: CalibrationSequence) -> bool:
    if len(moves) != len(sequence.moves):
        return False
    axis, angle = _told(sequence)
    return not _off(*_misses(moves, axis, angle), angle).any()


def _relabelled(sequence: CalibrationSequence) -> Iterator[tuple[str, CalibrationSequence]]:
    """Yield the sequence with its axes exchanged or reversed, few changes first, in words."""
    used = tuple(sequence.turned)
    orders = [*permutations(TABLE_AXES, len(used))]
    # One axis taken for another that is used as well: a spin about east in place of north.
    orders += [
        tuple(axis if name == wrong else name for name in used)
        for wrong, axis in product(used, TABLE_AXES)
    ]
    ways = [
        dict(zip(used, zip(order, signs, strict=True), strict=True))
        for order, signs in product(orders, product((1.0, -1.0), repeat=len(used)))
    ]
    for way in sorted(ways, key=lambda w: sum(2 * (a != b) + (s < 0) for a, (b, s) in w.items())):
        words = [
            f"{'minus ' if sign < 0 else ''}{axis} where it says {name}"
            for name, (axis, sign) in way.items()
            if axis != name or sign < 0
        ]
        actions = tuple(
            replace(a, axis=way[a.axis][0], angle=way[a.axis][1] * a.angle)
            if isinstance(a, Rotate) else a
            for a in sequence.actions
        )  # fmt: skip
        if words:
            yield ", ".join(words), replace(sequence, actions=actions)


def _rests(
    found: FoundSequence, sequence: CalibrationSequence
) -> tuple[tuple[Position, ...], npt.NDArray[np.int64], list[Finding]]:
    """Give each rest of the sequence the one of the log with as many turns before it."""
    before = np.array([sum(m.after < k for m in found.moves) for k in range(len(found.rests))])
    positions, rests, notes = [], [], []
    for position in sequence.positions:
        same = np.flatnonzero(before == position.moves)
        if len(same):
            positions.append(position)
            rests.append(int(same[np.argmax((found.rests.last - found.rests.first)[same])]))
        else:
            notes.append(
                finding(
                    "systematic.rest_missing", label=position.label, name=sequence.name,
                    moves=position.moves,
                )
            )  # fmt: skip
    return tuple(positions), np.array(rests, np.int64), notes


def _heading(found: FoundSequence, sequence: CalibrationSequence) -> list[Finding]:
    """Say where the declared heading is not the one that the Earth's rate shows."""
    off_by = _heading_off(found, sequence)
    if off_by is None:
        return []
    angle, sd = (np.degrees(x) for x in off_by)
    return [finding("systematic.heading", angle=f"{angle:+.1f}", sd=f"{sd:.2g}")]


def _heading_off(found: FoundSequence, sequence: CalibrationSequence) -> tuple[float, float] | None:
    """Return by how much the heading at the start is more than declared, and its sd [rad]."""
    if found.earth_b is None or found.earth_cov is None:
        return None
    east, north, _ = sequence.start @ found.earth_b
    cov = (sequence.start @ found.earth_cov @ sequence.start.T)[:2, :2]
    level = float(np.hypot(east, north))
    across = np.array([north, -east]) / max(level, 1e-300)
    sd = float(np.sqrt(across @ cov @ across)) / max(level, 1e-300)
    angle = float(np.arctan2(-east, north))
    return None if abs(angle) <= max(HEADING, 4.0 * sd) else (angle, sd)


def _said(axis: FloatArray, angle: float) -> str:
    return f"{np.degrees(angle):.1f} deg about {_along(axis)}"


def _along(direction: FloatArray) -> str:
    """Say which axis of the body a direction is along."""
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) > np.cos(AXIS):
        return ("minus " if direction[k] < 0 else "") + AXES[k]
    return "(" + ", ".join(f"{x:.2f}" for x in direction) + ") in body axes"
