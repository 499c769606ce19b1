"""Calibrate an IMU on a table whose angles need not be known: norm observation.

Rest the instrument in a dozen positions and spin the outer axis by whole turns in each. At rest
the specific force must have the size of gravity; over whole turns the mean rate must have that of
the table and of the Earth's vertical part. Both mean vectors of a spin lie along the outer axis,
which ties the frames of accelerometers and gyros together.

The published method solves linear equations and recovers the coefficients to first order; here the
recovery is exact, and the default is the likelihood of all readings together.

References
----------
.. [1] Dong, Ren, Chen, Wang, "Calibration method for the laser gyro strapdown inertial navigation
   system based on norm-observation", Infrared and Laser Engineering 47(9), 2018.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.estimate import norm_observation
from foucault.estimate.table import TableFit
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.noise import Readings
from foucault.models.turntable import State
from foucault.procedures import on_table
from foucault.procedures.on_table import Task, table_procedure
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.procedures.on_table.session import simulate as simulate


class Settings(TableSettings):
    """What can be chosen; the defaults suit most tables."""

    solution: Literal["likelihood", "linear", "published"] = "likelihood"
    """likelihood: all readings together; linear: the linear equations with the exact recovery;
    published: with the published recovery, to first order."""
    unification: Literal["parallel vectors", "four positions"] = "parallel vectors"
    """How the frames of the linear solutions are tied together; four positions: as published, needs
    four_positions = true and believes the angles of the table."""


class Session(TableSession):
    """The session that `simulate` makes."""


def task_of(settings: Settings) -> Task:
    """Return the task that `settings` describe."""
    variant = None if settings.solution == "likelihood" else partial(linear, settings)
    return Task("norm_observation", settings, None, variant)


def linear(
    settings: Settings, readings: Readings, site: Site, fit: TableFit
) -> tuple[CoefficientVector, State, FloatArray]:
    """Solve by linear equations, with the covariance that first-order propagation gives.

    With both it returns what one unit of each component of a reading does, shape (p, 3 k) [SI].

    `readings`: what was observed, readings that the fit left out are left out here too [SI];
    `fit`: the likelihood's solution: its covariance of the readings, scatter included, and
    outliers. Raises ``solution.linear``: a prior or terms that the linear equations do not have.
    """
    options = fit.model.options
    more = sorted(set(options.names) - set(LINEAR_LOWER))
    if options.prior is not None or more:
        what = ", ".join([*(["a prior"] if options.prior is not None else []), *more])
        raise error("solution.linear", solution=settings.solution, what=what)
    n = len(readings)
    kept = np.ones(n, bool)
    kept[[b % n for b in fit.outliers]] = False
    some = readings[kept]
    model, lever_arm = solve(settings, some, site)
    names = tuple(n for n in LINEAR_LOWER if readings.gyro is not None or n.startswith("accel."))
    values = model.coefficients(names).values
    rows, axes = fit.model.rows, fit.model.axes
    slopes = np.zeros((len(names), len(rows), 3))
    for k in np.flatnonzero(kept[rows % n]):
        triad, step = ("accel", 1e-4) if rows[k] < n else ("gyro", 1e-6)
        for i in range(3):
            moved = []
            for sign in (1.0, -1.0):
                other = getattr(readings, triad).copy()
                other[rows[k] % n] += sign * step * axes[k, i]
                at, _ = solve(settings, replace(readings, **{triad: other})[kept], site)
                moved.append(at.coefficients(names).values)
            slopes[:, k, i] = (moved[0] - moved[1]) / (2 * step)
    flat = slopes.reshape(len(names), -1)
    cov = flat @ fit.fit.covariance.whole @ flat.T
    vector = CoefficientVector(LAYOUT.subset(names), values, cov)
    return vector, replace(fit.estimate.state, model=model, lever_arm=lever_arm), flat


def solve(settings: Settings, readings: Readings, site: Site) -> tuple[ImuModel, FloatArray]:
    """Solve the linear equations of both triads and tie their frames together.

    Returns `lever_arm` (3,): the accelerometers from the centre of the table, body axes; zero where
    not solved for [m].
    """
    spin, arm = readings.spin, np.zeros(3)
    assert readings.accel is not None
    rest = readings.accel[~spin]
    triad = _published if settings.solution == "published" else norm_observation.solve
    M, b = _solved(
        triad(rest if len(rest) >= on_table.NORM_NEEDS else readings.accel, site.gravity)
    )
    model = ImuModel(accel_matrix=M, accel_bias=b)
    if readings.gyro is not None:
        h = turntable.mean_rate(readings.rate, site.latitude or 0.0)
        L, bias = _solved(triad(readings.gyro[spin], h[spin]))
        w_d = (readings.gyro[spin] - bias) @ np.linalg.inv(L).T
        f_b = (readings.accel[spin] - b) @ np.linalg.inv(M).T
        if settings.unification == "four positions":
            C_bd = norm_observation.unify_four_positions(readings, b, bias, h, site.gravity)
        else:
            C_bd, arm = norm_observation.unify(f_b, w_d, h[spin], site.gravity, settings.lever_arm)
        model = replace(model, gyro_matrix=L @ C_bd.T, gyro_bias=bias)
    return model, arm


def _published(readings: FloatArray, norm: float | FloatArray) -> tuple[FloatArray, FloatArray]:
    sizes = np.abs(np.broadcast_to(norm, len(readings)))
    return norm_observation.published_recovery(readings / sizes[:, None] * sizes[0], sizes[0])


def _solved(pair: tuple[FloatArray, FloatArray] | None) -> tuple[FloatArray, FloatArray]:
    assert pair is not None  # the start of the likelihood has solved the same equations
    return pair


PROCEDURE = table_procedure(
    "norm_observation", __doc__, Settings, Session, lambda settings, _: task_of(settings)
)
calibrate = PROCEDURE.calibrate
