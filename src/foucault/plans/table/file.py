"""Lists of positions as files: one line per position with three angles in degrees."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.files import atomic, keep_others, read_text

HEADINGS = ("outer", "middle", "inner")
"""The first line of a file."""


def write_positions(
    angles: FloatArray, path: str | Path, headings: tuple[str, ...] = HEADINGS
) -> None:
    """Write positions as CSV in degrees, whole or not at all.

    `angles` (n, k): outer, middle and inner angle of each position, or what `headings` name
    [rad].
    """
    keep_others(path, [",".join(headings).encode() + b"\n"])
    lines = [",".join(headings), *(",".join(f"{a:.9f}" for a in row) for row in np.degrees(angles))]
    with atomic(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")


def read_positions(path: str | Path) -> FloatArray:
    """Read positions from CSV in degrees, shape (n, 3) [rad].

    Raises ``plan.file``.
    """
    try:
        lines = read_text(path).splitlines()
    except OSError as problem:
        raise error("plan.file", path=path, why=problem.strerror) from None
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines) if row]
    if not rows or tuple(cell.lower() for cell in rows[0]) != HEADINGS:
        raise error("plan.file", path=path, why="its first line is not `outer,middle,inner`")
    if len(rows) == 1:
        raise error("plan.file", path=path, why="it holds no position")
    return np.radians([_angles(row, path, k) for k, row in enumerate(rows[1:], 2)])


def _angles(row: list[str], path: str | Path, line: int) -> list[float]:
    try:
        angles = [float(cell) for cell in row]
    except ValueError:
        angles = []
    if len(angles) != 3 or not np.isfinite(angles).all():
        raise error("plan.file", path=path, why=f"line {line} is not three angles")
    return angles
