"""Calibrate every example from a simulated session, and run the demo: with what is required only.

`make lowest` and `make newest` run it, where no tool of the tests need be.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from foucault import campaign, logs, report

EXAMPLES = Path(__file__).parent.parent / "examples"
NAMED = ("numpy", "scipy", "numba", "pandas", "pyarrow", "pydantic", "typer")


def main() -> int:
    """Return the number of examples that do not pass, and of commands that fail."""
    wrong = 0
    print("Python", sys.version.split()[0], *(f"{name} {version(name)}" for name in NAMED))
    with tempfile.TemporaryDirectory() as folder:
        for file in sorted(EXAMPLES.glob("*.toml")):
            made = campaign.save_session(campaign.simulate(file), Path(folder) / file.stem)
            result = campaign.calibrate(made)
            report.html(result)
            print(f"{file.stem}: {result.verdict.level}", flush=True)
            for ending in ("csv.gz", "parquet") if file.stem == "six_position" else ():
                kept = Path(folder) / f"kept.{ending}"
                log = logs.read(logs.LogDescription(file="log.csv"), made.parent)
                logs.write(log, kept)
                same = len(logs.read(logs.LogDescription(file=kept.name), kept.parent)) == len(log)
                print(kept.name, "is read" if same else "is not read")
                wrong += not same
            wrong += result.verdict.level != "pass"
        for words in (
            ["demo", "-o", "demo"],
            ["calibrate", "demo/session/campaign.toml", "-o", "again"],
        ):
            command = [sys.executable, "-m", "foucault", *words]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            print(*words[:1], "ended with", done.returncode, done.stderr[-2000:])
            wrong += done.returncode != 0
    return wrong


if __name__ == "__main__":
    sys.exit(main())
