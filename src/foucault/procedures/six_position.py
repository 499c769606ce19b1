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

from foucault.detect.noise import without_spikes
from foucault.guard import rest as turns
from foucault.procedures import on_faces
from foucault.procedures.on_faces import FaceSession, FaceSettings, Observed
from foucault.procedures.record import Given
from foucault.result import Result
from foucault.tables import Log


class Settings(FaceSettings):
    """What can be chosen; the defaults suit most logs."""


class Session(FaceSession):
    """The session that `simulate` makes."""


def _observed(log: Log, given: Given[Settings]) -> Observed:
    settings = given.settings
    log = without_spikes(log)
    faces = on_faces.found_faces(log, given.site, settings)
    turns.between_rests(log, faces.first, faces.last, faces.readings.up_k, alone=True)
    names = settings.estimated(gyro=log.gyro is not None, turns=False)
    return Observed(log, faces, None, names, (settings.placement_sd, 0.0, 0.0))


def _solve(log: Log, given: Given[Settings]) -> Result:
    given.progress(0.1, "finding the faces")
    observed = _observed(log, given)
    given.progress(0.5, "calibrating")
    return on_faces.result_of("six_position", observed.log, observed.solve(given))


PROCEDURE = on_faces.face_procedure(
    "six_position",
    __doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    observe=lambda log, given: _observed(log, given).model(given),
    additions=on_faces.additions,
    names=lambda settings, _: settings.estimated(turns=False),
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
