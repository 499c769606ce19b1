"""What a calibration beside another body does not estimate and counts with: two stages of a filter.

As in a tumble [1]_: one size of a term in the readings changes the white rows by E and the
parameters by A, as a small part of it does. With rows e, and terms of the sizes k::

    C = (E'E + diag(1 / k^2))^-1      t = C E'e      P + A C A'

The parameters are found again from readings without the terms as they were found; where that is not
what was foretold of them, a term is no longer a small change, and all is done once more from there.

References
----------
.. [1] B. Friedland, "Treatment of bias in recursive filtering", IEEE Trans. Automatic Control
   14(4), 1969.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.diagnose import left_out
from foucault.diagnose.checks import check
from foucault.diagnose.left_out import LAYOUT_GROUPS
from foucault.infer.filtered import exchanged
from foucault.infer.gauss_newton import Component
from foucault.infer.left_out import Judgement
from foucault.infer.left_out_states import OF, Group, Posterior, fit, parts, widened
from foucault.infer.left_out_states import planned as foreseen
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import Motion, Sizes, changes, terms
from foucault.result import Check

ONE = "scale factor error"
"""Kind of terms that are states: a plain number."""

PART = 0.01
"""Of a size is put into readings [1]: a whole one bends rows by more than a small term changes."""

ROUNDS, FORETOLD = 10, 0.1
"""At most so many times; how near to what was foretold there is no other time [sd]."""

S = TypeVar("S")


@dataclass(frozen=True)
class Term:
    """A term, and what one size of it adds to the readings [SI]."""

    name: str
    group: str
    gyro: FloatArray | float = 0.0  # (n, 3) [rad/s]
    accel: FloatArray | float = 0.0  # (n, 3) [m/s^2]


def terms_of(names: Sequence[str], motion: Motion, site: Site, sizes: Sizes) -> Iterator[Term]:
    """Yield one size of all of an IMU that is not estimated, as `names` are; `sizes` [SI]."""
    for group, size in sizes.items():
        own = group in LAYOUT_GROUPS or group.endswith(" drift")
        some = terms(names, site, {group: size}) if own else []
        for term, by in zip(some, changes(some, ImuModel(), motion) if some else (), strict=True):
            more = {"gyro": by.gyro, "accel": by.accel}
            yield Term(term.name, group, **{k: x for k, x in more.items() if x is not None})


@dataclass(frozen=True)
class Stages:
    """Parameters and terms together, before anything was enlarged."""

    rows: FloatArray  # (r,) white, without the terms [1]
    E: FloatArray  # (r, c) what one size of each adds to them [1]
    A: FloatArray  # (p, c) and to the parameters that are reported [SI]
    redundancy: int  # of the rows, before the parameters [1]
    states: CoefficientVector  # parameters [SI], then terms in sizes, with covariance
    mean: FloatArray  # (p + c,) what was known of them beforehand [SI]
    groups: Mapping[str, Group]  # what is judged

    @classmethod
    def of(
        cls, c: CoefficientVector, some: Sequence[Term], sizes: Sizes,
        answers: tuple[FloatArray, FloatArray, FloatArray], redundancy: int, out: FloatArray,
    ) -> Stages:  # fmt: skip
        """Join what was found, `c` is reported of it, with what the log says of `some` terms.

        `answers`: rows (r,) [1], and what `PART` of each term's size changes of them (r, c) [1] and
        of the parameters (p, c) [SI]; `redundancy`: of the rows [1]; `sizes`: of groups [SI];
        `out`: so many times each term was taken out of readings before, (c,) or (1,) [1].
        """
        E, A, count, p = answers[1] / PART, answers[2] / PART, len(some), len(c)
        out = np.broadcast_to(out, count)
        e, values = answers[0] + E @ out, c.values + A @ out
        C = np.linalg.inv(E.T @ E + np.eye(count))
        found, cov = C @ (E.T @ e), np.zeros((p + count,) * 2)
        assert c.cov is not None
        cov[:p, :p], cov[p:, p:] = c.cov + A @ C @ A.T, C
        cov[:p, p:], cov[p:, :p] = -A @ C, -C @ A.T
        names = [f"{OF}{one.name}" for one in some]
        layout = Layout((*c.layout.coefficients, *(Coefficient(n, "t", ONE, n) for n in names)))
        states = CoefficientVector(
            layout, np.append(values - A @ found, found), cov,
            prior_sd=np.append(c.prior_sd, np.ones(count)),
        )  # fmt: skip
        groups = {g: Group("source", tuple(f"{OF}{x.name}" for x in some if x.group == g),
                           *sizes[g]) for g in dict.fromkeys(x.group for x in some)}  # fmt: skip
        return cls(e, E, A, redundancy, states, np.append(values, np.zeros(count)), groups)

    def solved(self, times: Mapping[str, float]) -> CoefficientVector:
        """Return the states with groups so many `times` as large [1]."""
        known = widened(self.states, self.groups, times)
        return exchanged(
            self.states, (self.mean, self.states.prior_sd), replace(known, values=self.mean)
        )

    def posterior(self, c: CoefficientVector) -> Posterior:
        """Return what is judged of a solution."""
        left = self.rows - self.E @ c.values[len(self.A) :]
        n = self.redundancy - len(self.A)
        return Posterior(c, self.mean, {"readings": Component(float(left @ left), n, 0.0, np.inf)})


@dataclass(frozen=True)
class Counted(Generic[S]):
    """A solution from readings without what was found of the terms, and what they add to it."""

    solution: S
    coefficients: CoefficientVector  # those that are reported, with all of their covariance [SI]
    judged: Judgement
    budget: dict[str, FloatArray]  # group -> variance that it makes of them (p,) [SI]
    off: float = 0.0  # by how much they are not what was foretold, at most [sd]

    @property
    def checks(self) -> tuple[Check, ...]:
        """What is judged, and what was found once more and is not settled."""
        found = left_out.checks(self.judged)
        if self.off < FORETOLD:
            return found
        return (*found, check("left out settled", "terms found again", self.off, None, FORETOLD))

    def beside(
        self, known: Mapping[str, FloatArray], c: CoefficientVector
    ) -> dict[str, FloatArray]:
        """Return the variance of what is reported by source, (p,) each [SI].

        `known`: source -> variance (p,) by noise and what was known, before terms were counted
        [SI].
        """
        total = np.maximum(np.sum(list(known.values()), axis=0), 1e-300)
        left = np.maximum(c.sd**2 - np.sum(list(self.budget.values()), axis=0), 0.0)
        return {name: v * left / total for name, v in known.items()} | self.budget


Again = Callable[[FloatArray], tuple[S, CoefficientVector]]
"""Finds a solution once more, and what is reported of it [SI], in readings without so many times
each term (c,) [1]."""


def counted(
    s: S, c: CoefficientVector,
    stages: Callable[[S, CoefficientVector, FloatArray], tuple[Stages, Again[S]]],
    *, planned: bool = False,
) -> Counted[S]:  # fmt: skip
    """Count with what is not estimated, and enlarge what the readings contradict.

    `c`: what is reported of a solution [SI]; `stages`: both, at a solution from readings without so
    many times each term (c,) [1]; `planned`: it is of a session that was not made.
    """
    p, out = len(c), np.zeros(1)
    for _ in range(ROUNDS):
        both, again = stages(s, c, out)
        if planned:
            c = both.states.chosen(both.states.names[:p])
            judged = foreseen(both.posterior(both.states), both.groups, c.names)
            return Counted(s, c, judged, parts(both.states, both.groups, c.names))
        last, judged = fit(both.solved, both.posterior, both.groups, c.names)
        out = last.values[p:]
        s, c = again(out)
        if (off := float(np.max(np.abs(c.values - last.values[:p]) / c.sd))) < FORETOLD:
            break
    assert last.cov is not None and c.cov is not None
    c = replace(c, cov=c.cov + both.A @ last.cov[p:, p:] @ both.A.T)
    return Counted(s, c, judged, parts(last, both.groups, c.names), off)
