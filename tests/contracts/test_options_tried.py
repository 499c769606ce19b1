"""Every option and argument of every command is given to that command by a test.

The tests are read, not run: a call that starts with the name of a command is one of it, and its
words are the strings in it, in the names that it uses and in what the test is parametrised with.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from test_command_line import COMMANDS, options

TESTS = Path(__file__).parents[1]
NOT_TESTS = {"contracts", "fuzz", "test_docs.py", "test_bad_values.py"}
"""Where commands are named or run, and nothing is said of what an option does."""

GIVEN = [(name, option) for name, command in COMMANDS.items() for option in options(command)]

Words = dict[str, list[str]]
"""Strings behind the names of a file."""


def strings(node: ast.AST) -> list[str]:
    return [
        x.value for x in ast.walk(node) if isinstance(x, ast.Constant) and isinstance(x.value, str)
    ]


def assigned(nodes: Iterable[ast.AST], known: Words) -> Words:
    """Return the strings behind every name that is assigned to, or runs over something."""
    out = dict(known)
    for node in nodes:
        if isinstance(node, ast.Assign | ast.For):
            said = node.value if isinstance(node, ast.Assign) else node.iter
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                for name in (n.id for n in ast.walk(target) if isinstance(n, ast.Name)):
                    out[name] = out.get(name, []) + words_of(said, out)
    return out


def words_of(node: ast.AST, known: Words) -> list[str]:
    """Return the strings in a node and behind the names in it, in their order."""
    out = []
    for x in ast.walk(node):
        if isinstance(x, ast.Constant) and isinstance(x.value, str):
            out.append(x.value)
        elif isinstance(x, ast.Name):
            out += known.get(x.id, [])
    return out


def parametrised(function: ast.FunctionDef, known: Words) -> Words:
    """Return the strings behind the arguments of a test that is parametrised."""
    out = {}
    for decorator in function.decorator_list:
        if isinstance(decorator, ast.Call) and len(decorator.args) == 2:
            for name in " ".join(strings(decorator.args[0])).replace(",", " ").split():
                out[name] = words_of(decorator.args[1], known)
    return out


def calls(function: ast.FunctionDef, known: Words) -> Iterator[list[str]]:
    """Yield the words of every call in a function, after those of a function of the file."""
    known = assigned(ast.walk(function), known | parametrised(function, known))
    for node in ast.walk(function):
        if isinstance(node, ast.Call):
            before = known.get(node.func.id, []) if isinstance(node.func, ast.Name) else []
            yield before + [w for argument in node.args for w in words_of(argument, known)]


def imported(tree: ast.Module) -> Words:
    """Return the strings behind the names that a file has from makers beside the tests."""
    out = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("make_"):
            made = TESTS / f"{node.module}.py"
            if made.is_file():
                body = ast.parse(made.read_text(encoding="utf-8")).body
                names = {alias.name for alias in node.names}
                out |= {k: v for k, v in assigned(body, {}).items() if k in names}
    return out


GROUPS = {name.split()[0] for name in COMMANDS if " " in name}


def command_of(words: list[str]) -> str | None:
    """Return the command that a call is one of, or the group whose command another call says."""
    at = next((i for i, w in enumerate(words) if w in COMMANDS or w in GROUPS), None)
    if at is None or words[at] not in GROUPS:
        return None if at is None else words[at]
    first = words[at]
    both = (f"{first} {w}" for w in words[at + 1 :])
    alone = "north find" if first == "north" else first
    return next((name for name in both if name in COMMANDS), alone)


@cache
def tried() -> set[tuple[str, str]]:
    """Return every (command, spelling of an option) of the tests."""
    out = set()
    for path in sorted(TESTS.rglob("test_*.py")):
        if NOT_TESTS & set(path.relative_to(TESTS).parts):
            continue
        text = path.read_text(encoding="utf-8")
        if not re.search("CliRunner|import commands|from commands import", text):
            continue
        tree = ast.parse(text)
        known = assigned(tree.body, imported(tree))
        functions = [n for n in tree.body if isinstance(n, ast.FunctionDef)]
        for function in functions:
            if not function.name.startswith("test_"):
                said = [words for words in calls(function, known) if command_of(words)]
                known[function.name] = said[0] if said else []
        for function in functions:
            for words in calls(function, known):
                name = command_of(words)
                out |= {(name, w.partition("=")[0]) for w in words if name and w.startswith("-")}
    return out


def test_every_option_is_tried() -> None:
    untried = [
        f"{name} {option.opts[-1]}"
        for name, option in GIVEN
        if not {(name, s) for s in (*option.opts, *option.secondary_opts)} & tried()
    ]
    assert not untried


def test_an_option_that_nobody_tries_is_seen() -> None:
    assert ("align", "--still") not in tried() and ("navigate", "--still") in tried()
    assert ("north find", "--tilt") not in tried() and ("north plan", "--tilt") in tried()
