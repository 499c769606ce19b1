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
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from operator import add
from typing import Any, TypeVar

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.north import Implausible, drift_effect, implausible, signal_to_noise
from foucault.estimate.north import Fixes, Known, bound, level_square, settled, sought
from foucault.estimate.north_reduction import Nuisance, Pairs, reduce
from foucault.models.earth import Site
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation, Dwells, up_b
from foucault.procedures.north_seeking.counted import on_case
from foucault.procedures.north_seeking.field import (
    HOUR,
    Left,
    Products,
    Scatter,
    Terms,
    misfits,
)

BLOCK = 8192
"""Set-ups that are solved at once: fewer, and each call of a block costs as much as they do [1]."""

T = TypeVar("T")
U = TypeVar("U")


def in_blocks(count: int, of: Callable[[IntArray], T], start: int = 0) -> Iterator[T]:
    """Yield what `of` makes of the numbers of set-ups `start` to `count` [1], block by block."""
    blocks = np.split(np.arange(start, count), range(BLOCK, count - start, BLOCK))
    cores = min(len(blocks), os.cpu_count() or 1)
    if cores == 1:
        yield from map(of, blocks)
        return
    with ThreadPoolExecutor(cores) as pool:
        yield from pool.map(of, blocks)


def joined(count: int, of: Callable[[IntArray], tuple[T, U]]) -> tuple[T, list[U]]:
    """Return one of the dataclasses of all blocks, with all their arrays one after the other.

    Each is put in its place by who made it: memory holds the arrays once.

    `count`: set-ups of all [1]; `of`: makes of the numbers of some [1] what is joined, and what is
    returned block by block.
    """
    one, told = of(np.arange(min(BLOCK, count)))
    whole: T = _room(one, count)
    _put(whole, one, count, 0)

    def put(some: IntArray) -> U:
        part, more = of(some)
        _put(whole, part, count, int(some[0]))
        return more

    rest = in_blocks(count, put, BLOCK) if count > BLOCK else ()
    return whole, [told, *rest]


def _fields(part: Any) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a dataclass, not what it has worked out beside."""
    return ((one.name, getattr(part, one.name)) for one in fields(part))


def _room(part: Any, m: int) -> Any:
    """Return `part` with room for m set-ups."""
    out: dict[str, Any] = {}
    for name, x in _fields(part):
        if isinstance(x, np.ndarray):
            out[name] = np.empty((m if len(x) else 0, *x.shape[1:]), x.dtype)
        elif isinstance(x, dict):
            out[name] = {}
        else:
            out[name] = _room(x, m) if is_dataclass(x) else x
    return type(part)(**out)


def _put(whole: Any, part: Any, m: int, start: int) -> None:
    """Put a part, of m set-ups in all, to set-up `start`."""
    for name, x in _fields(part):
        room = getattr(whole, name)
        if isinstance(x, np.ndarray):
            room[start : start + len(x)] = x
        elif isinstance(x, dict):
            for key, each in x.items():  # a source that is none of another block is nothing there
                if key not in room:
                    room.setdefault(key, np.zeros((m, *each.shape[1:])))  # another may be faster
                room[key][start : start + len(each)] = each
        elif is_dataclass(x):
            _put(room, x, m, start)


@dataclass(frozen=True)
class Found:
    """What is found of m set-ups."""

    pairs: Pairs  # their four numbers, as far as a result says them [SI]
    fixes: Fixes  # solutions [rad]
    bound: FloatArray  # (m, 4) Cramer-Rao bound, white noise and a perfect instrument alone [rad]
    drift_effect: FloatArray  # (m,) of a drift of 1 rad/s^2 that is not estimated [s^2]
    ratio: FloatArray  # (m,) Earth's rate over what the gyro leaves uncertain of it [1]
    level: FloatArray | None  # (m,) of `level_square`, None where nothing is said of the level [1]
    # most, row: (m,) of `Pairs.worst` [sd], [1]
    most: FloatArray
    row: IntArray

    @property
    def results(self) -> Found:
        """The same with what all set-ups keep: no readings."""
        return replace(self, pairs=self.pairs.results)

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
    scatter: Scatter | None = None  # what may explain that, None: nothing is asked

    def __add__(self, more: Told) -> Told:
        products = self.products
        if products is not None and more.products is not None:
            products += more.products
        scatter = self.scatter
        if scatter is not None and more.scatter is not None:
            scatter += more.scatter
        each = zip(self.implausible, more.implausible, strict=True)
        return Told(
            tuple(max(two, key=lambda one: one.size) for two in each), products,
            {**self.groups, **more.groups}, self.misfit or more.misfit, scatter,
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

        def of(some: IntArray) -> tuple[Found, tuple[Told, list[str]]]:
            found, told = self.of_some(times, some, 1)
            return found.results, (told, [*found.fixes.sources])

        whole, told = joined(len(self.dwells.names), of)
        names = dict.fromkeys(name for _, some in told for name in some)  # whoever was faster
        sources = {name: whole.fixes.sources[name] for name in names}
        fixes = replace(whole.fixes, sources=sources)
        return replace(whole, fixes=fixes), functools.reduce(add, (one for one, _ in told))

    def of_some(
        self, times: Mapping[str, float], some: IntArray, budget: int = 4
    ) -> tuple[Found, Told]:
        """Solve set-ups of numbers `some` (k,) as `found` does all, with all that is said of them.

        `times`: as of `found` [1]; `budget`: as of `settled` [1].
        """
        dwells, known = self.dwells.setups(some), self.known.of(some)
        compensation = self.compensation
        pairs = reduce(dwells, self.noise, self.nuisance)
        told = Told(implausible(dwells, pairs, known, compensation))
        best, later = sought(pairs, known, compensation), self.sizes is not None
        fixes = settled(pairs, known, compensation, best, 0 if later else budget)
        if self.sizes is not None:
            left = Left.of(dwells, pairs, fixes.angles, known, compensation, self._terms,
                           self._span)  # fmt: skip
            products = left.products(fixes.status == 0)
            scatter = None if dwells.accel is None else self._scatter(dwells, pairs, fixes, known)
            told = Told(told.implausible, products, left.groups, misfits(pairs), scatter)
            pairs, known = left.counted(times)
            fixes = settled(pairs, known, compensation, fixes, budget)
        least = bound(pairs, known, compensation, fixes.angles)
        level = None
        if known.level_sd is not None and dwells.accel is not None:
            level = level_square(pairs, known, compensation)
        ratio, effect = signal_to_noise(fixes, pairs), drift_effect(pairs, fixes)
        fixes = replace(fixes, slope=np.zeros((0, 4)))  # it is in the effect
        worst = pairs.worst(dwells.first)
        return Found(pairs, fixes, least, effect, ratio, level, *worst), told

    @cached_property
    def _span(self) -> tuple[float, float]:
        """Begin and end of all readings, far enough apart for a drift [s]."""
        d = self.dwells
        begin = float(d.start.min())
        return begin, max(float((d.start + d.time).max()), begin + HOUR)

    @cached_property
    def _terms(self) -> Terms:
        """What is not estimated."""
        names = self.compensation.coefficients.names
        return Terms.of(names, self.site, self.sizes or {}, on_case(self.dwells))

    @cached_property
    def _forces(self) -> Terms:
        """What of that is of accelerometers, whatever is estimated."""
        some = {g: size for g, size in self._terms.sizes.items() if g.startswith("accel.")}
        return Terms.of((), self.site, some, on_case(self.dwells))

    def _scatter(self, dwells: Dwells, pairs: Pairs, fixes: Fixes, known: Known) -> Scatter:
        angles = np.where(np.isfinite(fixes.angles), fixes.angles, 0.0)
        f_b = np.reshape(known.gravity, (-1, 1)) * up_b(angles[:, 1], angles[:, 2])
        return Scatter.of(pairs, dwells, f_b, self._span, self._forces)
