"""The packages and what they import, as a picture: arrows go downwards only.

Packages that import one another share a box.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from generators.pictures import Sheet

SOURCE = Path(__file__).parents[2] / "src" / "foucault"

WORDS = {
    "cli": "commands", "campaign": "runs", "report": "pages", "export": "for others",
    "procedures": "methods", "plans": "what to do", "simulate": "made logs",
    "estimate": "filters", "infer": "the engine", "diagnose": "is it right?",
    "guard": "mistakes", "detect": "rests, turns", "navigate": "strapdown",
    "logs": "readers", "models": "what is true", "kernels": "compiled",
}  # fmt: skip
"""What a package is for."""

WIDTH, LINE, HEIGHT = 720, 72, 38


def imported(tree: ast.AST) -> Iterator[str]:
    """Yield the modules of this package that a file imports, but not for types alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.ImportFrom) and node.module == "foucault":
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and str(node.module).startswith("foucault."):
            yield str(node.module).split(".")[1]
        else:
            yield from imported(node)


def graph() -> dict[str, set[str]]:
    """Return every package or module and those that it imports."""
    out: dict[str, set[str]] = {}
    there = {p.stem for p in SOURCE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    for path in SOURCE.rglob("*.py"):
        name = path.relative_to(SOURCE).parts[0].removesuffix(".py")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        out.setdefault(name, set()).update(set(imported(tree)) & there - {name})
    return {name: to for name, to in out.items() if not name.startswith("__")}


def reached(name: str, imports: dict[str, set[str]]) -> set[str]:
    """Return all that a package imports, directly or not."""
    out, new = set[str](), {name}
    while new:
        new = set().union(*(imports[one] for one in new)) - out
        out |= new
    return out


def grouped(imports: dict[str, set[str]]) -> dict[tuple[str, ...], set[tuple[str, ...]]]:
    """Return the same of groups: packages that import one another are one."""
    far = {name: reached(name, imports) for name in imports}
    group = {
        name: tuple(sorted({name} | {one for one in far[name] if name in far[one]}))
        for name in imports
    }
    out: dict[tuple[str, ...], set[tuple[str, ...]]] = {}
    for name, to in imports.items():
        out.setdefault(group[name], set()).update({group[one] for one in to} - {group[name]})
    return out


def rows(imports: dict[tuple[str, ...], set[tuple[str, ...]]]) -> list[list[tuple[str, ...]]]:
    """Return the groups line by line, each below all that import it."""
    left, out = dict(imports), []
    while left:
        out.append(sorted(one for one in left if not any(one in to for to in left.values())))
        left = {one: to for one, to in left.items() if one not in out[-1]}
    return out


def width(group: tuple[str, ...]) -> float:
    """Return how wide the box of a group is [pixel]."""
    return sum(max(96.0, 9.8 * len(name) + 14) for name in group)


def draw() -> str:
    """Draw the packages; of arrows those that others do not imply."""
    imports = grouped(graph())
    lines = rows(imports)
    sheet = Sheet(WIDTH, LINE * len(lines) + 8, "Packages of Foucault and what they import")
    at = {}
    for i, line in enumerate(lines):
        gap = (WIDTH - sum(map(width, line))) / (len(line) + 1)
        right = 0.0
        for one in line:
            right += gap + width(one)
            at[one] = right - width(one) / 2, 4.0 + LINE * i
    for one, to in imports.items():
        implied = set[tuple[str, ...]]()
        for other in to:
            implied |= reached(other, imports)
        for other in to - implied:
            (x, y), (u, v) = at[one], at[other]
            sheet.arrow((x, y + HEIGHT), (u, v - 1), "grey thin")
    for one, (x, y) in at.items():
        half = width(one) / 2
        corners = [(x - half, y), (x + half, y), (x + half, y + HEIGHT), (x - half, y + HEIGHT)]
        sheet.path(corners, "box", closed=True)
        for k, name in enumerate(one):
            middle = x - half + width(one[:k]) + width((name,)) / 2
            words = WORDS.get(name, "")
            sheet.text((middle, y + (16 if words else 24)), name, "title", "middle")
            sheet.text((middle, y + 31), words, "small", "middle")
    return sheet.svg()
