"""Time `foucault calibrate` on every procedure, with nothing compiled yet and warm; write FIRST.md.

Each session is the one that the template of the procedure describes. CPU is that of all processes,
those that compile ahead included; warm is the best of three. Wall time means something on a machine
with two free cores only: the load at the start and the end is printed with it.

Run: python benchmarks/first.py [PROCEDURE ...]
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from run import processor

from foucault.procedures import PROCEDURES

FIRST, NEXT = 6.0, 0.9
"""Targets: the first calibration by the clock, and the next ones, CPU [s]."""

COMMAND = [sys.executable, "-m", "foucault", "-q"]


def timed(campaign: Path, cache: Path) -> tuple[float, float]:
    """Return CPU and wall time of one calibration [s]."""
    # Without compiled bytecode every run would compile this package's text again.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"NUMBA_CACHE_DIR": str(cache), "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as out:
        before, start = os.times(), time.perf_counter()
        command = [*COMMAND, "calibrate", str(campaign), "-o", f"{out}/run"]
        code = subprocess.run(command, env=environment, stdout=subprocess.DEVNULL).returncode
        wall, after = time.perf_counter() - start, os.times()
    if code not in (0, 3, 4):  # a verdict, whichever
        raise SystemExit(f"{campaign} ended with {code}")
    used = after.children_user + after.children_system
    return used - before.children_user - before.children_system, wall


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    procedure: str
    size: float  # of the log [MB]
    cold: tuple[float, float]  # CPU and wall of the first [s]
    warm: tuple[float, float]  # and of the next [s]

    def markdown(self) -> str:
        cold, warm = (" | ".join(f"{s:.{n}f}" for s in both)
                      for n, both in ((1, self.cold), (2, self.warm)))  # fmt: skip
        return f"| {self.procedure} | {self.size:.1f} | {cold} | {warm} |"


def misses(rows: list[Row]) -> str:
    """Say which rows miss their targets, as the table shows them."""
    first = [f"{r.procedure} ({r.cold[1]:.1f})" for r in rows if round(r.cold[1], 1) > FIRST]
    after = [f"{r.procedure} ({r.warm[0]:.2f})" for r in rows if round(r.warm[0], 2) > NEXT]
    return (
        f"Targets: the first within {FIRST:g} s by the clock, the next {NEXT:g} s of CPU. "
        f"The first misses it with {', '.join(first) or 'none'}; "
        f"the next with {', '.join(after) or 'none'}."
    )


def measured(procedure: str, folder: Path) -> Row:
    """Return what a procedure takes."""
    campaign, session = folder / f"{procedure}.toml", folder / procedure
    subprocess.run([*COMMAND, "init", procedure, "-o", str(campaign)], check=True)
    subprocess.run([*COMMAND, "simulate", str(campaign), "-o", str(session)], check=True)
    cache = folder / f"cache_{procedure}"
    cold = timed(session / "campaign.toml", cache)
    warm = [timed(session / "campaign.toml", cache) for _ in range(3)]
    size = (session / "log.csv").stat().st_size / 1e6
    return Row(procedure, size, cold, (min(w[0] for w in warm), min(w[1] for w in warm)))


def main() -> None:
    """Write the table, or print the rows that are asked for."""
    asked = sys.argv[1:]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for procedure in asked or PROCEDURES:
            rows.append(measured(procedure, Path(folder)))
            print(rows[-1].markdown(), flush=True)
    print(misses(rows))
    after = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    lines = [
        "# The first calibration and the next",
        "",
        "Written by `python benchmarks/first.py`: `foucault calibrate` with its report, on the "
        "session that each procedure's template describes; first with an empty cache of compiled "
        "code, then the best of three. CPU is that of all processes. Wall times count where two "
        "cores were free.",
        "",
        f"{processor()}, {os.cpu_count()} cores, Python {platform.python_version()}; load "
        f"{load:.1f} before, {after:.1f} after.",
        "",
        "| procedure | log [MB] | first, CPU [s] | wall [s] | next, CPU [s] | wall [s] |",
        "|---|---|---|---|---|---|",
        *(row.markdown() for row in rows),
        "",
        misses(rows),
    ]
    if not asked:
        text = "\n".join(lines) + "\n"
        (Path(__file__).parent / "FIRST.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
