"""How a session of transfer alignment is simulated, and what is written of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from foucault import logs
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.logs import master as masters
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.layouts import BESIDE
from foucault.models.master import MasterTable
from foucault.models.noise import ImuNoise, grade
from foucault.plans.manoeuvre_table import ManoeuvreTable
from foucault.plans.transfer.profiles import TransferProfile, transfer_profile
from foucault.procedures.fields import SampleRate
from foucault.procedures.transfer_alignment.log import SlaveLog
from foucault.procedures.transfer_alignment.settings import Settings
from foucault.simulate.transfer.link import Link, MasterNoise
from foucault.simulate.transfer.session import (
    INSTALLATION,
    TransferSimulation,
    simulate_transfer,
    turn_on_grade,
)
from foucault.simulate.transfer.slave import Flexure, Slave, Vibration
from foucault.strict import Strict
from foucault.tables import Log
from foucault.units import Angle, AngleSd, Quantity, Seconds

GRADE = "tactical"
"""Class of [simulate]; of this class the turn-on errors are those of the publication."""

TRUTH_TABLE, OUTAGE_LOG, REFERENCE = "truth.csv", "outage.csv", "reference.csv"
"""Where the slave truly was; its log after the hand-over, and what to compare that with: the
truth, but for the height, which is that of the barometer."""

LONGER = 1.0
"""The slave's log goes on for so long after the hand-over, and the outage begins so much before it
[s]."""

ROWS = 10.0
"""Rows of the tables of truth in a second [Hz]."""


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
    speed: Annotated[float, Quantity("velocity")] | None = Field(
        default=None, ge=0, examples=["40 m/s"]
    )
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
    master_velocity_sd: Annotated[float, Quantity("velocity")] = Field(default=0.05, ge=0, le=100)
    """Noise of the master's velocity, each component."""
    master_attitude_sd: AngleSd = Field(default=float(np.radians(1 / 60)), ge=0)
    """Noise of its heading, pitch and roll."""
    installation_sd: AngleSd = Field(default=INSTALLATION, ge=0)
    """Sd of the installation about each axis."""
    compliance_sd: AngleSd = Field(default=0.0, ge=0)
    """Sd of the compliance of the mount, per g, about each axis."""
    flexure: Angle = Field(default=0.0, ge=0)
    """Sd of a random bending."""
    flexure_memory: Seconds = Field(default=5.0, gt=0)
    """Its correlation time."""
    vibration: Annotated[float, Quantity("specific force")] = Field(default=0.0, ge=0)
    """Vibration, root mean square along each axis."""
    with_outage: bool = True
    """Simulate the outage after the hand-over too."""

    @property
    def motion(self) -> TransferProfile:
        """What the vehicle does."""
        found = transfer_profile(self.profile)
        begun = {"heading": self.heading, "speed": self.speed}
        start = replace(found.start, **{k: v for k, v in begun.items() if v is not None})
        if self.manoeuvres:
            own = tuple(table.segment(k) for k, table in enumerate(self.manoeuvres))
            found = replace(found, name="own manoeuvres", calibration=own)
        return replace(found, start=start, outage=found.outage if self.with_outage else ())


@dataclass(frozen=True)
class TransferSession:
    """A simulated session."""

    made: TransferSimulation  # everything that was simulated, the outage included [SI]

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
    published = turn_on_grade().spread
    spread = published if grade_name == GRADE else grade(grade_name).spread
    rng, layout = np.random.default_rng([seed, 21]), LAYOUT
    vector = ImuModel().coefficients()
    for group in published:
        at = layout.group(group)
        vector.values[at] = spread[group] * rng.standard_normal(len(at))
    return ImuModel.from_coefficients(vector)


def simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> TransferSession:
    """Simulate a session.

    `noise`: noise of the slave [SI]; `seed`: seed of installation, compliance and noise [1].
    """
    motion = moved(session.motion, site)
    return simulate_motion(motion, session, settings, model, noise, seed, site.anomaly)


def simulate_motion(
    motion: TransferProfile, session: Session, settings: Settings, model: ImuModel,
    noise: ImuNoise, seed: int, gravity_offset: float = 0.0,
) -> TransferSession:  # fmt: skip
    """Simulate a session of any motion.

    `session`: how its messages come, and how the slave is fixed; `noise`: its noise [SI]; `seed`:
    seed of installation, compliance and noise [1]; `gravity_offset`: local minus normal gravity
    [m/s^2].
    """
    mount = settings.mount
    rng = np.random.default_rng([seed, 22])
    mu, give = rng.standard_normal((2, 3))
    bend, shake = session.flexure, session.vibration
    slave = Slave(
        C_0=mount.C_ms,
        mu=_three(session.installation_sd * mu),
        lever_m=_three(mount.lever_m),
        compliance=_three(session.compliance_sd * give),
        flexure=Flexure((bend, bend, bend), session.flexure_memory) if bend else None,
        vibration=Vibration(accel=shake) if shake else None,
        model=model,
        noise=noise,
    )
    link = Link(
        session.message_rate, session.message_delay, session.jitter, session.lost,
        repeated=session.repeated, stamped=session.stamped, drift=session.clock_drift,
    )  # fmt: skip
    angle = session.master_attitude_sd
    says = MasterNoise(session.master_velocity_sd, (angle, angle, angle))
    made = simulate_transfer(
        motion, rate=session.rate, slave=slave, link=link, noise=says, seed=seed,
        gravity_offset=gravity_offset,
    )  # fmt: skip
    return TransferSession(made)


def moved(profile: TransferProfile, site: Site) -> TransferProfile:
    """Return a motion that begins at latitude and height of a site."""
    if site.latitude is None:
        raise error("transfer.place")
    here = replace(profile.start, latitude=site.latitude, height=site.height)
    return replace(profile, start=here)


def _three(x: FloatArray) -> tuple[float, float, float]:
    a, b, c = np.asarray(x, float).tolist()
    return a, b, c
