"""The list of the Python names; autosummary writes a page for each, from its docstring."""

from __future__ import annotations

import foucault

FOLDER = "api"

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

`import foucault` costs little: a name loads its module when it is first used. Arguments, arrays and
attributes are in SI and radians, frames and signs as in [conventions](conventions.md). These names
stay; everything else may move between versions, and has its own docstring:
`help(foucault.estimate)`.
"""


def page() -> str:
    named = {name for names in GROUPS.values() for name in names}
    more = tuple(name for name in foucault.__all__ if name not in named)
    lines = [HEAD]
    for heading, names in {**GROUPS, "More": more}.items():
        names = tuple(name for name in names if name in foucault.__all__)
        if names:
            lines += [f"## {heading}", "", "```{eval-rst}", ".. currentmodule:: foucault", "",
                      ".. autosummary::", f"   :toctree: {FOLDER}", "",
                      *(f"   {name}" for name in names), "```", ""]  # fmt: skip
    return "\n".join(lines)
