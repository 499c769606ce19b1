"""What procedures on the six faces have in common: settings, solution, result, and better plans.

A plan rests on each of the six faces once or more, all rests of one length, that which fills the
time of the session: many short rests tell a drift from a bias and average placements, few long ones
average noise and lose no time in moves. Turns may be followed by turns back, as fast or at half the
speed. Every plan is judged by what a calibration would state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
from typing import Any, Literal, Self, get_args

import numpy as np
from pydantic import Field, field_validator

from foucault import units
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
from foucault.estimate.faces import TILTS, FaceNoise, OnFaces, State, on_faces, scene_of, unbiased
from foucault.guard.rest import first_rest, same_unit
from foucault.infer.snooping import snoop
from foucault.logs.axes import spared
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import Change, Motion
from foucault.models.noise import ImuNoise, SessionNoise
from foucault.models.rests_and_turns import TurnReadings, face_name
from foucault.plans.directions import RestPlan, face_plan
from foucault.plans.limit import Limit
from foucault.plans.optimise import StatedSpace
from foucault.procedures import left_out, record
from foucault.procedures.left_out import Again
from foucault.procedures.record import Beforehand, Given, Procedure
from foucault.result import Result
from foucault.simulate.hand_rotated import simulate_drawn
from foucault.strict import Strict
from foucault.tables import SPIKES, Log, range_below_g
from foucault.units import AngleSd, Seconds

FaceName = Literal["z_p", "z_a", "x_p", "x_a", "y_p", "y_a"]
FACES = {name: ("xyz".index(name[0]), 1 if name[2] == "p" else -1) for name in get_args(FaceName)}
"""Name of a face as `sections` has it, z up first -> its axis, and +1 where that points up."""

FACE_NAMES = tuple(FACES)

PLACED = float(np.radians(5 / 60))
"""How far a placement is taken to be off where nobody says it and no residual tells it [rad]."""


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
    placement_sd: AngleSd | None = Field(default=None, ge=0, examples=["5 arcmin"])
    """How far placements are off, about each of two axes; default: as [procedure] says, else
    5 arcmin."""
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

    def sizes(self, settings: Any) -> dict[str, float]:
        """Return how far it lies and turns askew, as `estimate.faces.TILTS` names it [rad]."""
        out: dict[str, float] = {}
        for name, key in TILTS:
            if hasattr(self, key):
                said = (getattr(self, key), getattr(settings, key), *out.values(), PLACED)
                out[name] = next(sd for sd in said if sd is not None)
        return out

    def plan(self, settings: Any, seed: int) -> RestPlan:
        """Return the rests; `seed`: seed of what is drawn of them [1]."""
        return face_plan(
            rest_time=self.rest_time, move_time=self.move_time,
            placement_sd=self.sizes(settings)["placement"], faces=self.placed, seed=seed,
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
    checks = (*face_checks.checks(e), *face_checks.drifts(e, log))
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


# -- which faces are best --------------------------------------------------------------------------

Plan = tuple[float, tuple[str, ...], float | None]
"""Length of a rest [s], the faces in their order, as sections are named, and how long a turn back
lasts, None where there are none [s]."""

EVALUATIONS = 60  # Plans that a restart judges: each is a simulated session [1].
TENTH = 10.0  # Rests are whole numbers of tenths of a second [1/s].


class Wanted(record.Wanted):
    """What may be changed of the rests of a session, and what is wanted."""

    time: Seconds | None = Field(default=None, gt=0, examples=["3 min"])
    """Time of the whole session; left out, that of the session in [simulate]."""
    rests: int = Field(default=18, ge=6, le=60)
    """Most faces that are rested on, those again included."""
    rest_time: Seconds = Field(default=3.0, gt=0)
    """Shortest rest."""


@dataclass(frozen=True)
class Bench:
    """What there is time for in a session on faces."""

    known: Beforehand[Any, Any]
    time: float  # of the session [s]
    most: int  # faces that are rested on [1]
    shortest: float  # rest [s]
    ways: tuple[float | None, ...]  # how long turns back may last, None: there are none [s]

    @property
    def words(self) -> str:
        """What is allowed."""
        return (f"up to {self.most} rests of {self.shortest:.4g} s or more on faces, "
                f"{units.span(self.time)} in all")  # fmt: skip

    def draw(self, rng: np.random.Generator) -> Plan | None:
        """Return a random plan; None where its rests are too short, or two are one."""
        more = rng.choice(len(FACES), int(rng.integers(0, self.most - len(FACES) + 1)))
        order = [*range(len(FACES)), *more]
        return self.filled([FACE_NAMES[k] for k in rng.permutation(order)], self._way(rng))

    def _way(self, rng: np.random.Generator) -> float | None:
        return self.ways[int(rng.integers(len(self.ways)))] if len(self.ways) > 1 else self.ways[0]

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan | None:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1]."""
        if len(self.ways) > 1 and rng.random() < 0.15:
            return self.filled(list(plan[1]), self._way(rng))
        faces, way = list(plan[1]), rng.random()
        j, k = rng.integers(len(faces), size=2)
        if way < 0.25:
            faces.insert(int(j), FACE_NAMES[int(rng.integers(len(FACES)))])
        elif way < 0.4:
            faces.append(faces[0])
        elif way < 0.6:
            del faces[j]
        else:
            faces[j], faces[k] = faces[k], faces[j]
        return self.filled(faces, plan[2])

    def filled(self, faces: list[str], back: float | None = None) -> Plan | None:
        """Return the plan of `faces` that takes all of the time; None where it cannot.

        `back`: how long turns back last, None: there are none [s].
        """
        twice = any(a == b for a, b in pairwise(faces))
        if twice or len(set(faces)) < len(FACES) or len(faces) > self.most:
            return None
        done = self.steps((1.0, tuple(faces), back))
        spare = self.time - float(done.turn_time.sum())
        rest = np.floor(TENTH * spare / len(done.rest_time)) / TENTH
        return None if rest < self.shortest else (float(rest), tuple(faces), back)

    def steps(self, plan: Plan) -> RestPlan:
        """Return the rests and turns of a plan."""
        session = done(self.known, plan)["session"]
        told: RestPlan = session.perfect.plan(self.known.settings, 0)
        return told


def done(known: Beforehand[Any, Any], plan: Plan) -> dict[str, Any]:
    """Return the session that does a plan."""
    rest, faces, back = plan
    told = {"rest_time": rest, "order": faces, "repeated": 0}
    turned = {"back_time": back} if hasattr(known.session, "back_time") else {}
    return {"session": known.session.model_copy(update=told | turned)}


@dataclass(frozen=True, kw_only=True)
class FaceSpace(StatedSpace):
    """The orders of faces that there is time for."""

    def changes(self, plan: Plan) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file."""
        rest, faces, back = plan
        told = {"rest_time": f"{rest:g} s", "order": [*faces], "repeated": None}
        turned = {"back_time": back and f"{back:g} s"} if len(self.allowed.ways) > 1 else {}
        return {"simulate": told | turned}

    def steps(self, plan: Plan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per face."""
        rest, faces, back = plan
        rows: list[tuple[str, ...]] = [("rest", "face", "time (s)")]
        rows += [(str(k), face_name(*FACES[f]), f"{rest:g}") for k, f in enumerate(faces, 1)]
        if back is not None:
            turned = [face.endswith("_p") and face not in faces[:k] for k, face in enumerate(faces)]
            words = [f"in {back:g} s, after a rest" if one else "" for one in turned]
            words = ["turned back", *words]
            rows = [(*row, text) for row, text in zip(rows, words, strict=True)]
        return tuple(rows)

    def needs(self, plan: Plan) -> tuple[Limit, ...]:
        """Return what a plan needs of the session."""
        return (Limit("time of the session", "time", self.duration(plan), self.allowed.time, "s"),)

    def duration(self, plan: Plan) -> float:
        """Return the time of the session [s]."""
        return float(self.allowed.steps(plan).duration)


def space(name: str, b: Beforehand[Any, Any]) -> FaceSpace:
    """Return the rests among which the best are sought; those of the session are to beat."""
    wanted, session = b.wanted, b.session
    faces = session.faces
    back, turn = getattr(session, "back_time", None), getattr(session, "turn_time", None)
    ways = (None,) if turn is None else tuple(dict.fromkeys((None, turn, 2 * turn, back)))
    reference = session.rest_time, faces, back
    shortest = max(wanted.rest_time, b.settings.shortest)
    bench = Bench(b, np.inf, max(wanted.rests, len(reference[1])), shortest, ways)
    time = wanted.time or float(bench.steps(reference).duration)
    bench = replace(bench, time=time)
    return record.space_of(FaceSpace, name, b, done, bench, reference)[0]


def face_procedure(name: str, doc: str, **own: Any) -> Procedure[Any, Any]:
    """Return the procedure of a method on faces; `own`: what it does not share with the other."""
    return Procedure(
        name=name,
        doc=doc,
        by_rests=True,
        plan=lambda settings, session, _: session.perfect.plan(settings, 0),
        simulation=simulate_drawn,
        sizes=lambda session, settings: session.sizes(settings),
        again=lambda model, log, _: again(model, log),
        space=partial(space, name),
        Wanted=Wanted,
        evaluations=EVALUATIONS,
        **own,
    )
