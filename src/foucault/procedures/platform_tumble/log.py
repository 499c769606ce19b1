"""The log of a tumble and what its campaign file says: a command in the place of the gyros."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from foucault import logs
from foucault.arrays import FloatArray
from foucault.errors import Finding
from foucault.logs.description import LogDescription
from foucault.logs.reading import limits_si
from foucault.procedures.platform_tumble.settings import WHITE
from foucault.tables import Log

LOG_TABLE = Path(__file__).with_name("log.toml").read_text(encoding="utf-8")
"""[log] of the template, and of a simulated log."""

MEANS_TABLE = """\
[log]
file = "log.csv"                        # relative to this file; it says itself what it holds
"""
"""[log] of a simulated log of means: interval means, which no column and unit can describe."""

NOISE_LINES = f"""\
# Of the accelerometers, and of the drift of the gyros, which the log cannot show by itself.
[noise.accel]
white = "{WHITE[0]}"        # 1 ug in samples of 0.2 s
[noise.gyro]
white = "{WHITE[1]}"      # 0.05 deg/h in samples of 2 ms
"""
"""[noise] of the template."""

PRIOR_LINES = """\
# What is known beforehand of a coefficient, or of every coefficient of a group. Left out, all are
# zero, give or take what is usual: drift 1 deg/h, 0.5 deg/h/g and 0.01 deg/h/g^2, torquer scale
# factors 400 ppm, misalignments 120 arcsec, accelerometers 100 ug, 100 ppm and 100 ug/g^2.
# [prior]
# "gyro.drift" = { mean = "0 deg/h", sd = "5 deg/h" }
# "accel.scale.x" = { mean = "0 ppm", sd = "500 ppm" }
"""
"""[prior] of the template."""

ERRORS_LINE = '# errors = { "gyro.drift.x" = "2 deg/h", "accel.bias.y" = "50 ug" }'
"""Errors that are not drawn, in the template."""


class Description(LogDescription):
    """How to read the log of a tumble: a row without readings still has a command."""

    missing: Literal["mask", "error", "drop"] = Field(  # type: ignore[assignment]
        "mask",
        description='"mask" keeps rows whose accelerometers are missing, for their command; '
        '"error" refuses, "drop" leaves out rows with missing or infinite values',
    )


STILL = ("log.saturated", "log.stuck")
"""What a command is suspected of where it stands still, as it should."""


def log_table(log: Log | None = None) -> str:
    """Write the table [log] of the template, or for a simulated `log` [SI]."""
    return MEANS_TABLE if log is not None and log.sampled == "increment" else LOG_TABLE


def read_log(
    description: Description,
    folder: str | Path,
    progress: Callable[[float], None] | None = None,
) -> Log:
    """Read the log of a tumble; a command that stands still is no finding.

    `progress` or None: called with the fraction done, from 0 to 1.
    """
    log = logs.read(description, folder, progress)
    return replace(log, accel=_within(log.accel, description), findings=of_a_command(log.findings))


def _within(accel: FloatArray | None, description: Description) -> FloatArray | None:
    """Let readings at the declared limits be missing ones: how far beyond they were, is unknown."""
    limits = None if description.accel is None else limits_si(description.accel)
    if accel is None or limits is None:
        return accel
    slack = 1e-6 * (limits[:, 1] - limits[:, 0])
    clipped: npt.NDArray[np.bool_] = (accel <= limits[:, 0] + slack) | (
        accel >= limits[:, 1] - slack
    )
    rows = np.flatnonzero(clipped.any(axis=1))
    out = accel.copy()
    out[rows] = np.nan
    return out


def of_a_command(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return `findings` without those about gyros that say the same value for long: a command may.

    A gap is left to the procedure, which knows what was commanded.
    """
    return tuple(
        f for f in findings
        if f.code != "log.gap" and (f.code not in STILL or not f.message.startswith("gyro"))
    )  # fmt: skip
