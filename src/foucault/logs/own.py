"""Our own log files: columns of imu_log (`foucault.tables`) in SI, readable without description.

What a log says about the table that the instrument stands on, and rows that are means.
"""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import IO, Any, Literal, cast

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, error, require
from foucault.files import atomic
from foucault.tables import AXES, Log, TableColumns, declared, gaps

MARKER = "foucault imu log v1"
"""How our files begin to say what they are."""

METADATA_KEY = b"foucault"
"""Key of the marker in the metadata of a Parquet file."""

CALIBRATED = ", calibrated"
"""How the marker of a calibrated log ends."""

CALIBRATED_KEY = "foucault.calibrated_by"
"""Key of the remark that says which result made a calibrated log."""

ARRAY_KEY = "foucault"
"""Name of the array that holds the marker in a .npz file."""

ANGLES = ("outer", "middle", "inner")
"""Columns of the angles of a table."""

_ROWS = 1 << 18
_SAMPLED = ("rate", "increment")


def marker(sampled: str, calibrated: bool = False) -> str:
    """Return what a file says about itself: how it was `sampled`, and if it is `calibrated`."""
    return f"{MARKER}, sampled={sampled}, SI units{CALIBRATED if calibrated else ''}"


def sampled_of(text: str) -> Literal["rate", "increment"] | None:
    """Return how the log of a marker was sampled; None if the text is no marker of ours."""
    for sampled in _SAMPLED:
        if MARKER in text and f"sampled={sampled}" in text:
            return cast(Literal["rate", "increment"], sampled)
    return None


def describe(names: tuple[str, ...]) -> dict[str, Any]:
    """Return the blocks of a description for one of our files with these columns."""
    units = {column.name: column.unit for column in declared("imu_log")}
    blocks: dict[str, Any] = {"time": {"column": "time", "unit": units["time"]}}
    for triad in ("gyro", "accel", "mag"):
        columns = [f"{triad}_{axis}" for axis in AXES]
        if set(columns) <= set(names):
            blocks[triad] = {"columns": columns, "unit": units[columns[0]]}
    if "temperature" in names:
        blocks["temperature"] = {"column": "temperature", "unit": units["temperature"]}
    return blocks | _describe_table(names)


def _describe_table(names: tuple[str, ...]) -> dict[str, Any]:
    units = {column.name: column.unit for column in declared("table_log")}
    table: dict[str, Any] = {}
    if set(ANGLES) & set(names):
        table |= {"columns": [n if n in names else "" for n in ANGLES], "unit": units[ANGLES[0]]}
    if "table_rate" in names:
        table |= {"rate": "table_rate", "rate_unit": units["table_rate"]}
    if "position" in names:
        table["position"] = "position"
    blocks = {"table": table} if table else {}
    if "averaged" in names:
        blocks["averaged"] = {"column": "averaged", "unit": units["averaged"]}
    return blocks


def columns_of(log: Log) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of imu_log and table_log that a log has, each shape (n,) [SI].

    `log`: the log [SI].
    """
    out: dict[str, npt.NDArray[Any]] = dict(log.columns())
    if log.table is not None:
        angles = log.table.angles
        seen = [k for k in range(3) if np.isfinite(angles[:, k]).any()]
        out |= {ANGLES[k]: angles[:, k] for k in seen}
        if log.table.rate is not None:
            out["table_rate"] = log.table.rate
        if log.table.position is not None:
            out["position"] = log.table.position
    if log.averaged is not None:
        out["averaged"] = log.averaged
    return out


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
    require("log", log, Log)
    write_blocks([log], path)


def write_blocks(
    blocks: Iterable[Log], path: str | Path, remarks: Mapping[str, str] | None = None
) -> int:
    """Write a log that comes in blocks; no more than one of them is held (.npz: all).

    `blocks`: the log, piece by piece, at least one, all with the same columns [SI]; `remarks` or
    None: what else the file is to say: lines of a comment, or keys of the Parquet metadata.
    Returns number of samples written.
    """
    path = Path(path)
    for suffix, writer in _WRITERS.items():
        if path.name.lower().endswith(suffix):
            with atomic(path) as temporary:
                return writer(blocks, temporary, dict(remarks or {}))
    raise error("log.cannot_write", path=path, allowed=", ".join(_WRITERS))


def _batches(log: Log, schema: Any) -> Iterator[Any]:
    import pyarrow as pa

    columns = columns_of(log)
    for start in range(0, len(log), _ROWS):
        part = [np.ascontiguousarray(c[start : start + _ROWS]) for c in columns.values()]
        yield pa.record_batch(part, schema=schema)


def _opened(blocks: Iterable[Log], remarks: dict[str, str]) -> tuple[Any, Iterator[Log], str]:
    """Return the Arrow schema of the first block, all blocks, and the marker."""
    import pyarrow as pa

    rest = iter(blocks)
    first = next(rest)
    have = columns_of(first)
    fields = [
        pa.field(
            c.name,
            pa.int64() if c.name == "position" else pa.float64(),
            metadata={"unit": c.unit, "meaning": c.meaning},
        )
        for c in (*declared("imu_log"), *declared("table_log"))
        if c.name in have
    ]
    said = marker(first.sampled, calibrated=CALIBRATED_KEY in remarks)
    metadata = {METADATA_KEY: said.encode()} | {k: v.encode() for k, v in remarks.items()}
    return pa.schema(fields, metadata=metadata), chain([first], rest), said


def _write_csv(blocks: Iterable[Log], path: Path, remarks: dict[str, str]) -> int:
    with path.open("wb") as stream:
        return write_text_blocks(blocks, stream, remarks)


def _write_gzip(blocks: Iterable[Log], path: Path, remarks: dict[str, str]) -> int:
    # No name and no time inside, so that the same log gives the same bytes.
    with path.open("wb") as raw, gzip.GzipFile("", "wb", 6, raw, mtime=0) as stream:
        return write_text_blocks(blocks, cast(IO[bytes], stream), remarks)


def write_text_blocks(blocks: Iterable[Log], stream: IO[bytes], remarks: dict[str, str]) -> int:
    """Write a log that comes in blocks as text, each block as soon as it is there.

    `blocks`: the log, piece by piece [SI]; `remarks`: what else it says. Returns the number of
    samples written.
    """
    from pyarrow import csv

    schema, logs, said = _opened(blocks, remarks)
    lines = [f"# {said}", *(f"# {key}: {text}" for key, text in remarks.items())]
    stream.write("\n".join([*lines, ",".join(schema.names), ""]).encode())
    stream.flush()
    options = csv.WriteOptions(include_header=False)
    rows = 0
    with csv.CSVWriter(stream, schema, write_options=options) as writer:
        for log in logs:
            for batch in _batches(log, schema):
                writer.write_batch(batch)
            stream.flush()
            rows += len(log)
    return rows


def _write_parquet(blocks: Iterable[Log], path: Path, remarks: dict[str, str]) -> int:
    from pyarrow import parquet

    schema, logs, _ = _opened(blocks, remarks)
    rows = 0
    with parquet.ParquetWriter(path, schema, write_page_checksum=True) as writer:
        for log in logs:
            for batch in _batches(log, schema):
                writer.write_batch(batch)
            rows += len(log)
    return rows


def _write_npz(blocks: Iterable[Log], path: Path, remarks: dict[str, str]) -> int:
    _, logs, said = _opened(blocks, remarks)
    parts = [columns_of(log) for log in logs]
    arrays: dict[str, Any] = {k: np.concatenate([part[k] for part in parts]) for k in parts[0]}
    rows = len(arrays["time"])
    arrays[ARRAY_KEY] = np.array(
        "\n".join([said, *(f"{key}: {text}" for key, text in remarks.items())])
    )
    np.savez(path, allow_pickle=False, **arrays)
    return rows


_WRITERS = {
    ".csv": _write_csv,
    ".csv.gz": _write_gzip,
    ".parquet": _write_parquet,
    ".npz": _write_npz,
}


def whole_numbers(position: FloatArray, path: Path) -> FloatArray:
    """Refuse positions that are no whole numbers; an empty cell is -1.

    `position` (n,): numbers as in the file [1].
    """
    position = np.where(np.isnan(position), -1.0, position)
    wrong = position != np.rint(position)
    if wrong.any():
        raise error("log.position_number", file=path.name, value=f"{position[wrong][0]:g}")
    return np.maximum(position, -1.0)


def table_of(data: dict[str, FloatArray]) -> TableColumns | None:
    """Return what the blocks of a log say about the table, None where nothing.

    `data`: blocks by name, each shape (n,) [SI].
    """
    if not data.keys() & {*ANGLES, "table_rate", "position"}:
        return None
    none = np.full(len(data["time"]), np.nan)
    position = data.get("position")
    return TableColumns(
        np.column_stack([data.get(name, none) for name in ANGLES]),
        data.get("table_rate"),
        None if position is None else position.astype(np.int64),
    )


def angles_at_times(data: dict[str, FloatArray], apart: float) -> dict[str, FloatArray]:
    """Return the table angles at the times of their rows, from another instant of the interval.

    Between two rows an angle moves on evenly, by less than half a turn or, where the rate of the
    table is logged, by nearly what that says. Beside a gap it goes on as before.

    `data`: time and angles by name, each shape (n,) [SI]; `apart`: how many intervals the time of
    a row is after the instant of its angles [1].
    """
    time, turn = data["time"], 2 * np.pi
    step = np.diff(time)
    whole = ~gaps(step)
    out = {}
    for name in data.keys() & {*ANGLES}:
        moved = np.diff(data[name])
        told = np.zeros_like(moved)
        if name == "outer" and "table_rate" in data:
            told = 0.5 * (data["table_rate"][1:] + data["table_rate"][:-1]) * step
        moved -= turn * np.round((moved - told) / turn)
        moved[~whole] = np.nan
        after, before = np.append(moved, np.nan), np.append(np.nan, moved)
        near, other = (after, before) if apart > 0 else (before, after)
        move = np.where(np.isnan(near), other, near)
        out[name] = data[name] + apart * np.nan_to_num(move)
    return out


def joined_tables(tables: list[TableColumns]) -> TableColumns:
    """Put what logs say about the table one after the other; they tell the same columns."""

    def one(name: str) -> Any:
        parts = [getattr(table, name) for table in tables]
        return None if parts[0] is None else np.concatenate(parts)

    return TableColumns(one("angles"), one("rate"), one("position"))


def means_log(
    data: dict[str, FloatArray],
    kind: str,
    findings: tuple[Finding, ...],
    source: dict[str, Any],
) -> Log:
    """Make a log of rows that are means: nothing is known of what happened between them.

    `data`: blocks by name, each shape (n,) or (n, 3) [SI]; `kind`: means, or sums over the time
    of each row.
    """
    length = data["averaged"]
    wrong = np.flatnonzero(~(length > 0))
    if len(wrong):
        row = int(wrong[0])
        raise error("log.averaged", file=source.get("file", "the log"), row=row,
                    value=f"{length[row]:g}")  # fmt: skip
    if kind == "increment":
        for name in ("gyro", "accel"):
            if name in data:
                data[name] = data[name] / length[:, None]
    return Log(data["time"], data.get("gyro"), data.get("accel"), "rate", data.get("temperature"),
              findings, source, table_of(data), length, mag=data.get("mag"))  # fmt: skip
