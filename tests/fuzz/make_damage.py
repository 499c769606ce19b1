"""Files as they should be, in every format, and what can happen to their bytes."""

from __future__ import annotations

import gzip
import io
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
from hypothesis import strategies as st
from scipy.io import savemat

from foucault.tables import Log
from make_recordings import dataflash
from make_vehicle import bin_file, tlog_file, ulg_file

MOST = 60 << 20
"""Memory for a file of some kilobytes: the blocks of the readers, and room [bytes]."""

NAMES = ("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


def table(rows: int = 40) -> np.ndarray:
    """Rows of an instrument that is rocked, shape (rows, 7)."""
    rng = np.random.default_rng(1)
    t = np.arange(rows) / 50
    force = rng.normal([0.0, 0.0, 9.8], 0.1, (rows, 3))
    return np.column_stack([t, rng.normal(0, 0.1, (rows, 3)), force])


def _csv() -> bytes:
    out = io.BytesIO()
    pacsv.write_csv(_arrow(), out, pacsv.WriteOptions(quoting_style="none"))
    return out.getvalue()


def _arrow() -> pa.Table:
    return pa.table(dict(zip(NAMES, table().T, strict=True)))


def _saved(save: Callable[[io.BytesIO], object]) -> bytes:
    out = io.BytesIO()
    save(out)
    return out.getvalue()


def _text() -> bytes:
    head = "% made by a logger\n# " + " ".join(NAMES) + "\n"
    return _saved(lambda f: (f.write(head.encode()), np.savetxt(f, table(), "%.9f", "  ")))


GOOD: dict[str, bytes] = {
    "log.csv": _csv(),
    "log.csv.gz": gzip.compress(_csv(), mtime=0),
    "log.txt": _text(),
    "log.parquet": _saved(lambda f: pq.write_table(_arrow(), f)),
    "log.npy": _saved(lambda f: np.save(f, table())),
    "log.npz": _saved(lambda f: np.savez(f, **dict(zip(NAMES, table().T, strict=True)))),
    "log.mat": _saved(lambda f: savemat(f, {"imu": table()})),
    "log.bin": table().astype("<f8").tobytes(),
}
"""File name -> its content."""


def _flights() -> dict[str, bytes]:
    """Return logs of vehicles, which say themselves what they hold: name -> content."""
    logs = [Log(rows[:, 0].copy(), rows[:, 1:4].copy(), rows[:, 4:].copy()) for rows in [table()]]
    samples = (1000 * table(64)[:, 1:4]).astype(int).T.tolist()
    batch = {"ISBH": ("QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate",
                      [(1, 1, 1, 0, 938, 64, 1, 1000.0)]),
             "ISBD": ("QHHaaa", "TimeUS,N,seqno,x,y,z", [
                 (2 + k, 1, k, *(axis[32 * k : 32 * k + 32] for axis in samples))
                 for k in range(2)])}  # fmt: skip
    out = {}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        for name, wrote in (("imu.bin", bin_file), ("flight.ulg", ulg_file),
                            ("flight.tlog", tlog_file)):  # fmt: skip
            wrote(path, logs)
            out[name] = path.read_bytes()
        dataflash(path, batch)
        out["batches.bin"] = path.read_bytes()
    return out


FLIGHTS = _flights()


@st.composite
def damaged(draw: st.DrawFn, good: bytes) -> bytes:
    """Draw what is left of `good` after some accidents."""
    data = bytearray(good)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(data) - 1)))
        some = draw(st.integers(1, 64))
        how = draw(st.sampled_from(["cut", "flip", "lose", "insert", "twice", "zero", "bytes"]))
        if how == "cut":
            del data[at:]
        elif how == "flip" and data:
            data[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "lose":
            del data[at : at + some]
        elif how == "insert":
            data[at:at] = draw(st.sampled_from(WORDS))
        elif how == "twice":
            data[at:at] = data[at : at + some]
        elif how == "zero":
            data[at : at + some] = bytes(len(data[at : at + some]))
        else:
            data[at : at + 8] = draw(st.binary(max_size=8))
    return bytes(data)


WORDS = [
    b"nan", b"-inf", b"Infinity", b"1e999", b"-1e-999", b"1_0", b"0x1p3", b"1,5", b"1;5", b"NA",
    b"null", b'"', b"'", b",", b",,", b";", b"\t", b" ", b"\n", b"\r\n", b"\r", b"\n\n", b"\x00",
    b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf", b"#", b"%", b"# ", b"\xc3", b"\xe2\x82\xac",
    b"2026-01-01T00:00:00Z", b"9" * 400, b"x" * 5000, b"\xef\xbc\x91",
]  # fmt: skip
"""What gets into text files."""


@contextmanager
def bounded(file: str) -> Iterator[None]:
    """Assert that no more memory was used than `MOST`.

    A damaged .mat lets its library ask for what the file claims and leave it untouched; there it is
    what was touched that counts, where the system tells it.
    """
    untouched = file.endswith(".mat")
    before = _touched()
    tracemalloc.start()
    try:
        yield
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert (_touched() - before if untouched else peak) < MOST


def _touched() -> int:
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return 0
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size if sys.platform == "darwin" else 1024 * size


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return every place in a document."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    out = []
    for key, value in items:
        out.append((*path, key))
        if isinstance(value, dict | list):
            out += places(value, (*path, key))
    return out
