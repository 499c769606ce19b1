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
from pathlib import Path

from foucault.procedures import PROCEDURES

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


def row(procedure: str, folder: Path) -> str:
    """Return a line of the table."""
    campaign, session = folder / f"{procedure}.toml", folder / procedure
    subprocess.run([*COMMAND, "init", procedure, "-o", str(campaign)], check=True)
    subprocess.run([*COMMAND, "simulate", str(campaign), "-o", str(session)], check=True)
    cache = folder / f"cache_{procedure}"
    cold = timed(session / "campaign.toml", cache)
    warm = [timed(session / "campaign.toml", cache) for _ in range(3)]
    size = (session / "log.csv").stat().st_size / 1e6
    return (
        f"| {procedure} | {size:.1f} | {cold[0]:.1f} | {cold[1]:.1f} | "
        f"{min(w[0] for w in warm):.2f} | {min(w[1] for w in warm):.2f} |"
    )


def main() -> None:
    """Write the table, or print the rows that are asked for."""
    asked = sys.argv[1:]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for procedure in asked or PROCEDURES:
            rows.append(row(procedure, Path(folder)))
            print(rows[-1], flush=True)
    after = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    lines = [
        "# The first calibration and the next",
        "",
        "Written by `python benchmarks/first.py`: `foucault calibrate` with its report, on the "
        "session that each procedure's template describes; first with an empty cache of compiled "
        "code, then the best of three. CPU is that of all processes. Wall times count where two "
        "cores were free.",
        "",
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; load "
        f"{load:.1f} before, {after:.1f} after.",
        "",
        "| procedure | log [MB] | first, CPU [s] | wall [s] | next, CPU [s] | wall [s] |",
        "|---|---|---|---|---|---|",
        *rows,
    ]
    if not asked:
        text = "\n".join(lines) + "\n"
        (Path(__file__).parent / "FIRST.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
