"""What someone who follows a command from its call must read: python benchmarks/trace.py

For calibrations of simulated examples and a north fix: functions of this package that ran, their
files, and how often the way through them, in order of first calls, goes from one package to
another. Kernels that are compiled, code of modules and functions without a name do not count.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from itertools import pairwise
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"

CASES = {
    "calibrate hand_rotated": ("hand_rotated", "calibrate"),
    "calibrate turntable": ("turntable", "calibrate"),
    "calibrate transfer_alignment": ("transfer_alignment", "calibrate"),
    "north fix": ("north_seeking", "north"),
}
"""Name -> example that is simulated, and what is done with its session."""


def traced(words: list[str]) -> list[tuple[str, str]]:
    """Run a command and return (file, function) of all that ran, in order of the first call."""
    import foucault
    from foucault.__main__ import main

    root = str(Path(foucault.__file__).parent) + "/"
    first: dict[CodeType, None] = {}

    def see(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(root):
            first.setdefault(frame.f_code)

    sys.argv = ["foucault", *words]
    threading.setprofile(see)
    sys.setprofile(see)
    try:
        main()
    except SystemExit as end:
        if end.code not in (0, 3):  # 3: done, and doubtful
            raise
    finally:
        sys.setprofile(None)
    seen = [(code.co_filename.removeprefix(root), code.co_qualname) for code in first]
    return [(f, n) for f, n in seen if not f.startswith("kernels/") and n[-1] != ">"]


def counted(walk: list[tuple[str, str]]) -> tuple[int, int, int]:
    """Return how many functions, files and moves between packages are in a walk."""
    packages = [file.partition("/")[0] for file, _ in walk]
    return len(walk), len({f for f, _ in walk}), sum(a != b for a, b in pairwise(packages))


def measured(example: str, command: str, folder: Path) -> tuple[int, int, int]:
    """Simulate an example in `folder` and count what `command` of its session runs."""
    again, foucault = [sys.executable, __file__, "--one"], [sys.executable, "-m", "foucault"]
    words = [command, str(folder / "session" / "campaign.toml"), "-o", str(folder / "run")]
    source = [str(EXAMPLES / f"{example}.toml"), "-o", str(folder / "session")]
    subprocess.run([*foucault, "simulate", *source], check=True, capture_output=True)
    told = subprocess.run([*again, *words], check=True, capture_output=True, text=True).stdout
    return counted([(file, name) for file, name in json.loads(told.splitlines()[-1])])


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(traced(sys.argv[2:])))
        sys.exit()
    print("| command | functions | files | moves between packages |\n|---|---|---|---|")
    for title, (example, command) in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            row = measured(example, command, Path(folder))
        print("| " + " | ".join([title, *map(str, row)]) + " |", flush=True)
