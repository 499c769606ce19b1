"""Calibrate accelerometers and gyro biases from rests on the six faces of the instrument.

Rest the instrument with each axis up and down once or more, in any order, on a level support. In
each rest the specific force is known in the axes of the case, so that the readings give bias,
scale factors and misalignments by linear least squares; how far the placements are off is found
from the residuals or declared, and is part of every uncertainty.

References
----------
.. [1] D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., 2004,
   section 8.2 (multi-position tests).
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.diagnose.faces.moves import check_moves
from foucault.diagnose.spikes import without_spikes
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.procedures import Progress, on_faces, silent
from foucault.procedures.on_faces import settings as face_settings
from foucault.procedures.on_faces.settings import FaceSession, FaceSettings
from foucault.result import Result
from foucault.simulate.faces import face_plan
from foucault.simulate.faces import simulate as simulate_plan
from foucault.simulate.hand_rotated import Simulation
from foucault.tables import Log


class Settings(FaceSettings):
    """What can be chosen; the defaults suit most logs."""


class Session(FaceSession):
    """The session that `simulate` makes."""


def simulate(
    session: Session,
    *,
    settings: Settings | None = None,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    seed: int,
) -> Simulation:
    """Simulate a session.

    `settings` or None: not needed: the faces are always the six; `noise`: its noise [SI]; `seed`:
    seed of plan and noise [1].
    """
    plan_seed, noise_seed = np.random.SeedSequence(seed).generate_state(2)
    plan = face_plan(
        rest_time=session.rest_time, move_time=session.move_time,
        placement_sd=session.placement_sd, seed=int(plan_seed),
    )  # fmt: skip
    return simulate_plan(
        plan, model=model, noise=noise, site=site, rate=session.rate, sampled=session.kind,
        seed=int(noise_seed),
    )  # fmt: skip


def names_of(settings: Settings, gyro: bool = True) -> tuple[str, ...]:
    """Return the coefficients that are estimated."""
    return face_settings.names_of(settings, turns=False, gyro=gyro)


def calibrate(
    log: Log,
    *,
    site: Site,
    settings: Settings | None = None,
    noise: ImuNoise | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    instrument: Mapping[str, Any] | None = None,
    progress: Progress = silent,
) -> Result:
    """Calibrate an IMU from rests on its six faces.

    Parameters
    ----------
    log : Log
        Readings, or means with one row per rest [SI].
    site : Site
        Local gravity, and latitude where the Earth's rotation is to be modelled.
    settings : Settings or None
        What can be chosen; None takes the defaults.
    noise : ImuNoise or None
        Noise of the instrument [SI]; None measures it in the rests.
    prior : mapping of str to (float, float) or None
        Mean and standard deviation of coefficients or groups of coefficients [SI].
    instrument : mapping or None
        Name, serial and so on, kept in the result.
    progress : callable
        Called with the fraction done and what is being done.

    Returns
    -------
    Result
        Coefficients with covariance, checks and a verdict [SI].

    Raises
    ------
    FoucaultError
        A face missing, a rest on no face or moving, a wrong unit: see `foucault.symptoms`.
    """
    started = clock.monotonic()
    settings = settings or Settings()
    if not settings.earth_rate:
        site = replace(site, latitude=None)
    progress(0.1, "finding the faces")
    log = without_spikes(log)
    faces = on_faces.found_faces(log, site, settings)
    check_moves(log, faces)
    progress(0.5, "calibrating")
    solved = on_faces.solve(
        log, faces, None, site, names_of(settings, log.gyro is not None), noise,
        (settings.placement_sd, 0.0, 0.0), prior or {},
    )  # fmt: skip
    progress(1.0, "done")
    seconds = clock.monotonic() - started
    return on_faces.result_of("six_position", log, solved, instrument or {}, seconds)
