"""Everything public says what it does, and every number its shape or unit."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import foucault

# What these show is for people; their numbers are positions and colours.
WITHOUT_NUMBERS = ("foucault.cli", "foucault.report", "foucault.__main__")

NUMERIC = re.compile(r"\b(float|int|complex|\w*Array|NDArray|ndarray|ArrayLike)\b")
STATED = re.compile(r"\[[^\]\n]+\]|shape \(")
ENTRY = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*) ?:(.*(?:\n(?:[ \t]+.*)?)*)", re.MULTILINE)


@cache
def _modules() -> list[ModuleType]:
    found = pkgutil.walk_packages(foucault.__path__, "foucault.")
    names = ["foucault", *(m.name for m in found if not m.name.startswith(WITHOUT_NUMBERS))]
    return [importlib.import_module(name) for name in names]


def _functions(module: ModuleType) -> Iterator[tuple[str, FunctionType]]:
    for name, thing in vars(module).items():
        if name.startswith("_"):
            continue
        thing = getattr(thing, "py_func", thing)  # a compiled kernel
        if inspect.isfunction(thing) and thing.__module__ == module.__name__:
            yield f"{module.__name__}.{name}", thing
        if inspect.isclass(thing) and thing.__module__ == module.__name__:
            for key, member in vars(thing).items():
                member = getattr(member, "__func__", member)
                if not key.startswith("_") and inspect.isfunction(member):
                    yield f"{module.__name__}.{name}.{key}", member


def _classes(module: ModuleType) -> Iterator[tuple[str, type]]:
    for name, thing in vars(module).items():
        if (
            inspect.isclass(thing)
            and not name.startswith("_")
            and thing.__module__ == module.__name__
        ):
            yield f"{module.__name__}.{name}", thing


def _is_number(annotation: Any) -> bool:
    text = annotation if isinstance(annotation, str) else str(annotation)
    return bool(NUMERIC.search(re.sub(r"Callable\[.*\]|Literal\[.*\]", "", text)))


def _section(doc: str, title: str) -> dict[str, str]:
    """Return name -> entry of a numpydoc section."""
    match = re.search(rf"^{title}\n-+\n(.*?)(?=^\w[^\n]*\n-{{3,}}|\Z)", doc, re.M | re.S)
    if match is None:
        return {}
    return {
        name.strip("* "): text
        for names, text in ENTRY.findall(match.group(1))
        for name in names.split(",")
    }


def _clauses(doc: str, name: str) -> str:
    """Return what a docstring without sections says of an argument: `a`, `b` (n, 3): ...;"""
    doc = " ".join(doc.split())
    found = list(re.finditer(rf"`{name}`(?:, `\w+`)*( \([^)]*\))?(?: or None)?:[^;]*", doc))
    if not found:
        return doc if f"`{name}`" in doc else ""
    return " ".join("shape (" if match.group(1) else match.group() for match in found)


@cache
def _texts(module: str) -> dict[str, list[str]]:
    """Return the lines of every class of a module: `inspect` reads all of it for each."""
    text = Path(str(sys.modules[module].__file__)).read_text(encoding="utf-8")
    return {
        node.name: text.splitlines()[node.lineno - 1 : node.end_lineno]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef)
    }


def _beside(kind: type) -> dict[str, str]:
    """Return the comments of fields: beside one, or above one or several, "a, b: ..."."""
    found: dict[str, str] = {}
    for base in filter(dataclasses.is_dataclass, kind.__mro__):
        above = ""
        for line in map(str.strip, _texts(base.__module__)[base.__name__]):
            if line.startswith("#"):
                above += line[1:]
                continue
            field = re.match(r"(\w+): [^#]*(?:# (.*))?", line)
            names = re.match(r" ((?:\w+, )*\w+): ", above)
            text = (field[2] if field else None) or (above[names.end() :] if names else above)
            for name in names[1].split(", ") if names else [field[1]] if field else []:
                found.setdefault(name, re.sub(r"^ *(?=\()", "shape ", text))
            above = ""
    return found


def unstated(annotations: dict[str, Any], doc: str, title: str) -> list[str]:
    """Return the numbers whose shape or unit `doc` does not say."""
    entries = _section(doc, title)
    missing = []
    for name, annotation in annotations.items():
        if not _is_number(annotation):
            continue
        if not STATED.search(entries.get(name, "" if entries else _clauses(doc, name))):
            missing.append(name)
    return missing


def test_public_things_are_documented() -> None:
    for module in _modules():
        assert (
            (module.__doc__ or "").strip()
            or not vars(module).get("__file__", "").endswith("__init__.py")
            or not list(_functions(module))
        ), f"{module.__name__} has no docstring"
        things = [*_functions(module), *_classes(module)]
        assert [name for name, thing in things if not inspect.getdoc(thing)] == []


def test_every_number_states_its_shape_or_unit() -> None:
    assert [name for module in _modules() for name in _silent(module)] == []


def _silent(module: ModuleType) -> list[str]:
    """Return the numbers of a module that state neither."""
    missing = []
    for name, function in _functions(module):
        annotations = {k: v for k, v in function.__annotations__.items() if k != "return"}
        doc = inspect.getdoc(function) or ""
        missing += [f"{name}({p})" for p in unstated(annotations, doc, "Parameters")]
    for name, kind in _classes(module):
        if dataclasses.is_dataclass(kind):
            annotations = {f.name: f.type for f in dataclasses.fields(kind)}
            doc, beside = inspect.getdoc(kind) or "", _beside(kind)
            missing += [
                f"{name}.{p}"
                for p in unstated(annotations, doc, "Attributes")
                if not STATED.search(beside.get(p, ""))
            ]
    return missing


@dataclasses.dataclass
class _Fields:
    one: float  # length [m]
    two: float  # how long
    # (n, 3) of two lines,
    # here [m]
    three: list[float]
    # four, five: (n,) both
    four: float
    five: float
    six: float


def test_comments_of_fields_are_read() -> None:
    stated = {name for name, text in _beside(_Fields).items() if STATED.search(text)}
    assert stated == {"one", "three", "four", "five"}


def test_the_check_itself_sees_what_is_missing() -> None:
    doc = "Do.\n\nParameters\n----------\na : float\n    Length [m].\nb, c : float\n    Two.\n"
    numbers = {"a": "float", "b": "FloatArray", "c": "float | None", "d": "str", "e": "int"}
    assert unstated(numbers, doc, "Parameters") == ["b", "c", "e"]
    assert unstated({"a": "float"}, "Turn `a` [rad] around.", "Parameters") == []
    assert unstated({"a": "float"}, "Turn it around.", "Parameters") == ["a"]
    short = "Turn.\n\n`a`, `b` (n, 3): what `c` is not; `c`: from `a` [rad]; `e`: how often."
    assert unstated(dict.fromkeys("abcde", "float"), short, "Parameters") == ["d", "e"]
    assert unstated({"a": "Callable[[float], int]"}, "Call.", "Parameters") == []
