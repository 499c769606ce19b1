"""Parquet files, read in batches so that the file is never in memory twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.logs.encoding import not_a_bomb
from foucault.logs.own import METADATA_KEY
from foucault.logs.raw import BLOCK_ROWS, Progress, RawTable, must_fit

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout


def open_raw(path: Path, description: FileLayout, progress: Progress | None) -> RawTable:
    """Open a Parquet file; its top-level columns are the columns of the log."""
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        schema = file.schema_arrow
    marker = (schema.metadata or {}).get(METADATA_KEY, b"").decode()

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        wanted = [schema.field(c) for c in columns]
        for field in wanted:
            _must_be_number(path, field)
        names = list(dict.fromkeys(field.name for field in wanted))
        done = 0
        # Otherwise whole columns of a row group, or of the file, would be fetched ahead.
        with parquet.ParquetFile(path, pre_buffer=False, buffer_size=1 << 20) as file:
            total = max(1, file.metadata.num_rows)
            claimed = 8.0 * total * len(names)
            not_a_bomb(claimed, path.stat().st_size)
            must_fit(path, claimed)
            for batch in file.iter_batches(BLOCK_ROWS, columns=names):
                done += batch.num_rows
                if progress:
                    progress(done / total)
                yield np.column_stack([_floats(batch.column(f.name)) for f in wanted])

    def words(column: int) -> Iterator[list[str]]:
        name = schema.field(column).name
        with parquet.ParquetFile(path, pre_buffer=False, buffer_size=1 << 20) as file:
            for batch in file.iter_batches(BLOCK_ROWS, columns=[name]):
                yield ["" if word is None else str(word) for word in batch.column(0).to_pylist()]

    return RawTable(tuple(schema.names), True, blocks, marker, words=words)


def _floats(column: Any) -> Any:
    import pyarrow as pa

    # Unsafe only in that an integer beyond 2^53 is rounded, as any float64 is.
    return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)


def _must_be_number(path: Path, field: Any) -> None:
    from pyarrow import types

    if not (types.is_integer(field.type) or types.is_floating(field.type)):
        raise error(
            "log.not_numeric",
            file=path.name,
            line="every row",
            column=field.name,
            cell=f"of type {field.type}",
            hint="",
        )
