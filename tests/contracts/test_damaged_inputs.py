"""No log, however damaged or large, ends in a traceback, takes 2 GB or a minute.

Each is read by the command line in a process of its own. What `tests/fuzz` draws is held to less
memory still, there.
"""

from __future__ import annotations

import gzip
import io
import json
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

MOST_MEMORY, MOST_TIME = 2e9, 60.0
"""What a command may take [bytes], and of a processor that others share [s]."""

ROW = b"0.01,0.1,0.2,0.3,0.1,0.2,9.8\n"
TITLES = b"time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n"
NAMES = TITLES.decode().strip().split(",")

CAMPAIGN = """
[site]
latitude = "48 deg"
[procedure]
name = "hand_rotated"
[log]
file = "{file}"
{more}
[log.time]
column = {time}
unit = "s"
[log.gyro]
columns = {gyro}
unit = "{unit}"
[log.accel]
columns = {accel}
unit = "m/s^2"
"""

MEASURE = """
import json, resource, sys
from foucault.cli import main
sys.argv = ["foucault", *sys.argv[1:]]
code = 0
try:
    main()
except SystemExit as end:
    code = end.code
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps([code, 1024 * used.ru_maxrss, used.ru_utime + used.ru_stime]))
"""


def _rows(count: int) -> bytes:
    return TITLES + b"".join(b"%d" % k + ROW for k in range(count))


def _members(text: bytes, times: int) -> bytes:
    """A text so many times over, packed: gzip's members follow one another."""
    return gzip.compress(text) * times


def _sparse(path: Path, start: bytes, size: int) -> None:
    """Write a file that is zeros after its start, which take no room on the disk."""
    with path.open("wb") as stream:
        stream.write(start)
        stream.truncate(size)


def _npy_header(rows: int) -> bytes:
    out = io.BytesIO()
    words = {"descr": "<f8", "fortran_order": False, "shape": (rows, 7)}
    np.lib.format.write_array_header_1_0(out, words)
    return out.getvalue()


def _npz(path: Path) -> None:
    rows = 5_000_000
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as parts,
        parts.open("imu.npy", "w", force_zip64=True) as part,
    ):
        part.write(_npy_header(rows))
        for _ in range(rows // 1_000_000):
            part.write(bytes(56_000_000))


def _mat(path: Path) -> None:
    savemat(path, {"imu": np.zeros((3_000_000, 7))}, do_compression=True)


def _parquet(path: Path) -> None:
    part = pa.table({name: np.zeros(5_000_000) for name in NAMES})
    with pq.ParquetWriter(path, part.schema) as writer:
        for _ in range(2):
            writer.write_table(part)


def _written(content: bytes) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(content) and None


LARGE: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "padded with zero bytes": ("log.csv", lambda p: _sparse(p, _rows(500), 6 << 30), "zero bytes"),
    "padded, and packed": (
        "log.csv.gz", lambda p: p.write_bytes(gzip.compress(_rows(500))
                                              + _members(bytes(64 << 20), 64)) and None,
        "zero bytes",
    ),
    "packed zero bytes": (
        "log.csv.gz", lambda p: p.write_bytes(_members(bytes(64 << 20), 64)) and None,
        "zero bytes",
    ),
    "packed rows, one like the other": (
        "log.csv.gz", lambda p: _written(gzip.compress(TITLES) + _members(ROW * 2_000_000, 70))(p),
        "do not pack",
    ),
    "one endless line": ("log.csv", lambda p: _written(TITLES + b"1" * (300 << 20))(p),
                         "longer than"),
    "no sample at all": ("log.csv", lambda p: _written(b"nothing\n" * (5 << 20))(p),
                         "hold no sample"),
    "records of 10 TB": ("log.bin", lambda p: _sparse(p, b"", 10 << 40), "GB are free"),
    "an array of 10 TB": (
        "log.npy", lambda p: _sparse(p, _npy_header((10 << 40) // 56), 128 + (10 << 40) // 56 * 56),
        "GB are free",
    ),
    "packed arrays": ("log.npz", _npz, "do not pack"),
    "packed variables": ("log.mat", _mat, "do not pack"),
    "packed columns": ("log.parquet", _parquet, "do not pack"),
}  # fmt: skip
"""What it is -> file, what writes it, a word of what is told."""


def told(folder: Path, file: str, more: str = "", unit: str = "rad/s") -> tuple[int, str]:
    """Calibrate from a file; return exit status and what was written, within its limits."""
    numbered = file.startswith(("log.npy", "log.mat", "log.bin", "log.npz"))
    some = list(range(7)) if numbered else NAMES
    if file.endswith(".bin"):
        more += '\nrecord = { type = "float64", columns = 7 }'
    campaign = CAMPAIGN.format(
        file=file, more=more, unit=unit, time=json.dumps(some[0]), gyro=json.dumps(some[1:4]),
        accel=json.dumps(some[4:]),
    )  # fmt: skip
    if "rate =" in more:
        head, _, tail = campaign.partition("[log.time]")
        campaign = head + tail[tail.index("[log.gyro]") :]
    (folder / "campaign.toml").write_text(campaign)
    command = [sys.executable, "-c", MEASURE, "calibrate", "campaign.toml", "-o", "run"]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=10 * MOST_TIME, check=False
    )
    words = done.stdout + done.stderr
    assert "Traceback" not in words, words
    status, peak, took = json.loads(done.stdout.strip().splitlines()[-1])
    assert peak < MOST_MEMORY and took < MOST_TIME, (peak, took)
    return status, " ".join(words.split())


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="files without room on the disk, and peaks")
@pytest.mark.parametrize("name", LARGE)
def test_files_that_are_or_pretend_to_be_large(name: str, tmp_path: Path) -> None:
    file, write, word = LARGE[name]
    try:
        write(tmp_path / file)
    except OSError as problem:  # no such size on this disk
        pytest.skip(str(problem))
    status, words = told(tmp_path, file)
    (tmp_path / file).unlink()
    assert status not in (0, None) and word in words


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("more", "unit", "word"),
    [('rate = "1e30 Hz"', "rad/s", "is not the rate of a log"),
     ("", "0 rad/s", "every reading would be zero"),
     ("", "1e-300 rad/s", "every reading would be zero"),
     ("", "1e300 rad/s", "every reading would be too large")],
)  # fmt: skip
def test_sizes_that_no_log_has(more: str, unit: str, word: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(_rows(500))
    status, words = told(tmp_path, "log.csv", more, unit)
    assert status not in (0, None) and word in words
