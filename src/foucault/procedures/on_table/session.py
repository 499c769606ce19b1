"""What sessions on a table have in common: what can be chosen, and how one is simulated."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, field_validator

from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.turntable import TablePlan, up_k
from foucault.plans.directions import Positions, canonical, table_plan
from foucault.plans.directions import positions as angles_of_positions
from foucault.plans.efficiency import refuse_singular
from foucault.procedures import record
from foucault.simulate.table import Rig, Simulation, simulate_means
from foucault.simulate.table import simulate as simulate_log
from foucault.strict import Strict
from foucault.units import Angle, AngleSd, Force, Length, Rate

LOG_LINES = """\
# A spreadsheet of means, a row per position:  averaged = { column = "averaged", unit = "s" }

# The table; leave out what is not logged ("" in place of an angle). Norm observation needs none.
[log.table]
columns = ["outer", "middle", "inner"]
unit = "rad"
rate = "table_rate"                     # of the outer axis, counter-clockwise from above
rate_unit = "rad/s"
position = "position"                   # number of the position, empty or -1 in between
"""
"""What the log of a session on a table has beside the instrument's columns."""

FLOOR = 100.0
"""Time after which biases of most instruments move by as much as white noise leaves [s]."""


class TableSettings(record.Robust, record.EarthRate, record.Terms):
    """What can be chosen of a session on a table; procedures add their own."""

    plan: Annotated[str, record.checked(canonical)] = "icosahedron 12"
    """Set of positions, as `foucault plans` lists them."""
    positions: Annotated[list[list[str]] | None, record.checked(angles_of_positions)] = Field(
        default=None,
        examples=[[["30 deg", "0 deg", "-31.7 deg"], ["60 deg", "0 deg", "211.7 deg"]]],
    )
    """Positions of your own instead of a plan: outer, middle and inner angle each."""
    spin_rate: Rate = float(np.radians(10.0))
    """Rate of the outer axis in spins, counter-clockwise seen from above."""
    both_senses: bool = False
    """Each spin is followed by one the other way."""
    four_positions: bool = False
    """With the rests that the published unification of the frames needs."""
    shortest: record.Shortest = 5.0
    rate_sd: record.RateSd = 0.0
    table_rate_sd: record.TableRateSd = 0.0
    plumb_sd: record.PlumbSd = float(np.radians(1 / 60))
    lever_arm: bool = True
    """Estimate how far the accelerometers are from the centre of the table."""
    repeatability: record.Repeatability = True
    cable_limit: Angle | None = Field(default=None, gt=0, examples=["3 rev"])
    """Largest outer angle either way that a cable allows, turns counted; for preflight and
    optimise, as the other limits of the table below."""
    middle_range: tuple[Angle, Angle] | None = Field(default=None, examples=[["-95 deg", "95 deg"]])
    """Smallest and largest middle angle that the table reaches."""
    inner_range: tuple[Angle, Angle] | None = Field(default=None, examples=[["0 deg", "360 deg"]])
    """Smallest and largest inner angle that the table reaches."""
    angle_step: Angle | None = Field(default=None, gt=0, examples=["15 deg"])
    """Angles are multiples of this, as on a dividing head."""

    @field_validator("spin_rate", mode="after")
    @classmethod
    def _spins(cls, rate: float) -> float:
        if rate == 0.0:
            raise ValueError("it should not be zero")
        return rate

    @field_validator("middle_range", "inner_range", mode="after")
    @classmethod
    def _grows(cls, ends: tuple[float, float] | None) -> tuple[float, float] | None:
        if ends is not None and ends[0] > ends[1]:
            raise ValueError("its first angle should not be larger than its second")
        return ends

    @property
    def chosen(self) -> Positions:
        """The positions: those listed, else those of the plan."""
        return self.plan if self.positions is None else self.positions


class TableSession(Strict):
    """The session on a table that `simulate` makes."""

    rest_time: record.RestTime = 60.0
    turns: int = Field(default=4, ge=1)
    """Whole turns of each spin."""
    rate: record.SampleRate = 20.0
    kind: record.Sampling = "rate"
    rows: record.Rows = "samples"
    plumb_sd: record.PlumbSd = float(np.radians(30 / 3600))
    orthogonality_sd: record.OrthogonalitySd = float(np.radians(10 / 3600))
    zero_sd: record.ZeroSd = float(np.radians(10 / 3600))
    position_sd: record.PositionSd = float(np.radians(1 / 60))
    rate_error_sd: record.TableRateSd = 0.0
    rate_jitter: record.RateSd = 0.0
    accel_scatter: Force | None = Field(default=None, ge=0, examples=["20 ug"])
    """Sd of another bias of each accelerometer in every rest and spin. Left out: what white noise
    leaves in a mean of 100 s; none where [noise] says it or the calibration looks for none."""
    gyro_scatter: Rate | None = Field(default=None, ge=0, examples=["2 deg/h"])
    """Sd of another bias of each gyro in every rest and spin. Left out: as of accelerometers."""
    mounting_sd: AngleSd = Field(default=float(np.radians(10 / 60)), ge=0)
    """Sd of the rotation of the instrument on the table, about each axis."""
    lever_arm_sd: Length = Field(default=0.02, ge=0, le=100)
    """Sd of each coordinate of the accelerometers from the centre of the table."""
    heading: Angle = float(np.radians(30.0))
    """Azimuth of table y at outer angle zero, clockwise from North."""

    def scattered(self, settings: TableSettings, noise: ImuNoise) -> Self:
        """Return the session with the scatter that a calibration which measures noise counts."""
        if not settings.repeatability:
            return self
        triads = {"accel_scatter": noise.accel, "gyro_scatter": noise.gyro}
        usual = {key: triad.white / FLOOR**0.5 for key, triad in triads.items()}
        return self.model_copy(update={k: v for k, v in usual.items() if getattr(self, k) is None})


def plan_of(
    settings: TableSettings,
    session: TableSession,
    *,
    spins: bool = True,
    judged: str | None = "accel",
) -> TablePlan:
    """Plan what the table does in the session to simulate.

    `judged`: what the positions must determine, a key of `plans.efficiency.MODELS`, with
    `accel_quadratic` "accel" becomes "accel quadratic". None does not judge them. Raises
    ``plan.singular`` and ``plan.too_few``.
    """
    plan = table_plan(
        settings.chosen,
        spin_rate=settings.spin_rate,
        rest_time=session.rest_time,
        turns=session.turns,
        spins=spins,
        both_senses=settings.both_senses,
        four_positions=settings.four_positions,
    )
    if judged is not None:
        model = "accel quadratic" if judged == "accel" and settings.accel_quadratic else judged
        refuse_singular(plan.name, up_k(plan.angles[plan.rate == 0.0]), model)
    return plan


def draw_rig(session: TableSession, seed: int) -> Rig:
    """Draw the errors of a table, and how the instrument sits on it.

    `seed`: seed [1].
    """
    rng = np.random.default_rng(seed)
    common_sd = np.repeat([session.plumb_sd, session.orthogonality_sd, session.zero_sd], 2)
    return Rig(
        common=common_sd * rng.standard_normal(6),
        position_sd=session.position_sd,
        rate_error=session.rate_error_sd * float(rng.standard_normal()),
        rate_jitter=session.rate_jitter,
        accel_scatter=session.accel_scatter or 0.0,
        gyro_scatter=session.gyro_scatter or 0.0,
        mounting=session.mounting_sd * rng.standard_normal(3),
        lever_arm=session.lever_arm_sd * rng.standard_normal(3),
        heading=session.heading,
    )


def simulate(
    session: TableSession,
    *,
    settings: TableSettings | None = None,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    seed: int,
    spins: bool = True,
    judged: str | None = "accel",
) -> Simulation:
    """Simulate a session on a table.

    `session`: its length and rate, and the errors of the table; `settings`: positions and spins,
    None takes the defaults; `seed`: seed of table and noise [1]; `judged` or None: what the
    positions must determine, see `plan_of`.
    """
    settings = settings or TableSettings()
    rig_seed, noise_seed = (int(s) for s in np.random.SeedSequence(seed).generate_state(2))
    plan = plan_of(settings, session, spins=spins, judged=judged)
    rig = draw_rig(session, rig_seed)
    if session.rows == "means":
        return simulate_means(
            plan, model=model, noise=noise, site=site, rig=rig, rate=session.rate, seed=noise_seed
        )
    return simulate_log(
        plan, model=model, noise=noise, site=site, rig=rig, rate=session.rate,
        sampled=session.kind, seed=noise_seed,
    )  # fmt: skip
