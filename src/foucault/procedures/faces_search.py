"""Which faces, in which order and how often: the best that a session has time for are sought.

A plan rests on each of the six faces once or more, all rests of one length, that which fills the
time of the session: many short rests tell a drift from a bias and average placements, few long ones
average noise and lose no time in moves. Turns may be followed by turns back, as fast or at half the
speed. Every plan is judged by what a calibration would state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import Field

from foucault import procedures, units
from foucault.arrays import FloatArray
from foucault.models.imu import LAYOUT
from foucault.models.rests_and_turns import face_name
from foucault.plans.directions import RestPlan
from foucault.plans.limit import Limit
from foucault.plans.optimise import StatedSpace, require_seen, weights_of
from foucault.procedures.on_faces import FACES
from foucault.procedures.record import Beforehand, Stated
from foucault.strict import Strict
from foucault.units import Seconds

Plan = tuple[float, tuple[str, ...], float | None]
"""Length of a rest [s], the faces in their order, as sections are named, and how long a turn back
lasts, None where there are none [s]."""

HERE = "the session in [simulate]"

NAMES = tuple(FACES)

EVALUATIONS = 60  # Plans that a restart judges: each is a simulated session [1].
TENTH = 10.0  # Rests are whole numbers of tenths of a second [1/s].


class Wanted(Strict):
    """What may be changed of the rests of a session, and what is wanted."""

    weights: dict[str, float] = Field(default={})
    """How much each coefficient or group counts; 1 where nothing is said, 0 to leave it out."""
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
        return self.filled([NAMES[k] for k in rng.permutation(order)], self._way(rng))

    def _way(self, rng: np.random.Generator) -> float | None:
        return self.ways[int(rng.integers(len(self.ways)))] if len(self.ways) > 1 else self.ways[0]

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan | None:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1]."""
        if len(self.ways) > 1 and rng.random() < 0.15:
            return self.filled(list(plan[1]), self._way(rng))
        faces, way = list(plan[1]), rng.random()
        j, k = rng.integers(len(faces), size=2)
        if way < 0.25:
            faces.insert(int(j), NAMES[int(rng.integers(len(FACES)))])
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
        told: RestPlan = done(self.known, plan).perfect.plan(self.known.settings, 0)
        return told


def done(known: Beforehand[Any, Any], plan: Plan) -> Any:
    """Return the session that does a plan."""
    rest, faces, back = plan
    told = {"rest_time": rest, "order": faces, "repeated": 0}
    turned = {"back_time": back} if hasattr(known.session, "back_time") else {}
    return known.session.model_copy(update=told | turned)


def _sd(name: str, known: Beforehand[Any, Any], plan: Plan, _: str) -> FloatArray:
    """Return the sd of every coefficient that a calibration would state, shape (p,) [SI]."""
    session = done(known, plan)
    found = procedures.load(name).foreseen(replace(known, session=session), more=False)
    assert found is not None
    return found.sd


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
    stated = Stated(b, partial(_sd, name))
    sd = stated(reference, HERE)
    names = procedures.load(name).names(b.settings, session)
    layout = LAYOUT.subset(names)
    weights = weights_of(layout, wanted.weights)
    require_seen(names, weights, ~np.isfinite(sd), bench.words)
    return FaceSpace(
        allowed=bench, names=names, kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights, reference=reference, reference_name=HERE, cases=(HERE,), stated=stated,
    )  # fmt: skip
