"""A file of any format as columns of plain numbers, before they mean anything.

Each format has one module with one function, ``open_raw(path, description, progress)``, which
returns a `RawTable`. The table hands out its rows in blocks, so that no more than one block
exists beside the finished log.
"""

from __future__ import annotations

import difflib
import gzip
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

from foucault.errors import Finding, FoucaultError, error
from foucault.tables import FloatArray

if TYPE_CHECKING:
    from foucault.logs.layout import FileLayout

Progress = Callable[[float], None]
"""Called with the fraction done, from 0 to 1."""

BLOCK_ROWS = 1 << 18
"""Rows per block where the format leaves the choice to us."""


@dataclass(frozen=True)
class RawTable:
    """Columns of a file, not yet read.

    Attributes
    ----------
    names : tuple of str
        Name of each column; its number from 0 where the file has no names.
    named : bool
        Whether the names come from the file.
    blocks : callable
        ``columns -> iterator`` of ndarray, shape (m, len(columns)): the rows of these columns,
        in the order of the file [as in the file].
    marker : str
        What the file says about itself if this package wrote it, else empty.
    stamps : tuple of int
        Numbers of the columns that hold dates, handed out in seconds since 1970 [1].
    findings : tuple of Finding
        What was noticed of the file before its rows.
    words : callable or None
        ``column -> iterator`` of lists of str: the cells of one column as text, in the order of
        the file; None where the format holds numbers only.
    """

    names: tuple[str, ...]
    named: bool
    blocks: Callable[[Sequence[int]], Iterator[FloatArray]]
    marker: str = ""
    stamps: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()
    words: Callable[[int], Iterator[list[str]]] | None = None


_MODULES = {
    "csv": "delimited",
    "text": "delimited",
    "parquet": "parquet",
    "npy": "numpy_arrays",
    "npz": "numpy_arrays",
    "mat": "matlab",
    "binary": "binary",
}
_SUFFIXES = {
    ".csv": "csv",
    ".tsv": "csv",
    ".txt": "text",
    ".log": "text",
    ".dat": "text",
    ".asc": "text",
    ".imu": "text",
    ".parquet": "parquet",
    ".pq": "parquet",
    ".npy": "npy",
    ".npz": "npz",
    ".mat": "mat",
    ".bin": "binary",
}


def open_raw(path: Path, description: FileLayout, progress: Progress | None = None) -> RawTable:
    """Open a log file of any format.

    Parameters
    ----------
    path : Path
        The file.
    description : FileLayout
        How it is laid out.
    progress : callable or None
        Called with the fraction read, from 0 to 1.

    Returns
    -------
    RawTable
        Its columns, not yet read.
    """
    _must_exist(path)
    name = _format(path, description)
    module = import_module(f"foucault.logs.{_MODULES[name]}")
    try:
        table: RawTable = module.open_raw(path, description, progress)
    except FoucaultError:
        raise
    except Exception as problem:  # each library raises its own types for a damaged file
        raise unreadable(path, name, problem) from problem
    return replace(table, blocks=_guarded(table, path, name))


def _guarded(
    table: RawTable, path: Path, name: str
) -> Callable[[Sequence[int]], Iterator[FloatArray]]:
    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        try:
            yield from table.blocks(columns)
        except (FoucaultError, MemoryError):
            raise
        except Exception as problem:
            raise unreadable(path, name, problem) from problem

    return blocks


def unreadable(path: Path, name: str, problem: Exception) -> FoucaultError:
    """Build the error for a damaged file, or one of another format than it claims."""
    reason = " ".join(str(problem).split()) or type(problem).__name__
    return error("log.unreadable", file=path.name, format=name, reason=reason[:200].rstrip("."))


def _must_exist(path: Path) -> None:
    if path.is_file():
        return
    there = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
    near = difflib.get_close_matches(path.name, there, n=3, cutoff=0.5)
    near += [n for n in there if Path(n).stem == path.stem and n not in near]
    hint = f" The folder has {', '.join(near)}." if near else ""
    what = "is a folder, not a file" if path.is_dir() else "does not exist"
    raise error("log.missing_file", path=path, what=what, hint=hint)


def _format(path: Path, description: FileLayout) -> str:
    if description.format != "auto":
        return description.format
    if description.record is not None:
        return "binary"
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    known = _SUFFIXES.get(plain.suffix.lower())
    if known:
        return known
    with open_bytes(path) as stream:
        start = stream.read(4096)
    if start[:4] == b"PAR1":
        return "parquet"
    if is_text(start):
        return "text"
    raise error("log.format_unknown", file=path.name)


def is_text(start: bytes) -> bool:
    """Tell whether the first bytes of a file look like text."""
    return not any(byte < 9 or 13 < byte < 32 for byte in start)


def open_bytes(path: Path) -> IO[bytes]:
    """Open a file for reading, unpacked if it is gzip by content, whatever its suffix."""
    stream = path.open("rb")
    magic = stream.read(2)
    stream.seek(0)
    if magic != b"\x1f\x8b":
        return stream
    stream.close()
    return cast(IO[bytes], gzip.open(path, "rb"))
