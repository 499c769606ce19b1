"""Many sessions of one plan solved at once: a study axis in front of the arrays of a model.

The model of a planned session is followed to second order from where it was planned, white by all
sources whose sizes are known::

    y = h(x0 + d) + e,  e ~ N(0, I)      h(x0 + d) = h(x0) + (J + (H d) / 2) d
                                         J(x0 + d) = J + H d

A trial draws d of the instrument and e of the readings, sources that nobody declared at their true
sizes among them, and is solved as `mixed.fit` solves it: Gauss-Newton, sizes by restricted maximum
likelihood from the contrasts that no unknown of the plan explains, each as uncertain as it is, and
Gauss-Newton again. Whatever a procedure states can be drawn so; nothing of it is written twice.

What a log has besides is not in it: detecting rests, outliers, and causes that are named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.infer import mixed
from foucault.infer.gauss_newton import TOLD, student
from foucault.infer.mixed import Covariance, Fit, Source
from foucault.kernels import trials

Solver = Callable[..., None]  # Solves many trials: `solve_batch` of `kernels.trials`.
STEP = 1e-3  # Half the distance over which the Jacobian is differenced, of every unknown [SI].
MOST, SMALL = 40, 1e-5  # Iterations at most, and the step that ends them, in units of the sd [1].
AT_ONCE = 2**21  # Numbers in the Jacobians of the trials that are solved at once [1].

TRIED = np.geomspace(1e-3, 1e6, 61)
"""Sizes of a source that are tried, in units of what its largest contrast shows [1]."""

SURE = 3.0
"""How much less than its price a source may gain by its slope alone to be looked at in full [1]."""

HALVED = 24  # Times that the distance between two sizes that were tried is halved [1].


class Jet(NamedTuple):
    """White rows of a model about a state, to second order, as `kernels.trials` reads them.

    Columns in units of `Plan.unit`; what a row says nothing of is left out.
    """

    width: IntArray  # (N,) unknowns of each row
    column: npt.NDArray[np.uint32]  # (N, w) which they are
    J: FloatArray  # (N, w) first derivative of the prediction [1]
    H: FloatArray  # (N, w, w) second derivative [1]

    @classmethod
    def of(cls, J: FloatArray, H: FloatArray) -> Jet:
        """Leave out what is zero; `J` (N, m), `H` (m, N, m) the second direction in front [1]."""
        there = (J != 0) | (H != 0).any(axis=0)
        width = np.count_nonzero(there, axis=1)
        column = np.argsort(~there, axis=1, kind="stable")[:, : width.max()]
        rows = np.arange(len(J))[:, None]
        bent = H[column[:, :, None], rows[:, :, None], column[:, None, :]]
        return cls(width, column.astype(np.uint32), J[rows, column], bent)

    def readings(self, d: FloatArray, e: FloatArray) -> FloatArray:
        """Return h(d) + e, (b, N); `d` (b, m), `e` (b, N): white errors [1]."""
        y = np.empty_like(e)
        trials.predict_batch(*self, d, e, y)
        return y


class Solved(NamedTuple):
    """Trials that were solved."""

    error: FloatArray  # (b, p) estimate minus truth [SI]
    cov: FloatArray  # (b, p, p) covariance that each states [SI]
    # (b, p) by how much each variance is larger than with the most likely sizes [SI]
    more: FloatArray
    bound: FloatArray  # (b, p) what noise of the sensors alone allows [SI]
    converged: BoolArray  # (b,)


class Spectrum(NamedTuple):
    """What one source of unknown size does to contrasts z ~ N(0, I + v V) of many trials."""

    V: FloatArray  # (q, q) [1]
    size: FloatArray  # (q,) its eigenvalues [1]
    axes: FloatArray  # (q, q)

    def gain(self, z: FloatArray) -> FloatArray:
        """Return what it gains alone in twice the log-likelihood, (b,); `z` (b, q) [1]."""
        a = TRIED[:, None] / max(float(self.size.max()), 1e-300) * np.maximum(self.size, 0.0)
        square = (z @ self.axes) ** 2
        return np.asarray((square @ (a / (1 + a)).T - np.sum(np.log1p(a), axis=1)).max(axis=1))

    def best(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the most likely variance of each trial, and its degrees of freedom, (b,) each.

        `z` (b, q): contrasts for which there is one above zero [1].
        """
        size = np.maximum(self.size, 0.0)
        square = (z @ self.axes) ** 2
        a = TRIED[:, None] / max(float(size.max()), 1e-300) * size
        k = (square @ (a / (1 + a)).T - np.sum(np.log1p(a), axis=1)).argmax(axis=1)
        low = TRIED[np.maximum(k - 1, 0)] * (k > 0) / max(float(size.max()), 1e-300)
        high = TRIED[np.minimum(k + 1, len(TRIED) - 1)] / max(float(size.max()), 1e-300)
        for _ in range(HALVED):  # the slope falls through zero between the neighbours
            v = (low + high) / 2
            shrunk = size / (1 + v[:, None] * size)
            rises = np.sum(square * shrunk**2 / np.where(size > 0, size, 1.0) - shrunk, axis=1) > 0
            low, high = np.where(rises, v, low), np.where(rises, high, v)
        v = (low + high) / 2
        return v, np.sum(v[:, None] * size / (1 + v[:, None] * size), axis=1)

    def more(self, z: FloatArray, var: FloatArray, V: FloatArray) -> FloatArray:
        """Return about what another source gains beside this one, by its slope there, (b,).

        `z` (b, q): contrasts [1]; `var` (b,): of this source [1]; `V` (q, q): of the other [1].
        """
        a = 1 / (1 + var[:, None] * np.maximum(self.size, 0.0))
        M = self.axes.T @ V @ self.axes
        w = a * (z @ self.axes)
        slope = np.einsum("bi,ij,bj->b", w, M, w, optimize=True) - a @ np.diag(M)
        bent = np.einsum("bi,ij,bj->b", a, M**2, a, optimize=True)
        return np.asarray(np.where(slope > 0, slope**2 / (2 * bent), 0.0))


@dataclass(frozen=True)
class Plan:
    """A planned session, made ready for many trials: arrays, which go to any process."""

    names: tuple[str, ...]  # the coefficients
    here: FloatArray  # (p,) where it was planned [SI]
    unit: FloatArray  # (m,) units of the unknowns in which all are seen alike [SI]
    # jet, bare: rows as they are solved (readings, what is known of nuisances, the prior), and with
    # noise of the sensors alone, for the bound
    jet: Jet
    bare: Jet
    slope: FloatArray  # (N, m) of the rows as they are solved, where it was planned [1]
    prior: FloatArray  # (k,) what the last rows say, less where it was planned [1]
    errors: FloatArray  # (N, N) root of the true covariance of the rows [1]
    contrasts: FloatArray  # (q, N) rows that no unknown explains, without the prior [1]
    # Of every source whose size is to be found:
    free: Mapping[str, FloatArray]  # its causes in the rows, (N, k) each [1]
    spectra: Mapping[str, Spectrum]  # how it shows in the contrasts
    prices: Mapping[str, float]  # what it has to gain, twice the log-likelihood [1]
    certain: frozenset[str]  # those that are there for certain

    @property
    def size(self) -> int:
        """Trials that are solved at once, by the size of the problem [1]."""
        return int(np.clip(AT_ONCE // (len(self.errors) * len(self.unit)), 8, 4096))

    @classmethod
    def of(
        cls, fit: Fit, true: Mapping[str, float], sources: Sequence[Source] | None = None
    ) -> Plan:
        """Make a planned session ready.

        `fit`: as `mixed.planned` returns it; `true`: source -> its true size, of those to be found
        [SI]; `sources` or None: what errors are drawn of, where not the sources of the fit.
        """
        n, d, m = fit.at.jacobian.shape
        known = [s for s in fit.at.sources if s.sd is not None]
        whiten = Covariance(known, {}, (n, d), np.ones(n)).whiten
        sd = np.sqrt(np.diag(fit.estimate.state_cov))
        unit = np.where((sd > 0) & np.isfinite(sd), sd, 1.0)
        rows, said = _prior(fit)
        beside = [*([] if fit.at.known is None else [fit.at.known[1]]), rows]
        slopes = _slopes(fit, m)
        J, H = _rows(fit, known, slopes, beside, unit)
        N, k = len(J), len(said)

        true_of = Covariance(sources or fit.at.sources, true, (n, d), np.ones(n))
        half = np.asarray(np.linalg.cholesky(true_of.whole), float)
        errors = np.zeros((N, N))
        errors[: n * d, : n * d] = whiten(half.reshape(n, d, n * d))
        between = np.arange(n * d, N - k)  # what is known of nuisances, and true of them
        errors[between, between] = 1.0

        Q, s, _ = np.linalg.svd(J[: N - k])
        left = Q[:, int(np.sum(s > 1e-10 * s.max())) :].T
        contrasts = np.concatenate([left, np.zeros((len(left), k))], axis=1)

        free = dict[str, FloatArray]()
        for source in (s for s in fit.at.sources if s.sd is None):
            B = whiten(np.concatenate([np.zeros((n, d, 0)), *mixed.columns(source)], axis=2))
            B = np.concatenate([B, np.zeros((N - n * d, B.shape[1]))])
            both = [free[source.name], B] if source.name in free else [B]
            free[source.name] = np.concatenate(both, axis=1)
        shown = {name: contrasts @ B @ (contrasts @ B).T for name, B in free.items()}
        return cls(
            fit.model.layout.names, fit.model.values(fit.state), unit, Jet.of(J, H),
            Jet.of(*_rows(fit, [s for s in known if s.noise], slopes, beside, unit)), J, said,
            errors, contrasts, free,
            {name: Spectrum(V, *np.linalg.eigh(V)) for name, V in shown.items()},
            {s.name: s.price for s in fit.at.sources if s.sd is None},
            frozenset(s.name for s in fit.at.sources if s.sd is None and s.certain),
        )  # fmt: skip

    def drawn(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw white errors of all rows, shape (count, N); `count`: of trials [1]."""
        return np.asarray(rng.standard_normal((count, len(self.errors))) @ self.errors.T)

    def solve(
        self, truth: FloatArray, e: FloatArray, solver: Solver = trials.solve_batch
    ) -> Solved:
        """Solve trials.

        `truth` (b, p): coefficients [SI]; `e` (b, N): white errors [1]; `solver`: of
        `kernels.trials`, or that of `kernels.cuda` which does the same on a device.
        """
        p, known = len(self.names), self.prior
        d = np.zeros((len(truth), len(self.unit)))
        d[:, :p] = (truth - self.here) / self.unit[:p]
        y = self.jet.readings(d, e)
        if len(known):
            y[:, -len(known) :] = known
        bound = _solved(solver, self.bare, y, d, p, most=0)[1]
        found = _solved(solver, self.jet, y, np.zeros_like(d), p)
        likely, sizes = self._sizes(found[3] @ self.contrasts.T)
        more = np.zeros((len(truth), p))
        for some, spread in self._spreads(sizes):
            more[some] = self._enlarged(
                spread, {name: (v - likely[name])[some] for name, v in sizes.items()}
            )
            again = _solved(solver, self.jet, y[some], found[0][some], p, spread)
            for whole, part in zip(found, again, strict=True):
                whole[some] = part
        x, cov, good, _ = found
        scale = self.unit[:p]
        return Solved(
            (x[:, :p] - d[:, :p]) * scale, cov * scale * scale[:, None], more * scale**2,
            np.sqrt(np.diagonal(bound, axis1=1, axis2=2)) * scale, good,
        )  # fmt: skip

    def _spreads(self, sizes: Mapping[str, FloatArray]) -> list[tuple[IntArray, FloatArray]]:
        """Return trials in which something was found, and the inverse of their covariance."""
        some = np.flatnonzero(np.any([v > 0 for v in sizes.values()], axis=0))
        if not len(some):
            return []
        C = np.eye(len(self.errors)) + sum(
            sizes[name][some, None, None] * (B @ B.T) for name, B in self.free.items()
        )
        return [(some, np.asarray(np.linalg.inv(C)))]

    def _enlarged(self, spread: FloatArray, more: Mapping[str, FloatArray]) -> FloatArray:
        """Return what is `more` in sources, (b,) each [1], in the coefficients, (b, p) [1].

        `spread` (b, N, N): inverse of the covariance of the rows [1].
        """
        pull = self.slope.T @ spread
        gain = np.linalg.solve(pull @ self.slope, pull)[:, : len(self.names)]
        parts = (v[:, None] * np.sum((gain @ self.free[name]) ** 2, axis=2)
                 for name, v in more.items())  # fmt: skip
        return np.asarray(sum(parts))

    def _sizes(self, z: FloatArray) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return the variance of every source of unknown size, (b,) each: likely, and as uncertain.

        `z` (b, q): contrasts [1].
        """
        likely, out = ({name: np.zeros(len(z)) for name in self.spectra} for _ in range(2))
        gains = {name: one.gain(z) - self.prices[name] for name, one in self.spectra.items()}
        if not gains:
            return likely, out
        names, gain = [*gains], np.array([*gains.values()])
        most = np.where(gain.max(axis=0) > 0, gain.argmax(axis=0), -1)
        full = np.zeros(len(z), bool)
        for k, (name, one) in enumerate(self.spectra.items()):
            mine = np.flatnonzero(most == k)
            var, dof = one.best(z[mine])
            n = np.maximum(dof, TOLD)
            likely[name][mine], out[name][mine] = var, var * n / (n - 2)  # `student`, squared
            for other in names:
                if other != name:
                    more = one.more(z[mine], var, self.spectra[other].V)
                    full[mine] |= more > self.prices[other] / SURE
        shown = {name: one.V for name, one in self.spectra.items()}
        for i in np.flatnonzero(full):
            found, told, _ = mixed.priced(z[i], shown, self.prices)
            for name, sd in found.items():
                likely[name][i], out[name][i] = sd**2, (sd * student(told[name])) ** 2
        for name in self.certain:
            one = self.spectra[name]
            alone = np.ones(len(z), bool)
            for other in names:
                alone &= (other == name) | (likely[other] == 0)
            out[name][alone] = mixed.means(one.size, (z[alone] @ one.axes) ** 2)
            for i in np.flatnonzero(~alone):
                there = {n: float(v[i]) for n, v in likely.items()}
                out[name][i] = mixed.mean_variance(name, shown, there, z[i])
        return likely, out


def _solved(
    solver: Solver, jet: Jet, y: FloatArray, d: FloatArray, p: int,
    spread: FloatArray | None = None, most: int = MOST,
) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:  # fmt: skip
    """Solve readings (b, N) from `d` (b, m); `spread` (b, N, N): inverse of their covariance [1].

    Returns d, covariance of its first `p`, whether it settled, and what is left of the readings.
    """
    d, good, left = d.copy(), np.zeros(len(d), bool), np.empty_like(y)
    cov, S = np.empty((len(d), p, p)), np.zeros((1, 1, 1)) if spread is None else spread
    solver(*jet, y, S, spread is not None, d, most, SMALL, cov, left, good)
    return d, cov, good, left


def _prior(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return white rows of the prior (k, m), and what it says, less where it was planned (k,)."""
    prior, m = fit.problem.prior, len(fit.estimate.state_cov)
    if prior is None:
        return np.zeros((0, m)), np.zeros(0)
    k = np.flatnonzero(np.isfinite(prior.prior_sd))
    rows = np.zeros((len(k), m))
    rows[np.arange(len(k)), k] = 1 / prior.prior_sd[k]
    return rows, (prior.values - fit.model.values(fit.state))[k] / prior.prior_sd[k]


def _slopes(fit: Fit, m: int) -> FloatArray:
    """Return the second derivative of the prediction, (n, d, m, m) [SI]; `m`: of unknowns [1]."""
    model, out = fit.model, list[FloatArray]()
    for step in STEP * np.eye(m):
        ahead, back = (model.linearise(model.retract(fit.state, s)) for s in (step, -step))
        out.append((ahead.jacobian - back.jacobian) / (2 * STEP))
    H = np.stack(out, axis=2)
    return np.asarray((H + np.swapaxes(H, 2, 3)) / 2)  # along a straight way only this part counts


def _rows(
    fit: Fit, sources: Sequence[Source], slopes: FloatArray, rows: Sequence[FloatArray],
    unit: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return white rows and linear `rows` (k, m) after them, columns per `unit` (m,) [SI].

    First derivative (N, m), second (m, N, m).
    """
    n, d, m = fit.at.jacobian.shape
    whiten = Covariance(sources, {}, (n, d), np.ones(n)).whiten
    J = np.concatenate([whiten(fit.at.jacobian), *rows]) * unit
    H = np.zeros((m, *J.shape))
    H[:, : n * d] = whiten(slopes.reshape(n, d, m * m)).reshape(-1, m, m).transpose(1, 0, 2)
    return J, H * unit * unit[:, None, None]
