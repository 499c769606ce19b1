"""Every check has its words in one table, every row is used, and each use gives what it needs."""

from __future__ import annotations

import ast
import json
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from string import Formatter

import pytest

import foucault
from foucault.diagnose import checks
from foucault.diagnose.checks import Words, check, sentences

ROOT = Path(foucault.__file__).parent
GOLDEN = Path(__file__).parent.parent / "golden"

LEFT_TO_THE_VALUES = {"advice", "cure", "farthest", "message", "reason", "sums", "then"}
"""Fields that are sentences of their own, or nothing: what ends with one ends with a full stop."""


def _assigned(name: ast.expr, around: ast.AST) -> Iterator[ast.expr]:
    """Yield what a name is set to within a function."""
    for node in ast.walk(around):
        if not isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            yield from (value for one, value in pairs if ast.unparse(one) == ast.unparse(name))


@cache
def parsed() -> dict[str, ast.Module]:
    """Return file -> what it says, where it makes a check."""
    return {
        str(file.relative_to(ROOT)): ast.parse(text)
        for file in ROOT.rglob("*.py")
        if re.search(r"\b([cC]heck|Test)\(", text := file.read_text())
    }


class Use:
    """One call of `check`, or of a test of many set-ups, read without running it."""

    def __init__(self, call: ast.Call, around: ast.AST, module: ast.Module) -> None:
        self.around, self.module = around, module
        said = {k.arg: k.value for k in call.keywords}
        self.keys = self.strings(call.args[0])
        given = call.args[5] if len(call.args) > 5 else said.get("given")
        self.given = set() if given is None else self.fields(given)

    def strings(self, node: ast.expr) -> set[str]:
        """Return the strings that an expression can be."""
        if isinstance(node, ast.Constant):
            return {str(node.value)}
        parts = _assigned(node, self.around)
        if isinstance(node, ast.IfExp):
            parts = iter((node.body, node.orelse))
        return {s for part in parts for s in self.strings(part)}

    def fields(self, node: ast.expr) -> set[str]:
        """Return the keys of a dictionary, however it is put together."""
        parts: Iterator[ast.expr] = iter(())
        if isinstance(node, ast.Dict):
            return {k.value for k in node.keys if isinstance(k, ast.Constant)}
        if isinstance(node, ast.BinOp):
            parts = iter((node.left, node.right))
        elif isinstance(node, ast.IfExp):
            parts = iter((node.body, node.orelse))
        elif isinstance(node, ast.Lambda):
            parts = iter((node.body,))
        elif isinstance(node, ast.Name):
            parts = chain(_assigned(node, self.around), self._returned(node.id, self.around))
        elif isinstance(node, ast.Call):
            parts = self._returned(ast.unparse(node.func), self.module)
        return {field for part in parts for field in self.fields(part)}

    @staticmethod
    def _returned(name: str, within: ast.AST) -> Iterator[ast.expr]:
        made = (f for f in ast.walk(within) if isinstance(f, ast.FunctionDef))
        return (r.value for f in made if f.name == name for r in ast.walk(f)
                if isinstance(r, ast.Return) and r.value is not None)  # fmt: skip


@cache
def uses() -> dict[str, list[Use]]:
    """Return the uses of every key."""
    out = defaultdict(list)
    for module in parsed().values():
        for around in (n for n in ast.walk(module) if isinstance(n, ast.FunctionDef)):
            for node in ast.walk(around):
                named = isinstance(node, ast.Call) and ast.unparse(node.func)
                if named in ("check", "Test") and len(node.args) > 2:
                    use = Use(node, around, module)
                    for key in use.keys:
                        out[key].append(use)
    return out


def test_every_row_is_used_and_every_use_has_a_row() -> None:
    assert set(uses()) == set(sentences())


def test_every_use_gives_what_the_sentences_say() -> None:
    for key, row in sentences().items():
        wanted = {field for text in row for _, field, _, _ in Formatter().parse(text) if field}
        for use in uses()[key]:
            assert wanted <= use.given | {"value", "low", "high"}, key


def test_sentences_have_single_blanks_and_end_in_a_full_stop() -> None:
    for key, row in sentences().items():
        for text in filter(None, (row.fine, row.below, row.above, row.unlikely)):
            assert "  " not in text and text == text.strip(), key
            assert text.endswith(".") or re.split(r"[{}]", text)[-2] in LEFT_TO_THE_VALUES, key
        assert not row.fine.startswith("..."), key


def test_sentences_of_kept_results_have_single_blanks_and_end_in_a_full_stop() -> None:
    said = [
        (key, text) for file in GOLDEN.glob("*.json")
        for rows in json.loads(file.read_text()).values() for key, text in rows.items()
        if re.fullmatch(r"(.*\.)?checks\..*\.sentence:?", key)
    ]  # fmt: skip
    assert len(said) > 100
    for key, text in said:
        assert "  " not in text and text.endswith("."), (key, text)


def test_no_other_module_writes_the_sentence_of_a_check() -> None:
    found = {
        file for file, module in parsed().items() for node in ast.walk(module)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Check"
        and any(k.arg for k in node.keywords) | bool(node.args)
    }  # fmt: skip
    found.remove("diagnose/checks.py")
    assert not found, "Write it into diagnose/words.toml and use `check`."


def test_a_sentence_goes_on_from_the_one_inside_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = {
        "both": Words("It is {value:g}.", above="...: {why}."),
        "more": Words("It is {value:g}.", below="... Add {low:g}."),
        "same": Words("It is {value:g}."),
    }
    monkeypatch.setattr(checks, "sentences", lambda: rows)
    given = {"why": "too far off"}
    assert check("both", "a", 2.0, 1.0, 3.0, given).sentence == "It is 2."
    for value in (0.0, 4.0):
        found = check("both", "a", value, 1.0, 3.0, given)
        assert found.sentence == f"It is {value:g}: too far off." and not found.passed
    assert check("more", "a", 0.0, 1.0).sentence == "It is 0. Add 1."
    assert check("same", "a", 4.0, None, 3.0).sentence == "It is 4."
    assert not check("same", "a", float("nan"), passed=False).passed
    excused = check("both", "a", 4.0, 1.0, 3.0, given, excused=True)
    assert excused.passed and excused.low == 1.0 and excused.high is None
    assert not check("both", "a", 4.0, 1.0, 3.0, given, excused=True, p=1e-5).passed


def test_a_large_number_in_a_sentence_has_no_exponent() -> None:
    about = {"what": "drift", "size": "", "worst": "", "ties": "", "cure": "Look."}
    for value, wanted in ((312.4, "310 times"), (2.94, "2.9 times")):
        said = check("left out contradicted", "size", value, None, 1.0, about).sentence
        assert wanted in said and "e+" not in said
