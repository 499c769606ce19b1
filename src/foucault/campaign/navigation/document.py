"""What navigation.json says of a navigation."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.navigation.errors import NAUTICAL_MILE, circular_error, radial_rate
from foucault.files import plain_json
from foucault.models.layouts import kind_of

if TYPE_CHECKING:
    from foucault.diagnose.navigation.budget import Budget
    from foucault.procedures.navigation import NavigationTest, Run


def document(test: NavigationTest) -> dict[str, Any]:
    """Return everything that navigation.json says but its schema and the hashes.

    `test`: what was found [SI].
    """
    t = test.runs[0].trajectory
    out = {
        "verdict": str(test.verdict.level),
        "reasons": list(test.verdict.reasons),
        "instrument": test.instrument,
        "site": asdict(test.site) | {"longitude": test.longitude},
        "opening": {k: getattr(test.opening, k) for k in ("start", "end", "still", "found")},
        "settings": asdict(test.settings),
        "noise": {"source": test.noise_source} | asdict(test.noise),
        "calibration": test.calibration,
        "reference": _reference(test),
        "start": float(t.time[0]),
        "duration": float(t.time[-1] - t.time[0]),
        "runs": [_run(run, cov) for run, cov in zip(test.runs, _start_cov(test), strict=True)],
        "predicted": _predicted(test.budget, test.runs[0].start.time),
        "contributions": _contributions(test.budget),
        "difference": None if test.difference is None else test.difference[-1, :2],
        "stationary": test.stationary,
        "checks": [asdict(c) for c in test.checks],
        "findings": [f.as_dict() for f in test.findings],
        "provenance": test.provenance,
    }
    return {key: plain_json(value) for key, value in out.items()}


def _reference(test: NavigationTest) -> dict[str, Any] | None:
    known = test.reference
    if known is None:
        return None
    return {"still": known.still, "positions": known.position is not None} | known.source


def _start_cov(test: NavigationTest) -> list[FloatArray]:
    """Return the covariance of phi at each start; what is not calibrated is not in it."""
    return [test.budget.start, *(run.start.phi_cov for run in test.runs[1:])]


def _run(run: Run, start_cov: FloatArray) -> dict[str, Any]:
    start, t = run.start, run.trajectory
    out: dict[str, Any] = {
        "name": run.name,
        "start": {
            "method": start.method,
            "time": start.time,
            **dict(zip(("heading", "pitch", "roll"), t.angles[0], strict=True)),
            "covariance": start_cov.tolist(),
            "velocity": t.velocity_n[0].tolist(),
            "velocity_sd": start.velocity_sd,
            "position_sd": start.position_sd,
        },
        "end": {
            "east": None, "north": None, "up": None,
            **dict(zip(("heading", "pitch", "roll"), t.angles[-1], strict=True)),
        },
        "growth": [asdict(row) for row in run.growth],
    }  # fmt: skip
    if run.errors is not None:
        out["end"] |= dict(zip(("east", "north", "up"), run.errors.position[-1], strict=True))
        rate = radial_rate(run.errors)
        out["radial_rate"] = {"m/s": rate, "nmi/h": rate * 3600 / NAUTICAL_MILE}
    if run.schuler is not None:
        fit = run.schuler
        out["terms"] = {
            "rows": fit.rows(),
            "covariance": fit.cov.tolist(),
            "alike": [c.sentence() for c in fit.combinations()],
            "chi_square": fit.chi_square,
            "dof": fit.dof,
            "limits": list(fit.limits),
            "schuler_period": fit.place.schuler_period,
        }
    return out


def _predicted(budget: Budget, start: float) -> dict[str, Any]:
    """Return what was predicted at the end, by source and together."""
    out: dict[str, Any] = {"age": float(budget.time[-1]) - start}
    for name in ("coefficients", "alignment", "noise", "cov"):
        P = getattr(budget, name)[-1]
        sd = np.sqrt(np.maximum(np.diag(P), 0.0))
        out["all" if name == "cov" else name] = {
            "east_sd": sd[6], "north_sd": sd[7], "up_sd": sd[8], "heading_sd": sd[2],
            "covariance": P[6:8, 6:8].tolist(), "cep": float(circular_error(P[6:8, 6:8])),
        }  # fmt: skip
    return out


def _contributions(budget: Budget) -> list[dict[str, Any]]:
    """Return one row per coefficient, by what correcting it was worth at the end."""
    worth, left = budget.worth[-1], budget.left[-1]
    return [
        {
            "name": budget.names[k],
            "kind": kind_of(budget.names[k]),
            "value": budget.values[k],
            "sd": budget.sd[k],
            "worth": _at_end(worth[:, k]),
            "left": _at_end(left[:, k]),
        }
        for k in budget.ranked(budget.worth)
    ]


def _at_end(x: FloatArray) -> dict[str, float]:
    """Return position and heading of nine errors."""
    length = float(np.hypot(x[6], x[7]))
    return {"east": x[6], "north": x[7], "heading": x[2], "horizontal": length}
