"""The input guard: every mistake with every procedure and command, as docs/guard.toml says it.

A mistake is told, by an error or by what is found; or it does no harm; or the table says why no
reading shows it, and then nothing is told indeed.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from foucault import campaign
from foucault.errors import FoucaultError
from foucault.procedures import PROCEDURES
from foucault.result import Level
from foucault.symptoms import SYMPTOMS
from make_guard import COLUMNS, MISTAKES, Outcome, another, session

GUARD = tomllib.loads(
    (Path(__file__).parents[2] / "docs" / "guard.toml").read_text(encoding="utf-8")
)
COLUMNS_OF = {m: [c for c, cells in GUARD["columns"].items() if m in cells] for m in MISTAKES}
"""Mistake -> the columns that it is possible in."""

APART = 8


def quick(column: str, mistake: str) -> bool:
    """Whether a cell is among the eighth that is tried each time: every mistake in some columns,
    and in each column other mistakes than in its neighbour. The rest of the table is thorough.
    """
    first, among = list(MISTAKES).index(mistake), COLUMNS_OF[mistake]
    return (among.index(column) + first) % min(APART, len(among)) == 0


CELLS = [
    pytest.param(c, m, marks=() if quick(c, m) else pytest.mark.thorough, id=f"{c}-{m}")
    for c, cells in GUARD["columns"].items() for m in cells
]  # fmt: skip

HOW = {"fails", "stops", "told"}
"""Words of a cell that are no codes."""

ALIKE = {"hand_rotated_published": "hand_rotated", "multi_position": "turntable"}
"""Procedures whose input is that of another, checked by the same code."""


@cache
def clean(column: str, folder: Path) -> Outcome:
    return session(column).go(folder)


@pytest.fixture
def right(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    """What comes of a session without a mistake, once for each."""
    folder = tmp_path_factory.getbasetemp() / "right"
    folder.mkdir(exist_ok=True)
    return lambda column: clean(column, folder)


@pytest.mark.thorough
def test_the_table_is_complete() -> None:
    assert set(GUARD["columns"]) == set(COLUMNS)
    assert set(COLUMNS) | set(ALIKE) >= set(PROCEDURES)
    assert set(GUARD["mistakes"]) == set(MISTAKES)
    for column, cells in GUARD["columns"].items():
        possible = {name for name, make in MISTAKES.items() if make(session(column)) is not None}
        assert set(cells) == possible, column
    said = [cell for cells in GUARD["columns"].values() for cell in cells.values()]
    reasons = {cell.partition(": ")[2] for cell in said if ": " in cell}
    assert reasons == set(GUARD["reasons"])
    codes = {word for cell in said if ": " not in cell for word in cell.split()} - HOW
    assert codes <= set(SYMPTOMS)


@pytest.mark.thorough
@pytest.mark.parametrize("column", COLUMNS)
def test_a_right_session_is_taken(column: str, right) -> None:
    assert right(column).error is None


@pytest.mark.parametrize(("column", "mistake"), CELLS)
def test_a_mistake(column: str, mistake: str, right, tmp_path: Path) -> None:
    spoilt = MISTAKES[mistake](session(column))
    assert spoilt is not None
    cell, good, bad = GUARD["columns"][column][mistake], right(column), spoilt.go(tmp_path)
    kind, colon, _ = cell.partition(": ")
    if not colon:
        how = set(cell.split()) & HOW
        codes = set(cell.split()) - HOW
        assert codes <= bad.said
        ends = {c for c in codes if SYMPTOMS[c].severity == "error" or "stops" in how}
        assert bad.error in (codes if ends and "told" not in how else {None})
        assert "fails" not in cell.split() or bad.failed > good.failed
    else:
        told = {c for c in bad.findings - good.findings if SYMPTOMS[c].severity != "note"}
        assert bad.error is None and not told and not bad.failed - good.failed
        if kind == "same":
            assert np.allclose(bad.numbers, good.numbers, rtol=1e-6)


ELSEWHERE = {
    "hand_rotated": ("ms", "gyro deg", "accel g", "gyro swapped", "both swapped", "accel dead"),
    "rate_table": ("s as ms", "gyro reversed", "accel SI", "gyro clipped"),
    "north_seeking": ("gyro dead", "gyro reversed", "angles deg", "angles sense"),
}
"""Cells that are tried with another seed, and where there are grades with another one."""


@pytest.mark.thorough
@pytest.mark.parametrize("column", ELSEWHERE)
def test_mistakes_in_another_log(column: str, tmp_path: Path) -> None:
    grade = {} if column == "north_seeking" else {"grade": "tactical"}
    made = another(column, seed=77, **grade)
    for mistake in ELSEWHERE[column]:
        spoilt = MISTAKES[mistake](made)
        assert spoilt is not None
        codes = set(GUARD["columns"][column][mistake].split()) - HOW
        assert codes <= spoilt.go(tmp_path).said, mistake


@pytest.mark.thorough
@pytest.mark.parametrize("column", ["ferraris", "turntable", "norm_observation"])
def test_what_ends_the_work_names_the_gyro_that_is_stuck(column: str, tmp_path: Path) -> None:
    path = MISTAKES["gyro stuck"](session(column)).write(tmp_path)
    with pytest.raises(FoucaultError) as ended:
        campaign.calibrate(path)
    assert ended.value.message.startswith("gyro z repeats one reading from 0 s")
    assert "[log.gyro]" in ended.value.cure


def test_what_ends_the_work_says_first_that_triads_are_exchanged(tmp_path: Path) -> None:
    path = MISTAKES["triads exchanged"](session("hand_rotated")).write(tmp_path)
    with pytest.raises(FoucaultError) as ended:
        campaign.calibrate(path)
    assert ended.value.message.startswith("The columns of [log.gyro] hold 9.8")
    assert ended.value.cure == "Exchange `columns` of [log.gyro] and [log.accel]."


def test_what_is_unusable_names_the_gyro_that_is_stuck_first(tmp_path: Path) -> None:
    path = MISTAKES["gyro stuck"](session("hand_rotated")).write(tmp_path)
    verdict = campaign.calibrate(path).verdict
    assert verdict.level is Level.UNUSABLE
    assert verdict.reasons[0].startswith("gyro z repeats one reading from 0 s")
