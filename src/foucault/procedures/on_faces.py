"""What procedures on the six faces have in common: the settings, the solution and the result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Any, Literal, Self, get_args

import numpy as np
from pydantic import Field, field_validator

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.faces import Faces, find_faces
from foucault.detect.noise import measure_noise
from foucault.detect.stretches import How, Rests, detection_table
from foucault.diagnose import faces as face_checks
from foucault.diagnose import hand_rotated as session_report
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.faces import FaceEvidence
from foucault.errors import Finding
from foucault.estimate.faces import FaceNoise, OnFaces, State, on_faces, scene_of, unbiased
from foucault.guard.rest import first_rest, same_unit
from foucault.infer.snooping import snoop
from foucault.logs.axes import spared
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import Change, Motion
from foucault.models.noise import ImuNoise, SessionNoise
from foucault.models.rests_and_turns import TurnReadings, face_name
from foucault.plans.directions import RestPlan, face_plan
from foucault.procedures import left_out, record
from foucault.procedures.left_out import Again
from foucault.procedures.record import Given
from foucault.result import Result
from foucault.strict import Strict
from foucault.tables import SPIKES, Log, range_below_g
from foucault.units import AngleSd, Seconds

FaceName = Literal["z_p", "z_a", "x_p", "x_a", "y_p", "y_a"]
FACES = {name: ("xyz".index(name[0]), 1 if name[2] == "p" else -1) for name in get_args(FaceName)}
"""Name of a face as `sections` has it, z up first -> its axis, and +1 where that points up."""


class FaceSettings(record.EarthRate, record.Terms):
    """What can be chosen of rests on faces; procedures add their own."""

    placement_sd: AngleSd | None = Field(default=None, ge=0, examples=["5 arcmin"])
    """How far a placement is off about each axis (block and support together). Left out: found from
    the residuals."""
    accel_quadratic: bool = False
    """Estimate the accelerometers' quadratic terms too: errors of placement look much the same."""
    sections: dict[str, list[int]] | None = Field(
        default=None, examples=[{"x_p": [540, 1271], "x_a": [1620, 2361]}]
    )
    """First sample and the sample after the last of every rest, by name: x_p, x_a, y_p, y_a, z_p,
    z_a. Left out: found in the log."""
    window: record.Window = 0.5
    shortest: record.Shortest = 1.0
    threshold: record.Threshold = None


class FaceSession(Strict):
    """The session on faces that `simulate` makes."""

    rest_time: record.RestTime = 10.0
    move_time: Seconds = Field(default=2.0, gt=0)
    """Length of the move from one face to the next."""
    rate: record.SampleRate = 100.0
    kind: record.Sampling = "rate"
    placement_sd: AngleSd = Field(default=0.0, ge=0)
    """How far placements are off, about each of two axes."""
    repeated: int = Field(default=0, ge=0, le=6)
    """So many of the first faces are rested on again at the end, which shows a drift."""
    order: tuple[FaceName, ...] = Field(
        default=(), examples=[["z_p", "x_p", "y_p", "z_a", "x_a", "y_a", "z_p"]]
    )
    """Faces in the order of the rests, each by name, p with the axis up and a with it down; empty:
    z first, then x and y."""

    @field_validator("order")
    @classmethod
    def _known(cls, order: tuple[str, ...]) -> tuple[str, ...]:
        missing = [name for name in FACES if name not in order] if order else []
        if missing:
            raise ValueError(f"each of the six faces is needed; {', '.join(missing)} is missing")
        twice = [a for a, b in pairwise(order) if a == b]
        if twice:
            raise ValueError(f"{twice[0]} twice in turn is one rest: make the rests longer")
        return order

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of the faces that are rested on, in their order; one twice in turn is one rest."""
        order = self.order or tuple(FACES)
        return tuple(face for face, _ in groupby((*order, *order[: self.repeated])))

    @property
    def first_rest(self) -> str:
        """The face that it begins on, as [log.accel] has it."""
        return face_name(*FACES[self.faces[0]])

    @property
    def placed(self) -> list[tuple[int, int]]:
        """The faces that are rested on as `plans.directions.face_plan` has them [1]."""
        return [FACES[name] for name in self.faces]

    @property
    def perfect(self) -> Self:
        """The session as it is meant: nothing lies askew."""
        told = type(self).model_fields
        return self.model_copy(update={key: 0.0 for key in told if key.endswith("_sd")})

    def plan(self, settings: Any, seed: int) -> RestPlan:
        """Return the rests; `seed`: seed of what is drawn of them [1]."""
        return face_plan(
            rest_time=self.rest_time, move_time=self.move_time,
            placement_sd=self.placement_sd, faces=self.placed, seed=seed,
        )  # fmt: skip


def found_faces(log: Log, site: Site, settings: FaceSettings) -> Faces:
    """Find the rests on faces, and compare the first with its declaration."""
    how = How(settings.window, settings.shortest, settings.threshold)
    faces = find_faces(log, site.gravity, sections=settings.sections, how=how)
    same_unit(faces.readings.accel, site.gravity)
    told = first_rest(log, faces.readings.up_k[0])
    return replace(faces, findings=(*faces.findings, *told))


def noise_of(
    log: Log, faces: Faces, turns: TurnReadings | None, declared: ImuNoise | None
) -> FaceNoise:
    """Return the noise of the readings: as declared, else as measured in the rests.

    `turns` or None: the turns.
    """
    if log.averaged is not None:
        return FaceNoise.of_means(declared, faces.readings)
    counts = log.sampled == "increment"
    if declared is not None:
        noise = SessionNoise.declared(declared, log.interval, counts)
        return FaceNoise.sampled(noise, faces.readings, turns, "declared")
    assert log.accel is not None
    rests = Rests(faces.first, faces.last)
    accel, gyro = (
        measure_noise(x, log.interval, rests, increments=counts)
        for x in (log.accel, log.accel if log.gyro is None else log.gyro)
    )
    noise = SessionNoise.measured(accel, gyro)
    return FaceNoise.sampled(noise, faces.readings, turns, "measured")


@dataclass(frozen=True)
class Observed:
    """What was seen of a session on faces, and what it is to tell."""

    log: Log  # readings [SI]
    faces: Faces
    turns: TurnReadings | None
    names: tuple[str, ...]  # coefficients that are estimated
    # placement, level and angle as declared, or None [rad]
    tilts: tuple[float | None, float | None, float | None]

    def model(self, given: Given[Any]) -> OnFaces:
        """State the model of rests and turns."""
        readings = self.faces.readings
        scene, start = scene_of(readings, self.turns, given.site, self.names, self.log)
        had = noise_of(self.log, self.faces, self.turns, given.noise)
        return on_faces(scene, start, self.names, had, self.tilts)

    def solve(self, given: Given[Any]) -> FaceEvidence:
        """Solve it, with what is not estimated where its sizes are given."""
        model = self.model(given)
        prior = CoefficientVector.prior(model.layout, given.prior) if given.prior else None
        of = again(model, self.log)
        fit, judged = left_out.fit(model, prior, given.sizes, given.site, of)
        tested = snoop(fit.white, fit.estimate.state_cov)
        fit = replace(fit, estimate=unbiased(fit.estimate))
        placement, _, angle = self.tilts
        told = placement is not None, angle is not None
        return FaceEvidence(fit, model, self.faces, tested, *told, left_out=judged)


def additions(settings: Any, session: Any) -> list[tuple[str, Any, Any]]:
    """Return plans that show more; `session`: that of the procedure."""
    repeated = session.model_copy(update={"repeated": session.repeated + 1})
    return [("the first face again at the end", settings, repeated)]


def again(model: OnFaces, log: Log) -> Again:
    """Return the session reduced again: rests as the geometry has them, samples of the turns."""
    scene, n = model.scene, len(model.scene.rests)
    rests, turns, vertical = scene.rests, scene.turns, EARTH_RATE * scene.rests.up_k
    spans = [] if turns is None else [*zip(turns.first, turns.last, strict=True)]
    rows = np.concatenate([np.zeros(0, int), *(np.arange(*span) for span in spans)])
    begin = np.cumsum([0, *(b - a for a, b in spans)])[:-1]
    time = np.append(rests.start + rests.time / 2, log.time[rows])

    def motion(state: State) -> tuple[ImuModel, Motion]:
        C = state.C_bk
        f_b, w_b = scene.force_k @ C.T, scene.rate_k @ C.T
        if spans:
            assert log.accel is not None
            assert log.gyro is not None
            more = state.model.compensate(log.accel[rows], log.gyro[rows])
            assert more[0] is not None
            assert more[1] is not None
            f_b, w_b = np.concatenate([f_b, more[0]]), np.concatenate([w_b, more[1]])
        return state.model, Motion(time, f_b, w_b, *log.time[[0, -1]])

    def residuals(state: State, by: Change) -> FloatArray:
        accel, gyro = (np.zeros((len(time), 3)) if x is None else x for x in by[:2])
        stronger = 1 + by.gravity / scene.site.gravity
        north = 0.0
        if scene.site.latitude is not None:
            latitude = scene.site.latitude
            north = float(np.sin(latitude + by.latitude) - np.sin(latitude))
        read, turned, about = rests.gyro, turns, scene.turn_k
        if turns is not None:
            mean = np.add.reduceat(gyro[n:], begin) / np.diff(np.append(begin, len(rows)))[:, None]
            turned = replace(turns, gyro=turns.gyro + mean * turns.time[:, None])
            about = about + north * EARTH_RATE * np.einsum("mij,mj->mi", scene.spread, turns.up_k)
        other = replace(
            scene,
            rests=replace(rests, accel=rests.accel + accel[:n],
                          gyro=None if read is None else read + gyro[:n]),
            turns=turned, turn_k=about,
            force_k=scene.force_k * stronger, turn_force_k=scene.turn_force_k * stronger,
            rate_k=scene.rate_k + north * vertical,
        )  # fmt: skip
        return replace(model, scene=other).linearise(state).residuals

    known = left_out.white_of(model.noise.session) if model.noise.known else (np.nan, np.nan)
    slow = left_out.wander_of(model.noise.session.slow, float(np.ptp(log.time)))
    return Again(motion, residuals, known, slow)


def result_of(procedure: str, log: Log, e: FaceEvidence) -> Result:
    """Make the result of what was solved."""
    site, faces = e.scene.site, e.faces
    validity = range_below_g(log, site.gravity, SPIKES)
    checks = face_checks.checks(e)
    tables: dict[str, Any] = {"readings": face_checks.readings_table(e)}
    if faces.rests is not None:
        tables["detection"] = detection_table(log, faces.rests)
    return record.result_of(
        procedure,
        e.fit,
        checks,
        site=site,
        findings=(*_noticed(log, e), *faces.findings, *face_checks.findings(e)),
        validity=validity,
        diagnostics=_diagnostics(log, e, validity.get("gyro")),
        tables=tables,
        gain=e.gain,
        judged=e.left_out,
    )


def _noticed(log: Log, e: FaceEvidence) -> tuple[Finding, ...]:
    used = [(r.start, r.time) for r in (e.scene.rests, e.scene.turns) if r is not None]
    return spared(log.findings, log, used, used)


def _diagnostics(log: Log, e: FaceEvidence, rates: list[float] | None) -> dict[str, Any]:
    estimate, r = e.fit.estimate, e.scene.rests
    out: dict[str, Any] = {
        "noise": session_report.noise_json(
            e.model.noise.session, e.model.noise.source == "declared"
        ),
        "gravity": e.scene.site.gravity,
        "unseen": [
            *face_checks.unseen(e),
            *unseen_sizes(estimate.coefficients, e.scene.site.gravity, rates),
        ],
        "placement_sd": e.tilt(0),
        "placement_declared": e.placement_given,
        "faces": [face_name(int(a), s) for a, s in zip(r.axis, r.sign, strict=True)],
        "mounting": estimate.state.C_bk.tolist(),
    }
    if not e.model.noise.known:
        out["noise"] = {"source": "unknown: from the residuals"}
    if e.scene.turns is not None:
        out |= {
            "turns": face_checks.turns_in_words(e.scene),
            "level_sd": e.tilt(1),
            "angle_sd": e.tilt(2),
        }
    if e.faces.rests is not None:
        rests = e.faces.rests
        out["detection"] = {
            "threshold": rests.threshold,
            "window": rests.window * log.interval,
            "rests": len(r),
            "rest_time": float(r.time.sum()),
        }
    return out
