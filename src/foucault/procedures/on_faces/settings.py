"""What can be chosen of a session on the six faces, and what it estimates."""

from __future__ import annotations

from pydantic import Field

from foucault.procedures import fields
from foucault.strict import Strict
from foucault.units import AngleSd, Seconds


class FaceSettings(fields.EarthRate, fields.Terms):
    """What can be chosen of rests on faces; procedures add their own."""

    placement_sd: AngleSd | None = Field(default=None, ge=0, examples=["5 arcmin"])
    """How far a placement is off about each axis (block and support together). Left out: found from
    the residuals."""
    accel_quadratic: bool = False
    """Estimate the accelerometers' quadratic terms too: errors of placement look much the same."""
    sections: dict[str, list[int]] | None = Field(
        default=None, examples=[{"x_p": [540, 1271], "x_a": [1620, 2361]}]
    )
    """First sample and the sample after the last of every rest, by name: x_p, x_a, y_p, y_a, z_p,
    z_a. Left out: found in the log."""
    window: fields.Window = 0.5
    shortest: fields.Shortest = 1.0
    threshold: fields.Threshold = None


class FaceSession(Strict):
    """The session on faces that `simulate` makes."""

    rest_time: fields.RestTime = 10.0
    move_time: Seconds = Field(default=2.0, gt=0)
    """Length of the move from one face to the next."""
    rate: fields.SampleRate = 100.0
    kind: fields.Sampling = "rate"
    placement_sd: AngleSd = Field(default=0.0, ge=0)
    """How far placements are off, about each of two axes."""
