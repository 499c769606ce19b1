"""What sessions have in common in which a body is turned and moved by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import left_out
from foucault.diagnose.foresight import Foresight
from foucault.errors import finding
from foucault.estimate.two_bodies import UNSURE_DELAY
from foucault.infer.left_out import Judgement
from foucault.models.imu import ImuModel
from foucault.procedures.record import Beforehand, Given, SampleRate
from foucault.strict import Strict
from foucault.units import Seconds


class HandSession(Strict):
    """The motion of a session that is simulated."""

    motion: Literal["all axes", "rotation only", "one axis", "planar", "translation only",
                    "constant rate"] = "all axes"  # fmt: skip
    """What the hand does."""
    time: Seconds = Field(default=60.0, ge=10)
    """For how long."""
    vigour: float = Field(default=1.0, gt=0, le=4)
    """How fast, against 1.9 rad/s."""
    rate: SampleRate = 200.0


MOTION = {
    "lever": "turn about at least two axes, with starts and stops",
    "rotation": "turn about at least two axes, with starts and stops",
    "delay": "start and stop often, and do not swing regularly",
    "gyro.": "turn about all three axes",
    "accel.": "hold it in many attitudes, upside down among them",
    "level": "turn it about level axes too",
}
"""What shows a parameter."""

S = TypeVar("S", bound=Strict)
T = TypeVar("T", bound=HandSession)


@dataclass(frozen=True)
class Found:
    """What a session without errors tells."""

    coefficients: CoefficientVector  # with all of their covariance [SI]
    bound: FloatArray  # (p,) their sd by noise alone [SI]
    budget: dict[str, FloatArray]  # source -> variance (p,) [SI]
    unseen: list[str]  # names of what the motion does not show
    left_out: Judgement | None


def foreseen(
    b: Beforehand[S, T], simulated: Callable[..., Any], found: Callable[[Any, Given[S]], Found]
) -> Foresight:
    """Foresee a session by one that is simulated without errors, and what is `found` in its log."""
    noise = b.noise or b.typical
    assert noise is not None
    made = simulated(b.session, b.settings, ImuModel(), noise, b.site, b.seed)
    at = found(made.log, Given(b.site, b.settings, noise, b.prior, sizes=b.sizes))
    c, lost = at.coefficients, at.unseen
    words = dict.fromkeys(w for n in lost for k, w in MOTION.items() if k in n)
    delays = [n for n in c.names if n.endswith(".delay") and n != "accel.delay"]
    unsure = [n for n in delays if c.chosen([n]).sd[0] > UNSURE_DELAY]
    told = []
    if lost or unsure:
        reason = "; " + "; ".join(words or {MOTION["delay"]: None})
        told.append(finding("preflight.not_shown", names=", ".join(lost or unsure), reason=reason))
    return Foresight(
        coefficients=replace(c, values=np.zeros(len(c))), linearised_at="no errors",
        plan=b.session.motion, duration=b.session.time, states=len(c), rank=len(c) - len(lost),
        hardly=tuple(lost), bound=at.bound, budget=at.budget, findings=tuple(told),
        left_out=None if at.left_out is None else left_out.foretold(at.left_out),
    )  # fmt: skip
