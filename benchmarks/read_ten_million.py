"""Read a log of ten million rows from CSV and from Parquet: seconds and peak memory.

    python benchmarks/read_ten_million.py [ROWS]

Writes the files to a temporary folder, reads each in a fresh process and prints the peak
memory as a multiple of the table (rows x 7 columns x 8 bytes), which must stay below 3.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from multiprocessing import Process
from pathlib import Path

import numpy as np

from foucault.logs import write
from foucault.tables import Log

READ = """
import json, resource, sys, time
from foucault.logs import LogDescription, read
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
before, start = peak(), time.perf_counter()
log = read(LogDescription.model_validate(json.loads(sys.argv[2])), sys.argv[1])
print(json.dumps({"rows": len(log), "seconds": time.perf_counter() - start,
                  "peak": peak(), "before": before}))
"""

FILES = ("log.csv", "log.parquet")

DESCRIBED = {
    "time": {"column": "time", "unit": "s"},
    "gyro": {"unit": "deg/s"},
    "accel": {"unit": "m/s^2"},
}


def generate(folder: Path, rows: int) -> None:
    """Write a log of noise around gravity, with as many digits as float64 has."""
    rng = np.random.default_rng(1)
    accel = rng.normal(0.0, 0.01, (rows, 3))
    accel[:, 2] += 9.81
    log = Log(np.arange(rows) / 1000.0, rng.normal(0.0, 0.001, (rows, 3)), accel)
    for name in FILES:
        start = time.perf_counter()
        write(log, folder / name)
        size = (folder / name).stat().st_size / 1e6
        print(f"wrote {name} in {time.perf_counter() - start:.1f} s, {size:.0f} MB", flush=True)


def measure(folder: Path, description: dict[str, object]) -> dict[str, float]:
    """Read one file in a process of its own."""
    command = [sys.executable, "-c", READ, str(folder), json.dumps(description)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def main() -> None:
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
    table = rows * 7 * 8
    print(f"{rows} rows, 7 columns, table {table / 1e6:.0f} MB")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # A child's peak starts at the size of its parent, so the parent must stay small.
        maker = Process(target=generate, args=(folder, rows))
        maker.start()
        maker.join()
        for label, description in (
            ("CSV, our own", {"file": "log.csv"}),
            ("CSV, described", {"file": "log.csv", **DESCRIBED}),
            ("Parquet, our own", {"file": "log.parquet"}),
            ("Parquet, described", {"file": "log.parquet", **DESCRIBED}),
        ):
            got = measure(folder, description)
            print(
                f"{label}: {got['seconds']:.1f} s, peak {got['peak'] / 1e6:.0f} MB = "
                f"{got['peak'] / table:.2f} x table "
                f"({(got['peak'] - got['before']) / table:.2f} without the interpreter)"
            )


if __name__ == "__main__":
    main()
