"""A session on a rate table: what can be chosen of its calibration, and how one is simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from foucault import units
from foucault.arrays import FloatArray
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.procedures import fields
from foucault.simulate.rate_table import (
    RatePlan,
    RateTableSimulation,
    TableErrors,
    simulate_rate_table,
)
from foucault.strict import Strict
from foucault.tables import AXES
from foucault.units import AngleSd, RatioSd, Seconds

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
        fields.located(info, lambda: in_si(rates))
        return rates


class Settings(_Rates, fields.Robust, fields.EarthRate):
    """What can be chosen; the defaults suit most tables."""

    rates: tuple[str, ...] = ()
    """Rates of the table in each placement, in order, counter-clockwise seen from above positive;
    needed where the log carries no rate of the table. Rests between rates above 0.2 deg/s need not
    be listed."""
    axes: tuple[Axis, ...] = ()
    """Placements in order, such as x up; needed where the log has no accelerometers, checked where
    it has. An axis that is not named is not estimated."""
    asymmetry: bool = True
    """Estimate the asymmetry of each scale factor (3 more)."""
    cubic: bool = True
    """Estimate the cubic term of each scale factor (3 more)."""
    g_sensitivity: bool = False
    """Estimate the gyros' g-sensitivity too (9 more); needs every axis up and down."""
    rate_sd: fields.RateSd = 0.0
    table_rate_sd: fields.TableRateSd = 0.0
    fixture_sd: AngleSd = Field(default=0.0, ge=0)
    """Sd of the tilt of the instrument in each placement, about each level axis."""
    repeatability: fields.Repeatability = True
    shortest: fields.Shortest = 5.0

    @property
    def placed(self) -> tuple[str, ...]:
        """Axes of the instrument that were along the spin axis: all, unless `axes` names some."""
        return tuple(a for a in AXES if not self.axes or any(p.startswith(a) for p in self.axes))


class Session(_Rates):
    """The session that `simulate` makes."""

    rates: tuple[str, ...] = (
        "10 deg/s",
        "-10 deg/s",
        "25 deg/s",
        "-25 deg/s",
        "50 deg/s",
        "-50 deg/s",
        "100 deg/s",
        "-100 deg/s",
    )
    """Rates in each placement, unless [procedure] lists them."""
    axes: tuple[Axis, ...] = ("x up", "x down", "y up", "y down", "z up", "z down")
    """Placements, unless [procedure] lists them."""
    step_time: Seconds = Field(default=30.0, gt=0)
    """Each rate is held for whole turns, at least so long."""
    rest_time: Seconds = Field(default=0.0, ge=0)
    """Length of a rest before each rate and after the last; 0: no rests."""
    asymmetry_sd: RatioSd = Field(default=100e-6, ge=0)
    """Sd of the asymmetry of the scale factors."""
    cubic_sd: RatioSd = Field(default=50e-6, ge=0)
    """Sd of the cubic term at the fastest rate."""
    rate: fields.SampleRate = 20.0
    rows: fields.Rows = "samples"


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
