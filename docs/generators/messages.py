"""Pages of messages: by what one was doing, one anchor for each code."""

from __future__ import annotations

import re

from foucault.symptoms import SYMPTOMS, Symptom

GROUPS: dict[str, tuple[str, str]] = {
    "campaign": ("Writing a campaign file", "campaign unit coefficient noise part site left_out"),
    "logs": ("Reading a log", "log recognise output accel gyro"),
    "recording": ("Watching a session, and the noise of an instrument", "watch allan"),
    "rests": (
        "Calibrating by rests and turns: by hand, on faces",
        "session rest rests published faces ferraris turns worn",
    ),
    "table": (
        "Calibrating on a table",
        "table spin positions position plan poses readings solution unification rate_table",
    ),
    "north": ("Seeking north", "north norths north_plan north_search"),
    "continuous_spin": ("Calibrating on a spin axis", "spun"),
    "magnetometer": ("Calibrating a magnetometer", "mag"),
    "tumble": ("Tumbling a platform", "tumble torquing"),
    "systematic": ("Systematic calibration", "systematic sequence deflection"),
    "transfer": (
        "Transfer alignment, and two logs of one body",
        "transfer transfer_plan master delay manoeuvre h_infinity pose imus",
    ),
    "plans": ("Planning a session", "preflight optimise observability"),
    "navigate": ("Aligning and navigating", "alignment navigate reference strapdown"),
    "results": ("Applying, exporting and reading results", "apply export result program"),
    "several": (
        "Several results: merged, compared, over temperature, of many instruments",
        "prior merge compare temperature fleet tolerance",
    ),
    "studies": ("Studies, and computing on a cluster", "study cluster"),
    "records": ("Keeping records", "records"),
    "workbench": ("The workbench", "workbench"),
    "capture": ("Recording an instrument", "capture guide"),
    "certificate": ("Certificates", "certificate"),
    "python": ("Calling the library", "argument"),
}
"""Page -> its title, and the first words of the codes on it."""

_PAGE = {word: page for page, (_, words) in GROUPS.items() for word in words.split()}


def _where(code: str) -> str:
    """Return the page of a code."""
    word = code.split(".")[0]
    if word not in _PAGE:
        raise KeyError(f"no page for '{code}': add '{word}' to GROUPS in {__file__}")
    return _PAGE[word]


def index() -> str:
    lines = [
        "# Messages",
        "",
        "Every error, warning and note, with what to do about it: search for a few words of yours "
        "with the box above, or go by what you were doing. Where a value of yours stands in the "
        "message, its name stands here in ‹brackets›. With `--json` the command line prints the "
        "code as well.",
        "",
        "| you were | errors | warnings, notes |",
        "|---|--:|--:|",
    ]
    for page, (title, _) in GROUPS.items():
        severities = [row.severity for row in _rows(page)]
        errors = severities.count("error")
        lines.append(f"| [{title}](messages/{page}.md) | {errors} | {len(severities) - errors} |")
    lines += [
        "",
        "An *error* ends the work; a *warning* or a *note* is told and the work goes on. Which "
        "mistakes are noticed, and which cannot be: [what is noticed](guard.md).",
        "",
        "## By code",
        "",
        "```{dropdown} All codes",
        ", ".join(f"[`{code}`](#{code})" for code in SYMPTOMS),
        "```",
        "",
        "```{toctree}",
        ":hidden:",
        "",
        *(f"messages/{page}" for page in GROUPS),
        "```",
    ]
    return "\n".join(lines) + "\n"


def page(name: str) -> str:
    lines = [f"# {GROUPS[name][0]}", "", "[All messages](../messages.md)."]
    for row in _rows(name):
        lines += [
            "",
            f"({row.code})=",
            f"## {_text(row.symptom)}",
            "",
            f"{row.severity} `{row.code}`",
            "",
            f"> {_text(row.message)}",
            "",
            _text(row.cure),
        ]
    return "\n".join(lines) + "\n"


def _rows(page: str) -> list[Symptom]:
    return [row for row in SYMPTOMS.values() if _where(row.code) == page]


def _text(template: str) -> str:
    """Return a template with its fields in brackets, safe in Markdown."""
    template = re.sub(r"\{(\w+)[^}]*\}", r"‹\1›", template.replace("{{", "{").replace("}}", "}"))
    quoted = template.split("`")  # every second part is code
    quoted[::2] = [re.sub(r"([*_<>\[\]#|])", r"\\\1", part) for part in quoted[::2]]
    return "`".join(quoted)
