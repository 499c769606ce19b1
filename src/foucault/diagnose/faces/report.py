"""The table "readings" of a calibration on faces: its rests and turns, before and after."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.faces.checks import FaceEvidence
from foucault.diagnose.norm import norm_with_cov
from foucault.tables import AXES


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
        "turns": np.zeros(n), **_triad("accel", r.accel),
        **_triad("gyro", np.full((n, 3), np.nan) if r.gyro is None else r.gyro),
        **_triad("up", r.up_k @ state.C_bk.T),
        "norm_before": np.linalg.norm(r.accel, axis=1), "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)), "rate_before": rate, "rate_after": none,
        "rate_true": none, "residual": _worst(e)[:n], "weight": np.ones(n),
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
        **_triad("accel", t.accel / time), **_triad("gyro", t.gyro / time),
        **_triad("up", t.axis_k * sense[:, None] @ state.C_bk.T),
        "norm_before": none, "norm_after": none, "norm_sd": none,
        "rate_before": np.linalg.norm(t.gyro / time, axis=1),
        "rate_after": np.linalg.norm(rate, axis=1),
        "rate_true": np.linalg.norm(scene.turn_k / time, axis=1),
        "residual": _worst(e)[-m:], "weight": np.ones(m), "detectable": none,
    }  # fmt: skip


def _triad(name: str, x: FloatArray) -> dict[str, FloatArray]:
    return {f"{name}_{a}": x[:, i] for i, a in enumerate(AXES)}


def _worst(e: FaceEvidence) -> FloatArray:
    """Largest white residual of each observation, with its sign."""
    rows = e.fit.estimate.residuals[e.fit.estimate.blocks >= 0].reshape(-1, 3)
    return np.asarray(np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], 1)[:, 0])
