"""What a fit over temperature leaves for the report: facts, points and curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.temperature.checks import Seen
from foucault.estimate.temperature.order import Test
from foucault.models.temperature import TemperatureModel

CURVE = 61
"""Points of the curves that reports draw [1]."""

POINTS = ("session", "temperature", "coefficient", "value", "sd", "sd_total", "residual",
          "left_out")  # fmt: skip
"""Columns of the table of points."""


def facts(seen: Seen, model: TemperatureModel) -> dict[str, Any]:
    """Return the families with their functions and tests, as plain JSON values."""
    choice = seen.choice
    needed = {t.family: t for t in choice.needed}
    missing = {t.family: t for t in choice.missing}
    rows = []
    for f, name in enumerate(seen.families):
        member = seen.layout.names[int(np.flatnonzero(seen.family == f)[0])]
        rows.append({
            "family": name,
            "function": seen.label(choice.orders[f]),
            "temperatures": int(seen.counts[f]),
            "scatter": float(model.scatter[model.layout.index(member)]),
            "scatter_found": bool(choice.wanted[f]),
            "scatter_dof": float(choice.dof[f]),
            "needed": _said(needed.get(f), seen),
            "missing": _said(missing.get(f), seen),
        })  # fmt: skip
    tests = [
        {"family": seen.families[f], "F": F, "p": p} for f, F, p in seen.hysteresis
    ]  # fmt: skip
    fit = choice.fit
    return {"families": rows, "hysteresis": tests, "chi_square": fit.chi_square, "dof": fit.dof}


def _said(test: Test | None, seen: Seen) -> dict[str, Any] | None:
    if test is None:
        return None
    pair = {"has": seen.label(test.order), "against": seen.label(test.against)}
    return pair | {"F": test.F, "p": test.p}


def points(seen: Seen) -> dict[str, npt.NDArray[Any]]:
    """Return one row per session and coefficient: what was found, and how far off it is."""
    alone = np.full((len(seen.names), len(seen.layout)), np.nan)
    for one in seen.left_out:
        alone[one.sessions] = one.z
    rows: dict[str, list[Any]] = {k: [] for k in POINTS}
    fit = seen.choice.fit
    for k, name in enumerate(seen.names):
        e = seen.evidence[k]
        total = np.sqrt(np.diag(e.cov) + fit.variance[e.group])
        for row, i in enumerate(np.argmax(e.H, axis=1)):
            values = (name, seen.temperature[k], seen.layout.names[i], e.y[row] * seen.unit[i],
                      np.sqrt(e.cov[row, row]) * seen.unit[i], total[row] * seen.unit[i],
                      fit.residuals[k][row] / total[row], alone[k, i])  # fmt: skip
            for key, value in zip(POINTS, values, strict=True):
                rows[key].append(value)
    return {key: np.array(values) for key, values in rows.items()}


def curves(model: TemperatureModel) -> dict[str, npt.NDArray[Any]]:
    """Return the functions at temperatures from end to end, one row for each coefficient."""
    T = np.unique(np.concatenate([np.linspace(model.low, model.high, CURVE), model.knots]))
    T = T[~model.outside(T)]
    n = len(model.layout)
    return {
        "coefficient": np.repeat(np.array(model.layout.names), len(T)),
        "temperature": np.tile(T, n),
        "value": model.values(T).T.ravel(),
        "sd": model.sd(T).T.ravel(),
        "sd_next": model.sd(T, scatter=True).T.ravel(),
    }


def ramp_points(
    seen: Seen, model: TemperatureModel, parts: Sequence[tuple[str, FloatArray, FloatArray,
                                                              tuple[str, ...]]]
) -> dict[str, npt.NDArray[Any]]:  # fmt: skip
    """Return one row per part of a ramp and sensor: the bias there, as function and residual.

    `parts`: name of each ramp, temperature of its parts, shape (k,) [K], unit of each sensor's
    evidence, shape (s,) [SI], and the name of the bias of each sensor.
    """
    rows: dict[str, list[Any]] = {"ramp": [], "temperature": [], "coefficient": [], "value": []}
    e = len(seen.names)
    for name, temperature, size, biases in parts:
        for T in temperature:
            off = seen.choice.fit.residuals[e] * size
            for bias, miss in zip(biases, off, strict=True):
                if bias in model.layout:
                    at = float(model.values(T)[model.layout.index(bias)])
                    for key, value in zip(rows, (name, T, bias, at + miss), strict=True):
                        rows[key].append(value)
            e += 1
    return {key: np.array(values) for key, values in rows.items()}
