"""What an operator does: a plan as stages, each with an attitude, what to set and for how long.

Plans of every kind become the same stages, so that one list and one picture serve all of them. What
is drawn of an instrument that lies or is held somehow is turned about up so that y points north
where it can: its heading is free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from itertools import groupby
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.cluster import attitude_of
from foucault.models.rotation import exp, log
from foucault.models.spin import across
from foucault.models.turntable import TablePlan, chain
from foucault.plans.directions import Free, RestPlan
from foucault.plans.manoeuvres import Rest, Rotate, Straight, Sway, plain_manoeuvre
from foucault.plans.sequence import CalibrationSequence
from foucault.plans.transfer import TransferProfile
from foucault.plans.tumble import TorquingPlan
from foucault.simulate.motion import motion_of
from foucault.simulate.north import NorthPlan, Stops
from foucault.simulate.rate_table import PAUSE as STEP_PAUSE
from foucault.simulate.rate_table import RatePlan
from foucault.simulate.spin import PAUSE, RAMP, SpinPlan

STILL = np.zeros(3)

LEVEL = 3.0  # What is nearer to up, down or level is called so [deg].


@dataclass(frozen=True)
class Act:
    """One thing that happens in a stage."""

    words: str
    time: float  # how long it takes [s]
    C_nb: FloatArray  # (3, 3) attitude at its beginning, instrument to East-North-Up [1]
    w_b: FloatArray  # (3,) rate while it lasts, zero at rest [rad/s]


@dataclass(frozen=True)
class Stage:
    """A position, what is set for it, and what is done there."""

    set: str  # where to put it
    acts: tuple[Act, ...]
    move: float = 0.0  # time to get there [s]

    @property
    def shown(self) -> FloatArray:
        """Attitude that a picture shows, shape (3, 3) [1]: that of the rest, where there is one."""
        still = [act.C_nb for act in self.acts if not act.w_b.any()]
        return still[-1] if still else self.acts[0].C_nb

    @property
    def turns(self) -> FloatArray:
        """Rate that a picture shows, shape (3,), zero where nothing turns [rad/s].

        That of the turn that ends here, or with which what is done here begins.
        """
        turning = [act.w_b for act in self.acts if act.w_b.any()] or [STILL]
        return turning[0] if self.acts[-1].w_b.any() else turning[-1]

    @property
    def time(self) -> float:
        """How long it takes, the way there included [s]."""
        return self.move + sum(act.time for act in self.acts)


@singledispatch
def stages(plan: Any) -> tuple[Stage, ...]:
    """Return what an operator does, of a plan of any kind."""
    raise TypeError(type(plan).__name__)


def stands(C_nb: FloatArray) -> str:
    """Say how an instrument stands: where its axes point above or below the horizon.

    `C_nb` (3, 3): attitude, instrument to East-North-Up [1].
    """
    above = np.degrees(np.arcsin(np.clip(C_nb[2], -1.0, 1.0)))
    for axis, angle in zip("xyz", above, strict=True):
        if abs(angle) > 90.0 - LEVEL:
            return f"{axis} {'up' if angle > 0 else 'down'}"
    parts = []
    for axis, angle in zip("xyz", above, strict=True):
        way = "up" if angle > 0 else "down"
        parts.append(f"{axis} level" if abs(angle) < LEVEL else f"{axis} {abs(angle):.0f}° {way}")
    return ", ".join(parts)


def lasting(time: float) -> str:
    """Write how long something takes; `time` [s]."""
    if time < 120.0:
        return f"{time:.3g} s"
    minutes, seconds = divmod(round(time), 60)
    return f"{minutes} min {seconds} s" if seconds else f"{minutes} min"


def _rest(time: float, C_nb: FloatArray) -> Act:
    return Act("rest", time, C_nb, STILL)


def _angle(value: float) -> str:
    return f"{np.degrees(value):z.6g}°"


def _turned_north(C_nb: FloatArray) -> FloatArray:
    """Turn an attitude about up so that y, or where it is vertical z, points north."""
    to = C_nb[:, 1] if abs(C_nb[2, 1]) < np.cos(np.radians(30.0)) else C_nb[:, 2]
    return np.asarray(exp(np.array([0.0, 0.0, np.arctan2(to[0], to[1])])) @ C_nb)


@stages.register
def _(plan: RestPlan) -> tuple[Stage, ...]:
    out: list[Stage] = []
    for k, C in enumerate(plan.C_nb):
        shown, time = _turned_north(C), float(plan.rest_time[k])
        way = float(plan.turn_time[k - 1]) if k else 0.0
        turn = plan.rotation[k - 1] if k and plan.rotation is not None else STILL
        angle = float(np.linalg.norm(turn))
        in_place = k and plan.C_nb[k - 1][2] @ C[2] > np.cos(np.radians(LEVEL))
        if in_place and angle:
            about = turn / angle
            axis = int(np.abs(about).argmax())
            words = f"turn {_angle(angle * np.sign(about[axis]))} about {'xyz'[axis]}"
            start = shown @ exp(turn).T
            acts = (Act(words, way, start, turn / way), _rest(time, shown))
            out.append(Stage(f"{stands(C)}, turned in its place", acts))
        else:
            out.append(Stage(stands(C), (_rest(time, shown),), way))
    return tuple(out)


@stages.register
def _(plan: TablePlan) -> tuple[Stage, ...]:
    return _on_table(plan, "", 0.0)


def _on_table(plan: TablePlan, called: str, pause: float) -> tuple[Stage, ...]:
    at, out = chain(plan.angles), []
    for angles, rows in groupby(range(len(plan)), lambda k: plan.angles[k].tolist()):
        few = list(rows)
        spun = bool(plan.rate[few].any())
        axes = zip(("outer", "middle", "inner"), angles, strict=True)
        told = ", ".join(f"{axis} {_angle(a)}" for axis, a in axes if axis != "outer" or not spun)
        acts = tuple(_spin(float(plan.rate[k]), float(plan.time[k]), at.C_tk[k], at.outer_k[k])
                     for k in few)  # fmt: skip
        out.append(Stage(called or told, acts, pause * len(few)))
    return tuple(out)


def _spin(rate: float, time: float, C_nb: FloatArray, axis_b: FloatArray) -> Act:
    """Return a rest, or turns of the outer axis; `rate` [rad/s], `time` [s], `axis_b` (3,) [1]."""
    if not rate:
        return _rest(time, C_nb)
    turns = abs(rate) * time / (2 * np.pi)
    words = f"{np.degrees(rate):+.6g}°/s, {turns:.4g} turn{'s' if turns > 1.001 else ''}"
    return Act(words, time, C_nb, rate * axis_b)


@stages.register
def _(plan: RatePlan) -> tuple[Stage, ...]:
    return tuple(
        one for name in plan.axes for one in _on_table(plan.placement(name), name, STEP_PAUSE)
    )


@stages.register
def _(plan: SpinPlan) -> tuple[Stage, ...]:
    out = []
    for name in plan.mountings:
        unit = np.ones(3) / np.sqrt(3.0)
        if name != "skew":
            unit = np.eye(3)["xyz".index(name[-1])] * (-1.0 if name[0] == "-" else 1.0)
        # The spin axis points east and is level, as in a drill that lies on its side.
        C_nb = across(np.array([1.0, 0.0, 0.0])) @ across(unit).T
        acts = tuple(_spin(rate, plan.spin_time, C_nb, unit) for rate in plan.rates)
        told = "skew to all axes" if name == "skew" else f"{name} along the spin axis"
        out.append(Stage(told, acts, (2 * RAMP + PAUSE) * len(acts)))
    return tuple(out)


@stages.register
def _(plan: CalibrationSequence) -> tuple[Stage, ...]:
    out: list[Stage] = []
    acts: list[Act] = []
    for k, action in enumerate(plan.actions):
        C, u = plan.attitudes[k], plan.axis_b[k]
        if isinstance(action, Rotate):
            sign = np.sign(action.angle) or 1.0
            words = f"turn {_angle(action.angle)} about {action.axis} at {_angle(action.rate)}/s"
            acts.append(Act(words, action.time, C, u * sign * abs(action.angle) / action.time))
        else:
            out.append(Stage(stands(C), (*acts, _rest(action.time, C))))
            acts = []
    if acts:
        out.append(Stage(stands(plan.attitudes[-1]), tuple(acts)))
    return tuple(out)


@stages.register
def _(plan: TorquingPlan) -> tuple[Stage, ...]:
    out, C_np = [], attitude_of(np.asarray(plan.start, float)).T
    for k, step in enumerate(plan.steps):
        rates = zip("xyz", np.degrees(step.rate), strict=True)
        words = ", ".join(f"{axis} {rate:+.6g}°/s" for axis, rate in rates if rate) or "rest"
        act = Act(words, step.time + plan.ramp * (k == len(plan.steps) - 1), C_np, step.rate)
        out.append(Stage(step.label.replace(" deg", "°") or stands(C_np), (act,)))
        C_np = C_np @ exp(step.rate * step.time)
    return tuple(out)


@stages.register
def _(plan: NorthPlan) -> tuple[Stage, ...]:
    out, motion = [], plan.motion
    up_b = np.array([0.0, 0.0, 1.0])
    for number, setup in enumerate(plan.setups):
        pause = plan.pause if number else 0.0
        if isinstance(motion, Stops):
            for k, (index, dwell) in enumerate(zip(motion.index, motion.dwell, strict=True)):
                C_nb = setup.attitude @ exp(-index * up_b)
                told = f"set-up {setup.name}, index {_angle(index)}"
                way = motion.move if k else pause
                out.append(Stage(told, (_rest(float(dwell), C_nb),), way))
        else:
            act = _spin(-motion.rate, motion.length, setup.attitude, up_b)
            out.append(Stage(f"set-up {setup.name}", (act,), pause))
    return tuple(out)


@stages.register
def _(plan: TransferProfile) -> tuple[Stage, ...]:
    motion, spans = motion_of(plan.plan, plan.start)
    edges = np.array([[begin, end] for _, begin, end in spans])
    C_nb = motion.trajectory(np.minimum(edges.ravel(), motion.end)).C_nb.reshape(-1, 2, 3, 3)
    out = []
    for k, segment in enumerate(plan.plan):
        time = float(edges[k, 1] - edges[k, 0])
        silent = " (without the master)" if edges[k, 0] >= plan.hand_over else ""
        turn = log(C_nb[k, 0].T @ C_nb[k, 1])
        out.append(Stage(f"{_kind(segment)}{silent}", (
            Act(_told(segment), time, C_nb[k, 0], np.asarray(turn / time)),
        )))  # fmt: skip
    return tuple(out)


def _kind(segment: Any) -> str:
    return type(segment).__name__.replace("STurn", "S turn")


def _told(segment: Any) -> str:
    """Say how a vehicle does a segment."""
    if isinstance(segment, Sway):
        angles = ", ".join(_angle(a) for a in segment.angles)
        return f"{angles} about right, forward and up, period {lasting(segment.period)}"
    if isinstance(segment, Rotate):
        return f"{_angle(segment.angle)} about {segment.axis} at {_angle(segment.rate)}/s"
    if isinstance(segment, Rest | Straight):
        return "stand still" if isinstance(segment, Rest) else "straight on"
    said = plain_manoeuvre(segment)
    return ", ".join(str(value) for key, value in said.items() if key != "time")


@stages.register
def _(plan: Free) -> tuple[Stage, ...]:
    act = Act(plan.words, plan.time, np.eye(3), STILL)
    return (Stage("by hand", (act,)),)
