"""Find the rests on the six faces of an instrument, and the turns by known angles between them.

Rests are found in a log, given as sections, or rows of means. A rest is on the face whose axis its
specific force is closest to; the centre of all readings, which is the bias to within the errors of
placement, is taken off first.

Two rests on the same face with a net rotation by the declared angle about one axis between them,
or by two or three times as much, are a turn on the spot; after whole turns they are one placement.
A turn must have the sense and the size that was declared, for the sign of a gyro and its scale
factor cannot be told from them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect.noise import resolution
from foucault.detect.stretches import (
    HAND,
    How,
    Rests,
    find_rests,
    means_of,
    require_finite,
    require_live_gyros,
    turning,
)
from foucault.errors import Finding, FoucaultError, error, finding, suggestion
from foucault.models.rests_and_turns import SIX, FaceReadings, TurnReadings, bridged, face_name
from foucault.tables import AXES, Log
from foucault.units import STANDARD_GRAVITY, plain

Sections = Mapping[str, Sequence[int]]

OFF_FACE = np.radians(20.0)  # A rest that is tilted more than this belongs to no face [rad].
SHORTEST = 8  # Fewest samples of a section [1].

STILL = 2e-3, 6.0
"""A rest moves if its halves differ by more than this share of g and this many sd [1]."""

A_TURN = np.radians(45.0), np.radians(10.0)
"""A quiet time that turns so far, or so fast, is a turn and no rest [rad], [rad/s]."""

REST_SECTIONS = tuple(f"{a}_{s}" for a in AXES for s in "pa")
TURN_SECTIONS = tuple(f"{a}_rot" for a in AXES)
"""Names of sections: p and a for one and the other way up, rot for the turn about the axis."""


@dataclass(frozen=True)
class Faces:
    """Rests on faces, and where in the log they are."""

    readings: FaceReadings  # their means [SI]
    # first, last: (n,) first sample of each rest and the sample after its last
    first: IntArray
    last: IntArray
    tilt: FloatArray  # (n,) how far up seems to be from the face, before calibration [rad]
    rests: Rests | None  # how the rests were found, where they were looked for
    adjacent: BoolArray  # (n,) whether the next rest is the next quiet time of the log
    findings: tuple[Finding, ...] = ()

    def joined(self, pairs: list[tuple[int, int]]) -> Faces:
        """Return the same with `pairs` of rests, shape (k, 2) [1], taken for one placement each."""
        group = self.readings.group.copy()
        for one, other in pairs:
            group[group == group[other]] = group[one]
        return replace(self, readings=replace(self.readings, group=group))


def find_faces(
    log: Log,
    gravity: float,
    *,
    sections: Sections | None = None,
    how: How = HAND,
) -> Faces:
    """Find the rests on the six faces.

    `log`: readings, rows that are means are taken as they are [SI]; `gravity`: local gravity
    [m/s^2]; `sections` (2,): first sample and the sample after the last, by names such as x_p,
    None looks for rests; `how`: rests are looked for. Raises A face is missing, a rest is on no
    face, a rest moves, the unit of the readings is wrong.
    """
    if log.accel is None:
        raise error("session.no_accel")
    require_finite(log)
    if log.averaged is None:
        require_live_gyros(log)
    rests: Rests | None = None
    names: list[str] = []
    if sections is not None:
        names = check_sections(sections, len(log), log.averaged is not None)
        ends = np.array([sections[name] for name in names], np.int64).reshape(-1, 2)
        first, last = ends[:, 0], ends[:, 1]
    elif log.averaged is not None:
        first = np.arange(len(log), dtype=np.int64)
        last = first + 1
    else:
        rests = find_rests(log, how)
        first, last = rests.first, rests.last
    found = () if rests is None else _creeping(rests)
    readings, tilt = face_readings(log, first, last, gravity)
    off = tilt > OFF_FACE
    if rests is None and off.any():
        j = int(np.argmax(off))
        raise error("faces.off", **_off(readings, tilt, j, names))
    _complete(readings, tilt, off)
    found += tuple(finding("faces.left_out", **_off(readings, tilt, int(j), names))
                   for j in np.flatnonzero(off))  # fmt: skip
    kept = np.flatnonzero(~off)
    if names:
        found += _as_named(readings, names)
    if log.averaged is None:
        _still(log, readings, first, last, kept, gravity)
    order = kept[np.argsort(first[kept], kind="stable")]
    adjacent = np.append(np.diff(order) == 1, False) & (rests is not None)
    return Faces(
        _some(readings, order), first[order], last[order], tilt[order], rests, adjacent, found
    )


def _creeping(rests: Rests) -> tuple[Finding, ...]:
    """Return the findings of rests that moved; a turn at a constant rate is none."""
    far, fast = A_TURN
    rate, time = rests.left_out.T
    turn = (rate >= fast) | (rate * time >= far)
    return tuple(f for f, is_turn in zip(rests.findings, turn, strict=True) if not is_turn)


def check_sections(sections: Sections, samples: int, means: bool) -> list[str]:
    """Refuse sections beyond `samples` [1], or that cannot be; return the rests among them."""
    allowed = (*REST_SECTIONS, *TURN_SECTIONS)
    for name, given in sections.items():
        if name not in allowed:
            raise error(
                "faces.section_name", name=name, hint=suggestion(name, allowed),
                allowed=", ".join(allowed),
            )  # fmt: skip
        if means:
            raise error("faces.section_means")
        a, b = given if len(given) == 2 else (0, 0)
        if a < 0 or b > samples or b - a < SHORTEST:
            raise error(
                "faces.section_range", name=name, given=list(given), samples=samples,
                shortest=SHORTEST,
            )  # fmt: skip
    missing = [name for name in REST_SECTIONS if name not in sections]
    if missing:
        raise error("faces.section_missing", missing=", ".join(missing))
    return list(REST_SECTIONS)


def require_gravity(log: Log, accel: FloatArray, gravity: float, band: float) -> None:
    """Refuse means at rest that are not gravity by far, and name increments.

    `accel` (n, 3): means at rest [m/s^2]; `gravity`: local [m/s^2]; `band`: they may be so many
    times as large, or as small [1].
    """
    norm = float(np.median(np.linalg.norm(accel, axis=1)))
    ratio = norm / gravity
    if 1 / band < ratio < band:
        return
    in_g = abs(ratio * STANDARD_GRAVITY - 1.0) < 0.1  # at 10 Hz either may be
    if log.averaged is None and abs(ratio / log.interval - 1.0) < 0.1 and not in_g:
        raise error("accel.increments", given=f"{norm:.4g}", rate=plain(1 / log.interval))
    raise error("accel.scale_impossible", given=f"{norm:.4g}", ratio=f"{ratio:.3g}")


def face_readings(
    log: Log, first: IntArray, last: IntArray, gravity: float
) -> tuple[FaceReadings, FloatArray]:
    """Return means of rests on the faces that are nearest, and how far each is off [rad].

    `first`, `last` (n,): first sample of each rest and the sample after its last; `gravity`: local
    gravity [m/s^2].
    """
    assert log.accel is not None
    spans = list(zip(first.tolist(), last.tolist(), strict=True))
    accel = means_of(log.accel, spans)
    gyro = None if log.gyro is None else means_of(log.gyro, spans)
    if len(accel):
        require_gravity(log, accel, gravity, 2.0)
    axis, sign, tilt = _nearest(accel - _centre(accel))
    time = (last - first) * log.interval if log.averaged is None else log.averaged[first]
    readings = FaceReadings(
        np.eye(3)[axis] * sign[:, None], accel, gyro, log.time[first],
        np.asarray(time, float), np.arange(len(first), dtype=np.int64),
    )  # fmt: skip
    return readings, tilt


def _nearest(x: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    axis = np.abs(x).argmax(axis=1)
    along = x[np.arange(len(x)), axis]
    tilt = np.arccos(np.clip(np.abs(along) / np.linalg.norm(x, axis=1), 0.0, 1.0))
    return axis.astype(np.int64), np.sign(along), tilt


def _centre(accel: FloatArray) -> FloatArray:
    """Middle of the readings, where there are rests on all six faces."""
    if not len(accel):
        return np.zeros(3)
    axis, sign, _ = _nearest(accel)
    if any(not np.any((axis == a) & (sign == s)) for a, s in SIX):
        return np.zeros(3)
    means = [accel[(axis == a) & (sign == s)].mean(axis=0) for a, s in SIX]
    return np.asarray(np.mean(means, axis=0))


def _off(readings: FaceReadings, tilt: FloatArray, j: int, names: list[str]) -> dict[str, str]:
    where = f"section {names[j]}" if names else f"the rest at {readings.start[j]:.1f} s"
    nearest = face_name(int(readings.axis[j]), readings.sign[j])
    limit = f"{np.degrees(OFF_FACE):.0f}"
    return {"where": where, "tilt": f"{np.degrees(tilt[j]):.0f}", "face": nearest, "limit": limit}


def _complete(readings: FaceReadings, tilt: FloatArray, off: BoolArray) -> None:
    seen = {(int(a), int(s)) for a, s, o in zip(readings.axis, readings.sign, off, strict=True)
            if not o}  # fmt: skip
    missing = [face for face in SIX if face not in seen]
    if not missing:
        return
    tilted = [
        f"at {readings.start[j]:.1f} s {np.degrees(tilt[j]):.0f} deg off "
        f"{face_name(int(readings.axis[j]), readings.sign[j])}"
        for j in np.flatnonzero(off)
    ]
    raise error(
        "faces.missing",
        missing=", ".join(face_name(*face) for face in missing),
        found=", ".join(face_name(*face) for face in SIX if face in seen) or "no face at all",
        hint=f" Rests on no face: {'; '.join(tilted)}." if tilted else "",
    )


def _as_named(readings: FaceReadings, names: list[str]) -> tuple[Finding, ...]:
    """Compare the faces with the names of the sections: the axis must be right."""
    turned = []
    for j, name in enumerate(names):
        if AXES[int(readings.axis[j])] != name[0]:
            face = face_name(int(readings.axis[j]), readings.sign[j])
            raise error("faces.section_axis", name=name, face=face)
        if (readings.sign[j] > 0) != name.endswith("_p"):
            turned.append(name)
    if not turned:
        return ()
    return (finding("faces.section_sense", names=", ".join(turned)),)


def _some(r: FaceReadings, rows: IntArray) -> FaceReadings:
    gyro = None if r.gyro is None else r.gyro[rows]
    return FaceReadings(
        r.up_k[rows], r.accel[rows], gyro, r.start[rows], r.time[rows], r.group[rows]
    )


def _still(
    log: Log, r: FaceReadings, first: IntArray, last: IntArray, kept: IntArray, gravity: float
) -> None:
    """Refuse rests whose mean moves: the halves differ, or the instrument turns steadily."""
    assert log.accel is not None
    share, sds = STILL
    for j in kept.tolist():
        part = log.accel[first[j] : last[j]]
        half = len(part) // 2
        one, two = part[:half], part[half:]
        moved = np.abs(two.mean(axis=0) - one.mean(axis=0))
        sd = np.sqrt((one.var(axis=0) + two.var(axis=0)) / half)
        steps = np.array([resolution(part[:, i]) for i in range(3)])
        beyond = moved - np.maximum(share * gravity + steps, sds * sd)
        if (beyond > 0).any():
            worst = float(moved[np.argmax(beyond)])
            raise error(
                "faces.moving", start=f"{r.start[j]:.1f}",
                face=face_name(int(r.axis[j]), r.sign[j]), moved=f"{worst / gravity * 1e3:.2g} mg",
            )  # fmt: skip
    if r.gyro is not None:
        moving, off = turning(r.gyro[kept])
        if moving.any():
            j = int(np.argmax(np.where(moving, off, 0.0)))
            raise error(
                "faces.moving", start=f"{r.start[kept[j]]:.1f}",
                face=face_name(int(r.axis[kept[j]]), r.sign[kept[j]]),
                moved=f"{np.degrees(off[j]):.2g} deg/s",
            )  # fmt: skip


TOLERANCE = 0.12
"""A turn is whole if it measures this near to the declared angle: a gyro may be 10 % off [1]."""

SIDEWAYS = np.radians(20.0)
"""A turn about another direction than this near an axis is about no axis [rad]."""

BUMP = np.radians(45.0)  # A smaller rotation between two rests on one face is no turn [rad].
MOST = 3  # So many times the declared angle may have been turned at once [1].


WHOLE = 1e-6  # An angle this near to whole turns is whole turns [1].


def is_whole(angle: float) -> bool:
    """Tell whether `angle` [rad] is one or more whole turns."""
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
        """Return the angle that was turned, in the sense that the gyros say [rad]."""
        return float(self.times(angles) * np.copysign(angles[self.axis], self.size))

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
    all or of x, y and z, that of the first about each [rad]; `sections` (2,) or None: first sample
    of each turn and the sample after its last, by names such as x_rot. Raises no gyros, no turn
    about an axis, a turn that is not whole or about another axis, first turns in the other sense.
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
        if not any(c.times(angles) for c in found):
            _other_unit(log, found, angles)
        for c in found:
            _section_as_declared(log, c, angles)
    _all_axes(log, faces, bias, found, whole, angles)
    _sense(log, whole, angles)
    faces = faces.joined(_returned(whole, angles))
    return faces, _turn_readings(log, faces, whole, angles)


def _returned(whole: list[_Candidate], angles: FloatArray) -> list[tuple[int, int]]:
    """Return pairs of rests between which turns lead back to the same heading.

    A part of a turn leads to another heading, and another side of the support.
    """
    stood: dict[int, tuple[int, float]] = {}  # rest -> the first of its turns, and what was turned
    for c in whole:
        if c.after >= 0:
            first, turned = stood.setdefault(c.before, (c.before, 0.0))
            stood[c.after] = first, turned + c.turned(angles)

    def same(a: int, b: int) -> bool:
        turns = (stood[a][1] - stood[b][1]) / (2 * np.pi)
        return stood[a][0] == stood[b][0] and abs(turns - round(turns)) <= WHOLE

    return [(a, b) for a, b in combinations(stood, 2) if same(a, b)]


def _net(log: Log, a: int, b: int, bias: FloatArray) -> FloatArray:
    assert log.gyro is not None
    return np.asarray(log.lasting[a:b] @ (log.gyro[a:b] - bias))


def _between(log: Log, faces: Faces, bias: FloatArray, least: float = BUMP) -> list[_Candidate]:
    """Return what was turned by `least` [rad] or more between two rests on one face."""
    r, out = faces.readings, []
    for j in np.flatnonzero(faces.adjacent).tolist():
        if not np.array_equal(r.up_k[j], r.up_k[j + 1]):
            continue
        a, b = int(faces.last[j]), int(faces.first[j + 1])
        net = _net(log, a, b, bias) if b - a > 1 else np.zeros(3)
        if np.abs(net).max() >= least:
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


def _section_as_declared(log: Log, c: _Candidate, angles: FloatArray) -> None:
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


def _all_axes(
    log: Log, faces: Faces, bias: FloatArray, found: list[_Candidate],
    whole: list[_Candidate], angles: FloatArray,
) -> None:  # fmt: skip
    missing = [a for a in range(3) if all(c.axis != a for c in whole)]
    if not missing:
        return
    if not whole:
        _other_unit(log, found or _between(log, faces, bias, 0.0), angles)
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


def _other_unit(log: Log, found: list[_Candidate], angles: FloatArray) -> None:
    """Refuse turns that are whole about all axes, were their gyros in another unit."""
    tried = {np.degrees(1.0): ("turns.unit", "rad/s", "deg/s"),
             np.radians(1.0): ("turns.unit", "deg/s", "rad/s"),
             1.0 / log.interval: ("turns.increments", "", "")}  # fmt: skip
    for factor, (code, given, likely) in tried.items():
        right = [replace(c, net=c.net / factor if code == "turns.unit" else c.net * factor)
                 for c in found]  # fmt: skip
        fit = [c for c in right if c.times(angles) and c.sideways <= SIDEWAYS]
        if {c.axis for c in fit} == {0, 1, 2}:
            first = fit[0]
            shown = next(c for c in found if c.first == first.first)
            raise error(
                code, where=first.where(log), axis=AXES[first.axis], given=given, likely=likely,
                measured=plain(np.degrees(abs(shown.size)), 3), rate=plain(1 / log.interval),
                declared=f"{np.degrees(abs(angles[first.axis])):.0f}",
            )  # fmt: skip


def _sense(log: Log, whole: list[_Candidate], angles: FloatArray) -> None:
    """Refuse axes about which it was first turned in the other sense than declared: all, or some.

    What comes later is told by the gyros, whose sign the first turn has shown.
    """
    begun = [min((c for c in whole if c.axis == a), key=lambda c: c.first) for a in range(3)]
    against = [c for c in begun if c.size * angles[c.axis] < 0]
    if not against:
        return
    if len(against) == len(begun):
        raise error("turns.reversed", declared=_degrees(angles), other=_as_key(-angles))
    axes = sorted({c.axis for c in against})
    names = ", ".join(AXES[a] for a in axes)
    where = "; ".join(c.where(log) for c in against)
    other = np.where(np.isin(range(3), axes), -angles, angles)
    raise error("turns.sense", axes=names, where=where, declared=_degrees(angles[axes]),
                other=_as_key(other))  # fmt: skip


def _degrees(angles: FloatArray) -> str:
    """Write angles in degrees with their signs, one where they are all alike."""
    return ", ".join(dict.fromkeys(f"{np.degrees(v):+.0f}" for v in angles))


def _as_key(angles: FloatArray) -> str:
    """Write angles as `angle` of a campaign has them."""
    words = [f'"{np.degrees(v):+.0f} deg"' for v in angles]
    return words[0] if len(set(words)) == 1 else f"[{', '.join(words)}]"


def _turn_readings(
    log: Log, faces: Faces, whole: list[_Candidate], angles: FloatArray
) -> TurnReadings:
    assert log.gyro is not None
    assert log.accel is not None

    def added(x: FloatArray) -> FloatArray:
        spans = (slice(c.first, c.last) for c in whole)
        return np.array([log.lasting[some] @ x[some] for some in spans])

    first = np.array([c.first for c in whole], np.int64)
    last = np.array([c.last for c in whole], np.int64)
    group = [int(faces.readings.group[c.before]) if c.before >= 0 else c.group for c in whole]
    return TurnReadings(
        axis_k=np.eye(3)[[c.axis for c in whole]],
        angle=np.array([c.turned(angles) for c in whole]),
        up_k=np.array([c.up_k for c in whole]),
        gyro=added(log.gyro),
        accel=added(log.accel),
        bridged=bridged(log, np.maximum(first - 1, 0), np.minimum(last, len(log) - 1)),
        start=log.time[first],
        time=added(np.ones(len(log))),
        group=np.array(group, np.int64),
        first=first,
        last=last,
    )
