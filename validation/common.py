"""What the validations share: where logs lie, limits over a count, words and runs side by side."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import sqlite3
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Status
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.result import Level, Result

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

    One worker is this process itself, which has its kernels already. Results come in the order of
    the jobs, whatever the number of `workers`. What is done is kept in the folder that
    FOUCAULT_KEEP names: a run that was killed goes on from there, unless the code has changed.
    """
    kept = _kept(one)
    try:
        keys = [pickle.dumps(job) for job in jobs]
        known = dict(kept.execute("SELECT * FROM kept"))
        todo = [key for key in keys if key not in known]
        many = (workers or os.cpu_count()) != 1
        with multiprocessing.Pool(workers) if many else nullcontext() as pool:
            found = (pool.imap_unordered if pool else map)(partial(_of, one), todo)
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


@dataclass(frozen=True)
class Trial:
    """One session beside its truth."""

    errors: dict[str, float]  # of coefficients [SI]
    bound: FloatArray  # of them, by the noise of the sensors alone [SI]
    nees: float  # of all coefficients, over their number [1]
    degrees: int  # their number [1]
    passed: bool
    settled: bool

    @classmethod
    def of(cls, found: Result, true: Mapping[str, float], rows: Sequence[str] = ()) -> Trial:
        """Compare a result with truth [SI]; `rows`: names that are kept, all where none is said."""
        c = found.coefficients
        e = c.values - np.array([true[n] for n in c.names])
        kept = [k for k, n in enumerate(c.names) if not rows or n in rows]
        nees = float(e @ np.linalg.solve(c.cov, e)) / len(e)
        return cls({c.names[k]: float(e[k]) for k in kept},
                   np.array(found.diagnostics["bound"])[kept], nees, len(e),
                   found.verdict.level is Level.PASS, found.status is Status.CONVERGED)  # fmt: skip


def accuracy(
    one: Callable[[tuple[str, int]], Trial | None], cases: Sequence[str],
    units: Mapping[str, float], sessions: int, workers: int = 0,
) -> tuple[bool, dict[str, object]]:  # fmt: skip
    """Return whether all is as it must be, and a table: a line of cells for each of the `cases`.

    `one`: a session of a case by its seed, None where it is refused; `units`: columns, groups of
    coefficients by the part of their names that they share, in units of [SI].
    """
    jobs = [(case, seed) for case in cases for seed in range(sessions)]
    done, shown, good, settled = list(each(one, jobs, workers or None)), [], True, 0
    for k, case in enumerate(cases):
        kept = [x for x in done[k * sessions : (k + 1) * sessions] if x is not None]
        settled += sum(x.settled for x in kept)
        low, high = limits(kept[0].degrees * len(kept), tests=len(cases))
        ratio = float(np.mean([x.nees for x in kept]))
        good &= (fine := low <= ratio <= high)
        e = {n: np.array([x.errors[n] for x in kept]) for n in kept[0].errors}
        over = [rms([list(x.errors.values())[i] / x.bound[i] for x in kept]) for i in range(len(e))]
        cells = []
        for group, unit in units.items():
            some = [v for n, v in e.items() if n == group or n.rpartition(".")[0] == group]
            cells.append(f"{float(f'{rms(some) / unit:.2g}'):g}" if some else "-")
        cells.append(f"{sum(x.passed for x in kept)} of {len(kept)}")
        shown.append(f"| {case} | {ratio:.3f} | {low:.3f} to {high:.3f} | {must(fine)} | "
                     f"{np.median(over):.2f} | {' | '.join(cells)} |")  # fmt: skip
    enough = settled / len(jobs) >= 0.99
    return bool(good and enough), {
        "sessions": sessions, "shown": shown, "converged": f"{settled} of {len(jobs)}",
        "enough": must(enough),
    }  # fmt: skip


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
