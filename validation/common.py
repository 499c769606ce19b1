"""What the validations share: where logs lie, limits over a count, words and runs side by side."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import sqlite3
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("FOUCAULT_DATA", ROOT.parent / "shared" / "data")).resolve()
if (TESTS := str(ROOT / "tests")) not in sys.path:
    sys.path.insert(0, TESTS)  # the simulators and published equations of the tests


def limits(count: int, false_alarm: float = FALSE_ALARM, tests: int = 1) -> tuple[float, float]:
    """Return the two-sided limits of a chi-square of `count` degrees of freedom, over `count`.

    All `tests` together stay inside but for a share `false_alarm` of all studies.
    """
    low, high = chi_square_limits(count, false_alarm, tests)
    return low / count, high / count


def rms(x: Any) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def word(good: bool) -> str:
    return "yes" if good else "no"


def must(good: bool) -> str:
    """Return the word for what must be so."""
    return "yes" if good else "**no**"


def each(
    one: Callable[[Any], Any], jobs: Sequence[Any], workers: int | None = None
) -> Iterator[Any]:
    """Do all jobs side by side, by default on every processor; say how far it is.

    Results come in the order of the jobs, whatever the number of `workers`. What is done is kept
    in the folder that FOUCAULT_KEEP names: a run that was killed goes on from there, unless the
    code has changed.
    """
    kept = _kept(one)
    try:
        keys = [pickle.dumps(job) for job in jobs]
        known = dict(kept.execute("SELECT * FROM kept"))
        todo = [key for key in keys if key not in known]
        with multiprocessing.Pool(workers or os.cpu_count()) as pool:
            found = pool.imap_unordered(partial(_of, one), todo)
            for k, (key, result) in enumerate(found, len(keys) - len(todo) + 1):
                kept.execute("INSERT INTO kept VALUES (?, ?)", (key, result))
                kept.commit()
                known[key] = result
                if sys.stderr.isatty() or k % 500 == 0 or k == len(keys):
                    print(f"\r{k} of {len(keys)}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    finally:
        kept.close()
    yield from (pickle.loads(zlib.decompress(known[key])) for key in keys)


def _of(one: Callable[[Any], Any], key: bytes) -> tuple[bytes, bytes]:
    return key, zlib.compress(pickle.dumps(one(pickle.loads(key))))


def _kept(one: Callable[[Any], Any]) -> sqlite3.Connection:
    """Open what is kept of the jobs of a function, by the code that it is done with."""
    place: Path | str = ":memory:"
    if folder := os.environ.get("FOUCAULT_KEEP"):
        code = hashlib.sha256()
        for some in (
            "src/foucault/**/*.py",
            "src/foucault/**/*.t*",
            "validation/*.py",
            "tests/*.py",
        ):
            for path in sorted(ROOT.glob(some)):
                code.update(path.read_bytes())
        Path(folder).mkdir(parents=True, exist_ok=True)
        place = Path(folder) / f"{one.__module__}.{one.__name__}.{code.hexdigest()[:16]}.sqlite"
    out = sqlite3.connect(place)
    out.execute("CREATE TABLE IF NOT EXISTS kept (key BLOB PRIMARY KEY, result BLOB)")
    return out
