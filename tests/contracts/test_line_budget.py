"""Lines of Python in each package: they may fall, and rise only where a capability is new."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import foucault

ROOT = Path(foucault.__file__).parent

BUDGET = {
    ".": 3_273,
    "campaign": 5_110,
    "cli": 3_850,
    "detect": 4_441,
    "diagnose": 11_478,
    "estimate": 6_795,
    "export": 1_865,
    "guard": 1_941,
    "infer": 2_795,
    "kernels": 4_338,
    "logs": 6_100,
    "models": 5_454,
    "navigate": 2_097,
    "plans": 6_025,
    "procedures": 13_801,
    "recognise": 2_480,
    "report": 9_036,
    "simulate": 3_354,
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
