"""Find the time offset of two files: what they hold is described, or told by their titles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from foucault.campaign.running import opened, read_whole
from foucault.campaign.tables import Said, validate
from foucault.errors import error
from foucault.estimate.delay import BRACKET
from foucault.files import said_in
from foucault.logs import master as masters
from foucault.logs.checks import beside_another, on_a_shared_clock
from foucault.logs.layout import FileLayout
from foucault.logs.master import MasterDescription
from foucault.logs.raw import open_raw
from foucault.models.rotation import matrix_of
from foucault.models.transfer import MasterTable
from foucault.procedures import Progress, silent
from foucault.procedures.delay import FoundDelay, find_delay
from foucault.tables import Log

_HEADINGS = ("heading", "yaw", "trueheading", "true heading")


def run(
    slave: str | Path,
    master: str | Path | None = None,
    *,
    said: Said | None = None,
    mounting: tuple[float, float, float] | None = None,
    bracket: tuple[float, float] | None = BRACKET,
    progress: Progress = silent,
) -> FoundDelay:
    """Find the offset of two files.

    `slave`: a campaign file, for its log, a log that Foucault has written, or a file whose titles
    carry the units; `master`: a file with [master] or [log] in it, a table of a master or a log
    whose titles carry the units. None where the first file describes both; `said` or None: what is
    known of logs without a campaign; `mounting` or None: heading, pitch and roll of the slave in
    the axes of the master [rad]; `bracket`: where the offset lies [s], None for as far as they
    overlap; `progress`: called with the fraction done and what is being done.
    """
    said = said or Said()
    slave = Path(slave)
    with beside_another():
        case = opened(slave, said, None, progress)
    log = case.log
    other: Log | MasterTable | None = getattr(log, "master", None)
    if other is not None:  # such a log has told what was noticed of its master
        log = replace(log, findings=tuple(f for f in log.findings if f not in other.findings))
    names = slave.name, slave.name if master is None else Path(master).name
    if master is not None:
        other = _second(Path(master), said, lambda part, words: progress(0.4 + part, words))
    if other is None:
        raise error("delay.no_second", file=slave.name)
    if isinstance(other, Log) and log.source.get("sha256", 0) == other.source.get("sha256"):
        raise error("delay.same_log", file=slave.name)
    latitude = case.site.get("latitude")
    if isinstance(other, MasterTable) and not other.has_place and latitude is not None:
        other = other.from_place(latitude, case.site.get("height") or 0.0)
    progress(0.8, "matching")
    C_ms = None if mounting is None else np.asarray(matrix_of(*mounting))
    log = replace(log, findings=on_a_shared_clock(log.findings))
    return find_delay(log, other, C_ms=C_ms, bracket=bracket, names=names)


def _second(path: Path, said: Said, progress: Progress) -> Log | MasterTable:
    """Read a master, or a second log."""
    if path.suffix == ".toml" and path.is_file():
        tables = said_in(path, "campaign.syntax", path=path)
        if isinstance(tables.get("master"), dict):
            described = validate(MasterDescription, tables["master"], ("master",))
            return masters.read(described, path.parent)
    if path.suffix == ".toml":
        return read_whole(path, progress)[0]
    raw = open_raw(path, FileLayout.model_validate({"file": path.name}))
    if any(title.partition("(")[0].strip().lower() in _HEADINGS for title in raw.names):
        return masters.read(MasterDescription.model_validate({"file": path.name}), path.parent)
    return read_whole(path, progress, said.log)[0]
