"""What can be chosen where a slave is calibrated against a master in motion."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from foucault.arrays import FloatArray
from foucault.coefficients import Layout
from foucault.errors import FoucaultError, error
from foucault.models import imu
from foucault.models.attitude import matrix_of
from foucault.models.ins_errors import Sensors
from foucault.models.layouts import BESIDE
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.transfer import LOAD, Matching, Mount
from foucault.strict import Strict
from foucault.units import Angle, AngleSd, Quantity, Seconds, parse

ASIDE = ("gyro.misalignment", "accel.scale", "accel.misalignment")
"""Groups that are there for the uncertainties of the others: a motion need not show them."""

LEFT_OUT = (*ASIDE, "gyro.g_sensitivity")
"""Groups that are counted with although they are not asked for: what they may be is part of the
uncertainty of what is."""

USUAL = {
    "gyro.bias": "2.4 deg/h",
    "gyro.scale": "500 ppm",
    "accel.bias": "1 mg",
    "gyro.misalignment": "1 mrad",
    "accel.scale": "500 ppm",
    "accel.misalignment": "1 mrad",
    "gyro.g_sensitivity": "1 deg/h/g",
    "installation": "5 arcmin",
    "load": "2 arcmin",
}
"""Standard deviations beforehand where nothing else is said: zero, give or take these."""

LAYOUT = Layout((*imu.LAYOUT.coefficients, *BESIDE.coefficients))
"""What a campaign may name in [prior] and in the errors of [simulate]."""

PRIOR = {
    group: (0.0, parse(sd, LAYOUT.coefficients[LAYOUT.group(group)[0]].kind))
    for group, sd in USUAL.items()
}
"""`USUAL` as mean and standard deviation [SI]."""

NOISE = ImuNoise(
    TriadNoise(white=parse("30 ug/sqrt(Hz)", "velocity random walk")),
    TriadNoise(white=parse("0.06 deg/sqrt(h)", "angle random walk")),
)
"""White noise of the slave where nothing is said: there is no rest to measure it in."""

NOISE_LINES = """\
# There is no rest to measure the noise of the slave in: say it. Left out, it is that of a
# tactical instrument, the one below.
[noise.accel]
white = "30 ug/sqrt(Hz)"
[noise.gyro]
white = "0.06 deg/sqrt(h)"
"""
"""[noise] of the template."""

PRIOR_LINES = """\
# What is known beforehand of a coefficient, or of every coefficient of a group. Left out, all are
# zero, give or take: gyros 2.4 deg/h and 500 ppm, accelerometers 1 mg, installation 5 arcmin, load
# 2 arcmin per g. What is not in the result widens it: misalignments 1 mrad, scale factors of the
# accelerometers 500 ppm, g-sensitivity of the gyros 1 deg/h/g. Say what your instrument's are.
# [prior]
# "gyro.bias" = { mean = "0 deg/h", sd = "20 deg/h" }
# "installation" = { mean = "0 arcmin", sd = "30 arcmin" }
# "gyro.misalignment" = { mean = "0 mrad", sd = "0.1 mrad" }
"""
"""[prior] of the template."""


class Settings(Strict):
    """What can be chosen; the defaults suit a slave fixed firmly to the structure of its master."""

    matching: Literal["velocity+attitude", "velocity", "attitude"] = "velocity+attitude"
    """What of the master's messages is used."""
    attitude_form: Literal["vector", "angles"] = "vector"
    """Attitudes are compared as a rotation vector, or as heading, pitch and roll, which fail with
    the nose up or down."""
    vertical: bool = True
    """Use vertical velocity too: without it the bias of the accelerometer that points up rests on
    turns alone. It is not used without accel_bias_z, which it shows."""
    velocity_sd: Annotated[float, Quantity("velocity")] = Field(default=0.05, gt=0, le=100)
    """Sd of the difference of velocities, each component."""
    attitude_sd: AngleSd = Field(default=float(np.radians(1 / 60)), gt=0)
    """Sd of the difference of attitudes, each component: the master's noise, and what bends between
    the two faster than is modelled."""
    mounting_heading: Angle = 0.0
    """Nominal mounting: where y of the slave points, clockwise from the master's forward axis, seen
    from above."""
    mounting_pitch: Angle = 0.0
    """Its y above the master's level."""
    mounting_roll: Angle = 0.0
    """Its right side down."""
    lever_arm: tuple[str, str, str] = ("0 m", "0 m", "0 m")
    """From the master to the slave: right, forward, up of the master."""
    delay: str = "estimate"
    """How late messages arrive: "estimate", "none" (they are taken as if they held when they
    arrive), or a time such as "80 ms"."""
    delay_method: Literal["rate matching", "likelihood", "state"] = "rate matching"
    """Where a delay to be estimated starts from: what the gyros and the master's attitudes turned,
    the likeliest of many, or the middle of its bracket. From there on it is a state of the filter.
    """
    longest_delay: Seconds = Field(default=0.2, gt=0)
    """The delay is looked for from 0 to this."""
    shift: Literal["interpolated", "sample"] = "interpolated"
    """Look at the slave between its samples, or at the sample before, as published."""
    filter: Literal["kalman", "h_infinity"] = "kalman"
    """h_infinity inflates the covariance as its bound demands."""
    gamma: float | None = Field(default=None, gt=0, examples=[600.0])
    """Bound of the H-infinity filter. Left out: gamma_factor times the least."""
    gamma_factor: float = Field(default=1.2, gt=1)
    """Times the least gamma."""
    wanted: Literal["prior", "navigation"] = "prior"
    """What the bound is of: every state in units of its prior, or the horizontal position after the
    outage."""
    outage: Seconds = Field(default=600.0, gt=0)
    """How long the slave goes on alone afterwards."""
    accel_bias_z: bool = True
    """Estimate the bias of the z accelerometer; without it the states are the published sixteen."""
    misalignments: bool = False
    """Put misalignments of gyros and accelerometers and scale factors of the accelerometers into
    the result: twelve coefficients, most of which a motion does not show."""
    left_out: bool = True
    """Count with errors of the slave that are not in the result, of the size that [prior] says:
    misalignments, scale factors of the accelerometers, g-sensitivity of the gyros. false takes them
    as none, for a slave that is calibrated otherwise."""
    load: bool = False
    """The mount gives way under load: three states."""
    estimate_flexure: bool = False
    """Find flexure_sd, flexure_time and attitude_sd from the innovations: what makes them
    likeliest. What is said of them is where the search starts."""
    flexure_sd: AngleSd = Field(default=0.0, ge=0)
    """Sd of a bending that comes and goes; 0: none. Six states."""
    flexure_time: Seconds = Field(default=5.0, gt=0)
    """Its correlation time."""
    wander: Annotated[float, Quantity("angle random walk")] = Field(default=0.0, ge=0)
    """Random walk of the installation."""
    passes: int = Field(default=6, ge=1, le=10)
    """At most so many passes, each linear about what the one before has found; fewer where nothing
    moves any more."""
    hand_over: Seconds | None = Field(default=None, examples=["240 s"])
    """When the slave goes on alone, by its clock; later messages are not used. Left out: when the
    last message arrives."""

    @field_validator("lever_arm", "delay", mode="after")
    @classmethod
    def _parsed(cls, given: str | tuple[str, ...], info: ValidationInfo) -> str | tuple[str, ...]:
        name = str(info.field_name)
        try:
            if name == "lever_arm":
                for text in given:
                    parse(text, "length", name)
            elif given not in ("estimate", "none") and not parse(given, "time", name) >= 0:
                raise error("transfer.delay", given=given)
        except FoucaultError as problem:
            if "locate" in (info.context or ()):
                raise ValueError(problem) from None
            raise
        return given

    @model_validator(mode="after")
    def _possible(self) -> Settings:
        if self.matching == "velocity" and self.estimates_load:
            raise error("transfer.no_attitude")
        if self.shift == "sample" and self.estimates_delay:
            raise error("transfer.sample_delay")
        return self

    @property
    def estimates_load(self) -> bool:
        """Whether there are states that attitudes alone show."""
        return self.load or self.flexure_sd > 0

    @property
    def estimates_delay(self) -> bool:
        """Whether the delay is estimated."""
        return self.delay == "estimate"

    @property
    def known_delay(self) -> float:
        """The delay where it is not estimated [s]."""
        return 0.0 if self.delay in ("none", "estimate") else parse(self.delay, "time")

    @property
    def asked(self) -> Sensors:
        """Errors of the slave that are in the result, as terms."""
        axes = "xyz" if self.accel_bias_z else "xy"
        more = ASIDE if self.misalignments else ()
        return Sensors.of(("gyro.bias", "gyro.scale", *(f"accel.bias.{a}" for a in axes), *more))

    @property
    def sensors(self) -> Sensors:
        """Errors of the slave that are states: those, and what is counted with beside them."""
        asked = self.asked
        return Sensors.of((*asked.layout.names, *LEFT_OUT)) if self.left_out else asked

    @property
    def reported(self) -> tuple[str, ...]:
        """Coefficients of the result."""
        return (*self.asked.layout.names, *self.beside)

    @property
    def C_ms(self) -> FloatArray:  # noqa: N802
        """The nominal mounting, slave to master, shape (3, 3) [1]."""
        return matrix_of(self.mounting_heading, self.mounting_pitch, self.mounting_roll)

    @property
    def mount(self) -> Mount:
        """How the slave is fixed to the master, as far as it is known."""
        lever = np.array([parse(text, "length") for text in self.lever_arm])
        return Mount(self.C_ms, lever, self.load, self.flexure_sd, self.flexure_time, self.wander)

    @property
    def matched(self) -> Matching:
        """What of the messages is used, and how good it is."""
        parts = self.matching.split("+")
        return Matching(
            self.velocity_sd if "velocity" in parts else np.inf,
            self.attitude_sd if "attitude" in parts else np.inf,
            self.attitude_form, self.vertical and self.accel_bias_z, self.estimates_delay,
            self.shift,
        )  # fmt: skip

    @property
    def beside(self) -> tuple[str, ...]:
        """What is found besides the errors of the sensors."""
        left_out = {*(() if self.load else LOAD.names),
                    *(() if self.estimates_delay else ("master.delay",))}  # fmt: skip
        return tuple(name for name in BESIDE.names if name not in left_out)
