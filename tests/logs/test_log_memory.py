"""A long log is read without holding it more than twice."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from foucault.logs import write
from foucault.tables import Log

# What is freed goes back at once: the peak is what was held, not what a pool kept. Without fixed
# thresholds glibc raises its own with each block freed, and keeps what lies between others.
POOL = {
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    "MALLOC_ARENA_MAX": "1",
    "MALLOC_MMAP_THRESHOLD_": "65536",
    "MALLOC_TRIM_THRESHOLD_": "65536",
}

READ = """
import json, sys
import pyarrow.csv, pyarrow.parquet, pydantic
from foucault.logs import LogDescription, read
def peak():
    with open("/proc/self/status") as lines:
        return next(1024 * int(l.split()[1]) for l in lines if l.startswith("VmHWM"))
before = peak()
log = read(LogDescription(file=sys.argv[1]))
print(json.dumps([len(log), peak() - before]))
"""


def peak(folder, suffix, rows):
    """Return the memory that reading `rows` rows takes in a process of its own [byte]."""
    rng = np.random.default_rng(1)
    file = folder / f"log{suffix}"
    gyro, accel = rng.normal(size=(2, rows, 3))
    write(Log(np.arange(rows) / 1000.0, gyro, accel), file)
    command = [sys.executable, "-c", READ, str(file)]
    given = os.environ | POOL
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=given)
    got, memory = json.loads(done.stdout)
    assert got == rows
    return memory


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_peak_memory_grows_by_less_than_two_tables(tmp_path, suffix):
    # The difference of two sizes leaves out what pyarrow takes for its buffers once.
    short, long = 300_000, 900_000
    grown = peak(tmp_path, suffix, long) - peak(tmp_path, suffix, short)
    assert grown <= 2 * (long - short) * 7 * 8
