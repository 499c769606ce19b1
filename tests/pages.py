"""What a page holds, as tests read it."""

from __future__ import annotations

import json
import re
from html import unescape
from typing import Any


def figures(page: str) -> list[dict[str, Any]]:
    """Return the figures that a script draws, in order."""
    found = re.findall(r'<script type="application/json">(.*?)</script>', page)
    return [json.loads(text) for text in found]


def titles(page: str) -> list[str]:
    """Return the titles of its sections."""
    return [unescape(t) for t in re.findall(r"<h2 id=[^>]*>(.*?)</h2>", page)]


def text_of(page: str, title: str) -> str:
    """Return what a section says, without marks."""
    part = page[page.index(f">{title}</h2>") :]
    part = part[: part.index("</section>")]
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", part)))
