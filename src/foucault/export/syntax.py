"""How files of receivers are written: numbers, lists and keys, there and back.

The readers of these files differ in what they take for a number (`number_in`): PyYAML wants a point
and a sign of the exponent, OpenCV a first line ``%YAML:1.0`` and items indented deeper than their
key. What `lines_of` writes is right for all of them; what `read` finds may come from anybody.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from foucault.export.request import number

Found = dict[str, Any]
"""Path of a key, its parts joined by points -> a number, nested lists of numbers, or a text."""


@dataclass(frozen=True)
class Syntax:
    """One kind of file."""

    mark: str  # what begins a comment; "" where there are none
    line: str  # a row: {key}, {value}
    brackets: tuple[str, str, str]  # opening, between, closing, of a list
    rows_between: str = ", "  # between the rows of a matrix
    first: str = ""  # what has to stand before everything else


SYNTAXES = {
    "yaml": Syntax("#", "{key}: {value}", ("[", ", ", "]")),
    "opencv": Syntax("#", "{key}: {value}", ("[", ", ", "]"), first="%YAML:1.0"),
    "json": Syntax("", "", ("[", ", ", "]")),
    "launch": Syntax(
        "<!--", '  <param name="{key}" value="{value}" type="double"/>', ("", " ", "")
    ),
    "info": Syntax(";", "{key} {value}", ("", " ", "")),
    "px4": Syntax("#", "param set {key} {value}", ("", " ", "")),
    "ardupilot": Syntax("#", "{key},{value}", ("", " ", "")),
    "python": Syntax("#", "", ("[", ", ", "]")),
    "c++": Syntax("//", "", ("{", ", ", "}")),
    "matlab": Syntax("%", "", ("[", " ", "]"), rows_between="; "),
}

# -- There ---------------------------------------------------------------------------------------


def text_of(value: Any, syntax: Syntax) -> str:
    """Write a number or nested lists of numbers, as they stand in one line."""
    if not isinstance(value, list):
        return number(value)
    opening, between, closing = syntax.brackets
    if value and isinstance(value[0], list):
        if syntax.rows_between == "; ":  # a matrix has one pair of brackets
            return opening + "; ".join(between.join(map(number, row)) for row in value) + closing
        between = syntax.rows_between
    return opening + between.join(text_of(item, syntax) for item in value) + closing


def entry(key: str, value: Any, syntax: Syntax, pad: str = "") -> list[str]:
    """Return the lines of one key; a matrix of YAML has one line for each row."""
    if isinstance(value, list) and isinstance(value[0], list):
        return [f"{pad}{key}:", *(f"{pad}  - {text_of(row, syntax)}" for row in value)]
    return [pad + syntax.line.format(key=key, value=text_of(value, syntax))]


def moved(before: list[str], groups: list[str], braces: bool) -> list[str]:
    """Return the lines that lead from one group of keys to another, with braces or indented."""
    same = 0
    while same < min(len(groups), len(before)) and groups[same] == before[same]:
        same += 1
    out = [f"{'  ' * k}}}" for k in reversed(range(same, len(before)))] if braces else []
    for k in range(same, len(groups)):
        pad = "  " * k
        out += [f"{pad}{groups[k]}", f"{pad}{{"] if braces else [f"{pad}{groups[k]}:"]
    return out


def json_of(rows: Sequence[tuple[str, Any]], remark: str, words: list[str], texts: Any) -> str:
    """Write a JSON document of rows by path, with `words` under the key `remark`."""
    out: dict[str, Any] = {remark: "\n".join(words) if remark == "comment" else words, **texts}
    for path, value in rows:
        place = out
        *groups, key = path.split(".")
        for group in groups:
            place = place.setdefault(group, {})
        place[key] = value
    return json.dumps(out, indent=4, allow_nan=False, ensure_ascii=False) + "\n"


# -- And back ------------------------------------------------------------------------------------

_PYYAML = re.compile(r"[-+]?(?:[0-9][0-9_]*)\.[0-9_]*(?:[eE][-+][0-9]+)?|[-+]?[1-9][0-9_]*|[-+]?0"
                     r"|[-+]?\.[0-9_]+(?:[eE][-+][0-9]+)?")  # fmt: skip
"""Decimal numbers of PyYAML; it takes 1e-05 and 1.0e5 for text."""

_WITH_POINT = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+|\d+(?=[eE]))(?:[eE][-+]?\d+)?")
"""What OpenCV holds as a real number: versions of ORB-SLAM3 stop on an integer."""

_LIKE_A_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def number_in(text: str, reader: str) -> float | str:
    """Return the number that a reader finds in a word, or the word where it finds none."""
    word = text.strip()
    rule = {"PyYAML": _PYYAML, "ORB-SLAM3": _WITH_POINT}.get(reader, _LIKE_A_NUMBER)
    return float(word.replace("_", "")) if rule.fullmatch(word) else word


def read(name: str, text: str, reader: str) -> Found:
    """Return what a file has, by path; of code what its lines assign, see `assigned`."""
    if name in ("yaml", "opencv"):
        return dict(_yaml(text, reader))
    if name == "json":
        return dict(_leaves(json.loads(text), ""))
    if name == "launch":
        return {
            m["name"]: _of_launch(m)
            for m in map(_attributes, re.findall(r"<param\b[^>]*>", _without_xml_remarks(text)))
            if {"name", "value"} <= m.keys()
        }
    if name == "info":
        return dict(_info(text))
    pattern = {
        "px4": r"^\s*(?:param\s+set(?:-default)?|\d+\s+\d+)\s+(\w+)\s+(\S+)",
        "ardupilot": r"^\s*(?:param\s+set\s+)?(\w+)[,\s]\s*([-+.\deE]+)",
    }.get(name)
    if pattern is None:
        return {}
    return {m[0]: number_in(m[1], reader) for m in re.findall(pattern, text, re.MULTILINE)}


def _of_launch(param: Mapping[str, str]) -> float | str:
    """Return the number that roslaunch makes of a parameter: without a type it wants a point."""
    text = param["value"].strip()
    plain = "." in text or text.lstrip("+-").isdigit()
    return number_in(text, "") if plain or param.get("type") == "double" else text


def assigned(lines: Sequence[tuple[str, str]], name: str, text: str, reader: str) -> Found:
    """Return what code has in the place of {} in its lines, by key.

    `lines`: key and line of each row.
    """
    mark = SYNTAXES[name].mark
    code = "\n".join(line.partition(mark)[0] for line in text.splitlines())
    out: Found = {}
    for key, line in lines:
        before = line.strip().partition("{}")[0]
        # A line may be spaced otherwise.
        pattern = r"\s*".join(map(re.escape, re.findall(r"\w+|[^\w\s]", before)))
        if found := re.search(pattern + r"\s*", code):
            value = _balanced(code[found.end() :])
            out[key] = _bracketed(value, reader)
            code = code[: found.start()] + code[found.end() + len(value) :]
    return out


def _balanced(text: str) -> str:
    """Return the list at the beginning of a text, to the bracket that closes it; else its word."""
    if text[:1] not in ("[", "{"):
        return text[: len(text) - len(text.lstrip("-+.0123456789eE"))]
    depth = 0
    for end, character in enumerate(text, start=1):
        depth += (character in "[{") - (character in "]}")
        if depth == 0:
            return text[:end]
    return text


def _bracketed(text: str, reader: str) -> Any:
    """Return a number, or lists as Python, YAML, C++ and MATLAB write them."""
    text = text.strip()
    if not text.startswith(("[", "{")):
        return number_in(text, reader)
    inner = text[1:-1] if text[-1] in "]}" else text[1:]
    if ";" in inner:
        return [_bracketed(f"[{row}]", reader) for row in inner.split(";") if row.strip()]
    items = re.findall(r"[\[{][^\]}]*[\]}]|[^\s,\[\]{}]+", inner)
    return [_bracketed(item, reader) for item in items]


def _yaml(text: str, reader: str) -> Iterator[tuple[str, Any]]:
    """Yield path and value of each key; lists of rows, or over several lines, are one value."""
    stack: list[tuple[int, str]] = []
    rows: list[Any] = []
    path, pending = "", ""
    for raw in [*text.splitlines(), "end: 0"]:
        if raw.startswith("%YAML") or raw.strip() in ("---", "..."):
            continue
        line = re.sub(r"(^|\s)#.*", "", raw).rstrip()
        if not line:
            continue
        if pending:
            pending += " " + line.strip()
            if pending.count("[") > pending.count("]"):
                continue
            yield path, _bracketed(pending, reader)
            pending = ""
            continue
        body = line.lstrip(" ")
        indent = len(line) - len(body)
        if body.startswith("- ["):
            rows.append(_bracketed(body[2:], reader))
            continue
        if body.startswith("- ") and isinstance(item := number_in(body[2:], reader), float):
            rows.append(item)
            continue
        if rows:
            yield path, rows
            rows = []
        while body.startswith("- "):
            indent, body = indent + 2, body[2:].lstrip()
        key, colon, value = body.partition(":")
        if not colon:
            continue
        while stack and stack[-1][0] >= indent:
            stack.pop()
        stack.append((indent, key.strip().strip("\"'")))
        path = ".".join(part for _, part in stack).removesuffix(".data")
        value = re.sub(r"^!!\S+", "", value.strip()).strip()
        if value.count("[") > value.count("]"):
            pending = value
        elif value:
            yield path, _bracketed(value, reader) if value[0] == "[" else number_in(
                value.strip("\"'") if value[0] not in "\"'" else value, reader)  # fmt: skip


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, float(value)
    else:
        yield path, value


def _info(text: str) -> Iterator[tuple[str, Any]]:
    groups: list[str] = []
    last = ""
    for raw in text.splitlines():
        words = raw.partition(";")[0].split()
        for word in words:
            if word == "{":
                groups.append(last)
            elif word == "}":
                groups[-1:] = []
        words = [word for word in words if word not in "{}"]
        if len(words) == 2:
            yield ".".join([*groups, words[0]]), number_in(words[1], "")
        last = words[0] if words else last


def _without_xml_remarks(text: str) -> str:
    return re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)


def _attributes(tag: str) -> dict[str, str]:
    return dict(re.findall(r"(\w+)\s*=\s*\"([^\"]*)\"", tag))
