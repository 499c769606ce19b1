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
"""

from __future__ import annotations

import tomllib
from math import isclose, pi
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from foucault.errors import FoucaultError, error, suggestion
from foucault.files import parse_toml, read_text
from foucault.plans.manoeuvres import TABLE_AXES, Rest, Rotate
from foucault.plans.systematic.built_in import gimbal_sequence
from foucault.plans.systematic.sequence import (
    RAMP,
    RATE,
    REST,
    Action,
    CalibrationSequence,
    orientation,
)
from foucault.units import Angle, Quantity

_KINDS = ("rest", "turn", "spin")


class ActionTable(BaseModel):
    """One [[action]]: a rest, a turn or a spin."""

    model_config = ConfigDict(extra="forbid")

    rest: Annotated[float, Field(gt=0), Quantity("time")] | None = Field(
        None, description="stand still for so long"
    )
    turn: Annotated[float, Quantity("angle")] | None = Field(
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
