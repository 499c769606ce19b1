"""Readings on a table for the tests of its estimators: one call, everything that matters named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.estimate import table
from foucault.estimate.table import Options, TableModel, angle_start, free_start
from foucault.infer import mixed
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.models.noise import ImuNoise, grade
from foucault.models.turntable import Trust
from foucault.plans.directions import table_plan
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import Rig, simulate_readings

SITE = Site(9.81, np.radians(45.0), gravity_sd=0.0)
ARCSEC = np.pi / 648000
ACCEL_NAMES = tuple(n for n in LINEAR_LOWER if n.startswith("accel."))


def plan_of(name="icosahedron 12", spins=True, **more):
    """Return a plan with rests of a minute and spins of five turns at 10 deg/s."""
    return table_plan(
        name, spin_rate=np.radians(10.0), rest_time=60.0, turns=5, spins=spins, **more
    )


def simulated(
    plan, models=None, *, noise="tactical", common=0.0, position=0.0, seed=1, lever_arm=0.1,
    mounting=1e-3, draws=None, **rig,
):  # fmt: skip
    """Simulate readings of several instruments, each on a table with errors of its own."""
    models = [draw_errors("tactical", seed)] if models is None else models
    n = draws or len(models)
    rng = np.random.default_rng(seed)
    noise = noise if isinstance(noise, ImuNoise) else grade(noise).noise
    return simulate_readings(
        plan, models=models, noise=noise, site=SITE, seed=seed, draws=draws,
        rig=Rig(
            common=rng.normal(size=(n, 6)) * common, position_sd=position,
            mounting=rng.normal(size=(n, 3)) * mounting,
            lever_arm=rng.normal(size=(n, 3)) * lever_arm, heading=0.3, **rig,
        ),
    )  # fmt: skip


def silent(plan, model, *, sd=1e-9, rig=None, seed=1):
    """Return readings without noise, with a covariance as of some; and the simulation."""
    s = simulate_readings(
        plan, models=model, noise=ImuNoise(), site=SITE, rig=rig, draws=1, seed=seed
    )
    r = s.readings(0)
    eye = np.broadcast_to(np.eye(3), r.accel_cov.shape)
    return replace(r, accel_cov=eye * (9.81 * sd) ** 2, gyro_cov=eye * (0.17 * sd) ** 2), s


def trusting(common, position):
    """Return a trust in the angles with these sds."""
    return Trust(np.full(6, float(common)), position, SITE.latitude)


def model_of(readings, trust=None, names=LINEAR_LOWER, start=None, **options):
    """State the model; `trust` None believes nothing of the table."""
    spins = bool(readings.spin.any())
    if start is None:
        free = trust is None
        start = free_start(readings, SITE, spins) if free else angle_start(readings, SITE, trust)
    options = {
        "lever_arm": spins, "level": trust is None and spins, "gyro_at_rest": trust is not None,
    } | options  # fmt: skip
    return TableModel(readings, SITE, start, Options(LAYOUT.subset(names).names, **options))


def solved(readings, trust=None, names=LINEAR_LOWER):
    """Maximise the likelihood by the noise alone."""
    return mixed.solve(model_of(readings, trust, names)).estimate


def fitted(readings, trust=None, names=LINEAR_LOWER, **options):
    """Fit with outliers and scatter."""
    model = model_of(readings, trust, names, **options)
    return table.fit(readings, SITE, model.start, model.options)
