"""How things show themselves in a notebook: by the pages of `report`, loaded when one is shown."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from html import escape
from importlib import import_module
from typing import Any


class Shown:
    """What a notebook shows as HTML instead of its `repr`."""

    def _repr_html_(self) -> str:
        html: str = printer().html(self)
        return html


def printer() -> Any:
    """Return the module that draws for notebooks; nothing below `report` imports it."""
    return import_module("foucault.report.notebook")


@cache
def _display() -> Any:
    """Return the `display` of IPython where a kernel runs, None elsewhere."""
    if "ipykernel" not in sys.modules:
        return None
    return import_module("IPython.display")


def progress() -> Callable[[float, str], None]:
    """Return ``tell(fraction, words)``: a bar in a notebook, which ends at 1; silent elsewhere."""
    show = _display()
    held: list[Any] = []

    def tell(fraction: float, words: str) -> None:
        if show is None:
            return
        bar = f'<progress max="1" value="{fraction:.3f}"></progress> {escape(words)}'
        if not held:
            held.append(show.display(show.HTML(bar), display_id=True))
        else:
            held[0].update(show.HTML("" if fraction >= 1 else bar))

    return tell
