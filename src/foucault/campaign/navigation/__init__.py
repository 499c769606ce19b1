"""Navigate a log from a file: a campaign, a log of ours, or one whose titles carry the units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from foucault import logs, run_folder
from foucault.campaign.reading import load as load_campaign
from foucault.campaign.running import read_log
from foucault.campaign.tables import SiteTable
from foucault.errors import error
from foucault.files import sha256
from foucault.logs import reference as references
from foucault.logs.reference import Reference
from foucault.logs.titles import description_of
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures.hand_rotated import Progress, silent
from foucault.procedures.navigation import NavigationTest, navigate_log
from foucault.procedures.navigation.settings import Settings
from foucault.result import Result
from foucault.tables import Log


@dataclass(frozen=True)
class Said:
    """What is said beside the log; it goes before what a campaign file says.

    Attributes
    ----------
    site : mapping
        Keys of [site]: latitude, longitude [rad], height [m], gravity [m/s^2].
    settings : Settings
        What can be chosen.
    gyro_white, accel_white : float or None
        White noise [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)].
    serial : str
        Serial number of the instrument.
    """

    site: Mapping[str, Any] = field(default_factory=dict)
    settings: Settings = field(default_factory=Settings)
    gyro_white: float | None = None
    accel_white: float | None = None
    serial: str = ""


@dataclass(frozen=True)
class Source:
    """A log, and what its file says of it."""

    log: Log
    instrument: dict[str, Any]
    site: Mapping[str, Any]
    noise: ImuNoise | None


def run(
    log: str | Path,
    said: Said | None = None,
    *,
    calibration: str | Path | None = None,
    reference: str | Path | None = None,
    progress: Progress = silent,
) -> NavigationTest:
    """Navigate the log of a file.

    Parameters
    ----------
    log : str or Path
        A campaign file of any procedure, for its log, site, noise and instrument; a log that
        Foucault has written; or a file whose titles carry the units.
    said : Said or None
        What is said beside it.
    calibration : str, Path or None
        Run folder or result.json of the calibration.
    reference : str, Path or None
        File of positions, velocities or angles of the same clock.
    progress : callable
        Called with the fraction done and what is being done.

    Returns
    -------
    NavigationTest
        Trajectories, errors, contributions [SI].
    """
    said = said or Said()
    # What is wrong with the small files shows before a long log is read.
    result, known = (None, {}) if calibration is None else calibration_of(Path(calibration))
    truth: Reference | None = None if reference is None else references.read(reference)
    source = read(Path(log), progress)
    site, longitude = site_of({**source.site, **said.site})
    instrument = source.instrument | ({"serial": said.serial} if said.serial else {})
    found = navigate_log(
        source.log, site=site, longitude=longitude, settings=said.settings,
        noise=noise_of(said, source.noise), calibration=result, reference=truth,
        instrument=instrument,
        progress=lambda part, words: progress(0.3 + 0.6 * part, words),
    )  # fmt: skip
    made = found.provenance | {
        "calibration": known,
        "reference": {} if truth is None else truth.source,
    }
    return replace(found, provenance=made)


def calibration_of(path: Path) -> tuple[Result, dict[str, str]]:
    """Return the calibration of a run folder or result.json, with its file and hash."""
    result = run_folder.load_result(path, with_tables=False)
    file = path / run_folder.RESULT_FILE if path.is_dir() else path
    made = result.provenance | {"file": str(file)}
    return replace(result, provenance=made), {"file": str(file), "sha256": sha256(file)}


def read(path: Path, progress: Progress) -> Source:
    """Read a log, and what its file says of it."""
    if path.suffix != ".toml":
        description, told = description_of(path)
        log = logs.read(description, path.parent, lambda part: progress(0.3 * part, "reading"))
        return Source(replace(log, findings=told + log.findings), {}, {}, None)
    campaign = load_campaign(path, calibrates=False)
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


def noise_of(said: Said, noise: ImuNoise | None) -> ImuNoise | None:
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
