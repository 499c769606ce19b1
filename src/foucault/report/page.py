"""What a page of the report is made of: sections of text, tables, figures and code.

Sections say what is shown; the template says how. Nothing here knows HTML.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


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
class Items:
    """A list of sentences, each with a state: "good", "warning", "bad" or "plain"."""

    items: Sequence[tuple[str, str]]
    kind: str = "items"


@dataclass(frozen=True)
class Column:
    """A table column: its heading and how its cells look.

    `look` is "text", "long" (may break anywhere), "name", "symbol", "number" or "state";
    `aside` columns are left out on a narrow screen.
    """

    heading: str
    look: str = "text"
    aside: bool = False


@dataclass(frozen=True)
class Table:
    """A table: cells are text; a state cell is "good", "warning", "bad" or "plain".

    A row of one cell is a heading over the rows below it.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    kind: str = "table"


@dataclass(frozen=True)
class Figure:
    """A plotly figure as plain dictionaries, with a sentence that says what it shows.

    `on` is "everywhere" or "screen" (left out in print); `share` is the part of the width it
    takes [percent], where there is room for more than one side by side.
    """

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    caption: str = ""
    on: str = "everywhere"
    share: int = 100
    kind: str = "figure"


Block = Text | Code | Items | Table | Figure


@dataclass(frozen=True)
class Section:
    """One section of the report."""

    title: str
    lead: str
    blocks: Sequence[Block]
