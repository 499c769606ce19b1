"""The tables of a campaign file, as pydantic models: every key, its kind and its meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import Field, create_model, model_validator

from foucault.errors import Finding, error, finding
from foucault.logs.description import LogDescription
from foucault.logs.layout import FileLayout
from foucault.models import earth, noise
from foucault.strict import Strict
from foucault.units import Quantity

GRAVITY_LIMITS = (9.7, 9.9)
"""Anything outside is a mistake: gravity on the surface lies in 9.764 .. 9.834 [m/s^2]."""

HEIGHT_LIMITS = (-500.0, 20e3)
"""From the lowest land to the highest aircraft; beyond, km were m or feet a mistake [m]."""

GRAVITY_ANOMALY = 500e-6
"""Largest believable departure from normal gravity, relative; anomalies reach 400 mGal."""


class Instrument(Strict):
    """What was calibrated; repeated in the result and the report."""

    name: str = ""
    """Make and model."""
    serial: str = ""
    """Serial number."""
    operator: str = ""
    """Who made the measurement."""
    due: str = ""
    """When it must be calibrated again."""
    note: str = ""
    """Anything else worth keeping, such as the temperature."""


class SiteTable(Strict):
    """Where it was calibrated."""

    latitude: Annotated[float, Quantity("angle")] | None = None
    """Geodetic latitude, positive north. Without it Earth rate is not modelled."""
    longitude: Annotated[float, Quantity("angle")] | None = None
    """Longitude, positive east; kept for the record."""
    height: Annotated[float, Quantity("length")] = 0.0
    """Height above the ellipsoid."""
    gravity: Annotated[float, Quantity("gravity")] | None = None
    """Local gravity; left out, normal gravity at latitude and height."""
    gravity_sd: Annotated[float, Quantity("gravity")] | None = Field(
        default=None, ge=0, examples=["0.0004 m/s^2"]
    )
    """Its standard uncertainty. Left out: that of the gravity model of the place, 40 mGal; a value
    of a gravimeter has its own, such as 0.00001 m/s^2."""

    @property
    def said(self) -> bool:
        """Whether a place or gravity is given."""
        return self.latitude is not None or self.gravity is not None

    def site(self) -> earth.Site:
        """Return the site, with normal gravity where none is given."""
        if self.latitude is not None and abs(self.latitude) > np.pi / 2:
            raise error("site.latitude", given=np.degrees(self.latitude))
        if not HEIGHT_LIMITS[0] <= self.height <= HEIGHT_LIMITS[1]:
            raise error("site.height", given=self.height)
        if self.gravity is None:
            if self.latitude is None:
                raise error("site.unknown")
            site = earth.Site.at(self.latitude, self.height)
        elif GRAVITY_LIMITS[0] <= self.gravity <= GRAVITY_LIMITS[1]:
            site = earth.Site(self.gravity, self.latitude, self.height)
        else:
            raise error("site.gravity", given=self.gravity)
        return site if self.gravity_sd is None else replace(site, gravity_sd=self.gravity_sd)

    def findings(self) -> tuple[Finding, ...]:
        """Compare gravity as given with normal gravity."""
        if self.gravity is None or self.latitude is None:
            return ()
        normal = earth.gravity(self.latitude, self.height)
        off = abs(self.gravity / normal - 1)
        if off < GRAVITY_ANOMALY:
            return ()
        return (finding("site.gravity_differs", given=self.gravity, normal=normal, ppm=off * 1e6),)


class _Noise(Strict):
    def over(self, start: noise.TriadNoise) -> noise.TriadNoise:
        """Replace in `start` what the file gives."""
        return replace(start, **self.model_dump(exclude_none=True))


class AccelNoise(_Noise):
    """Noise of the accelerometers."""

    white: Annotated[float, Quantity("velocity random walk")] | None = Field(default=None, ge=0)
    """Velocity random walk."""
    bias_instability: Annotated[float, Quantity("specific force")] | None = Field(
        default=None, ge=0
    )
    """Standard deviation of a first-order Markov bias."""
    correlation_time: Annotated[float, Quantity("time")] | None = Field(default=None, gt=0)
    """Correlation time of that bias."""
    random_walk: Annotated[float, Quantity("acceleration random walk")] | None = Field(
        default=None, ge=0
    )
    """Acceleration random walk."""
    quantisation: Annotated[float, Quantity("specific force")] | None = Field(default=None, ge=0)
    """Step of the output; of increments, that of the sum over the sample interval."""


class GyroNoise(_Noise):
    """Noise of the gyros."""

    white: Annotated[float, Quantity("angle random walk")] | None = Field(default=None, ge=0)
    """Angle random walk."""
    bias_instability: Annotated[float, Quantity("angular rate")] | None = Field(default=None, ge=0)
    """Standard deviation of a first-order Markov bias."""
    correlation_time: Annotated[float, Quantity("time")] | None = Field(default=None, gt=0)
    """Correlation time of that bias."""
    random_walk: Annotated[float, Quantity("rate random walk")] | None = Field(default=None, ge=0)
    """Rate random walk."""
    quantisation: Annotated[float, Quantity("angular rate")] | None = Field(default=None, ge=0)
    """Step of the output; of increments, that of the sum over the sample interval."""


class NoiseTable(Strict):
    """Noise of the sensors, where it is known better than the rests can tell."""

    grade: str | None = Field(default=None, json_schema_extra={"enum": [*noise.GRADES, None]})
    """Start from a typical class."""
    accel: AccelNoise | None = None
    gyro: GyroNoise | None = None

    def noise(self) -> noise.ImuNoise:
        """Return the noise: the grade, with what is given for accel and gyro replaced."""
        if self.grade is None and self.accel is None and self.gyro is None:
            raise error("noise.empty", allowed=", ".join(noise.GRADES))
        start = (
            noise.ImuNoise() if self.grade is None else noise.grade(self.grade, "noise.grade").noise
        )
        return noise.ImuNoise(
            start.accel if self.accel is None else self.accel.over(start.accel),
            start.gyro if self.gyro is None else self.gyro.over(start.gyro),
        )


class PriorEntry(Strict):
    """What is known of a coefficient, or of every coefficient of a group, beforehand."""

    mean: str = Field(description="Expected value with its unit.", examples=["0 deg/h"])
    sd: str = Field(description="Standard deviation with its unit.", examples=["10 deg/h"])


class SimulateTable(Strict):
    """How `foucault simulate` makes the instrument."""

    seed: int = Field(default=1, ge=0)
    """Seed of every random number."""
    grade: str = Field(default="mems", json_schema_extra={"enum": list(noise.GRADES)})
    """Typical class its errors and noise are drawn from."""
    errors: dict[str, str] = Field(default={}, examples=[{"gyro.bias.x": "30 deg/h"}])
    """Coefficients set to a value instead of drawn."""

    @model_validator(mode="before")
    @classmethod
    def _join(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and isinstance(raw.get("errors"), dict):
            return raw | {"errors": joined(raw["errors"])}
        return raw


class CampaignFile(Strict):
    """A campaign of Foucault."""

    instrument: Instrument = Instrument()
    site: SiteTable = SiteTable()
    log: LogDescription
    master: dict[str, Any] = Field(default={})
    procedure: dict[str, Any]
    noise: NoiseTable | None = None
    prior: dict[str, PriorEntry] = Field(default={})
    simulate: dict[str, Any] = Field(default={})
    optimise: dict[str, Any] = Field(default={})

    @model_validator(mode="before")
    @classmethod
    def _join(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and isinstance(raw.get("prior"), dict):
            return raw | {"prior": joined(raw["prior"])}
        return raw

    def __reduce__(self) -> tuple[Any, ...]:
        # A class that is made on the fly has no name by which pickle could find it.
        return _empty_with, (type(self).model_fields["log"].annotation,), self.__getstate__()


def _empty_with(log: type[FileLayout]) -> CampaignFile:
    model = file_with(log)
    return model.__new__(model)


@cache
def file_with(log: type[FileLayout]) -> type[CampaignFile]:
    """Return the model of a campaign file whose [log] is described by `log`."""
    if log is LogDescription:
        return CampaignFile
    return create_model("CampaignFile", __base__=CampaignFile, log=(log, ...))


def joined(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Undo TOML's nesting of ``gyro.bias = ...`` written without quotes."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and value and not {"mean", "sd"} & value.keys():
            out |= joined(value, f"{before}{key}.")
        else:
            out[before + key] = value
    return out
