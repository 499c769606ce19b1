"""What a better motion before the hand-over may do, and the space in which it is sought."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.plans.transfer.moves import Flyable
from foucault.plans.transfer.profiles import TransferProfile
from foucault.plans.transfer.search import POSITION, TransferSpace
from foucault.plans.weights import weights_of
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment.foresight import Foreseen, foreseen
from foucault.procedures.transfer_alignment.session import Session, moved
from foucault.procedures.transfer_alignment.settings import Settings
from foucault.strict import Strict
from foucault.units import Quantity

EVALUATIONS = 200
"""Plans that a restart judges: each is a run of the filter [1]."""

RATE, MESSAGES = 10.0, 2.0
"""Samples and messages in a second that a search reckons with [Hz]."""

ELSEWHERE = np.radians(60.0)

HERE = "the site"
OTHERS = ("turned by 90 deg", "latitude 60 deg")
"""Where a plan found is compared, and what else is changed there."""

FASTER = 0.2
"""Part of the speed at the start by which it may be left, where nothing is said [1]."""


class Wanted(Strict):
    """What a better motion may do."""

    aim: Literal["coefficients", "position"] = "coefficients"
    """What is to be known best: coefficients, or the position after the outage."""
    total: Annotated[float, Quantity("time")] | None = Field(default=None, gt=0, examples=["4 min"])
    """Time until the hand-over; left out, that of the motion to beat."""
    most: int = Field(default=8, ge=1, le=40)
    """Most manoeuvres, straight runs among them."""
    shortest: Annotated[float, Quantity("time")] = Field(default=8.0, ge=1)
    """Shortest manoeuvre."""
    slowest: Annotated[float, Quantity("velocity")] | None = Field(
        default=None, gt=0, examples=["40 m/s"]
    )
    """Lowest speed; left out, a fifth below that at the start."""
    fastest: Annotated[float, Quantity("velocity")] | None = Field(
        default=None, gt=0, examples=["55 m/s"]
    )
    """Highest speed; left out, a fifth above that at the start."""
    bank: Annotated[float, Quantity("angle")] = Field(default=float(np.radians(45.0)), gt=0, lt=1.4)
    """Largest angle of bank; of a flat turn, of the force that is felt sideways."""
    acceleration: Annotated[float, Quantity("specific force")] = Field(default=0.15 * 9.80665, gt=0)
    """Largest acceleration along the path."""
    climb: Annotated[float, Quantity("angle")] = Field(default=float(np.radians(8.0)), ge=0, lt=1.4)
    """Largest angle of climb; 0 for a vehicle that does not."""
    height: Annotated[float, Quantity("length")] = Field(default=100.0, ge=0)
    """How far above and below the start it may go."""
    flat: bool = False
    """Whether it turns without rolling, as ships do."""
    weights: dict[str, float] = Field(default={}, examples=[{"gyro.bias": 3.0, "accel": 0.0}])
    """How much coefficients or groups of them count; 1 if left out."""


@dataclass
class Stated:
    """What a calibration on a motion would state."""

    known: Beforehand[Settings, Session]
    # (p,) what was stated before [SI]
    _kept: dict[str, FloatArray] = field(default_factory=dict, repr=False)

    def __call__(self, motion: TransferProfile, case: str) -> FloatArray:
        """Return the sd of every coefficient and of the position, shape (p,) [SI]."""
        key = f"{case} {motion.calibration}"
        if key not in self._kept:
            if case == OTHERS[0]:
                start = replace(motion.start, heading=motion.start.heading + np.pi / 2)
                motion = replace(motion, start=start)
            elif case == OTHERS[1]:
                motion = replace(motion, start=replace(motion.start, latitude=ELSEWHERE))
            self._kept[key] = _all(foreseen(motion, self.known))
        return self._kept[key]

    def quick(self, motion: TransferProfile) -> FloatArray:
        """Return the same by fewer messages, each as good as those that it stands for."""
        settings, session = self.known.settings, self.known.session
        few = session.message_rate / MESSAGES
        settings = settings.model_copy(update={
            "velocity_sd": settings.velocity_sd / np.sqrt(few),
            "attitude_sd": settings.attitude_sd / np.sqrt(few),
        })  # fmt: skip
        session = session.model_copy(update={"message_rate": MESSAGES})
        return _all(foreseen(motion, replace(self.known, settings=settings, session=session),
                             rate=RATE))  # fmt: skip


def _all(found: Foreseen) -> FloatArray:
    return np.append(found.vector.sd, found.position)


def space(b: Beforehand[Settings, Session]) -> TransferSpace:
    """Return the motions that are allowed; the one to beat is the campaign's."""
    wanted = b.wanted
    reference = moved(replace(b.session.motion, outage=()), b.site)
    stated = Stated(b)
    vector = foreseen(reference, b).vector
    weights = weights_of(vector.layout, wanted.weights)
    aims = wanted.aim == "position"
    return TransferSpace(
        allowed=_allowed(wanted, reference),
        names=(*vector.names, POSITION),
        kinds=(*(c.kind for c in vector.layout.coefficients), "length"),
        weights=np.append(0.0 * weights if aims else weights, float(aims)),
        prior_sd=np.append(vector.prior_sd, np.inf),
        reference=reference,
        cases=(HERE, *OTHERS),
        quick=stated.quick,
        stated=stated,
    )


def _allowed(wanted: Wanted, reference: TransferProfile) -> Flyable:
    begun, total = float(reference.start.speed), wanted.total or reference.hand_over
    out = Flyable(
        start=replace(reference, calibration=()),
        total=int(total),
        most=wanted.most,
        shortest=int(np.ceil(wanted.shortest)),
        slowest=(1.0 - FASTER) * begun if wanted.slowest is None else wanted.slowest,
        fastest=(1.0 + FASTER) * begun if wanted.fastest is None else wanted.fastest,
        bank=wanted.bank,
        acceleration=wanted.acceleration,
        climb=wanted.climb,
        height=wanted.height,
        flat=wanted.flat,
    )
    if not out.slowest <= begun <= out.fastest:
        raise error("transfer_plan.speed", given=f"{begun:g}", slowest=f"{out.slowest:g}",
                    fastest=f"{out.fastest:g}")  # fmt: skip
    if out.total < (out.most + 1) * out.shortest:
        raise error("transfer_plan.short", total=out.total, most=out.most, shortest=out.shortest)
    return out
