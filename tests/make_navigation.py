"""An instrument with known errors, its calibration, and logs of it at rest and on the move."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.errors import Status
from foucault.logs.reference import Reference
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, grade
from foucault.plans.manoeuvres import Accelerate, Rest, Start, STurn, Turn
from foucault.result import Level, Result, Verdict
from foucault.simulate.motion import MotionSimulation, simulate_motion

START = Start(np.radians(47.3), np.radians(8.5), 430.0, *np.radians([63.0, 3.0, -2.0]))
SITE = Site.at(START.latitude, START.height)
LONGITUDE = START.longitude
NOISE = grade("navigation").noise
SPREAD = grade("navigation").spread

DRIVE = [Rest(120.0)] + 2 * [
    Accelerate(15.0, 10.0), Turn(np.radians(80), 20.0, banked=False),
    STurn(np.radians(40), 30.0, banked=False), Accelerate(0.0, 10.0), Rest(20.0),
]  # fmt: skip
"""A rest, and a minute of driving, twice."""


def errors(seed: int = 1, known: float = 0.02) -> tuple[CoefficientVector, CoefficientVector]:
    """Return what an instrument errs by, and a calibration that knows it to a part of its size."""
    rng = np.random.default_rng(seed)
    layout = LAYOUT.subset(LINEAR_LOWER)
    spread = np.array([SPREAD[name.rpartition(".")[0]] for name in layout.names])
    true = spread * rng.normal(size=len(layout))
    sd = known * spread
    found = true + sd * rng.normal(size=len(layout))
    return CoefficientVector(layout, true), CoefficientVector(layout, found, np.diag(sd**2))


def calibration(vector: CoefficientVector, level: Level = Level.PASS, **changes) -> Result:
    """Return a calibration as `calibrate` leaves it."""
    words = {"instrument": {"serial": "SN 4", "name": "Unit"}} | changes
    return Result("turntable", vector, "", "body axes", "", Verdict(level, ("It is old.",)), (), (),
                  Status.CONVERGED, **words)  # fmt: skip


def logged(
    plan, vector: CoefficientVector | None = None, *, noise: ImuNoise | None = NOISE, seed: int = 1,
    rate: float = 20.0, start: Start = START,
) -> MotionSimulation:  # fmt: skip
    """Simulate a log of an instrument."""
    model = None if vector is None else ImuModel.from_coefficients(vector)
    return simulate_motion(plan, start, rate=rate, model=model, noise=noise, seed=seed)


def reference_of(run: MotionSimulation, every: int = 20, **changes) -> Reference:
    """Return the truth as a reference."""
    t = run.truth
    position = np.column_stack([t.latitude, t.longitude, t.height])[::every]
    words = {"position": position, "velocity_n": t.velocity_n[::every], "angles": t.angles[::every]}
    return Reference(t.time[::every], **(words | changes))


def write_reference(run: MotionSimulation, path: Path, every: int = 20) -> None:
    """Write the positions of the truth as CSV."""
    t = run.truth
    rows = np.column_stack([t.time, *np.degrees([t.latitude, t.longitude]), t.height])[::every]
    titles = "time (s),latitude (deg),longitude (deg),height (m)"
    np.savetxt(path, rows, "%.10f", ",", header=titles, comments="")
