"""Compare the rests and turns of a log with the sequence that was to be done.

Turns are compared by axis in the body and by angle, one by one. Where they do not agree, all ways
to exchange the axes that the sequence names, and to turn them the other way, are tried; if one
explains every turn, it is named.

Several recordings of one instrument: what its biases were in each, and whether that can be.

Of n recordings the bias of each is ``b + e_k``, ``e_k`` of standard deviation r: the
repeatability from one switch-on to the next. Differences ``d = D e`` with ``D D' = I`` have
covariance r^2 before the session, and ``r^2 (1 - L)`` after it. Along an eigenvector of L, with its
eigenvalue l, readings alone say ``y = d / l``, of variance ``r^2 / l``: ``sum l y^2 / r^2`` is
chi-square if r is right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.detect.sequence import FoundSequence, Move
from foucault.diagnose.checks import check
from foucault.errors import Finding, error, finding
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models.ins_errors import TURN_ON
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import TABLE_AXES, Rotate
from foucault.plans.sequence import BUILT_IN, CalibrationSequence, Position, pointing
from foucault.result import Check
from foucault.tables import AXES
from foucault.units import plain

START = np.radians(20.0)  # The first rest may lean this far from its declared orientation [rad].
AXIS = np.radians(8.0)  # The axis of a turn may be this far from its declared one [rad].
ANGLE = (np.radians(1.5), 0.03)  # Its angle may be off by this, and by this part of it [rad], [1].
HEADING = np.radians(5.0)  # A declared heading may be this far off before it is said [rad].


@dataclass(frozen=True)
class Matched:
    """A log against its sequence."""

    positions: tuple[Position, ...]  # the rests of the sequence that the log has
    rests: IntArray  # (m,) the number of the rest of the log that each of them is
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
        )


def match_sequence(found: FoundSequence, sequence: CalibrationSequence) -> Matched:
    """Check that a log is one of `sequence`, and say which rest is which.

    Raises the start, the number of turns, their axes or their angles are not those of the
    sequence.
    """
    up, declared = found.accel[0] / np.linalg.norm(found.accel[0]), sequence.start[2]
    angle = float(np.arccos(np.clip(up @ declared, -1.0, 1.0)))
    if angle > START:
        raise error(
            "systematic.start", name=sequence.name, declared=", ".join(pointing(sequence.start)),
            up=_along(declared), measured=_along(up), angle=f"{np.degrees(angle):.0f}",
        )  # fmt: skip
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


def _off(axis: FloatArray, angle: FloatArray, declared: FloatArray) -> BoolArray:
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
) -> tuple[tuple[Position, ...], IntArray, list[Finding]]:
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


SEEN = 1e-7
"""A difference that a session tells less of than this is not seen, but for rounding [1]."""

EACH = FALSE_ALARM / 8  # False-alarm rate of the check, as of the others of the session [1].

SAID = {"gyro": (np.radians(1.0) / 3600.0, "deg/h"), "accel": (9.80665e-6, "ug")}
"""Unit that biases of each triad are told in [SI], and its name."""


def lasting(states: CoefficientVector) -> CoefficientVector:
    """Return the coefficients that all recordings have in common [SI]."""
    return states.chosen(n for n in states.names if f".{TURN_ON}" not in n)


@dataclass(frozen=True)
class Between:
    """What the biases of one triad differ by between recordings."""

    triad: str
    declared: float  # by what was declared: standard deviation of each [SI]
    count: int  # number of recordings [1]
    apart: FloatArray  # (k,) differences that the readings alone tell [SI]
    variance: FloatArray  # (k,) their variances, but for the repeatability [SI^2]

    def square(self, sd: float) -> float:
        """Return the sum of squared differences over a repeatability `sd` [SI], squared [1]."""
        return float(np.sum(self.apart**2 / (self.variance + sd**2)))

    @property
    def share(self) -> float:
        """Sum of squares with what was declared, over what it stays below but for chance [1]."""
        if not len(self.apart):
            return 0.0
        return self.square(self.declared) / chi_square_limits(len(self.apart), 2 * EACH)[1]

    @property
    def scatter(self) -> float:
        """The repeatability that explains the differences; 0 where noise does [SI]."""
        from scipy.optimize import brentq

        n = len(self.apart)
        most = float(np.sqrt(np.sum(self.apart**2)))
        if not n or self.square(0.0) <= n:
            return 0.0
        return float(brentq(lambda sd: self.square(sd) - n, 0.0, most, xtol=1e-6 * most))


def between(states: CoefficientVector, triad: str, declared: float, count: int) -> Between:
    """Compare the biases of `count` recordings [1] with what was `declared` of them [SI]."""
    e = states.chosen(f"{triad}.{TURN_ON}{k}.{axis}" for k in range(1, count + 1) for axis in AXES)
    assert e.cov is not None
    apart = np.linalg.svd(np.ones((1, count)))[2][1:]
    D = np.kron(apart, np.eye(3))
    told, ways = np.linalg.eigh(np.eye(len(D)) - D @ e.cov @ D.T / declared**2)
    seen = told > SEEN
    told, y = told[seen], (ways.T @ D @ e.values)[seen]
    return Between(triad, declared, count, y / told, declared**2 * (1.0 / told - 1.0))


def recordings_check(some: list[Between]) -> Check:
    """Return the check `switch-on`: do the biases of the recordings agree as they should?"""
    each = [
        f"those of the {b.triad} scatter by {_in_unit(b, b.scatter)}, and "
        f"{b.triad}_bias_repeatability is {_in_unit(b, b.declared)}" for b in some if b.share > 1.0
    ]  # fmt: skip
    given = {"each": "; ".join(each)}
    return check("recordings", "switch-on", max(b.share for b in some), None, 1.0, given)


def told(some: list[Between]) -> Finding:
    """Say whose biases are reported."""
    return finding("systematic.recordings", count=some[0].count,
                   declared=" and ".join(_in_unit(b, b.declared) for b in some))  # fmt: skip


def summary(
    states: CoefficientVector, some: list[Between], times: list[tuple[float, float]]
) -> dict[str, Any]:
    """Return each recording's biases [SI], `times`: begin and end [s], for result.json."""
    assert states.cov is not None
    out: list[dict[str, Any]] = []
    for k, (start, end) in enumerate(times, 1):
        row: dict[str, Any] = {"start": start, "end": end}
        for b in some:
            mean, own = (
                [states.layout.index(f"{b.triad}.{group}.{axis}") for axis in AXES]
                for group in ("bias", f"{TURN_ON}{k}")
            )
            A = np.zeros((3, len(states)))
            A[range(3), mean] = A[range(3), own] = 1.0
            sd = np.sqrt(np.diag(A @ states.cov @ A.T))
            row[b.triad] = {"bias": (A @ states.values).tolist(), "sd": sd.tolist()}
        out.append(row)
    return {
        "repeatability": {b.triad: b.declared for b in some},
        "scatter": {b.triad: b.scatter for b in some}, "each": out,
    }  # fmt: skip


def _in_unit(b: Between, value: float) -> str:
    size, unit = SAID[b.triad]
    return f"{plain(value / size, 3)} {unit}"
