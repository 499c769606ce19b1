"""The folder of a navigation: everything found, and enough to write its report again.

::

    navigation.json             start, growth, terms, contributions, checks, findings [SI, rad]
    trajectory.parquet          the trajectory, with the calibration where one was given
    trajectory_without.parquet  the same without it
    errors.parquet              errors at the epochs of the reference, and their predicted sd
    budget.parquet              what every coefficient, alignment and noise contribute over time
    terms.parquet               terms of free inertial drift over time
    report.html                 for people, written by `report.navigation`

navigation.json is replaced last and knows the hashes of the tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.campaign.folder import Columns, as_arrays, parquet, read_table, write
from foucault.campaign.navigation.document import document
from foucault.campaign.navigation.tables import tables
from foucault.errors import error
from foucault.files import read_document
from foucault.run_folder import RESULT_FILE

if TYPE_CHECKING:
    from foucault.procedures.navigation import NavigationTest

SCHEMA = "foucault.navigation/1"
NAVIGATION_FILE = "navigation.json"


@dataclass(frozen=True)
class NavigationRecord:
    """What a navigation has found, as its folder keeps it."""

    about: Mapping[str, Any]  # what navigation.json says [SI]
    # name of the table -> column -> values [SI]
    tables: Mapping[str, Mapping[str, npt.NDArray[Any]]]


def record(test: NavigationTest) -> NavigationRecord:
    """Return what the folder of a navigation keeps.

    `test`: what was found [SI].
    """
    return _record({"schema": SCHEMA} | document(test), tables(test))


def _record(about: Mapping[str, Any], made: Mapping[str, Columns]) -> NavigationRecord:
    return NavigationRecord(about, {name: as_arrays(columns) for name, columns in made.items()})


def save(test: NavigationTest, folder: str | Path) -> NavigationRecord:
    """Write the folder of a navigation, without its report, whole or not at all.

    `test`: what was found [SI]; `folder`: made where it does not exist, an earlier navigation in
    it is replaced.
    """
    folder = Path(folder)
    if (folder / RESULT_FILE).exists():
        raise error("navigate.folder", folder=folder)
    made = tables(test)
    # Read back as real numbers, whatever they were counted in.
    files = {
        f"{name}.parquet": parquet({n: (np.asarray(v, float), u) for n, (v, u) in columns.items()})
        for name, columns in made.items()
    }
    about = write(folder, NAVIGATION_FILE, {"schema": SCHEMA} | document(test), files)
    return _record(about, made)


def load(folder: str | Path) -> NavigationRecord:
    """Read a folder back."""
    file = Path(folder) / NAVIGATION_FILE
    about = read_document(file, SCHEMA)
    read = {Path(n).stem: read_table(file, n, digest) for n, digest in about["files"].items()}
    return NavigationRecord(about, read)
