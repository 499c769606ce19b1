"""Text that a person wrote, made harmless where it enters code, pages, tables and screens.

Serial numbers, notes, columns of a log, names of files, plans and set-ups: whoever writes them
must not write the program, the page or the formula that they are shown in. One function for each
target; every writer uses that of its target, and nothing else joins such text to it.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Callable, Iterable
from urllib.parse import quote

_UNSEEN = ("Cc", "Cf", "Cs", "Cn", "Zl", "Zp")
"""Categories of characters that a reader does not see or a writer cannot encode."""

_COOKIE = re.compile(r"coding(?=[:=])")
"""What Python takes, in a comment of the first two lines, for the encoding of the file."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FORMULA = re.compile(rf"(?!{_NUMBER}\s*$)\s*[=+\-@\t\r]")
"""What a spreadsheet computes instead of showing it; a number is none."""

_CELL = re.compile(rf"(^|[,;\t\"'|])(\s*)(?=[=+\-@])(?!{_NUMBER}\s*(?:$|[,;)\]}}]))")
"""Where a cell of a comment begins with a formula, whatever parts the cells."""

_TAGS = re.compile(r"<(?!/?(?:b|i|br|sub|sup|extra)>)")
"""A tag in the text of a figure that is not one of ours."""


def plain(text: object) -> str:
    """Return `text` in one line, its spaces single, what cannot be seen replaced by a sign."""
    line = " ".join(str(text).split())
    return "".join("\ufffd" if unicodedata.category(c) in _UNSEEN else c for c in line)


def c_comment(text: object) -> str:
    """Return `text` for a C comment, which it neither ends nor begins anew."""
    line = plain(text).replace("??", "? ?")  # a trigraph may be a backslash
    while "*/" in line or "/*" in line:
        line = line.replace("*/", "* /").replace("/*", "/ *")
    return line


def hash_comment(text: object) -> str:
    """Return `text` for a comment that begins with #: Python, YAML, TOML, a shell."""
    return _COOKIE.sub("coding ", plain(text))


def csv_comment(text: object) -> str:
    """Return `text` for a comment line of a table; a spreadsheet takes it for cells."""
    return _CELL.sub(r"\1\2'", hash_comment(text))


def line_comment(text: object) -> str:
    """Return `text` for a comment of one line that a backslash at its end would go on with: C++."""
    return c_comment(text).rstrip("\\ ")


def xml_comment(text: object) -> str:
    """Return `text` for a comment of XML, which two hyphens in a row would end."""
    return re.sub(r"-(?=-|$)", "- ", plain(text))


_COMMENTS: dict[str, Callable[[object], str]] = {
    "#": hash_comment,
    " *": c_comment,
    "//": line_comment,
    "%": plain,
    ";": plain,
    "<!--": xml_comment,
}


def commented(lines: Iterable[object], mark: str, *, table: bool = False) -> str:
    """Put a comment mark before each of `lines`.

    `lines`: the remarks, one line each is made of them; `mark`: what begins a comment, a key of
    `_COMMENTS`, `` *`` inside one of C; `table`: whether the file is a table, which spreadsheets
    open.
    """
    safe = csv_comment if table else _COMMENTS[mark]
    out = []
    for line in map(str, lines):
        indent = " " * (len(line) - len(line.lstrip(" ")))
        end = " -->" if mark == "<!--" else ""
        out.append(f"{mark} {indent}{safe(line)}".rstrip() + end)
    return "\n".join(out)


def csv_cell(text: object) -> str:
    """Return `text` for a cell of a table: one that would be a formula gets an apostrophe."""
    line = "".join(" " if c in "\r\n\t\0" else c for c in str(text))
    return f"'{line}" if _FORMULA.match(line) else line


def toml_text(text: object) -> str:
    """Return `text` as a string of TOML, quoted; TOML knows the escapes of JSON and needs one more.

    Lone surrogates, which no file can hold, become the sign for what is not known.
    """
    known = str(text).encode("utf-8", "replace").decode("utf-8")
    return json.dumps(known, ensure_ascii=False).replace("\x7f", "\\u007f")


def json_remark(document: object) -> str:
    """Return a JSON document of texts for a comment line of a table; it reads back the same."""
    text = json.dumps(document)
    return re.sub(r"[=+@]|(?<!\w)-", lambda m: f"\\u{ord(m[0]):04x}", text)


def figure(value: object) -> object:
    """Return a figure with texts that hold no tag but those of our own layout.

    `value`: plain dictionaries, lists, texts and numbers, what stands under "meta" is no text of
    the drawing and stays as it is.
    """
    if isinstance(value, str):
        return _TAGS.sub("&lt;", value)
    if isinstance(value, dict):
        return {k: v if k == "meta" else figure(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [figure(v) for v in value]
    return value


def address(path: str) -> str:
    """Return the link to a file beside the page; it names no protocol and no other host."""
    return quote(path.replace("\\", "/").lstrip("/"))


def screen(text: object) -> str:
    """Return `text` for a terminal, which would obey what it does not show."""
    return "".join(
        c if c in "\n\t" or unicodedata.category(c) not in ("Cc", "Cs") else "\ufffd"
        for c in str(text)
    )
