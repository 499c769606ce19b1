"""Findings and tables of a session: what the report shows beside the checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose import information
from foucault.diagnose.hand_rotated.checks import Evidence
from foucault.diagnose.hand_rotated.held_out import rest_cov
from foucault.diagnose.norm import norm_with_cov
from foucault.errors import Finding, finding
from foucault.estimate import gauss_newton
from foucault.estimate.hand_rotated import likelihood
from foucault.estimate.hand_rotated.likelihood import Component
from foucault.models.rests_and_turns import Prediction, Session
from foucault.models.session_noise import SessionNoise
from foucault.result import Estimate
from foucault.tables import AXES, temperature_range


def hints(e: Evidence, prediction: Prediction, turned_round: bool = False) -> list[Finding]:
    """Return findings about the session: scatter, outliers, a wrong g, a missing term.

    `prediction`: residuals at the solution [SI]; `turned_round`: whether the Earth's rate has the
    wrong sign: g-sensitivity would only hide it.
    """
    found = [*_resolution(e), *_scatter(e), *_outliers(e), *_common_scale(e)]
    hidden = turned_round or bool(_resolution(e))
    return found + ([] if hidden else _g_sensitivity(e, prediction))


COARSE = 3.0
"""A constant rounding error this many times the noise of a rest's mean is worth saying [1]."""


def _resolution(e: Evidence) -> list[Finding]:
    """Name a triad whose steps are so coarse that its mean does not average the rounding."""
    rest = float(np.median(e.session.rest_time))
    rows = (
        ("accelerometers", e.noise.accel_rounding, e.noise.accel_psd, 1 / 9.80665e-3, "mg"),
        ("gyros", e.noise.gyro_rounding, e.noise.gyro_psd, 180 / np.pi * 3600, "deg/h"),
    )
    return [
        finding("session.resolution", what=what, sd=f"{rounding.max() * scale:.2g} {unit}")
        for what, rounding, psd, scale, unit in rows
        if np.any(rounding > COARSE * np.sqrt(psd / rest))
    ]


def _scatter(e: Evidence) -> list[Finding]:
    """Name scatter that is significant; a little is estimated in every session."""
    degrees = 180 / np.pi
    rows = (
        ("accel_repeatability", "the specific forces at rest", 1 / 9.80665e-3, "mg"),
        ("gyro_repeatability", "the rates at rest", degrees * 3600, "deg/h"),
        ("turn_repeatability", "the turns", degrees, "deg"),
    )
    return [
        finding("session.scatter", what=what, sd=f"{getattr(e.noise, name) * scale:.2g} {unit}")
        for name, what, scale, unit in rows
        if getattr(e.noise, name) > 0 and e.before[name].chi_square > e.before[name].high
    ]


def _outliers(e: Evidence) -> list[Finding]:
    n, out = len(e.session.accel_mean), []
    names = ("specific force of the rest", "rate of the rest", "turn")
    norms = gauss_newton.block_norms(e.estimate.residuals, e.estimate.blocks, e.estimate.weights)
    for block in np.flatnonzero(e.estimate.weights < 0.5).tolist():
        kind, j = min(block // n, 2), block % n if block < 2 * n else block - 2 * n
        at = int(e.session.last[j]) - 1 if kind == 2 else int(e.session.first[j])
        time = e.session.log.time[at] - e.session.log.time[0]
        words = {"what": names[kind], "time": f"{time:.1f}", "norm": f"{norms[block]:.0f}"}
        out.append(finding("session.outlier", **words))
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
    fit, *_ = np.linalg.lstsq(rows, residual, rcond=None)
    share = 1 - np.sum((residual - rows @ fit) ** 2) / np.sum(residual**2)
    # Three columns explain 3/n of pure scatter; ask for far more before speaking.
    if n < 12 or share < 0.5:
        return []
    size = np.degrees(np.abs(fit[:3]).max()) * 3600
    return [finding("session.g_sensitivity", share=f"{100 * share:.0f}", size=f"{size:.0f}")]


def tables(e: Evidence, prediction: Prediction, base: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables "rests" and "turns" of the report.

    `prediction`: residuals at the solution [SI].
    """
    s, n = e.session, len(e.up_b)
    norm, joint = norm_with_cov(
        e.estimate.state.model, e.estimate.coefficients, s.accel_mean, rest_cov(s, e.noise)
    )
    worst = _worst(e.estimate, n)
    rests = dict(base) | {f"up_{a}": e.up_b[:, i] for i, a in enumerate(AXES)}
    rests |= {
        "norm_before": np.linalg.norm(s.accel_mean, axis=1),
        "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)),
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


def chi_square_json(parts: Mapping[str, Component]) -> dict[str, list[float]]:
    """Return sums of squares with their limits as plain values for result.json."""
    short = {"accel_repeatability": "accel", "gyro_repeatability": "gyro"}
    out: dict[str, list[float]] = {}
    for name, c in parts.items():
        out[short.get(name, "turns")] = [c.chi_square, c.low, c.high, c.redundancy]
    return out


def bound(
    data: Session, names: tuple[str, ...], estimate: Estimate, noise: SessionNoise
) -> dict[str, Any]:
    """Return the Cramer-Rao bound of the noise alone, and what is seen worst, for result.json.

    `data`: what was observed [SI]; `noise`: its noise, the scatter in it is left out [SI].
    """
    alone = replace(noise, accel_repeatability=0.0, gyro_repeatability=0.0, turn_repeatability=0.0)
    problem = likelihood.build(data, names, estimate.state, alone)
    return information.bound(problem, estimate.state)


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


def heading_sd(estimate: Estimate, n: int) -> float:
    """Return the standard deviation of the heading of the first rest, about up [rad].

    `n`: number of coefficients [1].
    """
    up = estimate.state.C_nb[0, 2, :]
    return float(np.sqrt(up @ estimate.state_cov[n : n + 3, n : n + 3] @ up))


def noise_json(noise: SessionNoise, declared: bool) -> dict[str, Any]:
    """Return the noise as plain values for result.json.

    `noise`: noise with scatter [SI].
    """
    return {
        "source": "declared" if declared else "measured in the rests",
        "accel_white": [float(v) for v in np.sqrt(noise.accel_psd)],
        "gyro_white": [float(v) for v in np.sqrt(noise.turn_psd)],
        "accel_repeatability": noise.accel_repeatability,
        "gyro_repeatability": noise.gyro_repeatability,
        "turn_repeatability": noise.turn_repeatability,
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
