"""The page of benchmarks: benchmarks/README.md, which `make bench` writes."""

from __future__ import annotations

import re
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks" / "README.md"


def page() -> str:
    text = BENCHMARKS.read_text(encoding="utf-8").replace("# Benchmarks", "# Speed", 1)
    return re.sub(r"\.\./docs/", "", text).replace("[docs/", "[")
