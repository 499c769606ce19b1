"""Plain binary records: the same numbers again and again, nothing in between."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.logs.encoding import open_bytes, position
from foucault.logs.raw import BLOCK_ROWS, PIECE, Progress, RawTable

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a file of binary records, laid out as ``[log.record]`` says."""
    record = description.record
    if record is None:
        raise error("log.record_missing", file=path.name)
    order = "<" if record.byte_order == "little" else ">"
    types = [order + np.dtype(name).str[1:] for name in record.types()]
    dtype = np.dtype([(str(i), kind) for i, kind in enumerate(types)])
    names = dtype.names or ()
    skip = record.skip

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        size = max(1, path.stat().st_size)
        with open_bytes(path) as stream:
            for start in range(0, skip, PIECE):
                if not stream.read(min(PIECE, skip - start)):
                    break
            while data := stream.read(BLOCK_ROWS * dtype.itemsize):
                whole = len(data) // dtype.itemsize
                if len(data) % dtype.itemsize:
                    left = len(data) - whole * dtype.itemsize
                    raise error("log.record_cut", file=path.name, left=left, record=dtype.itemsize)
                rows = np.frombuffer(data, dtype)
                if progress:
                    progress(min(1.0, position(stream) / size))
                yield np.column_stack([rows[names[c]] for c in columns]).astype(np.float64)

    return RawTable(names, False, blocks)
