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

import numpy as np

from foucault.diagnose.faces.moves import check_moves
from foucault.diagnose.spikes import without_spikes
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.procedures import on_faces
from foucault.procedures.on_faces.settings import FaceSession, FaceSettings
from foucault.procedures.record import Given, Procedure
from foucault.result import Result
from foucault.simulate.faces import face_plan
from foucault.simulate.faces import simulate as simulate_plan
from foucault.simulate.hand_rotated import Simulation
from foucault.tables import Log


class Settings(FaceSettings):
    """What can be chosen; the defaults suit most logs."""


class Session(FaceSession):
    """The session that `simulate` makes."""


def _simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> Simulation:
    plan_seed, noise_seed = np.random.SeedSequence(seed).generate_state(2)
    plan = face_plan(
        rest_time=session.rest_time, move_time=session.move_time,
        placement_sd=session.placement_sd, seed=int(plan_seed),
    )  # fmt: skip
    return simulate_plan(
        plan, model=model, noise=noise, site=site, rate=session.rate, sampled=session.kind,
        seed=int(noise_seed),
    )  # fmt: skip


def _solve(log: Log, given: Given[Settings]) -> Result:
    site, settings, noise = given.site, given.settings, given.noise
    given.progress(0.1, "finding the faces")
    log = without_spikes(log)
    faces = on_faces.found_faces(log, site, settings)
    check_moves(log, faces)
    given.progress(0.5, "calibrating")
    names = settings.estimated(gyro=log.gyro is not None, turns=False)
    declared = (settings.placement_sd, 0.0, 0.0)
    solved = on_faces.solve(log, faces, None, site, names, noise, declared, given.prior)
    return on_faces.result_of("six_position", log, solved)


PROCEDURE = Procedure(
    name="six_position",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    simulation=_simulated,
    names=lambda settings, _: settings.estimated(turns=False),
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
