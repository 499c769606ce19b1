"""Run the same trial many times: any split over workers gives the same numbers.

Trial i gets the seed ``SeedSequence(seed, spawn_key=(i,))``, which depends on nothing but the
study's seed and i. This module knows neither files nor clusters: it is given a `map`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

Row = Mapping[str, Any]
Trial = Callable[[int, np.random.SeedSequence], Row]
S = TypeVar("S")
T = TypeVar("T")

AHEAD = 2  # Items that are begun, or done and not yet asked for, per worker [1].


class Map(Protocol):
    """Like the built-in ``map`` over one iterable: results in order, computed anywhere.

    Items are taken as they are needed, and never many more than the workers can begin.
    """

    def __call__(self, function: Callable[[S], T], items: Iterable[S], /) -> Iterator[T]:
        """Apply `function` to every item."""
        ...


def threads(workers: int) -> Map:
    """Return a map over a pool of threads; the kernels and the linear algebra release the GIL.

    `workers`: number of threads [1].
    """

    def over_threads(function: Callable[[S], T], items: Iterable[S], /) -> Iterator[T]:
        pool, waiting = ThreadPoolExecutor(workers), deque[Future[T]]()
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > AHEAD * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:  # an interrupted study must not finish what was queued
            pool.shutdown(cancel_futures=True)

    return over_threads


@dataclass(frozen=True)
class Numbered:
    """A trial that knows its seed by its number; goes to another process where the trial does."""

    trial: Trial
    seed: int  # seed of the study [1]

    def __call__(self, index: int) -> Row:
        """Run trial number `index`."""
        return self.trial(index, np.random.SeedSequence(self.seed, spawn_key=(index,)))


def run(
    trial: Trial, indices: Sequence[int], seed: int, map: Map = map
) -> Generator[Row, None, None]:
    """Run trials and yield their rows in the order of `indices`.

    `trial`: ``(index, seed sequence) -> row``, a failure of mathematics is a status in the row;
    `indices`: numbers of the trials [1]; `seed`: seed of the study [1]; `map`: where to compute:
    the built-in `map`, `threads(n)`, or that of a cluster.
    """
    yield from map(Numbered(trial, seed), indices)
