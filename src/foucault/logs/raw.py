"""A file of any format as columns of plain numbers, before they mean anything.

Each format has one function, ``open_csv(path, description, progress)`` or so, in `text` or
`formats`, which returns a `RawTable`. The table hands out its rows in blocks, so that no more than
one block exists beside the finished log. A format that says what its columns are also returns the
blocks of a description that say it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error
from foucault.files import free_memory
from foucault.logs.dialect import is_text, open_text
from foucault.logs.layout import FORMATS, FileLayout
from foucault.logs.own import describe, sampled_of

Progress = Callable[[float], None]
"""Called with the fraction done, from 0 to 1."""

PIECE = 1 << 20
"""A file is asked for no more at once, whatever it says of its length [bytes]."""

COPIES = 2
"""A log is in memory so many times while it is read, at least [1]."""

LOOK_AGAIN = 1.5
"""Memory is looked at again when a log has grown by this: asking the system takes a while [1]."""

BLOCK_ROWS = 1 << 18
"""Rows per block where the format leaves the choice to us."""


def _not_told() -> float:
    """Return 0.0: how far the reading is, where the format does not tell it."""
    return 0.0


@dataclass(frozen=True)
class RawTable:
    """Columns of a file, not yet read."""

    names: tuple[str, ...]  # name of each column; its number from 0 where the file has no names
    named: bool  # whether the names come from the file
    # ``columns -> iterator`` of ndarray, shape (m, len(columns)): the rows of these columns, in the
    # order of the file [as in the file]
    blocks: Callable[[Sequence[int]], Iterator[FloatArray]]
    marker: str = ""  # what the file says about itself if this package wrote it, else empty
    # numbers of the columns that hold dates, handed out in seconds since 1970 [1]
    stamps: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()  # what was noticed of the file before its rows
    # ``column -> iterator`` of arrays of strings of pyarrow: the cells of one column as text, in
    # the order of the file; None where the format holds numbers only
    words: Callable[[int], Iterator[Any]] | None = None
    # blocks of a description, as [log] has them, that the file or its format says itself; a unit
    # may be open
    declared: Mapping[str, Any] | None = None
    # what the readings are, where the file or its format says it
    sampled: Literal["rate", "increment"] | None = None
    # fraction of the file that the blocks handed out so far come from [1]
    done: Callable[[], float] = _not_told

    @property
    def described(self) -> bool:
        """Whether the file itself says all that a description must."""
        said = self.declared or {}
        triads = [said[name] for name in ("gyro", "accel") if name in said]
        return bool(triads) and all("unit" in triad for triad in triads)


_SUFFIXES = {suffix: name for name, kind in FORMATS.items() for suffix in kind.suffixes.split()}
_SENTENCES = {
    "novatel": re.compile(rb"(?m)^[#%](?:RAWIMU|CORRIMU)\w*A,"),
    "vectornav": re.compile(rb"(?m)^\$VNIMU,"),
}
DATAFLASH = b"\xa3\x95\x80"
"""How a log of ArduPilot begins: the description of its own descriptions."""

ROS_FOLDER = "metadata.yaml"
"""A folder with this file is a bag of ROS 2."""


def open_raw(path: Path, description: FileLayout, progress: Progress | None = None) -> RawTable:
    """Open a log file of any format.

    `progress` or None: called with the fraction read, from 0 to 1.
    """
    must_exist(path)
    done = [0.0]

    def watched(fraction: float) -> None:
        done[0] = fraction
        if progress:
            progress(fraction)

    with reading(path, "gzip"):
        name = _format(path, description)
    with reading(path, name):
        table: RawTable = _function(FORMATS[name].opens)(path, description, watched)
    return replace(of_own(table), blocks=_guarded(table, path, name), done=lambda: done[0])


@contextmanager
def reading(path: Path, name: str) -> Iterator[None]:
    """Let a file that ends its reader be one error, whatever type each library raises.

    `name`: the format that it is read in.
    """
    try:
        yield
    except FoucaultError:
        raise
    except MemoryError as problem:
        raise too_large(path, path.stat().st_size, free_memory()) from problem
    except Exception as problem:
        raise unreadable(path, name, problem) from problem


def _function(name: str) -> Callable[..., Any]:
    module, _, function = name.partition(".")
    found: Callable[..., Any] = getattr(import_module(f"foucault.logs.{module}"), function)
    return found


def instruments(path: Path) -> list[str]:
    """Return the topics of the instruments in the file of a vehicle, one for each, else none."""
    must_exist(path)
    name = format_of(path)
    if not name or not FORMATS[name].names:
        return []
    with reading(path, name):
        found: list[str] = _function(FORMATS[name].names)(path)
    return found


def library(name: str, extra: str, path: Path) -> Any:
    """Load the library that reads a format; what brings it stands in the error where it is missing.

    `extra`: the extra of this package that installs it; `path`: the file that wants it, for the
    text.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError:
        raise error("log.library", file=path.name, name=name.partition(".")[0],
                    extra=extra) from None  # fmt: skip


def of_own(table: RawTable) -> RawTable:
    """Return a table with what its marker declares, if this package wrote it."""
    sampled = sampled_of(table.marker)
    if sampled is None:
        return table
    return replace(table, declared=describe(table.names), sampled=sampled)


def _guarded(
    table: RawTable, path: Path, name: str
) -> Callable[[Sequence[int]], Iterator[FloatArray]]:
    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        with reading(path, name):
            yield from table.blocks(columns)

    return blocks


def in_blocks(
    columns: Mapping[str, npt.NDArray[Any]], progress: Progress | None
) -> Callable[[Sequence[int]], Iterator[FloatArray]]:
    """Return what hands out `columns`, each shape (n,), block by block."""
    each = list(columns.values())

    def blocks(some: Sequence[int]) -> Iterator[FloatArray]:
        for start in range(0, len(each[0]), BLOCK_ROWS):
            if progress:
                progress(min(1.0, (start + BLOCK_ROWS) / len(each[0])))
            part = [each[c][start : start + BLOCK_ROWS] for c in some]
            yield np.column_stack(part).astype(np.float64, copy=False)

    return blocks


def kept(raw: RawTable, path: Path) -> RawTable:
    """Return a table whose rows will all be kept, refused as soon as they cannot be."""

    def blocks(columns: Sequence[int]) -> Iterator[FloatArray]:
        held, looked = 0, 0.0
        for rows in raw.blocks(columns):
            held += rows.nbytes
            if held > LOOK_AGAIN * looked:
                looked = held
                must_fit(path, held / (raw.done() or 1.0), held)
            yield rows

    return replace(raw, blocks=blocks)


def together(
    parts: Iterable[Mapping[str, FloatArray]], raw: RawTable, path: Path
) -> dict[str, FloatArray]:
    """Return columns that are read piece by piece as one.

    `parts`: pieces, name of each column -> its rows [SI]; `raw`, `path`: where they come from.
    """
    data: dict[str, FloatArray] = {}
    count = 0
    for part in parts:
        end = count + len(next(iter(part.values())))
        if not data or end > len(next(iter(data.values()))):
            # As many as the file seems to hold; pages that are never written are never taken.
            room = int(1.1 * end / (raw.done() or 0.5)) + 1
            for name, values in part.items():
                larger = np.empty((room, *values.shape[1:]))
                if count:
                    larger[:count] = data[name][:count]
                data[name] = larger
        for name, values in part.items():
            data[name][count:end] = values
        count = end
    if not count:
        raise error("log.empty", file=path.name)
    return {name: values[:count] for name, values in data.items()}


def must_fit(path: Path, size: float, held: float = 0.0) -> None:
    """Refuse a log that memory cannot hold.

    `size`: all its numbers [bytes]; `held`: those that are in memory already [bytes].
    """
    free = free_memory() + held
    if COPIES * size > free:
        raise too_large(path, COPIES * size, free)


def too_large(path: Path, need: float, free: float) -> FoucaultError:
    """Build the error for a log that memory cannot hold.

    `need`: what it needs [bytes]; `free`: what is free [bytes].
    """
    return error(
        "log.too_large", file=path.name, need=f"{need / 1e9:.3g}", free=f"{free / 1e9:.3g}"
    )


def unreadable(path: Path, name: str, problem: Exception) -> FoucaultError:
    """Build the error for a damaged file, or one of another format than it claims."""
    reason = " ".join(str(problem).split()) or type(problem).__name__
    return error("log.unreadable", file=path.name, format=name, reason=reason[:200].rstrip("."))


def must_exist(path: Path) -> None:
    """Refuse a log that is no file, nor the folder of a bag of ROS 2."""
    if path.is_file() or (path / ROS_FOLDER).is_file():
        return
    there = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
    near = difflib.get_close_matches(path.name, there, n=3, cutoff=0.5)
    near += [n for n in there if Path(n).stem == path.stem and n not in near]
    hint = f" The folder has {', '.join(near)}." if near else ""
    what = "is a folder, not a file" if path.is_dir() else "does not exist"
    raise error("log.missing_file", path=path, what=what, hint=hint)


def format_of(path: Path) -> str:
    """Return the format that a file is read in where nothing is said of it, "" for none."""
    try:
        return _format(path, FileLayout.model_validate({"file": path.name}))
    except FoucaultError:
        return ""


def _format(path: Path, description: FileLayout) -> str:
    if description.format != "auto":
        return description.format
    if description.record is not None:
        return "binary"
    if path.is_dir():
        return "ros"
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    known = _SUFFIXES.get(plain.suffix.lower())
    if known == "binary":
        with plain.open("rb") as stream:
            known = "dataflash" if stream.read(3) == DATAFLASH else known
    if known not in (None, "csv", "text"):
        return known
    with open_text(path) as stream:
        start = stream.read(4096)
    if start[:4] == b"PAR1":
        return "parquet"
    spoken = next((name for name, tag in _SENTENCES.items() if tag.search(start)), None)
    if spoken or known:
        return spoken or cast(str, known)
    if is_text(start):
        return "text"
    raise error("log.format_unknown", file=path.name)
