"""What can be chosen where a slave is calibrated against a master in motion.

The log of a slave beside what its master said: how it is described, what of both can be used.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from foucault import logs
from foucault.arrays import FloatArray
from foucault.coefficients import Layout
from foucault.detect.noise import KNOCKS, without_spikes
from foucault.errors import Finding, error, finding
from foucault.files import sha256
from foucault.logs import master as masters
from foucault.logs.checks import on_a_shared_clock
from foucault.logs.description import OWN_LOG, log_head
from foucault.logs.master import MasterDescription
from foucault.models import imu
from foucault.models.earth import SEMI_MAJOR_AXIS, Site
from foucault.models.ins_errors import Sensors
from foucault.models.layouts import BESIDE
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import matrix_of
from foucault.models.transfer import LOAD, MasterTable, Matching, Mount
from foucault.navigate.increments import Increments, increments_of
from foucault.procedures.chosen import Chosen
from foucault.procedures.left_out import told_beside
from foucault.procedures.record import checked
from foucault.tables import Log
from foucault.units import (
    Angle,
    AngleSd,
    Length,
    Quantity,
    RatioSd,
    Seconds,
    Velocity,
    parse,
    plain,
    span,
)

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

TACTICAL = "usual of a tactical instrument, judgement"
"""What a size of `USUAL` rests on."""

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


def _possible_delay(given: str) -> None:
    if given not in ("estimate", "none") and not parse(given, "time", "delay") >= 0:
        raise error("transfer.delay", given=given)


class Settings(Chosen):
    """What can be chosen; the defaults suit a slave fixed firmly to the structure of its master."""

    matching: Literal["velocity+attitude", "velocity", "attitude"] = "velocity+attitude"
    """What of the master's messages is used."""
    attitude_form: Literal["vector", "angles"] = "vector"
    """Attitudes are compared as a rotation vector, or as heading, pitch and roll, which fail with
    the nose up or down."""
    vertical: bool = True
    """Use vertical velocity too: without it the bias of the accelerometer that points up rests on
    turns alone. It is not used without accel_bias_z, which it shows."""
    velocity_sd: Velocity = Field(default=0.05, gt=0, le=100)
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
    lever_arm: Annotated[
        tuple[str, str, str], checked(lambda arm: [parse(x, "length", "lever_arm") for x in arm])
    ] = ("0 m", "0 m", "0 m")
    """From the master to the slave: right, forward, up of the master."""
    delay: Annotated[str, checked(_possible_delay)] = "estimate"
    """How late messages arrive: "estimate", "none" (they are taken as if they held when they
    arrive), or a time such as "80 ms"."""
    delay_method: Literal["rate matching", "likelihood", "state"] = "rate matching"
    """Where a delay to be estimated starts from: what the gyros and the master's attitudes turned,
    the likeliest of many, or the middle of its bracket. From there on it is a state of the filter.
    """
    longest_delay: Seconds = Field(default=0.2, gt=0, le=60)
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
    misalignments, scale factors of the accelerometers, g-sensitivity of the gyros; beside them all
    else that is not estimated, unless [instrument] has left_out = false. false takes them as none,
    for a slave that is calibrated otherwise, and all else too where [instrument] says nothing."""
    lever_arm_sd: Length = Field(default=0.01, ge=0)
    """How well the lever arm is known, each component. It counts as what is not estimated does."""
    clock_sd: RatioSd = Field(default=20e-6, ge=0)
    """How well the clocks of slave and master keep the same rate. It counts likewise."""
    load_sd: AngleSd = Field(default=float(np.radians(3 / 3600)), ge=0)
    """How far a mount that is taken as rigid gives way per g of load. It counts likewise."""
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
    def always(self) -> Sizes:
        """Sizes of what is counted with although none is declared [SI]."""
        groups = LEFT_OUT if self.left_out else ()
        return {group: (PRIOR[group][1], TACTICAL) for group in groups}

    @property
    def sensors(self) -> Sensors:
        """Errors of the slave that are states: those, and what is counted with beside them."""
        return Sensors.of((*self.asked.layout.names, *self.always))

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


def sized(
    settings: Settings, sizes: Sizes | None, noise: ImuNoise | None, span: float
) -> Sizes | None:
    """Return the sizes of what is not estimated, None where it is taken for nothing [SI].

    `sizes` or None: as declared [SI]; `noise` or None: of the slave [SI]; `span`: of the log [s].
    """
    if not (sizes or settings.left_out):
        return None
    return told_beside(sizes, noise or NOISE, span)


MASTER_FILE = "master.csv"  # File of the messages of a simulated master.

LOG_TABLE = log_head("the slave's IMU; ") + Path(__file__).with_name("log.toml").read_text(
    encoding="utf-8"
)
"""[log] and [master] of the template."""

SIMULATED_TABLE = f"""\
{OWN_LOG}
[master]
file = "master.csv"                     # the titles of its columns say what they are
"""
"""The same of a simulated session."""


@dataclass(frozen=True)
class SlaveLog(Log):
    """The log of a slave, and the messages of its master.

    `time`, `gyro`, `accel`, `temperature`, `averaged`, `begins`, `mag`, `rests`: of the slave [SI].
    """

    master: MasterTable | None = None

    @classmethod
    def of(cls, log: Log, master: MasterTable) -> SlaveLog:
        """Return the log of a slave beside what its master said."""
        told = (*on_a_shared_clock(log.findings), *master.findings)
        own = {f.name: getattr(log, f.name) for f in fields(Log)}
        return cls(**own | {"findings": told, "master": master})

    @property
    def messages(self) -> MasterTable:
        """What the master said; refused where there is no master."""
        if self.master is None:
            raise error("transfer.no_master")
        return self.master


def with_master(log: Log, description: MasterDescription, folder: str | Path) -> SlaveLog:
    """Read the table of the master beside the log of a slave.

    `folder`: folder that a relative file name starts from.
    """
    assert description.file is not None
    table, file = masters.read(description, folder), Path(folder) / description.file
    source = log.source | {"master": {"file": description.file, "sha256": sha256(file)}}
    return replace(SlaveLog.of(log, table), source=source)


def write_log(log: SlaveLog, path: str | Path) -> None:
    """Write the log of a slave, and the table of its master beside it.

    `log`: what was simulated [SI]; `path`: file of the slave's log, `MASTER_FILE` gets into the
    same folder.
    """
    logs.write(log, path)
    masters.write(log.messages, Path(path).with_name(MASTER_FILE))


def log_table(log: Log | None = None) -> str:
    """Write the tables [log] and [master] of the template, or for a simulated `log` [SI]."""
    return LOG_TABLE if log is None else SIMULATED_TABLE


LEAST = 20  # Messages that it takes at least [1].
BEYOND = 0.3  # A delay is looked for so far outside its bracket too, to be told [s].

ELSEWHERE = np.radians(0.1)
"""A master whose latitude differs by so much from that of the site is not there [rad]."""

NORMAL = "normal gravity"  # `Site.gravity_source` where gravity is that of the place.

SPARE = 1.0
"""The slave's log is used from so much before the first message to so much after the last [s]."""

LONGEST_GAP = 0.25
"""A longer gap of the slave's log is not bridged: nothing says what it did meanwhile [s]."""


def heard(table: MasterTable, settings: Settings) -> tuple[Settings, list[Finding]]:
    """Return the settings for what a master says: some say no vertical velocity, and write zero."""
    used = settings.matched.vertical and settings.matching != "attitude"
    if not used or table.velocity_n[:, 2].any():
        return settings, []
    return settings.model_copy(update={"vertical": False}), [finding("transfer.no_vertical")]


def usable(log: SlaveLog) -> SlaveLog:
    """Return the log without spikes, each message once; refuse it backwards or not finite.

    Logs read from files are whole already.
    """
    columns = [x for x in (log.gyro, log.accel) if x is not None]
    lost = ~np.isfinite(np.column_stack([log.time, *columns])).all(axis=1)
    if lost.any():
        raise error("transfer.not_finite", count=int(lost.sum()),
                    time=stamp(float(log.time[np.argmax(lost)])))  # fmt: skip
    for triad in ("gyro", "accel"):
        column = getattr(log, triad)
        if column is not None and len(column) and not np.ptp(column, axis=0).any():
            raise error("transfer.dead", triad=triad)
    back = np.flatnonzero(np.diff(log.time) <= 0)
    if len(back):
        raise error("transfer.backwards", count=len(back), time=stamp(float(log.time[back[0] + 1])))
    said = log.messages.cleaned("error")
    log = without_spikes(log, most=KNOCKS)
    known = {f.code for f in log.findings}
    told = [f for f in said.findings if f.code not in known]
    return replace(log, master=said, findings=(*log.findings, *told))


def stamp(time: float) -> str:
    """Write `time`, shape () [s], to the millisecond, whether it counts from switch-on or 1970."""
    return plain(round(time, 3), 13)


def placed(table: MasterTable, site: Site) -> MasterTable:
    """Return the table with positions: those of a master that has none begin at the site."""
    if table.has_place:
        return table if table.height is not None else table.from_place(0.0, site.height)
    if site.latitude is None:
        raise error("transfer.place")
    return table.from_place(site.latitude, site.height)


def there(site: Site, table: MasterTable) -> tuple[Site, list[Finding]]:
    """Return the site where the run begins: a master that says its position knows it better."""
    if table.latitude is None or table.longitude is None:
        return site, []
    latitude = float(table.latitude[0])
    height = site.height if table.height is None else float(table.height[0])
    if site.latitude is None:
        return replace(site, latitude=latitude, height=height), []
    off = abs(latitude - site.latitude)
    if off < ELSEWHERE:
        return site, []
    moved = replace(site, latitude=latitude)
    if site.gravity_source == NORMAL:
        moved = replace(Site.at(latitude, height), gravity_sd=site.gravity_sd)
    told = finding("transfer.site", site=f"{np.degrees(site.latitude):.4f}",
                   master=f"{np.degrees(latitude):.4f}",
                   away=f"{off * SEMI_MAJOR_AXIS / 1e3:.0f} km")  # fmt: skip
    return moved, [told]


def even(table: MasterTable) -> MasterTable:
    """Return the table with times of arrival that do not jitter.

    The master's own stamps are even: the straight line of arrival over stamp is one clock against
    the other, and the mean of what the messages are late, which is part of the delay.
    """
    if table.arrival is None:
        return table
    age = table.time - table.time[0]
    slope, offset = np.polyfit(age, table.arrival, 1)
    return replace(table, arrival=offset + slope * age)


def common(
    log: SlaveLog, table: MasterTable, settings: Settings
) -> tuple[float, MasterTable, Increments]:
    """Return when the slave is handed over, the messages until then, and the slave beside them.

    `table`: messages, with positions [SI].
    """
    time = table.messages.time
    first, last = float(log.time[0]), float(log.time[-1])
    inside = (time > first) & (time <= last)
    end = settings.hand_over
    if end is not None and not (np.sum(inside) and time[inside][0] < end <= last):
        begin = float(time[inside][0]) if inside.any() else np.nan
        raise error("transfer.hand_over", given=stamp(end), begin=stamp(begin), last=stamp(last))
    if end is not None:
        inside &= time <= end
    if np.sum(inside) < LEAST:
        raise error("transfer.overlap", first=stamp(first), last=stamp(last),
                    begin=stamp(float(time[0])), end=stamp(float(time[-1])),
                    used=int(np.sum(inside)), least=LEAST)  # fmt: skip
    used = table[inside]
    end = float(time[inside][-1]) if end is None else end
    near = SPARE + settings.longest_delay + BEYOND
    rows = np.searchsorted(log.time, [float(time[inside][0]) - near, end + SPARE])
    some = log[slice(int(rows[0]), int(rows[1]))]
    step, allowed = np.diff(some.time), max(LONGEST_GAP, 2.0 * some.interval)
    if step.max() > allowed:
        at = float(some.time[np.argmax(step)])
        raise error("transfer.gap", count=int(np.sum(step > allowed)), time=stamp(at),
                    longest=span(float(step.max())), allowed=span(allowed))  # fmt: skip
    return end, used, increments_of(some, gaps="bridge")
