"""Findings and tables of a session: what the report shows beside the checks."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.hand_rotated.held_out import rest_cov
from foucault.diagnose.norm import norm_with_cov
from foucault.errors import Finding, finding
from foucault.estimate import gauss_newton
from foucault.estimate.hand_rotated.likelihood import SCATTER, session_of
from foucault.infer.mixed import Fit, HeldOut, causes
from foucault.models.rests_and_turns import Prediction, Session
from foucault.models.session_noise import SessionNoise
from foucault.result import Estimate
from foucault.tables import AXES, temperature_range


def hints(fit: Fit, prediction: Prediction, turned_round: bool = False) -> list[Finding]:
    """Return findings about the session: scatter, outliers, a wrong g, a missing term.

    `fit`: of the model of a session; `prediction`: residuals at the solution [SI];
    `turned_round`: whether the Earth's rate has the wrong sign: g-sensitivity would only hide it.
    """
    model = session_of(fit)
    coarse = _resolution(model.session, model.noise)
    found = [*coarse, *_scatter(fit), *_outliers(fit), *_common_scale(fit)]
    return found if turned_round or coarse else found + _g_sensitivity(fit, prediction)


COARSE = 3.0
"""A constant rounding error this many times the noise of a rest's mean is worth saying [1]."""


def _resolution(session: Session, noise: SessionNoise) -> list[Finding]:
    """Name a triad whose steps are so coarse that its mean does not average the rounding."""
    rest = float(np.median(session.rest_time))
    rows = (
        ("accelerometers", noise.accel_rounding, noise.accel_psd, 1 / 9.80665e-3, "mg"),
        ("gyros", noise.gyro_rounding, noise.gyro_psd, 180 / np.pi * 3600, "deg/h"),
    )
    return [
        finding("session.resolution", what=what, sd=f"{rounding.max() * scale:.2g} {unit}")
        for what, rounding, psd, scale, unit in rows
        if np.any(rounding > COARSE * np.sqrt(psd / rest))
    ]


def _scatter(fit: Fit) -> list[Finding]:
    """Name scatter that is significant; a little is estimated in every session."""
    degrees = 180 / np.pi
    rows = (
        ("accel", "the specific forces at rest", 1 / 9.80665e-3, "mg"),
        ("gyro", "the rates at rest", degrees * 3600, "deg/h"),
        ("turns", "the turns", degrees, "deg"),
    )
    return [
        finding("session.scatter", what=what, sd=f"{fit.found[SCATTER[kind]] * scale:.2g} {unit}")
        for kind, what, scale, unit in rows
        if fit.found.get(SCATTER[kind]) and fit.before[kind].chi_square > fit.before[kind].high
    ]


def _outliers(fit: Fit) -> list[Finding]:
    names = {"accel": "specific force of the rest", "gyro": "rate of the rest", "turns": "turn"}
    estimate, s, out = fit.estimate, session_of(fit).session, []
    norms = gauss_newton.block_norms(estimate.residuals, estimate.blocks, estimate.weights)
    for kind, rows in fit.model.kinds.items():
        first = int(np.argmax(rows.any(axis=1)))
        at = s.last - 1 if kind == "turns" else s.first
        for k in fit.outliers[rows[fit.outliers].any(axis=1)].tolist():
            time = s.log.time[at[k - first]] - s.log.time[0]
            words = {"what": names[kind], "time": f"{time:.1f}", "norm": f"{norms[k]:.0f}"}
            out.append(finding("session.outlier", **words))
    return out


def _common_scale(fit: Fit) -> list[Finding]:
    coefficients = fit.estimate.coefficients
    if "accel.scale.x" not in coefficients.layout:
        return []
    values = coefficients["accel.scale"].values
    mean = float(values.mean())
    if abs(mean) < 1500e-6 or float(np.ptp(values)) > abs(mean) / 3:
        return []
    gravity = f"{session_of(fit).session.site.gravity:.5f}"
    return [finding("session.common_scale", ppm=f"{mean * 1e6:.0f}", gravity=gravity)]


def _g_sensitivity(fit: Fit, prediction: Prediction) -> list[Finding]:
    """Regress the gyro residuals at rest on specific force, where they are unexplained."""
    found = fit.found.get(SCATTER["gyro"])
    if not found or "gyro.g_sensitivity.xx" in fit.estimate.coefficients.layout:
        return []
    up_b = fit.state.C_nb[:, 2, :]
    n = len(up_b)
    residual = prediction.residuals[n : 2 * n]
    if session_of(fit).session.site.latitude is None:  # what is the Earth's is no g-sensitivity
        residual = residual - prediction.earth[:n] @ causes(fit, "unknown Earth rate")
    rows = np.column_stack([up_b, np.ones(n)])
    solved, *_ = np.linalg.lstsq(rows, residual, rcond=None)
    share = 1 - np.sum((residual - rows @ solved) ** 2) / np.sum(residual**2)
    # Three columns explain 3/n of pure scatter; ask for far more before speaking.
    if n < 12 or share < 0.5:
        return []
    size = np.degrees(np.abs(solved[:3]).max()) * 3600
    return [finding("session.g_sensitivity", share=f"{100 * share:.0f}", size=f"{size:.0f}")]


def tables(
    fit: Fit, prediction: Prediction, held_out: HeldOut | None, base: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the tables "rests" and "turns" of the report.

    `fit`: of the model of a session; `prediction`: residuals at the solution [SI]; `held_out`:
    norms of rests that were left out [m/s^2].
    """
    s, estimate, up_b = session_of(fit).session, fit.estimate, fit.state.C_nb[:, 2, :]
    n = len(up_b)
    norm, joint = norm_with_cov(fit.state.model, estimate.coefficients, s.accel_mean, rest_cov(fit))
    worst, none = _worst(estimate), np.full((n, 1), np.nan)
    sd = none if held_out is None else held_out.sd[:n]
    rests = dict(base) | {f"up_{a}": up_b[:, i] for i, a in enumerate(AXES)}
    rests |= {
        "norm_before": np.linalg.norm(s.accel_mean, axis=1),
        "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)),
        "held_out": (none if held_out is None else held_out.error[:n])[:, 0],
        "held_out_sd": np.where(np.isfinite(sd), sd, np.nan)[:, 0],
        "residual": worst[:n],
        "weight": estimate.weights[:n],
    }
    if s.gyro_mean is None:
        return {"rests": rests}
    rho = prediction.residuals[2 * n :]
    C_se = prediction.C_se
    # The rotation error, moved to the end of the turn, as it shows in the direction of up.
    error = np.cross(np.einsum("nji,nj->ni", C_se, rho), up_b[1:])
    cosine = np.clip((np.trace(C_se, axis1=1, axis2=2) - 1) / 2, -1, 1)
    turns = {
        "start": s.log.time[s.last[:-1] - 1],
        "end": s.log.time[s.first[1:]],
        "angle": np.arccos(cosine),
        "path": prediction.turn_path,
        **{f"error_{a}": error[:, i] for i, a in enumerate(AXES)},
        "residual": worst[2 * n :],
        "weight": estimate.weights[2 * n :],
    }
    return {"rests": rests, "turns": turns}


def _worst(estimate: Estimate) -> FloatArray:
    """Largest white residual of each observation, with its sign."""
    used = estimate.blocks >= 0
    rows = estimate.residuals[used].reshape(-1, 3)
    return np.asarray(np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], 1)[:, 0])


def unseen(data: Session, gravity_sd: float) -> list[str]:
    """Say what this procedure cannot see in principle, for result.json.

    `data`: what was observed [SI]; `gravity_sd`: standard uncertainty of local gravity [m/s^2].
    """
    g = (
        f"its standard uncertainty, {gravity_sd / 1e-5:.3g} mGal, is part of every uncertainty"
        if gravity_sd
        else "it was taken as exact"
    )
    out = [
        f"A wrong local gravity: 1 ppm of g is 1 ppm in all accelerometer scale factors; {g}.",
        "How the body axes lie in the case: they are those of the accelerometers (see gauge).",
        "Specific force beyond 1 g: there the result is extrapolated.",
        "Other temperatures than that of the session.",
    ]
    if data.log.gyro is not None and data.site.latitude is None:
        out.append("The Earth's rotation: without a latitude it cannot be told from gyro bias.")
    first_rest = ((data.log.source.get("description") or {}).get("accel") or {}).get("first_rest")
    if not first_rest:
        out.append(
            "All three signs at once, and axes exchanged alike in both triads: the orientation "
            "of the first rest is not declared."
        )
    return out


def heading_sd(estimate: Estimate) -> float:
    """Return the standard deviation of the heading of the first rest, about up [rad]."""
    up, n = estimate.state.C_nb[0, 2, :], len(estimate.coefficients)
    return float(np.sqrt(up @ estimate.state_cov[n : n + 3, n : n + 3] @ up))


def noise_json(
    noise: SessionNoise, declared: bool, found: Mapping[str, float] = MappingProxyType({})
) -> dict[str, Any]:
    """Return the noise as plain values for result.json.

    `noise`: noise [SI]; `found`: source -> scatter beyond it [SI].
    """
    return {
        "source": "declared" if declared else "measured in the rests",
        "accel_white": [float(v) for v in np.sqrt(noise.accel_psd)],
        "gyro_white": [float(v) for v in np.sqrt(noise.turn_psd)],
        "accel_repeatability": found.get(SCATTER["accel"], 0.0),
        "gyro_repeatability": found.get(SCATTER["gyro"], 0.0),
        "turn_repeatability": found.get(SCATTER["turns"], 0.0),
    }


def validity(data: Session) -> dict[str, Any]:
    """Return the ranges that the session covered: outside them the result is extrapolated.

    `data`: what was observed [SI].
    """
    log = data.log
    out: dict[str, Any] = {
        "accel": [-data.site.gravity, data.site.gravity],
        "rate": log.rate,
        "sampled": log.sampled,
    }
    if log.gyro is not None:
        # Not the single largest sample: a spike is not a range.
        out["gyro"] = [float(v) for v in np.quantile(log.gyro, (0.001, 0.999))]
    return out | temperature_range(log)
