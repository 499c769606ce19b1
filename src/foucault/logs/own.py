"""Our own log files: columns of `foucault.tables.IMU_LOG` in SI, readable without description."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal, cast

import numpy as np

from foucault.errors import error
from foucault.files import atomic
from foucault.tables import AXES, IMU_LOG, Log

if TYPE_CHECKING:
    pass

MARKER = "foucault imu log v1"
"""How our files begin to say what they are."""

METADATA_KEY = b"foucault"
"""Key of the marker in the metadata of a Parquet file."""

ARRAY_KEY = "foucault"
"""Name of the array that holds the marker in a .npz file."""

_ROWS = 1 << 18
_SAMPLED = ("rate", "increment")


def marker(sampled: str) -> str:
    """Return what a file says about itself."""
    return f"{MARKER}, sampled={sampled}, SI units"


def sampled_of(text: str) -> Literal["rate", "increment"] | None:
    """Return how the log of a marker was sampled; None if the text is no marker of ours."""
    for sampled in _SAMPLED:
        if MARKER in text and f"sampled={sampled}" in text:
            return cast(Literal["rate", "increment"], sampled)
    return None


def describe(names: tuple[str, ...]) -> dict[str, Any]:
    """Return the blocks of a description for one of our files with these columns."""
    units = {column.name: column.unit for column in IMU_LOG}
    blocks: dict[str, Any] = {"time": {"column": "time", "unit": units["time"]}}
    for triad in ("gyro", "accel"):
        columns = [f"{triad}_{axis}" for axis in AXES]
        if set(columns) <= set(names):
            blocks[triad] = {"columns": columns, "unit": units[columns[0]]}
    if "temperature" in names:
        blocks["temperature"] = {"column": "temperature", "unit": units["temperature"]}
    return blocks


def write(log: Log, path: str | Path) -> None:
    """Write a log as CSV, gzipped CSV, Parquet or .npz, by suffix, whole or not at all.

    Every float64 is written so that reading it back gives the same bits.

    Parameters
    ----------
    log : Log
        The log [SI].
    path : str or Path
        ``.csv``, ``.csv.gz``, ``.parquet`` or ``.npz``.
    """
    path = Path(path)
    for suffix, writer in _WRITERS.items():
        if path.name.lower().endswith(suffix):
            with atomic(path) as temporary:
                writer(log, temporary)
            return
    raise error("log.cannot_write", path=path, allowed=", ".join(_WRITERS))


def _batches(log: Log, schema: Any) -> Iterator[Any]:
    import pyarrow as pa

    columns = log.columns()
    for start in range(0, len(log), _ROWS):
        part = [np.ascontiguousarray(c[start : start + _ROWS]) for c in columns.values()]
        yield pa.record_batch(part, schema=schema)


def _schema(log: Log) -> Any:
    import pyarrow as pa

    have = log.columns()
    fields = [
        pa.field(c.name, pa.float64(), metadata={"unit": c.unit, "meaning": c.meaning})
        for c in IMU_LOG
        if c.name in have
    ]
    return pa.schema(fields, metadata={METADATA_KEY: marker(log.sampled).encode()})


def _write_csv(log: Log, path: Path) -> None:
    with path.open("wb") as stream:
        _write_text(log, stream)


def _write_gzip(log: Log, path: Path) -> None:
    # No name and no time inside, so that the same log gives the same bytes.
    with path.open("wb") as raw, gzip.GzipFile("", "wb", 6, raw, mtime=0) as stream:
        _write_text(log, cast(IO[bytes], stream))


def _write_text(log: Log, stream: IO[bytes]) -> None:
    from pyarrow import csv

    schema = _schema(log)
    stream.write(f"# {marker(log.sampled)}\n{','.join(schema.names)}\n".encode())
    options = csv.WriteOptions(include_header=False)
    with csv.CSVWriter(stream, schema, write_options=options) as writer:
        for batch in _batches(log, schema):
            writer.write_batch(batch)


def _write_parquet(log: Log, path: Path) -> None:
    from pyarrow import parquet

    schema = _schema(log)
    with parquet.ParquetWriter(path, schema) as writer:
        for batch in _batches(log, schema):
            writer.write_batch(batch)


def _write_npz(log: Log, path: Path) -> None:
    arrays: dict[str, Any] = dict(log.columns())
    arrays[ARRAY_KEY] = np.array(marker(log.sampled))
    np.savez(path, allow_pickle=False, **arrays)


_WRITERS = {
    ".csv": _write_csv,
    ".csv.gz": _write_gzip,
    ".parquet": _write_parquet,
    ".npz": _write_npz,
}
