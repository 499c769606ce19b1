"""Numbers as text that reads back to the same bits."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray


def inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of `matrix`, shape (3, 3) [1]."""
    return np.asarray(np.linalg.inv(matrix), np.float64)


def number(value: float) -> str:
    """Write `value` [SI] with a point: YAML 1.1 takes 1e-05 for text, 1.0e-05 for a number."""
    text = repr(float(value) + 0.0)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def row(values: FloatArray) -> str:
    """Write `values`, shape (n,) [SI], separated by commas."""
    return ", ".join(number(v) for v in values)


def rows(matrix: FloatArray, opening: str, closing: str, indent: str = "    ") -> str:
    """Write `matrix`, shape (m, n) [SI], one row per line between brackets."""
    lines = [f"{indent}{opening}{row(line)}{closing}" for line in matrix]
    return ",\n".join(lines)


def tensor(values: FloatArray, opening: str, closing: str) -> str:
    """Write `values`, shape (l, m, n) [SI], one matrix after the other between brackets."""
    parts = [f"    {opening}\n{rows(m, opening, closing, '        ')}" for m in values]
    return ",\n".join(f"{part},\n    {closing}" for part in parts)


def nested(values: FloatArray, opening: str, closing: str) -> str:
    """Write `values`, shape (n,), (m, n) or (l, m, n) [SI], between brackets."""
    if values.ndim == 1:
        return f"{opening}{row(values)}{closing}"
    lines = (rows if values.ndim == 2 else tensor)(values, opening, closing)
    return f"{opening}\n{lines},\n{closing}"
