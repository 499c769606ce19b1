"""Types of arrays, for annotations, and directions that do not hang on rounding."""

from __future__ import annotations

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
