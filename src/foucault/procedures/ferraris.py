"""Calibrate an IMU from rests on its six faces and a turn by a known angle about each axis.

Rest the instrument with each axis up and down, and turn it on the spot once about each axis, with
a rest before and after. The rests calibrate the accelerometers and the gyro biases, the turns the
gyros: what they add up to is the angle. The likelihood uses what is redundant, models the Earth's
rotation where the latitude is given, and carries errors of placement, of the level of the support
and of the angle into every uncertainty. The published solution can be had instead, to compare.

References
----------
.. [1] F. Ferraris, U. Grimaldi, M. Parvis, "Procedure for effortless in-field calibration of
   three-axial rate gyro and accelerometers", Sensors and Materials 7(5), 1995.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, field_validator

from foucault.arrays import FloatArray
from foucault.detect.faces import BUMP, find_turns, is_whole
from foucault.detect.noise import without_spikes
from foucault.diagnose.faces import FaceEvidence
from foucault.errors import error
from foucault.estimate import faces as engine
from foucault.guard.rest import between_rests
from foucault.models.imu import LAYOUT, LINEAR_LOWER, Gauge, ImuModel
from foucault.plans.directions import RestPlan, face_plan
from foucault.procedures import on_faces
from foucault.procedures.on_faces import FaceSession, FaceSettings, Observed
from foucault.procedures.record import Given
from foucault.result import Result
from foucault.tables import Log
from foucault.units import Angle, AngleSd, Seconds

OneOrThree = float | tuple[float, float, float]
AngleOrThree = Annotated[
    Annotated[Angle, Tag("one")] | Annotated[tuple[Angle, Angle, Angle], Tag("each")],
    Discriminator(lambda given: "each" if isinstance(given, (list, tuple)) else "one"),
]


class Settings(FaceSettings):
    """What can be chosen; the defaults suit most logs."""

    solution: Literal["likelihood", "published"] = "likelihood"
    """likelihood: all readings, weighed by their uncertainty; published: the closed form of
    Ferraris, as other programs have it, with g-sensitivity."""
    angle: AngleOrThree = Field(
        default=-2 * np.pi, examples=["-360 deg", ["360 deg", "720 deg", "90 deg"]]
    )
    """Angle of the first turn about each positive axis, negative for clockwise as seen against the
    axis; others may go the other way. One value: whole turns. Three, for x, y and z: any known
    angles."""
    angle_sd: AngleSd | None = Field(default=None, ge=0, examples=["0.5 deg"])
    """How nearly a turn ends where it began. Left out: like the placement."""
    level_sd: AngleSd | None = Field(default=None, ge=0, examples=["5 arcmin"])
    """How nearly vertical the axis of a turn is (the level of the support). Left out: like the
    placement."""
    sections: dict[str, list[int]] | None = Field(
        default=None, examples=[{"x_p": [540, 1271], "x_a": [1620, 2361], "x_rot": [6770, 7093]}]
    )
    """First sample and the sample after the last of every rest and turn, by name: x_p, x_a, y_p,
    y_a, z_p, z_a, x_rot, y_rot, z_rot. Left out: found in the log."""

    @field_validator("angle")
    @classmethod
    def _known(cls, angle: OneOrThree) -> OneOrThree:
        if isinstance(angle, tuple):
            if min(abs(a) for a in angle) < BUMP:
                raise ValueError('each should be 45 deg or more, such as "90 deg"')
        elif not is_whole(angle):
            raise ValueError(
                'it should be one or more whole turns, such as "-360 deg", or a known angle for '
                'each axis, such as ["360 deg", "720 deg", "90 deg"]'
            )
        return angle


class Session(FaceSession):
    """The session that `simulate` makes."""

    turn_time: Seconds = Field(default=5.0, gt=0)
    """Length of each turn."""
    back_time: Seconds | None = Field(default=None, gt=0)
    """Length of a turn back, which follows each turn after a rest. Left out, none does."""
    angle_sd: AngleSd | None = Field(default=None, ge=0, examples=["0.5 deg"])
    """Error of the angle of a turn; default: as [procedure] says, else as placement_sd."""
    level_sd: AngleSd | None = Field(default=None, ge=0, examples=["5 arcmin"])
    """Tilt of the axis of a turn; default: as [procedure] says, else as placement_sd."""

    def plan(self, settings: Settings, seed: int) -> RestPlan:
        """Return the rests and turns; `seed`: seed of what is drawn of them [1]."""
        placement, level, angle = self.sizes(settings).values()
        return face_plan(
            rest_time=self.rest_time, move_time=self.move_time, turn_time=self.turn_time,
            back_time=self.back_time, angle=settings.angle, placement_sd=placement,
            level_sd=level, angle_sd=angle, faces=self.placed, seed=seed,
        )  # fmt: skip


def names_of(settings: Settings) -> tuple[str, ...]:
    """Return the coefficients that are estimated."""
    if settings.solution == "published":
        names = (*LINEAR_LOWER, *(n for n in LAYOUT.names if n.startswith("gyro.g_sensitivity.")))
        return tuple(n for n in LAYOUT.names if n in names)
    return settings.estimated()


def _observed(log: Log, given: Given[Settings]) -> Observed:
    settings = given.settings
    if settings.solution == "published" and given.prior:
        raise error("ferraris.prior")
    log = without_spikes(log)
    faces = on_faces.found_faces(log, given.site, settings)
    faces, turns = find_turns(log, faces, settings.angle, settings.sections)
    between_rests(log, faces.first, faces.last, faces.readings.up_k, alone=True)
    declared = (settings.placement_sd, settings.level_sd, settings.angle_sd)
    return Observed(log, faces, turns, names_of(settings), declared)


def _solve(log: Log, given: Given[Settings]) -> Result:
    given.progress(0.1, "finding faces and turns")
    observed = _observed(log, given)
    given.progress(0.5, "calibrating")
    solved, extra = observed.solve(given), dict[str, Any]()
    if given.settings.solution == "published":
        solved, extra = _published(solved)
    result = on_faces.result_of("ferraris", observed.log, solved)
    return replace(result, diagnostics=result.diagnostics | extra)


def _published(e: FaceEvidence) -> tuple[FaceEvidence, dict[str, Any]]:
    """Put the published solution in the place of the likelihood's, with its own covariance."""
    names, scene = e.model.layout.names, e.scene

    def solved(readings: FloatArray) -> ImuModel:
        n, _, _ = scene.sizes
        assert scene.turns is not None
        rests = replace(scene.rests, accel=readings[:n], gyro=readings[n : 2 * n])
        turns = replace(scene.turns, gyro=readings[2 * n :])
        return engine.published(rests, turns, scene.site, scene.spread)

    model_k = solved(scene.readings)
    model, C_bk = model_k.in_gauge(Gauge.LOWER)
    gain = _slope(lambda x: solved(x).in_gauge(Gauge.LOWER)[0].coefficients(names).values, scene)
    cov = gain @ e.fit.covariance.whole @ gain.T
    vector = replace(model.coefficients(names), cov=cov)
    # The residuals and the redundancy stay those of the likelihood: this solution has none.
    estimate = replace(e.fit.estimate, coefficients=vector, state=engine.State(model, C_bk))
    K_a, R_a = engine.scale_and_rotation(model_k.accel_matrix)
    K_g, R_g = engine.scale_and_rotation(model_k.gyro_matrix)
    terms = {
        "K_a": K_a, "R_a": R_a, "b_a": model_k.accel_bias, "K_g": K_g, "R_g": R_g,
        "b_g": model_k.gyro_bias, "K_ga": model_k.g_sensitivity,
    }  # fmt: skip
    extra = {"published": {name: value.tolist() for name, value in terms.items()}}
    return replace(e, fit=replace(e.fit, estimate=estimate), gain=gain), extra


def _slope(values: Any, scene: engine.Scene) -> FloatArray:
    """Derivative of the solution with respect to every reading, by central differences."""
    at = scene.readings
    n, _, _ = scene.sizes
    out = []
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = 1e-4 * (scene.site.gravity if k < 3 * n else 1e-2 if k < 6 * n else 1.0)
        moved = step.reshape(at.shape)
        out.append((values(at + moved) - values(at - moved)) / (2 * step[k]))
    return np.stack(out, axis=1)


def _stated(log: Log, given: Given[Settings]) -> engine.OnFaces | None:
    likelihood = given.settings.solution == "likelihood"
    return _observed(log, given).model(given) if likelihood else None


def _additions(settings: Settings, session: Session) -> list[tuple[str, Settings, Session]]:
    back = session.model_copy(update={"back_time": 2 * session.turn_time})
    turned = [("each turn turned back, at half the speed", settings, back)]
    return on_faces.additions(settings, session) + (turned if session.back_time is None else [])


PROCEDURE = on_faces.face_procedure(
    "ferraris",
    __doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    observe=_stated,
    additions=_additions,
    names=lambda settings, _: names_of(settings),
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
