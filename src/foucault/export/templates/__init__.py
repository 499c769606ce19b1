"""Code of other programs: for each module of `export` a file of the pieces that it joins."""

from __future__ import annotations

import re
from pathlib import Path


def pieces(name: str) -> dict[str, str]:
    """Return the pieces of a file, each below a line of its name: ``==== next``."""
    text = (Path(__file__).parent / f"{name}.txt").read_text(encoding="utf-8")
    parts = re.split(r"^==== (\w+)\n", text, flags=re.MULTILINE)[1:]
    return {key: code.removesuffix("\n") for key, code in zip(parts[::2], parts[1::2], strict=True)}
