"""What can be chosen of a session on the six faces, and what it estimates."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.procedures.fields import EarthRate, Strict
from foucault.tables import AXES
from foucault.units import AngleSd, Quantity, Seconds


class FaceSettings(EarthRate):
    """What can be chosen of rests on faces; procedures add their own."""

    placement_sd: AngleSd | None = Field(
        default=None,
        ge=0,
        examples=["5 arcmin"],
        description="How far a placement is off about each axis (block and support together). Left "
        "out: found from the residuals.",
    )
    accel_quadratic: bool = Field(
        default=False,
        description="Estimate the accelerometers' quadratic terms too: errors of placement look "
        "much the same.",
    )
    g_sensitivity: bool = Field(
        default=False, description="Estimate the gyros' g-sensitivity too (9 more)."
    )
    sections: dict[str, list[int]] | None = Field(
        default=None,
        examples=[{"x_p": [540, 1271], "x_a": [1620, 2361]}],
        description="First sample and the sample after the last of every rest, by name: x_p, x_a, "
        "y_p, y_a, z_p, z_a. Left out: found in the log.",
    )
    window: Seconds = Field(default=0.5, gt=0, description="Window of the rest detector.")
    shortest: Seconds = Field(default=1.0, gt=0, description="Shortest rest.")
    threshold: float | None = Field(
        default=None,
        gt=1,
        examples=[3.0],
        description="Level (1 = quiet) below which the instrument rests; default: from the data.",
    )


class FaceSession(Strict):
    """The session on faces that `simulate` makes."""

    rest_time: Seconds = Field(default=10.0, gt=0, description="Length of each rest.")
    move_time: Seconds = Field(
        default=2.0, gt=0, description="Length of the move from one face to the next."
    )
    rate: Annotated[float, Quantity("frequency")] = Field(
        default=100.0, gt=0, description="Sample rate."
    )
    kind: Literal["rate", "increment"] = Field(
        default="rate", description="Instantaneous rates, or means over each interval."
    )
    placement_sd: AngleSd = Field(
        default=0.0, ge=0, description="How far placements are off, about each of two axes."
    )


def names_of(settings: FaceSettings, turns: bool, gyro: bool = True) -> tuple[str, ...]:
    """Return the coefficients that are estimated.

    `turns`: whether there are turns, which show the gyros' scale factors and misalignments.
    """
    wanted = ["accel."] + (["gyro."] if gyro and turns else ["gyro.bias."] if gyro else [])
    names = [n for n in LINEAR_LOWER if n.startswith(tuple(wanted))]
    if settings.accel_quadratic:
        names += [f"accel.quadratic.{a}" for a in AXES]
    if settings.g_sensitivity and gyro:
        names += [n for n in LAYOUT.names if n.startswith("gyro.g_sensitivity.")]
    return tuple(n for n in LAYOUT.names if n in names)
