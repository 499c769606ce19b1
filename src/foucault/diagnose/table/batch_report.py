"""Tables of an instrument that was solved in a batch, with the columns of `table.report`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.norm import norm_with_cov, rate_norm_sd
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.readings import Readings
from foucault.tables import AXES


def readings_table(
    r: Readings, coefficients: CoefficientVector, lever_arm: FloatArray, site: Site
) -> dict[str, FloatArray]:
    """Return the table "readings" of the report, see `tables.READINGS`.

    `r`: means with the covariance of their noise, accelerometers and gyros [SI]; `coefficients`:
    the estimate with its covariance [SI]; `lever_arm` (3,): the accelerometers from the centre of
    the table, frame b [m].
    """
    assert r.accel is not None and r.gyro is not None
    model = ImuModel.from_coefficients(coefficients)
    h = turntable.mean_rate(r.rate, site.latitude or 0.0)
    f, w = model.compensate(r.accel, r.gyro)
    assert f is not None and w is not None
    axis = np.where(r.spin[:, None], w * np.sign(h)[:, None], f)
    up = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    # In spins the centripetal part is taken away, so that every norm must be local gravity.
    pushed = turntable.mean_force(up, np.where(r.spin, h, 0.0), 0.0, lever_arm)
    still = r.accel - pushed @ model.accel_matrix.T
    norm, cov = norm_with_cov(model, coefficients, still, r.accel_cov)
    spin = np.where(r.spin, 1.0, np.nan)  # the norm at rest is not calibrated by anything
    norms = {
        "norm_before": np.linalg.norm(r.accel, axis=1),
        "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(cov)),
        "rate_before": np.linalg.norm(r.gyro, axis=1) * spin,
        "rate_after": np.linalg.norm(w, axis=1) * spin,
        "rate_true": np.abs(h) * spin,
        "rate_sd": rate_norm_sd(model, coefficients, w, r.accel, r.gyro_cov) * spin,
    }
    return {
        "start": r.start,
        "end": r.start + r.time,
        "time": r.time,
        "rate": r.rate,
        "turns": r.turns,
        **{name: r.angles[:, k] for k, name in enumerate(("outer", "middle", "inner"))},
        **{f"accel_{a}": r.accel[:, k] for k, a in enumerate(AXES)},
        **{f"gyro_{a}": r.gyro[:, k] for k, a in enumerate(AXES)},
        **{f"up_{a}": up[:, k] for k, a in enumerate(AXES)},
        **norms,
        **_residual_columns(r, norms, site.gravity),
    }


def _residual_columns(
    r: Readings, norms: Mapping[str, FloatArray], gravity: float
) -> dict[str, FloatArray]:
    """Return the residuals of the norms over the sd of the noise: what the equations leave."""
    sd = [np.sqrt(np.trace(c, axis1=1, axis2=2) / 3) for c in (r.accel_cov, r.gyro_cov)]
    accel = np.where(r.spin, 0.0, norms["norm_after"] - gravity) / sd[0]
    gyro = np.nan_to_num(norms["rate_after"] - norms["rate_true"]) / sd[1]
    one = np.ones(len(r))
    return {
        "residual": np.maximum(np.abs(accel), np.abs(gyro)),
        "accel_residual": np.abs(accel),
        "gyro_residual": np.abs(gyro),
        "weight": one,
        "accel_weight": one,
        "gyro_weight": one,
        "detectable": np.full(len(r), np.nan),
    }


def rig_table(lever_arm: FloatArray, cov: FloatArray) -> dict[str, Any]:
    """Return the table "rig" of the report: the lever arm, where it was estimated.

    `lever_arm` (3,) or (0,): the accelerometers from the centre of the table, frame b [m]; `cov`
    (3, 3) or (0, 0): its covariance [m^2].
    """
    known = {c.name: c for c in turntable.RIG.coefficients}
    names = [f"lever_arm.{a}" for a in AXES[: len(lever_arm)]]
    return {
        "name": np.array(names, str),
        "meaning": np.array([known[n].meaning for n in names], str),
        "kind": np.array([known[n].kind for n in names], str),
        "value": lever_arm,
        "sd": np.sqrt(np.diag(cov)),
        "prior_sd": np.full(len(names), np.inf),
    }
