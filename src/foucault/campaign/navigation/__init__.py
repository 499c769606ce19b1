"""Navigate a log from a file: a campaign, a log of ours, or one whose titles carry the units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from foucault.campaign.source import calibration_of, noise_of, read, site_of
from foucault.errors import error
from foucault.logs import reference as references
from foucault.logs.reference import Reference
from foucault.procedures import Progress, silent
from foucault.procedures.navigation import NavigationTest, navigate_log
from foucault.procedures.navigation.settings import Settings


@dataclass(frozen=True)
class Said:
    """What is said beside the log; it goes before what a campaign file says."""

    # keys of [site]: latitude, longitude [rad], height [m], gravity [m/s^2]
    site: Mapping[str, Any] = field(default_factory=dict)
    settings: Settings = field(default_factory=Settings)  # what can be chosen
    # gyro_white, accel_white: white noise [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]
    gyro_white: float | None = None
    accel_white: float | None = None
    serial: str = ""  # serial number of the instrument


def run(
    log: str | Path,
    said: Said | None = None,
    *,
    calibration: str | Path | None = None,
    reference: str | Path | None = None,
    progress: Progress = silent,
) -> NavigationTest:
    """Navigate the log of a file.

    `log`: a campaign file of any procedure, for its log, site, noise and instrument, a log that
    Foucault has written, or a file whose titles carry the units; `said` or None: what is said
    beside it; `calibration` or None: run folder or result.json of the calibration; `reference` or
    None: file of positions, velocities or angles of the same clock; `progress`: called with the
    fraction done and what is being done. Returns trajectories, errors, contributions [SI].
    """
    said = said or Said()
    # What is wrong with the small files shows before a long log is read.
    result, known = (None, {}) if calibration is None else calibration_of(Path(calibration))
    truth: Reference | None = None if reference is None else references.read(reference)
    source = read(Path(log), progress)
    where = {**source.site, **said.site}
    if said.settings.position_sd is not None:
        _whole_place(where)
    site, longitude = site_of(where)
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


def _whole_place(where: Mapping[str, Any]) -> None:
    """Refuse a position of the start that is not whole."""
    missing = [f"--{k}" for k in ("latitude", "longitude", "height") if where.get(k) is None]
    if missing:
        raise error("navigate.position", missing=" and ".join(missing))
