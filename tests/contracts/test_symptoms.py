"""Every row of the table of symptoms is used, and its texts can be filled in."""

from __future__ import annotations

import re
from pathlib import Path
from string import Formatter

import pytest

import foucault
from foucault.errors import FoucaultError, error, finding
from foucault.symptoms import SYMPTOMS

SOURCE = Path(foucault.__file__).parent
CODE = "\n".join(p.read_text() for p in sorted(SOURCE.rglob("*.py")) if p.parent.name != "symptoms")


class Anything:
    """Fills any field: a number to a number's format, a word to a word's."""

    def __format__(self, how: str) -> str:
        return format(1.5, how) if how.endswith(tuple("efg")) else format("1.5", how)


@pytest.mark.parametrize("code", SYMPTOMS)
def test_a_symptom_is_raised_somewhere(code: str) -> None:
    assert f'"{code}"' in CODE


def test_every_code_that_is_raised_has_a_row() -> None:
    used = re.findall(r'\b(?:error|finding)\(\s*"([\w.]+)"', CODE)
    assert len(used) > 20
    assert set(used) <= set(SYMPTOMS)


@pytest.mark.parametrize("row", SYMPTOMS.values(), ids=list(SYMPTOMS))
def test_its_words_can_be_filled_in(row) -> None:
    fields = {
        name.split(".")[0].split("[")[0]
        for text in (row.message, row.cure)
        for _, name, _, _ in Formatter().parse(text)
        if name is not None
    }
    assert "" not in fields, "fields have names"
    values = dict.fromkeys(fields, Anything())
    made = finding(row.code, **values)
    assert row.severity in ("error", "warning", "note")
    assert made.severity == row.severity
    for text in (row.symptom, made.message, made.cure):
        assert text.strip() and "{" not in text
    problem = error(row.code, **values)
    assert isinstance(problem, FoucaultError)
    assert str(problem) == f"{made.message} {made.cure}"
