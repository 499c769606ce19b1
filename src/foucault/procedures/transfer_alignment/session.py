"""How a session of transfer alignment is simulated, and what is written of it.

What a planned motion will show of a slave, before it is flown, and what a better one may do.

A slave without errors is navigated beside a master without noise; the covariance of the filter, of
the noise that is expected, is then that of the result, whatever the errors will be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from foucault import logs
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.left_out import foretold
from foucault.diagnose.transfer import HARDLY, unknown
from foucault.diagnose.transfer_motion import unseen
from foucault.errors import error
from foucault.estimate.transfer import after_outage
from foucault.infer import filtered
from foucault.infer.information import Remaining, correlated, largest_shares
from foucault.infer.left_out_states import Group, Posterior, planned
from foucault.logs import master as masters
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.layouts import BESIDE
from foucault.models.noise import ImuNoise, grade
from foucault.models.transfer import MasterTable
from foucault.plans import transfer as plans
from foucault.plans.manoeuvres import Accelerate, ManoeuvreTable, Segment, Straight, STurn, Turn
from foucault.plans.optimise import weights_of
from foucault.procedures.left_out import declared_states
from foucault.procedures.record import Beforehand, SampleRate, Stated
from foucault.procedures.transfer_alignment.problem import (
    TransferProblem,
    assumed_noise,
    problem_of,
)
from foucault.procedures.transfer_alignment.settings import (
    LEFT_OUT,
    NOISE,
    Settings,
    SlaveLog,
    sized,
)
from foucault.simulate import transfer as simulation
from foucault.strict import Strict
from foucault.tables import Log
from foucault.units import Angle, AngleSd, Force, Length, Quantity, Seconds, Velocity

GRADE = "tactical"
"""Class of [simulate]; of this class the turn-on errors are those of the publication."""

TRUTH_TABLE, OUTAGE_LOG, REFERENCE = "truth.csv", "outage.csv", "reference.csv"
"""Where the slave truly was; its log after the hand-over, and what to compare that with: the
truth, but for the height, which is that of the barometer."""

LONGER = 1.0
"""The slave's log goes on for so long after the hand-over, and the outage begins so much before it
[s]."""

ROWS = 10.0  # Rows of the tables of truth in a second [Hz].


class Session(Strict):
    """The session that `simulate` makes."""

    profile: str = "flight"
    """What the vehicle does: flight, survey, straight, uav or ship."""
    manoeuvres: tuple[ManoeuvreTable, ...] = Field(
        default=(), examples=[[{"straight": "20 s"}, {"s_turn": "25 deg", "time": "40 s"}]]
    )
    """Your own, in the place of the profile's until the hand-over: straight, turn, s_turn,
    accelerate, climb or sway."""
    heading: Angle | None = Field(default=None, examples=["40 deg"])
    """Heading at the start; left out, that of the profile."""
    speed: Velocity | None = Field(default=None, ge=0, examples=["40 m/s"])
    """Speed at the start; left out, that of the profile."""
    rate: SampleRate = 200.0
    message_rate: Annotated[float, Quantity("frequency")] = Field(default=10.0, gt=0)
    """Messages of the master in a second."""
    message_delay: Seconds = Field(default=0.1, ge=0)
    """How late they arrive."""
    jitter: Seconds = Field(default=0.0, ge=0)
    """Sd of that."""
    lost: float = Field(default=0.0, ge=0, lt=1)
    """Part of the messages that is lost."""
    repeated: float = Field(default=0.0, ge=0, le=1)
    """Part of the messages that comes twice."""
    stamped: Literal["arrival", "validity", "both"] = "arrival"
    """What the stamps are."""
    clock_drift: float = Field(default=0.0, gt=-1e-3, lt=1e-3)
    """Part by which the master's clock is fast."""
    master_velocity_sd: Velocity = Field(default=0.05, ge=0, le=100)
    """Noise of the master's velocity, each component."""
    master_attitude_sd: AngleSd = Field(default=float(np.radians(1 / 60)), ge=0)
    """Noise of its heading, pitch and roll."""
    installation_sd: AngleSd = Field(default=simulation.INSTALLATION, ge=0)
    """Sd of the installation about each axis."""
    compliance_sd: AngleSd = Field(default=0.0, ge=0)
    """Sd of the compliance of the mount, per g, about each axis."""
    flexure: Angle = Field(default=0.0, ge=0)
    """Sd of a random bending."""
    flexure_memory: Seconds = Field(default=5.0, gt=0)
    """Its correlation time."""
    vibration: Force = Field(default=0.0, ge=0)
    """Vibration, root mean square along each axis."""
    with_outage: bool = True
    """Simulate the outage after the hand-over too."""

    @property
    def motion(self) -> plans.TransferProfile:
        """What the vehicle does."""
        found = plans.transfer_profile(self.profile)
        begun = {"heading": self.heading, "speed": self.speed}
        start = replace(found.start, **{k: v for k, v in begun.items() if v is not None})
        if self.manoeuvres:
            own = tuple(table.segment(k) for k, table in enumerate(self.manoeuvres))
            found = replace(found, name="own manoeuvres", calibration=own)
        return replace(found, start=start, outage=found.outage if self.with_outage else ())


@dataclass(frozen=True)
class TransferSession:
    """A simulated session."""

    made: simulation.TransferSimulation  # everything that was simulated, the outage included [SI]

    @property
    def model(self) -> ImuModel:
        """The errors of the slave."""
        return self.made.slave.model

    @cached_property
    def log(self) -> SlaveLog:
        """What the slave and its master said until the hand-over [SI]."""
        log = self.made.log
        end = int(np.searchsorted(log.time, self.made.hand_over + LONGER, "right"))
        return SlaveLog.of(log[:end], self.made.master)

    @property
    def recorded(self) -> Log:
        """What the slave said, the outage included [SI]."""
        return self.made.log

    def with_recorded(self, log: Log) -> TransferSession:
        """Return it with another such `log` [SI]."""
        return TransferSession(replace(self.made, log=log))

    @cached_property
    def outage(self) -> Log:
        """What the slave said from shortly before the hand-over on [SI]."""
        return self.made.log[self._outage_rows]

    @property
    def _outage_rows(self) -> slice:
        begin = np.searchsorted(self.made.log.time, self.made.hand_over - LONGER)
        return slice(int(begin), None)

    @property
    def beside(self) -> CoefficientVector:
        """How the slave was fixed, and how late its master: true values [SI]."""
        slave = self.made.slave
        return CoefficientVector(BESIDE, np.array([*slave.mu, self.delay, *slave.compliance]))

    @property
    def delay(self) -> float:
        """How late messages truly are, by the clock that they are used by [s]."""
        got = self.made.received
        once = np.diff(got.valid, prepend=-np.inf) > 0
        return float(np.mean((got.table.messages.time - got.valid)[once]))

    def reference(self, rows: slice, height: FloatArray | None = None) -> MasterTable:
        """Return where the slave truly was.

        `height` (n,) or None: what stands for its height at the times of the log [m].
        """
        t = self.made.truth
        up = t.height if height is None else height
        return MasterTable(t.time[rows], t.velocity_n[rows], t.C_nb[rows], None, t.latitude[rows],
                           t.longitude[rows], up[rows])  # fmt: skip

    def truth_json(self) -> dict[str, Any]:
        """Return what was true beside the errors of the sensors, for truth.json."""
        made = self.made
        return {
            "profile": made.profile.name,
            "hand_over": made.hand_over,
            "delay": self.delay,
            "lost": made.received.lost,
            "repeated": made.received.repeated,
            "mounting": made.slave.C_0.tolist(),
            "lever_arm": list(made.slave.lever_m),
            "flexure": 0.0 if made.slave.flexure is None else made.slave.flexure.sd[0],
        }

    def write_beside(self, folder: Path) -> None:
        """Write the truth, and the outage with what it is to be compared with.

        `folder`: gets `TRUTH_TABLE`, and where there is an outage `OUTAGE_LOG` and `REFERENCE`.
        """
        step = max(1, round(self.made.log.rate / ROWS))
        masters.write(self.reference(slice(None, None, step)), folder / TRUTH_TABLE)
        if not self.made.profile.outage:
            return
        rows = self._outage_rows
        logs.write(self.outage, folder / OUTAGE_LOG)
        aided = self.reference(slice(rows.start, None, step), self.made.barometer)
        masters.write(aided, folder / REFERENCE)


def draw_errors(grade_name: str, seed: int) -> ImuModel:
    """Draw what a slave reads wrong this time: biases, and scale factors of the gyros.

    `grade_name`: one of `models.noise.GRADES`, "tactical" is the slave of the publication;
    `seed`: seed [1].
    """
    published = simulation.turn_on_grade().spread
    spread = published if grade_name == GRADE else grade(grade_name).spread
    rng, layout = np.random.default_rng([seed, 21]), LAYOUT
    vector = ImuModel().coefficients()
    for group in published:
        at = layout.group(group)
        vector.values[at] = spread[group] * rng.standard_normal(len(at))
    return ImuModel.from_coefficients(vector)


def drawn(
    session: Session, settings: Settings, model: ImuModel, rng: np.random.Generator
) -> tuple[Session, Settings, ImuModel]:
    """Draw what else is not estimated, at its size: lever arm, mount and clocks."""
    lever = settings.mount.lever_m + settings.lever_arm_sd * rng.standard_normal(3)
    fast = settings.clock_sd * float(rng.standard_normal())
    rigid = not settings.load and settings.matching != "velocity"
    update = {} if session.clock_drift else {"clock_drift": fast}
    update |= {"compliance_sd": settings.load_sd} if rigid and not session.compliance_sd else {}
    arms = tuple(f"{x:.9g} m" for x in lever.tolist())
    return session.model_copy(update=update), settings.model_copy(update={"lever_arm": arms}), model


def simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> TransferSession:
    """Simulate a session.

    `seed`: seed of installation, compliance and noise [1].
    """
    motion = moved(session.motion, site)
    return simulate_motion(motion, session, settings, model, noise, seed, site.anomaly)


def simulate_motion(
    motion: plans.TransferProfile, session: Session, settings: Settings, model: ImuModel,
    noise: ImuNoise, seed: int, gravity_offset: float = 0.0,
) -> TransferSession:  # fmt: skip
    """Simulate a session of any motion.

    `session`: how its messages come, and how the slave is fixed; `seed`: seed of installation,
    compliance and noise [1]; `gravity_offset`: local minus normal gravity [m/s^2].
    """
    mount = settings.mount
    rng = np.random.default_rng([seed, 22])
    mu, give = rng.standard_normal((2, 3))
    bend, shake = session.flexure, session.vibration
    slave = simulation.Slave(
        C_0=mount.C_ms,
        mu=_three(session.installation_sd * mu),
        lever_m=_three(mount.lever_m),
        compliance=_three(session.compliance_sd * give),
        flexure=simulation.Flexure((bend, bend, bend), session.flexure_memory) if bend else None,
        vibration=simulation.Vibration(accel=shake) if shake else None,
        model=model,
        noise=noise,
    )
    link = simulation.Link(
        session.message_rate, session.message_delay, session.jitter, session.lost,
        repeated=session.repeated, stamped=session.stamped, drift=session.clock_drift,
    )  # fmt: skip
    angle = session.master_attitude_sd
    says = simulation.MasterNoise(session.master_velocity_sd, (angle, angle, angle))
    made = simulation.simulate_transfer(
        motion, rate=session.rate, slave=slave, link=link, noise=says, seed=seed,
        gravity_offset=gravity_offset,
    )  # fmt: skip
    return TransferSession(made)


def moved(profile: plans.TransferProfile, site: Site) -> plans.TransferProfile:
    """Return a motion that begins at latitude and height of a site."""
    if site.latitude is None:
        raise error("transfer.place")
    here = replace(profile.start, latitude=site.latitude, height=site.height)
    return replace(profile, start=here)


def _three(x: FloatArray) -> tuple[float, float, float]:
    a, b, c = np.asarray(x, float).tolist()
    return a, b, c


RATE = 50.0  # Samples in a second that a covariance takes [Hz].
TIED = 0.5  # Errors that are less correlated are not named [1].
MOST = 3  # So many combinations are named [1].

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
    posterior: Posterior  # of all states that are constant
    groups: Mapping[str, Group]  # what of them is counted with; empty: nothing else is


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
    # What a motion does not show is a matter of the motion, whatever else may hide it.
    alone = now if not now.groups else foreseen(plan, replace(b, sizes=None), gravity=True)
    vector, shown = now.vector, alone.vector
    assert vector.cov is not None
    assert shown.cov is not None
    # Combinations of the coefficients, their priors as units.
    left, ways = np.linalg.eigh(shown.cov / np.outer(shown.prior_sd, shown.prior_sd))
    left = np.sqrt(np.maximum(left, 0.0))
    words = [Remaining(a, largest_shares(vector.layout, w)).words
             for a, w in zip(left[::-1].tolist(), ways.T[::-1], strict=True)]  # fmt: skip
    lost = int(np.sum(left > HARDLY))
    rho = vector.cov / np.outer(vector.sd, vector.sd)
    judged, bought = None, tuple[Extra, ...]()
    if now.groups:
        judged = planned(now.posterior, now.groups, vector.names)
        bought = declared_states(now.posterior, now.groups, judged, vector.names)
    return Foresight(
        coefficients=vector,
        linearised_at="a slave without errors",
        plan=now.name,
        duration=now.time,
        states=len(vector),
        rank=len(vector) - lost,
        smallest=float(left.min()),
        hardly=alone.hardly,
        unseen=tuple(words[:lost]),
        remaining=tuple(words[lost : lost + MOST]),
        correlated=correlated(vector.names, rho, TIED)[:MOST],
        more=(*bought, *tuple(more)),
        left_out=None if judged is None else foretold(judged),
        findings=(*([] if b.noise else [assumed_noise()]), *unseen(alone.hardly)),
    )


def _at_hand_over(
    plan: plans.TransferProfile, hand_over: float | None
) -> tuple[tuple[Segment, ...], tuple[Segment, ...]]:
    """Return what is flown before a manoeuvre more, and after it: the one it is handed over in."""
    begun, ends = plan.calibration, np.cumsum([s.time for s in plan.calibration])
    if hand_over is None or not len(ends) or hand_over >= ends[-1]:
        return begun, ()
    k = int(np.searchsorted(ends, hand_over))
    return begun[:k], begun[k:]


def _speed_after(plan: plans.TransferProfile, flown: tuple[Segment, ...]) -> float:
    speeds = [s.speed for s in flown if isinstance(s, Accelerate)]
    return float(speeds[-1] if speeds else plan.start.speed)


def problem_on(
    plan: plans.TransferProfile, b: Beforehand[Settings, Session], *, rate: float = RATE
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
    sizes = sized(b.settings, b.sizes, b.noise, plan.hand_over)
    p = problem_of(made.log, b.site, about, b.noise or NOISE, zero, sizes=sizes, match=False)
    return p.with_delay(made.delay)


def foreseen(
    plan: plans.TransferProfile, b: Beforehand[Settings, Session], *, rate: float = RATE,
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
    if gravity and "site.gravity" not in p.model.counted:
        of_gravity = filtered.response(fit, p.model.heavier(p.site.gravity_sd))
        of_gravity = of_gravity[[names.index(name) for name in vector.names]]
        cov = cov + np.outer(of_gravity, of_gravity)
    settings = b.settings
    ahead = np.array([after_outage(fit.system, p.counted.sensors, settings.outage, turn=turn)
                      for turn in AHEAD])  # fmt: skip
    # Where it is is what the master says: of the position at the hand-over nothing is counted.
    # Nor is gravity: what it is taken for wrongly, the bias makes good as long as it is.
    ahead[:, :, 6:9] = 0.0
    squares = np.einsum("tij,jk,tik->t", ahead, fit.run.cov, ahead)
    zero = replace(vector, values=np.zeros(len(vector)), cov=cov)
    return Foreseen(plan.name, plan.hand_over, zero, unknown(states, LEFT_OUT, motion=True),
                    float(np.sqrt(squares.mean())), Posterior(states, p.prior.values, {}),
                    p.groups if p.counted.judged else {})  # fmt: skip


EVALUATIONS = 200  # Plans that a restart judges: each is a run of the filter [1].

QUICK_RATE, MESSAGES = 10.0, 2.0
"""Samples and messages in a second that a search reckons with [Hz]."""

ELSEWHERE = np.radians(60.0)

HERE = "the site"
OTHERS = ("turned by 90 deg", "latitude 60 deg")
"""Where a plan found is compared, and what else is changed there."""

FASTER = 0.2  # Part of the speed at the start by which it may be left, where nothing is said [1].


class Wanted(Strict):
    """What a better motion may do."""

    aim: Literal["coefficients", "position"] = "coefficients"
    """What is to be known best: coefficients, or the position after the outage."""
    total: Seconds | None = Field(default=None, gt=0, examples=["4 min"])
    """Time until the hand-over; left out, that of the motion to beat."""
    most: int = Field(default=8, ge=1, le=40)
    """Most manoeuvres, straight runs among them."""
    shortest: Seconds = Field(default=8.0, ge=1)
    """Shortest manoeuvre."""
    slowest: Velocity | None = Field(default=None, gt=0, examples=["40 m/s"])
    """Lowest speed; left out, a fifth below that at the start."""
    fastest: Velocity | None = Field(default=None, gt=0, examples=["55 m/s"])
    """Highest speed; left out, a fifth above that at the start."""
    bank: Angle = Field(default=float(np.radians(45.0)), gt=0, lt=1.4)
    """Largest angle of bank; of a flat turn, of the force that is felt sideways."""
    acceleration: Force = Field(default=0.15 * 9.80665, gt=0)
    """Largest acceleration along the path."""
    climb: Angle = Field(default=float(np.radians(8.0)), ge=0, lt=1.4)
    """Largest angle of climb; 0 for a vehicle that does not."""
    height: Length = Field(default=100.0, ge=0)
    """How far above and below the start it may go."""
    flat: bool = False
    """Whether it turns without rolling, as ships do."""
    weights: dict[str, float] = Field(default={}, examples=[{"gyro.bias": 3.0, "accel": 0.0}])
    """How much coefficients or groups of them count; 1 if left out."""


def _stated(
    b: Beforehand[Settings, Session], motion: plans.TransferProfile, case: str
) -> FloatArray:
    """Return the sd of every coefficient and of the position, shape (p,) [SI]."""
    if case == OTHERS[0]:
        start = replace(motion.start, heading=motion.start.heading + np.pi / 2)
        motion = replace(motion, start=start)
    elif case == OTHERS[1]:
        motion = replace(motion, start=replace(motion.start, latitude=ELSEWHERE))
    return _all(foreseen(motion, b))


def _quick(b: Beforehand[Settings, Session], motion: plans.TransferProfile) -> FloatArray:
    """Return the same by fewer messages, each as good as those that it stands for."""
    few = b.session.message_rate / MESSAGES
    settings = b.settings.model_copy(update={
        "velocity_sd": b.settings.velocity_sd / np.sqrt(few),
        "attitude_sd": b.settings.attitude_sd / np.sqrt(few),
    })  # fmt: skip
    session = b.session.model_copy(update={"message_rate": MESSAGES})
    return _all(foreseen(motion, replace(b, settings=settings, session=session), rate=QUICK_RATE))


def _all(found: Foreseen) -> FloatArray:
    return np.append(found.vector.sd, found.position)


def space(b: Beforehand[Settings, Session]) -> plans.TransferSpace:
    """Return the motions that are allowed; the one to beat is the campaign's."""
    wanted = b.wanted
    reference = moved(replace(b.session.motion, outage=()), b.site)
    vector = foreseen(reference, b).vector
    weights = weights_of(vector.layout, wanted.weights)
    aims = wanted.aim == "position"
    return plans.TransferSpace(
        allowed=_allowed(wanted, reference),
        names=(*vector.names, plans.POSITION),
        kinds=(*(c.kind for c in vector.layout.coefficients), "length"),
        weights=np.append(0.0 * weights if aims else weights, float(aims)),
        prior_sd=np.append(vector.prior_sd, np.inf),
        reference=reference,
        reference_name=reference.name,
        cases=(HERE, *OTHERS),
        quick=partial(_quick, b),
        alone=partial(_quick, replace(b, sizes=None)),
        stated=Stated(b, _stated),
    )


def _allowed(wanted: Wanted, reference: plans.TransferProfile) -> plans.Flyable:
    begun, total = float(reference.start.speed), wanted.total or reference.hand_over
    out = plans.Flyable(
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
