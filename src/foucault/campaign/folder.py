"""The folder that a command leaves: one document, its tables, and both whole or not at all.

The document is replaced last and knows the hashes of the tables.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.errors import error
from foucault.files import atomic, unwritable
from foucault.run_folder import REPORT_FILE

Columns = Mapping[str, tuple[Any, str]]
"""Name of a column -> its values and their SI unit."""


def write(
    folder: Path, file: str, about: Mapping[str, Any], files: Mapping[str, bytes] | None = None
) -> dict[str, Any]:
    """Write a document and the files that belong to it; remove the report of an earlier one.

    `about`: what it says, as plain values, hashes of `files` are added under "files"; `files`:
    contents of the other files by name, None for a document that has none.
    """
    told = dict(about)
    if files is not None:
        told["files"] = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    text = json.dumps(told, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:  # closed in reverse order, once everything is on the disk
            stack.enter_context(atomic(folder / file)).write_text(text, encoding="utf-8")
            for name, data in (files or {}).items():
                stack.enter_context(atomic(folder / name)).write_bytes(data)
        (folder / REPORT_FILE).unlink(missing_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from problem
    return told


def read_table(file: Path, name: str, digest: str) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a table beside a document."""
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


def parquet(columns: Columns) -> bytes:
    """Return a table as a Parquet file that carries the units.

    `columns`: values and unit of each column [SI].
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [pa.array(v) for v, _ in columns.values()]
    fields = [
        pa.field(name, array.type, metadata={"unit": unit})
        for (name, (_, unit)), array in zip(columns.items(), arrays, strict=True)
    ]
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), buffer)
    return buffer.getvalue()


def as_arrays(columns: Columns) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a table without their units.

    `columns`: values and unit of each column [SI].
    """
    return {name: np.asarray(values) for name, (values, _) in columns.items()}
