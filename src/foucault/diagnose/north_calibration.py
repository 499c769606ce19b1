"""Judge the calibration of a north seeker: gross mistakes, checks, headings that stand out.

What its report shows beside the checks is here too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import check
from foucault.diagnose.fit_checks import Judged, chi_square_json, explained, said_once
from foucault.diagnose.fit_checks import checks as general_checks
from foucault.diagnose.north import MATTERS, offset_drift
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.north import ACCEL, GYRO, LEVEL, Known, Rig, solve, tilts
from foucault.estimate.north_reduction import INDEXING, Pairs
from foucault.infer.gauss_newton import Component, chi_square_limits
from foucault.infer.mixed import Fit, HeldOut, causes, held_out
from foucault.models.north_seeker import Compensation, Dwells
from foucault.models.rotation import turned
from foucault.result import Check, Estimate
from foucault.units import STANDARD_GRAVITY

SIGNIFICANT = 0.01
"""The coupling of the third rate is there where chance gives it less often than this [1]."""

TURNED = np.radians(20.0)
"""An index zero further off than this is a mistake, no misalignment [rad]."""

FAR = 0.01
"""Scale factors, or a turn about the axis of the base, that are larger than this may well be a
mistake; instruments have a few tenths of it [1]."""

SUSPECT = 1e-2
"""Accelerometer biases that may rather be a case that stands askew on the table [m/s^2]."""

VAGUE = 0.1  # Standard deviation of a scale factor or coupling that is as good as unknown [1].

NOTHING = 1e-6
"""Part of the Earth's rate that is read by a gyro that reads nothing: no unit is so wrong [1]."""

UNKNOWN = "from the residuals"
NOISE: dict[str, Literal["declared", "measured", "unknown"]] = {
    "declared": "declared", "measured in the dwells": "measured", UNKNOWN: "unknown",
}  # fmt: skip
"""Where the noise is from, here and in `diagnose.fit_checks`."""

KINDS = {
    GYRO: "gyro rates over headings", ACCEL: "specific forces over headings",
    "gyro over index angles": "gyro readings over index angles",
    "accel over index angles": "accelerometer readings over index angles",
}  # fmt: skip
"""Kinds of reading, of the calibration and within the set-ups, and what people call them."""

LEAN, BIASED = 2e-3, 2e-2
"""A table leaned on purpose where its set-ups depart from one axis by the first, or where the
accelerometers would have biases of the second [g]."""


def leans(pairs: Pairs, rig: Rig) -> bool:
    """Tell whether the accelerometers say that the table was tilted on purpose.

    On one axis the horizontal specific force is a constant, the bias, and a vector that turns with
    the heading.
    """
    s, c = np.sin(rig.heading), np.cos(rig.heading)
    m, zero, one = len(pairs), np.zeros(len(pairs)), np.ones(len(pairs))
    right = np.stack([one, zero, c, -s], 1)  # x_b of a vector (E, N)
    forward = np.stack([zero, one, s, c], 1)
    force = pairs.values[:, 2:].T.ravel() / rig.site.gravity
    design = np.concatenate([right, forward])
    found = np.linalg.lstsq(design, force, rcond=None)[0]
    left = np.abs(force - design @ found).max()
    return bool(left > LEAN or (np.abs(found[:2]).max() > BIASED and m > 1))


def z_significance(estimate: Estimate) -> tuple[float, float]:
    """Test whether the coupling of the rate along z_b is there.

    Returns chi-square with two degrees of freedom, and how often chance gives so much [1].
    """
    from scipy.special import chdtrc

    c = estimate.coefficients
    keep = [c.layout.index(f"gyro.misalignment.{o}z") for o in "xy"]
    assert c.cov is not None
    value = c.values[keep] @ np.linalg.solve(c.cov[np.ix_(keep, keep)], c.values[keep])
    return float(value), float(chdtrc(2.0, value))


def z_findings(test: tuple[float, float], chosen: str) -> list[Finding]:
    """Say what `z_significance`, `test` [1], showed of that coupling, where it matters."""
    if chosen == "no" and test[1] < SIGNIFICANT:
        return [finding("north.z_left_out", p=f"{test[1]:.2g}")]
    if chosen == "free" and test[1] > SIGNIFICANT:
        return [finding("north.z_not_seen", p=f"{test[1]:.2g}")]
    return []


def require_sound(estimate: Estimate) -> None:
    """Raise where headings do not span, or a sense, zero or unit is plainly wrong."""
    if estimate.status is Status.UNOBSERVABLE:
        weakest = "; ".join(estimate.weakest) or "the coefficients, with the tilt of the table"
        raise error("north.undetermined", names=weakest)
    c = estimate.coefficients
    vague = [n for n, sd in zip(c.names, c.sd, strict=True) if "bias" not in n and sd > VAGUE]
    if vague and all(name.endswith(("xz", "yz")) for name in vague):  # which tilts alone show
        raise error("north.tilts_contradict", names=", ".join(vague), sd=f"{max(c.sd):.2g}")
    if vague:  # seen only by what a table that is not quite level turns into them
        raise error("north.undetermined", names=", ".join(vague))
    model = Compensation(estimate.coefficients).model
    M = model.gyro_matrix[:2, :2]
    det = float(np.linalg.det(M))
    size = np.sqrt(abs(det))
    if det < 0 and size > NOTHING:
        raise error("north.sense")
    if not 0.5 < size < 2:
        raise error("north.gyro_scale", factor=f"{size:.4g}" if size > NOTHING else "0")
    angle = _turn(M)
    if abs(angle) > TURNED:
        raise error("north.index_zero", angle=f"{np.degrees(angle):.1f}")


def _turn(M: FloatArray) -> float:
    """Return by how much a 2 x 2 matrix turns, clockwise [rad]."""
    return float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]))


def suspicious(estimate: Estimate, latitude: float) -> list[Finding]:
    """Name what fits, but is larger than instruments have, at `latitude` [rad]."""
    M = Compensation(estimate.coefficients).model.gyro_matrix[:2, :2]
    found = []
    size = float(np.sqrt(np.linalg.det(M)))
    if abs(size - 1) > FAR:
        like = np.degrees(np.arccos(min(np.cos(latitude) * size, 1.0)))
        found.append(finding("north.scale_common", size=f"{100 * (size - 1):+.2g}",
                             latitude=f"{np.copysign(like, latitude):.1f}"))  # fmt: skip
    c = estimate.coefficients
    bias = float(np.hypot(c.get("accel.bias.x"), c.get("accel.bias.y")))
    if bias > SUSPECT:
        lean = f"{np.degrees(bias / STANDARD_GRAVITY) * 60:.0f}"
        mg = f"{bias / STANDARD_GRAVITY * 1e3:.2g}"
        found.append(finding("north.wedge", bias=mg, lean=lean))
    angle = _turn(M)
    if abs(angle) > FAR:
        found.append(finding("north.turned", angle=f"{np.degrees(angle):.2f}"))
    return found


def within(pairs: Pairs) -> dict[str, Component]:
    """Return how gyro and accelerometers fit over the index angle within set-ups [SI]."""
    names = [kind for kind in KINDS if kind not in (GYRO, ACCEL)]
    square, dof = pairs.chi_square.sum(axis=0), pairs.dof.sum(axis=0).astype(float)
    return {
        name: Component(float(v), float(n), *chi_square_limits(n, tests=len(KINDS)))
        for name, v, n in zip(names, square, dof, strict=True)
        if n
    }


def chi_square(fit: Fit, pairs: Pairs) -> dict[str, list[float]]:
    """Return sums of squares, their limits and degrees of freedom [1], for result.json."""
    return chi_square_json({**fit.after, **within(pairs)})


def checks(
    fit: Fit, pairs: Pairs, rig: Rig, dwells: Dwells, source: str, apart: HeldOut
) -> tuple[Check, ...]:
    """Return every test; `apart`: set-ups [SI] predicted from the others, noise by `source`."""
    inside, found_in = within(pairs), {}
    if INDEXING in rig.assumed:  # a size that nobody declared may be too large, and is no fault
        inside = {kind: replace(c, low=0.0) for kind, c in inside.items()}
    if source == UNKNOWN:  # by residuals of the set-ups and of what is within
        own = zip(fit.after.items(), pairs.dof.sum(axis=0), strict=False)
        fit = replace(fit, dof={kind: c.redundancy + n for (kind, c), n in own})
        inside, found_in = {}, {kind: (kind,) for kind in fit.dof}
    middle = np.bincount(dwells.setup, dwells.start + dwells.time / 2) / np.bincount(dwells.setup)
    cause = "the noise is larger than said, or a heading, index angle or reading is wrong"
    e = Judged(
        fit, KINDS, NOISE[source], middle, found_in,
        readings="headings", cure="Add headings.", cause=dict.fromkeys(KINDS, cause),
        named=lambda i: f"'{dwells.names[i]}'",
        said={LEVEL: "how level the table is (level_sd in [procedure])"},
    )  # fmt: skip
    readings = replace(e, fit=replace(fit, before=inside, after=inside))
    out = general_checks(e) + [explained(readings, kind) for kind in inside]
    out += _fitting(apart, fit.estimate, source) + _level(fit, rig)
    return (*said_once(out, "level"), *_offset_drift(pairs, fit.estimate.coefficients, dwells))


def _offset_drift(pairs: Pairs, c: CoefficientVector, dwells: Dwells) -> list[Check]:
    """Test what the drift of the offset from set-up to set-up does to the biases."""
    names = [n for n in ("gyro.bias.x", "gyro.bias.y") if n in c.layout]
    drift = offset_drift(pairs, dwells)
    if drift is None or not names:
        return []
    moved = np.abs(drift * pairs.drift_slope[:, : len(names)].mean(axis=0))
    sds = float(np.max(moved / [c.sd[c.layout.index(n)] for n in names]))
    rate, size = np.degrees(drift) * 3600**2, np.degrees(moved.max()) * 3600
    given = {"rate": rate, "size": size, "sds": sds}
    return [check("offset drift", "offset drift", sds, None, MATTERS, given)]


def each_apart(fit: Fit) -> HeldOut:
    """Return every set-up as the others predict it."""
    return held_out(fit, [np.array([i]) for i in range(len(fit.at.residuals))])


def _fitting(apart: HeldOut, estimate: Estimate, source: str) -> list[Check]:
    found = outlier(apart, estimate, source)
    if found is None:
        return []
    _, beyond, size = found
    given = {"what": "set-up", "size": size}
    return [check("worst", "every heading fits", beyond, None, 1.0, given)]


def _level(fit: Fit, rig: Rig) -> list[Check]:
    """Whether the table stands as level as was said, where the accelerometers can tell."""
    tilt = fit.state[len(fit.model.layout) :]
    if not (len(tilt) and np.isfinite(rig.level_sd)):
        return []
    value = float(np.sum(tilt**2)) / rig.level_sd**2
    given = {"what": "table", "ratio": np.sqrt(value / 2)}
    return [check("level", "level", value, None, chi_square_limits(2)[1], given)]


def outlier(apart: HeldOut, estimate: Estimate, source: str) -> tuple[int, float, float] | None:
    """Find the set-up that fits the others worst.

    Where the noise was measured by these very residuals it is measured anew without the set-up in
    question, for an outlier hides behind the noise that it makes.

    `apart`: every set-up predicted from the others; `source`: where the noise is from. Returns its
    number, its test over the limit (above 1: it does not fit), and its residual over the sd [1];
    None where nothing controls a set-up.
    """
    from scipy.special import fdtri

    own = np.maximum(apart.counts, 1.0)
    ratio = apart.scores / own
    n = len(ratio)
    limits = np.array([chi_square_limits(d, tests=n)[1] for d in own]) / own
    rest = estimate.dof - own
    controlled = apart.counts > 0
    if source == UNKNOWN:
        controlled &= rest >= 1
        left = np.maximum(estimate.chi_square - apart.scores, 1e-12) / np.maximum(rest, 1.0)
        ratio = ratio / left
        limits = fdtri(own, np.maximum(rest, 1.0), 1 - 0.01 / n)
    beyond = np.where(controlled, ratio / limits, 0.0)
    if not controlled.any():
        return None
    worst = int(np.argmax(beyond))
    return worst, float(beyond[worst]), float(np.sqrt(ratio[worst]))


def findings(apart: HeldOut, estimate: Estimate, dwells: Dwells, source: str) -> list[Finding]:
    """Name the heading that does not fit the others."""
    found = outlier(apart, estimate, source)
    if found is None or found[1] <= 1:
        return []
    name = dwells.names[found[0]]
    return [finding("north.heading_outlier", name=name, size=f"{found[2]:.1f}")]


# -- what the report shows beside the checks ------------------------------------------------


def table_json(fit: Fit, rig: Rig) -> dict[str, Any]:
    """Return what was found of the turntable, for result.json."""
    tilt = fit.state[len(fit.model.layout) :]
    east, north = tilt if len(tilt) else (0.0, 0.0)
    return {
        "used": rig.tilt,
        "tilt_about_east": float(east),
        "tilt_about_north": float(north),
        "heading_sd": rig.heading_sd,
        "heading_offset_sd": rig.heading_offset_sd,
    }


def unseen(rig: Rig, names: tuple[str, ...]) -> list[str]:
    """Say what the session cannot show in principle."""
    common = "it was taken as exact"
    if rig.heading_offset_sd:
        sd = np.degrees(rig.heading_offset_sd) * 60
        common = f"its standard uncertainty, {sd:.3g} arcmin, is part of every coupling"
    out = [
        f"An error that all reference headings share goes straight into every later heading; "
        f"{common}.",
        "A wrong latitude: 1 arcmin is "
        f"{np.tan(abs(rig.site.latitude or 0.0)) * np.radians(1 / 60) * 1e6:.0f} ppm in both "
        "scale factors.",
        "The gyro's constant offset, which every fix finds anew.",
        "Other index angles than those used, and other temperatures.",
    ]
    if "gyro.misalignment.xz" not in names:
        out.append(
            "Coupling of the rate along the axis of the base: 0.001 of it moves the heading by "
            "about 0.06 deg times the tangent of latitude, different at other tilts."
        )
    if rig.tilt == "each" and not rig.level_sd:
        out.append(
            "A table whose axis leans: tilted by 10 deg, 1 arcmin of it turns the headings by 11 "
            "arcsec. `level_sd` puts it into the uncertainty."
        )
    if rig.tilt == "one axis":
        out.append("Scale factor of the accelerometers: 200 ppm are 7 arcsec of tilt at 10 deg.")
    return out


def circle_accuracy(errors: FloatArray) -> dict[str, float]:
    """Return the usual figures of heading errors around the circle, for result.json.

    `errors` (m,): heading as found minus reference [rad]. Returns "std" about the mean, "max"
    departure from the mean, "peak_to_peak", and "rms" and "max_absolute" with the mean in [rad].
    """
    off = errors - errors.mean()
    return {
        "std": float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0,
        "max": float(np.abs(off).max()),
        "peak_to_peak": float(np.ptp(errors)),
        "mean": float(errors.mean()),
        "rms": float(np.sqrt(np.mean(errors**2))),
        "max_absolute": float(np.abs(errors).max()),
    }


def heading_errors(
    pairs: Pairs, rig: Rig, coefficients: CoefficientVector | None
) -> tuple[FloatArray, FloatArray]:
    """Return errors of headings, and sd, (m,) [rad] of `pairs`; `coefficients` or none."""
    level = None if rig.accelerometers else max(rig.level_sd, 1e-9)
    known = Known(rig.site.gravity, rig.site.latitude, rig.latitude_sd, level_sd=level)
    found = solve(pairs, known, Compensation() if coefficients is None else Compensation(
        coefficients))  # fmt: skip
    return turned(found.angles[:, 0] - rig.heading), found.sd[:, 0]


def heading_table(
    fit: Fit, pairs: Pairs, rig: Rig, dwells: Dwells, apart: HeldOut
) -> dict[str, npt.NDArray[Any]]:
    """Return a row per set-up: readings, what is left of them, and tilt [SI]."""
    left = fit.at.residuals.copy()
    for source in fit.at.sources:
        if source.shared is not None:
            left -= source.shared @ causes(fit, source.name)
    standard = apart.error / apart.sd
    lean = tilts(pairs, rig.site.gravity, Compensation()) if rig.accelerometers else None
    nothing = np.full(len(pairs), np.nan)
    before, _ = heading_errors(pairs, rig, None)
    after, sd = heading_errors(pairs, rig, fit.estimate.coefficients)
    return {
        "setup": np.array(dwells.names),
        "heading": rig.heading,
        "gyro_x": pairs.values[:, 0],
        "gyro_y": pairs.values[:, 1],
        "left_x": left[:, 0],
        "left_y": left[:, 1],
        "residual_x": standard[:, 0],
        "residual_y": standard[:, 1],
        "offset": pairs.offset,
        "heading_before": before,
        "heading_after": after,
        "heading_sd": sd,
        "pitch": nothing if lean is None else lean[:, 0],
        "roll": nothing if lean is None else lean[:, 1],
    }
