"""Types of arrays, directions that do not hang on rounding, and columns without pandas."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
IndexArray = npt.NDArray[np.intp]


def settled(values: FloatArray, rows: FloatArray, near: float = 1e-6) -> FloatArray:
    """Return directions, with those of equal values turned to where rounding has no say.

    Any turn within the space of equal singular values is as right as another, and which one a
    library returns depends on the processor. Here the first is the projection of the axis that
    lies deepest in the space, the next the same of what is left.

    `values` (n,): sorted, of any unit; `rows` (n, m): orthonormal, one a value [1]; `near`: values
    that differ by no more than this part of the larger count as equal [1].
    """
    out, start = rows.copy(), 0
    for end in range(1, len(values) + 1):
        larger = max(abs(values[end - 1]), abs(values[end])) if end < len(values) else 0.0
        if end < len(values) and abs(values[end] - values[end - 1]) <= near * larger:
            continue
        space = rows[start:end]
        for k in range(start, end if end - start > 1 else start):
            share = space.T @ space
            deepest = int(np.argmax(np.diag(share).round(6)))
            out[k] = share[deepest] / np.sqrt(share[deepest, deepest])
            space = space - np.outer(space @ out[k], out[k])
        start = end
    return out


@dataclass(frozen=True, eq=False)
class Names(Sequence[str]):
    """Words of a column of pyarrow, of which few are looked at."""

    column: Any  # array of strings

    def __len__(self) -> int:
        return len(self.column)

    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            return Names(self.column[i])
        return self.column[int(range(len(self))[i])].as_py()

    def __iter__(self) -> Iterator[str]:
        return iter(self.column.to_pylist())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and [*self] == [*other]

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True, eq=False)
class Made(Sequence[Any]):
    """A column of numbers that are made when they are read: of many rows a few at a time."""

    size: int  # rows [1]
    of: Callable[[slice], npt.NDArray[Any]]  # some rows -> their numbers

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, i: Any) -> Any:
        return self.of(i) if isinstance(i, slice) else self.of(slice(None))[i]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.of(slice(None)))

    def __array__(self, dtype: Any = None, copy: Any = None) -> npt.NDArray[Any]:
        return np.asarray(self.of(slice(None)), dtype)


def chosen(names: Sequence[str], some: IntArray) -> Sequence[str]:
    """Return those of `names` at the places `some` (k,) [1]."""
    if isinstance(names, Names):
        return Names(names.column.take(to_arrow(some)))
    return tuple(names[i] for i in some.tolist())


def begins(x: npt.NDArray[Any]) -> BoolArray:
    """Tell where runs of equal numbers of `x` (n,) [any unit] begin, without a copy of it."""
    new = np.ones(len(x), bool)
    np.not_equal(x[1:], x[:-1], out=new[1:])
    return new


def repeating(x: FloatArray, count: int) -> FloatArray:
    """Return the first of `count` parts of `x` (n,) [any unit] that are all alike, else all of it.

    Of many set-ups with the same stops what hangs on these is found once.
    """
    if not count or len(x) % count:
        return x
    rows = x.reshape(count, -1)
    return rows[0] if bool((rows == rows[0]).all()) else x


def by_number(numbers: IntArray, of: Callable[[int], float]) -> FloatArray:
    """Return `of` each of `numbers` (m,), none negative [1]: of many few are different."""
    there = np.flatnonzero(np.bincount(numbers))
    table = np.zeros(there.max(initial=-1) + 1)
    table[there] = [of(n) for n in there.tolist()]
    return table[numbers]


def of_arrow(column: Any) -> npt.NDArray[Any]:
    """Return a column of a table of pyarrow, numbers that are null as NaN.

    `to_numpy` imports pandas, which takes longer than most tables; a cast, all that can be computed
    with a column.
    """
    import pyarrow as pa

    if isinstance(column, pa.ChunkedArray):
        column = column.combine_chunks()
    if pa.types.is_boolean(column.type) and not column.null_count:
        return of_arrow(column.cast(pa.uint8())).astype(bool)
    if pa.types.is_timestamp(column.type):
        none = np.iinfo(np.int64).min  # not a time
        ticks = of_arrow(column.cast(pa.int64()).fill_null(none))
        return ticks.view(f"datetime64[{column.type.unit}]")
    if pa.types.is_integer(column.type) and column.null_count:
        column = column.cast(pa.float64())
    if pa.types.is_floating(column.type) and column.null_count:
        column = column.fill_null(np.nan)
    if not pa.types.is_floating(column.type) and not pa.types.is_integer(column.type):
        return np.array(column.to_pylist(), object)
    kind, data = np.dtype(column.type.to_pandas_dtype()), column.buffers()[1]
    if not len(column):
        return np.empty(0, kind)
    return np.frombuffer(data, kind, len(column), column.offset * kind.itemsize)


def runs_of(cells: Any) -> IntArray:
    """Return where runs of equal words begin in an array of strings of pyarrow, shape (k,) [1]."""
    from pyarrow import compute

    moved = of_arrow(compute.not_equal(cells[1:], cells[:-1]))
    return np.flatnonzero(np.append(np.ones(min(len(cells), 1), bool), moved))


def to_arrow(values: Any) -> Any:
    """Return a column for a table of pyarrow, as `pyarrow.array` does without importing pandas."""
    import pyarrow as pa

    if isinstance(values, Names):
        return values.column
    x = np.asarray(values)
    if x.dtype.kind in "UO" and x.ndim == 1:
        words = x.tolist()
        if not all(isinstance(word, str) for word in words):
            return pa.array(words)
        coded = [word.encode() for word in words]
        ends = np.cumsum([0, *map(len, coded)], dtype=np.int32)
        text = pa.py_buffer(b"".join(coded))
        return pa.StringArray.from_buffers(len(coded), pa.py_buffer(ends), text)
    if x.dtype.kind not in "fib" or x.ndim != 1:
        return pa.array(values)
    kind = pa.from_numpy_dtype(x.dtype)
    memory = np.packbits(x, bitorder="little") if x.dtype.kind == "b" else np.ascontiguousarray(x)
    return pa.Array.from_buffers(kind, len(x), [None, pa.py_buffer(memory)])


def transposed(a: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """Return the transposes of matrices `a` (..., r, c) [any unit]; NumPy 1 has no name for it."""
    return np.asarray(np.swapaxes(a, -1, -2), dtype=float)
