"""Rests on the faces of a cube: which face, which moves between them, what they show.

Judge a calibration on faces: what was redundant, what the residuals say, what nobody saw.

The table "readings", its rests and turns before and after, is made of the same evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.detect.faces import Faces
from foucault.diagnose.checks import check, reversed_earth_at_rest, reversed_earth_check
from foucault.diagnose.fit_checks import Judged, Limit
from foucault.diagnose.fit_checks import checks as fit_checks
from foucault.diagnose.left_out import common_g_sensitivity, counted_size
from foucault.diagnose.references import (
    BEYOND_THE_SESSION,
    EARTH_ROTATION,
    norm_with_cov,
    triad_columns,
    worst_residuals,
    wrong_gravity,
)
from foucault.errors import Finding, finding
from foucault.estimate.faces import BEYOND, SCATTER, OnFaces, Scene
from foucault.infer import gauss_newton, mixed
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.left_out import Judgement
from foucault.infer.mixed import Fit
from foucault.infer.snooping import Snooping, snoop
from foucault.models.earth import EARTH_RATE
from foucault.models.rests_and_turns import face_name, turn_name
from foucault.result import Check
from foucault.tables import AXES, Log
from foucault.units import plain

ROUGH = np.radians(1.0)  # Placements that are off by more than this are no calibration [rad].
UNSTILL = 0.05  # Scatter of rests that is no longer a calibration: 5 mg [m/s^2].
TURNED = np.radians(1.0)  # Scatter of rates that no instrument at rest has [rad/s].
PARTIAL = 0.03  # A gyro scale factor error beyond this looks like a turn that was not whole [1].

SINGLE = 0.025
"""The same, where one turn about an axis is all there is and nobody says how it ended: 10 deg of a
turn are 2.8 %, and raw scale factors of small instruments reach 2 % [1]."""

ARCMIN = np.degrees(1.0) * 60


@dataclass(frozen=True)
class FaceEvidence:
    """Everything the checks look at."""

    fit: Fit  # of `model`, solved
    model: OnFaces
    faces: Faces  # where it was observed
    snooping: Snooping  # tests of the single readings
    # whether it was declared how the instrument was placed, and how nearly the turns ended where
    # they began
    placement_given: bool
    angle_given: bool
    # (p, 3 k) what a unit of each reading does to the coefficients of another estimate than the
    # fit's, None: they are the fit's
    gain: FloatArray | None = None
    left_out: Judgement | None = None  # what was made of the terms that are not estimated

    @property
    def scene(self) -> Scene:
        """What was observed [SI]."""
        return self.model.scene

    def tilt(self, which: int) -> float:
        """Return the sd that was used [rad] of `which` [1]: 0 placement, 1 level, 2 angle."""
        source = self.model.tilt(which)
        beyond = 0.0 if which else self.fit.sds.get(BEYOND, 0.0)
        return float(np.hypot(mixed.size_of(source, self.fit.sds), beyond))


KINDS = {
    "accel": "specific force at rest",
    "gyro": "angular rate at rest",
    "turns": "turns",
}
"""Kind of reading -> what people call it."""


def checks(e: FaceEvidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    own = {c.name: c for c in (_redundancy(e), *_untested_turns(e))}
    out = [own.get(c.name, c) for c in fit_checks(judged(e))]
    out += [_whole(e)] if e.scene.turns is not None else []
    out.append(_placement(e))
    out += [sign for sign in (_turned_round(e),) if sign is not None]
    return tuple(out)


def drifts(e: FaceEvidence, log: Log) -> list[Check]:
    """Judge the drift within the rests of `log`: from face to face errors of placement hide it.

    With D the second half of a rest less its first, ``D = r T/2`` of a rate r, and a variance as
    1/T. It fails where it is more than chance, and a drift that is counted with, and moves a bias
    by more than two sd.
    """
    from scipy.special import ndtri, stdtrit

    out, c, k = list[Check](), e.fit.estimate.coefficients, len(e.faces.first)
    scales = {"accel": (1 / 9.80665e-3, "mg"), "gyro": (ARCMIN * 60, "deg/h")}
    for triad, (scale, unit) in scales.items():
        x, names = getattr(log, triad), [f"{triad}.bias.{a}" for a in AXES]
        if x is None or log.averaged is not None or not set(names) <= set(c.names):
            continue
        spans = zip(e.faces.first.tolist(), e.faces.last.tolist(), strict=True)
        halves = [np.array_split(x[a:b], 2) for a, b in spans]
        moved = np.array([two.mean(axis=0) - one.mean(axis=0) for one, two in halves])
        time = e.scene.rests.time[:, None]
        weight = float(np.sum(time**3)) / 4
        rate = np.sum(time**2 / 2 * moved, axis=0) / weight
        dof = 3 * (k - 1)
        left = float(np.sum(time * (moved - rate * time / 2) ** 2)) / dof
        session = float(np.ptp(e.scene.rests.start))
        counted = counted_size(e.left_out, f"{triad}.bias drift")
        tail = gauss_newton.FALSE_ALARM / 12
        chance = float(stdtrit(dof, tail)) * session * np.sqrt(left / weight)
        limit = np.hypot(chance, float(ndtri(tail)) * counted)
        size = np.abs(rate) * session
        high = np.maximum(limit, 4 * c.sd[[c.layout.index(name) for name in names]])
        j = int(np.argmax(size / high))
        given = {"name": names[j], "size": f"{plain(size[j] * scale, 2)} {unit}"}
        out.append(check("drift within rests", f"drift of {triad} within rests [{unit}]",
                         float(size[j]) * scale, None, float(high[j]) * scale, given))  # fmt: skip
    return out


def judged(e: FaceEvidence) -> Judged:
    """Return what every fit is asked, of a session on faces."""
    known, beyond = e.model.noise.known, bool(e.fit.found.get(BEYOND))
    placed = (
        "the instrument was not placed as well as `placement_sd` says, or a rest is wrong; leave "
        "`placement_sd` out to have it estimated"
    )
    disturbed = "a rest was disturbed, or is not what it is taken for"
    return Judged(
        e.fit, KINDS, e.model.noise.source, e.model.middle,
        found_in={"accel": (SCATTER["accel"], BEYOND), "gyro": (SCATTER["gyro"],)} if known
        else {"accel": ("accelerometer noise",), "gyro": ("gyro noise",)},
        limits={
            SCATTER["accel"]: Limit(
                "The specific force at rest", UNSTILL, 1 / 9.80665e-3, "mg",
                "the instrument moved in its rests, or the log is damaged",
            ),
            SCATTER["gyro"]: Limit(
                "The angular rate at rest", TURNED, ARCMIN * 60, "deg/h", "the instrument turned",
            ),
        },
        # How it settles after a turn has nothing to do with its noise: `limits` judge it.
        too_much=np.inf,
        blocks=_blocks(e.scene), named=partial(_named, e.scene),
        overstated="the noise or the errors of placement are",
        cure="Rest on each face again.",
        more="repeat the rests",
        cause={
            "accel": placed if beyond else disturbed,
            "gyro": disturbed if "gyro.g_sensitivity.xx" in e.model.layout
            else "the gyros feel specific force (try g_sensitivity = true in [procedure]), or a "
            "rest was disturbed",
            "turns": "the turns did not end as well as `angle_sd` and `level_sd` say",
        },
    )  # fmt: skip


def _blocks(scene: Scene) -> IntArray:
    """Number what is held out together: a rest with all it says, a turn."""
    n, rated, m = scene.sizes
    return np.concatenate([np.arange(n), np.arange(rated), n + np.arange(m)])


def _named(scene: Scene, k: int) -> str:
    """Return what people call a rest, or a turn, of `_blocks`."""
    r, t = scene.rests, scene.turns
    if t is None or k < len(r):
        return f"the rest {face_name(int(r.axis[k]), r.sign[k])} at {r.start[k]:.1f} s"
    return f"the turn {turns_in_words(scene)[k - len(r)]}"


def _turned_round(e: FaceEvidence) -> Check | None:
    """Doubt rates at rest, or a g-sensitivity, that a reversed sign of the Earth's rate makes."""
    rests, site, state = e.scene.rests, e.scene.site, e.fit.estimate.state
    if rests.gyro is None or "gyro.g_sensitivity.xx" in e.model.layout:
        return reversed_earth_check(e.fit.estimate.coefficients, site)
    matrix = state.model.gyro_matrix @ state.C_bk
    noise = float(np.sqrt(e.model.noise.gyro_var.mean())) if e.model.noise.known else 0.0
    rates = rests.gyro - e.scene.rate_k @ matrix.T
    beside = common_g_sensitivity(e.left_out, site.gravity)
    return reversed_earth_at_rest(rates, rests.up_k, matrix, site, noise, beside)


def _redundancy(e: FaceEvidence) -> Check:
    """Say what is left over of the specific forces, and what that does not test."""
    n, faces = len(e.scene.rests), len(np.unique(e.scene.rests.up_k, axis=0))
    free = e.fit.after["accel"].redundancy
    given = {"n": n, "faces": faces, "free": plain(free, 2), "equations": 3 * n}
    key = "single faces" if n == faces else "repeated faces"
    return check(key, "redundancy", free, given=given)


def _untested_turns(e: FaceEvidence) -> list[Check]:
    turns = e.fit.after.get("turns")
    if turns is None or turns.redundancy >= 0.5:
        return []
    return [
        check("turns untested", "noise of turns", np.nan, given={"n": len(e.scene.turns or ())})
    ]


def _whole(e: FaceEvidence) -> Check:
    """Doubt a turn that a plausible scale factor hardly explains: one turn cannot tell the two."""
    vector, turns = e.fit.estimate.coefficients, e.scene.turns
    assert turns is not None
    names = [f"gyro.scale.{a}" for a in AXES]
    values = np.array([vector.value(n) for n in names])
    known = np.array([np.isfinite(vector.prior_sd[vector.names.index(n)]) for n in names])
    single = np.bincount(turns.axis, minlength=3) == 1
    alone = single & ~known & (not e.angle_given)
    limits = np.where(alone, SINGLE, PARTIAL)
    k = int(np.argmax(np.abs(values) / limits))
    value, limit = float(values[k]), 100 * float(limits[k])
    given = {
        "turns": "; ".join(turns_in_words(e.scene)), "sd": plain(e.tilt(2) * ARCMIN, 2),
        "where": "as declared" if e.angle_given else "like the placements: declare `angle_sd`",
        "axis": AXES[k], "alone": "A single turn cannot tell. " if alone[k] else "",
        "off": np.degrees(np.abs(turns.angle[turns.axis == k]).min()) * abs(value),
    }  # fmt: skip
    return check("whole turns", "whole turns", 100 * value, -limit, limit, given)


def _placement(e: FaceEvidence) -> Check:
    sd, declared = e.tilt(0), e.placement_given
    size = {"size": plain(sd * ARCMIN, 2)}
    if e.fit.found.get(BEYOND):
        high = (e.model.given[0] or 0.0) * ARCMIN
        return check("placement beyond", "placement", sd * ARCMIN, None, high, size)
    where = ", as declared" if declared else ""
    if sd:
        where = "as declared" if declared else "as the residuals show"
    key = "placement" if sd else "placement exact"
    given = size | {"where": where}
    return check(key, "placement", sd * ARCMIN, None, ROUGH * ARCMIN, given)


def findings(e: FaceEvidence) -> list[Finding]:
    """Return what was noticed: an unknown latitude, an unknown noise, a bad rest."""
    out, r = [], e.scene.rests
    if r.gyro is None:
        out.append(finding("session.no_gyro"))
    elif e.scene.site.latitude is None:
        sd = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
        out.append(finding("session.no_latitude", sd=f"{sd:.0f}"))
    if not e.model.noise.known:
        out.append(finding("readings.noise_unknown"))
    if e.model.noise.known:
        out += _outliers(e)
    return out


def turns_in_words(scene: Scene) -> list[str]:
    """Return each turn in words: about which axis, what was up, in which sense."""
    t = scene.turns
    if t is None:
        return []
    rows = zip(t.axis.tolist(), t.angle.tolist(), t.about_up.tolist(), strict=True)
    return [turn_name(*row) for row in rows]


def _outliers(e: FaceEvidence) -> list[Finding]:
    """Name the rest that fits worst, where it fits worse than chance allows.

    One bad rest looks like scatter of all. It is one where without it nothing is left of that.
    """
    s, n = e.snooping, e.scene.sizes[0]
    scatter = {name: 0.0 for name in (*SCATTER.values(), BEYOND) if e.fit.sds.get(name)}
    alone = None
    if scatter:
        problem = mixed.stated(e.model, {**e.fit.sds, **scatter})
        alone = gauss_newton.solve(replace(problem, start=e.fit.state))
        s = snoop(problem.linearise(alone.state, alone.weights), alone.state_cov)
    tested = np.flatnonzero(s.dof > 0)
    if not len(tested):
        return []
    limit = np.array([chi_square_limits(d, tests=len(tested))[1] for d in s.dof[tested]])
    over = s.test[tested] / limit
    j = int(tested[np.argmax(over)])
    if over.max() <= 1 or j >= 2 * n:
        return []
    if alone and alone.chi_square - s.test[j] > chi_square_limits(alone.dof - s.dof[j])[1]:
        return []
    r, k = e.scene.rests, j % n
    face = face_name(int(r.axis[k]), r.sign[k])
    what = "specific force" if j < n else "rate"
    also = [int(b) % n for b in s.alike(j)]
    words = ", ".join(face_name(int(r.axis[i]), r.sign[i]) for i in also)
    return [
        finding(
            "faces.outlier", what=what, face=face, time=f"{r.start[k]:.1f}",
            sds=f"{np.sqrt(s.test[j]):.0f}",
            also=f" The rest {words} would look the same." if also else "",
        )
    ]  # fmt: skip


def unseen(e: FaceEvidence) -> list[str]:
    """Say what this procedure cannot see in principle, for result.json."""
    out = [
        wrong_gravity(e.scene.site.gravity_sd),
        "Faces that are not square to one another, alike on opposite sides: that is a misalignment "
        "of the accelerometers. Only what differs between opposite faces shows in the residuals.",
        *BEYOND_THE_SESSION,
    ]
    face = e.scene.rests.axis * e.scene.rests.sign + 3 * e.scene.rests.sign
    if np.count_nonzero(np.diff(face)) + 1 == len(np.unique(face)):
        out.append(
            "A jump of an accelerometer between two opposite faces: half of a bias goes into the "
            "scale factor. Rest on the first faces again at the end."
        )
    if e.scene.turns is not None:
        out.append(
            "A turn that ended where it should not: 1 deg of 360 is 2800 ppm of the gyro's scale "
            "factor; `angle_sd` says how well it ended."
        )
    if e.scene.rests.gyro is not None and e.scene.site.latitude is None:
        out.append(EARTH_ROTATION)
    if "accel.quadratic.x" in e.fit.estimate.coefficients.layout:
        out.append(
            "The quadratic terms apart from errors of placement: they are the difference between "
            "the bias along the vertical and that across it."
        )
    return out


def readings_table(e: FaceEvidence) -> dict[str, FloatArray]:
    """Return the table "readings": the rests, then the turns."""
    scene, estimate = e.scene, e.fit.estimate
    state, r, n = estimate.state, scene.rests, len(scene.rests)
    at = 3 * np.arange(n)[:, None, None] + np.arange(3)
    own = e.fit.covariance.whole[at, np.swapaxes(at, 1, 2)]
    norm, joint = norm_with_cov(state.model, estimate.coefficients, r.accel, own)
    size = np.linalg.norm(
        np.einsum("kij,kj->ki", np.linalg.cholesky(own), e.snooping.direction[:n]), axis=1
    )
    none = np.full(n, np.nan)
    rate = none if r.gyro is None else np.linalg.norm(r.gyro, axis=1)
    out = {
        "start": r.start, "end": r.start + r.time, "time": r.time, "rate": np.zeros(n),
        "turns": np.zeros(n), **triad_columns("accel", r.accel),
        **triad_columns("gyro", np.full((n, 3), np.nan) if r.gyro is None else r.gyro),
        **triad_columns("up", r.up_k @ state.C_bk.T),
        "norm_before": np.linalg.norm(r.accel, axis=1), "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)), "rate_before": rate, "rate_after": none,
        "rate_true": none, "residual": worst_residuals(e.fit.estimate)[:n], "weight": np.ones(n),
        "detectable": e.snooping.detectable[:n] * size,
    }  # fmt: skip
    if scene.turns is None:
        return out
    turns = _turn_columns(e)
    return {name: np.concatenate([column, turns[name]]) for name, column in out.items()}


def _turn_columns(e: FaceEvidence) -> dict[str, FloatArray]:
    scene, state = e.scene, e.fit.estimate.state
    t = scene.turns
    assert t is not None
    m, time = len(t), t.time[:, None]
    sense = np.where(t.about_up == 0, 1.0, t.about_up)
    _, rate = state.model.compensate(t.accel / time, t.gyro / time)
    none = np.full(m, np.nan)
    return {
        "start": t.start, "end": t.start + t.time, "time": t.time,
        "rate": sense * t.angle / t.time, "turns": np.abs(t.angle) / (2 * np.pi),
        **triad_columns("accel", t.accel / time), **triad_columns("gyro", t.gyro / time),
        **triad_columns("up", t.axis_k * sense[:, None] @ state.C_bk.T),
        "norm_before": none, "norm_after": none, "norm_sd": none,
        "rate_before": np.linalg.norm(t.gyro / time, axis=1),
        "rate_after": np.linalg.norm(rate, axis=1),
        "rate_true": np.linalg.norm(scene.turn_k / time, axis=1),
        "residual": worst_residuals(e.fit.estimate)[-m:], "weight": np.ones(m), "detectable": none,
    }  # fmt: skip
