"""What a navigation shows: contributions, terms of free inertial drift, and its checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.alignment.input import POOR
from foucault.diagnose.navigation import schuler
from foucault.diagnose.navigation.budget import Budget, budget, normalised_square
from foucault.diagnose.navigation.errors import NavigationError
from foucault.diagnose.navigation.free_inertial import Place
from foucault.diagnose.words import check
from foucault.estimate import free_run
from foucault.estimate.chi_square import chi_square_limits
from foucault.logs.reference import Reference
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.models.rotation import log as rotation_vector
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT
from foucault.models.size_effect import LEVER, OFFSET, with_size_effect
from foucault.navigate.strapdown import Trajectory
from foucault.procedures.navigation.run import Made, Task
from foucault.procedures.navigation.start import start_of
from foucault.result import Check, Level
from foucault.tables import Log
from foucault.units import plain

EPOCHS = 150
"""Epochs at which contributions are computed [1]."""

TURNS = np.radians(2.0)
"""A body that turns by more does not keep its sensor errors constant in a level frame [rad]."""

SMALL = 1e-4
"""A coefficient is changed by what moves readings by this part of gravity or Earth's rate [1]."""

QUIETEST = (1e-9, 1e-7)
"""White noise that a fit takes at least [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]."""


def budget_of(task: Task, made: Made, vector: CoefficientVector | None) -> Budget:
    """Propagate start errors, coefficients and noise along a run.

    `vector` or None: the coefficients that were corrected.
    """
    rows = _rows(made)
    names = () if vector is None else vector.names
    sensors = with_size_effect(
        Sensors.of(name for name in names if name not in SIZE_EFFECT),
        lever=any(name in LEVER for name in names), delay=any(name in OFFSET for name in names),
    )  # fmt: skip
    if vector is None:
        vector = CoefficientVector.zeros(sensors.layout)
    vector = _ordered(vector, sensors)
    sense = free_run.sensitivity(
        made.increments, made.state, sensors, rows, first=made.first,
        gravity_offset=task.site.anomaly, held=task.held,
    )  # fmt: skip
    noise = free_run.spread(
        made.increments, made.state, Sensors.of(()), rows, np.zeros((9, 9)), task.noise,
        first=made.first, gravity_offset=task.site.anomaly, held=task.held,
    )  # fmt: skip
    return budget(
        made.increments.time[rows], sense, _aligned(task, made, vector),
        (vector.names, vector.values, vector.cov), made.start.phi_cov, noise,
        made.start.velocity_sd, made.start.position_sd,
    )  # fmt: skip


def _rows(made: Made) -> npt.NDArray[np.int64]:
    """Return rows spread evenly from the start to the last epoch that is compared."""
    last = len(made.increments) - 1
    if made.errors is not None:
        last = made.increments.row_at(float(made.errors.time[-1]))
    wanted = np.linspace(made.first, last, EPOCHS + 1)[1:]
    return np.unique(np.round(wanted).astype(np.int64))


def _ordered(vector: CoefficientVector, sensors: Sensors) -> CoefficientVector:
    """Return coefficients in the order of the error model."""
    keep = [vector.layout.index(name) for name in sensors.layout.names]
    cov = None if vector.cov is None else vector.cov[np.ix_(keep, keep)]
    return CoefficientVector(sensors.layout, vector.values[keep], cov)


def _aligned(task: Task, made: Made, vector: CoefficientVector) -> FloatArray:
    """Return the start attitude error per unit of each coefficient, by aligning again."""
    out = np.zeros((3, len(vector)))
    if task.settings.attitude_given or not len(vector):
        return out
    rows = np.searchsorted(made.log.time, [task.seen.start, task.seen.end])
    # Rows beside the window feed the integration at its ends.
    rest = made.log[max(0, int(rows[0]) - 3) : int(rows[1]) + 4]
    for k, name in enumerate(vector.names):
        if name in SIZE_EFFECT:
            continue  # at rest there is none
        step = _step(name, rest, task.site.gravity)
        accel, gyro = _model(name, step).measure(*_readings(rest))
        shifted = replace(rest, accel=accel, gyro=gyro)
        found = start_of(shifted, task.site, task.seen, task.settings, task.noise)
        out[:, k] = -rotation_vector(found.C_nb @ made.start.C_nb.T) / step
    return out


def _model(name: str, value: float) -> ImuModel:
    return ImuModel.from_coefficients(CoefficientVector(LAYOUT.subset([name]), np.array([value])))


def _readings(rest: Log) -> tuple[FloatArray, FloatArray]:
    assert rest.accel is not None
    assert rest.gyro is not None
    return rest.accel, rest.gyro


def _step(name: str, rest: Log, gravity: float) -> float:
    """Return a step small enough for the response to be linear, large against rounding."""
    size = (gravity, EARTH_RATE)
    # Beside the readings gravity and rate along every axis, one of which may read nothing.
    probes = [
        np.concatenate([x, v * np.ones((1, 3))]) for x, v in zip(_readings(rest), size, strict=True)
    ]
    moved = _model(name, 1.0).measure(*probes)
    change = max(float(np.abs(m - x).max()) / v
                 for m, x, v in zip(moved, probes, size, strict=True))  # fmt: skip
    return SMALL / change


def not_stationary(
    reference: Reference | None, trajectory: Trajectory, errors: NavigationError | None
) -> str:
    """Return why the terms of free inertial drift cannot be fitted; empty where they can."""
    if reference is None or errors is None:
        return "there is nothing to compare with"
    if not np.isfinite(errors.position[:, :2]).all():
        return "the reference has no positions"
    if float(errors.age[-1]) < schuler.SHORTEST:
        return f"the run is shorter than {plain(schuler.SHORTEST)} s"
    if not reference.still:
        return "the instrument moved"
    some = trajectory.every(max(1, len(trajectory) // 500)).C_nb
    turned = np.linalg.norm(rotation_vector(some @ some[0].T), axis=-1).max()
    if turned > TURNS:
        return f"the instrument turned, by up to {plain(np.degrees(turned), 3)} deg"
    return ""


def schuler_of(
    site: Site, errors: NavigationError | None, noise: ImuNoise
) -> schuler.SchulerFit | None:
    """Fit the terms of free inertial drift to the error of a run that stood still."""
    if errors is None:
        return None
    assert site.latitude is not None
    place = Place(site.latitude, site.height, site.gravity)
    return schuler.fit(
        errors.age, errors.position[:, :2], place,
        gyro_white=max(noise.gyro.white, QUIETEST[0]),
        accel_white=max(noise.accel.white, QUIETEST[1]),
    )  # fmt: skip


def checks(
    errors: NavigationError | None, budget: Budget, noise_source: str, calibrated: bool
) -> tuple[Check, ...]:
    """Test whether the start is known, and whether the error is what was predicted.

    `errors` or None: error of the run; `calibrated`: without a calibration the prediction lacks
    the errors of the sensors.
    """
    sd = float(np.degrees(np.sqrt(budget.start[2, 2])))
    limit, name = float(np.degrees(POOR)), "heading at the start"
    out = [check(name, name, sd, None, limit, {"sd": plain(sd, 3)}, fails=Level.UNUSABLE)]
    ends = [] if errors is None else _ends(errors, budget)
    why = _lacking(bool(ends), budget, noise_source, calibrated)
    if why:  # nothing of it may look like a certificate
        key = "last epoch not judged" if ends else "not judged"
        given = {"why": why} | (_off(*ends[0]) if ends else {})
        out.append(check(key, "error at the last epoch", np.nan, given=given, passed=False))
        return tuple(out)
    for name, e, P, unit in ends:
        square = normalised_square(e, P)
        most = chi_square_limits(len(e), 0.02, len(ends))[1]  # only too large is a mistake
        given = _off(name, e, P, unit)
        out.append(check("last epoch", f"{name} at the last epoch", square, None, most, given))
    return tuple(out)


End = tuple[str, FloatArray, FloatArray, str]


def _ends(errors: NavigationError, budget: Budget) -> list[End]:
    """Return name, error, predicted covariance and unit of what is known at the last epoch."""
    last = budget.cov[-1]
    parts = [
        ("position", errors.position[-1, :2], last[6:8, 6:8], "m"),
        ("velocity", errors.velocity[-1, :2], last[3:5, 3:5], "m/s"),
        ("heading", np.degrees(errors.angles[-1, :1]),
         np.degrees(np.degrees(last[2:3, 2:3])), "deg"),
    ]  # fmt: skip
    return [(n, e, P, u) for n, e, P, u in parts if np.isfinite(e).all()]


def _lacking(compared: bool, budget: Budget, noise_source: str, calibrated: bool) -> str:
    """Return why a run cannot be judged; empty where it can."""
    if not compared:
        return "there is nothing to compare with at the last epoch"
    if not calibrated:
        return "without a calibration nothing is known of the errors of the sensors"
    if np.isnan(budget.sd).any():
        return "the calibration does not say how sure its coefficients are"
    return "the noise of the sensors is not known" if noise_source == "none" else ""


def _off(name: str, e: FloatArray, P: FloatArray, unit: str) -> dict[str, str]:
    size, sd = float(np.linalg.norm(e)), float(np.sqrt(np.trace(P)))
    return {"what": name.capitalize(), "off": plain(size, 3), "unit": unit, "sd": plain(sd, 3)}
