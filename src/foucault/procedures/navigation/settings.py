"""What can be chosen where a log is navigated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from foucault.errors import error

Method = Literal["inertial_frame", "two_vector", "kalman"]

LEVEL_SD = float(np.radians(0.02))
"""Standard deviation of a pitch or roll that is given without one [rad]."""

HEADING_SD = float(np.radians(0.2))
"""Standard deviation of a heading that is given without one [rad]."""

VELOCITY_SD = 0.1
"""Standard deviation of each component of a velocity that is given without one [m/s]."""


@dataclass(frozen=True)
class Settings:
    """How a log is aligned and navigated."""

    align: float | None = None  # how long the start is a rest [s]; None finds the first rest
    method: Method = "inertial_frame"  # how it is aligned
    # heading, pitch, roll: start attitude, where it is given [rad]
    heading: float | None = None
    pitch: float | None = None
    roll: float | None = None
    # heading_sd, level_sd: standard deviation of the heading, of pitch and roll that are given
    # [rad]
    heading_sd: float = HEADING_SD
    level_sd: float = LEVEL_SD
    # velocity at the start, east, north, up, where it is given; it needs the attitude [m/s]
    velocity: tuple[float, float, float] | None = None
    # standard deviation of each component of it, or of that of a reference; None: `VELOCITY_SD`
    # where a velocity is given, else zero [m/s]
    velocity_sd: float | None = None
    # standard deviation of the place, along each of east, north and up: the run starts at the site,
    # not where a reference is. None: the place is taken as exact [m]
    position_sd: float | None = None
    # vertical channel; None: held at a known site, aided where heights are known, else free
    vertical: Literal["free", "held", "aided"] | None = None
    gaps: Literal["stop", "bridge"] = "stop"  # what is done where samples are missing
    # start, end: part of the log that is used, from its start [s]
    start: float | None = None
    end: float | None = None
    still: bool = False  # whether it never left the site, whatever the readings say
    rate: float = 10.0  # rows a second of the trajectory that is kept [Hz]

    def __post_init__(self) -> None:
        given = {k: getattr(self, k) is not None for k in ("heading", "pitch", "roll")}
        whole = all(given.values()) or not any(given.values())
        if not whole and (given["pitch"] or given["roll"]):
            raise error(
                "navigate.attitude",
                given=", ".join(f"--{k}" for k, is_given in given.items() if is_given),
                missing=", ".join(f"--{k}" for k, is_given in given.items() if not is_given),
            )
        moving = [k for k in ("velocity", "velocity_sd") if getattr(self, k) is not None]
        if moving and not all(given.values()):
            raise error("navigate.velocity", given="--" + moving[0].replace("_", "-"))

    @property
    def attitude_given(self) -> bool:
        """Whether heading, pitch and roll are given."""
        return self.pitch is not None

    @property
    def start_velocity_sd(self) -> float:
        """Standard deviation of each component of the velocity at a start in motion [m/s]."""
        if self.velocity_sd is not None:
            return self.velocity_sd
        return 0.0 if self.velocity is None else VELOCITY_SD
