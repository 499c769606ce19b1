"""Judge a calibration on faces: what was redundant, what the residuals say, what nobody saw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.checks import (
    drift_check,
    judge_prior,
    plausible_scales,
    reversed_earth_check,
    status_check,
)
from foucault.diagnose.faces.rests import Faces
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import TOLD, chi_square_limits
from foucault.estimate.drift import Drift
from foucault.estimate.faces.covariance import Belief, FaceNoise
from foucault.estimate.faces.likelihood import Scene
from foucault.estimate.faces.scatter import Scatter
from foucault.estimate.snooping import Snooping
from foucault.models.earth import EARTH_RATE
from foucault.models.faces import face_name, turn_name
from foucault.result import Check, Estimate
from foucault.tables import AXES
from foucault.units import plain

ROUGH = np.radians(1.0)
"""Placements that are off by more than this are no calibration [rad]."""

PARTIAL = 0.03
"""A gyro scale factor error beyond this looks like a turn that was not whole [1]."""

SINGLE = 0.025
"""The same, where one turn about an axis is all there is and nobody says how it ended: 10 deg of a
turn are 2.8 %, and raw scale factors of small instruments reach 2 % [1]."""

ARCMIN = np.degrees(1.0) * 60


@dataclass(frozen=True)
class FaceEvidence:
    """Everything the checks look at."""

    scene: Scene  # what was observed [SI]
    faces: Faces  # where it was observed
    estimate: Estimate
    noise: FaceNoise  # its noise [SI]
    declared: bool  # whether the noise was declared
    belief: Belief  # what is believed of placements and turns [rad]
    placement_given: bool  # whether the placement was declared
    found: Mapping[str, Scatter]  # what the residuals said before the placement was settled
    cov: FloatArray  # (3 k, 3 k) covariance of all readings [SI]
    snooping: Snooping  # tests of the single readings
    angle_given: bool = False  # whether it was declared how nearly the turns ended where they began
    drift: Drift | None = None  # the drift of a coefficient that the residuals show most clearly

    def component(self, kind: str) -> tuple[float, float]:
        """Return sum of squares and redundancy of the "accel", "gyro" or "turns" residuals [1]."""
        n, rated, m = self.scene.sizes
        edges = np.cumsum([0, n, rated, m]) * 3
        k = ("accel", "gyro", "turns").index(kind)
        rows = slice(int(edges[k]), int(edges[k + 1]))
        e = self.estimate
        return float(np.sum(e.residuals[rows] ** 2)), float(np.sum(1 - e.leverage[rows]))


def checks(e: FaceEvidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    vector = e.estimate.coefficients
    out = [status_check(e.estimate.status, e.estimate.weakest), _redundancy(e)]
    out += judge_prior(e.estimate)
    out += [*plausible_scales(vector), *drift_check(e.drift, vector.layout)]
    out.append(_explained(e, "accel"))
    if e.scene.rests.gyro is not None:
        out.append(_explained(e, "gyro"))
    if e.scene.turns is not None:
        out += [_turns(e), _whole(e)]
    out.append(_placement(e))
    sign = reversed_earth_check(vector, e.scene.site)
    out += [sign] if sign is not None else []
    return tuple(out)


def _redundancy(e: FaceEvidence) -> Check:
    n, _, _ = e.scene.sizes
    free = e.component("accel")[1]
    faces = len({(a, s) for a, s in zip(e.scene.rests.axis, e.scene.rests.sign, strict=True)})
    words = (
        f"{n} rests on {faces} faces leave {plain(free, 2)} of {3 * n} equations of specific force "
        "over. They test whether opposite faces have the same bias"
    )
    words += (
        "; scale factors and misalignments are not tested: an error there would not be seen."
        if n == faces
        else ", and whether rests on the same face agree."
    )
    return Check("redundancy", free, None, None, True, words)


def _explained(e: FaceEvidence, kind: str) -> Check:
    """Compare residuals with all that is believed, and say what had to be added for that."""
    value, dof = e.component(kind)
    what = _KINDS[kind]
    name = f"noise of {what}"
    if not e.noise.known and kind in e.found:
        left, known = float(e.found[kind].dof), e.found[kind].sd > 0
        fine = left >= TOLD and known
        words = f"The noise of {what} is unknown " + (
            f"and was taken from its residuals ({plain(left, 2)} redundant)."
            if fine
            else f"and the residuals do not tell it ({plain(left, 2)} redundant, {TOLD:g} needed): "
            "the uncertainties mean little. Declare [noise], or repeat the rests."
        )
        return Check(name, left if known else 0.0, TOLD, None, fine, words)
    if dof < 0.5:
        return Check(name, float("nan"), None, None, True, f"Nothing tests the noise of {what}.")
    low, high = chi_square_limits(dof)
    words = _added(e, kind)
    added = bool(words)
    ratio, free = plain(float(np.sqrt(value / dof)), 3), plain(dof, 2)
    words += f"The residuals of {what} are {ratio} times what is expected"
    words += f" ({free} degrees of freedom)"
    if value > high:
        words += _excess(e, kind)
    elif value < low and not added:
        words += ": the noise or the errors of placement are overstated, and so are the "
        words += "uncertainties."
    else:
        words += "."
    # Uncertainties that are too large, from noise measured at rest, are only careful. Declared
    # noise that is contradicted is not.
    wrong = e.declared and _contradicted(e, kind)
    least = low if e.declared and not added else None
    return Check(name, value, least, high, value <= high and not wrong, words)


_KINDS = {
    "accel": "specific force at rest",
    "gyro": "angular rate at rest",
    "turns": "turns",
}


def _contradicted(e: FaceEvidence, kind: str) -> bool:
    part = {"accel": "repeats", "gyro": "gyro"}.get(kind, "")
    return part in e.found and e.found[part].significant


def _added(e: FaceEvidence, kind: str) -> str:
    """Say what was added to the noise because the residuals asked for it."""
    placed = e.found.get("placement")
    out = ""
    if kind == "accel" and e.belief.accel > 0:
        size = plain(e.belief.accel / 9.80665e-3, 2)
        out += f"rests on the same face differ by {size} mg beyond the noise; "
    if kind == "accel" and placed is not None and placed.sd > 0:
        ratio = plain(float(np.sqrt(placed.chi_square / placed.dof)), 3)
        out += (
            f"opposite faces disagree {ratio} times as much as the noise explains, which was taken "
            f"for errors of placement of {plain(placed.sd * ARCMIN, 2)} arcmin; "
        )
    if kind == "gyro" and e.belief.gyro > 0:
        size = plain(np.degrees(e.belief.gyro) * 3600, 2)
        out += f"the rates scatter by {size} deg/h beyond the noise"
        if "gyro.g_sensitivity.xx" not in e.estimate.coefficients.layout:
            out += " (try g_sensitivity = true in [procedure])"
        out += "; "
    if not out:
        return ""
    return f"{out[0].upper()}{out[1:-2]}: this is part of the uncertainties. "


def _excess(e: FaceEvidence, kind: str) -> str:
    if kind == "accel" and e.placement_given:
        return (
            ": the instrument was not placed as well as `placement_sd` says, or a rest is wrong. "
            "Leave `placement_sd` out to have it estimated."
        )
    if kind == "turns":
        return (
            ": the turns did not end as well as `angle_sd` and `level_sd` say. The uncertainties "
            "do not know it."
        )
    return ": a rest was disturbed, or is not what it is taken for."


def _turns(e: FaceEvidence) -> Check:
    _, dof = e.component("turns")
    m = e.scene.sizes[2]
    if dof >= 0.5:
        return _explained(e, "turns")
    words = (
        f"{m} turns determine nine gyro coefficients and nothing is left over: a turn that was not "
        "as declared would not be seen. Turn about each axis twice to test it."
    )
    return Check("noise of turns", float("nan"), None, None, True, words)


def _whole(e: FaceEvidence) -> Check:
    """Doubt a turn that a plausible scale factor hardly explains: one turn cannot tell the two."""
    vector, turns = e.estimate.coefficients, e.scene.turns
    assert turns is not None
    names = [f"gyro.scale.{a}" for a in AXES]
    values = np.array([vector.value(n) for n in names])
    known = np.array([np.isfinite(vector.prior_sd[vector.names.index(n)]) for n in names])
    single = np.bincount(turns.axis, minlength=3) == 1
    alone = single & ~known & (not e.angle_given)
    limits = np.where(alone, SINGLE, PARTIAL)
    k = int(np.argmax(np.abs(values) / limits))
    value, limit = float(values[k]), float(limits[k])
    fine = abs(value) <= limit
    sd = f"{plain(e.belief.angle * ARCMIN, 2)} arcmin"
    words = f"The turns, as the data show: {'; '.join(turns_in_words(e.scene))}. They are as whole "
    words += f"as the scale factors of the gyros allow to say; they count as exact to {sd} (sd)"
    words += ", as declared." if e.angle_given else ", like the placements: declare `angle_sd`."
    if not fine:
        off = np.degrees(np.abs(turns.angle[turns.axis == k]).min()) * abs(value)
        words = (
            f"The turn about {AXES[k]} is {100 * value:+.1f} % off: a scale factor error of the "
            f"gyro, or {off:.0f} deg that were turned too much or too little. "
        )
        words += "A single turn cannot tell. " if alone[k] else ""
        words += "Turn against a stop, and twice about each axis, or declare `angle_sd`."
    return Check("whole turns", 100 * value, -100 * limit, 100 * limit, fine, words)


def _placement(e: FaceEvidence) -> Check:
    sd = e.belief.placement
    size = f"{plain(sd * ARCMIN, 2)} arcmin"
    where = "as declared" if e.placement_given else "as the residuals show"
    words = f"The placements are off by {size} (sd), {where}; they are part of the uncertainties."
    if sd == 0:
        words = "The placements count as exact" + (", as declared." if e.placement_given else ".")
    fine = sd <= ROUGH
    if not fine:
        words += " That is too much: use a block with square faces on a level support."
    return Check("placement", sd * ARCMIN, None, ROUGH * ARCMIN, fine, words)


def findings(e: FaceEvidence) -> list[Finding]:
    """Return what was noticed: an unknown latitude, an unknown noise, a bad rest."""
    out, r = [], e.scene.rests
    if r.gyro is None:
        out.append(finding("session.no_gyro"))
    elif e.scene.site.latitude is None:
        sd = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
        out.append(finding("session.no_latitude", sd=f"{sd:.0f}"))
    if not e.noise.known:
        out.append(finding("readings.noise_unknown"))
    if e.noise.known:
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
    """Name the rest that fits worst, where it fits worse than chance allows."""
    s, n = e.snooping, e.scene.sizes[0]
    tested = np.flatnonzero(s.dof > 0)
    if not len(tested):
        return []
    limit = np.array([chi_square_limits(d, tests=len(tested))[1] for d in s.dof[tested]])
    over = s.test[tested] / limit
    j = int(tested[np.argmax(over)])
    if over.max() <= 1 or j >= 2 * n:
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
    sd = e.scene.site.gravity_sd
    g = (
        f"its standard uncertainty, {sd / 1e-5:.3g} mGal, is part of every uncertainty"
        if sd
        else "it was taken as exact"
    )
    out = [
        f"A wrong local gravity: 1 ppm of g is 1 ppm in all accelerometer scale factors; {g}.",
        "Faces that are not square to one another, alike on opposite sides: that is a misalignment "
        "of the accelerometers. Only what differs between opposite faces shows in the residuals.",
        "Specific force beyond 1 g: there the result is extrapolated.",
        "Other temperatures than that of the session.",
    ]
    if e.scene.turns is not None:
        out.append(
            "A turn that ended where it should not: 1 deg of 360 is 2800 ppm of the gyro's scale "
            "factor; `angle_sd` says how well it ended."
        )
    if e.scene.rests.gyro is not None and e.scene.site.latitude is None:
        out.append("The Earth's rotation: without a latitude it cannot be told from gyro bias.")
    if "accel.quadratic.x" in e.estimate.coefficients.layout:
        out.append(
            "The quadratic terms apart from errors of placement: they are the difference between "
            "the bias along the vertical and that across it."
        )
    return out
