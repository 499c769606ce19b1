"""What can be chosen of a platform tumble, and the session that is simulated.

Errors and noise that are usual of torqued clusters.

The log of a tumble and what its campaign file says: a command in the place of the gyros.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from foucault import logs, units
from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, error
from foucault.logs.description import OWN_LOG, LogDescription, log_head
from foucault.logs.reading import limits_si
from foucault.models.cluster import CONSTANTS, SOURCE_SYMBOLS, ClusterModel
from foucault.models.earth import Site
from foucault.models.left_out import GRAVITY, LATITUDE, Sizes
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans import tumble as torquing
from foucault.plans.tumble import Limits, TorquingPlan
from foucault.procedures.record import checked
from foucault.simulate.tumble import Acquisition, TumbleSimulation, simulate_tumble
from foucault.strict import Strict
from foucault.tables import Log
from foucault.units import Angle, AngleSd, Rate, Seconds

TYPICAL = {
    "gyro.drift": ("1 deg/h", "0.2 deg/h"),
    "gyro.drift_input": ("0.5 deg/h/g", "0.1 deg/h/g"),
    "gyro.drift_output": ("0.5 deg/h/g", "0.1 deg/h/g"),
    "gyro.drift_spin": ("0.5 deg/h/g", "0.1 deg/h/g"),
    "gyro.drift_input_output": ("0.01 deg/h/g^2", "0.005 deg/h/g^2"),
    "gyro.drift_input_spin": ("0.01 deg/h/g^2", "0.005 deg/h/g^2"),
    "gyro.drift_output_spin": ("0.01 deg/h/g^2", "0.005 deg/h/g^2"),
    "gyro.torquer_scale": ("400 ppm", "50 ppm"),
    "gyro.misalignment": ("120 arcsec", "20 arcsec"),
    "accel.bias": ("100 ug", "10 ug"),
    "accel.scale": ("100 ppm", "10 ppm"),
    "accel.misalignment": ("120 arcsec", "20 arcsec"),
    "accel.quadratic": ("100 ug/g^2", "10 ug/g^2"),
}
"""Mean and sd of the errors of clusters, in the signs of `models.cluster.SOURCE_SYMBOLS`."""


def _kind(group: str) -> str:
    kind: str = CONSTANTS.coefficients[CONSTANTS.group(group)[0]].kind
    return kind


PRIOR = {group: (0.0, units.parse(mean, _kind(group))) for group, (mean, _) in TYPICAL.items()}
"""What is known of the errors where nothing else is said: zero, give or take their usual size."""

WHITE = ("0.4472136 ug/sqrt(Hz)", "3.72678e-05 deg/sqrt(h)")
"""White noise of accelerometers and gyros: 1 ug in samples of 0.2 s, and a drift of 0.05 deg/h in
samples of 2 ms."""

NOISE = ImuNoise(
    TriadNoise(white=units.parse(WHITE[0], "velocity random walk")),
    TriadNoise(white=units.parse(WHITE[1], "angle random walk")),
)
"""Noise that is simulated where [noise] says nothing."""

OTHERWISE = ("gyro.g_sensitivity", GRAVITY, LATITUDE)
"""Groups that are among the constants by other names, or sources of their own."""

SIZE_EFFECT: Sizes = {"accel.lever": (0.005, "judgement"), "accel.delay": (1e-3, "judgement")}
"""How far accelerometers are from where they are said to be [m], how late they read [s]; 1 sd."""

Three = tuple[str, str, str]

DEGREE = float(np.radians(1.0))  # One degree [rad].
MINUTE = 60.0  # No reading comes so late, and no cluster takes so long to follow a command [s].
HOUR = 3600.0  # No rig is read, or told what to do, so seldom [s].
GRADE = "navigation"  # Class of [simulate]; the errors of clusters are those of `TYPICAL`.


def _three(given: Three, kind: str, key: str) -> FloatArray:
    return np.array([units.parse(text, kind, key) for text in given])


def _are(kind: str, key: str) -> AfterValidator:
    return checked(lambda given: _three(given, kind, key))


class PlanStep(Strict):
    """One step of a torquing plan."""

    rate: Annotated[Three, _are("angular rate", "rate")] = Field(
        examples=[["-0.1 deg/s", "0 deg/s", "0 deg/s"]]
    )
    """Rate about x, y and z of the cluster, relative to East-North-Up."""
    time: Seconds = Field(gt=0)
    """How long it is held."""


class Settings(Strict):
    """What can be chosen; the defaults suit a cluster that starts level and pointed north."""

    filter: Literal["gauss-newton", "published", "published literal"] = "gauss-newton"
    """gauss-newton: the linearised filter repeated about its own solution; published: one pass with
    annealed noise; published literal: one pass as printed, which diverges."""
    average: Seconds = Field(default=1.0, ge=0)
    """Residuals are averaged over so long; 0 s: every sample."""
    start: Annotated[Three, _are("angle", "start")] = ("0 deg", "0 deg", "0 deg")
    """Outer, middle and inner angle at the first row: all zero where x, y and z of the cluster
    point north, up and east."""
    start_sd: AngleSd = Field(default=5 * DEGREE, gt=0)
    """Sd of that attitude about East and about North."""
    azimuth_sd: AngleSd = Field(default=5 * DEGREE, gt=0)
    """Sd of it about Up."""
    arms: Annotated[
        tuple[Three, Three, Three],
        checked(lambda arms: [_three(arm, "length", "arms") for arm in arms]),
    ] = (("0 m", "0 m", "0 m"),) * 3
    """Position of the x, y and z accelerometer, along x, y and z of the cluster."""
    mask_edges: Seconds = Field(default=0.0, ge=0)
    """Readings so long after a step of the command are left out, for there the angular acceleration
    is not known."""
    command_holds: Literal["auto", "from its time", "until its time"] = "auto"
    """Whether the command of a row begins or ends at the time of the row; auto: it ends there where
    readings are means over the interval before, and begins there if not."""
    delay_sd: Seconds = Field(default=0.0, ge=0, le=MINUTE)
    """Sd of the time by which readings are older than the row says; above 0 it is estimated."""
    latitude_sd: AngleSd = Field(default=1e-3 * DEGREE, ge=0, le=DEGREE)
    """Sd of the latitude in [site]: 0.001 deg are 110 m. A latitude 0.01 deg off moves a drift by 8
    sd, and no residual shows it."""
    plan: str | None = Field(default=None, examples=["-x -z -y +z"])
    """What was commanded: published, or signed axes in equal segments. The log has the command
    itself; a plan is compared with it, and is what `foucault simulate` does (published, if neither
    plan nor steps are given)."""
    rate: Rate | None = Field(default=None, gt=0, examples=["0.1 deg/s"])
    """Rate of that plan; 0.1 deg/s, or less where the rig allows less, if left out."""
    segment: Seconds | None = Field(default=None, gt=0, examples=["900 s"])
    """Time of each segment of a sequence of axes; left out, all take 5400 s."""
    steps: tuple[PlanStep, ...] = ()
    """Instead of `plan`, any rates: a list of { rate = ["-0.1 deg/s", "0 deg/s", "0 deg/s"], time =
    "1800 s" }."""
    ramp: Seconds = Field(default=0.0, ge=0)
    """Time in which each rate of the plan is reached."""
    rate_limit: Rate | None = Field(default=None, gt=0, examples=["0.2 deg/s"])
    """Largest rate about an axis that the rig allows."""
    tilt_limit: Angle | None = Field(default=None, gt=0, examples=["60 deg"])
    """Largest tilt of the cluster from `start` that the rig allows. Preflight judges a plan by it,
    and a search for plans keeps it."""
    middle_limit: Angle | None = Field(default=None, gt=0, examples=["60 deg"])
    """Largest middle angle, either way, that the gimbals allow; likewise."""
    cable_limit: Angle | None = Field(default=None, gt=0, examples=["400 deg"])
    """Largest turn of the outer and of the inner gimbal from `start`, either way, that cables or
    stops allow; likewise."""
    passes: int = Field(default=20, ge=1)
    """Most passes of gauss-newton."""

    @model_validator(mode="after")
    def _one_plan(self) -> Settings:
        if self.plan is not None and self.steps:
            raise error("torquing.contradiction", first="plan", second="steps")
        what = "the plan is a list of steps" if self.steps else "no plan is given"
        for key in ("rate", "segment"):
            if self.plan is None and getattr(self, key) is not None:
                raise error("torquing.unused", key=key, what=what)
        if self.plan in torquing.NAMES and self.segment is not None:
            raise error("torquing.unused", key="segment", what=f"the plan is '{self.plan}'")
        self.torquing  # noqa: B018  # refuses a plan that cannot be
        return self

    @property
    def angles(self) -> FloatArray:
        """Outer, middle and inner angle at the first row, shape (3,) [rad]."""
        return _three(self.start, "angle", "start")

    @property
    def lever_arms(self) -> FloatArray:
        """Position of each accelerometer in a row, shape (3, 3) [m]."""
        return np.array([_three(arm, "length", "arms") for arm in self.arms])

    def held(
        self, sampled: Literal["rate", "increment"]
    ) -> Literal["from its time", "until its time"]:
        """Return how the command of a row holds.

        `sampled`: readings at the time of a row, or means over the interval before it.
        """
        if self.command_holds != "auto":
            return self.command_holds
        return "until its time" if sampled == "increment" else "from its time"

    @property
    def limits(self) -> Limits:
        """What the rig allows."""
        return Limits(self.rate_limit, self.tilt_limit, self.middle_limit, self.cable_limit)

    @property
    def published_rate(self) -> float:
        """Rate of plans that do not say theirs: the published, or what the rig allows [rad/s]."""
        return min(torquing.RATE, self.rate_limit or torquing.RATE)

    @property
    def planned(self) -> TorquingPlan:
        """The plan, or the published one where none is given."""
        published = torquing.published(self.published_rate)
        return self.torquing or torquing.starting(published, self.angles, self.ramp)

    @property
    def torquing(self) -> TorquingPlan | None:
        """The plan from `start`, None where none is given."""
        rate = self.published_rate if self.rate is None else self.rate
        if self.steps:
            rates = [_three(step.rate, "angular rate", "rate") for step in self.steps]
            plan = torquing.from_rates(rates, [step.time for step in self.steps])
        elif self.plan is None:
            return None
        elif self.plan in torquing.NAMES:
            plan = torquing.published(rate)
        else:
            plan = torquing.sequence(self.plan, rate, segment=self.segment)
        if self.rate_limit is not None:
            plan = plan.within(self.rate_limit)
        return torquing.starting(plan, self.angles, self.ramp)


class Session(Strict):
    """The tumble that `simulate` makes."""

    integrator: Literal["exponential", "published"] = "exponential"
    """exponential: one rotation per sample, at any attitude; published: the three angles in steps
    of 2 ms, which must keep away from middle = 90 deg."""
    interval: Seconds = Field(default=0.2, gt=0, le=HOUR)
    """Time between samples."""
    command_interval: Seconds = Field(default=1.0, gt=0, le=HOUR)
    """Time between commands, a multiple of `interval`."""
    kind: Literal["rate", "increment"] = "rate"
    """Readings at the time of a row, or their means over the interval before it."""
    attitude: Annotated[Three, _are("angle", "attitude")] = ("2 deg", "3 deg", "5 deg")
    """By how much outer, middle and inner angle differ from `start`, on average."""
    attitude_sd: AngleSd = Field(default=0.1 * DEGREE, ge=0)
    """Sd of that."""
    delay: Seconds = Field(default=0.0, ge=-MINUTE, le=MINUTE)
    """By how much readings are older than the row says; 0 s: drawn with `delay_sd`."""
    edge: Seconds = Field(default=0.0, ge=0, le=MINUTE)
    """Time in which the cluster follows a step of the command: readings taken then feel the angular
    acceleration."""


def simulated(
    session: Session,
    settings: Settings,
    model: ClusterModel,
    noise: ImuNoise,
    site: Site,
    seed: int,
) -> TumbleSimulation:
    """Simulate a tumble: the plan of the settings, or the published one.

    `noise`: noise of the cluster [SI]; `seed`: seed of attitude, delay and noise [1].
    """
    plan = settings.planned
    rng = np.random.default_rng([seed, 5])
    if site.latitude is not None:  # it is known as well as the calibration will be told
        north = settings.latitude_sd * float(np.random.default_rng([seed, 6]).standard_normal())
        site = replace(site, latitude=site.latitude + north)
    away = _three(session.attitude, "angle", "attitude")
    away += session.attitude_sd * rng.standard_normal(3)
    delay = session.delay or settings.delay_sd * float(rng.standard_normal())
    how = Acquisition(
        session.interval, session.command_interval, session.kind, settings.held(session.kind),
        delay, session.edge, settings.lever_arms,
    )  # fmt: skip
    return simulate_tumble(
        plan, model=model, noise=noise, site=site, start=plan.start + away, acquisition=how,
        integrator=session.integrator, seed=seed,
    )  # fmt: skip


def drawn(
    session: Session, settings: Settings, model: ClusterModel, rng: np.random.Generator
) -> tuple[Session, Settings, ClusterModel]:
    """Draw what else is not estimated, at its size: places and delay of the accelerometers."""
    (arm, _), (delay, _) = SIZE_EFFECT.values()
    away = settings.lever_arms + arm * rng.standard_normal((3, 3))
    arms = tuple(tuple(f"{x:.9g} m" for x in row) for row in away.tolist())
    late = delay * float(rng.standard_normal())
    if not (session.delay or settings.delay_sd):
        session = session.model_copy(update={"delay": late})
    return session, settings.model_copy(update={"arms": arms}), model


def draw_errors(grade: str, seed: int) -> ClusterModel:
    """Draw the errors of one cluster: about zero, of their usual size, as the prior believes.

    `seed`: seed [1].
    """
    if grade != GRADE:
        raise error("torquing.grade", given=grade, allowed=GRADE)
    drawn = np.random.default_rng(seed).standard_normal(len(CONSTANTS))
    sd = CoefficientVector.prior(CONSTANTS, PRIOR).prior_sd
    return ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, sd * drawn))


def draw_printed(seed: int) -> ClusterModel:
    """Draw the errors of one cluster as the source does: about their usual size, never about zero.

    `seed`: seed [1].

    The usual size has the sign of the source's symbols, all of them positive: a misalignment that
    enters with a minus in `models.cluster.SOURCE_SYMBOLS`, such as gyro.misalignment.xz, is drawn
    about -120 arcsec. A prior about zero pulls such clusters all one way.
    """
    drawn = np.random.default_rng(seed).standard_normal(len(CONSTANTS))
    values = []
    for c, one in zip(CONSTANTS.coefficients, drawn, strict=True):
        mean, sd = (units.parse(text, c.kind) for text in TYPICAL[c.name.rpartition(".")[0]])
        values.append(SOURCE_SYMBOLS[c.name][1] * (mean + sd * float(one)))
    return ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, np.array(values)))


COMMANDED = """\
# The commanded rates, not what a gyro says: the loop of the platform holds the gyros at null.
"""
"""What stands in [log] before the gyros."""

LOG_TABLE = log_head(before_gyro=COMMANDED) + Path(__file__).with_name("log.toml").read_text(
    encoding="utf-8"
)
"""[log] of the template, and of a simulated log."""

NOISE_LINES = f"""\
# Of the accelerometers, and of the drift of the gyros, which the log cannot show by itself.
[noise.accel]
white = "{WHITE[0]}"        # 1 ug in samples of 0.2 s
[noise.gyro]
white = "{WHITE[1]}"      # 0.05 deg/h in samples of 2 ms
"""
"""[noise] of the template."""

PRIOR_LINES = """\
# What is known beforehand of a coefficient, or of every coefficient of a group. Left out, all are
# zero, give or take what is usual: drift 1 deg/h, 0.5 deg/h/g and 0.01 deg/h/g^2, torquer scale
# factors 400 ppm, misalignments 120 arcsec, accelerometers 100 ug, 100 ppm and 100 ug/g^2.
# [prior]
# "gyro.drift" = { mean = "0 deg/h", sd = "5 deg/h" }
# "accel.scale.x" = { mean = "0 ppm", sd = "500 ppm" }
"""
"""[prior] of the template."""

ERRORS_LINE = '# errors = { "gyro.drift.x" = "2 deg/h", "accel.bias.y" = "50 ug" }'
"""Errors that are not drawn, in the template."""


class Description(LogDescription):
    """How to read the log of a tumble: a row without readings still has a command."""

    missing: Literal["mask", "error", "drop"] = Field(  # type: ignore[assignment]
        "mask",
        description='"mask" keeps rows whose accelerometers are missing, for their command; '
        '"error" refuses, "drop" leaves out rows with missing or infinite values',
    )


STILL = ("log.saturated", "log.stuck", "log.held")
"""What a command is suspected of where it stands still, as it should."""


def log_table(log: Log | None = None) -> str:
    """Write the table [log] of the template, or for a simulated `log` [SI]."""
    return OWN_LOG if log is not None and log.sampled == "increment" else LOG_TABLE


def read_log(
    description: Description,
    folder: str | Path,
    progress: Callable[[float], None] | None = None,
) -> Log:
    """Read the log of a tumble; a command that stands still is no finding.

    `progress` or None: called with the fraction done, from 0 to 1.
    """
    log = logs.read(description, folder, progress)
    return replace(log, accel=_within(log.accel, description), findings=of_a_command(log.findings))


def _within(accel: FloatArray | None, description: Description) -> FloatArray | None:
    """Let readings at the declared limits be missing ones: how far beyond they were, is unknown."""
    limits = None if description.accel is None else limits_si(description.accel)
    if accel is None or limits is None:
        return accel
    slack = 1e-6 * (limits[:, 1] - limits[:, 0])
    clipped: BoolArray = (accel <= limits[:, 0] + slack) | (accel >= limits[:, 1] - slack)
    rows = np.flatnonzero(clipped.any(axis=1))
    out = accel.copy()
    out[rows] = np.nan
    return out


def of_a_command(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return `findings` without those about gyros that say the same value for long: a command may.

    A gap is left to the procedure, which knows what was commanded.
    """
    return tuple(
        f for f in findings
        if f.code != "log.gap" and (f.code not in STILL or not f.message.startswith("gyro"))
    )  # fmt: skip
