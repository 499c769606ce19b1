"""Run folders of an instrument over years, and records of them in either database."""

from __future__ import annotations

import dataclasses
import json
import sqlite3
from pathlib import Path

from foucault import run_folder
from foucault.records import Records
from make_compare import make_results


def make_runs(
    home: Path, n: int = 3, serial: str = "0042", seed: int = 3, folder: str = ""
) -> list[Path]:
    """Save `n` runs of the instrument `serial`, a year apart, below `home`."""
    out = []
    for i, result in enumerate(make_results(n, seed=seed)):
        named = result.instrument | {"name": "IMU", "serial": serial}
        path = home / (folder or f"{serial}-{2024 + i}")
        run_folder.save(dataclasses.replace(result, instrument=named), path)
        out.append(path)
    return out


def make_records(home: Path, n: int = 3) -> Records:
    """Return records in `home` that hold `n` runs of IMU 0042."""
    records = Records(home / "records.sqlite", make=True, who="ann")
    records.add(make_runs(home, n))
    return records


def tamper(file: Path, *lines: str) -> None:
    """Change a database behind the program's back, its triggers removed first."""
    with sqlite3.connect(file) as connection:
        for name in ("entry_no_update", "entry_no_delete"):
            connection.execute(f"DROP TRIGGER IF EXISTS {name}")
        for line in lines:
            connection.execute(line)
    connection.close()


def edit(folder: Path) -> None:
    """Change a number in the result.json of a run folder."""
    file = folder / run_folder.RESULT_FILE
    document = json.loads(file.read_text())
    document["coefficients"][0]["value"] *= 1.001
    file.write_text(json.dumps(document))
