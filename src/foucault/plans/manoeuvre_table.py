"""Manoeuvres of a vehicle as a campaign file has them, one table each.

::

    manoeuvres = [
      { straight = "20 s" },
      { turn = "90 deg", time = "12 s" },            # positive to the right
      { s_turn = "25 deg", time = "40 s" },
      { accelerate = "85 m/s", time = "15 s" },      # to this speed
      { climb = "50 m", time = "14 s" },             # by this height, and level again
      { sway = ["0.7 deg", "1.5 deg", "5 deg"], period = "9 s", time = "60 s" },
    ]
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from foucault.plans.manoeuvres import Accelerate, Climb, Segment, Straight, STurn, Sway, Turn
from foucault.units import Angle, Quantity

Seconds = Annotated[float, Field(gt=0), Quantity("time")]

KINDS = ("straight", "turn", "s_turn", "accelerate", "climb", "sway")

TONES, FADE = 4, 0.2
"""Sinusoids of a sway in each direction, and the part of it in which it fades in, and out [1]."""


class ManoeuvreTable(BaseModel):
    """One manoeuvre: a straight run, a turn, an S-turn, a change of speed, a climb or a swell."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    straight: Seconds | None = Field(None, description="go straight on for so long")
    turn: Angle | None = Field(None, description="change of heading, positive to the right")
    s_turn: Angle | None = Field(
        None, description="turn so far, by twice as much the other way, and back"
    )
    accelerate: Annotated[float, Field(ge=0), Quantity("velocity")] | None = Field(
        None, description="speed to reach"
    )
    climb: Annotated[float, Quantity("length")] | None = Field(
        None, description="height to climb, down if negative"
    )
    sway: tuple[Angle, Angle, Angle] | None = Field(
        None, description="swell or gusts: amplitudes of heading, pitch and roll"
    )
    time: Seconds | None = Field(None, description="how long it takes")
    period: Seconds | None = Field(None, description="period of a sway")
    flat: bool = Field(False, description="turn without rolling, as ships and cars do")

    @model_validator(mode="after")
    def _one_thing(self) -> ManoeuvreTable:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            what = " and ".join(given) or "none of them"
            raise ValueError(f"it has to have one of {', '.join(KINDS)}, and has {what}")
        (kind,) = given
        if (kind == "straight") == (self.time is not None):
            needs = "says how long by itself" if kind == "straight" else "needs `time`"
            raise ValueError(f"{kind} {needs}")
        if (kind == "sway") != (self.period is not None):
            raise ValueError("`period` goes with a sway, and a sway with a `period`")
        if self.flat and kind not in ("turn", "s_turn"):
            raise ValueError("`flat` goes with turn and s_turn")
        return self

    def segment(self, number: int = 0) -> Segment:
        """Return what it says.

        `number`: place in the plan: two sways are not the same one [1].
        """
        if self.straight is not None:
            return Straight(self.straight)
        assert self.time is not None
        if self.turn is not None:
            return Turn(self.turn, self.time, not self.flat)
        if self.s_turn is not None:
            return STurn(self.s_turn, self.time, not self.flat)
        if self.accelerate is not None:
            return Accelerate(self.accelerate, self.time)
        if self.climb is not None:
            return Climb(self.time, height=self.climb)
        assert self.sway is not None and self.period is not None
        return Sway(self.time, self.period, self.sway, tones=TONES, fade=FADE * self.time,
                    seed=number)  # fmt: skip


def plain_manoeuvre(segment: Segment) -> dict[str, Any]:
    """Return a segment of one of `KINDS` but a sway as a campaign has it."""
    if isinstance(segment, Straight):
        return {"straight": f"{segment.time:.12g} s"}
    lasting = {"time": f"{segment.time:.12g} s"}
    if isinstance(segment, Turn | STurn):
        key = "turn" if isinstance(segment, Turn) else "s_turn"
        flat = {} if segment.banked else {"flat": True}
        return {key: f"{np.degrees(segment.angle):.12g} deg"} | lasting | flat
    if isinstance(segment, Accelerate):
        return {"accelerate": f"{segment.speed:.12g} m/s"} | lasting
    assert isinstance(segment, Climb) and segment.height is not None
    return {"climb": f"{segment.height:.12g} m"} | lasting
