"""Align the log of a file: a campaign, a log of ours, or one whose titles carry the units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from foucault.campaign.navigation import Said
from foucault.campaign.source import calibration_of, noise_of, read, site_of
from foucault.errors import error
from foucault.navigate.align import Method
from foucault.procedures import Progress, silent
from foucault.procedures.alignment import Comparison, align_log


@dataclass(frozen=True)
class Window:
    """Which part of a log is aligned, and how.

    Attributes
    ----------
    methods : sequence of str
        Methods; none for all that fit.
    start, end : float or None
        The rest, from the start of the log [s].
    rests : sequence of (float, float)
        Rests at different headings [s].
    gyro_bias_sd, accel_bias_sd : float or None
        How well the biases are known [rad/s], [m/s^2].
    gaps : {"stop", "bridge"}
        What is done where samples are missing.
    """

    methods: Sequence[Method] = ()
    start: float | None = None
    end: float | None = None
    rests: Sequence[tuple[float, float]] = field(default_factory=tuple)
    gyro_bias_sd: float | None = None
    accel_bias_sd: float | None = None
    gaps: Literal["stop", "bridge"] = "stop"


def run(
    log: str | Path,
    said: Said,
    window: Window,
    *,
    calibration: str | Path | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Align the log of a file.

    Parameters
    ----------
    log : str or Path
        A campaign file of any procedure, a log that Foucault has written, or a file whose titles
        carry the units.
    said : Said
        Site and noise, before what a campaign says of them.
    window : Window
        Which part, and how.
    calibration : str, Path or None
        Run folder or result.json of the calibration.
    progress : callable
        Called with the fraction done and what is being done.
    """
    result, _ = (None, {}) if calibration is None else calibration_of(Path(calibration))
    found = read(Path(log), progress)
    site, _ = site_of({**found.site, **said.site})
    if site is None:
        raise error("alignment.no_latitude")
    progress(0.5, "aligning")
    return align_log(
        found.log, site=site, methods=window.methods, start=window.start, end=window.end,
        rests=window.rests, noise=noise_of(said, found.noise), gyro_bias_sd=window.gyro_bias_sd,
        accel_bias_sd=window.accel_bias_sd, calibration=result, gaps=window.gaps,
    )  # fmt: skip
