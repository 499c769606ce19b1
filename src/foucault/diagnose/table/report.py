"""Tables and diagnostics of a calibration on a table: what the report shows beside the checks."""

from __future__ import annotations

from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose import information
from foucault.diagnose.fit_checks import budget_json
from foucault.diagnose.norm import norm_with_cov, rate_norm_sd
from foucault.diagnose.table.checks import detectable
from foucault.estimate.table.fit import TableFit
from foucault.estimate.table.likelihood import OF_TABLE, TableModel
from foucault.infer import mixed
from foucault.infer.mixed import Fit
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.readings import Readings
from foucault.models.references import gravity_error, rate_slope
from foucault.models.table_geometry import Angles, Trust
from foucault.models.table_state import State
from foucault.models.turntable import RIG
from foucault.tables import AXES, Log, temperature_range

NOISE = {
    "declared": "declared",
    "measured": "measured in the readings",
    "unknown": "unknown: from the residuals",
}
"""Where the noise of readings is from, in words: rows of a log that are means do not tell it."""


def bound(fit: Fit) -> dict[str, Any]:
    """Return the Cramer-Rao bound of a known noise, and what is seen worst, for result.json."""
    model = fit.model
    assert isinstance(model, TableModel)
    if model.readings.noise_from == "unknown":
        return {}  # made-up weights of accelerometers against gyros say nothing
    return information.bound(mixed.noise_alone(fit), fit.state)


def allowed(fit: Fit) -> FloatArray:
    """Return the standard deviations that everything declared allows, shape (p,) [SI].

    Sensor noise, jitter of the rate and an unknown heading, without scatter and without a prior.
    """
    problem = mixed.stated(fit.model)
    at = problem.linearise(fit.state, np.ones(problem.n_blocks))
    return information.information(at, problem.layout).sd


def budget(fit: Fit, site: Site, table_rate_sd: float) -> dict[str, object]:
    """Split the variance of the coefficients by source, for result.json.

    `table_rate_sd`: relative sd of an error that all spin rates share [1].
    """
    c = fit.estimate.coefficients
    none, table = np.zeros(len(c)), ("B", "what the campaign says of the table")
    gravity = gravity_error(c, site) ** 2
    return budget_json(fit, dict.fromkeys(OF_TABLE, (none, *table)) | {
        "local gravity": (gravity, "B", "standard uncertainty of local gravity"),
        "rate of the table": (
            (rate_slope(c) * table_rate_sd) ** 2, "B",
            "table_rate_sd as given; tilt of the outer axis",
        ),
    })  # fmt: skip


def readings_table(e: TableFit) -> dict[str, Any]:
    """Return the table "readings" of the report, see `tables.READINGS`."""
    r, state = e.model.readings, e.estimate.state
    accel_cov, gyro_cov = _covariances(e)
    out: dict[str, Any] = {
        "start": r.start,
        "end": r.start + r.time,
        "time": r.time,
        "rate": r.rate,
        "turns": r.turns,
        **{name: r.angles[:, i] for i, name in enumerate(("outer", "middle", "inner"))},
    }
    up = state.geometry.directions()
    out |= {f"up_{a}": up[:, i] for i, a in enumerate(AXES)}
    h = turntable.mean_rate(r.rate, e.model.site.latitude or 0.0)
    if r.accel is not None:
        out |= {f"accel_{a}": r.accel[:, i] for i, a in enumerate(AXES)}
        # In spins the centripetal part is taken away, so that every norm must be local gravity.
        pushed = turntable.mean_force(up, np.where(r.spin, h, 0.0), 0.0, state.lever_arm)
        still = r.accel - pushed @ state.model.accel_matrix.T
        norm, cov = norm_with_cov(state.model, e.estimate.coefficients, still, accel_cov)
        out |= {
            "norm_before": np.linalg.norm(r.accel, axis=1),
            "norm_after": norm,
            "norm_sd": np.sqrt(np.diag(cov)),
        }
    if r.gyro is not None:
        _, w = state.model.compensate(r.accel, r.gyro)
        assert w is not None
        out |= {f"gyro_{a}": r.gyro[:, i] for i, a in enumerate(AXES)}
        spin = np.where(r.spin, 1.0, np.nan)  # the norm at rest is not calibrated by anything
        out |= {
            "rate_before": np.linalg.norm(r.gyro, axis=1) * spin,
            "rate_after": np.linalg.norm(w, axis=1) * spin,
            "rate_true": np.abs(h) * spin,
            "rate_sd": rate_norm_sd(state.model, e.estimate.coefficients, w, r.accel, gyro_cov)
            * spin,
        }
    return out | _residual_columns(e)


def _covariances(e: TableFit) -> tuple[FloatArray, FloatArray]:
    """Return the covariance that each reading has for itself, body axes, shape (n, 3, 3) [SI]."""
    r, model, n = e.model.readings, e.model, len(e.model.readings)
    out = np.concatenate([r.accel_cov, r.gyro_cov])
    own = e.fit.covariance.own * e.estimate.weights[:, None, None]
    out[model.rows] = np.swapaxes(model.axes, 1, 2) @ own @ model.axes
    return out[:n], out[n:]


def _residual_columns(e: TableFit) -> dict[str, FloatArray]:
    s, rows, n = e.snooping, e.model.rows, len(e.model.readings)
    tests, smallest, weights = np.zeros(2 * n), np.full(2 * n, np.nan), np.ones(2 * n)
    weights[rows] = e.estimate.weights
    # One number per observation: its test, as a multiple of what is expected.
    # A reading that was left out is tested with the tiny weight it keeps: undo that.
    test = s.test / np.maximum(e.estimate.weights, 1e-12)
    tests[rows] = np.where(s.dof > 0, np.sqrt(test / np.maximum(s.dof, 1)), 0.0)
    smallest[rows] = detectable(e)
    return {
        "residual": np.maximum(tests[:n], tests[n:]),
        "accel_residual": tests[:n],
        "gyro_residual": tests[n:],
        "weight": np.minimum(weights[:n], weights[n:]),
        "accel_weight": weights[:n],
        "gyro_weight": weights[n:],
        "detectable": smallest[:n],
    }


def rig_table(e: TableFit) -> dict[str, Any]:
    """Return the table "rig" of the report: what was found beside the coefficients."""
    estimate = e.estimate
    state: State = estimate.state
    at = len(estimate.coefficients)
    sd = np.sqrt(np.diag(estimate.state_cov))
    rows: list[tuple[str, float, float, float]] = []
    options = e.model.options
    if options.lever_arm:
        rows += [
            (f"lever_arm.{a}", float(state.lever_arm[i]), float(sd[at + i]), np.inf)
            for i, a in enumerate(AXES)
        ]
    at += 3 * options.lever_arm + options.level + 3 * options.offset
    g = state.geometry
    if isinstance(g, Angles):
        from foucault.models.rotation import log

        mounting = -log(g.C_bk)
        rows += [
            (f"mounting.{a}", float(mounting[i]), float(sd[at + i]), np.inf)
            for i, a in enumerate(AXES)
        ]
        at += 3
        for k in g.used:
            rows.append(
                (
                    turntable.COMMON[k],
                    float(g.common[k]),
                    float(sd[at]),
                    float(g.trust.common_sd[k]),
                )
            )
            at += 1
        if g.heading is not None:
            turned = float((g.heading + np.pi) % (2 * np.pi) - np.pi)
            last = at + (g.position.size if g.trust.position_sd > 0 else 0)
            rows.append(("table.heading", turned, float(sd[last]), np.inf))
    known = {c.name: c for c in RIG.coefficients}
    return {
        "name": np.array([r[0] for r in rows], str),
        "meaning": np.array([known[r[0]].meaning for r in rows], str),
        "kind": np.array([known[r[0]].kind for r in rows], str),
        "value": np.array([r[1] for r in rows], float),
        "sd": np.array([r[2] for r in rows], float),
        "prior_sd": np.array([r[3] for r in rows], float),
    }


def validity(readings: Readings, log: Log | None, site: Site) -> dict[str, Any]:
    """Return the ranges that the session covered: outside them the result is extrapolated.

    `readings`: what was observed [SI]; `log`: where it came from, None where it stayed on disk.
    """
    out: dict[str, Any] = {"accel": [-site.gravity, site.gravity]}
    if log is not None:
        out["sampled"] = log.sampled
    if readings.interval > 0:
        out["rate"] = 1.0 / readings.interval
    if readings.gyro is not None:
        largest = float(np.abs(readings.gyro).max())
        out["gyro"] = [-largest, largest]
    return out if log is None else out | temperature_range(log)


def unseen(
    readings: Readings, site: Site, table_rate_sd: float, trust: Trust | None, quadratic: bool
) -> list[str]:
    """Say what a procedure on a table cannot see in principle, for result.json.

    `readings`: what was observed [SI]; `table_rate_sd`: relative sd of an error that all spin
    rates share [1]; `trust`: what is believed of the table, None for nothing; `quadratic`:
    whether the quadratic terms of the accelerometers are estimated.
    """
    g = (
        f"its standard uncertainty, {site.gravity_sd / 1e-5:.3g} mGal, is part of every uncertainty"
        if site.gravity_sd
        else "it was taken as exact"
    )
    out = [
        f"A wrong local gravity: 1 ppm of g is 1 ppm in all accelerometer scale factors; {g}.",
        "How the body axes lie in the case: they are those of the accelerometers (see gauge).",
        "Specific force beyond 1 g: there the result is extrapolated.",
        "Other temperatures than that of the session.",
    ]
    if readings.gyro is not None:
        sd = table_rate_sd
        rate = (
            f"its standard uncertainty, {sd * 1e6:.3g} ppm, is part of every uncertainty"
            if sd
            else "it was taken as exact"
        )
        out.insert(1, f"A wrong rate of the table: 1 ppm is 1 ppm in all gyro scales; {rate}.")
        spins = readings.rate[readings.spin]
        if np.all(spins > 0) or np.all(spins < 0):
            out.append(
                "The g-sensitivity of the gyros: with spins in one sense it looks like a scale "
                "factor and a misalignment. Spin both ways (both_senses), or estimate it."
            )
        rates = np.unique(np.round(np.abs(readings.rate[readings.spin]), 6))
        if len(rates) == 1:
            out.append("Gyro scale factors that change with the rate: all spins had the same.")
        push = 0.01 * float(np.max(readings.rate**2)) / 9.80665e-6
        out.append(
            f"Accelerometers apart from one another: in spins each centimetre is up to {push:.0f} "
            f"ug, and goes into scatter and bias."
        )
    if trust is not None and not np.any(trust.common_sd):
        out.append(
            "Errors of the table that all positions share, such as axes that are not square: they "
            "go into the coefficients, and the uncertainties do not know them."
        )
    if not quadratic:
        out.append("Quadratic terms of the accelerometers: about 0.6 of each goes into the bias.")
    return out
