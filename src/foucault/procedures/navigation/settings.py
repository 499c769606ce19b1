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


@dataclass(frozen=True)
class Settings:
    """How a log is aligned and navigated.

    Attributes
    ----------
    align : float or None
        How long the start is a rest [s]; None finds the first rest.
    method : {"inertial_frame", "two_vector", "kalman"}
        How it is aligned.
    heading, pitch, roll : float or None
        Start attitude, where it is given [rad].
    heading_sd, level_sd : float
        Standard deviation of the heading, of pitch and roll that are given [rad].
    vertical : {"free", "held", "aided"} or None
        Vertical channel; None: held at a known site, aided where heights are known, else free.
    gaps : {"stop", "bridge"}
        What is done where samples are missing.
    start, end : float or None
        Part of the log that is used, from its start [s].
    still : bool
        Whether it never left the site, whatever the readings say.
    rate : float
        Rows a second of the trajectory that is kept [Hz].
    """

    align: float | None = None
    method: Method = "inertial_frame"
    heading: float | None = None
    pitch: float | None = None
    roll: float | None = None
    heading_sd: float = HEADING_SD
    level_sd: float = LEVEL_SD
    vertical: Literal["free", "held", "aided"] | None = None
    gaps: Literal["stop", "bridge"] = "stop"
    start: float | None = None
    end: float | None = None
    still: bool = False
    rate: float = 10.0

    def __post_init__(self) -> None:
        given = {k: getattr(self, k) is not None for k in ("heading", "pitch", "roll")}
        whole = all(given.values()) or not any(given.values())
        if not whole and (given["pitch"] or given["roll"]):
            raise error(
                "navigate.attitude",
                given=", ".join(f"--{k}" for k, is_given in given.items() if is_given),
                missing=", ".join(f"--{k}" for k, is_given in given.items() if not is_given),
            )

    @property
    def attitude_given(self) -> bool:
        """Whether heading, pitch and roll are given."""
        return self.pitch is not None
