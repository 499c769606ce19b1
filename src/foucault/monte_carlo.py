"""Run the same trial many times: any split over workers gives the same numbers.

Trial i gets the seed ``SeedSequence(seed, spawn_key=(i,))``, which depends on nothing but the
study's seed and i. This module knows neither files nor clusters: it is given a `map`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import numpy as np

Row = Mapping[str, Any]
Trial = Callable[[int, np.random.SeedSequence], Row]


class Map(Protocol):
    """Like the built-in ``map`` over one iterable: results in order, computed anywhere."""

    def __call__(self, function: Callable[[int], Row], items: Iterable[int], /) -> Iterable[Row]:
        """Apply `function` to every item."""
        ...


def threads(workers: int) -> Map:
    """Return a map over a pool of threads; the kernels and the linear algebra release the GIL.

    Parameters
    ----------
    workers : int, shape ()
        Number of threads [1].
    """

    def over_threads(function: Callable[[int], Row], items: Iterable[int], /) -> Iterable[Row]:
        pool = ThreadPoolExecutor(workers)
        try:
            yield from pool.map(function, items)
        finally:  # an interrupted study must not finish what was queued
            pool.shutdown(cancel_futures=True)

    return over_threads


def run(trial: Trial, indices: Sequence[int], seed: int, map: Map = map) -> Iterator[Row]:
    """Run trials and yield their rows in the order of `indices`.

    Parameters
    ----------
    trial : callable
        ``(index, seed sequence) -> row``; a failure of mathematics is a status in the row.
    indices : sequence of int, length n
        Numbers of the trials [1].
    seed : int, shape ()
        Seed of the study [1].
    map : callable
        Where to compute: the built-in `map`, `threads(n)`, or that of a cluster.

    Yields
    ------
    mapping
        The row of each trial.
    """

    def numbered(index: int) -> Row:
        return trial(index, np.random.SeedSequence(seed, spawn_key=(index,)))

    yield from map(numbered, indices)
