"""Judge the calibration of a session: held-out rests, checks, hints, tables for the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.diagnose.coverage import Coverage
from foucault.diagnose.held_out import norm_with_sd, rest_cov
from foucault.errors import ADVICE, Finding, Status, finding
from foucault.estimate import norm_observation
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.session_likelihood import Component
from foucault.models.rests_and_turns import Prediction, Session
from foucault.models.session_noise import SessionNoise
from foucault.result import Check, Estimate, Level
from foucault.tables import AXES

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

ENOUGH_RESTS = 12
"""Fewer rests leave too little redundancy to notice that one is wrong [1]."""

CONDITION = (25.0, 500.0)
"""Condition number of the norm equations: doubtful and unusable beyond [1]. Even coverage has
about 5, rests within 60 degrees of one axis about 60."""

UNSTILL = {"accel": 0.05, "turn": np.radians(1.0)}
"""Scatter that is no longer a calibration: 5 mg at rest [m/s^2], 1 deg in a turn [rad]."""


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at.

    `up_b`, shape (rests, 3) [1], is the direction of up in each rest; `held_out`, shape (rests,)
    twice, the error of the norm predicted without the rest and its sd [m/s^2].
    """

    session: Session
    estimate: Estimate
    noise: SessionNoise
    declared: bool
    before: Mapping[str, Component]
    after: Mapping[str, Component]
    coverage: Coverage
    up_b: FloatArray
    held_out: tuple[FloatArray, FloatArray]


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason.

    Parameters
    ----------
    e : Evidence
        Data, estimate and diagnostics.
    """
    ended = status_checks(e.estimate.status, len(e.up_b), e.estimate.weakest)
    out = [*ended, _half_space(e), _condition(e), *_plausible(e)]
    out += [_explained(e, name, what) for name, what in _KINDS.items() if name in e.before]
    out += _unstill(e)
    out += _even(e)
    if np.isfinite(e.held_out[0]).any():
        out.append(_held_out(e))
    return tuple(out)


_KINDS = {
    "accel_repeatability": "specific force at rest",
    "gyro_repeatability": "angular rate at rest",
    "turn_repeatability": "turns",
}


def status_checks(status: Status, rests: int, weakest: tuple[str, ...] = ()) -> tuple[Check, ...]:
    """Return the checks that every cost has: it converged, and there were rests enough.

    Parameters
    ----------
    status : Status
        How the estimation ended.
    rests : int, shape ()
        Number of rests [1].
    weakest : tuple of str
        Combinations of coefficients that were not seen.
    """
    return _converged(status, weakest), _rests(rests)


def _converged(status: Status, weakest: tuple[str, ...]) -> Check:
    fine = status is Status.CONVERGED
    words = ADVICE[status]
    if weakest:
        words += " Not seen: " + "; ".join(weakest) + "."
    return Check("converged", float(fine), 1.0, None, fine, words, Level.UNUSABLE)


def _rests(n: int) -> Check:
    fine = n >= ENOUGH_RESTS
    words = (
        f"{n} rests were used."
        if fine
        else f"Only {n} rests: at least {ENOUGH_RESTS} are needed to notice a bad one."
    )
    return Check("rests", n, ENOUGH_RESTS, None, fine, words)


def _half_space(e: Evidence) -> Check:
    value = e.coverage.half_space
    fine = value < 0.0
    missing = ", ".join(words for _, words in e.coverage.missing) or "nothing"
    words = (
        "The orientations lie on all sides."
        if fine
        else f"All rests lie in one half-space: bias and scale are hard to tell apart. "
        f"Add rests with {missing}."
    )
    return Check("half-space", value, None, 0.0, fine, words)


def _condition(e: Evidence) -> Check:
    rows = norm_observation.design(e.up_b, 1.0)
    value = float(np.linalg.cond(rows / np.linalg.norm(rows, axis=0)))
    doubtful, unusable = CONDITION
    fine = value <= doubtful
    level = Level.UNUSABLE if value > unusable else Level.DOUBTFUL
    missing = ", ".join(words for _, words in e.coverage.missing) or "more directions"
    words = (
        f"The orientations determine the accelerometer coefficients well (condition {value:.0f})."
        if fine
        else f"The orientations determine the accelerometer coefficients poorly (condition "
        f"{value:.0f}, even coverage has 5). Add rests with {missing}."
    )
    return Check("condition", value, None, doubtful, fine, words, level)


def _plausible(e: Evidence) -> list[Check]:
    """A scale factor error of a third is a wrong unit, not an instrument."""
    out = []
    for triad, words in (("accel", "accelerometer"), ("gyro", "gyro")):
        names = [n for n in e.estimate.coefficients.names if n.startswith(f"{triad}.scale.")]
        if not names:
            continue
        values = [e.estimate.coefficients.value(n) for n in names]
        value = float(max(values, key=abs))
        fine = abs(value) < 0.3
        sentence = (
            f"The largest {words} scale factor error is {100 * value:.2g} %."
            if fine
            else f"A {words} scale factor error of {100 * value:.0f} % is a wrong unit or count "
            f"scale, not an instrument: check [log.{triad}]."
        )
        out.append(Check(f"{triad} scale", value, -0.3, 0.3, fine, sentence, Level.UNUSABLE))
    return out


def _explained(e: Evidence, name: str, what: str) -> Check:
    c = e.before[name]
    added = getattr(e.noise, name) > 0
    inside = c.low <= c.chi_square <= c.high
    ratio = np.sqrt(c.ratio)
    if inside:
        words = f"The residuals of {what} are as large as the noise says ({ratio:.2f} times)."
    elif c.chi_square < c.low:
        words = (
            f"The residuals of {what} are only {ratio:.2f} times what the noise says: the noise "
            f"is overstated and so are the uncertainties."
        )
    elif added:
        words = f"The residuals of {what} are {ratio:.1f} times what the noise explains"
        words += (
            ": the declared noise is too small. The uncertainties include the scatter."
            if e.declared
            else "; the scatter was estimated and is part of the uncertainties."
        )
    else:
        words = (
            f"The residuals of {what} are {ratio:.1f} times what the noise explains, and the "
            f"uncertainties do not know it."
        )
    # Noise measured in the rests is a lower limit, and scatter beyond it is accounted for;
    # noise that was declared and is contradicted makes the result doubtful. Measured noise that
    # is too large (hands shake in the rests) only makes the uncertainties careful.
    fine = inside or (not e.declared and (added or c.chi_square < c.low))
    return Check(f"noise of {what}", c.chi_square, c.low, c.high, fine, words)


def _unstill(e: Evidence) -> list[Check]:
    rows = (
        ("accel", e.noise.accel_repeatability, 1 / 9.80665e-3, "mg", "The rests"),
        ("turn", e.noise.turn_repeatability, 180 / np.pi, "deg", "The turns"),
    )
    out = []
    for key, value, scale, unit, what in rows:
        limit = UNSTILL[key]
        fine = value <= limit
        words = f"{what} scatter by {value * scale:.2g} {unit} beyond the noise" + (
            "."
            if fine
            else f", more than {limit * scale:.2g} {unit}: the instrument moved in its rests, or "
            f"the log is damaged (lost samples, wrong sample rate)."
        )
        out.append(Check(f"scatter of {what[4:]}", value, None, limit, fine, words))
    return out


def _even(e: Evidence) -> list[Check]:
    """Compare the residuals of the first and the second half of the session."""
    from scipy.special import fdtri

    n = len(e.up_b)
    kinds = {"rests": np.arange(n)}
    if e.session.gyro_mean is not None:
        kinds["turns"] = np.arange(2 * n, 3 * n - 1)
    out = []
    for what, mine in kinds.items():
        halves = [np.isin(e.estimate.blocks, part) for part in np.array_split(mine, 2)]
        square = [float(np.sum(e.estimate.residuals[h] ** 2)) for h in halves]
        dof = [max(float(np.sum(1 - e.estimate.leverage[h])), 1.0) for h in halves]
        ratio = (square[0] / dof[0]) / max(square[1] / dof[1], 1e-300)
        alpha = FALSE_ALARM / len(kinds)
        low = 1 / float(fdtri(dof[1], dof[0], 1 - alpha / 2))
        high = float(fdtri(dof[0], dof[1], 1 - alpha / 2))
        fine = low <= ratio <= high
        worse = "first" if ratio > 1 else "second"
        times = np.sqrt(max(ratio, 1 / ratio))
        words = (
            f"Both halves of the session fit alike ({what})."
            if fine
            else f"The {what} of the {worse} half of the session fit {times:.1f} times worse than "
            f"the others: it was disturbed, warming up, or lost samples, and no single "
            f"uncertainty describes all of it."
        )
        out.append(Check(f"evenness of {what}", ratio, low, high, fine, words))
    return out


def _held_out(e: Evidence) -> Check:
    error, sd = e.held_out
    used = np.isfinite(error)
    score = float(np.sum((error[used] / sd[used]) ** 2))
    dof = int(used.sum())
    low, high = chi_square_limits(dof)
    inside = score <= high
    ratio = np.sqrt(score / dof)
    rms = np.sqrt(np.mean(error[used] ** 2)) / 9.80665e-6
    words = (
        f"Rests that the fit did not see are predicted to {rms:.0f} ug, {ratio:.2f} times their "
        f"predicted uncertainty."
    )
    return Check("held-out rests", score, low, high, inside, words)


def hints(e: Evidence, prediction: Prediction) -> list[Finding]:
    """Return findings about the session: scatter, outliers, a wrong g, a missing term.

    Parameters
    ----------
    e : Evidence
        Data, estimate and diagnostics.
    prediction : Prediction
        Residuals at the solution [SI].
    """
    return [*_scatter(e), *_outliers(e), *_common_scale(e), *_g_sensitivity(e, prediction)]


def _scatter(e: Evidence) -> list[Finding]:
    sizes = (
        ("the specific forces at rest", e.noise.accel_repeatability / 9.80665e-3, "mg"),
        ("the rates at rest", np.degrees(e.noise.gyro_repeatability) * 3600, "deg/h"),
        ("the turns", np.degrees(e.noise.turn_repeatability), "deg"),
    )
    return [
        finding("session.scatter", what=what, sd=f"{size:.2g} {unit}")
        for what, size, unit in sizes
        if size > 0
    ]


def _outliers(e: Evidence) -> list[Finding]:
    n, out = len(e.session.accel_mean), []
    names = ("rest", "rest", "turn")
    for block in np.flatnonzero(e.estimate.weights < 0.5).tolist():
        kind, j = min(block // n, 2), block % n if block < 2 * n else block - 2 * n
        at = int(e.session.last[j]) - 1 if kind == 2 else int(e.session.first[j])
        weight = e.estimate.weights[block]
        out.append(
            finding(
                "session.outlier",
                what=names[kind],
                time=f"{e.session.log.time[at]:.1f}",
                norm=f"{3 / weight:.0f}",
                weight=f"{weight:.2f}",
            )
        )
    return out


def _common_scale(e: Evidence) -> list[Finding]:
    if "accel.scale.x" not in e.estimate.coefficients.layout:
        return []
    values = e.estimate.coefficients["accel.scale"].values
    mean = float(values.mean())
    if abs(mean) < 1500e-6 or float(np.ptp(values)) > abs(mean) / 3:
        return []
    gravity = f"{e.session.site.gravity:.5f}"
    return [finding("session.common_scale", ppm=f"{mean * 1e6:.0f}", gravity=gravity)]


def _g_sensitivity(e: Evidence, prediction: Prediction) -> list[Finding]:
    """Regress the gyro residuals at rest on specific force, where they are unexplained."""
    if e.noise.gyro_repeatability == 0 or "gyro.g_sensitivity.xx" in e.estimate.coefficients.layout:
        return []
    n = len(e.up_b)
    residual = prediction.residuals[n : 2 * n]
    rows = np.column_stack([e.up_b, np.ones(n)])
    fit, *_ = np.linalg.lstsq(rows, residual)
    share = 1 - np.sum((residual - rows @ fit) ** 2) / np.sum(residual**2)
    # Three columns explain 3/n of pure scatter; ask for far more before speaking.
    if n < 12 or share < 0.5:
        return []
    size = np.degrees(np.abs(fit[:3]).max()) * 3600
    return [finding("session.g_sensitivity", share=f"{100 * share:.0f}", size=f"{size:.0f}")]


def tables(e: Evidence, prediction: Prediction, base: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables "rests" and "turns" of the report.

    Parameters
    ----------
    e : Evidence
        Data, estimate and diagnostics.
    prediction : Prediction
        Residuals at the solution [SI].
    base : mapping
        The columns that `diagnose.rests.rest_table` makes.
    """
    s, n = e.session, len(e.up_b)
    norm, sd = norm_with_sd(
        e.estimate.state.model, e.estimate.coefficients, s.accel_mean, rest_cov(s, e.noise)
    )
    worst = _worst(e.estimate, n)
    rests = dict(base) | {f"up_{a}": e.up_b[:, i] for i, a in enumerate(AXES)}
    rests |= {
        "norm_before": np.linalg.norm(s.accel_mean, axis=1),
        "norm_after": norm,
        "norm_sd": sd,
        "held_out": e.held_out[0],
        "held_out_sd": e.held_out[1],
        "residual": worst[:n],
        "weight": e.estimate.weights[:n],
    }
    if s.gyro_mean is None:
        return {"rests": rests}
    rho = prediction.residuals[2 * n :]
    C_se = prediction.C_se
    # The rotation error, moved to the end of the turn, as it shows in the direction of up.
    error = np.cross(np.einsum("nji,nj->ni", C_se, rho), e.up_b[1:])
    cosine = np.clip((np.trace(C_se, axis1=1, axis2=2) - 1) / 2, -1, 1)
    turns = {
        "start": s.log.time[s.last[:-1] - 1],
        "end": s.log.time[s.first[1:]],
        "angle": np.arccos(cosine),
        "path": prediction.turn_path,
        **{f"error_{a}": error[:, i] for i, a in enumerate(AXES)},
        "residual": worst[2 * n :],
        "weight": e.estimate.weights[2 * n :],
    }
    return {"rests": rests, "turns": turns}


def _worst(estimate: Estimate, n: int) -> FloatArray:
    """Largest white residual of each observation, with its sign."""
    used = estimate.blocks >= 0
    rows = estimate.residuals[used].reshape(-1, 3)
    return np.asarray(np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], 1)[:, 0])


def coverage_json(c: Coverage, directions: int) -> dict[str, Any]:
    """Return coverage as plain values for result.json.

    Parameters
    ----------
    c : Coverage
        The coverage.
    directions : int, shape ()
        Number of rests [1].
    """
    missing = [{"direction": d.tolist(), "words": words} for d, words in c.missing]
    return {
        "missing": missing,
        "largest_gap": c.largest_gap,
        "half_space": c.half_space,
        "flatness": c.flatness,
        "directions": directions,
    }


def chi_square_json(parts: Mapping[str, Component]) -> dict[str, list[float]]:
    """Return sums of squares with their limits as plain values for result.json.

    Parameters
    ----------
    parts : mapping of str to Component
        Fit of each kind of observation.
    """
    short = {"accel_repeatability": "accel", "gyro_repeatability": "gyro"}
    out: dict[str, list[float]] = {}
    for name, c in parts.items():
        out[short.get(name, "turns")] = [c.chi_square, c.low, c.high, c.redundancy]
    return out
