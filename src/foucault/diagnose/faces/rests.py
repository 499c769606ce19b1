"""Find the rests on the six faces of an instrument: in a log, in sections, in rows of means.

A rest is on the face whose axis its specific force is closest to; the centre of all readings,
which is the bias to within the errors of placement, is taken off first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.rests import (
    Rests,
    find_rests,
    require_live_gyros,
    resolution,
    turning,
)
from foucault.errors import Finding, error, finding, suggestion
from foucault.models.faces import SIX, FaceReadings, face_name
from foucault.tables import AXES, Log

Sections = Mapping[str, Sequence[int]]

OFF_FACE = np.radians(20.0)
"""A rest that is tilted more than this belongs to no face [rad]."""

SHORTEST = 8
"""Fewest samples of a section [1]."""

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
    adjacent: npt.NDArray[np.bool_]  # (n,) whether the next rest is the next quiet time of the log
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
    window: float = 0.5,
    threshold: float | None = None,
    shortest: float = 1.0,
) -> Faces:
    """Find the rests on the six faces.

    `log`: readings, rows that are means are taken as they are [SI]; `gravity`: local gravity
    [m/s^2]; `sections` (2,): first sample and the sample after the last, by names such as x_p,
    None looks for rests; `window`: window of the rest detector [s]; `threshold`: its threshold,
    None chooses it from the data [1]; `shortest`: shortest rest [s]. Raises A face is missing, a
    rest is on no face, a rest moves, the unit of the readings is wrong.
    """
    _readable(log)
    assert log.accel is not None
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
        rests = find_rests(log, window=window, threshold=threshold, shortest=shortest)
        first, last = rests.first, rests.last
    found = () if rests is None else _creeping(rests)
    readings, tilt = _on_faces(log, first, last, gravity)
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


def _readable(log: Log) -> None:
    if log.accel is None:
        raise error("session.no_accel")
    for what, x in (("accel", log.accel), ("gyro", log.gyro)):
        bad = None if x is None else np.flatnonzero(~np.isfinite(x).all(axis=1))
        if bad is not None and len(bad):
            raise error("session.not_finite", what=what, index=int(bad[0]))


def check_sections(sections: Sections, samples: int, means: bool) -> list[str]:
    """Refuse sections that cannot be; return the names of those that are rests.

    `sections` (2,): the sections; `samples`: length of the log [1]; `means`: whether the rows of
    the log are means.
    """
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


def _on_faces(
    log: Log, first: IntArray, last: IntArray, gravity: float
) -> tuple[FaceReadings, FloatArray]:
    assert log.accel is not None
    spans = list(zip(first.tolist(), last.tolist(), strict=True))
    accel = np.array([log.accel[a:b].mean(axis=0) for a, b in spans]).reshape(-1, 3)
    gyro = None
    if log.gyro is not None:
        gyro = np.array([log.gyro[a:b].mean(axis=0) for a, b in spans]).reshape(-1, 3)
    if len(accel):
        norm = float(np.median(np.linalg.norm(accel, axis=1)))
        if not 0.5 < norm / gravity < 2.0:
            ratio = f"{norm / gravity:.3g}"
            raise error("accel.scale_impossible", given=f"{norm:.4g}", ratio=ratio)
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


def _complete(readings: FaceReadings, tilt: FloatArray, off: npt.NDArray[np.bool_]) -> None:
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
