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

import hashlib
import io
import json
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.campaign.navigation.document import document
from foucault.campaign.navigation.tables import Columns, tables
from foucault.errors import error
from foucault.files import atomic, read_document, unwritable
from foucault.run_folder import REPORT_FILE, RESULT_FILE

if TYPE_CHECKING:
    from foucault.procedures.navigation import NavigationTest

SCHEMA = "foucault.navigation/1"
NAVIGATION_FILE = "navigation.json"


@dataclass(frozen=True)
class NavigationRecord:
    """What a navigation has found, as its folder keeps it.

    Attributes
    ----------
    about : dict
        What navigation.json says [SI].
    tables : dict of str to dict of str to ndarray
        Name of the table -> column -> values [SI].
    """

    about: Mapping[str, Any]
    tables: Mapping[str, Mapping[str, npt.NDArray[Any]]]


def record(test: NavigationTest) -> NavigationRecord:
    """Return what the folder of a navigation keeps.

    Parameters
    ----------
    test : NavigationTest
        What was found [SI].
    """
    return _record({"schema": SCHEMA} | document(test), tables(test))


def _record(about: Mapping[str, Any], made: Mapping[str, Columns]) -> NavigationRecord:
    arrays = {name: {c: np.asarray(v) for c, (v, _) in t.items()} for name, t in made.items()}
    return NavigationRecord(about, arrays)


def save(test: NavigationTest, folder: str | Path) -> NavigationRecord:
    """Write the folder of a navigation, without its report, whole or not at all.

    Parameters
    ----------
    test : NavigationTest
        What was found [SI].
    folder : str or Path
        Made where it does not exist; an earlier navigation in it is replaced.

    Returns
    -------
    NavigationRecord
        What was written.
    """
    folder = Path(folder)
    if (folder / RESULT_FILE).exists():
        raise error("navigate.folder", folder=folder)
    made, about = tables(test), {"schema": SCHEMA} | document(test)
    files = {f"{name}.parquet": _parquet(columns) for name, columns in made.items()}
    about["files"] = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    text = json.dumps(about, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:  # closed in reverse order, once everything is on the disk
            stack.enter_context(atomic(folder / NAVIGATION_FILE)).write_text(text, encoding="utf-8")
            for name, data in files.items():
                stack.enter_context(atomic(folder / name)).write_bytes(data)
        (folder / REPORT_FILE).unlink(missing_ok=True)  # it belongs to an earlier navigation
    except OSError as problem:
        raise unwritable(folder, problem) from problem
    return _record(about, made)


def load(folder: str | Path) -> NavigationRecord:
    """Read a folder back.

    Parameters
    ----------
    folder : str or Path
        The folder.
    """
    file = Path(folder) / NAVIGATION_FILE
    about = read_document(file, SCHEMA)
    read = {Path(n).stem: _table(file, n, digest) for n, digest in about["files"].items()}
    return NavigationRecord(about, read)


def _table(file: Path, name: str, digest: str) -> dict[str, npt.NDArray[Any]]:
    import pyarrow.parquet as pq

    where = {"file": file, "table": Path(name).stem, "path": name}
    try:
        data = (file.parent / name).read_bytes()
    except FileNotFoundError:
        raise error("result.table_missing", **where) from None
    if hashlib.sha256(data).hexdigest() != digest:
        raise error("result.table_changed", **where)
    table = pq.read_table(io.BytesIO(data))
    return {c: table.column(c).to_numpy() for c in table.column_names}


def _parquet(columns: Columns) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = [pa.field(n, pa.float64(), metadata={"unit": u}) for n, (_, u) in columns.items()]
    arrays = [pa.array(np.asarray(v, float)) for v, _ in columns.values()]
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), buffer)
    return buffer.getvalue()
