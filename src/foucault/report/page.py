"""What a page of the report is made of: sections of text, tables, figures and code.

Sections say what is shown; the template says how. Nothing here knows HTML.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from foucault.escape import address

GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "mu": "μ", "tau": "τ"}
"""Symbols that are letters of another alphabet."""


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Code:
    """Lines to copy."""

    text: str
    kind: str = "code"


@dataclass(frozen=True)
class Equation:
    """Equations in plain letters, one per line, to be typeset: ``b_a``, ``x^2``, ``A^-1``."""

    lines: Sequence[str]
    kind: str = "equation"


@dataclass(frozen=True)
class Facts:
    """What is what, as pairs; an empty value becomes a line to fill in by hand."""

    pairs: Sequence[tuple[str, str]]
    kind: str = "facts"


@dataclass(frozen=True)
class Items:
    """A list of sentences, each with a state: "good", "warning", "bad" or "plain"."""

    items: Sequence[tuple[str, str]]
    kind: str = "items"


@dataclass(frozen=True)
class Column:
    """A table column: its heading and how its cells look.

    `look` is "text", "short", "long" (may break anywhere), "meaning" (only where there is room),
    "name", "symbol", "number", "state" or "link" (cells are `Link`); `aside` columns are left out
    on a narrow screen, `optional` ones until they are asked for.
    """

    heading: str
    look: str = "text"
    aside: bool = False
    optional: bool = False


class Link(str):
    """The text of a cell that leads to a file beside the page, or to none."""

    address: str

    @classmethod
    def to(cls, file: str, text: str) -> Link:
        """Return `text` with a link to `file`, the page's neighbour; empty for none."""
        out = cls(text)
        out.address = address(file) if file else ""
        return out


@dataclass(frozen=True)
class Table:
    """A table: cells are text; a state cell is "good", "warning", "bad" or "plain".

    A row of one cell is a heading over the rows below it. `option` is the label of the switch
    that shows the optional columns; print shows them always.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    option: str = ""
    kind: str = "table"


@dataclass(frozen=True)
class Figure:
    """A plotly figure as plain dictionaries, with a sentence that says what it shows.

    `on` is "everywhere" or "screen" (left out in print); `share` is the part of the width it
    takes [percent], where there is room for more than one side by side; `alt` says to those who
    do not see it what is drawn, where the caption does not.
    """

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    caption: str = ""
    on: str = "everywhere"
    share: int = 100
    alt: str = ""
    kind: str = "figure"


Block = Text | Code | Equation | Facts | Items | Table | Figure


@dataclass(frozen=True)
class Section:
    """One section of the report."""

    title: str
    lead: str
    blocks: Sequence[Block]
