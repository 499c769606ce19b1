"""Match what two instruments on one body turned between the same instants.

Between two epochs of the master, ``a`` to ``b`` by its stamps, the master turned by ``phi_m`` and
the slave, ``tau`` earlier by its own clock, by ``phi_s``, both relative to inertial space::

    phi_s = C_ms' phi_m + (b - a) bias + noise

Unknown are the delay tau, the mounting ``C_ms = C_0 Exp(mu)`` and the bias of the slave's gyros
less that of the master. All are found by Gauss-Newton. The noise is that of the gyros (white in
phi), of the master's attitude (white in attitude, so that neighbours in phi differ in sign) and of
what bends between the two (coloured): its spectrum is taken from the residuals of a first pass and
weights the second, frequency by frequency and axis by axis (`estimate.delay.spectral_weights`). The
covariance is that of the weighted residuals as they are, row by row, so that jitter of the stamps,
which disturbs most where the motion is quickest, counts as much as it does.

References
----------
.. [1] J. G. MacKinnon, H. White, "Some Heteroskedasticity-Consistent Covariance Matrix Estimators
   with Improved Finite Sample Properties", J. Econometrics 29, 1985, p. 305-325.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.estimate.delay.spectral_weights import filtered, shared, spectrum_of, whitening
from foucault.estimate.delay.turned import SlaveAttitude, Turns, inside
from foucault.models.rotation import cross_matrix, exp

ITERATIONS = 20
"""Most steps of Gauss-Newton in one pass [1]."""

TOGETHER = 20
"""Neighbouring rows that slow bending of the mount may disturb alike [1]."""

SETTLED, NEARLY = 1e-3, 0.1
"""Steps of so many standard deviations end the iteration: of the delay, and of all together, some
of which hardly count [1]."""

LOOSE = 1.0
"""Standard deviation of the mounting about its start, where nothing else holds it [rad]."""

HELD = np.diag(np.r_[0.0, np.full(3, LOOSE**-2), np.zeros(3)])
"""Information of that start."""

TAU, MU, BIAS = 0, slice(1, 4), slice(4, 7)
"""Places of the delay [s], the mounting [rad] and the bias [rad/s] among the unknowns."""


@dataclass(frozen=True)
class Match:
    """What matching has found."""

    x: FloatArray  # (7,) delay [s], mounting mu relative to the start (3) [rad], bias (3) [rad/s]
    cov: FloatArray  # (7, 7) covariance [SI]
    C_ms: FloatArray  # (3, 3) mounting, mu included [1]
    used: BoolArray  # (k,) which intervals of the master
    residual: FloatArray  # (k, 3) phi_s less what was expected, in s; zero where not used [rad]
    slope: FloatArray  # (k, 3, 7) its derivatives by x
    phi_s: FloatArray  # (k, 3) what the slave turned, zero where not used [rad]
    converged: bool  # whether the iteration has settled
    # (f, 3) spectrum by which the residuals were weighted, as the square of a Fourier transform
    # [rad^2]
    spectrum: FloatArray | None = None

    @property
    def delay(self) -> float:
        """The delay [s]."""
        return float(self.x[TAU])


def match(
    slave: SlaveAttitude, turns: Turns, delay: float, C_ms: FloatArray,
    among: BoolArray | None = None,
) -> Match:  # fmt: skip
    """Find delay, mounting and bias from a start that is near, all residuals of equal weight.

    `delay`: start of the delay, within a part of the shortest period of the motion [s]; `C_ms`
    (3, 3): start of the mounting [1]; `among` (k,): intervals that may be used, None for all.
    """
    x = np.zeros(7)
    x[TAU] = delay
    return _pass(slave, turns, x, C_ms, among, (None, None))


def weigh(
    slave: SlaveAttitude, turns: Turns, found: Match, among: BoolArray | None = None
) -> Match:
    """Find them again, weighted by the spectrum of the residuals of a match.

    `turns`: the master, its stamps may have moved a little; `among` (k,): intervals that may be
    used, None for all.
    """
    used = found.used if among is None else found.used & among
    spectrum = spectrum_of(np.where(used[:, None], found.residual, 0.0))
    x = found.x.copy()
    x[MU] = 0.0
    return _pass(slave, turns, x, found.C_ms, among, (spectrum, shared(found.phi_s, spectrum)))


def _pass(
    slave: SlaveAttitude, turns: Turns, x: FloatArray, C_0: FloatArray, among: BoolArray | None,
    weights: tuple[FloatArray | None, FloatArray | None],
) -> Match:  # fmt: skip
    """Iterate with one set of weights."""
    x, converged = x.copy(), False
    for _ in range(ITERATIONS):
        now = _look(slave, turns, x, C_0, among)
        now = _weighed(now, weights)
        step, whole, part = _step(now)
        step[TAU] = np.clip(step[TAU], -turns.interval, turns.interval)
        x = x + step
        if part <= SETTLED and whole <= NEARLY:
            converged = True
            break
    last = replace(_weighed(_look(slave, turns, x, C_0, among), weights), converged=converged)
    if weights[0] is None:
        return last
    return replace(last, cov=_with_bending(*whitened(last)))


def _look(
    slave: SlaveAttitude, turns: Turns, x: FloatArray, C_0: FloatArray, among: BoolArray | None
) -> Match:
    """Return the residuals and their slopes at x, zero where an interval is not used."""
    k = len(turns)
    used = inside(slave, turns, float(x[TAU]), among)
    some = turns if used.all() else turns[used]
    phi_s, slope = slave.turned(some.start - x[TAU], some.end - x[TAU])
    C_ms = C_0 @ exp(x[MU])
    expected = some.phi_m @ C_ms
    residual, slopes, turned = np.zeros((k, 3)), np.zeros((k, 3, 7)), np.zeros((k, 3))
    residual[used] = phi_s - expected - some.dt[:, None] * x[BIAS]
    slopes[used, :, TAU] = slope
    slopes[used, :, MU] = -cross_matrix(expected)
    slopes[used, :, BIAS] = -some.dt[:, None, None] * np.eye(3)
    turned[used] = phi_s
    return Match(x, np.zeros((7, 7)), C_ms, used, residual, slopes, turned, False)


def _weighed(now: Match, weights: tuple[FloatArray | None, FloatArray | None]) -> Match:
    """Return a match with its spectrum, and the slope by the delay as far as both turned."""
    spectrum, gain = weights
    if spectrum is None or gain is None:
        return now
    slope = now.slope.copy()
    slope[:, :, TAU] = filtered(slope[:, :, TAU], gain)[: len(slope)]
    return replace(now, slope=slope, spectrum=spectrum)


def whitened(found: Match, slope: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return residuals (m, 3) and slopes (m, 3, p) divided by their amplitude [1]; m >= k.

    `slope` (k, 3, p): slopes by other unknowns, None for those of the match.
    """
    slope = found.slope if slope is None else slope
    if found.spectrum is None:
        sd = np.sqrt(np.mean(found.residual[found.used] ** 2)) or 1.0
        return found.residual / sd, slope / sd
    k = len(found.residual)
    both = np.concatenate([found.residual[..., None], slope], axis=2)
    flat = filtered(both, whitening(found.spectrum / k))
    return flat[..., 0], flat[..., 1:]


def _step(found: Match) -> tuple[FloatArray, float, float]:
    """Return the step of Gauss-Newton, and its length and that of the delay in deviations."""
    e, J = whitened(found)
    flat = J.reshape(-1, J.shape[2])
    A = flat.T @ flat + HELD
    inverse = _inverse(A)
    step = -inverse @ (e.ravel() @ flat + HELD @ found.x)
    part = abs(step[TAU]) / np.sqrt(inverse[TAU, TAU]) if inverse[TAU, TAU] > 0 else 0.0
    return step, float(np.sqrt(max(step @ A @ step, 0.0))), float(part)


def residual_step(found: Match, delays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far unknowns of the delay are from zero, and their covariance with the others.

    `delays` (k, 3, p): slopes by unknowns that stand in for the delay [rad/s] times their unit.
    Returns `step` (p + 6,): step, the unknowns in place of the delay first; `cov` (p + 6, p + 6):
    its covariance.
    """
    p = delays.shape[2]
    e, J = whitened(found, np.concatenate([delays, found.slope[:, :, 1:]], axis=2))
    held = np.zeros((p + 6, p + 6))
    held[p:, p:] = HELD[1:, 1:]
    flat = J.reshape(-1, p + 6)
    step = -_inverse(flat.T @ flat + held) @ (e.ravel() @ flat)
    return step, covariance(e + J @ step, J, held)


def covariance(
    e: FloatArray, J: FloatArray, held: FloatArray | None = None, rows: int = 1
) -> FloatArray:
    """Return the covariance of a weighted fit by its residuals as they are, shape (p, p).

    By what the solution would be without each of the rows, or without so many at once (jackknife):
    ``dx_r = A^-1 J_r' (I - J_r A^-1 J_r')^-1 e_r``, ``cov = sum dx dx'``; [1]. It holds where rows
    differ in noise. What is not seen is infinite.

    `e` (k, 3): whitened residuals of the solution [1]; `J` (k, 3, p): their slopes [1]; `held`
    (p, p) or None: information that is known beside [1]; `rows`: rows that are left out together:
    those that have an error in common [1].
    """
    p = J.shape[2]
    held = np.zeros((p, p)) if held is None else held
    blocks = len(e) // rows
    J_r = J[: blocks * rows].reshape(blocks, 3 * rows, p)
    e_r = e[: blocks * rows].reshape(blocks, 3 * rows, 1)
    flat = J.reshape(-1, p)
    A = flat.T @ flat + held
    inverse = _inverse(A)
    shift = J_r @ inverse
    left = (1.0 + 1e-9) * np.eye(3 * rows) - shift @ np.swapaxes(J_r, 1, 2)
    dx = (np.swapaxes(shift, 1, 2) @ np.linalg.solve(left, e_r))[:, :, 0]
    cov = dx.T @ dx + inverse @ held @ inverse
    blind = np.diag(A) <= 0
    cov[blind, blind] = np.inf
    return np.asarray(cov)


def _with_bending(e: FloatArray, J: FloatArray) -> FloatArray:
    """Return the covariance of delay, mounting and bias.

    Slow bending moves the mounting for many rows alike, the delay hardly.
    """
    cov = covariance(e, J, HELD)
    slow = covariance(e, J, HELD, TOGETHER)
    with np.errstate(invalid="ignore"):
        more = np.sqrt(np.fmax(np.diag(slow) / np.diag(cov), 1.0))
    more[TAU] = 1.0
    return np.asarray(cov * np.outer(more, more))


def _inverse(A: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(A))
    size[size == 0] = 1.0
    scale = np.outer(size, size)
    return np.asarray(np.linalg.pinv(A / scale, rcond=1e-14, hermitian=True) / scale)
