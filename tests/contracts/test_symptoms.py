"""Every row of the table of symptoms is used, and its texts can be filled in."""

from __future__ import annotations

import ast
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any

import pytest
from test_command_line import COMMANDS, PROGRAM, options

import foucault
from foucault import campaign
from foucault.errors import FoucaultError, doubting, error, finding
from foucault.result import Level, Verdict
from foucault.symptoms import SYMPTOMS

SOURCE = Path(foucault.__file__).parent
TESTS = Path(__file__).parents[1]

WINDOW = 12
"""So many letters of a text that no three rows share are words of its own [1]."""


@cache
def code() -> str:
    """Return the program without its remarks and docstrings."""
    return "\n".join(
        re.sub(r"(?ms)^ *#[^\n]*$|\"\"\".*?\"\"\"", "", path.read_text(encoding="utf-8"))
        for path in sorted(SOURCE.rglob("*.py"))
        if path.parent.name != "symptoms"
    )


def spoken() -> Iterator[str]:
    """Yield every string of the tests; remarks and docstrings are none."""
    for path in sorted(TESTS.rglob("*.py")):
        if path == Path(__file__):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        bare = {n.value for n in ast.walk(tree) if isinstance(n, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in bare:
                yield node.value


def told() -> set[str]:
    """Return the rows that a test names by their code or by words of their own."""
    rows = defaultdict(set)
    for code, row in SYMPTOMS.items():
        for text in (row.message, row.cure):
            for part in re.split(r"\{[^}]*\}", text):
                for i in range(len(part) - WINDOW + 1):
                    rows[part[i : i + WINDOW]].add(code)
    guard = tomllib.loads((TESTS.parent / "docs" / "guard.toml").read_text(encoding="utf-8"))
    out = {
        word for column in guard["columns"].values() for v in column.values() for word in v.split()
    }
    for said in spoken():
        out |= set(said.split())
        plain = re.sub(r"\\([^dws])", r"\1", said)  # of a regular expression
        for i in range(len(plain) - WINDOW + 1):
            found = rows.get(plain[i : i + WINDOW], set())
            out |= found if len(found) < 3 else set()
    return out


class Anything:
    """Fills any field: a number to a number's format, a word to a word's."""

    def __format__(self, how: str) -> str:
        return format(1.5, how) if how.endswith(tuple("efg")) else format("1.5", how)


def test_every_symptom_is_raised_somewhere() -> None:
    assert set(SYMPTOMS) <= set(re.findall(r'"([\w.]+)"', code()))


@pytest.mark.thorough
def test_every_symptom_is_told_in_a_test() -> None:
    assert set(SYMPTOMS) <= told()


def test_every_code_that_is_raised_has_a_row() -> None:
    used = re.findall(r'\b(?:error|finding)\(\s*"([\w.]+)"', code())
    assert len(used) > 20
    assert set(used) <= set(SYMPTOMS)


def test_their_words_can_be_filled_in() -> None:
    for code, row in SYMPTOMS.items():
        fields = {
            name.split(".")[0].split("[")[0]
            for text in (row.message, row.cure)
            for _, name, _, _ in Formatter().parse(text)
            if name is not None
        }
        assert "" not in fields, f"{code}: fields have names"
        values = dict.fromkeys(fields, Anything())
        made = finding(row.code, **values)
        assert row.severity in ("error", "warning", "note"), code
        assert made.severity == row.severity, code
        for text in (row.symptom, made.message, made.cure):
            assert text.strip() and "{" not in text, code
        problem = error(row.code, **values)
        assert isinstance(problem, FoucaultError), code
        assert str(problem) == f"{made.message} {made.cure}", code


def keys_in(schema: Any) -> Iterator[str]:
    """Yield every key that a campaign file may have."""
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for value in schema.values():
            yield from keys_in(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from keys_in(value)


OTHER_KEYS = {
    "axis",  # "body axis = declared column"
    "end", "orientation", "diagnostics",  # of Python
    "limit",  # of a tolerance file
    "brackets", "cuda", "dask", "records", "postgresql", "capture", "workbench",  # TOML; extras
    "certificate", "references", "labels",  # of a certificate
    "result", "action",  # lists of comparisons and sequences
}  # fmt: skip
SPELLINGS = {s for c in COMMANDS.values() for o in options(c) for s in (*o.opts, *o.secondary_opts)}


def test_what_they_advise_exists() -> None:
    keys_of_files = set(keys_in(campaign.schema()))
    for text in (text for row in SYMPTOMS.values() for text in (row.message, row.cure)):
        assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)) <= SPELLINGS, text
        for line in re.findall(r"`foucault ([^`]*)`", text):
            words = line.split()
            command = PROGRAM.commands[words[0]]
            if hasattr(command, "commands"):
                inner = next((w for w in words[1:] if w in command.commands), "find")
                command = command.commands.get(inner, command)
            have = {s for o in command.params for s in o.opts}
            assert {w for w in words if w.startswith("-")} <= have, line
        assert not re.search(r"--[a-z-]+ '|install '", text), 'cmd.exe knows only "'
        keys = re.findall(r"(?<![\w.`\"{-])([a-z][a-z_.]+) = ", text)
        keys += re.findall(r"`([a-z][a-z_]+)`", text) + re.findall(r"\[([a-z][a-z_.]+)\]", text)
        assert {key.split(".")[-1] for key in keys} <= keys_of_files | OTHER_KEYS, text


OTHER = finding("log.stuck", triad="accel", axis="x", start="3", end="9")
STUCK = finding("log.stuck", triad="gyro", axis="y", start="0", end="153.32")


def test_an_error_begins_with_what_was_doubtful_before_it() -> None:
    doubt = finding("systematic.latitude", seen="48.9", sd="0.02", declared="54.8")
    failed = error("strapdown.not_finite", row=7, time="1")
    with pytest.raises(FoucaultError) as told, doubting([STUCK, doubt]), doubting([doubt]):
        raise failed
    assert told.value.code == failed.code and told.value.cure == STUCK.cure
    said = f"{STUCK.message} With it: {doubt.message} With it: {failed.message}"
    assert told.value.message == said
    same = FoucaultError(STUCK.code, STUCK.message, STUCK.cure)
    for noticed, raised in ((finding("readings.noise_unknown"), failed), (OTHER, same)):
        with pytest.raises(FoucaultError) as alone, doubting([noticed]):
            raise raised
        assert alone.value is raised


def test_a_verdict_begins_with_the_doubts_in_the_order_noticed() -> None:
    first, second = (f"{f.message} {f.cure}" for f in (STUCK, OTHER))
    failed = "A gyro scale factor error of -100 % is a wrong unit."
    noticed = (STUCK, finding("readings.noise_unknown"), OTHER)
    bad = Verdict(Level.UNUSABLE, (failed, second)).doubted(noticed)
    assert bad == Verdict(Level.UNUSABLE, (first, second, failed))
    assert bad.doubted(noticed) == bad
    assert Verdict(Level.PASS).doubted(noticed) == Verdict(Level.DOUBTFUL, (first, second))
    assert Verdict(Level.PASS).doubted(noticed[1:2]) == Verdict(Level.PASS)
