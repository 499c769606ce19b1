"""North of many set-ups: block by block, on all cores; of each block stays what a result says.

A set-up is solved by itself, whatever is in its block, and blocks are put together in their order:
the numbers are the same for any number of cores. What all set-ups tell together, the products of
`field`, is summed up.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from operator import add
from typing import Any, TypeVar

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.north import Implausible, drift_effect, implausible, signal_to_noise
from foucault.estimate.north import Fixes, Known, bound, level_square, settled, solve
from foucault.estimate.north_reduction import Nuisance, Pairs, left_white, reduce
from foucault.models.earth import Site
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation, Dwells
from foucault.procedures.north_seeking.counted import explained
from foucault.procedures.north_seeking.field import Left, Products, misfits

BLOCK = 4096
"""Set-ups that are solved at once: fewer, and each call of a block costs as much as they do [1]."""

T = TypeVar("T")


def in_blocks(count: int, of: Callable[[IntArray], T]) -> Iterator[T]:
    """Yield what `of` makes of the numbers of `count` set-ups [1], block by block."""
    blocks = np.split(np.arange(count), range(BLOCK, count, BLOCK))
    cores = min(len(blocks), os.cpu_count() or 1)
    if cores == 1:
        yield from map(of, blocks)
        return
    with ThreadPoolExecutor(cores) as pool:
        yield from pool.map(of, blocks)


ROWS = ("fit", "residuals", "accel_residuals", "accel_white", "gyro_weights", "accel_weights")
"""Arrays with a row for every reading; others have one for every set-up, or none."""


def joined(parts: Iterator[T], dwells: Dwells) -> T:
    """Return one of the dataclasses of all blocks, with all their arrays one after the other.

    Each is put in its place as it comes: memory holds the arrays once.

    `dwells`: the readings [SI].
    """
    first = next(parts)
    m, n = len(dwells.names), len(dwells)
    whole: T = _room(first, m, n)
    at = 0, 0
    for part in chain([first], parts):
        at = _put(whole, part, m, at)
    return whole


def _room(part: Any, m: int, n: int) -> Any:
    """Return `part` with room for m set-ups and n readings."""
    out: dict[str, Any] = {}
    for name, x in vars(part).items():
        if isinstance(x, np.ndarray):
            size = (n if name in ROWS else m) if len(x) else 0
            out[name] = np.empty((size, *x.shape[1:]), x.dtype)
        elif isinstance(x, dict):
            out[name] = {}
        else:
            out[name] = None if x is None else _room(x, m, n)
    return type(part)(**out)


def _put(whole: Any, part: Any, m: int, at: tuple[int, int]) -> tuple[int, int]:
    """Put a part, of m set-ups in all, to set-up and reading `at`; return where the next begins."""
    setup, row = at
    end = setup + len(part), row
    for name, x in vars(part).items():
        room = getattr(whole, name)
        if isinstance(x, np.ndarray):
            start = row if name in ROWS else setup
            room[start : start + len(x)] = x
            end = (end[0], max(end[1], start + len(x))) if name in ROWS else end
        elif isinstance(x, dict):
            for key, each in x.items():  # a source that is none of another block is nothing there
                there = room.setdefault(key, np.zeros((m, *each.shape[1:])))
                there[setup : end[0]] = each
        elif x is not None:
            end = end[0], max(end[1], _put(room, x, m, at)[1])
    return end


@dataclass(frozen=True)
class Found:
    """What is found of m set-ups."""

    pairs: Pairs  # their four numbers, as far as a result says them [SI]
    fixes: Fixes  # solutions [rad]
    bound: FloatArray  # (m, 4) Cramer-Rao bound, white noise and a perfect instrument alone [rad]
    drift_effect: FloatArray  # (m,) of a drift of 1 rad/s^2 that is not estimated [s^2]
    ratio: FloatArray  # (m,) Earth's rate over what the gyro leaves uncertain of it [1]
    level: FloatArray | None  # (m,) of `level_square`, None where nothing is said of the level [1]

    def __len__(self) -> int:
        return len(self.fixes)


@dataclass(frozen=True)
class Told:
    """What a block tells beside: it is put together with that of the others."""

    implausible: tuple[Implausible, ...]  # what reads more than there is
    products: Products | None = None  # of what is not estimated, None: nothing is left out
    # group -> its terms, of groups that do something to these set-ups
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    misfit: bool = False  # accelerometers of one scatter by more than their noise

    def __add__(self, more: Told) -> Told:
        products = self.products
        if products is not None and more.products is not None:
            products += more.products
        each = zip(self.implausible, more.implausible, strict=True)
        return Told(
            tuple(max(two, key=lambda one: one.size) for two in each), products,
            {**self.groups, **more.groups}, self.misfit or more.misfit,
        )  # fmt: skip


@dataclass(frozen=True)
class Seeking:
    """Set-ups whose north is sought, and what they share."""

    dwells: Dwells  # readings of all [SI]
    known: Known
    noise: ImuNoise  # [SI]
    nuisance: Nuisance
    compensation: Compensation  # errors of the instrument
    site: Site
    sizes: Sizes | None  # of what is not estimated, None: nothing is put to it [SI]

    def of(self, some: IntArray) -> Pairs:
        """Return the four numbers of set-ups `some` (k,) by their readings alone [SI]."""
        return reduce(self.dwells.setups(some), self.noise, self.nuisance)

    def found(self, times: Mapping[str, float]) -> tuple[Found, Told]:
        """Solve all set-ups, with so many `times` the sizes of groups of what is left out [1]."""
        parts = in_blocks(len(self.dwells.names), partial(self._found, times))
        told = list[Told]()

        def each() -> Iterator[Found]:
            for found, more in parts:
                told.append(more)
                yield found

        return joined(each(), self.dwells), functools.reduce(add, told)

    def _found(self, times: Mapping[str, float], some: IntArray) -> tuple[Found, Told]:
        dwells, known = self.dwells.setups(some), self.known.of(some)
        compensation = self.compensation
        pairs = reduce(dwells, self.noise, self.nuisance)
        told = Told(implausible(dwells, pairs, known, compensation))
        fixes = solve(pairs, known, compensation)
        if self.sizes is not None:
            left = self._left(dwells, pairs, fixes.angles, known)
            groups = {g: left.names[g] for g, B in left.columns.items() if B.any()}
            products = left.products(fixes.status == 0)
            told = Told(told.implausible, products, groups, misfits(pairs))
            pairs, known = left.counted(times)
            fixes = settled(pairs, known, compensation, fixes)
        least = bound(pairs, known, compensation, fixes.angles)
        level = None
        if known.level_sd is not None and dwells.accel is not None:
            level = level_square(pairs, known, compensation)
        ratio, effect = signal_to_noise(fixes, pairs), drift_effect(pairs, fixes)
        fixes = replace(fixes, slope=np.zeros((0, 4)))  # it is in the effect
        return Found(pairs.results, fixes, least, effect, ratio, level), told

    @cached_property
    def span(self) -> tuple[float, float]:
        """Begin and end of all readings [s]."""
        d = self.dwells
        return float(d.start.min()), float((d.start + d.time).max())

    def _left(self, dwells: Dwells, pairs: Pairs, angles: FloatArray, known: Known) -> Left:
        assert self.sizes is not None
        return Left.of(dwells, pairs, angles, known, self.compensation, self.site, self.sizes,
                       self.span)  # fmt: skip

    def scatter(self, times: Mapping[str, float]) -> FloatArray:
        """Return the products of `counted.explained` over all set-ups, by `times` [1]."""
        return np.asarray(sum(in_blocks(len(self.dwells.names), partial(self._scatter, times))))

    def _scatter(self, times: Mapping[str, float], some: IntArray) -> FloatArray:
        dwells, known = self.dwells.setups(some), self.known.of(some)
        pairs = reduce(dwells, self.noise, self.nuisance)
        fixes = solve(pairs, known, self.compensation)
        left = self._left(dwells, pairs, fixes.angles, known)
        white = partial(left_white, dwells, self.noise, self.nuisance)
        return explained(pairs, dwells, left.motion, white, times, self.site, left.sizes)
