"""What a planned motion will show of a slave, said before it is flown.

A slave without errors is navigated beside a master without noise; the covariance of the filter, of
the noise that is expected, is then that of the result, whatever the errors will be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.information import Remaining, correlated, largest_shares
from foucault.diagnose.transfer.checks import HARDLY, unknown
from foucault.diagnose.transfer.findings import unseen
from foucault.errors import Finding
from foucault.estimate.transfer.hand_over import after_outage
from foucault.infer import filtered
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.plans.manoeuvres import Accelerate, Segment, Straight, STurn, Turn
from foucault.plans.transfer.profiles import TransferProfile
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment.problem import (
    TransferProblem,
    assumed_noise,
    problem_of,
)
from foucault.procedures.transfer_alignment.session import Session, moved, simulate_motion
from foucault.procedures.transfer_alignment.settings import LEFT_OUT, NOISE, Settings

RATE = 50.0
"""Samples in a second that a covariance takes [Hz]."""

TIED = 0.5
"""Errors that are less correlated are not named [1]."""

MOST = 3
"""So many combinations are named [1]."""

_DEG = np.pi / 180.0

AHEAD = (0.0, 90 * _DEG, 180 * _DEG, 270 * _DEG)
"""Turns with which an outage may begin: straight on, no manoeuvre before it is worth much [rad]."""


def manoeuvres(speed: float) -> dict[str, tuple[Segment, ...]]:
    """Return what may be added to a motion, each half a minute, by name.

    `speed`: speed of the vehicle [m/s].
    """
    return {
        "straight on": (Straight(30.0),),
        "an S-turn of 40 deg": (STurn(40 * _DEG, 30.0),),
        "faster by a fifth and back": (Accelerate(1.2 * speed, 15.0), Accelerate(speed, 15.0)),
        "a turn of 90 deg": (Turn(90 * _DEG, 30.0),),
    }


@dataclass(frozen=True)
class Foreseen:
    """What one motion shows."""

    name: str
    time: float  # how long it takes [s]
    # coefficients at zero with the covariance that they will have, and sds of the prior [SI]
    vector: CoefficientVector
    hardly: tuple[str, ...]  # those that the motion shows hardly anything of
    # what all errors will make of the horizontal position after the outage of the settings: root
    # mean square over the headings of `AHEAD` [m]
    position: float


def foresee(b: Beforehand[Settings, Session]) -> Foresight:
    """Return what the motion of a session will show, and what a manoeuvre more would."""
    plan, hand_over = moved(replace(b.session.motion, outage=()), b.site), b.settings.hand_over
    now, more = foreseen(plan, b, gravity=True), []
    before, after = _at_hand_over(plan, hand_over)
    for name, segments in manoeuvres(_speed_after(plan, before)).items():
        longer, later = replace(plan, calibration=(*before, *segments, *after)), b
        if hand_over is not None:
            end = hand_over + sum(segment.time for segment in segments)
            later = replace(b, settings=b.settings.model_copy(update={"hand_over": end}))
        then = foreseen(longer, later, gravity=True)
        more.append(Extra.of(name, then.time - now.time, now.vector.names,
                             then.vector.sd / now.vector.sd))  # fmt: skip
    return _judged(now, tuple(more), [] if b.noise else [assumed_noise()])


def _at_hand_over(
    plan: TransferProfile, hand_over: float | None
) -> tuple[tuple[Segment, ...], tuple[Segment, ...]]:
    """Return what is flown before a manoeuvre more, and after it: the one it is handed over in."""
    begun, ends = plan.calibration, np.cumsum([s.time for s in plan.calibration])
    if hand_over is None or not len(ends) or hand_over >= ends[-1]:
        return begun, ()
    k = int(np.searchsorted(ends, hand_over))
    return begun[:k], begun[k:]


def _speed_after(plan: TransferProfile, flown: tuple[Segment, ...]) -> float:
    speeds = [s.speed for s in flown if isinstance(s, Accelerate)]
    return float(speeds[-1] if speeds else plan.start.speed)


def problem_on(
    plan: TransferProfile, b: Beforehand[Settings, Session], *, rate: float = RATE
) -> TransferProblem:
    """Return what a slave without errors beside a master without noise shows of a motion.

    `rate`: samples of the slave in a second [Hz].
    """
    session = Session(
        rate=rate, message_rate=b.session.message_rate, message_delay=b.session.message_delay,
        master_velocity_sd=0.0, master_attitude_sd=0.0, installation_sd=0.0,
    )  # fmt: skip
    made = simulate_motion(plan, session, b.settings, ImuModel(), ImuNoise(), 0)
    about = b.settings.model_copy(update={"delay_method": "state"})
    zero = {name: (0.0, sd) for name, (_, sd) in b.prior.items()}
    p = problem_of(made.log, b.site, about, b.noise or NOISE, zero, match=False)
    return p.with_delay(made.delay)


def foreseen(
    plan: TransferProfile, b: Beforehand[Settings, Session], *, rate: float = RATE,
    gravity: bool = False,
) -> Foreseen:  # fmt: skip
    """Return the covariance that a motion leaves.

    `rate`: samples of the slave in a second [Hz]; `gravity`: whether what is not known of local
    gravity counts, no motion makes it less.
    """
    p = problem_on(plan, b, rate=rate)
    fit, names = filtered.foreseen(p.model), p.model.names[p.model.first :]
    states = p.model.estimate(fit, p.prior)
    vector = states.chosen(b.settings.reported)
    cov = vector.cov
    assert cov is not None
    if gravity:
        of_gravity = filtered.response(fit, p.model.heavier(p.site.gravity_sd))
        of_gravity = of_gravity[[names.index(name) for name in vector.names]]
        cov = cov + np.outer(of_gravity, of_gravity)
    settings = b.settings
    ahead = np.array([after_outage(fit.system, settings.sensors, settings.outage, turn=turn)
                      for turn in AHEAD])  # fmt: skip
    # Where it is is what the master says: of the position at the hand-over nothing is counted.
    # Nor is gravity: what it is taken for wrongly, the bias makes good as long as it is.
    ahead[:, :, 6:9] = 0.0
    squares = np.einsum("tij,jk,tik->t", ahead, fit.run.cov, ahead)
    zero = replace(vector, values=np.zeros(len(vector)), cov=cov)
    return Foreseen(plan.name, plan.hand_over, zero, unknown(states, LEFT_OUT, motion=True),
                    float(np.sqrt(squares.mean())))  # fmt: skip


def _judged(now: Foreseen, more: tuple[Extra, ...], told: list[Finding]) -> Foresight:
    vector = now.vector
    assert vector.cov is not None
    # Combinations of the coefficients, their priors as units.
    left, ways = np.linalg.eigh(vector.cov / np.outer(vector.prior_sd, vector.prior_sd))
    left = np.sqrt(np.maximum(left, 0.0))
    words = [Remaining(a, largest_shares(vector.layout, w)).words
             for a, w in zip(left[::-1].tolist(), ways.T[::-1], strict=True)]  # fmt: skip
    lost = int(np.sum(left > HARDLY))
    rho = vector.cov / np.outer(vector.sd, vector.sd)
    return Foresight(
        coefficients=vector,
        linearised_at="a slave without errors",
        plan=now.name,
        duration=now.time,
        states=len(vector),
        rank=len(vector) - lost,
        smallest=float(left.min()),
        hardly=now.hardly,
        unseen=tuple(words[:lost]),
        remaining=tuple(words[lost : lost + MOST]),
        correlated=correlated(vector.names, rho, TIED)[:MOST],
        more=more,
        findings=(*told, *unseen(now.hardly)),
    )
