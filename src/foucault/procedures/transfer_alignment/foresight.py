"""What a planned motion will show of a slave, said before it is flown.

A slave without errors is navigated beside a master without noise; the covariance of the filter, of
the noise that is expected, is then that of the result, whatever the errors will be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.information import largest_shares, terms
from foucault.diagnose.transfer.checks import HARDLY
from foucault.diagnose.transfer.findings import WANTED
from foucault.errors import Finding, finding
from foucault.estimate.linear_filter import LinearRun, given, kalman
from foucault.estimate.transfer.outage import after_outage
from foucault.estimate.transfer.system import Free, free_run
from foucault.models.earth import Site
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
class Shown:
    """What one motion shows."""

    name: str
    time: float  # how long it takes [s]
    # coefficients at zero with the covariance that they will have, and sds of the prior [SI]
    vector: CoefficientVector
    seen: FloatArray  # (n,) sds that they would have without what is only counted with [SI]
    # what all errors will make of the horizontal position after the outage of the settings: root
    # mean square over the headings of `AHEAD` [m]
    position: float


def foresee(b: Beforehand[Settings, Session]) -> Foresight:
    """Return what the motion of a session will show, and what a manoeuvre more would."""
    settings, session, site, noise = b.settings, b.session, b.site, b.noise
    plan = moved(replace(session.motion, outage=()), site)
    known = (settings, session, site, noise, b.prior)
    now = shown(plan, *known, gravity=True)
    more = []
    before, after = _at_hand_over(plan, settings.hand_over)
    for name, segments in manoeuvres(_speed_after(plan, before)).items():
        longer = replace(plan, calibration=(*before, *segments, *after))
        later = settings
        if settings.hand_over is not None:
            more_time = sum(segment.time for segment in segments)
            later = settings.model_copy(update={"hand_over": settings.hand_over + more_time})
        then = shown(longer, later, *known[1:], gravity=True)
        more.append(Extra.of(name, then.time - now.time, now.vector.names,
                             then.vector.sd / now.vector.sd))  # fmt: skip
    return _judged(now, tuple(more), [] if noise else [assumed_noise()])


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


def free_of(
    plan: TransferProfile, settings: Settings, session: Session, site: Site,
    noise: ImuNoise | None, prior: Mapping[str, tuple[float, float]], *, rate: float,
) -> tuple[TransferProblem, Free]:  # fmt: skip
    """Return a slave without errors beside a master without noise on a motion.

    `noise` or None: noise of the slave [SI]; `prior`: mean and standard deviation of coefficients
    or groups of coefficients [SI]; `rate`: samples of the slave in a second [Hz].
    """
    quiet = Session(
        rate=rate, message_rate=session.message_rate, message_delay=session.message_delay,
        master_velocity_sd=0.0, master_attitude_sd=0.0, installation_sd=0.0,
    )  # fmt: skip
    made = simulate_motion(plan, quiet, settings, ImuModel(), ImuNoise(), 0)
    about = settings.model_copy(update={"delay_method": "state"})
    zero = {name: (0.0, sd) for name, (_, sd) in prior.items()}
    p = problem_of(made.log, site, about, noise or NOISE, zero, match=False)
    p = p.with_delay(made.delay)
    free = free_run(p.slave, p.master, settings.mount, settings.matched, p.prior, p.prior, p.sd)
    return p, free


def shown(
    plan: TransferProfile, settings: Settings, session: Session, site: Site,
    noise: ImuNoise | None, prior: Mapping[str, tuple[float, float]], *, rate: float = RATE,
    gravity: bool = False,
) -> Shown:  # fmt: skip
    """Return the covariance that a motion leaves.

    `noise` or None: noise of the slave [SI]; `prior`: mean and standard deviation of coefficients
    or groups of coefficients [SI]; `rate`: samples of the slave in a second [Hz]; `gravity`:
    whether what is not known of local gravity counts, no motion makes it less.
    """
    p, free = free_of(plan, settings, session, site, noise, prior, rate=rate)
    run = kalman(free.system)
    names = settings.reported
    cov, at = run.cov, [free.layout.index(name) for name in names]
    aside = [i for i, name in enumerate(free.layout.names) if name.startswith(LEFT_OUT)]
    seen = np.sqrt(np.maximum(np.diag(given(cov, aside))[at], 0.0))
    of_gravity = _of_gravity(p, run)[at] if gravity else np.zeros(len(at))
    own = cov[np.ix_(at, at)] + np.outer(of_gravity, of_gravity)
    vector = replace(p.vector.chosen(names), values=np.zeros(len(at)), cov=own)
    ahead = np.array([after_outage(free, settings.sensors, settings.outage, turn=turn)
                      for turn in AHEAD])  # fmt: skip
    # Where it is is what the master says: of the position at the hand-over nothing is counted.
    # Nor is gravity: what it is taken for wrongly, the bias makes good as long as it is.
    ahead[:, :, 6:9] = 0.0
    squares = np.einsum("tij,jk,tik->t", ahead, cov, ahead)
    return Shown(plan.name, plan.hand_over, vector, seen, float(np.sqrt(squares.mean())))


def _of_gravity(p: TransferProblem, run: LinearRun) -> FloatArray:
    """Return what one standard deviation of local gravity makes of the states, shape (n,)."""
    heavier = replace(p.slave, gravity_offset=p.slave.gravity_offset + p.site.gravity_sd)
    s = p.settings
    other = free_run(heavier, p.master, s.mount, s.matched, p.prior, p.prior, p.sd)
    return np.asarray(kalman(other.system).states[-1] - run.states[-1])


def _judged(now: Shown, more: tuple[Extra, ...], told: list[Finding]) -> Foresight:
    vector = now.vector
    assert vector.cov is not None
    ratio = now.seen / vector.prior_sd
    hardly = tuple(n for n, r in zip(vector.names, ratio, strict=True)
                   if r > HARDLY and not n.startswith(LEFT_OUT))  # fmt: skip
    # Combinations of the coefficients, their priors as units.
    left, ways = np.linalg.eigh(vector.cov / np.outer(vector.prior_sd, vector.prior_sd))
    left = np.sqrt(np.maximum(left, 0.0))
    words = [f"{terms(largest_shares(vector.layout, w))}: known to {a:.2g} of the prior"
             for a, w in zip(left[::-1], ways.T[::-1], strict=True)]  # fmt: skip
    lost = int(np.sum(left > HARDLY))
    if hardly:
        groups = [g for g in WANTED if any(n == g or n.startswith(f"{g}.") for n in hardly)]
        told.append(finding("transfer.unseen", names=", ".join(hardly),
                            wanted="; ".join(WANTED[g] for g in groups)))  # fmt: skip
    return Foresight(
        coefficients=vector,
        linearised_at="a slave without errors",
        plan=now.name,
        duration=now.time,
        states=len(vector),
        rank=len(vector) - lost,
        smallest=float(left.min()),
        hardly=hardly,
        unseen=tuple(words[:lost]),
        remaining=tuple(words[lost : lost + MOST]),
        correlated=_correlated(vector),
        more=more,
        findings=tuple(told),
    )


def _correlated(vector: CoefficientVector) -> tuple[tuple[str, str, float], ...]:
    assert vector.cov is not None
    rho = vector.cov / np.outer(vector.sd, vector.sd)
    first, second = np.triu_indices(len(vector), 1)
    order = np.argsort(-np.abs(rho[first, second]))
    pairs = [(int(first[k]), int(second[k])) for k in order[:MOST]]
    return tuple((vector.names[i], vector.names[j], float(rho[i, j])) for i, j in pairs
                 if abs(rho[i, j]) > TIED)  # fmt: skip
