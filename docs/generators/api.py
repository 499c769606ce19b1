"""The page of the Python names, from their docstrings."""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
from collections.abc import Iterator
from typing import Any

import foucault

GROUPS = {
    "Calibrate": ("load_campaign", "calibrate", "simulate_campaign", "Campaign"),
    "Logs": ("LogDescription", "read_log", "write_log", "Log"),
    "Results": (
        "load_result", "save_result", "Result", "CoefficientVector", "Verdict", "Level", "Check",
        "Finding", "Status", "FoucaultError",
    ),
    "Models": ("ImuModel", "Layout", "ImuNoise", "grade", "Site"),
    "Attitude and way": ("align_log", "navigate_log", "increments_of", "simulate_motion", "State"),
    "Units": ("parse_unit", "convert_unit"),
}  # fmt: skip
"""Heading -> names in the order of the page; a public name that is missing comes at the end."""

HEAD = """\
# Python

Written from the docstrings. `import foucault` costs little: a name loads its module when it is
first used. Arguments, arrays and attributes are in SI and radians, frames and signs as in
[conventions](conventions.md). These names stay; everything else may move between versions, and has
its own docstring: `help(foucault.estimate)`.
"""


def page() -> str:
    groups = dict(GROUPS)
    named = {name for names in GROUPS.values() for name in names}
    groups["More"] = tuple(name for name in foucault.__all__ if name not in named)
    lines = [HEAD]
    for heading, names in groups.items():
        names = tuple(name for name in names if name in foucault.__all__)
        if names:
            lines += [f"## {heading}", ""]
        for name in names:
            lines += [f"### {name} {{ #{name} }}", ""]
            lines += _thing(name, getattr(foucault, name))
    return "\n".join(lines).rstrip() + "\n"


def _thing(name: str, thing: Any) -> list[str]:
    if not inspect.isclass(thing):
        return [*_signature(f"foucault.{name}", thing), *_docstring(thing)]
    lines = _docstring(thing)
    if issubclass(thing, enum.Enum):
        lines += [f"- `{m.name}`: `{m.value!r}`" for m in thing] + [""]
    if fields := getattr(thing, "model_fields", None):
        lines += _fields(fields)
    for key, member in _members(thing):
        if isinstance(member, property) or not callable(member):
            about = inspect.getdoc(member) or ""
            lines += [f"**`{name}.{key}`**", "", *_prose(about)]
        else:
            lines += [*_signature(f"{name}.{key}", member), *_docstring(member)]
    return lines


def _members(thing: type) -> Iterator[tuple[str, Any]]:
    """Yield public methods and properties with a docstring of their own."""
    for key, member in vars(thing).items():
        member = getattr(member, "__func__", member)
        if key.startswith("_") or not (inspect.isfunction(member) or isinstance(member, property)):
            member = getattr(member, "func", None)  # functools.cached_property
            if key.startswith("_") or member is None:
                continue
            member = property(member)
        if dataclasses.is_dataclass(thing) and key in thing.__dataclass_fields__:
            continue
        if inspect.getdoc(member):
            yield key, member


def _signature(name: str, function: Any) -> list[str]:
    parameters = list(inspect.signature(function).parameters.values())
    if parameters and parameters[0].name in ("self", "cls"):
        parameters = parameters[1:]
    words, starred = [], False
    for p in parameters:
        if p.kind is p.KEYWORD_ONLY and not starred:
            words.append("*")
            starred = True
        default = "" if p.default is p.empty else f"={_default(p.default)}"
        words.append(
            {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "") + p.name + default
        )
    line = f"{name}({', '.join(words)})"
    if len(line) > 88:
        line = f"{name}(\n    " + ",\n    ".join(words) + ",\n)"
    return ["```text", line, "```", ""]


def _default(value: Any) -> str:
    return "..." if callable(value) else repr(value)


def _fields(fields: dict[str, Any]) -> list[str]:
    rows = [f"| `{key}` | {' '.join((f.description or '').split())} |" for key, f in fields.items()]
    return ["| key | |", "|---|---|", *rows, ""]


def _docstring(thing: Any) -> list[str]:
    """Return a numpydoc docstring as Markdown: sections in bold, entries as a table."""
    text = inspect.getdoc(thing) or ""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text, flags=re.M)
    lines = _prose(parts[0])
    for heading, body in zip(parts[1::2], parts[2::2], strict=True):
        if heading in ("Parameters", "Attributes", "Returns", "Raises"):
            lines += ["| " + heading + " | |", "|---|---|", *_entries(body), ""]
        else:
            lines += [f"*{heading}.*", "", *_prose(body)]
    return lines


def _entries(body: str) -> Iterator[str]:
    for entry in re.split(r"\n(?=\S)", body.strip()):
        head, _, about = entry.partition("\n")
        name, _, kind = head.partition(" : ")
        words = _escaped(" ".join(about.split()))
        yield f"| `{name}` | {f'*{_escaped(kind)}*. ' if kind else ''}{words} |"


def _prose(text: str) -> list[str]:
    """Return reStructuredText paragraphs as Markdown, literal blocks as code."""
    lines: list[str] = []
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        if not paragraph.strip():
            continue
        if paragraph.startswith("    "):
            lines += ["```text", inspect.cleandoc(paragraph), "```", ""]
        else:
            words = " ".join(re.sub(r"^\.\. (\[\d+\])", r"\1", paragraph).split())
            lines += [_escaped(re.sub(r"::$", ":", words)), ""]
    return lines


def _escaped(text: str) -> str:
    quoted = re.split(r"``?", text)
    quoted[::2] = [re.sub(r"([*_<>|\[\]])", r"\\\1", part) for part in quoted[::2]]
    quoted[1::2] = [part.replace("|", r"\|") for part in quoted[1::2]]
    return "`".join(quoted)
