"""What the report of a rate table shows: the steps, and what the standards ask for."""

from __future__ import annotations

from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.infer.mixed import Covariance
from foucault.procedures.rate_table.checks import Solution
from foucault.tables import AXES

OF_A_STEP = ("gyro noise", "rate jitter", "rate scatter", "bias drift")
"""Sources that make one step differ from another."""


def step_table(e: Solution, start: FloatArray) -> dict[str, Any]:
    """Return the table "rate_steps".

    `start` (n,): when each step began [s].
    """
    s, n = e.steps, len(e.steps)
    rows, axis = np.arange(n), e.steps.axis
    gyro = s.gyro[rows, axis]
    w_b = e.model.compensate(s.force, s.gyro)[1]
    assert w_b is not None
    some = [source for source in e.fit.at.sources if source.name in OF_A_STEP]
    whole = Covariance(some, e.fit.sds, (n, 3), np.ones(n)).whole.reshape(n, 3, n, 3)
    back = np.linalg.inv(e.model.gyro_matrix)
    cov = back @ whole[rows, :, rows] @ back.T
    norms = e.fit.estimate.residuals[: 3 * n].reshape(n, 3)
    worst = np.take_along_axis(norms, np.abs(norms).argmax(axis=1)[:, None], 1)[:, 0]
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
        "line": gyro - _lines(e)[0],
        "after": w_b[rows, axis] - e.speed,
        "after_sd": np.sqrt(cov[rows, axis, axis]),
        "residual": worst,
        "weight": e.fit.estimate.weights,
    }


def _lines(e: Solution) -> tuple[FloatArray, dict[str, dict[str, float]]]:
    """Fit a straight line to the steps about each axis; return it there, and what it says."""
    gyro = e.steps.gyro[np.arange(len(e.steps)), e.steps.axis]
    out, figures = np.full(len(e.steps), np.nan), {}
    for i, a in enumerate(AXES):
        mine = (e.steps.axis == i) & (e.fit.estimate.weights > 0.5)
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


def standard_figures(e: Solution) -> dict[str, dict[str, float]]:
    """Return what IEEE Std 647 and 952 ask for, per axis, as plain values.

    ``scale_factor``: slope of the straight line through all steps [1]; ``nonlinearity``: largest
    deviation from it, as a fraction of full scale [1]; ``asymmetry``: difference of the slopes for
    positive and negative rates over their mean [1]; ``full_scale``: largest rate [rad/s].
    """
    return _lines(e)[1]


def drift_figures(e: Solution) -> dict[str, Any]:
    """Return how the bias moved, for result.json: ``sd`` [rad/s], ``time`` [s], ``kind``."""
    if not e.bias_sd:
        return {"sd": 0.0, "kind": "none"}
    if np.isinf(e.table.bias_time):
        return {"sd": e.bias_sd, "kind": "line"}
    kind = "Gauss-Markov" if e.table.bias_time else "steps"
    return {"sd": e.bias_sd, "kind": kind, "time": e.table.bias_time}
