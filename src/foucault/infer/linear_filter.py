"""A linear system that is given epoch by epoch: Kalman filter, likelihood, smoother.

::

    x_k = Phi_k x_k-1 + u_k + w_k,    z_k = H_k x_k + v_k

What is linearised about a run that is not corrected on the way (a free run of a navigator, say) is
of this form, and can be filtered again and again, with other noise or another bound, at the cost of
the filter alone. The recursion is `kernels.linear_filter`.

The a-posteriori H-infinity filter of any linear system.

Whatever the noise does, as long as the filter exists the energy of its error of ``L x`` stays below
``gamma^2`` times that of start error, process and measurement noise, each counted by the inverse of
the covariance it was given::

    sum |L (x - x_est)|^2  <  gamma^2 (|x0 - x0_est|^2_P0^-1 + sum |w|^2_Q^-1 + sum |v|^2_R^-1)

It is a Kalman filter whose covariance is made larger along L after every update, by as much as
gamma demands (as measurements of negative variance: design/README.md); with gamma infinite it is
the Kalman filter. There is a least gamma, below which it
does not exist; it depends on the system, its covariances and L, and is found by trying.

What it is worth: insurance against covariances that are somewhat too small, at the cost of a little
noise. It does not rescue a wrong model, and its covariance is not that of its error.

References
----------
.. [1] G. J. Bierman, *Factorization Methods for Discrete Sequential Estimation*, 1977, chapter 10
   (the modified Bryson-Frazier smoother).
.. [2] B. Hassibi, A. H. Sayed, T. Kailath, "Linear estimation in Krein spaces, part II:
   applications", *IEEE Transactions on Automatic Control* 41 (1996) 34-49, theorem 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import error
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.kernels.linear_filter import TOGETHER, linear_filter, linear_smoother


@dataclass(frozen=True)
class LinearSystem:
    """What happens from epoch to epoch, and what is measured."""

    # (m, b, n) transition to each epoch from the one before, the first from the start; its rows
    # beyond the first b are those of the identity [SI]
    Phi: FloatArray
    # (m, n) half of the variance of the white noise between them, which comes in half before the
    # transition and half after [SI]
    half: FloatArray
    H: FloatArray  # (m, q, n) rows of what is measured [SI]
    z: FloatArray  # (m, q) what was measured [SI]
    R: FloatArray  # (m, q) its variances; infinite where nothing was [SI]
    x0: FloatArray  # (n,) expected state at the start [SI]
    P0: FloatArray  # (n, n) its covariance [SI]
    # (m, b) u, known steps of the state, which no noise comes with; None for none [SI]
    jump: FloatArray | None = None

    def between(self, epochs: slice, x0: FloatArray, P0: FloatArray) -> LinearSystem:
        """Return what happens in some epochs, from a state `x0` (n,), `P0` (n, n) before [SI]."""
        jump = None if self.jump is None else self.jump[epochs]
        return LinearSystem(self.Phi[epochs], self.half[epochs], self.H[epochs], self.z[epochs],
                            self.R[epochs], x0, P0, jump)  # fmt: skip


@dataclass(frozen=True)
class LinearRun:
    """What a filter has found, epoch by epoch."""

    # states, sd: (m, n) estimates after each epoch and their standard deviations [SI]
    states: FloatArray
    sd: FloatArray
    # innovation, variance: (m, q) of each measurement; NaN where nothing was measured, a NaN
    # innovation alone where it lay beyond the gate [SI]
    innovation: FloatArray
    variance: FloatArray
    predicted: FloatArray  # (m, n) or (0, n) estimates before each epoch, where kept [SI]
    before: FloatArray  # (m, n, n) or (0, n, n) their covariances, where kept [SI]
    cov: FloatArray  # (n, n) covariance at the end [SI]
    # (m,) smallest ``1 - l P l' / gamma^2`` of each epoch; NaN for a Kalman filter [1]
    margin: FloatArray
    # epoch at which an H-infinity filter of this gamma ceased to exist; nothing is known from there
    # on [1]
    stopped: int | None

    @cached_property
    def white(self) -> FloatArray:
        """Innovations over their standard deviations, shape (m, q); NaN where there is none [1]."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.innovation / np.sqrt(self.variance))

    @cached_property
    def nis(self) -> FloatArray:
        """Normalised innovation squared of each epoch, shape (m,) [1]."""
        return np.asarray(np.nansum(self.innovation**2 / self.variance, axis=1))

    @property
    def log_likelihood(self) -> float:
        """Of all innovations [1]."""
        taken = np.isfinite(self.innovation)
        e, S = self.innovation[taken], self.variance[taken]
        return float(-0.5 * np.sum(e**2 / S + np.log(2.0 * np.pi * S)))


def conditional(cov: FloatArray, known: list[int]) -> FloatArray:
    """Return what `cov` (n, n) [SI] leaves once the `known` are known exactly."""
    if not known:
        return cov
    across, own = cov[:, known], cov[np.ix_(known, known)]
    unit = np.sqrt(np.diag(own))  # states of many units
    gain = np.linalg.solve(own / np.outer(unit, unit), (across / unit).T)
    return np.asarray(cov - (across / unit) @ gain)


LINE = 8
"""Numbers in a line of the cache, and in the widest register [1]."""


def kalman(system: LinearSystem, *, gate: float = np.inf, keep: bool = False) -> LinearRun:
    """Run a Kalman filter; `gate`: measurements beyond so many sd are left out [1]."""
    return bounded(system, np.zeros((0, len(system.x0))), np.inf, gate=gate, keep=keep)


def bounded(
    system: LinearSystem, L: FloatArray, limit: float, *, gate: float = np.inf, keep: bool = False
) -> LinearRun:
    """Run a filter whose error of ``L x`` stays below a bound, see `infer.linear_filter`.

    `L` (r, n): what is wanted [SI]; `limit`: square of the bound gamma, infinite for a Kalman
    filter [1]; `gate`: measurements beyond so many standard deviations are left out [1].
    """
    s = system
    jump = np.zeros(s.Phi.shape[:2]) if s.jump is None else s.jump
    q, n = s.H.shape[1:]
    together = max(-(-q // TOGETHER), 1) * TOGETHER
    P, T, G = (_rows(many, n + 1) for many in (n, s.Phi.shape[1], together))
    P[:, :n], P[:, n] = s.P0, s.x0
    x, sd, innovation, variance, predicted, before, cov, margin, stopped = linear_filter(
        s.Phi, jump, s.half, s.H, s.z, s.R, np.ascontiguousarray(L, float), float(limit),
        float(gate), P, T, G, keep,
    )  # fmt: skip
    return LinearRun(x, sd, innovation, variance, predicted, before, cov, margin,
                     None if stopped == len(s.Phi) else int(stopped))  # fmt: skip


def _rows(many: int, columns: int) -> FloatArray:
    """Return rows of zeros that fill whole registers, each begun where one can be loaded at once.

    So a filter takes two thirds of the time: `columns` at least, in whole lines of the cache.
    """
    width = -(-columns // LINE) * LINE
    flat = np.zeros(many * width + LINE)
    at = -flat.ctypes.data // flat.itemsize % LINE
    return flat[at : at + many * width].reshape(many, width)


@dataclass(frozen=True)
class LinearSmoothed:
    """A Kalman run as seen from its end."""

    states: FloatArray  # (m, n) estimates [SI]
    cov: FloatArray  # (m, n, n) covariances [SI]
    start: FloatArray  # (n,) estimate of the state at the start [SI]
    start_cov: FloatArray  # (n, n) its covariance [SI]


def smoothed_start(system: LinearSystem, run: LinearRun) -> FloatArray:
    """Return the state at the start alone as `smoothed` has it, shape (n,) [SI]."""
    return np.asarray(system.x0 - system.P0 @ _backward(system, run, whole=False)[2])


def smoothed(system: LinearSystem, run: LinearRun) -> LinearSmoothed:
    """Smooth a run of `kalman` made with ``keep=True``."""
    lam, adj, adjoint, information = _backward(system, run, whole=True)
    P = run.before
    states, cov = run.predicted - np.einsum("kij,kj->ki", P, lam), P - P @ adj @ P
    P0 = system.P0
    return LinearSmoothed(states, cov, system.x0 - P0 @ adjoint, P0 - P0 @ information @ P0)


def _backward(system: LinearSystem, run: LinearRun, *, whole: bool) -> tuple[FloatArray, ...]:
    if len(run.before) != len(system.Phi):
        raise ValueError("a run to be smoothed must be made with keep=True")
    back: tuple[FloatArray, ...] = linear_smoother(
        system.Phi, system.H, system.R, run.innovation, run.before, whole
    )
    return back


@dataclass(frozen=True)
class Shock:
    """A sudden change of some states, at the epoch where it explains most."""

    epoch: int  # before what is measured there it came [1]
    square: float  # squared, in its sds [1]
    limit: float  # what none of so many epochs comes to by chance [1]
    size: FloatArray  # (q,) change of the states [SI]
    sd: FloatArray  # (q,) its standard deviations [SI]
    least: float  # a change that half of all epochs notice, whichever state changes [SI]


UNSEEN = 1e-6  # A direction of which what follows says less, of its own scale, is not asked [1].


def shocks(system: LinearSystem, run: LinearRun, ways: Mapping[str, IntArray]) -> dict[str, Shock]:
    """Return of each way (q,) of states to change at once where and how it would explain most [1].

    With lambda and Lambda of the smoother, that is all that follows an epoch, a step d of states W
    has the estimate ``-(W' Lambda W)^-1 W' lambda``, of covariance ``(W' Lambda W)^-1`` [3]_.

    `run`: of `kalman`, made with ``keep=True``; `ways`: name -> indices of states, shape (q,) [1].

    References
    ----------
    .. [3] P. de Jong, J. Penzer, "Diagnosing shocks in time series", *JASA* 93 (1998).
    """
    lam, adj = _backward(system, run, whole=True)[:2]
    return stepped(lam, adj, ways)


def stepped(
    lam: FloatArray, adj: FloatArray, ways: Mapping[str, IntArray], **words: float
) -> dict[str, Shock]:
    """Return the same from the adjoints of a smoother.

    `lam` (m, n), `adj` (m, n, n): lambda and Lambda [1 / SI]; `ways`: name -> indices of states,
    shape (q,) [1]; `words`: of `likeliest` [1].
    """
    return {
        name: likeliest(adj[:, at[:, None], at], -lam[:, at], ways=len(ways), **words)
        for name, at in ways.items()
    }


def likeliest(
    own: FloatArray, pull: FloatArray, *, ways: float = 1, times: float = 0,
    false_alarm: float = FALSE_ALARM,
) -> Shock:  # fmt: skip
    """Return where and how a change explains most: d of ``own d = pull`` gains ``pull' d``.

    `own` (k, q, q), `pull` (k, q): information of a change at each epoch, and what the residuals
    say of it [1 / SI]; `ways`: how many kinds of change are asked for [1]; `times`: at how many
    epochs that are not much alike, 0 for all [1]; `false_alarm`: how often one is beyond the limit
    by chance [1].
    """
    var = np.einsum("kii->ki", own)
    inverse = np.where(var > 0, 1.0 / np.sqrt(np.where(var > 0, var, 1.0)), 0.0)
    scaled, asked = own * inverse[:, :, None] * inverse[:, None, :], pull * inverse
    # Of positive eigenvalues whose mean is one the least is larger than their product over e; then
    # the inverse has no variance below one.
    seen = np.linalg.det(scaled) > np.e * UNSEEN
    covs = np.empty_like(scaled)
    covs[seen] = np.linalg.inv(scaled[seen])
    seen[seen] = (np.einsum("kii->ki", covs[seen]) > 1 - 1e-9).all(axis=1)
    size, axes = np.linalg.eigh(scaled[~seen])
    share = np.where(size > UNSEEN, 1.0 / np.maximum(size, UNSEEN), 0.0)
    covs[~seen] = axes * share[:, None, :] @ np.swapaxes(axes, 1, 2)
    square = np.sum(asked * (covs @ asked[..., None])[..., 0], axis=1)
    k = int(np.argmax(square))
    cov = covs[k] * np.outer(inverse[k], inverse[k])
    limit = chi_square_limits(own.shape[1], 2 * false_alarm / ways, int(times) or len(own))[1]
    sds = np.sqrt(np.einsum("kii->ki", covs)) * inverse
    least = np.sqrt(limit) * float(np.median(sds, axis=0).max())
    return Shock(k, float(square[k]), limit, cov @ pull[k], np.sqrt(np.diag(cov)), least)


def extended(system: LinearSystem, H: FloatArray, sd: float) -> LinearSystem:
    """Return it with last states that stay, seen by `H` (m, q, k), known to `sd` about 0 [SI]."""
    more = (0, H.shape[2])
    P0 = np.pad(system.P0, (more, more))
    new = range(len(system.x0), len(P0))
    P0[new, new] = sd**2
    return replace(
        system, Phi=np.pad(system.Phi, ((0, 0), (0, 0), more)),
        half=np.pad(system.half, ((0, 0), more)), H=np.concatenate([system.H, H], axis=2),
        x0=np.pad(system.x0, more), P0=P0,
    )  # fmt: skip


WIDEST = 1e12
"""A gamma beyond which no filter is looked for [1]."""


def by_prior(system: LinearSystem) -> FloatArray:
    """Return the L that wants every state, in units of its uncertainty at the start, (n, n).

    `system`: the system, states that are known exactly at the start are not wanted.
    """
    sd = np.sqrt(np.diag(system.P0))
    return np.diag(1.0 / sd[sd > 0]) if (sd > 0).all() else np.diag(1.0 / sd)[sd > 0]


def h_infinity(system: LinearSystem, L: FloatArray, gamma: float) -> LinearRun:
    """Run the H-infinity filter.

    `L` (r, n): what is wanted, each row in units in which errors shall be compared [SI]; `gamma`:
    bound of the error, infinite for a Kalman filter [1]. Returns where the filter ceased to exist
    `stopped` is the epoch, and nothing is known from there on. Raises A gamma that is not
    positive, or an L that does not fit the states.
    """
    if not gamma > 0:
        raise error("h_infinity.gamma", given=f"{gamma:g}")
    if L.ndim != 2 or L.shape[1] != len(system.x0):
        raise error("h_infinity.wanted", shape=L.shape, states=len(system.x0))
    return bounded(system, L, gamma**2)


def least_gamma(system: LinearSystem, L: FloatArray, *, within: float = 0.01) -> float:
    """Return the least gamma, to `within` [1], for which a filter of `L` (r, n) [SI] exists."""

    def exists(gamma: float) -> bool:
        return h_infinity(system, L, gamma).stopped is None

    high = 1.0
    while not exists(high):
        high *= 4.0
        if high > WIDEST:
            raise error("h_infinity.none", tried=f"{WIDEST:g}")
    low = high / 4.0
    while exists(low):
        low, high = low / 4.0, low
        if low < 1.0 / WIDEST:  # nothing is wanted
            return high
    while high > low * (1.0 + within):
        middle = float(np.sqrt(low * high))
        if exists(middle):
            high = middle
        else:
            low = middle
    return high
