"""Settings that several procedures have: each with one meaning and one description.

A field that only is there is an annotated type, to which a table of a campaign gives its default.
What is done with a field is a method of the class that has it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationInfo

from foucault.errors import FoucaultError
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.strict import Strict
from foucault.units import AngleSd, Quantity, RatioSd, Seconds

Checked = TypeVar("Checked")

# -- of a calibration --------------------------------------------------------------------------

Quadratic = Annotated[bool, Field(description="Estimate the accelerometers' quadratic terms too.")]
Repeatability = Annotated[
    bool,
    Field(description="Estimate the scatter between readings that the noise does not explain."),
]
Window = Annotated[Seconds, Field(gt=0, description="Window of the rest detector.")]
Shortest = Annotated[Seconds, Field(gt=0, description="Shortest rest.")]
Threshold = Annotated[
    float | None,
    Field(
        gt=1,
        examples=[3.0],
        description="Level (1 = quiet) below which the instrument rests; default: from the data.",
    ),
]
RateSd = Annotated[
    RatioSd, Field(ge=0, description="Relative sd of the rate from one spin or step to the next.")
]
TableRateSd = Annotated[
    RatioSd, Field(ge=0, description="Relative sd of an error that all rates of the table share.")
]

# -- of a table ----------------------------------------------------------------------------------

PlumbSd = Annotated[
    AngleSd, Field(ge=0, description="Sd of the tilt of the outer axis, about each of two axes.")
]
OrthogonalitySd = Annotated[
    AngleSd, Field(ge=0, description="Sd of the angles between the table's axes.")
]
ZeroSd = Annotated[
    AngleSd, Field(ge=0, description="Sd of the zero errors of middle and inner angle.")
]
PositionSd = Annotated[
    AngleSd,
    Field(ge=0, description="Sd of the middle and inner angle from one position to the next."),
]

# -- of a simulated session ----------------------------------------------------------------------

RestTime = Annotated[Seconds, Field(gt=0, description="Length of each rest.")]
SampleRate = Annotated[float, Field(gt=0, description="Sample rate."), Quantity("frequency")]
Sampling = Annotated[
    Literal["rate", "increment"],
    Field(description="Instantaneous rates, or means over each interval."),
]
Rows = Annotated[
    Literal["samples", "means"],
    Field(description="A row per sample, or one mean per position, step or stop."),
]


class EarthRate(Strict):
    """Whether the Earth's rotation is modelled."""

    earth_rate: bool = True
    """Model the Earth's rotation where the latitude is given."""

    def where(self, site: Site) -> Site:
        """Return the site as it is modelled: without latitude where the Earth is not to turn."""
        return site if self.earth_rate else replace(site, latitude=None)


class Terms(Strict):
    """Which terms of the model of an IMU are estimated beside the linear ones."""

    accel_quadratic: Quadratic = False
    g_sensitivity: bool = False
    """Estimate the gyros' g-sensitivity too (9 more)."""

    def estimated(self, *, gyro: bool = True, turns: bool = True) -> tuple[str, ...]:
        """Return the names of all coefficients that are estimated.

        `gyro`: whether there are gyros; `turns`: whether they are turned, which shows their scale
        factors and misalignments.
        """
        families = ("accel.",) + (("gyro." if turns else "gyro.bias.",) if gyro else ())
        names = [n for n in LINEAR_LOWER if n.startswith(families)]
        more = ("accel.quadratic.",) * self.accel_quadratic
        more += ("gyro.g_sensitivity.",) * (self.g_sensitivity and gyro)
        return tuple(n for n in LAYOUT.names if n in names or n.startswith(more))


class Robust(Strict):
    """What is done with readings that contradict the others."""

    loss: Literal["robust", "squares"] = "robust"
    """robust: a reading that contradicts the others, beyond 3 sd, counts little or nothing;
    squares: all count in full."""

    @property
    def robust(self) -> bool:
        """Whether such readings are left out or weighted down."""
        return self.loss == "robust"


def located(info: ValidationInfo, check: Callable[[], Checked]) -> Checked:
    """Return what `check` does; where a file is read (`info` says so) its error names the key."""
    try:
        return check()
    except FoucaultError as problem:
        if "locate" in (info.context or ()):
            raise ValueError(problem) from None
        raise
