"""Fit readings on a table: outliers left out, unexplained scatter estimated.

A wrong reading is looked for by data snooping, because with few redundant readings it spreads over
the residuals of all. Where several readings would look alike none is left out, and the result
says so. Scatter beyond the noise is one more variance for each group of readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Status
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.snooping import Snooping, snoop, snoop_fit
from foucault.estimate.table.likelihood import FOUND_IN, KINDS, Options, TableModel
from foucault.infer import mixed
from foucault.models.earth import Site
from foucault.models.readings import Readings
from foucault.models.table_geometry import Angles
from foucault.models.table_state import State
from foucault.result import Estimate, Linearised

ENOUGH = 8.0
"""With fewer degrees of freedom scatter is added only where it is significant [1]."""


@dataclass(frozen=True)
class TableFit:
    """A solution, and which readings are wrong."""

    fit: mixed.Fit
    # (k,) observations of which one is wrong, but it cannot be told which, see `TableModel.rows`
    suspects: tuple[int, ...] = ()
    # (k,) readings of which the angles of one are wrong, but it cannot be told which
    angle_suspects: tuple[int, ...] = ()

    @property
    def model(self) -> TableModel:
        """What was fitted."""
        model = self.fit.model
        assert isinstance(model, TableModel)
        return model

    @property
    def estimate(self) -> Estimate:
        """What was estimated."""
        return self.fit.estimate

    @property
    def scatter(self) -> dict[str, float]:
        """Source -> scatter that was found beyond the noise, see `likelihood` [SI]."""
        return {name: sd for name, sd in self.fit.found.items() if sd > 0}

    @property
    def outliers(self) -> tuple[int, ...]:
        """The observations that were left out, see `TableModel.rows`."""
        return tuple(int(b) for b in self.model.rows[self.fit.outliers])

    @property
    def wrong_angles(self) -> tuple[int, ...]:
        """The readings whose table angles were not believed, because they are far off."""
        geometry = self.estimate.state.geometry
        return geometry.doubted if isinstance(geometry, Angles) else ()

    @cached_property
    def snooping(self) -> Snooping:
        """Tests of the observations at the solution, outliers left out."""
        return snoop_fit(self.fit)

    def solved(self, state: State | None = None, weights: FloatArray | None = None) -> TableFit:
        """Solve again with the same sizes of everything.

        `state` or None: another one to start from; `weights` (k,) or None: what an observation
        counts, where it has changed [1].
        """
        old = self.fit
        at = self.estimate.state if state is None else state
        weights = self.estimate.weights if weights is None else weights
        fit = mixed.solve(old.model, old.sds, weights, at)
        if old.found:
            fit = replace(fit, found=old.found, dof=old.dof, before=old.before)
        return replace(self, fit=fit)


def fit(readings: Readings, site: Site, start: State, options: Options) -> TableFit:
    """Estimate the coefficients, the outliers, and the scatter that the noise leaves unexplained.

    `readings`: means with the covariance of their noise [SI]; `start`: where to start, its
    geometry says what is believed of the table; `options`: how to fit. A prior comes last, when
    outliers and scatter are settled: they would take up what contradicts it.
    """
    model, prior = TableModel(readings, site, start, options), options.prior
    alone = mixed.solve(model)
    if alone.estimate.status is Status.UNOBSERVABLE and prior is not None:
        return TableFit(mixed.fit(model, prior, robust=options.robust))
    told = dict.fromkeys((s.name for s in model.sources if s.unexplained), 0.0)
    for kind, c in alone.after.items():
        if FOUND_IN[kind][-1] in told:
            told[FOUND_IN[kind][-1]] += c.redundancy
    few = frozenset(name for name, dof in told.items() if dof < ENOUGH)
    found = TableFit(replace(alone, model=replace(model, tested=few)))
    suspects: tuple[int, ...] = ()
    angles: tuple[int, ...] = ()
    for _ in range(2):  # outliers make scatter, and scatter makes outliers: look twice for each
        now = found
        if options.robust:
            now, alike_angles = _without_wrong_angles(now)
            angles = angles or alike_angles
            now, alike = _without_outliers(now)
            suspects = suspects or alike
        # A noise that nobody knows, and was made up, bends everything: its scatter is found twice.
        if now is found and found.fit.found and readings.noise_from != "unknown":
            break
        found = now
        if options.repeatability:
            found = replace(now, fit=mixed.fit(now.fit.model, near=now.fit))
    if isinstance(found.estimate.state.geometry, Angles):
        found = _believed_again(found)
    return TableFit(mixed.with_prior(found.fit, prior), suspects, angles)


def _without_wrong_angles(found: TableFit) -> tuple[TableFit, tuple[int, ...]]:
    """Stop believing the angles of the positions that are far off, one by one.

    One angle that was typed wrong is no error of the table: believed, it turns the instrument's
    axes, and as scatter of the readings it would be shared by all of them.
    """
    geometry = found.estimate.state.geometry
    if not isinstance(geometry, Angles) or geometry.trust.position_sd == 0:
        return found, ()
    for _ in range(1 + len(found.model.readings) // 5):
        worst = _worst_angle(found)
        if worst is None:
            break
        j, alike = worst
        if len(alike):
            return found, tuple(sorted((j, *alike)))
        state = found.estimate.state
        doubted = tuple(sorted((*state.geometry.doubted, j)))
        found = found.solved(replace(state, geometry=replace(state.geometry, doubted=doubted)))
    return found, ()


def angle_tests(found: TableFit) -> Snooping:
    """Test the angles of each position against what the readings say of them.

    `found`: a solution that believes the angles with errors of known size.
    """
    at, geometry = found.fit.white, found.estimate.state.geometry
    first = int(np.sum(at.blocks >= 0)) + len(geometry.used)
    rows = slice(first, first + geometry.position.size)
    number = np.repeat(np.arange(len(geometry.position)), 2)
    alone = Linearised(at.residuals[rows], at.jacobian[rows], number)
    return snoop(alone, found.estimate.state_cov, rows=2)


def _worst_angle(found: TableFit) -> tuple[int, tuple[int, ...]] | None:
    """Return the reading whose angles stand out, and those that would look the same."""
    s, r = angle_tests(found), found.snooping
    seen = np.flatnonzero(s.dof > 0)
    if len(seen) < 2:
        return None
    # A table worse than declared is another matter: one position must stand out from the others.
    usual = max(1.0, float(np.median(s.test[seen] / s.dof[seen])) / MEDIAN)
    alpha = FALSE_ALARM / len(s.blocks)
    limits = np.array([chi_square_limits(d, 2 * alpha)[1] for d in s.dof[seen]])
    score = s.test[seen] / usual / limits
    best = int(np.argmax(score))
    if score[best] <= 1.0:
        return None
    j = int(seen[best])
    own = np.flatnonzero(found.model.rows == j)
    if len(own):
        # Where the specific force has another size than gravity, it is the reading that is wrong.
        rests = found.model.kind < 2
        noise = max(1.0, float(np.median(r.test[rests] / np.maximum(r.dof[rests], 1.0))) / MEDIAN)
        more = float(r.test[own[0]] - s.test[j]) / noise
        if r.dof[own[0]] > s.dof[j] and more > chi_square_limits(1.0, 2 * alpha)[1]:
            return None
    return j, tuple(int(b) for b in s.alike(j))


def _believed_again(found: TableFit) -> TableFit:
    """Believe angles again that are not far off once the scatter of the readings is known."""
    state = found.estimate.state
    g: Angles = state.geometry
    if not g.doubted:
        return found
    first = found.model.options.unknowns.before_geometry + 3 + len(g.used)
    limit = chi_square_limits(2.0, 2 * FALSE_ALARM / len(g.position))[1]
    kept = []
    for j in g.doubted:
        own = slice(first + 2 * j, first + 2 * j + 2)
        cov = found.estimate.state_cov[own, own] + g.trust.position_sd**2 * np.eye(2)
        if g.position[j] @ np.linalg.solve(cov, g.position[j]) > limit:
            kept.append(j)
    if len(kept) == len(g.doubted):
        return found
    return found.solved(replace(state, geometry=replace(g, doubted=tuple(kept))))


MEDIAN = 0.693
"""Median of chi-square with two degrees of freedom over its mean, ln 2 [1]."""


def _without_outliers(found: TableFit) -> tuple[TableFit, tuple[int, ...]]:
    """Take the worst observations out one by one; return those of which one is wrong, if any."""
    for _ in range(1 + len(found.model.readings) // 5):
        worst = _worst(found)
        if worst is None:
            break
        alike = found.snooping.alike(worst)
        if len(alike):
            return found, tuple(sorted(int(b) for b in found.model.rows[[worst, *alike]]))
        weights = found.estimate.weights.copy()
        weights[worst] = gauss_newton.LEFT_OUT
        found = found.solved(weights=weights)
    return found, ()


def _worst(found: TableFit) -> int | None:
    """Return the row of the observation that is significantly worse than the others of its kind.

    Where one kind fits badly as a whole, only it is looked at: it shows in the others too.
    """
    from scipy.special import fdtri

    s, after = found.snooping, found.fit.after
    kept = found.estimate.weights > 0.5
    score = np.zeros(len(s.blocks))
    bad = [name for name, c in after.items() if c.chi_square > c.high]
    worst_kind = max(bad, key=lambda name: after[name].ratio) if bad else None
    for k, name in enumerate(KINDS[:4]):
        mine = np.flatnonzero((found.model.kind == k) & kept & (s.dof > 0))
        parts = {*KINDS[3:]} if k == 3 else {name}
        if not len(mine) or (worst_kind is not None and worst_kind not in parts):
            continue
        components = [after[part] for part in parts if part in after]
        # What the others say, of all their residuals and of each kind: one kind may be far worse.
        others, left = np.ones(len(mine)), np.zeros(len(mine))
        whole = [sum(c.chi_square for c in components), sum(c.redundancy for c in components)]
        for square, redundancy in (*((c.chi_square, c.redundancy) for c in components), whole):
            left = np.maximum(redundancy - s.dof[mine], 0.0)
            rest = np.maximum(square - s.test[mine], 0.0) / np.maximum(left, 0.5)
            others = np.where(left > 0.5, np.maximum(others, rest), others)
        # Noise may be too small for all, above all where it was measured; one reading must stand
        # out from the others then. Where it fits them, it is the better yardstick.
        top = np.array([chi_square_limits(max(n, 1e-3))[1] for n in left])
        too_small = (others > 1.0) & ((not found.model.readings.declared) | (others * left > top))
        common = np.where(too_small, others, 1.0)
        alpha = FALSE_ALARM / len(s.blocks)
        known = np.array([chi_square_limits(d, 2 * alpha)[1] for d in s.dof[mine]])
        pairs = zip(s.dof[mine], left, strict=True)
        fitted = np.array([d * float(fdtri(d, max(n, 1.0), 1 - alpha)) for d, n in pairs])
        limit = np.where(too_small, fitted, known)
        score[mine] = s.test[mine] / common / limit
    worst = int(np.argmax(score))
    return worst if score[worst] > 1.0 else None
