"""Lines of Python in each package: they may fall, and rise only where a capability is new."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import foucault

ROOT = Path(foucault.__file__).parent

BUDGET = {
    ".": 3_115,
    "campaign": 5_290,
    "cli": 4_923,
    "diagnose": 19_669,
    "estimate": 8_331,
    "export": 1_988,
    "infer": 1_368,
    "kernels": 4_288,
    "logs": 6_267,
    "models": 4_988,
    "navigate": 1_560,
    "plans": 6_105,
    "procedures": 13_724,
    "report": 9_905,
    "simulate": 3_626,
    "symptoms": 87,
}

SLACK = 100
"""Lines below its budget at which that of a package has to be lowered [1]."""


def test_no_package_grows_beyond_its_budget() -> None:
    lines: Counter[str] = Counter()
    for file in ROOT.rglob("*.py"):
        part = file.relative_to(ROOT).parts
        lines[part[0] if len(part) > 1 else "."] += len(file.read_text().splitlines())
    grown = {name: n for name, n in lines.items() if n > BUDGET.get(name, 0)}
    assert not grown, f"Over budget: {grown}. Delete first; CONTRIBUTING.md says when it may rise."
    loose = {name: lines[name] for name, n in BUDGET.items() if n - lines[name] > SLACK}
    assert not loose, f"Well done; lower the budget to {loose}, so that it stays."
