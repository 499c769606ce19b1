"""What the titles of columns say: which sensor, which axis, which number of several, which unit.

The words are data, `titles.toml`. A title is taken apart from its end: a unit in brackets or as an
ending, then the axis, then what is left is looked up.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

_BRACKET = re.compile(r"\s*[(\[{<]\s*([^()\[\]{}<>]*?)\s*[)\]}>]\s*$")
_INDEX = re.compile(r"^(?:[0-2xyzXYZ]|axis\s*[xyz0-2])$")
_SPEAKS = re.compile(r"(?:\s+in\s+|\s*/\s*|,\s*)([^\s].*)$")
_CAMEL = re.compile(r"(?<=[a-zà-ÿ])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_ROLL = {"p": 0, "q": 1, "r": 2, "roll": 0, "pitch": 1, "yaw": 2, "phi": 0, "theta": 1, "psi": 2}
"""Axes of rates in the words of flight."""


@dataclass(frozen=True)
class Meaning:
    """What a title says; empty where it says nothing."""

    role: str = ""  # accel, gyro, time, ... a table of titles.toml
    axis: int | None = None  # 0, 1, 2 for x, y, z [1]
    sensor: str = ""  # what tells one of several triads of a role from another
    unit: str = ""  # as this program writes it
    gravity: bool = False  # its logger reads gravity, +1 g down


@cache
def _words() -> dict[str, Any]:
    text = Path(__file__).with_name("titles.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def unit_of(text: str) -> str:
    """Return a unit as this program writes it, "" where the text is none that is known."""
    plain = text.strip().strip("()[]{}").strip().lower().replace("**", "^").replace("  ", " ")
    known: dict[str, str] = _words()["units"]
    return known.get(plain) or known.get(plain.replace(" ", "")) or ""


def units_row(cells: Sequence[str]) -> bool:
    """Tell whether the cells of a line are units: half of those that say something."""
    said = [cell for cell in cells if cell.strip("-() []")]
    return bool(said) and 2 * sum(bool(unit_of(cell)) for cell in said) >= len(said)


def meaning(title: str, unit: str = "") -> Meaning:
    """Return what a title means; `unit`: what a row of units says of the column."""
    rest, found = _without_unit(title.strip().strip('"'))
    unit = unit_of(unit) or found
    tokens = _tokens(rest)
    if not tokens:
        return Meaning(unit=unit)
    whole = "".join(tokens)
    if whole in ("p", "q", "r"):  # rates in the words of flight
        return Meaning("gyro", _ROLL[whole], unit=unit)
    gravity = any(word in whole for word in _words()["gravity"]["has"])
    plain = _role(_stem(tokens))
    if unit in ("s", "ms", "us", "ns", "min", "day") and plain in ("", "temperature"):
        plain = "time"
    if unit in ("m", "cm", "mm") and not plain:  # where something is
        plain = "other"
    axes = _axes(tokens)
    for axis, left in axes:
        role = _role(_stem(left))
        if role == "gyro" or (role and role not in ("time", "counter")):
            # "roll" of an attitude is none of the turn; a rate of it is.
            return Meaning(role, axis, "".join(re.findall(r"\d+", " ".join(left))), unit, gravity)
    number = "".join(re.findall(r"\d+", " ".join(tokens)))
    # In words that are not known an axis is one all the same.
    alone = axes[0][0] if axes and not plain and {"x", "y", "z"} & set(tokens) else None
    return Meaning(plain, alone, number if plain not in ("time", "counter") else "", unit)


def _without_unit(title: str) -> tuple[str, str]:
    """Return a title without its unit, and the unit."""
    bracket = _BRACKET.search(title)
    if bracket and not _INDEX.match(bracket[1]):
        return title[: bracket.start()], unit_of(bracket[1])
    spoken = _SPEAKS.search(title)
    if spoken and unit_of(spoken[1]):
        return title[: spoken.start()], unit_of(spoken[1])
    index = title[bracket.start() :] if bracket else ""
    body = title[: bracket.start()] if bracket else title
    low = body.lower()
    for end in sorted(_words()["units"], key=len, reverse=True):
        # "time_ms", "gyro_rad[0]": an ending apart; "timestamp" does not end in a unit.
        for mark in ("_", " ", "."):
            if (
                low.endswith(mark + end)
                and len(low) > len(end) + 1
                and end not in ("g's", "c", "f")
            ):
                return body[: -len(end) - 1] + index, _words()["units"][end]
    return title, ""


def _tokens(text: str) -> list[str]:
    """Return the words of a title, lower case, without accents."""
    split = _CAMEL.sub(" ", text)
    bare = "".join(c for c in unicodedata.normalize("NFKD", split) if not unicodedata.combining(c))
    bare = unicodedata.normalize("NFC", bare)  # letters of Korean stay whole
    return re.findall(r"[^\W\d_]+|\d+", bare.lower())


def _axes(tokens: list[str]) -> list[tuple[int, list[str]]]:
    """Return the axes that a title may name, the likeliest first, with what is left of it."""
    found: list[tuple[int, list[str]]] = []
    for i in (len(tokens) - 1, *range(len(tokens) - 1)):
        word, left = tokens[i], tokens[:i] + tokens[i + 1 :]
        if word in ("x", "y", "z", "xout", "yout", "zout"):
            found.append(("xyz".index(word[0]), left))
    if found:
        return found
    last, first = tokens[-1], tokens[0]
    if len(tokens) > 1 and last in ("0", "1", "2"):
        found.append((int(last), tokens[:-1]))
    if len(last) > 1 and last[-1] in "xyz":
        found.append(("xyz".index(last[-1]), [*tokens[:-1], last[:-1]]))
    elif tokens[-1].isdigit() and len(tokens) > 1 and tokens[-2][-1] in "xyz":  # "ax1"
        word = tokens[-2]
        found.append(("xyz".index(word[-1]), [*tokens[:-2], word[:-1], last]))
    if len(first) > 1 and first[0] in "xyz":
        found.append(("xyz".index(first[0]), [first[1:], *tokens[1:]]))
    if first[0] in "xyz" and not first.isascii():
        found.append(("xyz".index(first[0]), [first[1:], *tokens[1:]]))
    for i, word in enumerate(tokens[:-1]):  # "ax_low", "gz_filt"
        if len(word) > 1 and word[-1] in "xyz" and _role(word[:-1]) in ("accel", "gyro", "mag"):
            left = [t for t in tokens[i + 1 :] if t.isdigit()]
            found.append(("xyz".index(word[-1]), [word[:-1], *left]))
    for i, word in enumerate(tokens):
        left = tokens[:i] + tokens[i + 1 :]
        # "q_w" is of a quaternion.
        if word in _ROLL and left and _role("".join(left)) == "gyro" and (i or left != ["w"]):
            found.append((_ROLL[word], left))
    return found


def _stem(tokens: list[str]) -> str:
    """Return the letters of a title without words that name a part or a message."""
    ignored = _words()["ignored"]["is"]
    letters = [re.sub(r"\d", "", token) for token in tokens]
    return "".join(word for word in letters if word not in ignored) or "".join(letters)


def _role(stem: str) -> str:
    known = _words()["stamp"]
    if stem in known["is"]:
        return "time"
    if any(word in stem for word in known["has"]) and "relative" not in stem and "dt" not in stem:
        return "time"
    roles = {role: words for role, words in _words().items()
             if role not in ("units", "gravity", "ignored", "stamp")}  # fmt: skip
    # "dtheta" is no "dt".
    whole = next((role for role, words in roles.items() if stem in words.get("is", ())), "")
    return whole or next(
        (role for role, words in roles.items() if any(word in stem for word in words["has"])), ""
    )
