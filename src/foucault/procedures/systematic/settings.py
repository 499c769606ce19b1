"""What can be chosen of a systematic calibration, and how a session of one is simulated.

How a campaign describes the log of a systematic calibration.
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from foucault import units
from foucault.coefficients import Layout
from foucault.errors import error
from foucault.logs.description import OWN_LOG, log_head
from foucault.models import imu
from foucault.models.deflection import MODELS, DeflectionModel, deflection_model
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise
from foucault.models.size_effect import LEVER, OFFSET, with_size_effect
from foucault.navigate.inertial_frame import EPOCH, FEWEST
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.sequence import REST, CalibrationSequence, built_in, orientation
from foucault.plans.sequence_file import ActionTable
from foucault.procedures.chosen import Chosen
from foucault.procedures.record import Quadratic, SampleRate, Shortest, checked
from foucault.simulate import hand_rotated
from foucault.simulate.systematic import SystematicSimulation, TableErrors, simulate_systematic
from foucault.strict import Strict
from foucault.tables import Log
from foucault.units import Angle, AngleSd, Force, Length, Rate, Seconds, Velocity

Deflection = Literal[
    "none", "choose", "coupled6", "direct6", "direct6+transverse3", "lateral3+axial6", "direct12",
    "general18", "symmetric6",
]  # fmt: skip
assert get_args(Deflection)[2:] == MODELS
FIRST: Literal["coupled6"] = "coupled6"
"""The model that a choice begins with, and that is simulated for one."""

NAMES = ("gyro.bias", "gyro.scale", "gyro.misalignment", "accel.bias", "accel.scale",
         "accel.misalignment.yx", "accel.misalignment.zx", "accel.misalignment.zy",
         "accel.asymmetry")  # fmt: skip
"""The 24 errors of the instrument that every session estimates."""

USUAL = {
    "gyro.bias": "0.2 deg/h",
    "gyro.scale": "1000 ppm",
    "gyro.misalignment": "10 arcmin",
    "gyro.asymmetry": "100 ppm",
    "deflection": "5 arcsec/g",
    "accel.bias": "1 mg",
    "accel.scale": "1000 ppm",
    "accel.misalignment": "10 arcmin",
    "accel.asymmetry": "100 ppm",
    "accel.quadratic": "50 ug/g^2",
    "accel.lever": "0.1 m",
    "accel.delay": "0.02 s",
}
"""Standard deviations before the session where nothing else is said: zero, give or take these."""

DRAWN = {"accel.asymmetry": 2e-5, "deflection": units.parse("3 arcsec/g", "deflection")}
"""Standard deviations of what is drawn for a simulation besides the class of the instrument [SI].
"""

SIZE_EFFECT: Sizes = {"accel.lever": (0.02, "judgement"), "accel.delay": (1e-3, "judgement")}
"""How far accelerometers are from one point [m], and how late after the gyros [s], 1 sd, where that
is not estimated."""

AS_PARAMETERS = Layout(
    tuple(
        {c.name: c for name in MODELS for c in deflection_model(name).layout.coefficients}.values()
    )
)
"""Parameters of all models of deflection."""

LAYOUT = Layout(
    (
        *imu.LAYOUT.coefficients, *AS_PARAMETERS.coefficients, *LEVER.coefficients,
        *OFFSET.coefficients,
    )
)  # fmt: skip
"""What a campaign may name in [prior]."""

PRIOR = {
    group: (0.0, units.parse(sd, LAYOUT.coefficients[LAYOUT.group(group)[0]].kind))
    for group, sd in USUAL.items()
}
"""`USUAL` as mean and standard deviation [SI]."""

PRIOR_LINES = """\
# What is known beforehand of a coefficient, or of every coefficient of a group. Left out, all are
# zero, give or take: gyros 0.2 deg/h, 1000 ppm, 10 arcmin; accelerometers 1 mg, 1000 ppm,
# 10 arcmin, asymmetry 100 ppm, quadratic 50 ug/g^2; deflection 5 arcsec/g, lever arms 10 cm,
# delay 20 ms.
# [prior]
# "gyro.bias" = { mean = "0 deg/h", sd = "1 deg/h" }
# "deflection" = { mean = "0 arcsec/g", sd = "2 arcsec/g" }
"""
"""[prior] of the template."""

GRADE = "navigation"  # Class of [simulate]: the method is one for instruments that find north.


FIRST_REST = FEWEST * EPOCH
"""Of the first rest so much is needed, for the attitude at the start is found in it [s]."""

ENDS = 0.5  # A rest that is planned is found shorter by less than this [s].


class Settings(Chosen):
    """What can be chosen; the defaults suit an instrument on a table in a laboratory."""

    sequence: Annotated[tuple[str, ...], checked(lambda names: [*map(built_in, names)])] = Field(
        default=("19 positions",), examples=[("19 positions", "spins, simple 6")]
    )
    """Built-in sequences that were done, in order; the log is compared with them. An empty list
    takes the rests as the log has them."""
    start: tuple[str, str, str] = ("east", "north", "up")
    """Where x, y and z pointed at first in a sequence of your own."""
    actions: tuple[ActionTable, ...] = ()
    """A sequence of your own in place of built-in ones: a list of { rest = "150 s" }, { turn = "90
    deg", about = "y" }, { spin = 10, about = "north", rate = "18 deg/s" }."""
    deflection: Deflection = Field(
        default="none",
        description="How the input axes of dithered gyros bend under specific force: "
        f"none, {', '.join(MODELS)}; choose: whether they do and which of these it is, by "
        "likelihood. It takes spins to see it.",
    )
    chirality: Literal[-1, 1] = -1
    """Sense of the spokes of the dither wheel, where the model has one; choose tries both."""
    accel_quadratic: Quadratic = False
    accel_asymmetry: bool = True
    """Estimate the accelerometers' scale factor asymmetry: a scale factor for each sign, which at
    right angles alone looks like a quadratic term."""
    gyro_asymmetry: bool = False
    """Estimate the gyros' scale factor asymmetry too."""
    lever_arms: bool = False
    """Estimate where the x and y accelerometer sit, from the z accelerometer."""
    delay: bool = False
    """Estimate how much later the accelerometers read than the gyros."""
    steps: Literal["joint", "published"] = "joint"
    """joint: all states from the beginning; published: those of the deflection only after the first
    part, whose result starts the second with the published uncertainties."""
    passes: int = Field(default=6, ge=1, le=20)
    """Most passes through the session, each linear about the result before; 1: the first alone,
    which a wide prior spoils."""
    velocity_sd: Velocity = Field(default=1e-4, gt=0, le=100)
    """How still the instrument stands at rest, each component."""
    position_sd: Length = Field(default=1e-2, gt=0, le=1e4)
    """How near the same place it comes to rest after every turn."""
    turning_sd: Velocity | None = Field(default=None, gt=0, le=100, examples=["2 mm/s"])
    """How still it stays while it turns about itself, each component: velocity is measured in turns
    too. Left out: at rest alone."""
    interval: Seconds = Field(default=1.0, gt=0)
    """Time between updates."""
    decorrelate: bool | None = Field(default=None, examples=[True])
    """Start every rest anew with velocity and position, so that what the lever arms of the
    accelerometers do in turns is not taken for errors of the gyros. Left out: unless the lever arms
    are estimated."""
    gyro_bias_repeatability: Rate = Field(
        default=units.parse("0.01 deg/h", "angular rate"),
        ge=units.parse("0.00001 deg/h", "angular rate"),
    )
    """Of several recordings: sd of what the gyro biases differ by from one to the next, such as
    from switch-on to switch-on."""
    accel_bias_repeatability: Force = Field(
        default=units.parse("50 ug", "specific force"), ge=units.parse("0.01 ug", "specific force")
    )
    """The same of the accelerometers."""
    shortest: Shortest = 5.0
    rate_limit: Rate | None = Field(default=None, gt=0, examples=["90 deg/s"])
    """Highest rate of the table."""
    angle_step: Angle | None = Field(default=None, gt=0, le=float(np.pi), examples=["45 deg"])
    """Angles at which the instrument can be put are multiples of this (90 deg: never slanting);
    left out, any."""

    @model_validator(mode="after")
    def _possible(self) -> Settings:
        if self.steps == "published" and self.deflection == "none":
            raise error("systematic.published")
        if self.lever_arms and self.decorrelate:
            raise error("systematic.levers_forgotten")
        return self

    @property
    def optional(self) -> dict[str, tuple[str, ...]]:
        """What may still be taken into the estimate."""
        kept = bool(self.decorrelate)  # no lever arms where rests start anew
        return {k: g for k, g in super().optional.items() if not (kept and k == "lever_arms")}

    @property
    def plan(self) -> CalibrationSequence | None:
        """The sequence that was to be done, None where it is not said."""
        if self.actions:
            actions = tuple(table.action() for table in self.actions)
            return CalibrationSequence("own sequence", orientation(self.start), actions)
        if not self.sequence:
            return None
        return reduce(CalibrationSequence.then, [built_in(name) for name in self.sequence])

    def plans(self, recordings: int) -> list[CalibrationSequence | None]:
        """Return the sequence that was to be done in each recording.

        `recordings`: their number [1].
        """
        if recordings == 1:
            return [self.plan]
        if self.steps == "published":
            raise error("systematic.recordings_published", count=recordings)
        if self.actions or len(self.sequence) not in (0, recordings):
            told = f"{len(self.sequence)} in `sequence`"
            raise error("systematic.recordings_sequence", count=recordings,
                        given="actions" if self.actions else told)  # fmt: skip
        return [built_in(name) for name in self.sequence] or [None] * recordings

    @property
    def turn_on(self) -> dict[str, float]:
        """By how much biases differ from recording to recording: sd of each triad [SI]."""
        return {"gyro": self.gyro_bias_repeatability, "accel": self.accel_bias_repeatability}

    @property
    def model(self) -> DeflectionModel | None:
        """The model of deflection, None for none and for one that is yet to be chosen."""
        if self.deflection in ("none", "choose"):
            return None
        return deflection_model(self.deflection, self.chirality)

    @property
    def drawn(self) -> DeflectionModel | None:
        """The model by which a simulated instrument bends: of a choice, that of the source."""
        if self.deflection == "choose":
            return deflection_model(FIRST, self.chirality)
        return self.model

    @property
    def restarts(self) -> bool:
        """Whether every rest starts anew with velocity and position."""
        return not self.lever_arms if self.decorrelate is None else self.decorrelate

    @property
    def sensors(self) -> Sensors:
        """What is estimated, as terms."""
        sensors = Sensors.of(
            (
                *(name for name in NAMES if self.accel_asymmetry or name != "accel.asymmetry"),
                *(["accel.quadratic"] if self.accel_quadratic else []),
                *(["gyro.asymmetry"] if self.gyro_asymmetry else []),
            )
        )
        if self.model is not None:
            sensors = sensors.with_deflection(self.model)
        return with_size_effect(sensors, lever=self.lever_arms, delay=self.delay)


class Session(Strict):
    """The session that `simulate` makes."""

    rest_time: Seconds | None = Field(default=None, gt=0, examples=["60 s"])
    """Length of every rest; left out, as the sequence has it."""
    rate: SampleRate = 50.0
    angle_sd: AngleSd = Field(default=float(np.radians(1 / 60)), ge=0)
    """Sd of the error of every turn of the table; errors add up."""
    start_sd: AngleSd = Field(default=float(np.radians(0.5)), ge=0)
    """Sd of the attitude at the start from the one of the sequence, each axis."""
    arms: Length = Field(default=0.0, ge=0)
    """Sd of the place of the x and y accelerometer from the z accelerometer."""
    delay: Seconds = 0.0
    """How much later accelerometers read than gyros."""


def draw_errors(grade: str, seed: int) -> ImuModel:
    """Draw the errors of one instrument, the asymmetry of its accelerometers included.

    `seed`: seed [1].
    """
    sd = DRAWN["accel.asymmetry"]
    asymmetry = sd * np.random.default_rng([seed, 11]).standard_normal(3)
    return replace(hand_rotated.draw_errors(grade, seed), accel_asymmetry=asymmetry)


def planned(settings: Settings, session: Session) -> CalibrationSequence:
    """Return the sequence that is to be done, with the rests of the session.

    The attitude at the start is found in a rest, and a turn ends where another begins: a sequence
    that is meant to follow another, such as spins, has a rest put before its first turn, and one
    that ends with a turn has one put after it.

    `session`: length of every rest, if it says one.
    """
    sequence = settings.plan
    if sequence is None:
        raise error("systematic.no_sequence")
    still = Rest(REST, "start"), Rest(REST, "end")
    before = still[:1] if isinstance(sequence.actions[0], Rotate) else ()
    after = still[1:] if isinstance(sequence.actions[-1], Rotate) else ()
    sequence = replace(sequence, actions=(*before, *sequence.actions, *after))
    if session.rest_time is not None:
        sequence = replace(sequence, actions=tuple(
            replace(a, time=session.rest_time) if isinstance(a, Rest) else a
            for a in sequence.actions
        ))  # fmt: skip
    first = sequence.actions[0].time
    if first < FIRST_REST + ENDS:
        raise error("systematic.first_rest", time=f"{first:g}", least=f"{FIRST_REST + ENDS:g}")
    return sequence


def simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> SystematicSimulation:
    """Simulate a session.

    `model`: errors of the instrument, where they have no deflection it is drawn, if there is a
    model; `seed`: seed of deflection, table and noise [1].
    """
    sequence = planned(settings, session)
    rng = np.random.default_rng([seed, 12])
    if settings.drawn is not None and not model.deflection.any():
        theta = DRAWN["deflection"] * rng.standard_normal(len(settings.drawn))
        model = replace(model, deflection=settings.drawn.tensor(theta))
    arms = np.zeros((3, 3))
    arms[:2] = session.arms * rng.standard_normal((2, 3))
    east, north, up = (session.start_sd * rng.standard_normal(3)).tolist()
    return simulate_systematic(
        sequence, site=site, model=model, noise=noise, rate=session.rate,
        table=TableErrors(session.angle_sd, (east, north, up)), arms=arms, delay=session.delay,
        seed=seed,
    )  # fmt: skip


def drawn(
    session: Session, settings: Settings, model: ImuModel, rng: np.random.Generator
) -> tuple[Session, Settings, ImuModel]:
    """Draw what else is not estimated, at its size: lever arms and delay of the accelerometers."""
    (arms, _), (delay, _) = SIZE_EFFECT.values()
    late = delay * float(rng.standard_normal())
    update = {} if session.arms or settings.lever_arms else {"arms": arms}
    update |= {} if session.delay or settings.delay else {"delay": late}
    return session.model_copy(update=update), settings, model


LOG_TABLE = log_head() + Path(__file__).with_name("log.toml").read_text(encoding="utf-8")
"""[log] of the template."""


def log_table(log: Log | None = None) -> str:
    """Write the table [log] of the template, or for a simulated `log` [SI]."""
    return LOG_TABLE if log is None else OWN_LOG
