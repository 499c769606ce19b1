"""Several IMUs on one rigid body: what ties them together, and their errors against the first.

The motion of the body is a cubic B-spline of rate and specific force at the accelerometers of the
first IMU, the master; all readings, its own too, are of that motion with noise, as in
`kernels.two_imus`. Pairwise regression would pull lever arms to zero, for the master's noise is in
its regressors.

A pass is linear about spline and parameters. The spline is eliminated from the normal equations, a
band with a border; what is left is the information of the parameters, less what noise makes by
itself (`infer.shown`). Several slaves share one spline, so that what they have in common through
the master's noise is in the covariance.

Errors are those against the master: a bias of both is not seen, nor a scale factor of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.estimate import two_bodies as bodies
from foucault.estimate.two_bodies import COLOURED, MOVED, ROUND, SETTLED, Answers, Change
from foucault.infer.gauss_newton import student
from foucault.infer.shown import Shown, shown
from foucault.kernels import banded
from foucault.kernels import two_imus as kernels
from foucault.models.rotation import exp, right_jacobian_inverse
from foucault.models.rotation import log as vector_of
from foucault.models.two_imus import ORDINALS, layout_of
from foucault.tables import Log, evened

USUAL = {
    "rotation": np.pi / np.sqrt(3), "lever": 0.3, "delay": 0.2, "clock": 0.01, "gyro.bias": 0.2,
    "accel.bias": 2.0, "gyro.scale": 0.03, "gyro.misalignment": 0.03, "accel.scale": 0.03,
    "accel.misalignment": 0.03, "accel.delay": 0.01, "gyro.g_sensitivity": 1e-3,
}  # fmt: skip
"""Standard deviations where nothing else is said, of offset and rotation about the start [SI]."""

GROWN = 0.02  # Logarithm of a variance by which it grows no more [1].

NOISY = 4
"""Pass in which what the motion shows is told from what its noise does, before all settles."""

QUIET, ABOUT = 2, 0.3
"""Passes in which noise grows by no more than that of differences of readings may be off, in its
logarithm: what a start leaves is none, and looks like one in which nothing is seen [1]."""

PROBES = 4  # Draws of signs that tell what the spline takes of readings [1].

NEAR = 0.1  # Steps since that was told that do not change it, together [sd].

FEWEST = 1e-9
"""Information of a knot that no reading tells of, as a part of that of the others [1]."""


BEND = 4
"""So many rows to either side tell how a rate bends: more miss it, fewer add noise [1]."""


@dataclass(frozen=True)
class Readings:
    """What one IMU read."""

    time: FloatArray  # (n,) by its own clock [s]
    middle: float  # of all its stamps [s]
    read: FloatArray  # (n, 6) rate [rad/s], specific force [m/s^2]

    @classmethod
    def of(cls, log: Log) -> Readings:
        """Take a log; means over intervals become what was there in their middle."""
        assert log.gyro is not None and log.accel is not None
        stamp, back = evened(log.time), 0.0
        read = np.ascontiguousarray(np.column_stack([log.gyro, log.accel]))
        if log.sampled == "increment":
            back, s = 0.5 * log.interval, BEND
            slope = (read[s:] - read[:-s]) / (stamp[s:] - stamp[:-s])[:, None]
            long = np.maximum(stamp[2 * s :] - stamp[: -2 * s], 2 * s * log.interval)[:, None]
            # The mean is the value in the middle and h^2 / 24 times its second derivative.
            read[s:-s] -= log.interval**2 / 12 * (slope[s:] - slope[:-s]) / long
        return cls(stamp - back, float(stamp[0] + stamp[-1]) / 2, read)


@dataclass(frozen=True)
class Slave:
    """Parameters of one slave."""

    C_cb: FloatArray  # (3, 3) axes of the master to its own [1]
    lever_b: FloatArray  # (3,) from the master's accelerometers to its own [m]
    tau: float  # what is added to its stamps [s]
    kappa: float  # by how much the master's clock is faster [1]
    # gyro, accel: bias (3,) [rad/s], [m/s^2] and I + S + M (3, 3), that of accel lower [1]
    gyro: tuple[FloatArray, FloatArray]
    accel: tuple[FloatArray, FloatArray]
    late: float  # its accelerometers, after its gyros [s]
    by_force: FloatArray  # (3, 3) g-sensitivity of its gyros [rad/s per m/s^2]

    @classmethod
    def started(cls, C_cb: FloatArray, lever_b: FloatArray, tau: float, kappa: float) -> Slave:
        """Return one without errors of its own.

        `C_cb` (3, 3) [1], `lever_b` (3,) [m], `tau` [s], `kappa` [1]: as its attributes.
        """
        zero, one = np.zeros(3), np.eye(3)
        return cls(C_cb, lever_b, tau, kappa, (zero, one), (zero, one), 0.0, np.zeros((3, 3)))

    @property
    def flat(self) -> FloatArray:
        """As `kernels.two_imus` takes them, shape (46,)."""
        return np.concatenate([
            self.C_cb.ravel(), self.gyro[1].ravel(), self.by_force.ravel(), self.accel[1].ravel(),
            self.lever_b, self.gyro[0], self.accel[0], [self.late],
        ])  # fmt: skip

    @property
    def values(self) -> FloatArray:
        """In the order of the columns, shape (39,) [SI]."""
        one = np.eye(3)
        return np.concatenate([
            vector_of(self.C_cb), self.lever_b, [self.tau, self.kappa], self.gyro[0], self.accel[0],
            (self.gyro[1] - one).ravel(), (self.accel[1] - one)[np.tril_indices(3)], [self.late],
            self.by_force.ravel(),
        ])  # fmt: skip

    def moved(self, d: FloatArray) -> Slave:
        """Return the slave a step `d` (39,) away [SI]."""
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = d[23:29]
        return Slave(
            exp(d[:3]) @ self.C_cb, self.lever_b + d[3:6], self.tau + d[6], self.kappa + d[7],
            (self.gyro[0] + d[8:11], self.gyro[1] + d[14:23].reshape(3, 3)),
            (self.accel[0] + d[11:14], self.accel[1] + lower), self.late + d[29],
            self.by_force + d[30:39].reshape(3, 3),
        )  # fmt: skip

    def at(self, r: Readings) -> FloatArray:
        """Return the stamps of a slave by the clock of the master, shape (n,) [s]."""
        return np.asarray(r.time + self.tau + self.kappa * (r.time - r.middle))


@dataclass(frozen=True)
class Problem:
    """Readings of all, and what is known of their noise."""

    readings: tuple[Readings, ...]  # the master first
    knot: float  # between two knots [s]
    first: float  # time of the first knot's interval, clock of the master [s]
    knots: int  # [1]
    given: tuple[tuple[float, float] | None, ...]  # sd of a gyro and accelerometer reading [SI]
    prior_sd: FloatArray  # (p,) [SI]
    mean: FloatArray  # (p,) known beforehand, or the start [SI]
    hold: IntArray  # (k,) numbers of columns that are not estimated [1]

    def noisy(self, var: FloatArray, rng: np.random.Generator) -> Problem:
        """Return the same with its noise once more, `var` (i, 2) [SI]."""
        made = [
            replace(r, read=r.read + np.repeat(np.sqrt(v), 3) * rng.standard_normal(r.read.shape))
            for r, v in zip(self.readings, var, strict=True)
        ]
        return replace(self, readings=tuple(made))


@dataclass(frozen=True)
class Normal:
    """The normal equations of a pass, the spline eliminated."""

    L: FloatArray  # (6 m, 24) Cholesky factor of the spline's part, column by column
    W: FloatArray  # (6 m, p + 1) columns of the parameters, and what is left, divided by it
    information: FloatArray  # (p, p) [1 / SI^2]
    gradient: FloatArray  # (p,) before the spline is eliminated [1 / SI]
    score: FloatArray  # (p,) [1 / SI]
    left: tuple[FloatArray, ...]  # (n, 6) readings less what they should be, NaN beyond [SI]

    def moved(self, delta: FloatArray) -> FloatArray:
        """Return what the spline moves by beside a step `delta` (p,) of parameters, (m, 6) [SI]."""
        out = np.ascontiguousarray((self.W[:, -1] - self.W[:, :-1] @ delta)[:, None])
        banded.backward(self.L, out)
        return out.reshape(-1, 6)


def normal(
    problem: Problem, slaves: Sequence[Slave], spline: FloatArray, var: FloatArray,
    other: FloatArray | None = None, still: bool = False,
) -> Normal:  # fmt: skip
    """Linearise about slaves and `spline` (m, 6) [SI]; `var` (i, 2): of readings [SI].

    `other` (m, 6) or None: columns are those at this spline less those here [SI]; `still`: only the
    spline moves.
    """
    from scipy.linalg import cholesky_banded

    n, p = 6 * problem.knots, 0 if still else kernels.COLUMNS * len(slaves)
    band, border = np.zeros((n, 24)), np.zeros((n, p + 1))
    corner, rhs, left = np.zeros((p, p)), np.zeros(p), []
    if other is None:
        other = np.zeros((0, 6))
    for k, r in enumerate(problem.readings):
        one = None if k == 0 else slaves[k - 1]
        time, x = (r.time, np.zeros(46)) if one is None else (one.at(r), one.flat)
        off = np.empty_like(r.read)
        own = kernels.COLUMNS * (k - 1) if k else -1
        kernels.normal(
            time, r.time - r.middle, r.read, var[k], x, own, spline, other, problem.first,
            problem.knot, band, border, corner, rhs, off,
        )  # fmt: skip
        left.append(off)
    band[:, 0] += FEWEST * band[:, 0].max()
    hold = problem.hold[problem.hold < p]
    border[:, hold] = corner[hold] = corner[:, hold] = rhs[hold] = 0.0
    L = cholesky_banded(band.T, overwrite_ab=True, lower=True, check_finite=False).T
    banded.forward(L, border)
    corner = np.tril(corner) + np.tril(corner, -1).T
    pull = border[:, :p].T @ border
    return Normal(L, border, corner - pull[:, :p], rhs, rhs - pull[:, p], tuple(left))


class Blocks(NamedTuple):
    """What blocks of time say of the parameters, the spline eliminated."""

    begin: FloatArray  # (b,) clock of the master [s]
    scores: FloatArray  # (b, p) [1 / SI]
    information: FloatArray  # (b, p, p) [1 / SI^2]


@dataclass(frozen=True)
class Solution:
    """What was found."""

    problem: Problem
    slaves: tuple[Slave, ...]
    spline: FloatArray  # (m, 6) [rad/s], [m/s^2]
    made: FloatArray  # (p, p) information that noise makes by itself [1 / SI^2]
    var: FloatArray  # (i, 2) variance of a reading of gyros and accelerometers [SI]
    ratio: FloatArray  # (i, 2) mean square of what is left over that, each reading counted once [1]
    cov: FloatArray  # (p, p) as it is stated [SI]
    formal: FloatArray  # (p, p) as if what is left were white [SI]
    spread: float  # by how much scores scatter more than white rows, as an sd [1]
    halves: float  # rms of the difference of the halves over its sd [1]
    lag_one: FloatArray  # (i, 2) correlation of what is left with the next [1]
    left: tuple[FloatArray, ...]  # (n, 6) of each [SI]
    blocks: Blocks
    passes: int  # [1]
    converged: bool

    @property
    def values(self) -> FloatArray:
        """Parameters, shape (p,) [SI]."""
        return np.concatenate([s.values for s in self.slaves])

    @property
    def unseen(self) -> BoolArray:
        """Parameters that the motion does not show: as uncertain as they were, (p,)."""
        lost = np.sqrt(np.diag(self.cov)) > 0.5 * self.problem.prior_sd
        lost[self.problem.hold] = False
        return np.asarray(lost)


def problem_of(
    readings: Sequence[Readings], start: Sequence[Slave], known: Mapping[str, tuple[float, float]],
    given: Sequence[tuple[float, float] | None], knot: float, held: Sequence[str],
) -> Problem:  # fmt: skip
    """State a problem.

    `known`: mean and sd of parameters beforehand, by name [SI]; `given`: sd of a gyro and an
    accelerometer reading of each, None where it is found [SI]; `knot`: between two [s]; `held`:
    endings and groups of names that are not estimated.
    """
    layout = layout_of(len(start))
    mean = np.concatenate([s.values for s in start])
    sd = np.zeros(len(mean))
    for i, name in enumerate(layout.names):
        bare = name.split(".", 1)[1] if name.startswith(ORDINALS) else name
        group = bare.rpartition(".")[0] if bare not in USUAL else bare
        sd[i] = USUAL[group]
        if group not in ("rotation", "delay", "clock"):
            mean[i] = 0.0
        for key, (value, spread) in known.items():
            if name == key or name.startswith(key + "."):
                mean[i], sd[i] = value, spread
    hold = np.array([i for i, n in enumerate(layout.names) if n.endswith(tuple(held))], int)
    hold = np.union1d(hold, [i for i, n in enumerate(layout.names)
                             if any(f"{key}." in n for key in held)]).astype(int)  # fmt: skip
    first = float(readings[0].time[0])
    knots = int(np.ceil((readings[0].time[-1] - first) / knot)) + 4
    return Problem(tuple(readings), knot, first, knots, tuple(given), sd, mean, hold)


def solve(problem: Problem, start: Sequence[Slave], most: int = 12) -> Solution:
    """Pass by pass, from a start; at `most` so many [1]."""
    slaves, p = tuple(start), kernels.COLUMNS * len(start)
    var = np.array([_quiet(r) ** 2 if g is None else np.square(g)
                    for r, g in zip(problem.readings, problem.given, strict=True)])  # fmt: skip
    spline = np.zeros((problem.knots, 6))
    spline += normal(
        replace(problem, readings=problem.readings[:1]), (), spline, var, still=True
    ).moved(np.zeros(0))
    made, converged, passes = np.zeros((p, p)), False, 0
    growth, since = np.zeros_like(var), np.inf
    for passes in range(1, most + 1):
        at = normal(problem, slaves, spline, var)
        ask, values = passes == NOISY, np.concatenate([s.values for s in slaves])
        off = np.linalg.solve(_of_values(slaves), problem.mean - values)
        while True:
            if ask:
                made, since = of_noise(problem, slaves, spline, var), 0.0
            seen = shown(at.information, made, problem.prior_sd)
            delta = seen.step(at.score, off, problem.prior_sd)
            delta[problem.hold] = 0.0
            sd = np.sqrt(np.diag(seen.covariance(problem.prior_sd)))
            moved = float(np.max(np.abs(delta) / sd))
            converged = passes > 2 and moved < SETTLED and float(np.abs(growth).max()) < GROWN
            # What the motion shows is asked once more where all has settled.
            if not (ask := converged and since >= NEAR):
                break
        if converged:
            break
        since += moved
        # The logarithm by which variances have to grow that nobody declared.
        asked = np.log(np.maximum(_ratio(problem, slaves, spline, var, at), 1e-12))
        asked[[g is not None for g in problem.given]] = 0.0
        size = max(1.0, float(np.abs(delta).max(initial=0.0, where=_is_offset(p))) / 0.05)
        spline = spline + at.moved(delta) / size
        parts = (delta / size).reshape(len(slaves), -1)
        slaves = tuple(s.moved(d) for s, d in zip(slaves, parts, strict=True))
        before, growth = growth, np.asarray(asked)
        if passes <= QUIET:
            growth = np.minimum(growth, ABOUT)
        # Every other pass as far as two of them tell of all that follow [Aitken]: of equal
        # instruments one gets what the other loses, and the better one settles slowly.
        ratio = np.divide(growth, before, out=np.zeros_like(growth), where=before != 0)
        part = np.clip(1 / (1 - np.minimum(ratio, 0.7)), 0.3, 3)
        var = var * np.exp(growth * (part if passes > NOISY and passes % 2 else 1.0))
    else:
        at = normal(problem, slaves, spline, var)
    return _stated(problem, slaves, spline, made, var, at, passes, converged)


def _is_offset(p: int) -> BoolArray:
    out = np.zeros(p, bool)
    out[6 :: kernels.COLUMNS] = True
    return out


def _quiet(r: Readings) -> FloatArray:
    """Return the noise of a reading of gyros and accelerometers, by its fourth differences [SI].

    Second ones of a quiet instrument are those of the motion.
    """
    bend = np.diff(r.read, 4, axis=0)
    square = np.median(bend.reshape(-1, 2, 3) ** 2, axis=(0, 2)) / 0.4549 / 70
    return np.asarray(np.sqrt(square + 1e-18))


def _ratio(
    problem: Problem, slaves: Sequence[Slave], spline: FloatArray, var: FloatArray, at: Normal
) -> FloatArray:
    """Return the mean square of what is left over its variance, without the spline's (i, 2).

    What the spline takes of readings is the trace of their leverage, by signs that are drawn: it
    follows the noise of one that is alone, and forces tell of rates too.
    """
    rng, out = np.random.default_rng(0), np.zeros_like(var)
    for k, left in enumerate(at.left):
        there, sd = np.isfinite(left), np.repeat(np.sqrt(var[k]), 3)
        signs = np.where(there[:, :, None], rng.choice([-1.0, 1.0], (*left.shape, PROBES)), np.nan)
        for triad in range(2):
            own = slice(3 * triad, 3 * triad + 3)
            off = np.zeros_like(signs)
            off[:, own] = signs[:, own] * sd[own, None]
            y = np.zeros((6 * problem.knots, PROBES))
            _pulled(problem, slaves, spline, var, k, slice(None), off, y,
                    np.zeros((len(problem.prior_sd), PROBES)))  # fmt: skip
            banded.forward(at.L, y)
            free = there[:, own].sum() - np.sum(y**2) / PROBES
            out[k, triad] = np.nansum(left[:, own] ** 2) / var[k, triad] / max(free, 1.0)
    return out


def _of_values(slaves: Sequence[Slave]) -> FloatArray:
    """Return the derivative of values by a step, (p, p): rotations are moved on the left."""
    out = np.eye(kernels.COLUMNS * len(slaves))
    for k, s in enumerate(slaves):
        own = slice(kernels.COLUMNS * k, kernels.COLUMNS * k + 3)
        out[own, own] = right_jacobian_inverse(-vector_of(s.C_cb))
    return out


def of_noise(
    problem: Problem, slaves: Sequence[Slave], spline: FloatArray, var: FloatArray
) -> FloatArray:
    """Return the information that noise makes by itself, (p, p): see `infer.shown` [1 / SI^2].

    `spline` (m, 6), `var` (i, 2): as of `normal` [SI].
    """
    again = problem.noisy(var, np.random.default_rng(0))
    other = spline + normal(again, slaves, spline, var, still=True).moved(np.zeros(0))
    found = normal(problem, slaves, spline, var, other).information
    # Not negative but for rounding.
    size, Q = np.linalg.eigh(found * np.outer(problem.prior_sd, problem.prior_sd))
    scale = np.outer(problem.prior_sd, problem.prior_sd)
    return np.asarray((Q * np.maximum(size, 0.0)) @ Q.T / scale)


def _stated(
    problem: Problem, slaves: tuple[Slave, ...], spline: FloatArray, made: FloatArray,
    var: FloatArray, at: Normal, passes: int, converged: bool,
) -> Solution:  # fmt: skip
    seen = shown(at.information, made, problem.prior_sd)
    blocks = _blocks(problem, slaves, spline, var, at)
    scores = bodies.wider(blocks.begin, blocks.scores)
    cov, spread, halves = _widened(seen, scores, problem.prior_sd)
    J = _of_values(slaves)
    lag = np.array([_lag_one(x) for x in at.left])
    cov = _without_circles(J @ cov @ J.T, slaves, problem.prior_sd)
    formal = J @ seen.covariance(problem.prior_sd) @ J.T
    ratio = _ratio(problem, slaves, spline, var, at)
    return Solution(problem, slaves, spline, made, var, ratio, cov, formal, spread, halves, lag,
                    at.left, blocks, passes, converged)  # fmt: skip


def formal(s: Solution, var: FloatArray) -> FloatArray:
    """Return what the covariance would be, were `var` (i, 2) the noise and white [SI]."""
    at = normal(s.problem, s.slaves, s.spline, var)
    J = _of_values(s.slaves)
    P = shown(at.information, s.made, s.problem.prior_sd).covariance(s.problem.prior_sd)
    return np.asarray(J @ P @ J.T)


def changes(s: Solution) -> dict[str, Change]:
    """Return what of the parameters, by their groups, explains most by changing for good."""
    begin, scores, information = s.blocks
    onto = shown(information.sum(axis=0), s.made, s.problem.prior_sd).onto
    groups, J = dict[str, list[int]](), _of_values(s.slaves)
    for i, name in enumerate(layout_of(len(s.slaves)).names):
        if i not in s.problem.hold:
            groups.setdefault(bodies.group_of(name), []).append(i)
    found = bodies.changes(begin, scores @ onto.T, onto @ information @ onto.T, s.problem.prior_sd,
                           groups)  # fmt: skip
    return {name: replace(x, moved=x.moved @ J.T) for name, x in found.items()}


def answers(s: Solution, added: Sequence[FloatArray]) -> Answers:
    """Return what changes of a solution with what is `added` to readings.

    `added`: c times in all, to what each IMU read (n, 6, its own) [SI].
    """
    from scipy.linalg import block_diag

    problem, sd, p = s.problem, s.problem.prior_sd, len(s.problem.prior_sd)
    at = normal(problem, s.slaves, s.spline, s.var)
    seen = shown(at.information, s.made, sd)
    gain = np.linalg.inv(seen.information + np.diag(sd**-2.0)) @ seen.onto
    gain[problem.hold] = gain[:, problem.hold] = 0.0
    scaled, borders, says = [], [], []
    for k, (left, more) in enumerate(zip(at.left, added, strict=True)):
        D = np.where(np.isfinite(left)[:, :, None], more, 0.0)
        border, say = np.zeros((6 * problem.knots, D.shape[2])), np.zeros((p, D.shape[2]))
        _pulled(problem, s.slaves, s.spline, s.var, k, slice(None), D, border, say)
        scaled.append((D / np.repeat(np.sqrt(s.var[k]), 3)[:, None]).reshape(-1, D.shape[2]))
        borders.append(border)
        says.append(say)
    rows = [(np.nan_to_num(x) / np.repeat(np.sqrt(v), 3)).ravel()
            for x, v in zip(at.left, s.var, strict=True)]  # fmt: skip
    y = np.hstack(borders)
    banded.forward(at.L, y)
    score = np.hstack(says) - at.W[:, :p].T @ y
    delta = gain @ score
    both = score.T @ delta
    # The motion and the parameters found again: E = D - J delta, less what the spline makes of it.
    gram = block_diag(*(D.T @ D for D in scaled)) - y.T @ y - both - both.T
    pull = np.concatenate([D.T @ e for D, e in zip(scaled, rows, strict=True)])
    return Answers(
        float(sum(e @ e for e in rows)), pull - y.T @ at.W[:, -1] - delta.T @ at.score,
        gram + delta.T @ at.information @ delta, _of_values(s.slaves) @ delta,
        sum(int(np.count_nonzero(e)) for e in rows) - s.spline.size,
    )  # fmt: skip


def _pulled(
    problem: Problem, slaves: Sequence[Slave], spline: FloatArray, var: FloatArray, k: int,
    some: slice, off: FloatArray, border: FloatArray, rhs: FloatArray,
) -> None:  # fmt: skip
    """Add what `some` readings of the IMU `k` say, `off` (n, 6, c) [SI], as `kernels.pulled`."""
    r, one = problem.readings[k], None if k == 0 else slaves[k - 1]
    time, x = (r.time, np.zeros(46)) if one is None else (one.at(r), one.flat)
    kernels.pulled(time[some], (r.time - r.middle)[some], off, var[k], x,
                   kernels.COLUMNS * (k - 1) if k else -1, spline, problem.first, problem.knot,
                   border, rhs)  # fmt: skip


def _blocks(
    problem: Problem, slaves: Sequence[Slave], spline: FloatArray, var: FloatArray, at: Normal
) -> Blocks:
    """Return what blocks of time say of the parameters, the spline eliminated."""
    p, h, none = len(problem.prior_sd), problem.knot, np.zeros((0, 6))
    begin = np.arange(problem.first, problem.first + h * problem.knots + bodies.SPLIT, bodies.SPLIT)
    scores, information = np.zeros((len(begin), p)), np.zeros((len(begin), p, p))
    Z = np.ascontiguousarray(at.W[:, :p])
    banded.backward(at.L, Z)
    for k, r in enumerate(problem.readings):
        one = None if k == 0 else slaves[k - 1]
        time, x = (r.time, np.zeros(46)) if one is None else (one.at(r), one.flat)
        late, own = abs(one.late) if one else 0.0, kernels.COLUMNS * (k - 1) if k else -1
        edges = [*np.searchsorted(time, begin), len(time)]
        edges[0] = 0
        for b, (i, j) in enumerate(pairwise(edges)):
            if i == j:
                continue
            ends = (time[[i, j - 1]] + [-late, late] - problem.first) / h + [-1.0, 5.0]
            q0, q1 = np.clip(ends, 0, problem.knots).astype(int)
            z, n = Z[6 * q0 : 6 * q1], 6 * (q1 - q0)
            band, border = np.zeros((n, 24)), np.zeros((n, p + 1))
            corner, rhs, left = np.zeros((p, p)), np.zeros(p), np.empty((j - i, 6))
            kernels.normal(
                time[i:j], (r.time - r.middle)[i:j], r.read[i:j], var[k], x, own, spline[q0:q1],
                none, problem.first + h * q0, h, band, border, corner, rhs, left,
            )  # fmt: skip
            scores[b] += rhs - z.T @ border[:, p]
            both = border[:, :p].T @ z
            half = np.tril(corner, -1) + np.diag(np.diag(corner)) / 2 - both
            made = band[:, :1] / 2 * z  # half of the band, by which the other half is known
            for d in range(1, min(24, n)):
                made[d:] += band[:-d, d, None] * z[:-d]
            half += z.T @ made
            information[b] += half + half.T
    hold = problem.hold
    scores[:, hold] = information[:, hold] = information[:, :, hold] = 0.0
    some = np.abs(scores).sum(axis=1) > 0
    return Blocks(begin[some], scores[some], information[some])


def _widened(
    seen: Shown, scores: FloatArray, prior_sd: FloatArray
) -> tuple[FloatArray, float, float]:
    """Return the covariance as scores (blocks, p) have it, their spread, and that of the halves."""
    formal, n = seen.covariance(prior_sd), len(scores)
    gain = np.linalg.inv(seen.information + np.diag(prior_sd**-2.0))
    found = (scores - scores.mean(axis=0)) @ seen.onto.T @ gain.T
    share = 1 - np.diag(formal) / prior_sd**2  # what the prior adds scatters in no score
    told = share > 0.5
    ratio = np.sqrt(np.sum(found**2, axis=0) / (np.diag(formal) * np.maximum(share, 1e-3)))
    spread = float(np.sqrt(np.mean(ratio[told] ** 2))) if told.any() else 1.0
    wide = np.ones(len(prior_sd))
    if spread > COLOURED:
        wide[told] = np.maximum(ratio * student(n - 1), 1.0)[told]
    off = (found[: n // 2].sum(axis=0) - found[n // 2 :].sum(axis=0)) / wide
    own = np.flatnonzero(told)
    halves = 1.0
    if len(own):
        halves = float(
            np.sqrt(off[own] @ np.linalg.solve(formal[np.ix_(own, own)], off[own]) / len(own))
        )
    wide *= halves if halves > MOVED else 1.0
    scaled = formal * np.outer(wide, wide)
    held = np.minimum(1.0, prior_sd / np.sqrt(np.diag(scaled)))  # no more than was known before
    return scaled * np.outer(held, held), spread, halves


def _without_circles(cov: FloatArray, slaves: Sequence[Slave], prior_sd: FloatArray) -> FloatArray:
    """Return the covariance (p, p) with nothing said of a rotation that may be anything."""
    out = cov.copy()
    for k in range(len(slaves)):
        own = slice(kernels.COLUMNS * k, kernels.COLUMNS * k + 3)
        if np.linalg.eigvalsh(cov[own, own])[-1] < ROUND**2:
            continue
        lost = np.arange(own.start, own.stop)[np.sqrt(np.diag(cov[own, own])) > 0.1 * ROUND]
        out[lost] = out[:, lost] = 0.0
        out[lost, lost] = prior_sd[lost] ** 2
    return out


def _lag_one(left: FloatArray) -> FloatArray:
    """Return the correlation of what is left with the next, gyros and accelerometers (2,) [1]."""
    x = np.nan_to_num(left).reshape(-1, 2, 3)
    total = np.sum(x**2, axis=(0, 2))
    return np.asarray(np.sum(x[1:] * x[:-1], axis=(0, 2)) / np.maximum(total, 1e-300))
