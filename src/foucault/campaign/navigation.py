"""A log from a file navigated, and the folder of that: enough to write its report again.

::

    navigation.json             start, growth, terms, contributions, checks, findings [SI, rad]
    trajectory.parquet          the trajectory, with the calibration where one was given
    trajectory_without.parquet  the same without it
    errors.parquet              errors at the epochs of the reference, and their predicted sd
    budget.parquet              what every coefficient, alignment and noise contribute over time
    terms.parquet               terms of free inertial drift over time
    report.html                 for people, written by `report.navigation`
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from pydantic import Field

from foucault import run_folder
from foucault.arrays import FloatArray
from foucault.campaign.running import opened
from foucault.campaign.tables import Said
from foucault.diagnose.navigation import NAUTICAL_MILE, circular_error, radial_rate
from foucault.diagnose.schuler import TERMS
from foucault.errors import error
from foucault.logs import reference as references
from foucault.logs.reference import Reference
from foucault.models import earth
from foucault.models.layouts import kind_of
from foucault.navigate.align import Method
from foucault.procedures import Progress, silent
from foucault.procedures.alignment import Comparison, align_log
from foucault.procedures.navigation import NavigationTest, navigate_log
from foucault.procedures.navigation.start import Settings
from foucault.procedures.record import Stretch
from foucault.run_folder import Record
from foucault.tables import declared
from foucault.units import Force, Rate

if TYPE_CHECKING:
    from foucault.diagnose.navigation import Budget
    from foucault.procedures.navigation import NavigationTest, Run


def run(
    log: str | Path,
    said: Said | None = None,
    settings: Settings | None = None,
    *,
    calibration: str | Path | None = None,
    reference: str | Path | None = None,
    progress: Progress = silent,
) -> NavigationTest:
    """Navigate the log of a file.

    `log`: a campaign file of any procedure, for its log, site, noise and instrument, a log that
    Foucault has written, or a file whose titles carry the units; `said` or None: what is said
    beside it; `settings` or None: what can be chosen [SI]; `calibration` or None: run folder or
    result.json of the calibration; `reference` or None: file of positions, velocities or angles of
    the same clock. Returns trajectories, errors, contributions [SI].
    """
    settings = settings or Settings()
    # What is wrong with the small files shows before a long log is read.
    truth: Reference | None = None if reference is None else references.read(reference)
    case = opened(log, said or Said(), calibration, progress)
    if settings.position_sd is not None:
        missing = [
            f"--{k}" for k in ("latitude", "longitude", "height") if case.site.get(k) is None
        ]
        if missing:
            raise error("navigate.position", missing=" and ".join(missing))
    found = navigate_log(
        case.log, site=case.place, longitude=float(case.site.get("longitude") or 0.0),
        settings=settings, noise=case.noise, calibration=case.calibration, reference=truth,
        instrument=case.instrument, progress=case.progress,
    )  # fmt: skip
    made = found.provenance | {
        "calibration": case.known,
        "reference": {} if truth is None else truth.source,
    }
    return replace(found, provenance=made)


def document(test: NavigationTest) -> dict[str, Any]:
    """Return everything that navigation.json says but its schema and the hashes."""
    t = test.runs[0].trajectory
    return {
        "verdict": str(test.verdict.level),
        "reasons": list(test.verdict.reasons),
        "instrument": test.instrument,
        "site": test.site.said | {"longitude": test.longitude},
        "opening": {k: getattr(test.opening, k) for k in ("start", "end", "still", "found")},
        "settings": test.settings.model_dump(),
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


Columns = dict[str, tuple[Any, str]]

ENU = ("east", "north", "up")
WITHOUT = "without_"  # What columns of the run without the calibration begin with.


def tables(test: NavigationTest) -> dict[str, Columns]:
    """Return every table of a navigation, values and unit of each column."""
    start = (test.runs[0].trajectory.latitude[0], test.runs[0].trajectory.longitude[0],
             test.runs[0].trajectory.height[0])  # fmt: skip
    out = {"trajectory": _trajectory(test.runs[0], start), "budget": _budget(test)}
    if len(test.runs) > 1:
        out["trajectory_without"] = _trajectory(test.runs[1], start)
    if test.runs[0].errors is not None:
        out["errors"] = _errors(test, start)
    if test.runs[0].schuler is not None:
        out["terms"] = _terms(test)
    # Read back as real numbers, whatever they were counted in.
    return {
        name: {n: (np.asarray(v, float), u) for n, (v, u) in columns.items()}
        for name, columns in out.items()
    }


def _trajectory(run: Run, start: tuple[float, float, float]) -> Columns:
    t = run.trajectory
    here = earth.displacement(*start, t.latitude, t.longitude, t.height)
    values = [t.time, t.latitude, t.longitude, t.height, *t.velocity_n.T, *t.angles.T, *here.T]
    return {c.name: (v, c.unit) for c, v in zip(declared("trajectory"), values, strict=True)}


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
        out |= _reference_columns(test.reference, main.time, start)
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


def _reference_columns(
    known: Reference, time: FloatArray, start: tuple[float, float, float]
) -> Columns:
    if known.position is None:
        return {}
    latitude, longitude, height = known.position[np.searchsorted(known.time, time)].T
    here = earth.displacement(*start, latitude, longitude, height)
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


def record(test: NavigationTest) -> Record:
    """Return what the folder of a navigation keeps."""
    return run_folder.record("navigation", document(test), tables(test))


# -- Align the log of a file: a campaign, a log of ours, or one whose titles carry the units -----


class Window(Stretch):
    """Which part of a log is aligned, and how."""

    methods: tuple[str, ...] = ()
    """Methods; none for all that fit."""
    rests: tuple[tuple[float, float], ...] = ()
    """Rests at different headings [s]."""
    gyro_bias_sd: Rate | None = Field(default=None, ge=0)
    """How well the gyro biases are known, such as "0.01 deg/h"."""
    accel_bias_sd: Force | None = Field(default=None, ge=0)
    """How well the accelerometer biases are known, such as "50 ug"."""


def align(
    log: str | Path,
    said: Said,
    window: Window,
    *,
    calibration: str | Path | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Align the log of a file.

    `log`: a campaign file of any procedure, a log that Foucault has written, or a file whose titles
    carry the units; `said`: site and noise, before what a campaign says of them; `calibration` or
    None: run folder or result.json of the calibration.
    """
    case = opened(log, said, calibration, progress)
    if case.place is None:
        raise error("alignment.no_latitude")
    progress(0.5, "aligning")
    methods = cast(tuple[Method, ...], window.methods)  # an unknown one is refused there
    return align_log(
        case.log, site=case.place, methods=methods, start=window.start, end=window.end,
        rests=window.rests, noise=case.noise, gyro_bias_sd=window.gyro_bias_sd,
        accel_bias_sd=window.accel_bias_sd, calibration=case.calibration, gaps=window.gaps,
    )  # fmt: skip
