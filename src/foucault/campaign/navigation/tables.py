"""The tables that the folder of a navigation keeps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.navigation.free_inertial import TERMS
from foucault.models import geodesy
from foucault.tables import TRAJECTORY

if TYPE_CHECKING:
    from foucault.logs.reference import Reference
    from foucault.procedures.navigation import NavigationTest, Run

Columns = dict[str, tuple[Any, str]]

ENU = ("east", "north", "up")
WITHOUT = "without_"
"""What columns of the run without the calibration begin with."""


def tables(test: NavigationTest) -> dict[str, Columns]:
    """Return every table of a navigation, values and unit of each column.

    `test`: what was found [SI].
    """
    start = (test.runs[0].trajectory.latitude[0], test.runs[0].trajectory.longitude[0],
             test.runs[0].trajectory.height[0])  # fmt: skip
    out = {"trajectory": _trajectory(test.runs[0], start), "budget": _budget(test)}
    if len(test.runs) > 1:
        out["trajectory_without"] = _trajectory(test.runs[1], start)
    if test.runs[0].errors is not None:
        out["errors"] = _errors(test, start)
    if test.runs[0].schuler is not None:
        out["terms"] = _terms(test)
    return out


def _trajectory(run: Run, start: tuple[float, float, float]) -> Columns:
    t = run.trajectory
    here = geodesy.displacement(*start, t.latitude, t.longitude, t.height)
    values = [t.time, t.latitude, t.longitude, t.height, *t.velocity_n.T, *t.angles.T, *here.T]
    return {c.name: (v, c.unit) for c, v in zip(TRAJECTORY, values, strict=True)}


def _errors(test: NavigationTest, start: tuple[float, float, float]) -> Columns:
    """Return errors of the runs, what was predicted, and where the reference is."""
    main = test.runs[0].errors
    assert main is not None
    out: Columns = {"time": (main.time, "s"), "age": (main.age, "s")}
    for k, run in enumerate(test.runs):
        if run.errors is None:
            continue
        before = WITHOUT if k else ""
        errors = run.errors
        rows = np.searchsorted(errors.time, main.time).clip(0, len(errors) - 1)
        same = np.abs(errors.time[rows] - main.time) < 1e-6
        for name, x, unit in (("", errors.position, "m"), ("velocity_", errors.velocity, "m/s")):
            for i, axis in enumerate(ENU):
                out[f"{before}{name}{axis}"] = (np.where(same, x[rows, i], np.nan), unit)
        for i, angle in enumerate(("heading", "pitch", "roll")):
            out[f"{before}{angle}"] = (np.where(same, errors.angles[rows, i], np.nan), "rad")
    cov = _at(test, main.time)
    for name, (i, j), unit in COVARIANCES:
        out[f"cov_{name}"] = (cov[:, i, j], unit)
    if test.reference is not None:
        out |= _reference(test.reference, main.time, start)
    return out


COVARIANCES = (
    ("east_east", (6, 6), "m^2"), ("east_north", (6, 7), "m^2"), ("north_north", (7, 7), "m^2"),
    ("up_up", (8, 8), "m^2"), ("velocity_east", (3, 3), "m^2/s^2"),
    ("velocity_north", (4, 4), "m^2/s^2"), ("velocity_up", (5, 5), "m^2/s^2"),
    ("phi_east", (0, 0), "rad^2"), ("phi_north", (1, 1), "rad^2"), ("phi_up", (2, 2), "rad^2"),
)  # fmt: skip
"""Elements of the predicted covariance that are kept: name, place, unit."""


def _at(test: NavigationTest, wanted: FloatArray) -> FloatArray:
    """Interpolate what was predicted; before the first epoch it grows from the start."""
    time, x, start = test.budget.time, test.budget.cov, test.runs[0].start
    begin = np.diag(np.repeat([0.0, start.velocity_sd**2, start.position_sd**2], 3))[None]
    begin[0, :3, :3] = test.budget.start
    t = np.concatenate([[2 * time[0] - time[1] if len(time) > 1 else time[0] - 1.0], time])
    flat = np.concatenate([begin, x]).reshape(len(t), -1)
    return np.stack([np.interp(wanted, t, c) for c in flat.T], axis=-1).reshape(-1, 9, 9)


def _reference(known: Reference, time: FloatArray, start: tuple[float, float, float]) -> Columns:
    if known.position is None:
        return {}
    latitude, longitude, height = known.position[np.searchsorted(known.time, time)].T
    here = geodesy.displacement(*start, latitude, longitude, height)
    return {f"reference_{a}": (here[:, i], "m") for i, a in enumerate(ENU)}


def _budget(test: NavigationTest) -> Columns:
    b = test.budget
    out: Columns = {"time": (b.time, "s"), "age": (b.time - test.runs[0].start.time, "s")}
    for source in ("coefficients", "alignment", "noise"):
        part = getattr(b, source)
        for name, (i, j), unit in COVARIANCES[:3]:
            out[f"{source}_{name}"] = (part[:, i, j], unit)
    for name, (i, j), unit in COVARIANCES:
        out[f"cov_{name}"] = (b.cov[:, i, j], unit)
    for kind, part in (("worth", b.worth), ("left", b.left)):
        for k, name in enumerate(b.names):
            for i, axis in enumerate(ENU[:2]):
                out[f"{kind}.{name}.{axis}"] = (part[:, 6 + i, k], "m")
    if test.difference is not None:
        for i, axis in enumerate(ENU[:2]):
            out[f"difference_{axis}"] = (test.difference[:, i], "m")
    return out


def _terms(test: NavigationTest) -> Columns:
    out: Columns = {}
    for k, run in enumerate(test.runs):
        fit = run.schuler
        if fit is None:
            continue
        before = WITHOUT if k else ""
        if not k:
            out["age"] = (fit.time, "s")
        for i, axis in enumerate(ENU[:2]):
            out[f"{before}{axis}"] = (fit.observed[:, i], "m")
            out[f"{before}noise.{axis}"] = (fit.noise_sd[:, i], "m")
            for j, term in enumerate(TERMS):
                out[f"{before}{term}.{axis}"] = (fit.parts[:, i, j], "m")
    return out
