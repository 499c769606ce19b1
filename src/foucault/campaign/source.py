"""A log from a campaign or from a file alone, and what is said beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from foucault import logs, run_folder
from foucault.campaign.reading import load as load_campaign
from foucault.campaign.running import read_log, refuse_more
from foucault.campaign.tables import SiteTable
from foucault.errors import error
from foucault.files import sha256
from foucault.logs.description import LogDescription
from foucault.logs.titles import description_of
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures import Progress
from foucault.result import Result
from foucault.tables import Log


class White(Protocol):
    """White noise that is said beside a file [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]."""

    @property
    def gyro_white(self) -> float | None: ...
    @property
    def accel_white(self) -> float | None: ...


@dataclass(frozen=True)
class Source:
    """A log, and what its file says of it."""

    log: Log
    instrument: dict[str, Any]
    site: Mapping[str, Any]
    noise: ImuNoise | None


def calibration_of(path: Path) -> tuple[Result, dict[str, str]]:
    """Return the calibration of a run folder or result.json, with its file and hash."""
    result = run_folder.load_result(path, with_tables=False).numbers()
    file = path / run_folder.RESULT_FILE if path.is_dir() else path
    made = result.provenance | {"file": str(file)}
    return replace(result, provenance=made), {"file": str(file), "sha256": sha256(file)}


def read(path: Path, progress: Progress) -> Source:
    """Read a log, and what its file says of it."""
    if path.suffix != ".toml":
        description, told = description_of(path)
        description.whole()
        log = logs.read(description, path.parent, lambda part: progress(0.3 * part, "reading"))
        return Source(replace(log, findings=told + log.findings), {}, {}, None)
    campaign = load_campaign(path, calibrates=False)
    refuse_more(campaign, "what reads a log by itself")
    if isinstance(campaign.log, LogDescription):
        campaign.log.whole()
    log = read_log(campaign, lambda part, words: progress(0.3 * part, words))
    if not isinstance(log, Log):
        raise error("north.not_imu", procedure=campaign.procedure)
    return Source(log, campaign.instrument, campaign.tables.site.model_dump(), campaign.noise)


def site_of(given: Mapping[str, Any]) -> tuple[Site | None, float]:
    """Return the site and its longitude; no site where nothing is said of it."""
    longitude = float(given.get("longitude") or 0.0)
    if given.get("latitude") is None and given.get("gravity") is None:
        return None, longitude
    return SiteTable.model_validate(given).site(), longitude


def noise_of(said: White, noise: ImuNoise | None) -> ImuNoise | None:
    """Return the noise that a file declares, with what is said of it instead."""
    if said.gyro_white is None and said.accel_white is None:
        return noise
    start = noise or ImuNoise(TriadNoise(), TriadNoise())
    accel, gyro = start.accel, start.gyro
    if said.accel_white is not None:
        accel = replace(accel, white=said.accel_white)
    if said.gyro_white is not None:
        gyro = replace(gyro, white=said.gyro_white)
    return ImuNoise(accel, gyro)
