"""Find turns by known angles about the case axes: between rests on one face, or in sections.

Two rests on the same face with a net rotation by the declared angle about one axis between them,
or by two or three times as much, are a turn on the spot; after whole turns they are one placement.
A turn must have the sense and the size that was declared, for the sign of a gyro and its scale
factor cannot be told from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.faces.rests import TURN_SECTIONS, Faces, Sections
from foucault.errors import FoucaultError, error
from foucault.models.faces import TurnReadings
from foucault.tables import AXES, Log

TOLERANCE = 0.12
"""A turn is whole if it measures this near to the declared angle: a gyro may be 10 % off [1]."""

SIDEWAYS = np.radians(20.0)
"""A turn about another direction than this near an axis is about no axis [rad]."""

BUMP = np.radians(45.0)
"""A smaller rotation between two rests on one face is no turn [rad]."""

MOST = 3
"""So many times the declared angle may have been turned at once [1]."""


WHOLE = 1e-6
"""An angle this near to whole turns is whole turns [1]."""


def is_whole(angle: float) -> bool:
    """Tell whether an angle is one or more whole turns.

    `angle`: what was turned [rad].
    """
    turns = abs(angle) / (2 * np.pi)
    return round(turns) > 0 and abs(turns - round(turns)) <= WHOLE


@dataclass(frozen=True)
class _Candidate:
    first: int
    last: int
    net: FloatArray
    up_k: FloatArray
    group: int
    after: int = -1  # the rest that follows and is the same placement
    before: int = -1
    section: str = ""

    @property
    def axis(self) -> int:
        return int(np.abs(self.net).argmax())

    @property
    def size(self) -> float:
        return float(self.net[self.axis])

    @property
    def sideways(self) -> float:
        across = np.linalg.norm(np.delete(self.net, self.axis))
        return float(np.arctan2(across, abs(self.size)))

    def times(self, angles: FloatArray) -> int:
        """How many times the declared angle it is, 0 where it is no whole number of them."""
        ratio = abs(self.size / angles[self.axis])
        k = int(np.clip(np.round(ratio), 1, MOST))
        return k if abs(ratio / k - 1) <= TOLERANCE else 0

    def turned(self, angles: FloatArray) -> float:
        """Return the angle that was turned, were the turn as declared [rad]."""
        return float(self.times(angles) * angles[self.axis])

    def where(self, log: Log) -> str:
        if self.section:
            return f"section {self.section}"
        return f"the movement from {log.time[self.first]:.1f} to {log.time[self.last - 1]:.1f} s"


def find_turns(
    log: Log,
    faces: Faces,
    angle: float | tuple[float, float, float],
    sections: Sections | None = None,
) -> tuple[Faces, TurnReadings]:
    """Find the turns, and join the rests before and after each to one placement.

    `log`: readings with gyros [SI]; `angle`: declared angle of a turn about the positive axis, of
    all or of x, y and z [rad]; `sections` (2,) or None: first sample of each turn and the sample
    after its last, by names such as x_rot. Raises no gyros, no turn about an axis, a turn that is
    not whole, in the other sense, or about another axis.
    """
    if log.gyro is None:
        raise error("turns.no_gyro")
    if log.averaged is not None:
        raise error("turns.means")
    assert faces.readings.gyro is not None
    angles = np.broadcast_to(np.asarray(angle, dtype=float), 3)
    bias = np.average(faces.readings.gyro, axis=0, weights=faces.readings.time)
    if sections is None:
        found = _between(log, faces, bias)
        whole = [c for c in found if c.times(angles) and c.sideways <= SIDEWAYS]
    else:
        found = whole = _sections(log, faces, bias, sections)
        for c in found:
            _as_declared(log, c, angles)
    _complete(log, found, whole, angles)
    _sense(log, whole, angles)
    # A part of a turn leads to another heading, and another side of the support.
    same = [c for c in whole if c.after >= 0 and is_whole(c.turned(angles))]
    faces = faces.joined([(c.before, c.after) for c in same])
    return faces, _readings(log, faces, whole, angles)


def _net(log: Log, a: int, b: int, bias: FloatArray) -> FloatArray:
    assert log.gyro is not None
    return np.asarray((log.gyro[a:b] - bias).sum(axis=0) * log.interval)


def _between(log: Log, faces: Faces, bias: FloatArray) -> list[_Candidate]:
    r, out = faces.readings, []
    for j in np.flatnonzero(faces.adjacent).tolist():
        if not np.array_equal(r.up_k[j], r.up_k[j + 1]):
            continue
        a, b = int(faces.last[j]), int(faces.first[j + 1])
        net = _net(log, a, b, bias) if b - a > 1 else np.zeros(3)
        if np.abs(net).max() >= BUMP:
            group = int(r.group[j])
            out.append(_Candidate(a, b, net, r.up_k[j], group, after=j + 1, before=j))
    return out


def _sections(log: Log, faces: Faces, bias: FloatArray, sections: Sections) -> list[_Candidate]:
    missing = [name for name in TURN_SECTIONS if name not in sections]
    if missing:
        raise error("turns.section_missing", missing=", ".join(missing))
    out = []
    for k, name in enumerate(TURN_SECTIONS):
        a, b = sections[name]
        up, group = _up(log, faces, a, b), len(faces.readings) + k
        out.append(_Candidate(a, b, _net(log, a, b, bias), up, group, section=name))
    return out


def _up(log: Log, faces: Faces, a: int, b: int) -> FloatArray:
    """Return the face that is up when a section starts: of its mean where that is clear."""
    assert log.accel is not None
    r = faces.readings
    means = [r.accel[(r.axis == i) & (r.sign == s)].mean(axis=0) for i in range(3) for s in (1, -1)]
    centre, size = np.mean(means, axis=0), np.linalg.norm(np.ptp(means, axis=0)) / np.sqrt(12)
    mean = log.accel[a:b].mean(axis=0) - centre
    if np.linalg.norm(mean) < 0.7 * size:  # about a level axis: gravity goes round
        mean = log.accel[a : a + 5].mean(axis=0) - centre
    axis = int(np.abs(mean).argmax())
    return np.asarray(np.eye(3)[axis] * np.sign(mean[axis]))


def _as_declared(log: Log, c: _Candidate, angles: FloatArray) -> None:
    """Refuse a section that is not the turn its name says."""
    if abs(c.size) >= BUMP and (c.sideways > SIDEWAYS or AXES[c.axis] != c.section[0]):
        raise error(
            "turns.axis", where=c.where(log), axis=c.section[0],
            measured=", ".join(f"{np.degrees(v):.0f}" for v in c.net),
        )  # fmt: skip
    if not c.times(angles):
        raise _partial(log, c, angles)


def _partial(log: Log, c: _Candidate, angles: FloatArray) -> FoucaultError:
    declared = abs(np.degrees(angles[c.axis]))
    return error(
        "turns.partial", where=c.where(log), axis=AXES[c.axis],
        measured=f"{abs(np.degrees(c.size)):.0f}", declared=f"{declared:.0f}",
    )  # fmt: skip


def _complete(
    log: Log, found: list[_Candidate], whole: list[_Candidate], angles: FloatArray
) -> None:
    missing = [a for a in range(3) if all(c.axis != a for c in whole)]
    if not missing:
        return
    for c in found:
        if c.sideways > SIDEWAYS:
            raise error(
                "turns.axis", where=c.where(log), axis=AXES[missing[0]],
                measured=", ".join(f"{np.degrees(v):.0f}" for v in c.net),
            )  # fmt: skip
        if c.axis in missing:
            raise _partial(log, c, angles)
    names = ", ".join(AXES[a] for a in missing)
    seen = ", ".join(sorted({AXES[c.axis] for c in whole})) or "none"
    raise error("turns.missing", missing=names, seen=seen)


def _sense(log: Log, whole: list[_Candidate], angles: FloatArray) -> None:
    """Refuse turns in the other sense than declared: all of them, or some."""
    against = [c for c in whole if c.size * angles[c.axis] < 0]
    if not against:
        return
    if len(against) == len(whole):
        raise error("turns.reversed", declared=_degrees(angles), other=_as_key(-angles))
    axes = sorted({c.axis for c in against})
    names = ", ".join(AXES[a] for a in axes)
    where = "; ".join(c.where(log) for c in against)
    raise error("turns.sense", axes=names, where=where, declared=_degrees(angles[axes]))


def _degrees(angles: FloatArray) -> str:
    """Write angles in degrees with their signs, one where they are all alike."""
    return ", ".join(dict.fromkeys(f"{np.degrees(v):+.0f}" for v in angles))


def _as_key(angles: FloatArray) -> str:
    """Write angles as `angle` of a campaign has them."""
    words = [f'"{np.degrees(v):+.0f} deg"' for v in angles]
    return words[0] if len(set(words)) == 1 else f"[{', '.join(words)}]"


def _readings(log: Log, faces: Faces, whole: list[_Candidate], angles: FloatArray) -> TurnReadings:
    assert log.gyro is not None
    assert log.accel is not None
    dt = log.interval
    first = np.array([c.first for c in whole], np.int64)
    last = np.array([c.last for c in whole], np.int64)
    group = [int(faces.readings.group[c.before]) if c.before >= 0 else c.group for c in whole]
    return TurnReadings(
        axis_k=np.eye(3)[[c.axis for c in whole]],
        angle=np.array([c.turned(angles) for c in whole]),
        up_k=np.array([c.up_k for c in whole]),
        gyro=np.array([log.gyro[c.first : c.last].sum(axis=0) * dt for c in whole]),
        accel=np.array([log.accel[c.first : c.last].sum(axis=0) * dt for c in whole]),
        start=log.time[first],
        time=np.asarray((last - first) * dt),
        group=np.array(group, np.int64),
        first=first,
        last=last,
    )
