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
    """Which part of a log is aligned, and how."""

    methods: Sequence[Method] = ()  # methods; none for all that fit
    # start, end: the rest, from the start of the log [s]
    start: float | None = None
    end: float | None = None
    # rests at different headings [s]
    rests: Sequence[tuple[float, float]] = field(default_factory=tuple)
    # gyro_bias_sd, accel_bias_sd: how well the biases are known [rad/s], [m/s^2]
    gyro_bias_sd: float | None = None
    accel_bias_sd: float | None = None
    gaps: Literal["stop", "bridge"] = "stop"  # what is done where samples are missing


def run(
    log: str | Path,
    said: Said,
    window: Window,
    *,
    calibration: str | Path | None = None,
    progress: Progress = silent,
) -> Comparison:
    """Align the log of a file.

    `log`: a campaign file of any procedure, a log that Foucault has written, or a file whose
    titles carry the units; `said`: site and noise, before what a campaign says of them;
    `calibration` or None: run folder or result.json of the calibration; `progress`: called with
    the fraction done and what is being done.
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
