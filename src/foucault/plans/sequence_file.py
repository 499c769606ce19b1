"""A user's sequence of a systematic calibration as a TOML file.

::

    name = "four positions and a spin"
    start = ["up", "east", "north"]       # where x, y and z of the body point at first

    [[action]]
    rest = "150 s"
    [[action]]
    turn = "90 deg"                       # counter-clockwise about the axis
    about = "y"                           # x y z of the body, or east north up
    rate = "10 deg/s"
    [[action]]
    spin = 10                             # turns
    about = "north"
    rate = "18 deg/s"

or, in place of the actions, rests at angles of a two-axis gimbal::

    [gimbal]
    angles = [["0 deg", "0 deg"], ["90 deg", "0 deg"], ["90 deg", "180 deg"]]   # outer, inner
    rest = "150 s"

For the one who turns the table a sequence is written as rows, one per action: when it begins, what
it is, about which axis, by how much and how fast, and where x, y and z point afterwards.
"""

from __future__ import annotations

import csv
import io
import tomllib
from math import isclose, pi
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from foucault.errors import FoucaultError, error, suggestion
from foucault.escape import csv_cell, toml_text
from foucault.files import atomic, keep_others, parse_toml, read_text
from foucault.plans.manoeuvres import TABLE_AXES, Rest, Rotate
from foucault.plans.sequence import (
    DIRECTIONS,
    RAMP,
    RATE,
    REST,
    Action,
    CalibrationSequence,
    gimbal_sequence,
    orientation,
    pointing,
)
from foucault.units import Angle, Quantity

_KINDS = ("rest", "turn", "spin")


class ActionTable(BaseModel):
    """One [[action]]: a rest, a turn or a spin."""

    model_config = ConfigDict(extra="forbid")

    rest: Annotated[float, Field(gt=0), Quantity("time")] | None = Field(
        None, description="stand still for so long"
    )
    turn: Angle | None = Field(
        None, description="turn by this angle, counter-clockwise about the axis"
    )
    spin: float | None = Field(None, description="so many turns about the axis")
    about: str | None = Field(
        None, description="x, y or z of the body, or east, north or up; a spin needs a level one"
    )
    rate: Annotated[float, Field(gt=0), Quantity("angular rate")] = Field(
        RATE, description="largest rate"
    )
    ramp: Annotated[float, Field(gt=0), Quantity("time")] = Field(
        RAMP, description="growth of the rate, and its fading"
    )
    label: str = Field("", description="name in figures and messages")

    @model_validator(mode="after")
    def _one_thing(self) -> ActionTable:
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            what = " and ".join(given) or "none of them"
            raise ValueError(f"it has to have one of rest, turn and spin, and has {what}")
        (kind,) = given
        beside = ", ".join(sorted(filter(self._said, self.model_fields_set - {"rest", "label"})))
        if kind == "rest" and beside:
            raise ValueError(f"a rest has a time and a label, not {beside}")
        axes = TABLE_AXES[3:] if kind == "spin" else TABLE_AXES
        if kind != "rest" and self.about not in axes:
            hint = suggestion(str(self.about), axes)
            raise ValueError(f"a {kind} needs `about`, one of {', '.join(axes)}.{hint}")
        return self

    def _said(self, key: str) -> bool:
        """Return whether a key has another value than its default, which a saved file holds."""
        value, default = getattr(self, key), type(self).model_fields[key].default
        if isinstance(default, float) and isinstance(value, float):
            return not isclose(value, default, rel_tol=1e-9)
        return bool(value != default)

    def action(self) -> Action:
        """Return what it says."""
        if self.rest is not None:
            return Rest(self.rest, self.label)
        angle = self.turn if self.turn is not None else 2 * pi * (self.spin or 0.0)
        return Rotate(str(self.about), angle, self.rate, self.ramp, self.label)


class GimbalTable(BaseModel):
    """[gimbal]: rests at pairs of angles, the inner axis turned before the outer one."""

    model_config = ConfigDict(extra="forbid")

    angles: list[tuple[Angle, Angle]] = Field(
        min_length=2, description="outer angle about East and inner angle about z of each rest"
    )
    rest: Annotated[float, Field(gt=0), Quantity("time")] = Field(
        REST, description="length of each rest"
    )
    rate: Annotated[float, Field(gt=0), Quantity("angular rate")] = Field(
        RATE, description="largest rate of a move"
    )
    ramp: Annotated[float, Field(gt=0), Quantity("time")] = Field(
        RAMP, description="growth of the rate, and its fading"
    )


class SequenceTable(BaseModel):
    """A sequence: its name, how it starts, and its actions in order or its gimbal angles."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field("own sequence", description="name of the sequence")
    start: tuple[str, str, str] = Field(
        ("east", "north", "up"),
        description="where x, y and z of the body point at first; with both gimbal angles zero",
    )
    action: list[ActionTable] = Field(
        default_factory=list, description="rests, turns and spins in order"
    )
    gimbal: GimbalTable | None = Field(None, description="gimbal angles instead of actions")

    @model_validator(mode="after")
    def _one_way(self) -> SequenceTable:
        if bool(self.action) == (self.gimbal is not None):
            raise ValueError("it has to have either [[action]] tables or [gimbal]")
        return self

    def sequence(self) -> CalibrationSequence:
        """Return the sequence it describes."""
        start = orientation(self.start)
        if self.gimbal is not None:
            table = self.gimbal
            return gimbal_sequence(
                np.array(table.angles), name=self.name, start=start, rest=table.rest,
                rate=table.rate, ramp=table.ramp,
            )  # fmt: skip
        actions = tuple(table.action() for table in self.action)
        return CalibrationSequence(self.name, start, actions)


def read_sequence(path: str | Path) -> CalibrationSequence:
    """Read a sequence from a TOML file.

    Raises ``sequence.file``, ``sequence.entry`` or ``sequence.directions``.
    """
    try:
        text = read_text(path)
    except OSError as problem:
        raise error("sequence.file", path=path, why=problem.strerror) from None
    return parse_sequence(text, path)


def parse_sequence(text: str, path: str | Path = "sequence.toml") -> CalibrationSequence:
    """Read a sequence from `text`; `path` is where it would lie."""
    try:
        raw = parse_toml(text)
    except tomllib.TOMLDecodeError as problem:
        raise error("sequence.file", path=path, why=str(problem)) from None
    try:
        return SequenceTable.model_validate(raw, context={"locate": True}).sequence()
    except ValidationError as problem:
        raise _first(problem, path) from None


def _first(problem: ValidationError, path: str | Path) -> FoucaultError:
    details = sorted(problem.errors(), key=lambda d: d["type"] != "extra_forbidden")
    first = details[0]
    loc = [part for part in first["loc"] if not str(part).startswith("function-")]
    place = "".join(
        f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in loc
    ).lstrip(".")
    cause = first.get("ctx", {}).get("error")
    inner = cause.args[0] if cause is not None and cause.args else None
    why = inner.message if isinstance(inner, FoucaultError) else first["msg"]
    if first["type"] == "extra_forbidden":
        inside: dict[str, type[BaseModel]] = {"action": ActionTable, "gimbal": GimbalTable}
        model = inside[str(loc[0])] if len(loc) > 1 else SequenceTable
        keys = list(model.model_fields)
        why = f"no such key{suggestion(str(loc[-1]), keys)}; there are {', '.join(keys)}"
    why = why.removeprefix("Value error, ").rstrip(".")
    return error("sequence.entry", path=path, place=place or "the file", why=why)


HEADINGS = (
    "start (s)", "action", "about", "angle (deg)", "rate (deg/s)", "end (s)", "x to", "y to",
    "z to", "label",
)  # fmt: skip
"""First row of the table."""

WHOLE = 1e-9  # Turns that are so near to whole ones are whole [1].


def turns_of(turn: Rotate) -> int:
    """Return the whole turns about a level axis that a turn makes; 0 where it is no spin."""
    turns = turn.angle / (2 * np.pi)
    level = turn.axis in ("east", "north", "up")
    return round(turns) if level and abs(turns - round(turns)) < WHOLE else 0


def rows(sequence: CalibrationSequence) -> tuple[tuple[str, ...], ...]:
    """Return the sequence as a table for people, the headings first."""
    out = [HEADINGS]
    for k, action in enumerate(sequence.actions):
        begin, end = (f"{t:.1f}" for t in sequence.times[k : k + 2])
        points = pointing(sequence.attitudes[k + 1])
        out.append((begin, *_done(action), end, *points, action.label))
    return tuple(out)


def _done(action: Action) -> tuple[str, str, str, str]:
    if isinstance(action, Rest):
        return "rest", "", "", ""
    what = "spin" if turns_of(action) else "turn"
    angle, rate = (f"{np.degrees(v):z.10g}" for v in (action.angle, action.rate))
    return what, action.axis, angle, rate


def plain_action(action: Action) -> dict[str, Any]:
    """Return an action as sequence files have it; see `ActionTable`."""
    if isinstance(action, Rest):
        return {"rest": f"{action.time:.12g} s"} | ({"label": action.label} if action.label else {})
    turns = turns_of(action)
    angle = {"spin": turns} if turns else {"turn": f"{np.degrees(action.angle):z.12g} deg"}
    out = {**angle, "about": action.axis, "rate": f"{np.degrees(action.rate):.12g} deg/s"}
    if abs(action.ramp - RAMP) > WHOLE:
        out["ramp"] = f"{action.ramp:.12g} s"
    return out | ({"label": action.label} if turns and action.label else {})


def plain_start(sequence: CalibrationSequence) -> tuple[str, ...]:
    """Return where x, y and z point at first, in words.

    `sequence`: rests, turns and spins, its start has to be along east, north and up. Raises
    ``sequence.slanting``.
    """
    out = []
    for column in sequence.start.T:
        k = int(np.abs(column).argmax())
        if abs(column[k]) < 1 - WHOLE:
            raise error("sequence.slanting", name=sequence.name)
        out.append(DIRECTIONS[k + (3 if column[k] < 0 else 0)])
    return tuple(out)


def write_steps(sequence: CalibrationSequence, path: str | Path) -> None:
    """Write a sequence: a table as CSV, or a file that reads as one where it ends in .toml."""
    path = Path(path)
    keep_others(path, [",".join(HEADINGS).encode(), b"\n[[action]]\n"])
    if path.suffix.lower() == ".toml":
        text = _toml(sequence)
    else:
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows(
            [*row[:-1], csv_cell(row[-1])] for row in rows(sequence)
        )
        text = stream.getvalue()
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _toml(sequence: CalibrationSequence) -> str:
    start = ", ".join(f'"{way}"' for way in plain_start(sequence))
    lines = [f"name = {toml_text(sequence.name)}", f"start = [{start}]"]
    for action in sequence.actions:
        pairs = plain_action(action).items()
        lines += ["", "[[action]]"]
        lines += [f"{k} = {v if isinstance(v, int) else toml_text(v)}" for k, v in pairs]
    return "\n".join([*lines, ""])
