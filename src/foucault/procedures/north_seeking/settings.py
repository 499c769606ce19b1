"""What can be chosen of north seeking, and the session that is simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from foucault import units
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.estimate.north_reduction import NEAR_SD
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import SEEKER
from foucault.models.rotation import turned
from foucault.plans.north_orders import PALINDROME, PUBLISHED, SEQUENTIAL
from foucault.procedures.record import Rows, SampleRate
from foucault.simulate.north import (
    NorthPlan,
    NorthSimulation,
    Placement,
    SeekerErrors,
    Stops,
    simulate_north,
)
from foucault.strict import Strict
from foucault.units import Angle, AngleSd, Quantity, Rate, RatioSd, Seconds

Ramp = Annotated[float, Quantity("rate ramp")]
Force = Annotated[float, Quantity("specific force")]

MINUTE = float(np.radians(1.0 / 60.0))
"""One arcmin [rad]."""

MOST_LATITUDE = np.radians(89.0)
"""Nearer to a pole the horizontal part of the Earth's rate is too small to be of use [rad]."""

ORDERS = {order.name: order for order in (PUBLISHED, SEQUENTIAL, PALINDROME)}
"""The orders of stops that can be simulated by name."""

SPREAD = {
    "gyro.bias": ("0.02 deg/h", "angular rate"),
    "gyro.scale": ("0.2 %", "scale factor error"),
    "gyro.misalignment": ("5 arcmin", "misalignment"),
    "gyro.misalignment.xz": ("10 arcmin", "misalignment"),
    "gyro.misalignment.yz": ("10 arcmin", "misalignment"),
    "accel.bias": ("100 ug", "specific force"),
    "accel.scale": ("200 ppm", "scale factor error"),
}
"""What the errors of instruments are drawn from: standard deviation and kind."""


class Stop(Strict):
    """One stop of the base."""

    index: Angle
    """Index angle, clockwise seen from above."""
    dwell: Seconds | None = Field(default=None, gt=0, examples=["75 s"])
    """How long it lasts; left out, the `dwell` of all stops."""


Named = Literal["published", "sequential", "palindrome"]
Order = Annotated[
    Annotated[Named, Tag("name")] | Annotated[tuple[Stop, ...], Tag("list"), Field(min_length=1)],
    Discriminator(lambda given: "name" if isinstance(given, str) else "list"),
]
"""A mistake is told of what was given alone: a name, or a list."""


class Settings(Strict):
    """What can be chosen: of both, of the calibration on a turntable, of the fix in the field."""

    drift: Literal["auto", "none", "linear"] = "auto"
    """Linear drift of the gyro in each set-up; auto: estimated where it is nearly free."""
    drift_sd: Ramp | None = Field(default=None, gt=0, examples=["0.05 deg/h/h"])
    """Standard deviation of that drift, if it is known; then it is weighed, not estimated freely.
    """
    index_sd: AngleSd = Field(default=0.0, ge=0, examples=["10 arcsec"])
    """Sd of every index angle, by itself."""
    index_lag_sd: Seconds | None = Field(default=None, ge=0, examples=["1 ms"])
    """Sd of the time between an index angle and the middle of the gyro's reading, for a base that
    turns."""
    index_limit: Angle | None = Field(default=None, gt=0, examples=["180 deg"])
    """Planning. How far the base turns either way from index 0, as a cable lets it; left out, any
    angle. Named orders are told by angles within it where they can be."""
    index_step: Angle | None = Field(default=None, gt=0, examples=["90 deg"])
    """Planning. Detents of the base: it stops at multiples of this alone."""
    settle: Seconds = Field(default=1.0, ge=0)
    """Left out after every move of the base."""
    shortest: Seconds = Field(default=5.0, gt=0)
    """Shortest dwell."""
    tilt: Literal["auto", "one axis", "each"] = "auto"
    """Calibration. one axis: the table turned about one vertical axis; each: it was tilted too, and
    the accelerometers say how much."""
    z_coupling: Literal["auto", "free", "no"] = "auto"
    """Calibration. Two more parameters, the coupling of the rate along the axis of the base, which
    only a tilted table shows; auto: with what `z_coupling_sd` says of them."""
    z_coupling_sd: AngleSd = Field(default=MINUTE * 10, gt=0)
    """Calibration. Sd of that coupling beforehand."""
    heading_sd: AngleSd = Field(default=0.0, ge=0)
    """Calibration. Sd of every reference heading, by itself."""
    heading_offset_sd: AngleSd = Field(default=0.0, ge=0)
    """Calibration. Sd of an error that all reference headings share."""
    level_sd: AngleSd | None = Field(default=None, gt=0, examples=["1 arcmin"])
    """How far from level it may stand, about each axis; needed without accelerometers."""
    latitude_sd: AngleSd = Field(default=0.0, ge=0, examples=["0.5 deg"])
    """Sd of the latitude of the site."""
    accel_bias_sd: Force = Field(default=units.parse("100 ug", "specific force"), ge=0)
    """Sd of the accelerometers' biases, where no calibration on one vertical axis has found them.
    """
    accel_scale_sd: RatioSd = Field(default=200e-6, ge=0)
    """Sd of the accelerometers' scale factors, which a level table does not show."""
    accel_misalignment_sd: AngleSd = Field(default=MINUTE / 3, ge=0)
    """Sd of the angle between the axes of tilt, which neither does."""
    unknown_latitude: bool = False
    """Fix. Estimate the latitude; the site needs gravity then."""
    hemisphere: Literal["north", "south"] | None = None
    """Fix. Decides between two roots where latitude is unknown; north if left out."""
    near: Angle | None = Field(default=None, examples=["120 deg"])
    """Fix. Rough heading, where the stops leave more than one."""
    near_sd: AngleSd = Field(default=NEAR_SD, gt=0)
    """Fix. Sd of that rough heading."""
    gyro_offset: Rate = 0.0
    """Fix. The gyro's constant offset, if `gyro_offset_sd` is given."""
    gyro_offset_sd: Rate | None = Field(default=None, gt=0, examples=["0.5 deg/h"])
    """Fix. Its sd; left out, the offset is found from the readings."""
    accuracy: Angle | None = Field(default=None, gt=0, examples=["0.1 deg"])
    """Fix. Wanted sd of the heading; the result says how long it takes."""

    @model_validator(mode="after")
    def _consistent(self) -> Settings:
        if self.drift == "none" and self.drift_sd is not None:
            raise error("north.contradiction", first='drift = "none"', second="drift_sd")
        if self.gyro_offset and self.gyro_offset_sd is None:
            raise error("north.offset_alone")
        return self


class Planning(Strict):
    """What a plan for north seeking is asked for, and judged by."""

    latitude: Angle
    """Latitude of the site, positive north, such as "47.3 deg"."""
    time: Seconds | None = Field(default=None, gt=0)
    """Time there is, moves included, such as "10 min"."""
    gyro_bias_instability: Rate | None = Field(default=None, ge=0)
    """Bias instability of the gyro, such as "0.005 deg/h"."""
    gyro_correlation_time: Seconds | None = Field(default=None, gt=0)
    """Correlation time of that instability; "300 s" if left out."""
    gyro_random_walk: Annotated[float, Quantity("rate random walk")] | None = Field(
        default=None, ge=0
    )
    """Rate random walk of the gyro, such as "0.002 deg/h/sqrt(h)"."""
    accel_noise: Annotated[float, Quantity("velocity random walk")] | None = Field(
        default=None, ge=0
    )
    """Velocity random walk of the accelerometers; "5 ug/sqrt(Hz)" if left out."""
    drift: Ramp | None = Field(default=None, ge=0)
    """Linear drift of the gyro to expect, such as "0.01 deg/h/h"."""
    drift_estimated: bool = True
    """Whether the solution estimates the drift."""
    tilt: Angle = Field(default=0.0, ge=0)
    """Largest tilt of the case, such as "10 deg"; level if left out."""
    rough: Angle | None = Field(default=None, gt=0)
    """Standard deviation of a heading that is known, such as "2 deg"."""
    move: Seconds = Field(default=10.0, ge=0)
    """Time from one stop to the next, settling included; "10 s" if left out."""


class Session(Strict):
    """The calibration session that `simulate` makes."""

    headings: int = Field(default=12, ge=1)
    """Headings of the turntable, evenly spread."""
    order: Order = "published"
    """Order of the stops of the base in each heading: published, sequential, palindrome, or a list
    of { index = "0 deg", dwell = "75 s" }."""
    dwell: Seconds = Field(default=120.0, gt=0)
    """Length of the shortest stop, or of those in a list that say none."""
    move: Seconds = Field(default=5.0, ge=0)
    """Time from one stop to the next."""
    tilts: tuple[str, ...] = ("0 deg",)
    """Pitch of the table; the headings are gone through at each of them."""
    offset_sd: Rate = Field(default=MINUTE / 60, ge=0)
    """Sd of the constant offset of the gyro."""
    twice_per_turn_sd: Rate = Field(default=0.0, ge=0, examples=["0.01 deg/h"])
    """Sd of what repeats twice per turn of the base, as stops with biases of their own do."""
    gyro_drift: Ramp = 0.0
    """Linear drift of the gyro."""
    accelerometers: Literal["base", "case", "none"] = "base"
    """One that turns with the gyro, two fixed to the case, or none."""
    rate: SampleRate = 10.0
    rows: Rows = "means"

    @property
    def called(self) -> str:
        """What the order is called."""
        return f"{self.order} order" if isinstance(self.order, str) else "stops of the campaign"

    def motion(self, limit: float | None = None) -> Stops:
        """Return what the base does in each heading.

        `limit`: how far it turns either way, None for any angle [rad].
        """
        if isinstance(self.order, str):
            order = ORDERS[self.order]
            index, dwell = order.index, self.dwell * order.share / order.share.min()
            if limit is not None:
                index = np.where(np.abs(index) > limit, turned(index), index)
            return Stops(index, dwell, self.move)
        lengths = [self.dwell if stop.dwell is None else stop.dwell for stop in self.order]
        return Stops(np.array([s.index for s in self.order]), np.array(lengths), self.move)


def planned(settings: Settings, session: Session) -> NorthPlan:
    """Return the set-ups and what the base does in each."""
    pitches = [units.parse(text, "angle", "tilts") for text in session.tilts]
    if any(abs(p) >= np.pi / 2 for p in pitches):
        raise error("north.tilt_plan", given=", ".join(session.tilts))
    headings = np.arange(session.headings) * 2 * np.pi / session.headings
    setups = tuple(
        Placement(_name(heading, pitch, pitches), float(heading), pitch)
        for pitch in pitches
        for heading in headings
    )
    return NorthPlan(setups, session.motion(settings.index_limit))


def simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> NorthSimulation:
    """Simulate a session on a turntable; what is wrong with table and base is drawn from settings.

    `model`: errors of the instrument, resolved by the base; `noise`: its noise [SI]; `seed`: seed
    of table, offset and noise [1].
    """
    rng = np.random.default_rng([seed, 5])
    common = settings.heading_offset_sd * float(rng.standard_normal())
    offset = session.offset_sd * float(rng.standard_normal())
    twice = (session.twice_per_turn_sd * rng.standard_normal(2)).tolist()
    drift = session.gyro_drift
    if settings.drift_sd is not None and not drift:
        drift = settings.drift_sd * float(rng.standard_normal())
    lean = (settings.level_sd or 0.0) * np.random.default_rng([seed, 6]).standard_normal(2)
    base, own = parts(model)
    errors = SeekerErrors(
        gyro_offset=offset, gyro_drift=drift, index_sd=settings.index_sd,
        heading_sd=settings.heading_sd, heading_offset=common,
        twice_per_turn=(twice[0], twice[1]), lean=(float(lean[0]), float(lean[1])), own=own,
    )  # fmt: skip
    accel = None if session.accelerometers == "none" else session.accelerometers
    made = simulate_north(
        planned(settings, session), model=base, noise=noise, site=site, errors=errors,
        accel=accel, rate=session.rate, rows=session.rows, seed=seed,
    )  # fmt: skip
    return replace(made, model=model)


def parts(model: ImuModel) -> tuple[ImuModel, ImuModel]:
    """Return what of the errors repeats with the index angle, and what turns with the sensors."""
    whole = model.coefficients(LAYOUT.names)
    repeats = [n.split(".")[1] in ("bias", "scale", "misalignment") for n in LAYOUT.names]
    base, own = (
        whole.with_values({n: 0.0 for n, k in zip(LAYOUT.names, repeats, strict=True) if k != kept})
        for kept in (True, False)
    )
    return ImuModel.from_coefficients(base), ImuModel.from_coefficients(own)


def draw_errors(_grade: str, seed: int) -> ImuModel:
    """Draw the errors of one north seeker, those that repeat with its index angle.

    `_grade`: not needed: what base and housing do hardly depends on the class of the gyro;
    `seed`: seed [1].
    """
    sd = {name: units.parse(text, kind) for name, (text, kind) in SPREAD.items()}
    wanted = [n for n in SEEKER.names if n.rpartition(".")[0] in sd]
    rng = np.random.default_rng(seed)
    values = [sd.get(n, sd[n.rpartition(".")[0]]) * float(rng.standard_normal()) for n in wanted]
    return ImuModel.from_coefficients(CoefficientVector(SEEKER.subset(wanted), np.array(values)))


def _name(heading: float, pitch: float, pitches: list[float]) -> str:
    name = f"{np.degrees(heading):g}"
    return name if len(pitches) == 1 else f"{name} at {np.degrees(pitch):g}"
