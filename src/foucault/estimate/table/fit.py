"""Fit readings on a table: outliers left out, unexplained scatter estimated.

A wrong reading is looked for by data snooping, because with few redundant readings it spreads over
the residuals of all. Where several readings would look alike none is left out, and the result
says so. Scatter beyond the noise is one more variance for each group of readings.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Status
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits, student
from foucault.estimate.snooping import Snooping, snoop
from foucault.estimate.table.likelihood import Observed, build
from foucault.infer.mixed import Component
from foucault.models.earth import Site
from foucault.models.readings import Readings
from foucault.models.table_geometry import Angles
from foucault.models.table_state import State, Unknowns
from foucault.result import Estimate, Linearised, Problem

KINDS = ("accel at rest", "accel in spins", "gyro at rest", "gyro in spins", "rate of spins")
"""The kinds of residual; in spins the rate along the axis, which is the table's, stands alone."""

ACROSS, ALONG = 3, 4

GROUPS = {
    "accel at rest": "accel",
    "accel in spins": "accel",
    "gyro at rest": "gyro at rest",
    "gyro in spins": "gyro in spins",
    "rate of spins": "rate of spins",
}
"""Kind of reading -> what has one scatter. Errors of the table act on gyros in proportion to the
rate, on accelerometers alike at rest and in spins; one variance each for their rests and spins
would let that with less redundancy shrink to nothing and take the solution with it."""

ENOUGH = 8.0
"""With fewer degrees of freedom scatter is added only where it is significant [1]."""


@dataclass(frozen=True)
class Options:
    """How to fit."""

    names: tuple[str, ...]
    # lever_arm, level, offset: whether these are unknown, see `table_state.State`
    lever_arm: bool
    level: bool
    offset: bool = False
    prior: CoefficientVector | None = None  # Gaussian prior on the coefficients
    rate_sd: float = 0.0  # relative sd of the rate from one spin to the next [1]
    robust: bool = True
    repeatability: bool = True  # estimate scatter that the noise does not explain
    gyro_at_rest: bool = False  # look at the rates at rest even where the heading is unknown


@dataclass(frozen=True)
class TableFit:
    """A solution and how well it fits."""

    options: Options  # how it was fitted
    observed: Observed  # readings with the covariance that was used, scatter included [SI]
    problem: Problem  # the problem that was solved
    estimate: Estimate
    at: Linearised  # the problem linearised there, with full weights
    # before, after: fit of each kind of reading by the noise alone, and with the scatter
    before: dict[str, Component]
    after: dict[str, Component]
    snooping: Snooping  # tests of the readings at the solution, outliers left out
    # sd that was added to each of `GROUPS`, per axis [SI]; of the rate of spins relative [1]
    scatter: dict[str, float] = field(default_factory=dict)
    # (k,) readings that were left out: j for the specific force of reading j, n + j for its rate
    outliers: tuple[int, ...] = ()
    # (k,) readings of which one is wrong, but it cannot be told which
    suspects: tuple[int, ...] = ()
    # (k,) readings whose table angles were not believed, because they are far off
    wrong_angles: tuple[int, ...] = ()
    # (k,) readings of which the angles of one are wrong, but it cannot be told which
    angle_suspects: tuple[int, ...] = ()

    @property
    def first_of_geometry(self) -> int:
        """Column of the first unknown of the geometry [1]."""
        o = self.options
        return Unknowns(o.names, o.lever_arm, o.level, o.offset).before_geometry


def kinds_of(readings: Readings, blocks: IntArray) -> IntArray:
    """Return the index in `KINDS` of each observation, shape (k,); -1 for a prior.

    `blocks` (k,): numbers of observations, see `likelihood.build`.
    """
    n = len(readings)
    spin = readings.spin[blocks % n].astype(int)
    return np.where(blocks < 0, -1, 2 * (blocks >= n) + spin)


def fit(readings: Readings, site: Site, start: State, options: Options) -> TableFit:
    """Estimate the coefficients, the outliers, and the scatter that the noise leaves unexplained.

    `readings`: means with the covariance of their noise [SI]; `start`: where to start, its
    geometry says what is believed of the table; `options`: how to fit. A prior comes last, when
    outliers and scatter are settled: they would take up what contradicts it.
    """
    found = _fit(readings, site, start, replace(options, prior=None))
    if options.prior is None:
        return found
    if found.estimate.status is Status.UNOBSERVABLE:  # nothing can be said without it
        return _fit(readings, site, start, options)
    problem = replace(found.problem, prior=options.prior)
    estimate = gauss_newton.add_prior(problem, found.estimate)
    at = problem.linearise(estimate.state, estimate.weights)
    return replace(
        found, options=options, problem=problem, estimate=estimate, at=at,
        snooping=snoop(at, estimate.state_cov),
    )  # fmt: skip


def _fit(readings: Readings, site: Site, start: State, options: Options) -> TableFit:
    """Estimate the coefficients, the outliers, and the scatter, all at once."""
    observed = Observed.of(
        readings, site, start, rate_sd=options.rate_sd, gyro_at_rest=options.gyro_at_rest
    )
    weights = np.ones(2 * len(readings))
    found = _solve(observed, start, options, weights)
    before = found.after
    suspects: tuple[int, ...] = ()
    angles: tuple[int, ...] = ()
    for _ in range(2):  # outliers make scatter, and scatter makes outliers: look twice for each
        if options.robust:
            found, alike_angles = _without_wrong_angles(found, options, weights)
            angles = angles or alike_angles
            found, alike = _without_outliers(found, options, weights)
            suspects = suspects or alike
            before = before if found.scatter else found.after
        grown = _with_scatter(found, options, weights) if options.repeatability else found
        if grown is found:
            break
        found = grown
    if isinstance(found.estimate.state.geometry, Angles):
        found = _believed_again(found, options, weights)
    if readings.noise_unknown and found.scatter:
        found = _as_student(found, options, weights)
    left = np.flatnonzero(weights < 0.5)
    geometry = found.estimate.state.geometry
    return replace(
        found, before=before, outliers=tuple(int(b) for b in left), suspects=suspects,
        wrong_angles=geometry.doubted if isinstance(geometry, Angles) else (),
        angle_suspects=angles,
    )  # fmt: skip


def _without_wrong_angles(
    found: TableFit, options: Options, weights: FloatArray
) -> tuple[TableFit, tuple[int, ...]]:
    """Stop believing the angles of the positions that are far off, one by one.

    One angle that was typed wrong is no error of the table: believed, it turns the instrument's
    axes, and as scatter of the readings it would be shared by all of them.
    """
    geometry, scatter = found.estimate.state.geometry, found.scatter
    if not isinstance(geometry, Angles) or geometry.trust.position_sd == 0:
        return found, ()
    for _ in range(1 + len(found.observed.readings) // 5):
        worst = _worst_angle(found)
        if worst is None:
            break
        j, alike = worst
        if len(alike):
            return found, tuple(sorted((j, *alike)))
        state = found.estimate.state
        doubted = tuple(sorted((*state.geometry.doubted, j)))
        state = replace(state, geometry=replace(state.geometry, doubted=doubted))
        found = replace(_solve(found.observed, state, options, weights), scatter=scatter)
    return found, ()


def angle_tests(found: TableFit) -> Snooping:
    """Test the angles of each position against what the readings say of them.

    `found`: a solution that believes the angles with errors of known size.
    """
    at, geometry = found.at, found.estimate.state.geometry
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
    own = np.flatnonzero(r.blocks == j)
    if len(own):
        # Where the specific force has another size than gravity, it is the reading that is wrong.
        rests = r.blocks < len(s.blocks)
        noise = max(1.0, float(np.median(r.test[rests] / np.maximum(r.dof[rests], 1.0))) / MEDIAN)
        more = float(r.test[own[0]] - s.test[j]) / noise
        if r.dof[own[0]] > s.dof[j] and more > chi_square_limits(1.0, 2 * alpha)[1]:
            return None
    return j, tuple(int(b) for b in s.alike(j))


def _believed_again(found: TableFit, options: Options, weights: FloatArray) -> TableFit:
    """Believe angles again that are not far off once the scatter of the readings is known."""
    state = found.estimate.state
    g: Angles = state.geometry
    if not g.doubted:
        return found
    first = found.first_of_geometry + 3 + len(g.used)
    limit = chi_square_limits(2.0, 2 * FALSE_ALARM / len(g.position))[1]
    kept = []
    for j in g.doubted:
        own = slice(first + 2 * j, first + 2 * j + 2)
        cov = found.estimate.state_cov[own, own] + g.trust.position_sd**2 * np.eye(2)
        if g.position[j] @ np.linalg.solve(cov, g.position[j]) > limit:
            kept.append(j)
    if len(kept) == len(g.doubted):
        return found
    state = replace(state, geometry=replace(g, doubted=tuple(kept)))
    return replace(_solve(found.observed, state, options, weights), scatter=found.scatter)


MEDIAN = 0.693
"""Median of chi-square with two degrees of freedom over its mean, ln 2 [1]."""


def _without_outliers(
    found: TableFit, options: Options, weights: FloatArray
) -> tuple[TableFit, tuple[int, ...]]:
    """Take the worst readings out one by one; `weights` remembers them."""
    scatter = found.scatter
    for _ in range(1 + len(found.observed.readings) // 5):
        worst = _worst(found, found.observed.readings)
        if worst is None:
            break
        alike = found.snooping.alike(worst)
        block = int(found.snooping.blocks[worst])
        if len(alike):
            return found, tuple(sorted((block, *(int(b) for b in alike))))
        weights[block] = gauss_newton.LEFT_OUT
        found = _solve(found.observed, found.estimate.state, options, weights)
        found = replace(found, scatter=scatter)
    return found, ()


def _solve(observed: Observed, start: State, options: Options, weights: FloatArray) -> TableFit:
    problem = build(
        observed, options.names, start, lever_arm=options.lever_arm, level=options.level,
        offset=options.offset, prior=options.prior,
    )  # fmt: skip
    estimate = gauss_newton.solve(problem, loss=partial(_held, weights), weights=weights)
    # The test of a reading that was left out is that of a prediction: it keeps its tiny weight.
    at = problem.linearise(estimate.state, estimate.weights)
    components = _components(estimate, observed.readings)
    return TableFit(
        options, observed, problem, estimate, at, components, components,
        snooping=snoop(at, estimate.state_cov),
    )  # fmt: skip


def _held(weights: FloatArray, norms: FloatArray) -> FloatArray:
    """A loss whose weights are settled."""
    return weights


def _components(estimate: Estimate, readings: Readings) -> dict[str, Component]:
    """Split the sum of squares by kind of reading, readings left out not counted."""
    kind = kinds_of(readings, estimate.blocks)
    used = estimate.blocks >= 0
    first = np.zeros(len(kind), bool)
    first[np.flatnonzero(used)[::3]] = True  # three rows per observation
    kind[first & (kind == ACROSS)] = ALONG
    kept = used & (estimate.weights[estimate.blocks] > 0.5)
    present = [k for k in range(len(KINDS)) if np.any((kind == k) & kept)]
    out = {}
    for k in present:
        mine = (kind == k) & kept
        redundancy = float(np.sum(1 - estimate.leverage[mine]))
        low, high = chi_square_limits(max(redundancy, 1e-3), tests=len(present))
        out[KINDS[k]] = Component(
            float(np.sum(estimate.residuals[mine] ** 2)), redundancy, low, high
        )
    return out


def _worst(found: TableFit, readings: Readings) -> int | None:
    """Return the row of the reading that is significantly worse than the others of its kind.

    Where one kind fits badly as a whole, only it is looked at: it shows in the others too.
    """
    from scipy.special import fdtri

    s = found.snooping
    kind = kinds_of(readings, s.blocks)
    kept = found.estimate.weights[s.blocks] > 0.5
    score = np.zeros(len(s.blocks))
    bad = [name for name, c in found.after.items() if c.chi_square > c.high]
    worst_kind = max(bad, key=lambda name: found.after[name].ratio) if bad else None
    for k, name in enumerate(KINDS[:ALONG]):
        mine = np.flatnonzero((kind == k) & kept & (s.dof > 0))
        parts = {name, KINDS[ALONG]} if k == ACROSS else {name}
        if not len(mine) or (worst_kind is not None and worst_kind not in parts):
            continue
        components = [found.after[part] for part in parts if part in found.after]
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
        too_small = (others > 1.0) & ((not readings.declared) | (others * left > top))
        common = np.where(too_small, others, 1.0)
        alpha = FALSE_ALARM / len(s.blocks)
        known = np.array([chi_square_limits(d, 2 * alpha)[1] for d in s.dof[mine]])
        pairs = zip(s.dof[mine], left, strict=True)
        fitted = np.array([d * float(fdtri(d, max(n, 1.0), 1 - alpha)) for d, n in pairs])
        limit = np.where(too_small, fitted, known)
        score[mine] = s.test[mine] / common / limit
    worst = int(np.argmax(score))
    return worst if score[worst] > 1.0 else None


def _with_scatter(found: TableFit, options: Options, weights: FloatArray) -> TableFit:
    """Add variance to each group of readings until its residuals fit."""
    r, now = found.observed.readings, group_components(found.after)
    growing = [
        group
        for group, c in now.items()
        if c.chi_square > c.high or (not r.declared and c.redundancy >= ENOUGH and c.ratio > 1)
    ]
    if not growing:
        return found
    # Later rounds add to what is there already.
    base = inflated(found.observed, found.scatter, sign=-1.0)
    scatter = dict.fromkeys(growing, 0.0) | found.scatter
    for _ in range(20):
        scatter = {k: _grown(base, k, v, now[k]) for k, v in sorted(scatter.items())}
        found = _solve(inflated(base, scatter), found.estimate.state, options, weights)
        now = group_components(found.after)
        if all(abs(now[k].ratio - 1) < 0.03 or v == 0 for k, v in scatter.items()):
            break
    return replace(found, scatter={k: v for k, v in scatter.items() if v > 0})


def _as_student(found: TableFit, options: Options, weights: FloatArray) -> TableFit:
    """Widen noise that only the residuals tell to the variance of Student's distribution."""
    parts = group_components(found.after)
    base = inflated(found.observed, found.scatter, sign=-1.0)
    wider = {g: sd * student(parts[g].redundancy) for g, sd in found.scatter.items()}
    again = _solve(inflated(base, wider), found.estimate.state, options, weights)
    return replace(again, scatter=found.scatter, after=found.after)


def group_components(kinds: dict[str, Component]) -> dict[str, Component]:
    """Join the kinds of reading that have one scatter."""
    names = list(dict.fromkeys(GROUPS[kind] for kind in kinds))
    out = {}
    for group in names:
        mine = [c for kind, c in kinds.items() if GROUPS[kind] == group]
        redundancy = sum(c.redundancy for c in mine)
        low, high = chi_square_limits(max(redundancy, 1e-3), tests=len(names))
        out[group] = Component(sum(c.chi_square for c in mine), redundancy, low, high)
    return out


def _members(readings: Readings, group: str) -> npt.NDArray[np.bool_]:
    """Tell which readings are of a group."""
    if group == "accel":
        return np.ones(len(readings), bool)
    return np.asarray(readings.spin == (group != "gyro at rest"))


def _grown(base: Observed, group: str, scatter: float, c: Component) -> float:
    """Scale the total variance by its ratio and give the increase to the scatter."""
    cov = base.accel_cov if group == "accel" else base.gyro_cov
    mine = _members(base.readings, group)
    white = np.trace(cov[mine], axis1=1, axis2=2) / 3
    if group == "rate of spins":
        w = base.readings.gyro[mine]  # type: ignore[index]
        white = np.einsum("ni,nij,nj->n", w, cov[mine], w) / np.sum(w**2, axis=1) ** 2
    usual = float(np.median(white))
    return float(np.sqrt(max((scatter**2 + usual) * c.ratio - usual, 0.0)))


def inflated(observed: Observed, scatter: dict[str, float], sign: float = 1.0) -> Observed:
    """Return the same readings with more variance.

    `observed`: readings and their covariance [SI]; `scatter`: group of readings -> sd to add, per
    axis [SI], that of the rate of spins is relative; `sign`: -1 takes it away again [1].
    """
    accel, gyro = observed.accel_cov.copy(), observed.gyro_cov.copy()
    for group, sd in scatter.items():
        cov = accel if group == "accel" else gyro
        mine = _members(observed.readings, group)
        added = np.broadcast_to(np.eye(3), cov[mine].shape)
        if group == "rate of spins":
            w = observed.readings.gyro[mine]  # type: ignore[index]
            added = w[:, :, None] * w[:, None, :]
        cov[mine] += sign * sd**2 * added
    return replace(observed, accel_cov=accel, gyro_cov=gyro)
