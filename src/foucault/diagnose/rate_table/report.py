"""What the report of a rate table shows: steps, what the standards ask for, bound and budget."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose import information
from foucault.diagnose.rate_table.checks import RateEvidence
from foucault.estimate.rate_table.likelihood import (
    Trust,
    Unknowns,
    build,
    covariance,
    wanders,
    whitening,
)
from foucault.tables import AXES


def step_table(e: RateEvidence, start: FloatArray) -> dict[str, Any]:
    """Return the table "rate_steps".

    `start` (n,): when each step began [s].
    """
    s, n = e.steps, len(e.steps)
    rows, axis = np.arange(n), e.steps.axis
    gyro = s.gyro[rows, axis]
    w_b = e.model.compensate(s.force, s.gyro)[1]
    assert w_b is not None
    kinds = covariance(s, e.trust)
    moved = e.trust.bias_sd**2 * np.eye(3)
    cov = kinds["gyro noise"] + kinds["rate jitter"] + moved
    back = np.linalg.inv(e.model.gyro_matrix)
    sd = np.sqrt(np.diagonal(back @ cov @ back.T, axis1=1, axis2=2))
    line = gyro - _lines(e)[0]
    used = e.estimate.blocks >= 0
    residual = e.estimate.residuals[used].reshape(n, 3)
    worst = np.take_along_axis(residual, np.abs(residual).argmax(axis=1)[:, None], 1)[:, 0]
    return {
        "start": start,
        "end": start + s.time,
        "placement": s.placement,
        "axis": np.array(AXES)[axis],
        "up": s.sense,
        "rate": s.rate,
        "rate_true": e.speed,
        "gyro": gyro,
        "turns": s.turns,
        "before": gyro - e.speed,
        "line": line,
        "after": w_b[rows, axis] - e.speed,
        "after_sd": sd[rows, axis],
        "residual": worst,
        "weight": e.estimate.weights,
    }


def _lines(e: RateEvidence) -> tuple[FloatArray, dict[str, dict[str, float]]]:
    """Fit a straight line to the steps about each axis; return it there, and what it says."""
    gyro = e.steps.gyro[np.arange(len(e.steps)), e.steps.axis]
    out, figures = np.full(len(e.steps), np.nan), {}
    for i, a in enumerate(AXES):
        mine = (e.steps.axis == i) & (e.estimate.weights > 0.5)
        x, y = e.speed[mine], gyro[mine]
        senses = e.steps.rate[mine] * e.steps.sense[mine]
        if (senses >= 0).all() or (senses <= 0).all() or len(x) < 3:
            continue
        top = float(np.abs(x).max())
        straight = np.column_stack([x / top, np.ones_like(x)])
        slope, bias = np.linalg.lstsq(straight, y, rcond=None)[0]
        rows = e.steps.axis == i
        out[rows] = slope * e.speed[rows] / top + bias
        bent = np.linalg.lstsq(np.column_stack([straight, np.abs(x) / top]), y, rcond=None)[0]
        figures[a] = {
            "scale_factor": float(slope / top),
            # slope is the scale factor times the full scale: the quotient is of full scale.
            "nonlinearity": float(np.abs(y - straight @ [slope, bias]).max() / abs(slope)),
            "asymmetry": float(2 * bent[2] / bent[0]),
            "full_scale": top,
        }
    return out, figures


def standard_figures(e: RateEvidence) -> dict[str, dict[str, float]]:
    """Return what IEEE Std 647 and 952 ask for, per axis, as plain values.

    ``scale_factor``: slope of the straight line through all steps [1]; ``nonlinearity``: largest
    deviation from it, as a fraction of full scale [1]; ``asymmetry``: difference of the slopes for
    positive and negative rates over their mean [1]; ``full_scale``: largest rate [rad/s].
    """
    return _lines(e)[1]


def bound(e: RateEvidence) -> dict[str, Any]:
    """Return the Cramer-Rao bound of the noise alone, and what is seen worst, for result.json."""
    alone = Trust(latitude=0.0 if e.trust.latitude is None else e.trust.latitude)
    state = e.estimate.state
    if not wanders(e.steps, alone):
        state = replace(state, drift=None)
    problem = build(e.steps, e.names, alone, start=state)
    return information.bound(problem, problem.start)


def drift_figures(e: RateEvidence) -> dict[str, Any]:
    """Return how the bias moved, for result.json: ``sd`` [rad/s], ``time`` [s], ``kind``."""
    trust = e.trust
    if not trust.bias_sd:
        return {"sd": 0.0, "kind": "none"}
    if np.isinf(trust.bias_time):
        return {"sd": trust.bias_sd, "kind": "line"}
    kind = "Gauss-Markov" if trust.drifts else "steps"
    return {"sd": trust.bias_sd, "kind": kind, "time": trust.bias_time}


def budget(e: RateEvidence) -> dict[str, list[float]]:
    """Split the variance of the coefficients by source, for result.json."""
    n, k = len(e.names), len(e.steps)
    kinds = covariance(e.steps, e.trust)
    root = whitening(list(kinds.values())) * np.sqrt(e.estimate.weights)[:, None, None]
    at = e.problem.linearise(e.estimate.state, e.estimate.weights)
    gain = e.estimate.state_cov[:n] @ at.jacobian.T
    steps = np.einsum("nki,kij->nkj", gain[:, : 3 * k].reshape(n, k, 3), root)
    out = {name: np.einsum("nki,kij,nkj->n", steps, cov, steps) for name, cov in kinds.items()}
    for j, source in enumerate(Unknowns.of(e.names, e.steps, e.trust).sources):
        out[source] = out.get(source, 0.0) + gain[:, 3 * k + j] ** 2
    if np.isfinite(e.estimate.coefficients.prior_sd).any():
        left = np.diag(e.estimate.state_cov)[:n] - np.sum(list(out.values()), axis=0)
        out["prior"] = np.maximum(left, 0.0)
    total = np.sum(list(out.values()), axis=0)
    return {name: v.tolist() for name, v in out.items() if np.any(v > 1e-9 * total)}
