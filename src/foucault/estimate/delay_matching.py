"""Match what two instruments on one body turned between the same instants.

Between two epochs of the master, ``a`` to ``b`` by its stamps, the master turned by ``phi_m`` and
the slave, ``tau`` earlier by its own clock, by ``phi_s``, both relative to inertial space::

    phi_s = (1 + k) C_ms' phi_m + (b - a) bias + noise

Unknown are the delay tau, the mounting ``C_ms = C_0 Exp(mu)``, and bias and scale factor errors k,
axis by axis, of the slave's gyros less those of the master. All are found by Gauss-Newton. The
noise is that of the gyros (white in phi), of the master's attitude (white in attitude, so that
neighbours in phi differ in sign) and of what bends between the two (coloured): its spectrum is
taken from the residuals of a first pass and weights the second, frequency by frequency and axis by
axis (`estimate.delay`).

Noise between two samples is smaller than at one. Were a slave that samples as rarely as its master
asked itself how its turning changes with the delay, the least residual would lie nearer to the
middle between two samples, by ten standard deviations where its gyros are the worse ones. What the
master says of that change weights the residuals instead, for its noise is another one (an
instrumental variable [2]_). The covariance is that of the weighted residuals as they are, row by
row, so that jitter of the stamps, which disturbs most where the motion is quickest, counts as much
as it does.

References
----------
.. [1] J. G. MacKinnon, H. White, "Some Heteroskedasticity-Consistent Covariance Matrix Estimators
   with Improved Finite Sample Properties", J. Econometrics 29, 1985, p. 305-325.
.. [2] T. Soderstrom, "Errors-in-Variables Methods in System Identification", 2018, chapter 6.

Weights of residuals by their own spectrum, axis by axis.

The spectrum is the sum of two kinds of white noise, of the residual itself and of what it is the
difference of, and of whatever else there is, which is smoothed. The filter that makes such
residuals white looks back only: one that looked ahead as well would do so too, but spread what one
row does over rows far away.

References
----------
.. [1] P. Whittle, "The Analysis of Multiple Stationary Time Series", J. R. Statist. Soc. B 15,
   1953, p. 125-139.
.. [2] A. V. Oppenheim, R. W. Schafer, *Discrete-Time Signal Processing*, 1989, chapter 12
   (minimum phase from the cepstrum).

What a slave and its master turned between the same instants, relative to inertial space.

Between two epochs of the master, a to b by its stamps, and tau earlier by the slave's clock::

    phi_m = Log(C_im(a)' C_im(b))        phi_s = Log(C_is(a - tau)' C_is(b - tau))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray
from foucault.models.rotation import cross_matrix, exp, log
from foucault.navigate.increments import Increments

ComplexArray = npt.NDArray[np.complex128]

LEAST = 4  # A spectrum is smoothed over at least so many values on either side [1].

RATIOS = 1.0 - np.geomspace(1.0, 1e-4, 25)
"""Parts of differenced white noise in the residuals that are tried [1]."""


def spectrum_of(residual: FloatArray) -> FloatArray:
    """Return the spectrum of residuals, shape (f, 3) [rad^2].

    White noise of phi and of attitude, ``S = c (1 - r + r (2 sin(w/2))^2)``, are fitted first; what
    is left over is smoothed.

    `residual` (k, 3): residuals [rad].
    """
    k = len(residual)
    power = np.abs(waves(residual)) ** 2
    power = np.maximum(power, 1e-20 * power.max(initial=1e-280))
    rise = 4 * np.sin(np.pi * np.linspace(0.0, 0.5, len(power))) ** 2
    shapes = 1 - RATIOS[:, None] + RATIOS[:, None] * rise
    out = np.empty_like(power)
    for axis, p in enumerate(power.T):
        inner, shape = p[1:], shapes[:, 1:]  # the bias has taken the first
        level = np.log(np.mean(inner / shape, axis=1)) + np.mean(np.log(shape), axis=1)
        best = shapes[np.argmin(level)]
        out[:, axis] = best * _smoothed(inner / best[1:], _most(k))
    return np.asarray(out)


def shared(turned: FloatArray, spectrum: FloatArray) -> FloatArray:
    """Return how much of what the slave turned the master has too, by frequency (f, 3) [1].

    Where the slave bends or is noisy its own rate says too much of what a delay would change.

    `turned` (k, 3): what the slave turned [rad]; `spectrum` (f, 3): spectrum of the residuals
    [rad^2].
    """
    power = np.abs(waves(turned)) ** 2
    smooth = np.stack([_smoothed(p[1:], _most(len(turned))) for p in power.T], axis=1)
    return np.asarray(np.clip(1.0 - spectrum / np.maximum(smooth, 1e-300), 0.0, 1.0))


def filtered(x: FloatArray, gain: FloatArray | ComplexArray) -> FloatArray:
    """Return series through a filter, as long as a Fourier transform likes, not shorter.

    `x` (k, 3) or (k, 3, p): series [any unit]; `gain` (f, 3): gain by frequency and axis [1].
    """
    return _in_time(waves(x) * (gain if x.ndim == 2 else gain[..., None]))


def whitening(spectrum: FloatArray) -> ComplexArray:
    """Return the causal filter, (f, 3), that makes residuals of `spectrum` [rad^2] white; [2]."""
    cepstrum = _in_time(np.log(spectrum).astype(complex))
    half = len(spectrum) - 1
    cepstrum[1:half] *= 2.0
    cepstrum[half + 1 :] = 0.0
    return np.asarray(np.exp(-0.5 * waves(cepstrum)))


def waves(x: FloatArray) -> ComplexArray:
    """Return the Fourier transform of `x` (k, ...) [any] along axis 0, of a quick even length."""
    from scipy.fft import next_fast_len, rfft

    return np.asarray(rfft(x, 2 * next_fast_len(-(-len(x) // 2), real=True), axis=0))


def _in_time(bins: ComplexArray) -> FloatArray:
    """Return its inverse."""
    from scipy.fft import irfft

    return np.asarray(irfft(bins, 2 * (len(bins) - 1), axis=0))


def _most(k: int) -> int:
    return max(LEAST, round(0.5 * float(np.sqrt(k))))


def _smoothed(power: FloatArray, most: int) -> FloatArray:
    """Return running means, over fewer values near the start, with one value more in front."""
    n = len(power)
    half = np.clip(np.arange(n) // 2, min(LEAST, n - 1), min(most, n - 1))
    padded = np.pad(power, n - 1, mode="reflect")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    middle = np.arange(n) + n - 1
    smooth = (total[middle + half + 1] - total[middle - half]) / (2 * half + 1)
    return np.concatenate([smooth[:1], smooth])


@dataclass(frozen=True)
class Turns:
    """What a master turned between its epochs, relative to inertial space."""

    # start, end: (k,) epochs, as stamped [s]
    start: FloatArray
    end: FloatArray
    phi_m: FloatArray  # (k, 3) rotation vectors in the master's axes [rad]

    @cached_property
    def dt(self) -> FloatArray:
        """Lengths of the intervals, shape (k,) [s]."""
        return self.end - self.start

    @cached_property
    def interval(self) -> float:
        """Usual length of an interval [s]."""
        return float(np.median(self.dt))

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, rows: slice | BoolArray) -> Turns:
        """Return some of the intervals."""
        return Turns(self.start[rows], self.end[rows], self.phi_m[rows])


LOST = 3.5  # Longer intervals than so many usual ones have a gap that hides what was turned [1].


@dataclass(frozen=True)
class SlaveAttitude:
    """The attitude of the slave relative to its start, at any time.

    Between samples the angle follows the cubic that has the increments around it.
    """

    increments: Increments  # what its gyros added up [SI]

    @cached_property
    def history(self) -> FloatArray:
        """Attitude at the end of every interval relative to inertial space, shape (n, 3, 3)."""
        from foucault.kernels.inertial import from_start

        x = self.increments
        C_0s, _ = from_start(x.dtheta_b, np.zeros_like(x.dtheta_b), *x.bends)
        return np.asarray(C_0s)

    @cached_property
    def _bends(self) -> tuple[FloatArray, FloatArray]:
        """How much the increment before is less than each one, and the one after more [rad]."""
        theta, joined = self.increments.dtheta_b, self.increments.joined
        before, after = np.zeros_like(theta), np.zeros_like(theta)
        step = np.where(joined[1:, None], np.diff(theta, axis=0), 0.0)
        before[1:], after[:-1] = step, step
        return before, after

    @cached_property
    def cuts(self) -> FloatArray:
        """Ends of the intervals that are not joined to the one before, shape (c,) [s].

        Where few samples in a row are lost what was between is known, and turns are few without it.
        """
        x = self.increments
        long = np.diff(x.time) > LOST * float(np.median(x.dt))
        long[1:] |= long[:-1]  # the row after a gap is not joined either
        return x.time[1:][~x.joined[1:] & long]

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return C_0s, (k, 3, 3), and w_is_s, (k, 3) [rad/s], at `time` (k,) within the log [s]."""
        x = self.increments
        row = np.clip(np.searchsorted(x.time, time), 1, len(x) - 1)
        f = ((time - x.time[row - 1]) / (x.time[row] - x.time[row - 1]))[:, None]
        p = 1.0 - f
        theta, (before, after) = x.dtheta_b[row], (one[row] for one in self._bends)
        # Everett's formula for the integral of the rate through four ends of intervals
        part = f * theta + p * (p * p - 1) / 6 * before + f * (f * f - 1) / 6 * after
        rate = theta - (3 * p * p - 1) / 6 * before + (3 * f * f - 1) / 6 * after
        return self.history[row - 1] @ exp(part), rate / x.dt[row][:, None]

    def turned(self, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return phi_s, shape (k, 3) [rad], and its slope by the delay, shape (k, 3) [rad/s].

        `start`, `end` (k,): from when to when, by the slave's clock [s].
        """
        if np.array_equal(start[1:], end[:-1]):  # one look-up serves both
            C, w = self.at(np.append(start, end[-1:]))
            C_a, C_b, w_a, w_b = C[:-1], C[1:], w[:-1], w[1:]
        else:
            (C_a, w_a), (C_b, w_b) = self.at(start), self.at(end)
        phi = log(np.swapaxes(C_a, 1, 2) @ C_b)
        # Log(Exp(w_a d) Exp(phi) Exp(-w_b d)), to second order in phi
        fall, sum_ = w_a - w_b, w_a + w_b
        slope = fall - 0.5 * np.cross(phi, sum_) + np.cross(phi, np.cross(phi, fall)) / 12
        return phi, slope


def turns_of(time: FloatArray, C_nb: FloatArray, w_in_n: FloatArray | None = None) -> Turns:
    """Return what a master turned between its epochs.

    `time` (k,): epochs, as stamped, rising [s]; `C_nb` (k, 3, 3): its attitude [1]. Frame n
    cancels but for its own rate; `w_in_n` (k, 3): rate of frame n, of Earth and transport
    [rad/s], None where n does not turn. Left out, up to 15 deg/h of the Earth's rate go into the
    bias.
    """
    before = np.swapaxes(C_nb[:-1], 1, 2)
    if w_in_n is not None:
        between = 0.5 * (w_in_n[:-1] + w_in_n[1:]) * np.diff(time)[:, None]
        before = before @ exp(between)
    phi = np.full((len(time) - 1, 3), np.nan)
    both = before @ C_nb[1:]
    known = np.isfinite(both).all(axis=(1, 2))
    phi[known] = log(both[known])
    return Turns(time[:-1], time[1:], phi)


def inside(
    slave: SlaveAttitude, turns: Turns, delay: float, among: BoolArray | None = None
) -> BoolArray:
    """Return which of `among` (k,) the slave's log covers without a gap at `delay` [s]."""
    time = slave.increments.time
    a, b = turns.start - delay, turns.end - delay
    ok = (a >= time[0]) & (b <= time[-1])
    if among is not None:
        ok &= among
    if len(slave.cuts):
        # From the end of one interval to the beginning of the next: no epoch may lie in between.
        ok &= np.searchsorted(slave.cuts, a, side="right") == np.searchsorted(slave.cuts, b)
    return np.asarray(ok)


ITERATIONS = 20  # Most steps of Gauss-Newton in one pass [1].
TOGETHER = 20  # Neighbouring rows that slow bending of the mount may disturb alike [1].

SETTLED, NEARLY = 1e-3, 0.1
"""Steps of so many standard deviations end the iteration: of the delay, and of all together, some
of which hardly count [1]."""

LOOSE = 1.0
"""Standard deviation of the mounting about its start, where nothing else holds it [rad]."""

GAINS = 0.05  # Standard deviation of scale factor errors, where nothing else holds them [1].

HELD = np.diag(np.r_[0.0, np.full(3, LOOSE**-2), np.zeros(3), np.full(3, GAINS**-2)])
"""Information of both."""

ALIKE = np.diag(np.r_[np.diag(HELD)[:7], np.full(3, 1e30)])
"""The same where the gyros have no scale factor errors."""

TAU, MU, BIAS, GAIN = 0, slice(1, 4), slice(4, 7), slice(7, 10)
"""Places of delay [s], mounting [rad], bias [rad/s] and scale factor errors [1] of the unknowns."""


@dataclass(frozen=True)
class Match:
    """What matching has found."""

    # x: (10,) delay [s], mounting mu from the start (3) [rad], bias (3) [rad/s], scale (3) [1]
    x: FloatArray
    cov: FloatArray  # (10, 10) covariance [SI]
    C_ms: FloatArray  # (3, 3) mounting, mu included [1]
    used: BoolArray  # (k,) which intervals of the master
    residual: FloatArray  # (k, 3) phi_s less what was expected, in s; zero where not used [rad]
    slope: FloatArray  # (k, 3, 10) its derivatives by x
    weighted: FloatArray  # (k, 3, 10) the same as the master alone says them
    phi_s: FloatArray  # (k, 3) what the slave turned, zero where not used [rad]
    converged: bool  # whether the iteration has settled
    held: FloatArray  # (10, 10) information that was known before [SI]
    # (f, 3) spectrum by which the residuals were weighted, as the square of a Fourier transform
    # [rad^2]
    spectrum: FloatArray | None = None

    @property
    def delay(self) -> float:
        """The delay [s]."""
        return float(self.x[TAU])


def match(
    slave: SlaveAttitude, turns: Turns, delay: float, C_ms: FloatArray,
    among: BoolArray | None = None, held: FloatArray = ALIKE,
) -> Match:  # fmt: skip
    """Find delay, mounting and bias from a start that is near, all residuals of equal weight.

    `delay`: start of the delay, within a part of the shortest period of the motion [s]; `C_ms`
    (3, 3): start of the mounting [1]; `among` (k,): intervals that may be used, None for all;
    `held` (10, 10): what is known before [SI].
    """
    x = np.zeros(len(HELD))
    x[TAU] = delay
    return _pass(slave, turns, x, C_ms, among, held, (None, None))


def weigh(
    slave: SlaveAttitude, turns: Turns, found: Match, among: BoolArray | None = None
) -> Match:
    """Match again, by the spectrum of the residuals, intervals `among` (k,), None all [1]."""
    used = found.used if among is None else found.used & among
    spectrum = spectrum_of(np.where(used[:, None], found.residual, 0.0))
    x = found.x.copy()
    x[MU] = 0.0
    weights = spectrum, shared(found.phi_s, spectrum)
    return _pass(slave, turns, x, found.C_ms, among, found.held, weights)


def _pass(
    slave: SlaveAttitude, turns: Turns, x: FloatArray, C_0: FloatArray, among: BoolArray | None,
    held: FloatArray, weights: tuple[FloatArray | None, FloatArray | None],
) -> Match:  # fmt: skip
    """Iterate with one set of weights."""
    x, converged = x.copy(), False
    for _ in range(ITERATIONS):
        now = _look(slave, turns, x, C_0, among, held)
        now = _weighed(now, weights)
        step, whole, part = _step(now)
        step[TAU] = np.clip(step[TAU], -turns.interval, turns.interval)
        x = x + step
        if part <= SETTLED and whole <= NEARLY:
            converged = True
            break
    last = _weighed(_look(slave, turns, x, C_0, among, held), weights)
    last = replace(last, converged=converged)
    if weights[0] is None:
        return last
    return replace(last, cov=_with_bending(*_as_weighted(last, np.ones((len(turns), 1))), held))


def _look(
    slave: SlaveAttitude, turns: Turns, x: FloatArray, C_0: FloatArray, among: BoolArray | None,
    held: FloatArray,
) -> Match:  # fmt: skip
    """Return the residuals and their slopes at x, zero where an interval is not used."""
    k = len(turns)
    used = inside(slave, turns, float(x[TAU]), among)
    rows = slice(None) if used.all() else used  # what is not picked is not copied
    some = turns[rows]
    phi_s, slope = slave.turned(some.start - x[TAU], some.end - x[TAU])
    C_ms = C_0 @ exp(x[MU])
    turned = some.phi_m @ C_ms
    residual, slopes, weighted, phi = (np.zeros((k, 3, *n)) for n in ((), (10,), (10,), ()))
    weighted[rows, :, TAU] = _by_master(some, turned)
    slopes[rows, :, TAU] = slope
    for one in (slopes, weighted):
        one[rows, :, MU] = -(1.0 + x[GAIN])[:, None] * cross_matrix(turned)
        one[rows, :, BIAS] = -some.dt[:, None, None] * np.eye(3)
        one[rows, :, GAIN] = -turned[:, None, :] * np.eye(3)
    more = np.r_[BIAS, GAIN]
    residual[rows], phi[rows] = phi_s - turned + slopes[rows][:, :, more] @ x[more], phi_s
    return Match(x, np.zeros((10, 10)), C_ms, used, residual, slopes, weighted, phi, False, held)


def _by_master(turns: Turns, turned: FloatArray) -> FloatArray:
    """Return how turns of the master [rad/s] change as they pass, by those before and after.

    `turned` (k, 3): its turns in the slave's axes [rad].
    """
    rate, middle = turned / turns.dt[:, None], (turns.start + turns.end) / 2
    out = np.zeros_like(turned)
    change = (rate[2:] - rate[:-2]) / (middle[2:] - middle[:-2])[:, None]
    near = turns.end[2:] - turns.start[:-2] < 1.5 * (turns.dt[2:] + turns.dt[1:-1] + turns.dt[:-2])
    out[1:-1] = np.where(near[:, None], -change * turns.dt[1:-1, None], 0.0)
    return out


def _weighed(now: Match, weights: tuple[FloatArray | None, FloatArray | None]) -> Match:
    """Return a match with its spectrum, and what the master says as far as both turned."""
    spectrum, gain = weights
    if spectrum is None or gain is None:
        return now
    weighted = now.weighted.copy()
    seen = np.r_[TAU, np.r_[MU], np.r_[GAIN]]  # by the motion: the bias needs none
    weighted[:, :, seen] = filtered(weighted[:, :, seen], gain)[: len(weighted)]
    return replace(now, weighted=weighted, spectrum=spectrum)


def whitened(found: Match, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals (m, 3) and slopes (m, 3, p) divided by their amplitude [1]; m >= k.

    `slope` (k, 3, p): slopes of the residuals.
    """
    if found.spectrum is None:
        sd = np.sqrt(np.mean(found.residual[found.used] ** 2)) or 1.0
        return found.residual / sd, slope / sd
    k = len(found.residual)
    both = np.concatenate([found.residual[..., None], slope], axis=2)
    flat = filtered(both, whitening(found.spectrum / k))
    return flat[..., 0], flat[..., 1:]


def _as_weighted(found: Match, factors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residuals, slopes, and what weights these, divided by their amplitude [1].

    `factors` (k, p): what stands in for the delay is so many times the delay, row by row.
    """

    def of(slope: FloatArray) -> FloatArray:
        many = slope[:, :, :1] * factors[:, None, :]
        return np.concatenate([many, slope[:, :, 1:]], axis=2)

    J = of(found.slope)
    e, both = whitened(found, np.concatenate([J, of(found.weighted)], axis=2))
    return e, both[:, :, : J.shape[2]], both[:, :, J.shape[2] :]


def _step(found: Match) -> tuple[FloatArray, float, float]:
    """Return the step of Gauss-Newton, and its length and that of the delay in deviations."""
    e, J, Z = _as_weighted(found, np.ones((len(found.residual), 1)))
    flat = Z.reshape(-1, Z.shape[2])
    inverse = _inverse(Z, J, found.held)
    step = -inverse @ (e.ravel() @ flat + found.held @ found.x)
    sd = float(np.linalg.norm(inverse[TAU] @ flat.T))
    part = abs(step[TAU]) / sd if sd > 0 else 0.0
    return step, float(np.linalg.norm(J @ step)), float(part)


def residual_step(found: Match, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far unknowns of the delay are from zero, and their covariance with the others.

    `factors` (k, p): what stands in for the delay is so many times the delay, row by row [1/unit].
    Returns `step` (p + 9,): step, the unknowns in place of the delay first; `cov` its covariance.
    """
    e, J, Z = _as_weighted(found, factors)
    held = np.zeros((J.shape[2], J.shape[2]))
    held[factors.shape[1] :, factors.shape[1] :] = found.held[1:, 1:]
    step = -_inverse(Z, J, held) @ (e.ravel() @ Z.reshape(-1, len(held)))
    return step, covariance(e + J @ step, J, held, weighted=Z)


def covariance(
    e: FloatArray, J: FloatArray, held: FloatArray | None = None, rows: int = 1,
    weighted: FloatArray | None = None,
) -> FloatArray:  # fmt: skip
    """Return the covariance of a weighted fit by its residuals as they are, shape (p, p).

    By what the solution would be without each of the rows, or without so many at once (jackknife):
    ``dx_r = A^-1 Z_r' (I - J_r A^-1 Z_r')^-1 e_r``, ``cov = sum dx dx'``; [1]. It holds where rows
    differ in noise. What is not seen is infinite.

    `e` (k, 3): whitened residuals of the solution [1]; `J` (k, 3, p): their slopes [1]; `held`
    (p, p) or None: information that is known beside [1]; `rows`: rows that are left out together:
    those that have an error in common [1]; `weighted` (k, 3, p): Z, what the slopes are weighted
    by, None for themselves [1].
    """
    p = J.shape[2]
    Z = J if weighted is None else weighted
    held = np.zeros((p, p)) if held is None else held
    blocks = len(e) // rows
    J_r, Z_r = (x[: blocks * rows].reshape(blocks, 3 * rows, p) for x in (J, Z))
    e_r = e[: blocks * rows].reshape(blocks, 3 * rows, 1)
    inverse = _inverse(Z, J, held)
    shift = J_r @ inverse
    left = (1.0 + 1e-9) * np.eye(3 * rows) - shift @ np.swapaxes(Z_r, 1, 2)
    dx = (inverse @ (np.swapaxes(Z_r, 1, 2) @ np.linalg.solve(left, e_r)))[:, :, 0]
    cov = dx.T @ dx + inverse @ held @ inverse.T
    blind = (np.einsum("kap,kap->p", J, J) + np.diag(held)) <= 0
    cov[blind, blind] = np.inf
    return np.asarray(cov)


def _with_bending(e: FloatArray, J: FloatArray, Z: FloatArray, held: FloatArray) -> FloatArray:
    """Return the covariance of delay, mounting and bias.

    Slow bending moves the mounting for many rows alike, the delay hardly.
    """
    cov = covariance(e, J, held, weighted=Z)
    slow = covariance(e, J, held, TOGETHER, Z)
    with np.errstate(invalid="ignore"):
        more = np.sqrt(np.fmax(np.diag(slow) / np.diag(cov), 1.0))
    more[TAU] = 1.0
    return np.asarray(cov * np.outer(more, more))


def _inverse(Z: FloatArray, J: FloatArray, held: FloatArray) -> FloatArray:
    """Return the inverse of ``Z' J + held``, where Z and J are (k, 3, p)."""
    z, j = (x.reshape(-1, x.shape[2]) for x in (Z, J))
    scale = np.outer(*(np.sqrt(np.einsum("kp,kp->p", x, x) + np.diag(held)) for x in (z, j)))
    scale[scale == 0] = 1.0
    return np.asarray(np.linalg.pinv((z.T @ j + held) / scale, rcond=1e-14) / scale.T)
