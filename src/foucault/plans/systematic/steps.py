"""A sequence of systematic calibration for the one who turns the table: what to do when.

One row per action: when it begins, what it is, about which axis, by how much and how fast, and
where x, y and z of the instrument point afterwards.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from foucault.errors import error
from foucault.escape import csv_cell, toml_text
from foucault.files import atomic, keep_others
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.systematic.sequence import (
    DIRECTIONS,
    RAMP,
    Action,
    CalibrationSequence,
    pointing,
)

HEADINGS = (
    "start (s)", "action", "about", "angle (deg)", "rate (deg/s)", "end (s)", "x to", "y to",
    "z to", "label",
)  # fmt: skip
"""First row of the table."""

WHOLE = 1e-9
"""Turns that are so near to whole ones are whole [1]."""


def turns_of(turn: Rotate) -> int:
    """Return the whole turns about a level axis that a turn makes; 0 where it is no spin."""
    turns = turn.angle / (2 * np.pi)
    level = turn.axis in ("east", "north", "up")
    return round(turns) if level and abs(turns - round(turns)) < WHOLE else 0


def rows(sequence: CalibrationSequence) -> tuple[tuple[str, ...], ...]:
    """Return the sequence as a table for people, the headings first."""
    out = [HEADINGS]
    for k, action in enumerate(sequence.actions):
        begin, end = (f"{t:.1f}" for t in sequence.times[k : k + 2])
        points = pointing(sequence.attitudes[k + 1])
        out.append((begin, *_done(action), end, *points, action.label))
    return tuple(out)


def _done(action: Action) -> tuple[str, str, str, str]:
    if isinstance(action, Rest):
        return "rest", "", "", ""
    what = "spin" if turns_of(action) else "turn"
    angle, rate = (f"{np.degrees(v):z.10g}" for v in (action.angle, action.rate))
    return what, action.axis, angle, rate


def plain_action(action: Action) -> dict[str, Any]:
    """Return an action as sequence files have it; see `systematic_file.ActionTable`."""
    if isinstance(action, Rest):
        return {"rest": f"{action.time:.12g} s"} | ({"label": action.label} if action.label else {})
    turns = turns_of(action)
    angle = {"spin": turns} if turns else {"turn": f"{np.degrees(action.angle):z.12g} deg"}
    out = {**angle, "about": action.axis, "rate": f"{np.degrees(action.rate):.12g} deg/s"}
    if abs(action.ramp - RAMP) > WHOLE:
        out["ramp"] = f"{action.ramp:.12g} s"
    return out | ({"label": action.label} if turns and action.label else {})


def plain_start(sequence: CalibrationSequence) -> tuple[str, ...]:
    """Return where x, y and z point at first, in words.

    `sequence`: rests, turns and spins, its start has to be along east, north and up. Raises
    ``sequence.slanting``.
    """
    out = []
    for column in sequence.start.T:
        k = int(np.abs(column).argmax())
        if abs(column[k]) < 1 - WHOLE:
            raise error("sequence.slanting", name=sequence.name)
        out.append(DIRECTIONS[k + (3 if column[k] < 0 else 0)])
    return tuple(out)


def write_steps(sequence: CalibrationSequence, path: str | Path) -> None:
    """Write a sequence: a table as CSV, or a file that reads as one where it ends in .toml."""
    path = Path(path)
    keep_others(path, [",".join(HEADINGS).encode(), b"\n[[action]]\n"])
    if path.suffix.lower() == ".toml":
        text = _toml(sequence)
    else:
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows(
            [*row[:-1], csv_cell(row[-1])] for row in rows(sequence)
        )
        text = stream.getvalue()
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _toml(sequence: CalibrationSequence) -> str:
    start = ", ".join(f'"{way}"' for way in plain_start(sequence))
    lines = [f"name = {toml_text(sequence.name)}", f"start = [{start}]"]
    for action in sequence.actions:
        pairs = plain_action(action).items()
        lines += ["", "[[action]]"]
        lines += [f"{k} = {v if isinstance(v, int) else toml_text(v)}" for k, v in pairs]
    return "\n".join([*lines, ""])
