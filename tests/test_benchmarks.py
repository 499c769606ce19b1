"""The programs that benchmarks and validation keep as text, which neither types nor imports see."""

from __future__ import annotations

import ast
import importlib
import json
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def holds_programs(script: Path) -> bool:
    """Whether a script has text that imports; the others may import what only a bench installs."""
    parts = (n.value for n in ast.walk(ast.parse(script.read_text(encoding="utf-8")))
             if isinstance(n, ast.Constant))  # fmt: skip
    return any(isinstance(part, str) and "\nimport " in part for part in parts)


SCRIPTS = sorted(
    script
    for folder in ("benchmarks", "validation")
    for script in (ROOT / folder).glob("*.py")
    if holds_programs(script)
)


def programs(script: Path) -> Iterator[tuple[str, str]]:
    """Yield name and text of the programs in a script, but not of the parts they are made of."""
    body = ast.parse(script.read_text(encoding="utf-8")).body
    made = [node.value for node in body if isinstance(node, ast.Assign)]
    parts = {n.id for value in made for n in ast.walk(value) if isinstance(n, ast.Name)}
    for name, value in runpy.run_path(str(script), run_name="read").items():
        if isinstance(value, str) and "\nimport " in value and name not in {"__doc__", *parts}:
            yield name, value


def undefined(text: str) -> set[str]:
    """Return the names that a program uses and nothing in it defines."""
    check = [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F821",
             "--output-format", "json", "-"]  # fmt: skip
    done = subprocess.run(check, input=text, capture_output=True, text=True, check=False)
    return {row["message"].split("`")[1] for row in json.loads(done.stdout)}


def given(script: Path, name: str) -> bool:
    """Whether a script, or the one that runs all, puts something in the place of a name."""
    source = "".join(p.read_text(encoding="utf-8") for p in (script, ROOT / "benchmarks/run.py"))
    return re.search(rf'replace\("{name}"|\b{name}(, \w+)* = ', source) is not None


@pytest.fixture(autouse=True)
def as_a_script(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    script: Path = request.getfixturevalue("script")
    for folder in (ROOT / "tests", script.parent):
        monkeypatch.syspath_prepend(str(folder))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_what_it_takes_from_the_package_is_there(script: Path) -> None:
    found = dict(programs(script))
    assert found
    for name, text in found.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("foucault"):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    if not hasattr(module, alias.name):
                        importlib.import_module(f"{node.module}.{alias.name}")
        missing = {n for n in undefined(text) if not given(script, n)}
        assert not missing, name
