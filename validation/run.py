"""Run validations: `python validation/run.py` all, `python validation/run.py NAME [numbers]` one.

Each of `validation/NAME.py` says what it validates and returns, from `main`, whether all is as it
must be and the numbers; the words around them are `validation/pages/NAME.md`, and both together
are written to docs/validation/NAME.md. What `main` takes are numbers of draws, so that a short
run is possible, or names. Jobs run on all processors; with FOUCAULT_KEEP=FOLDER what is done is
kept, and a run that was stopped goes on there. Logs of others are looked for under $FOUCAULT_DATA
(default ../shared/data); what needs them is skipped where they are not.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is there

HERE = Path(__file__).resolve().parent
PAGES = HERE / "pages"
NAMES = sorted(page.stem for page in PAGES.glob("*.md"))


def run(name: str, numbers: list[str]) -> bool:
    """Run one validation, write and show its page; return whether all is as it must be."""
    done = importlib.import_module(name).main(*map(_given, numbers))
    if done is None:
        return True
    good, values = done
    text = page(name, values)
    (HERE.parent / "docs" / "validation" / f"{name}.md").write_text(text, encoding="utf-8")
    print(text)
    return bool(good)


def _given(word: str) -> int | float | str:
    """Read a number of draws, or a name."""
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word


def page(name: str, values: dict[str, object]) -> str:
    """Put values in their places; a list is the lines of a table."""
    lines = {k: "\n".join(v) if isinstance(v, list) else v for k, v in values.items()}
    filled = (PAGES / f"{name}.md").read_text(encoding="utf-8").format_map(lines)
    return filled.rstrip() + "\n"


def main(words: list[str]) -> int:
    if words:
        return 0 if run(words[0], words[1:]) else 1
    # Each by itself, also after one that fails.
    failed = [n for n in NAMES if subprocess.run([sys.executable, __file__, n]).returncode]
    if failed:
        print("failed:", *failed, file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
