"""A session on a rate table: what can be chosen of its calibration, and how one is simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from foucault import units
from foucault.arrays import FloatArray
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.procedures.fields import EarthRate, Strict
from foucault.procedures.validators import located
from foucault.simulate.rate_table import (
    RatePlan,
    RateTableSimulation,
    TableErrors,
    simulate_rate_table,
)
from foucault.tables import AXES
from foucault.units import AngleSd, Quantity, RatioSd, Seconds

LOG_LINES = """\
# A spreadsheet of means, a row per step:  averaged = { column = "averaged", unit = "s" }

# The table; leave out what is not logged ("" in place of an angle), and list `rates` below instead.
[log.table]
columns = ["outer", "", ""]
unit = "rad"
rate = "table_rate"                     # counter-clockwise from above
rate_unit = "rad/s"
"""
"""What the log of a session on a rate table has beside the instrument's columns."""

Axis = Literal["x up", "x down", "y up", "y down", "z up", "z down"]


def in_si(rates: tuple[str, ...]) -> FloatArray:
    """Return rates written with their unit, such as "10 deg/s", shape (k,) [rad/s]."""
    return np.array([units.parse(text, "angular rate", "rates") for text in rates])


class _Rates(Strict):
    """A list of rates as text, each checked where it stands."""

    @field_validator("rates", mode="after", check_fields=False)
    @classmethod
    def _are_rates(cls, rates: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        located(info, lambda: in_si(rates))
        return rates


class Settings(_Rates, EarthRate):
    """What can be chosen; the defaults suit most tables."""

    rates: tuple[str, ...] = Field(
        default=(),
        description="Rates of the table in each placement, in order, counter-clockwise seen from "
        "above positive; needed where the log carries no rate of the table. Rests between rates "
        "above 0.2 deg/s need not be listed.",
    )
    axes: tuple[Axis, ...] = Field(
        default=(),
        description="Placements in order, such as x up; needed where the log has no "
        "accelerometers, checked where it has. An axis that is not named is not estimated.",
    )
    asymmetry: bool = Field(
        default=True, description="Estimate the asymmetry of each scale factor (3 more)."
    )
    cubic: bool = Field(
        default=True, description="Estimate the cubic term of each scale factor (3 more)."
    )
    g_sensitivity: bool = Field(
        default=False,
        description="Estimate the gyros' g-sensitivity too (9 more); needs every axis up and down.",
    )
    rate_sd: RatioSd = Field(
        default=0.0, ge=0, description="Relative sd of the rate from one step to the next."
    )
    table_rate_sd: RatioSd = Field(
        default=0.0, ge=0, description="Relative sd of an error that all rates share."
    )
    fixture_sd: AngleSd = Field(
        default=0.0,
        ge=0,
        description="Sd of the tilt of the instrument in each placement, about each level axis.",
    )
    loss: Literal["robust", "squares"] = Field(
        default="robust",
        description="robust: a step beyond 3 sd is weighted down; squares: all count in full.",
    )
    repeatability: bool = Field(
        default=True,
        description="Estimate the scatter between steps that the noise does not explain.",
    )
    shortest: Seconds = Field(default=5.0, gt=0, description="Shortest rest.")

    @property
    def placed(self) -> tuple[str, ...]:
        """Axes of the instrument that were along the spin axis: all, unless `axes` names some."""
        return tuple(a for a in AXES if not self.axes or any(p.startswith(a) for p in self.axes))


class Session(_Rates):
    """The session that `simulate` makes."""

    rates: tuple[str, ...] = Field(
        default=(
            "10 deg/s", "-10 deg/s", "25 deg/s", "-25 deg/s", "50 deg/s", "-50 deg/s",
            "100 deg/s", "-100 deg/s",
        ),
        description="Rates in each placement, unless [procedure] lists them.",
    )  # fmt: skip
    axes: tuple[Axis, ...] = Field(
        default=("x up", "x down", "y up", "y down", "z up", "z down"),
        description="Placements, unless [procedure] lists them.",
    )
    step_time: Seconds = Field(
        default=30.0, gt=0, description="Each rate is held for whole turns, at least so long."
    )
    rest_time: Seconds = Field(
        default=0.0,
        ge=0,
        description="Length of a rest before each rate and after the last; 0: no rests.",
    )
    asymmetry_sd: RatioSd = Field(
        default=100e-6, ge=0, description="Sd of the asymmetry of the scale factors."
    )
    cubic_sd: RatioSd = Field(
        default=50e-6, ge=0, description="Sd of the cubic term at the fastest rate."
    )
    rate: Annotated[float, Quantity("frequency")] = Field(
        default=20.0, gt=0, description="Sample rate."
    )
    rows: Literal["samples", "means"] = Field(
        default="samples", description="A row per sample, or one mean per step."
    )


def simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> RateTableSimulation:
    """Simulate a session; what is wrong with table and fixture is drawn from the settings.

    `model`: errors of the instrument, asymmetry and cubic terms are drawn where it has none;
    `noise`: its noise [SI]; `seed`: seed of table, instrument and noise [1].
    """
    rng = np.random.default_rng([seed, 3])
    rates = in_si(settings.rates or session.rates)
    asymmetry = session.asymmetry_sd * rng.standard_normal(3)
    cubic = session.cubic_sd * rng.standard_normal(3) / max(float(np.abs(rates).max()), 1e-9) ** 2
    if not model.gyro_asymmetry.any():
        model = replace(model, gyro_asymmetry=asymmetry)
    if not model.gyro_cubic.any():
        model = replace(model, gyro_cubic=cubic)
    errors = TableErrors(
        settings.table_rate_sd * float(rng.standard_normal()),
        settings.rate_sd,
        settings.fixture_sd,
    )
    plan = RatePlan(settings.axes or session.axes, rates, session.step_time)
    if session.rest_time:
        plan = plan.with_rests(session.rest_time)
    return simulate_rate_table(
        plan, model=model, noise=noise, site=site, errors=errors, rate=session.rate,
        means=session.rows == "means", seed=seed,
    )  # fmt: skip
