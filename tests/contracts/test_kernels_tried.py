"""Every kernel that is called from outside has a test that runs it compiled and as plain Python."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KERNELS = ROOT / "src" / "foucault" / "kernels"


def _words(text: str) -> set[str]:
    return set(re.findall(r"\w+", text))


def entries() -> set[tuple[str, str]]:
    """Module and name of each compiled function that no other kernel calls, or others import."""
    functions = {
        (file.stem, node.name)
        for file in KERNELS.glob("*.py")
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and node.decorator_list
    }
    called = [
        node.func.id
        for file in KERNELS.glob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    ]
    outside = set()
    for file in KERNELS.parent.rglob("*.py"):
        if KERNELS in file.parents:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                "foucault.kernels."
            ):
                outside |= {(node.module.rsplit(".", 1)[1], name.name) for name in node.names}
    return {(m, name) for m, name in functions if name not in called or (m, name) in outside}


@pytest.mark.thorough
def test_every_kernel_is_tried_in_both_forms():
    tests = [file.read_text(encoding="utf-8") for file in (ROOT / "tests").rglob("test_*.py")]
    both = [_words(text) for text in tests if "py_func" in text or "plain_kernels" in text]
    found = entries()
    assert len(found) > 20
    untried = {(m, name) for m, name in found if not any({m, name} <= words for words in both)}
    assert not untried


@pytest.mark.thorough
def test_no_kernel_is_dead():
    elsewhere = [
        file.read_text(encoding="utf-8")
        for file in KERNELS.parent.rglob("*.py")
        if KERNELS not in file.parents
    ]
    words = set().union(*map(_words, elsewhere))
    inside = [file.read_text(encoding="utf-8") for file in KERNELS.glob("*.py")]
    count = {name: sum(len(re.findall(rf"\b{name}\b", t)) for t in inside) for _, name in entries()}
    assert not {name for name, n in count.items() if n == 1 and name not in words}
