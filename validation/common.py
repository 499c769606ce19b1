"""What the validations share: where logs lie, limits over a count, words and runs side by side."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
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


def each(one: Callable[[Any], Any], jobs: Sequence[Any], workers: int = 2) -> Iterator[Any]:
    """Do all jobs, by so many processes; say how far it is."""
    with multiprocessing.Pool(min(workers, os.cpu_count() or 1)) as pool:
        for k, done in enumerate(pool.imap(one, jobs)):
            print(f"\r{k + 1} of {len(jobs)}", end="", file=sys.stderr, flush=True)
            yield done
    print(file=sys.stderr)
