"""How many terms the functions of temperature need, told by F-tests.

The functions of a family (the three biases of the gyros, say) are one of several nested spaces:
constant, straight line, parabola ... `choose` starts with the largest that the temperatures allow,
takes the scatter from there, and takes the last term of a family away as long as the sum of squares
grows by no more than chance explains. In this order a term that is missing cannot hide in the
scatter. `against` is the same test of any two designs, for what else may be missing.

References
----------
.. [1] G. A. F. Seber, A. J. Lee, *Linear Regression Analysis*, 2nd ed., 2003, section 4.3 (F-test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.estimate.chi_square import FALSE_ALARM
from foucault.estimate.temperature.fit import Design, Evidence, Fit, scatter, solve


@dataclass(frozen=True)
class Spaces:
    """The functions that every family may have, and which coefficients it has."""

    # per family: the spaces from the smallest to the largest, each shape (k, b) [any]
    nested: tuple[tuple[FloatArray, ...], ...]
    family: IntArray  # (n,) the family of each coefficient [1]
    constant: FloatArray  # (1, b) the space of a constant [any]
    constants: int  # how many constants nobody wants to know follow the coefficients [1]

    def design(self, orders: Sequence[int], more: FloatArray | None = None, of: int = -1) -> Design:
        """Return the design where each family has the space of its order.

        `orders`: number of the space of each family [1]; `more` (k, b) or None: functions that
        one family has besides [any]; `of`: that family [1].
        """
        spaces = []
        for f in self.family:
            space = self.nested[f][orders[f]]
            spaces.append(space if more is None or f != of else np.concatenate([space, more]))
        return Design.of([*spaces, *[self.constant] * self.constants])

    def largest(self) -> list[int]:
        """Return the number of the largest space of each family."""
        return [len(spaces) - 1 for spaces in self.nested]


@dataclass(frozen=True)
class Test:
    """One F-test: does a family need more than it has?"""

    family: int  # number of the family [1]
    order: int  # the space it has [1]
    against: int  # the larger one it was tested against [1]
    F: float  # growth of the sum of squares per term [1]
    p: float  # probability of so much by chance [1]


@dataclass(frozen=True)
class Choice:
    """What the evidence needs."""

    fit: Fit
    orders: tuple[int, ...]  # number of the space of each family [1]
    needed: tuple[Test, ...]  # per family that changes: its space against the next smaller one
    missing: tuple[Test, ...]  # per family that could have more: its space against the largest
    # (g,) degrees of freedom that tell the scatter of each group; infinite where it is taken as
    # known [1]
    dof: FloatArray
    known: FloatArray  # (g,) s_f^2 as declared [unit^2]
    # wanted, untold: (g,) scatters that were to be found; those of them for which there is no
    # freedom, taken as zero
    wanted: BoolArray
    untold: BoolArray


def choose(
    evidence: Sequence[Evidence],
    spaces: Spaces,
    fixed: dict[int, int],
    known: FloatArray,
    wanted: BoolArray,
) -> Choice | None:
    """Choose the space of every family; None where the evidence cannot even tell those asked for.

    `fixed`: family -> the number of the space it has to have [1]; `known` (g,): s_f^2 where it is
    declared [unit^2]; `wanted` (g,): which scatters are to be found.
    """
    largest = spaces.largest()
    full = spaces.design(largest)
    if solve(evidence, full, known) is None:
        return None
    free, dof = _told(evidence, full, wanted)
    variance = scatter(evidence, full, known, free)
    tester = _Tester(evidence, spaces, variance, dof, max(1, sum(n > 0 for n in largest)))
    # What is fixed too low leaves its misfit to those it is correlated with: it is not, in tests.
    beside = tester.reduced(largest, set(fixed))
    orders = [fixed.get(f, n) for f, n in enumerate(beside)]
    needed = [tester.test(beside, f, n - 1, n) for f, n in enumerate(orders) if n > 0]
    missing = [
        tester.test(beside, f, n, largest[f]) for f, n in enumerate(orders) if n < largest[f]
    ]
    found = refit(evidence, spaces.design(orders), known, wanted)
    if found is None:
        return None
    fit, dof, free = found
    return Choice(fit, tuple(orders), tuple(needed), tuple(missing), dof, known, wanted,
                  wanted & ~free)  # fmt: skip


def refit(
    evidence: Sequence[Evidence], design: Design, known: FloatArray, wanted: BoolArray
) -> tuple[Fit, FloatArray, BoolArray] | None:
    """Fit one design with its scatter; None where the evidence cannot tell it.

    `known` (g,): s_f^2 where it is declared [unit^2]; `wanted` (g,): which scatters are to be
    found. Returns `dof` (g,): degrees of freedom that tell each scatter; infinite where it is
    taken as known [1]; `free` (g,): which scatters were found.
    """
    if solve(evidence, design, known) is None:
        return None
    free, dof = _told(evidence, design, wanted)
    fit = solve(evidence, design, scatter(evidence, design, known, free))
    return None if fit is None else (fit, dof, free)


def against(small: Fit, large: Fit, dof: float) -> tuple[float, float, int]:
    """Return F, its probability by chance and its number of terms, of two fits one in the other.

    `dof`: degrees of freedom that tell the scatter, infinite where it is declared [1].
    """
    terms = max(len(large.theta) - len(small.theta), 1)
    F = max(small.chi_square - large.chi_square, 0.0) / terms
    if np.isinf(dof):
        return F, float(special.chdtrc(terms, F * terms)), terms
    return F, float(special.fdtrc(terms, dof, F)), terms


@dataclass(frozen=True)
class _Tester:
    """Tests families against one another, all with the scatter of the largest design."""

    evidence: Sequence[Evidence]
    spaces: Spaces
    variance: FloatArray
    dof: FloatArray
    tests: int
    fits: dict[tuple[int, ...], Fit] = field(default_factory=dict)

    def fit(self, orders: tuple[int, ...]) -> Fit:
        if orders not in self.fits:
            fit = solve(self.evidence, self.spaces.design(orders), self.variance)
            assert fit is not None  # a part of what was told
            self.fits[orders] = fit
        return self.fits[orders]

    def test(self, orders: Sequence[int], family: int, small: int, large: int) -> Test:
        fits = [
            self.fit(tuple(order if f == family else n for f, n in enumerate(orders)))
            for order in (small, large)
        ]
        F, p, _ = against(fits[0], fits[1], self.dof[family])
        return Test(family, small, large, F, p)

    def reduced(self, orders: list[int], fixed: set[int]) -> list[int]:
        """Take terms away while chance explains them."""
        while True:
            tests = [
                self.test(orders, f, n - 1, n)
                for f, n in enumerate(orders)
                if n > 0 and f not in fixed
            ]
            worst = max(tests, key=lambda t: t.p, default=None)
            if worst is None or worst.p <= FALSE_ALARM / self.tests:
                return orders
            orders = [worst.order if f == worst.family else n for f, n in enumerate(orders)]


def _told(
    evidence: Sequence[Evidence], design: Design, wanted: BoolArray
) -> tuple[BoolArray, FloatArray]:
    """Return which scatters there is freedom to find, and how much of it tells each."""
    rows = np.zeros(len(wanted))
    owner: dict[int, int] = {}
    for one in evidence:
        np.add.at(rows, one.group, 1.0)
        for row, group in zip(one.H, one.group, strict=True):
            # A row of a session is of one coefficient; one of a ramp is led by its own constant.
            owner.setdefault(int(np.flatnonzero(row)[-1]), int(group))
    for coefficient in design.coefficient:
        if int(coefficient) in owner:
            rows[owner[int(coefficient)]] -= 1.0
    free = wanted & (rows > 0)
    return free, np.where(free, rows, np.inf)
