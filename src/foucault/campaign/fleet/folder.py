"""The folder of a fleet, written and read back.

::

    fleet.json                          what was asked, versions, counts, broken instruments
    fleet.parquet                       a row per instrument
    report.html                         the summary page, written by `report.fleet`
    campaign.toml                       the campaign with every default filled in
    instruments/SERIAL/result.json ...  a run folder per instrument
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from foucault import run_folder
from foucault.campaign.fleet.table import FleetTable, Row
from foucault.campaign.folder import parquet, read_table, write
from foucault.campaign.reading import Campaign
from foucault.campaign.tolerance import Tolerance
from foucault.campaign.writing import resolved
from foucault.errors import FoucaultError
from foucault.files import read_document
from foucault.result import provenance

SCHEMA = "foucault.fleet/1"
FLEET_FILE, TABLE_FILE, INSTRUMENTS = "fleet.json", "fleet.parquet", "instruments"


def save(
    table: FleetTable, campaign: Campaign, folder: Path, *, batch: bool, seconds: float
) -> dict[str, Any]:
    """Write what is said of all instruments together.

    `table`: the instruments, whose run folders are written already [SI]; `seconds`: how long it
    took [s].
    """
    text = resolved(campaign, folder).encode()
    made = {k: v for k, v in provenance({}, seconds).items() if k != "input"}
    document = table.document() | {
        "schema": SCHEMA,
        "procedure": campaign.procedure,
        "solved_in_batch": int(table.good.sum()) if batch else 0,
        "campaign": {"file": run_folder.CAMPAIGN_FILE, "sha256": hashlib.sha256(text).hexdigest()},
        "tolerance": None if table.tolerance is None else table.tolerance.as_json(),
        "provenance": made,
    }
    files = {TABLE_FILE: parquet(table.columns()), run_folder.CAMPAIGN_FILE: text}
    return write(folder, FLEET_FILE, document, files)


def about(folder: str | Path) -> dict[str, Any]:
    """Return what fleet.json in a folder says."""
    return read_document(Path(folder) / FLEET_FILE, SCHEMA)


def load(folder: str | Path) -> tuple[FleetTable, dict[str, Any]]:
    """Return the instruments of a folder as they were decided [SI], and what fleet.json says.

    Raises A file is missing, was changed, or is of another schema.
    """
    folder = Path(folder)
    said = about(folder)
    columns = read_table(folder / FLEET_FILE, TABLE_FILE, said["files"][TABLE_FILE])
    broken = {p["serial"]: FoucaultError(p["code"], p["message"], p["cure"])
              for p in said["broken"]}  # fmt: skip
    rows = []
    for serial, where in zip(columns["serial"], columns["folder"], strict=True):
        if serial in broken:
            rows.append(Row.broken(serial, broken[serial]))
            continue
        page = f"{where}/{run_folder.REPORT_FILE}"
        result = run_folder.load_result(folder / where)
        rows.append(Row.of(serial, result, where, page if (folder / page).is_file() else ""))
    names = [n.removeprefix("sd.") for n in columns if n.startswith("sd.")]
    given = said["tolerance"]
    tolerance = None if given is None else Tolerance.from_json(given)
    return FleetTable.of(names, rows).decided(tolerance), said
