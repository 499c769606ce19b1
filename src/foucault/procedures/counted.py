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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.diagnose import left_out
from foucault.diagnose.checks import check
from foucault.diagnose.left_out import LAYOUT_GROUPS
from foucault.estimate.two_bodies import Answers
from foucault.infer.filtered import exchanged
from foucault.infer.gauss_newton import Component
from foucault.infer.left_out import Judgement
from foucault.infer.left_out_states import OF, Group, Posterior, fit, parts, widened
from foucault.infer.left_out_states import planned as foreseen
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import Motion, Sizes, changes, terms
from foucault.result import Check

ONE = "scale factor error"
"""Kind of terms that are states: a plain number."""

ROUNDS, FORETOLD = 10, 0.1
"""At most so many times; how near to what was foretold there is no other time [sd]."""

INSIDE, SMALL = 20, np.repeat([1e-3, 1e-2], 3)
"""Times that terms are found at readings without them, at most; what shows a slope [SI]."""

GYROS, FORCES = slice(0, 3), slice(3, 6)
"""What is read: rates [rad/s], then specific forces [m/s^2]."""

BY_CLOCK = "by_clock"
"""Diagnostic: derivatives of what is reported by the logarithm of the rate of all clocks."""

GIVES_WAY = (
    "A mount that gives way slowly: both bodies are taken for one that is rigid, and what turns "
    "between them in the length of the session looks like a bias."
)

S = TypeVar("S")


@dataclass(frozen=True)
class Term:
    """A term, and what one size of it adds to readings [SI]."""

    name: str
    group: str
    triad: slice  # of readings, which have the rate before the specific force
    read: FloatArray  # (n, 3) [rad/s] or [m/s^2]


@dataclass(frozen=True)
class Unit:
    """An IMU with the errors that were found, and what is not estimated of it."""

    c: CoefficientVector  # what is reported of all [SI]
    time: FloatArray  # (n,) of its readings [s]
    site: Site
    sizes: Sizes  # [SI]
    own: str = ""  # what its names begin with
    late: FloatArray | float = 0.0  # (n, 3) that its forces are too small, moving [m/s^2]
    more: tuple[Term, ...] = ()  # beside those of the instrument

    @property
    def names(self) -> list[str]:
        """Names of its errors, as of one IMU alone."""
        bare = (n.removeprefix(self.own) for n in self.c.names if n.startswith(self.own))
        return [n for n in bare if n in LAYOUT.names]

    @property
    def rows(self) -> list[int]:
        """Where these are among all that is reported."""
        return [self.c.names.index(self.own + n) for n in self.names]

    def true(self, read: FloatArray) -> tuple[ImuModel, FloatArray, FloatArray]:
        """Return errors, and specific force [m/s^2] and rate [rad/s] of readings without terms.

        `read`: those, (n, 6) [SI].
        """
        own = CoefficientVector(LAYOUT.subset(self.names), self.c.values[self.rows])
        model = ImuModel.from_coefficients(own)
        f, w = model.compensate(read[:, 3:] + self.late, read[:, :3])
        assert f is not None and w is not None
        return model, f, w

    def terms(self, read: FloatArray) -> list[Term]:
        """Return one size of all that is not estimated, of further IMUs as large as of the first.

        `read`: readings without it, (n, 6) [SI].
        """
        _, f, w = self.true(read)
        motion, out = Motion(self.time, f, w, float(self.time[0]), float(self.time[-1])), []
        for group, size in self.sizes.items():
            of_imu = group in LAYOUT_GROUPS or group.endswith(" drift")
            some = terms(self.names, self.site, {group: size}) if of_imu else []
            made = changes(some, ImuModel(), motion) if some else ()
            for term, by in zip(some, made, strict=True):
                triad, own = (GYROS, by.gyro) if by.accel is None else (FORCES, by.accel)
                assert own is not None
                out.append(Term(self.own + term.name, group, triad, own))
        return [*out, *self.more]

    def _sum(self, read: FloatArray, times: FloatArray) -> FloatArray:
        out = np.zeros_like(read)
        for one, k in zip(self.terms(read), times, strict=True):
            out[:, one.triad] += k * one.read
        return out

    def without(self, read: FloatArray, times: FloatArray) -> FloatArray:
        """Return readings without terms, which are those of what is left (n, 6) [SI].

        `read`: with them, (n, 6) [SI]; `times`: so many of each term, (c,) [1].
        """
        out = read
        for _ in range(INSIDE):
            last, out = out, read - self._sum(out, times)
            if (np.abs(out - last) < 1e-3 * SMALL).all():
                break
        return out

    def added(self, read: FloatArray, times: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return what one size of each adds to readings, from which so many `times` it were taken.

        Readings r have been taken for ``y + g(y, c) x = r``, with terms g of the true motion. So

            dy = -(I + h)^-1 (g dx - h m dc),    h = d(g x) / dy,    m = d(reading) / dc

        `read`: y, (n, 6) [SI]; `times`: x, (c,) [1]. Returns columns g and, of each error, -h m,
        (n, 6, c), and of each column which parameter it goes with, negative: it is a term (c,).
        """
        some = self.terms(read)
        G = np.zeros((*read.shape, len(some)))
        for k, one in enumerate(some):
            G[:, one.triad, k] = one.read
        if not times.any():
            return G, np.full(G.shape[2], -1)
        now = self._sum(read, times)
        h = np.stack([self._sum(read + d, times) - now for d in np.diag(SMALL)], axis=2) / SMALL
        model, f, w = self.true(read)
        slopes = model.slopes(f, w, self.names)
        m = np.concatenate([slopes.gyro, slopes.accel], axis=1)
        columns = np.linalg.inv(np.eye(6) + h) @ np.concatenate([G, -h @ m], axis=2)
        return columns, np.append(np.full(G.shape[2], -1), self.rows)


@dataclass(frozen=True)
class Stages:
    """Parameters and terms together, before anything was enlarged."""

    answers: Answers  # of white rows without the terms, and of the parameters that are reported
    states: CoefficientVector  # parameters [SI], then terms in sizes, with covariance
    mean: FloatArray  # (p + c,) what was known of them beforehand [SI]
    groups: Mapping[str, Group]  # what is judged

    @classmethod
    def of(
        cls, c: CoefficientVector, some: Sequence[Term], sizes: Sizes,
        answers: Answers, out: FloatArray,
    ) -> Stages:  # fmt: skip
        """Join what was found, `c` is reported of it, with what the log says of `some` terms.

        `answers`: what one size of each changes; `sizes`: of groups [SI]; `out`: so many times each
        term was taken out of readings before, (c,) or (1,) [1].
        """
        (square, pull, gram, A, _), count, p = answers, len(some), len(c)
        out = np.broadcast_to(out, count)
        there = answers._replace(
            square=float(square + 2 * out @ pull + out @ gram @ out), pull=pull + gram @ out
        )
        values = c.values + A @ out
        C = np.linalg.inv(gram + np.eye(count))
        found, cov = C @ there.pull, np.zeros((p + count,) * 2)
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
        return cls(there, states, np.append(values, np.zeros(count)), groups)

    def solved(self, times: Mapping[str, float]) -> CoefficientVector:
        """Return the states with groups so many `times` as large [1]."""
        known = widened(self.states, self.groups, times)
        return exchanged(
            self.states, (self.mean, self.states.prior_sd), replace(known, values=self.mean)
        )

    def posterior(self, c: CoefficientVector) -> Posterior:
        """Return what is judged of a solution."""
        square, pull, gram, A, redundancy = self.answers
        x = c.values[len(A) :]
        left = float(square - 2 * x @ pull + x @ gram @ x)
        found = Component(left, redundancy - len(A), 0.0, np.inf)
        return Posterior(c, self.mean, {"readings": found})


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
        return (*found, check("left out settled", "moved by terms [sd]", self.off, None, FORETOLD))

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


Again = Callable[[FloatArray, CoefficientVector], tuple[S, CoefficientVector]]
"""Finds a solution once more, and what is reported of it [SI], in readings without so many times
each term (c,) [1], at the errors that were foretold."""


def counted(
    s: S, c: CoefficientVector,
    stages: Callable[[S, CoefficientVector, FloatArray], tuple[Stages, Again[S]]],
    *, planned: bool = False,
) -> Counted[S]:  # fmt: skip
    """Count with what is not estimated, and enlarge what the readings contradict.

    `c`: what is reported of a solution [SI]; `stages`: both, at a solution from readings without so
    many times each term (c,) or (1,) [1]; `planned`: it is of a session that was not made.
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
        s, c = again(out, replace(c, values=last.values[:p]))
        if (off := float(np.max(np.abs(c.values - last.values[:p]) / c.sd))) < FORETOLD:
            break
    assert last.cov is not None and c.cov is not None
    A = both.answers.A
    c = replace(c, cov=c.cov + A @ last.cov[p:, p:] @ A.T)
    return Counted(s, c, judged, parts(last, both.groups, c.names), off)
