"""CONTRIBUTING.md as a page of the site, with the picture of the packages where it is spoken of."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
MARK = "<!-- the picture of the packages stands here in the site -->"
PICTURE = "![Every package above those that it imports](images/packages.svg)"


def page() -> str:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    if MARK not in text:
        raise ValueError("CONTRIBUTING.md no longer says where the picture of the packages stands.")
    return text.replace(MARK, PICTURE).replace("](docs/", "](")
