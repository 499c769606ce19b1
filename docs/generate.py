"""Write the pages that come from the program itself into docs/generated/.

The glossary, a campaign file with its schema, the help of every command, the table of errors and
warnings, and the docstrings: what the program says about itself cannot go out of date.
"""

from __future__ import annotations

import importlib
import inspect
import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import FunctionType

import foucault
from foucault import campaign, procedures

HERE = Path(__file__).parent
COMMANDS = (
    "init",
    "inspect",
    "simulate",
    "calibrate",
    "apply",
    "report",
    "demo",
    "schema",
    "messages",
)


def program(*words: str) -> str:
    """Return what `foucault` prints."""
    command = [str(Path(sys.executable).with_name("foucault")), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def fenced(text: str, language: str = "text") -> str:
    """Return `text` as a block of code."""
    return f"```{language}\n{text.strip()}\n```\n"


def command_line() -> str:
    """Return the help of the program and of every command."""
    parts = ["# Command line\n", fenced(program("--help"))]
    parts += [f"## {name}\n\n{fenced(program(name, '--help'))}" for name in COMMANDS]
    return "\n".join(parts)


def campaign_file() -> str:
    """Return the template of every procedure and the schema."""
    parts = ["# Campaign file\n\nWhat `foucault init` writes; every key is explained in it.\n"]
    parts += [
        f"## {name}\n\n{fenced(campaign.template(name), 'toml')}" for name in procedures.PROCEDURES
    ]
    parts.append(f"## Schema\n\n{fenced(json.dumps(campaign.schema(), indent=1), 'json')}")
    return "\n".join(parts)


def api() -> str:
    """Return the docstrings of all public functions and classes, module by module."""
    parts = ["# Python\n\nThe names of `foucault` itself load when first used.\n"]
    for found in pkgutil.walk_packages(foucault.__path__, "foucault."):
        module = importlib.import_module(found.name)
        things = [
            (name, thing)
            for name, thing in vars(module).items()
            if not name.startswith("_")
            and getattr(thing, "__module__", "") == found.name
            and isinstance(thing, FunctionType | type)
        ]
        if found.name.startswith("foucault.cli") or not (things or module.__doc__):
            continue
        parts.append(f"## {found.name}\n\n{fenced(module.__doc__ or '')}")
        for name, thing in things:
            shown = f"{name}{signature(thing)}\n\n{inspect.getdoc(thing) or ''}"
            parts.append(f"### {name}\n\n{fenced(shown)}")
    return "\n".join(parts)


def signature(thing: FunctionType | type) -> str:
    """Return the arguments of a function or class, nothing where Python cannot tell."""
    try:
        return str(inspect.signature(thing))
    except ValueError:
        return ""


def main() -> None:
    """Write every generated page."""
    folder = HERE / "generated"
    folder.mkdir(exist_ok=True)
    pages = {
        "glossary.md": f"# Glossary\n\n{fenced(foucault.__doc__ or '')}",
        "command_line.md": command_line(),
        "campaign.md": campaign_file(),
        "messages.md": f"# Errors and warnings\n\n{program('messages')}",
        "api.md": api(),
    }
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
