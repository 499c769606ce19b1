"""NumPy files: one array (.npy) or several by name (.npz)."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.logs.encoding import not_a_bomb
from foucault.logs.own import ARRAY_KEY
from foucault.logs.raw import BLOCK_ROWS, Progress, RawTable, must_fit

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

Array = npt.NDArray[Any]

PACKED = 1100
"""Zip makes nothing smaller than by this factor [1]."""


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a .npy or .npz file; pickled objects are refused."""
    with path.open("rb") as stream:
        if stream.read(2) == b"PK":
            arrays = _unpacked(stream, path)
            marker = str(arrays.pop(ARRAY_KEY, ""))
            return from_arrays(path, arrays, description.variable, progress, marker)
    loaded = np.load(path, allow_pickle=False, mmap_mode="r")
    return from_arrays(path, {"": loaded}, None, progress)


def _unpacked(stream: IO[bytes], path: Path) -> dict[str, Array]:
    """Return the arrays of a .npz file, none larger than it can hold packed."""
    arrays, size, whole = {}, path.stat().st_size, 0.0
    with zipfile.ZipFile(stream) as parts:
        for info in parts.infolist():
            with parts.open(info) as part:
                version = np.lib.format.read_magic(part)
                header = np.lib.format.read_array_header_1_0 if version == (1, 0) else (
                    np.lib.format.read_array_header_2_0)  # fmt: skip
                shape, _, dtype = header(part)
                claimed = math.prod(shape) * dtype.itemsize
            if claimed > min(info.file_size, PACKED * size):
                raise ValueError(f"'{info.filename}' claims more numbers than it holds")
            whole += claimed
            not_a_bomb(whole, size)
            must_fit(path, claimed)
            with parts.open(info) as part:
                name = info.filename.removesuffix(".npy")
                arrays[name] = np.lib.format.read_array(part, allow_pickle=False)
    return arrays


def from_arrays(
    path: Path,
    arrays: Mapping[str, Array],
    variable: str | None,
    progress: Progress | None,
    marker: str = "",
) -> RawTable:
    """Make columns of the arrays of a file.

    `arrays`: arrays by name, each shape (n,), (n, k) or (k, n): samples run along the longer side
    [1]; `variable`: the one array to use, if None all arrays with as many samples as the longest;
    `progress` or None: called with the fraction read, from 0 to 1; `marker`: what the file says
    about itself if this package wrote it. Returns columns by number for one matrix, ``name``,
    ``name.0``, ``name.1`` ... for several.
    """
    tables = {n: t for n, a in arrays.items() if (t := _samples_first(a)) is not None}
    if variable is not None:
        if variable not in tables:
            hint, allowed = suggestion(variable, tables), ", ".join(tables)
            raise error("log.variable", file=path.name, name=variable, hint=hint, allowed=allowed)
        tables = {variable: tables[variable]}
    rows = max((len(t) for t in tables.values()), default=0)
    if rows == 0:
        raise error("log.empty", file=path.name)
    columns: dict[str, Array] = {}
    longest = {n: t for n, t in tables.items() if len(t) == rows}
    for name, table in longest.items():
        columns |= _named_columns(name, table, alone=len(longest) == 1)
    series = list(columns.values())

    def blocks(wanted: Sequence[int]) -> Iterator[FloatArray]:
        for start in range(0, rows, BLOCK_ROWS):
            part = [series[c][start : start + BLOCK_ROWS] for c in wanted]
            if progress:
                progress(min(1.0, (start + BLOCK_ROWS) / rows))
            yield np.column_stack(part).astype(np.float64)

    return RawTable(tuple(columns), not all(map(str.isdigit, columns)), blocks, marker)


def _samples_first(array: Array) -> Array | None:
    numeric = array.dtype.names is not None or array.dtype.kind in "iuf"
    if not numeric or array.ndim not in (1, 2) or array.size == 0:
        return None
    return array.T if array.ndim == 2 and array.shape[0] < array.shape[1] else array


def _named_columns(name: str, table: Array, alone: bool) -> dict[str, Array]:
    if table.dtype.names is not None:
        return {field: table[field].reshape(len(table)) for field in table.dtype.names}
    if table.ndim == 1:
        return {name or "0": table}
    if table.shape[1] == 1 and not alone:
        return {name: table[:, 0]}
    prefix = "" if alone else f"{name}."
    return {f"{prefix}{i}": table[:, i] for i in range(table.shape[1])}
