"""Types of arrays, directions that do not hang on rounding, and columns without pandas."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


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


def of_arrow(column: Any) -> npt.NDArray[Any]:
    """Return a column of a table of pyarrow, numbers that are null as NaN.

    Its memory is read as it lies: `to_numpy` imports pandas, which takes longer than most tables.
    """
    import pyarrow as pa

    if pa.types.is_boolean(column.type) and not column.null_count:
        return of_arrow(column.cast(pa.uint8())).astype(bool)
    if pa.types.is_timestamp(column.type):
        kind = np.dtype(f"datetime64[{column.type.unit}]")
    elif pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
        kind = np.dtype(column.type.to_pandas_dtype())
    else:
        return np.array(column.to_pylist(), object)
    parts = [_of_chunk(part, kind) for part in getattr(column, "chunks", [column])]
    return np.concatenate(parts) if parts else np.empty(0, kind)


def _of_chunk(part: Any, kind: np.dtype[Any]) -> npt.NDArray[Any]:
    bits, data = part.buffers()
    if data is None or not len(part):
        return np.empty(0, kind)
    values = np.frombuffer(data, kind, part.offset + len(part))[part.offset :]
    if not part.null_count:
        return values
    known = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")
    missing = known[part.offset : part.offset + len(part)] == 0
    nothing = np.datetime64("NaT") if kind.kind == "M" else np.nan
    return np.where(missing, nothing, values)
