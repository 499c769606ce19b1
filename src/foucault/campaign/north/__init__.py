"""Find north from a file: a campaign of a north seeker, or readings whose titles say all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault.campaign.reading import load as load_campaign
from foucault.campaign.running import read_log
from foucault.campaign.source import calibration_of, noise_of
from foucault.campaign.tables import SiteTable
from foucault.errors import error, finding
from foucault.logs import indexed
from foucault.logs.indexed_own import description_of
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.procedures import Progress, silent
from foucault.procedures.north_seeking.fix import Survey, find_north
from foucault.procedures.north_seeking.settings import Settings
from foucault.result import Result
from foucault.tables import IndexedLog

PROCEDURE = "north_seeking"


@dataclass(frozen=True)
class Said:
    """What is said beside the readings; it goes before what a campaign file says."""

    site: Mapping[str, Any]  # keys of [site]: latitude [rad], height [m], gravity [m/s^2]
    settings: Mapping[str, Any]  # keys of [procedure] [SI]
    # gyro_white, accel_white: white noise [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]
    gyro_white: float | None = None
    accel_white: float | None = None
    reads: str | None = None  # sign of the accelerometers of readings without a campaign
    serial: str = ""  # serial number of the instrument


@dataclass(frozen=True)
class _Read:
    """Readings, and what their file says of them."""

    log: IndexedLog
    instrument: dict[str, Any]
    site: Mapping[str, Any]
    settings: Settings
    noise: ImuNoise | None
    prior: Mapping[str, tuple[float, float]]


def run(
    readings: str | Path,
    said: Said | None = None,
    *,
    calibration: str | Path | None = None,
    progress: Progress = silent,
) -> Survey:
    """Find the heading of every set-up of a file.

    `readings`: a campaign file, or a CSV or Parquet file whose titles carry the units; `said` or
    None: what is said beside it; `calibration` or None: run folder or result.json of the
    calibration; `progress`: called with the fraction done and what is being done. Returns the
    solution of all set-ups [SI].
    """
    said, path = said or Said({}, {}), Path(readings)
    # A wrong calibration shows before a long log is read.
    known: dict[str, str] = {}
    result: Result | None = None
    if calibration is not None:
        result, known = calibration_of(Path(calibration))
    read = _campaign(path, said, progress) if path.suffix == ".toml" else _bare(path, said)
    settings = Settings.model_validate(read.settings.model_dump() | dict(said.settings))
    instrument = read.instrument | ({"serial": said.serial} if said.serial else {})
    survey = find_north(
        read.log, site=_site(read, said, settings), settings=settings,
        noise=_noise(read, said), calibration=result, prior=read.prior, instrument=instrument,
        progress=progress,
    )  # fmt: skip
    findings = survey.findings
    if survey.compensation.serial and not instrument.get("serial"):
        findings += (finding("north.whose", serial=survey.compensation.serial),)
    made = survey.provenance | {"settings": settings.model_dump(), "calibration": known}
    return replace(survey, findings=findings, provenance=made)


def _campaign(path: Path, said: Said, progress: Progress) -> _Read:
    campaign = load_campaign(path)
    if campaign.procedure != PROCEDURE:
        raise error("north.other_campaign", file=path, given=campaign.procedure)
    if said.reads is not None:
        raise error("north.reads_declared", file=path)
    log = read_log(campaign, progress)
    return _Read(
        log, campaign.instrument, campaign.tables.site.model_dump(), campaign.settings,
        campaign.noise, campaign.prior,
    )  # fmt: skip


def _bare(path: Path, said: Said) -> _Read:
    description, told = description_of(path, said.reads)
    log = indexed.read(description, path.parent)
    return _Read(replace(log, findings=told + log.findings), {}, {}, Settings(), None, {})


def _site(read: _Read, said: Said, settings: Settings) -> Site:
    site = {**read.site, **said.site}
    if read.log.latitude is not None and site.get("latitude") is None:
        return _of_log(read.log, site)
    if settings.unknown_latitude and site.get("gravity") is None and site.get("latitude") is None:
        raise error("north.fix_gravity")
    if not settings.unknown_latitude and site.get("latitude") is None:
        raise error("north.fix_latitude")
    return SiteTable.model_validate(site).site()


def _of_log(log: IndexedLog, site: Mapping[str, Any]) -> Site:
    """Return the place of the first set-up, where the log alone says the latitudes."""
    assert log.latitude is not None
    known = np.isfinite(log.latitude)
    said = set(log.setup[known].tolist())
    without = [name for k, name in enumerate(log.names) if k not in said]
    if without:
        raise error("north.place_missing", count=len(without), name=without[0])
    first = float(log.latitude[np.argmax(known)])
    return SiteTable.model_validate({**site, "latitude": first}).site()


def _noise(read: _Read, said: Said) -> ImuNoise | None:
    if read.noise is None:
        for given, mine, missing, other in (
            ("gyro", said.gyro_white, "accelerometers", said.accel_white),
            ("accelerometers", said.accel_white, "gyro", said.gyro_white),
        ):
            needed = missing == "gyro" or read.log.accel is not None
            if mine is not None and other is None and needed:
                raise error("north.noise_half", given=given, missing=missing)
    return noise_of(said, read.noise)
