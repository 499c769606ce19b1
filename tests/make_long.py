"""Write `long.toml`: the tests that `make test` leaves to `make thorough`, by what they took.

    make thorough PYTEST_ADDOPTS=--junit-xml=a.xml; make tests PYTEST_ADDOPTS=--junit-xml=b.xml
    python tests/make_long.py a.xml b.xml

Measure with kernels compiled and the machine at rest. Of a family of cases the long ones are named
alone, but where most are long. What a run does not hold stays as it was.
"""

from __future__ import annotations

import argparse
import ast
import json
import tomllib
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from pathlib import Path

HERE = Path(__file__).parent
TABLE = HERE / "long.toml"
SHORT = 0.3
"""A test of `make test` takes less [s]."""
ALWAYS = ("contracts/test_golden.py", "contracts/test_imports.py")
"""What guards every change, whatever it takes."""


def table() -> dict[str, list[str]]:
    """Return the names of the long tests of each file; a family by its name without a case."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def measured(files: list[str]) -> dict[str, dict[str, float]]:
    """Return the seconds of every test, by file and name, of JUnit files."""
    found: dict[str, dict[str, float]] = defaultdict(dict)
    for file in files:
        for case in ElementTree.parse(file).getroot().iter("testcase"):
            path = case.get("classname", "").removeprefix("tests.").replace(".", "/") + ".py"
            found[path][case.get("name", "")] = float(case.get("time", 0))
    return found


def long_ones(cases: dict[str, float], slower: float) -> list[str]:
    """Return what is long of a file's tests, measured on a machine so many times `slower` [1]."""
    families: dict[str, list[str]] = defaultdict(list)
    for name in cases:
        families[name.partition("[")[0]].append(name)
    out = []
    for family, names in families.items():
        some = [name for name in names if cases[name] > SHORT * slower]
        out += [family] if 2 * len(some) > len(names) else some
    return sorted(out)


def there(path: str) -> set[str]:
    """Return the names of the functions of a file of tests."""
    tree = ast.parse((HERE / path).read_text(encoding="utf-8")) if (HERE / path).exists() else None
    return {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)} if tree else set()


def main() -> None:
    """Take files of JUnit, and how much slower than usual the machine was."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("files", nargs="*")
    given.add_argument("--slower", type=float, default=1.0)
    asked = given.parse_args()
    rows = table() if TABLE.exists() else {}
    for path, cases in measured(asked.files).items():
        families = {name.partition("[")[0] for name in cases}
        stay = [name for name in rows.get(path, []) if name not in cases and name not in families]
        mine = [] if path in ALWAYS else long_ones(cases, asked.slower)
        rows[path] = sorted({*stay, *mine})
    rows = {p: [n for n in names if n.partition("[")[0] in there(p)] for p, names in rows.items()}
    lines = ["# By tests/make_long.py: what `make test` leaves to `make thorough`."]
    for path in sorted(rows):
        if rows[path]:  # a string of JSON is one of TOML
            names = [f"  {json.dumps(name, ensure_ascii=False)}," for name in rows[path]]
            lines += ["", f'"{path}" = [', *names, "]"]
    TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
