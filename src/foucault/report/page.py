"""A document: what a page says, as sections of text, tables, figures and code.

Sections say what is shown; printers say how: a page of HTML, a screen, JSON. Nothing here knows
any of them. Titles and sentences stand in words.toml.
"""

from __future__ import annotations

import datetime
import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.coefficients import format_value
from foucault.display import Shown
from foucault.errors import Finding
from foucault.escape import address
from foucault.files import flat
from foucault.result import Check, Level

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ", "kappa": "κ", "lambda": "λ", "mu": "μ",
    "rho": "ρ", "tau": "τ", "psi": "ψ",
}  # fmt: skip
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

    @classmethod
    def of(cls, words: str) -> Column:
        """Return a column from its heading and, after a colon, its look: "± sd: number aside"."""
        heading, _, how = words.rpartition(":") if ":" in words else (words, "", "")
        look, shown = "text", {"aside": False, "optional": False}
        for word in how.split():
            if word in shown:
                shown[word] = True
            else:
                look = word
        return cls(heading, look, **shown)


def columns(*words: str) -> list[Column]:
    """Return columns from their words, " | " between them; empty words are no columns."""
    return [Column.of(one) for some in words for one in some.split(" | ") if some]


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


def table(*cells: tuple[str, Iterable[str] | None], option: str = "") -> Table:
    """Return a table from the words of each column and its cells; None for no such column."""
    kept = [(Column.of(words), list(some)) for words, some in cells if some is not None]
    rows = [list(row) for row in zip(*(some for _, some in kept), strict=True)]
    return Table([column for column, _ in kept], rows, option)


@dataclass(frozen=True)
class Figure(Shown):
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
    """One section of the report; `key` is that of its words."""

    title: str
    lead: str
    blocks: Sequence[Block]
    key: str = ""


@dataclass(frozen=True)
class Heading:
    """The top of a document: what was done, and the verdict."""

    title: str
    line: list[str]
    state: str
    word: str
    reasons: list[str]


@dataclass(frozen=True)
class Document:
    """What is said of a run, for every printer."""

    heading: Heading
    sections: Sequence[Section]

    def as_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and words, for JSON."""
        return asdict(self)

    @classmethod
    def of(cls, heading: Heading, *sections: Any) -> Document:
        """Return a document of what there is to say: sections, lists of them, or None."""
        return cls(heading, [s for s in _flat(sections) if s is not None])


def _flat(some: Any) -> Iterable[Any]:
    for one in some:
        if isinstance(one, list | tuple):
            yield from _flat(one)
        else:
            yield one


# -- sections and their words ----------------------------------------------------------------


@cache
def data_file(name: str) -> dict[str, Any]:
    """Return what a file beside this one holds: words.toml, or figures.toml."""
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    return tomllib.loads(text)


@cache
def _words() -> dict[str, str]:
    """Every sentence of words.toml by its key, such as "tumble.residuals.lead"."""
    return flat(data_file("words.toml"))


def said(*keys: str, **values: Any) -> str:
    """Return the sentences of these keys, filled with `values`; an empty key says nothing."""
    return " ".join(_words()[key].format(**values) for key in keys if key)


def told(key: str) -> str:
    """Return the sentence of a key, empty where there is none."""
    return _words().get(key, "")


FILLED = {"text": "text", "items": "items", "table": "rows"}
"""Kind of a block -> without which of its parts there is nothing to show."""


def section(
    key: str, /, *blocks: Any, lead: str | None = None, title: str | None = None, **values: Any
) -> Section | None:
    """Return a section with the title and the lead of `key`; None where no block is left.

    `blocks` may hold None, empty lists of items and tables without a row, which go, other lists,
    and text, which becomes a paragraph.
    """
    told = [Text(b) if isinstance(b, str) else b for b in _flat(blocks) if b is not None]
    kept = [b for b in told if getattr(b, FILLED.get(b.kind, "kind"))]
    if not kept:
        return None
    known = _words()
    title = known[f"{key}.title"].format(**values) if title is None else title
    if lead is None:
        lead = known.get(f"{key}.lead", "").format(**values)
    return Section(title, lead, kept, key)


STATES = {Level.PASS: "good", Level.DOUBTFUL: "warning", Level.UNUSABLE: "bad"}
WORDS = {Level.PASS: "Pass", Level.DOUBTFUL: "Doubtful", Level.UNUSABLE: "Unusable"}

_LOOKS = {"warning": "warning", "error": "bad"}


def findings(
    noticed: Iterable[Finding | Mapping[str, str]], where: str = "data", title: str = "Findings"
) -> Section | None:
    """Return what was noticed, each with its cure."""
    items = []
    for one in noticed:
        one = one.as_dict() if isinstance(one, Finding) else one
        items.append((_LOOKS.get(one["severity"], "plain"), f"{one['message']} {one['cure']}"))
    lead = f"Noticed in the {where}; the work went on."
    return Section(title, lead, [Items(items)], "findings") if items else None


def provenance(rows: Iterable[Sequence[str]]) -> Section:
    """Return what a report was made from and with, without what is not known."""
    known = [[what, value] for what, value in rows if value]
    return Section("Provenance", "", [Table(columns("what | value: long"), known)])


def facts(*pairs: tuple[str, str]) -> Facts:
    """Return what is known of some pairs."""
    return Facts([p for p in pairs if p[1]])


def checks(some: Iterable[Check | Mapping[str, Any]], lead: str = "") -> Section | None:
    """Return every test that a verdict rests on, with its limits."""
    every = [c if isinstance(c, Check) else check_of(c) for c in some]
    rows = [
        [
            "good" if c.passed else STATES[c.fails],
            c.name,
            "" if np.isnan(c.value) else _size_of(c.value),
            _limits(c.low, c.high),
            c.sentence,
        ]
        for c in every
    ]
    heads = columns(": state | check | value: number aside | limits: number aside | what it says")
    lead = lead or "Every test that the verdict rests on."
    return Section("Checks", lead, [Table(heads, rows)], "checks") if rows else None


def check_of(known: Mapping[str, Any]) -> Check:
    """Return a check of a JSON document."""
    value = math.nan if known["value"] is None else float(known["value"])
    return Check(**(dict(known) | {"value": value, "fails": Level(known["fails"])}))


def _limits(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{_size_of(low)} to {_size_of(high)}"
    if low is not None:
        return f"≥ {_size_of(low)}"
    return f"≤ {_size_of(high)}" if high is not None else ""


def _size_of(value: float) -> str:
    return minus(f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}")


def chi_square(what: str, row: Sequence[float | None]) -> tuple[str, str]:
    """Say how the residuals of `what` fit; `row` is the sum of squares, limits, and freedom.

    No upper limit, None, is that of residuals in which noise that is not white shows too.
    """
    value, low, high, dof = (float("inf") if v is None else v for v in row)
    fits = low <= value <= high
    size = [f"{v:.3g}" if v < 1e3 else f"{v:.0f}" for v in (value, low, high)]
    limits = f"{size[1]} to {size[2]}" if high < float("inf") else f"{size[1]} and above"
    text = f"{what}: chi-square {size[0]}, {'inside' if fits else 'outside'} {limits} ({dof:.0f} "
    return ("good" if fits else "warning", text + "degrees of freedom).")


# -- numbers and units as people write them --------------------------------------------------


def minus(text: str) -> str:
    """Write a minus sign as such."""
    return text.replace("-", "−")


def unsigned(text: str) -> str:
    """Write a minus sign as such, and a rounded zero without one."""
    return minus(text if float(text.rstrip(" %")) else text.lstrip("-"))


_UNIT_SIGNS = (
    (r"\bug\b", "µg"), (r"\bus\b", "µs"), (r"\buT\b", "µT"), (r"\bdeg\b", "°"),
    (r"\bdegC\b", "°C"), (r"\bpercent\b", "%"), (r"\bsqrt\((\w+)\)", r"√\1"),
    (r"\^2\b", "²"), (r"\^3\b", "³"),
)  # fmt: skip


def shown(unit: str) -> str:
    """Write a unit with the signs that people use."""
    for plain, sign in _UNIT_SIGNS:
        unit = re.sub(plain, sign, unit)
    return unit


_ONE = r"(?:ug|mg|g|count|us|ms|s|h|uT|nT|deg|degC|arcsec|arcmin|rad|ppm|ppb|percent|mm|m|K|Hz)"
_PART = rf"(?:{_ONE}|\({_ONE}/{_ONE}(?:\^\d)?\)|sqrt\({_ONE}\))(?:\^\d)?"
_AMOUNT = re.compile(rf"(?<=\d) ({_PART}(?:/{_PART})*)(?![\w/])")


def signs(text: str) -> str:
    """Write amounts in a sentence as tables do, but leave what is quoted to be copied."""
    parts = text.split('"')
    for i in range(0, len(parts), 2):
        part = _AMOUNT.sub(_amount, parts[i]).replace(" +- ", " ± ")
        part = part.replace(" %", "\N{NO-BREAK SPACE}%")
        parts[i] = re.sub(r"(?<![^\s(±≤≥])-(?=\d)", "\N{MINUS SIGN}", part)
    return '"'.join(parts)


def _amount(found: re.Match[str]) -> str:
    unit = shown(found[1])
    if unit == found[1]:
        return found[0]
    return unit if unit == "°" else f"\N{NO-BREAK SPACE}{unit}"


def known_to(value: float, sd: float | None) -> str:
    """Write a number to the second digit of its standard deviation."""
    return minus(format_value(value, sd))


def size(sd: float | None) -> str:
    """Write an uncertainty to its second digit; nothing where there is none."""
    return format_value(sd, sd) if sd and np.isfinite(sd) else ""


def unit_of(kind: str, *values: npt.ArrayLike) -> tuple[str, float]:
    """Return the unit, as people write it, for the largest of `values` [SI], and its size."""
    every = np.concatenate([np.abs(np.asarray(v, float)).ravel() for v in values])
    unit = units.display_unit(kind, float(every[np.isfinite(every)].max(initial=0.0)))
    return shown(unit), units.factor(unit, kind)


def quantity(value: float, kind: str, digits: int = 3) -> str:
    """Write a quantity [SI] in the unit that people would use."""
    unit, one = unit_of(kind, value)
    return f"{units.plain(value / one, digits)} {unit}"


def counted(n: int, what: str) -> str:
    """Write a number of things, n, shape () [1]."""
    return f"{n} {what}{'s' * (n != 1)}"


def words(value: Any) -> str:
    """Write a plain JSON value for people."""
    if isinstance(value, Mapping):
        return "; ".join(f"{k} {words(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(words(v) for v in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return "unknown" if value is None else str(value)


def angle(degrees: float) -> str:
    """Write the uncertainty of an angle [deg] to two digits, in the unit people would use."""
    unit, one = angle_unit(degrees)
    return f"{units.plain(degrees / one, 2)} {unit}".replace(" °", "°")


def angle_unit(degrees: float) -> tuple[str, float]:
    """Return the unit that people would read so many degrees in, and its size [deg]."""
    unit, one = unit_of("angle", math.radians(degrees))
    return unit, math.degrees(one)


# -- of which instrument, where, when, from what ---------------------------------------------


def date(text: str) -> str:
    """Write an ISO date for people; anything else stays as it is."""
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{moment.day} {moment:%B %Y, %H:%M} {moment:%Z}".strip()


def place(site: dict[str, Any]) -> str:
    """Write latitude and height for people."""
    parts = []
    if site.get("latitude") is not None:
        degrees = float(np.rad2deg(site["latitude"]))
        parts.append(f"{abs(degrees):.4f}° {'N' if degrees >= 0 else 'S'}")
    if site.get("height"):
        parts.append(f"{site['height']:.0f} m")
    return ", ".join(parts)


def gravity(site: dict[str, Any]) -> str:
    """Write local gravity, its uncertainty and where it is from."""
    if site.get("gravity") is None:
        return ""
    sd = site.get("gravity_sd")
    known = f" ± {sd:.6f}".rstrip("0") if sd else ""
    source = f" ({site['gravity_source']})" if site.get("gravity_source") else ""
    return f"{site['gravity']:.5f}{known} m/s²{source}"


def instrument(about: dict[str, Any]) -> str:
    """Write name and serial number of an instrument."""
    return " ".join(str(about[k]) for k in ("name", "serial") if about.get(k))


def origin(about: Mapping[str, Any], where: str | None = None) -> list[str]:
    """Return instrument, place and date of a run in a few words."""
    created = (about.get("provenance") or {}).get("created")
    parts = [instrument(about.get("instrument") or {}), where or place(about["site"])]
    return [part for part in (*parts, date(str(created)) if created else "") if part]


def made_from(about: Mapping[str, Any], files: Mapping[str, str]) -> Section:
    """Return files, settings and versions of a run; `files` are keys and what they are called."""
    made = about["provenance"]
    rows = [(k, str(made.get(k, ""))) for k in ("created", "seconds")]
    for key, name in files.items():
        rows += [(f"{name or key}: {k}", words(v)) for k, v in (made.get(key) or {}).items()]
    settings = made.get("settings") or about.get("settings") or {}
    rows.append(("settings [SI]", words({k: v for k, v in settings.items() if v is not None})))
    return provenance([*rows, ("versions", words(made.get("versions") or {}))])


_ORDER = ("error", "warning", "note")


def counted_once(noticed: Iterable[Finding]) -> list[dict[str, str]]:
    """Return each kind of finding once, with how many there are, the gravest first."""
    kinds: dict[str, list[Finding]] = {}
    for one in noticed:
        kinds.setdefault(one.code, []).append(one)
    out = []
    for some in kinds.values():
        more = f" (and {len(some) - 1} more like it)" if len(some) > 1 else ""
        out.append(some[0].as_dict() | {"message": some[0].message + more})
    return sorted(out, key=lambda one: _ORDER.index(one["severity"]))


ALIKE = 3  # Findings of one kind that are written out [1].


def grouped(noticed: Sequence[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return findings, of many of one kind the first few and how many there are."""
    out: list[Mapping[str, str]] = []
    for code in dict.fromkeys(f["code"] for f in noticed):
        mine = [f for f in noticed if f["code"] == code]
        out += mine[:ALIKE]
        if len(mine) > ALIKE:
            more = f"The same in {len(mine) - ALIKE} more set-ups."
            out[-1] = dict(out[-1]) | {"cure": f"{out[-1]['cure']} {more}"}
    return out
