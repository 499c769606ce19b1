"""Unknowns of spins about a level axis: coefficients, grips, phases and noise.

The motion is that of `models.spin`. Phase, rate and acceleration of every sample are states, the
acceleration a random walk. They are eliminated exactly: with A the information of the states (a
band), X and S what coefficients and states do to white readings y, the information of a spin is
``X'X - X'S A^-1 S'X``.

References
----------
.. [1] Y. V. Bolotin, V. A. Savin, "Turntable IMU Calibration Algorithm Based on the Fourier
   Transform Technique", Sensors 23(2), 1045, 2023: the idea, by another estimator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.detect.steady import Spin
from foucault.kernels import banded
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.spin import GRIP, Grip, across, moved

RATE_WALKS = 4.0 ** np.arange(-3, 5)
"""Densities of the random walk of the angular acceleration that are tried [rad/s^2/sqrt(s)]."""

PROBES = 4  # Draws of noise that tell how many numbers the phase takes up [1].

WALK_TURNS = 12
"""The walk of the acceleration is told by means over a twelfth of a turn [1 / turn]."""

SWAY_TURNS = 4  # The sway is told by means over a quarter of a turn [1 / turn].


# -- a spin without its phase ----------------------------------------------------------------------


@dataclass(frozen=True)
class Sizes:
    """Noise of one spin."""

    sd: FloatArray  # (6,) of a reading: accelerometers [m/s^2], gyros [rad/s]
    walk: float  # density of the random walk of the acceleration [rad/s^2/sqrt(s)]


@dataclass(frozen=True)
class Passed:
    """A spin linearised at a point, its phase eliminated."""

    information: FloatArray  # (u, u) of its own unknowns [1 / SI^2]
    gradient: FloatArray  # (u,) [1 / SI]
    left: FloatArray  # (n, 6) white residuals, the phase smoothed [1]
    free: FloatArray  # (6,) readings less what the phase takes up of each; 0 without draws [1]
    path: FloatArray  # (n, 3) the phase where no unknown moves [SI]
    unit: FloatArray  # (3,) of the states, as they are scaled [1 / SI]
    X: FloatArray  # (n, 6, u) what unknowns do to white readings [1 / SI]
    S: FloatArray  # (n, 6, 3) what scaled states do to them [1]
    moves: FloatArray  # (n, 3, u) minus the derivative of the scaled states by the unknowns

    @cached_property
    def pull(self) -> FloatArray:
        """What a reading of one sd does to the gradient, shape (n, 6, u) [1 / SI]."""
        return np.asarray(self.X - self.S @ self.moves)


def _prior(spin: Spin, walk: float, path: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return information of the states as blocks on and below the diagonal, and its gradient.

    In units ``(1, 1/h, 1/h^2)`` of phase, rate and acceleration, h the step: well conditioned.
    """
    n, h = len(path), spin.step
    ratio = np.diff(spin.time) / h
    one = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1.0]])
    size = ratio[:, None] ** np.array([2.5, 1.5, 0.5]) * walk * h**2.5
    W = np.linalg.inv(one) / (size[:, :, None] * size[:, None, :])
    Phi = np.zeros((n - 1, 3, 3))
    Phi[:, [0, 1, 2], [0, 1, 2]] = 1.0
    Phi[:, 0, 1] = Phi[:, 1, 2] = ratio
    Phi[:, 0, 2] = ratio**2 / 2
    x = path * np.array([1.0, h, h**2])
    u = x[1:] - np.einsum("nij,nj->ni", Phi, x[:-1])
    Wu, WPhi = np.einsum("nij,nj->ni", W, u), W @ Phi
    on, below, slope = np.zeros((n, 3, 3)), -WPhi, np.zeros((n, 3))
    on[1:] += W
    on[:-1] += np.swapaxes(Phi, 1, 2) @ WPhi
    slope[1:] += Wu
    slope[:-1] -= np.einsum("nji,nj->ni", Phi, Wu)
    return on, below, slope


def _band(on: FloatArray, below: FloatArray) -> FloatArray:
    """Return blocks (n, 3, 3) and (n - 1, 3, 3) as the lower band of a matrix, shape (6, 3 n)."""
    n = len(on)
    out = np.zeros((6, n, 3))
    for a in range(3):
        for d in range(6):
            if a + d < 3:
                out[d, :, a] = on[:, a + d, a]
            elif a + d < 6:
                out[d, :-1, a] = below[:, a + d - 3, a]
    return out.reshape(6, 3 * n)


def passed(
    spin: Spin, grip: Grip, path: FloatArray, model: ImuModel, names: tuple[str, ...],
    sizes: Sizes, site: Site, draws: int = 0, last: Passed | None = None,
) -> Passed:  # fmt: skip
    """Linearise a spin about a `path` (n, 3) [SI] and eliminate the states.

    `draws`: of noise, to tell how much of it the phase takes up [1]; `last`: what is not needed any
    more, whose X is written over: new memory costs as much.
    """
    from scipy.linalg import cholesky_banded

    room = None if last is None else last.X
    miss, X, S = _white(spin, grip, path, model, names, sizes, site, room)
    n, p = len(miss), len(names)
    unit = np.array([1.0, spin.step, spin.step**2])
    on, below, slope = _prior(spin, sizes.walk, path)
    on += np.swapaxes(S, 1, 2) @ S
    probes = np.random.default_rng(n).standard_normal((n, 6, draws))
    u, S_t = p + GRIP, np.swapaxes(S, 1, 2)
    right = np.empty((n, 3, u + 1 + draws))
    np.matmul(S_t, X, out=right[:, :, :u])
    np.matmul(S_t, probes, out=right[:, :, u + 1 :])
    right[:, :, u] = np.einsum("nki,nk->ni", S, miss) - slope
    L = cholesky_banded(_band(on, below), lower=True, check_finite=False).T
    flat = right.reshape(3 * n, -1)
    banded.forward(L, flat)
    by_states = flat[:, :u].T @ flat[:, :u]
    banded.backward(L, flat)
    taken = S @ right[:, :, u:]
    rows, left = X.reshape(6 * n, u), miss - taken[:, :, 0]
    free = np.einsum("nkj,nkj->k", probes, probes - taken[:, :, 1:]) / max(draws, 1)
    return Passed(rows.T @ rows - by_states, rows.T @ left.ravel(), left, free,
                  path + right[:, :, u] / unit, unit, X, S, right[:, :, :u])  # fmt: skip


def _white(
    spin: Spin, grip: Grip, path: FloatArray, model: ImuModel, names: tuple[str, ...],
    sizes: Sizes, site: Site, room: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Return white residuals (n, 6), what unknowns (n, 6, u) and scaled states (n, 6, 3) do.

    `room`: for the second of these, (n, 6, u).
    """
    at, p = moved(grip, path, site, spin.shrunk(path[:, 1])), len(names)
    # Slopes by the unknowns take the rate as constant: along its own wander a scale factor would be
    # told by the walk of the phase, which has no scale.
    steadily = np.column_stack([path[:, 0], np.full((len(path), 2), [path[:, 1].mean(), 0.0])])
    mean = moved(grip, steadily, site, spin.shrunk(steadily[:, 1]))
    slopes, by = model.slopes(mean.f, mean.w, names), model.slopes(at.f, at.w, ())
    X = np.empty((len(path), 6, p + GRIP)) if room is None else room
    X[:, :3, :p], X[:, 3:, :p] = slopes.accel, slopes.gyro
    (f_by_grip, w_by_grip), (f_by_path, w_by_path) = mean.by_grip, at.by_path
    X[:, :3, p:] = slopes.accel_by_force @ f_by_grip
    X[:, 3:, p:] = slopes.gyro_by_force @ f_by_grip + slopes.gyro_by_rate @ w_by_grip
    S = np.empty((len(path), 6, 3))
    S[:, :3] = by.accel_by_force @ f_by_path
    S[:, 3:] = by.gyro_by_force @ f_by_path + by.gyro_by_rate @ w_by_path
    miss = spin.readings - np.column_stack(model.measure(at.f, at.w))
    X /= sizes.sd[:, None]
    S /= sizes.sd[:, None] * np.array([1.0, spin.step, spin.step**2])
    return miss / sizes.sd, X, S


def _averaged(spin: Spin, path: FloatArray, sizes: Sizes) -> tuple[Spin, FloatArray, Sizes]:
    """Return a spin, its path and its noise, averaged over parts of a turn."""
    k = max(round(2 * np.pi / WALK_TURNS / abs(spin.rate) / spin.step), 1)
    n = len(spin.time) // k

    def mean(x: FloatArray) -> FloatArray:
        return np.asarray(x[: n * k].reshape(n, k, *x.shape[1:]).mean(axis=1))

    few = replace(spin, time=mean(spin.time), readings=mean(spin.readings), many=spin.many * k)
    return few, mean(path), replace(sizes, sd=sizes.sd / np.sqrt(k))


def _likeliest_walk(
    spin: Spin, grip: Grip, path: FloatArray, model: ImuModel, sizes: Sizes, site: Site
) -> float:
    """Return the density of the random walk that is most likely, the coefficients as they are.

    By means over parts of a turn: a tool's rate is no random walk of its acceleration, and what
    quiet gyros tell of it from sample to sample is not how it varies while gravity turns.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded

    spin, path, sizes = _averaged(spin, path, sizes)
    miss, _, S = _white(spin, grip, path, model, (), sizes, site)
    x = path * np.array([1.0, spin.step, spin.step**2])
    right, gram = np.einsum("nki,nk->ni", S, miss), np.swapaxes(S, 1, 2) @ S
    of_one, last = _prior(spin, 1.0, path), len(RATE_WALKS) - 1

    @cache
    def unlikely(k: int) -> float:
        on, below, slope = (part / RATE_WALKS[k] ** 2 for part in of_one)
        band = cholesky_banded(_band(on + gram, below), lower=True, check_finite=False)
        b = (right - slope).ravel()
        gained = b @ cho_solve_banded((band, True), b, check_finite=False)
        walked = np.einsum("ni,ni", x, slope)  # the prior is quadratic: its gradient times x
        det = 2 * np.sum(np.log(band[0])) + 6 * (len(x) - 1) * np.log(RATE_WALKS[k])
        return float(walked - gained + det)

    k, best = -1, int(np.abs(np.log(RATE_WALKS / sizes.walk)).argmin())
    while k != best:  # downhill from the walk before
        k, best = best, min((max(best - 1, 0), best, min(best + 1, last)), key=unlikely)
    log = np.log(RATE_WALKS)
    if 0 < k < last:
        a, b, c = (unlikely(k + j) for j in (-1, 0, 1))
        return float(np.exp(log[k] + (log[1] - log[0]) / 2 * (a - c) / max(a - 2 * b + c, 1e-9)))
    return float(RATE_WALKS[k])


# -- where to start --------------------------------------------------------------------------------


def first_phase(spin: Spin, C_bm: FloatArray) -> tuple[FloatArray, float, float]:
    """Return a path (n, 3) [SI], the size of gravity that turns [m/s^2], and the slope of phases.

    `C_bm` (3, 3): axes of the mounting [1]. The slope is of the phase by the accelerometers over
    that by the gyros: minus one where they turn unlike.
    """
    from scipy.ndimage import uniform_filter1d

    x = (spin.readings[:, :3] - spin.readings[:, :3].mean(axis=0)) @ C_bm
    y = uniform_filter1d(x, max(round(0.3 / (abs(spin.rate) * spin.step)), 1), axis=0)
    w = spin.readings[:, 3:] @ C_bm[:, 2]
    turned = np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2 * np.diff(spin.time))])
    seen = np.unwrap(np.arctan2(-y[:, 1], y[:, 0]))
    slope = float((seen[-1] - seen[0]) / (turned[-1] - turned[0]))
    width = max(round(np.pi / (abs(spin.rate) * spin.step)), 3)
    off = np.unwrap(np.angle(np.exp(1j * (seen - turned))))
    off = uniform_filter1d(off, width, mode="nearest")
    smooth = uniform_filter1d(w, max(width // 6, 1), mode="nearest")
    slow = uniform_filter1d(np.gradient(smooth, spin.time), max(width // 3, 1), mode="nearest")
    size = float(np.sqrt(2 * np.mean(x[:, 0] ** 2 + x[:, 1] ** 2) / 2))
    return np.column_stack([turned + off, smooth, slow]), size, slope


# -- a session -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Point:
    """Where an estimate is."""

    model: ImuModel
    grips: tuple[Grip, ...]
    paths: tuple[FloatArray, ...]  # (n, 3) of every spin [SI]
    sizes: tuple[Sizes, ...]


@dataclass(frozen=True)
class Solved:
    """A session solved by itself: its point, and every spin about it."""

    spins: tuple[Spin, ...]
    names: tuple[str, ...]
    site: Site
    point: Point
    each: tuple[Passed, ...]
    converged: bool

    @property
    def unknowns(self) -> int:
        """How many there are, grips and all."""
        return len(self.names) + GRIP * len(self.point.grips)

    @property
    def level_sd(self) -> float:
        """Sd of the level Earth rate along and across an axis of unknown azimuth [1]."""
        latitude = self.site.latitude
        if latitude is None:
            return float(1 / np.sqrt(3.0))
        return max(float(np.cos(latitude) / np.sqrt(2.0)), 1e-3)

    def own(self, k: int) -> IntArray:
        """Return which of all unknowns are those of spin `k` [1]."""
        p, m = len(self.names), self.spins[k].mounting
        return np.append(np.arange(p), p + GRIP * m + np.arange(GRIP))


def started(
    spins: tuple[Spin, ...], axes: list[FloatArray], paths: tuple[FloatArray, ...],
    declared: ImuNoise | None,
) -> Point:  # fmt: skip
    """Return where to start: an instrument without errors, noise as readings seem to have it.

    `axes`: of the mountings, (3,) each [1]; `paths`: of the spins by `first_phase`, (n, 3) each
    [SI].
    """
    sizes = tuple(Sizes(np.maximum(_rough(s), floor(s, declared)), 1.0) for s in spins)
    return Point(ImuModel(), tuple(Grip(across(axis)) for axis in axes), paths, sizes)


def solve(
    spins: tuple[Spin, ...], start: Point, names: tuple[str, ...], site: Site,
    declared: ImuNoise | None, most: int = 12,
) -> Solved:  # fmt: skip
    """Find coefficients, grips, phases and the noise of every spin; `most`: passes [1]."""
    at = Solved(spins, names, site, start, (), False)
    last, size = np.inf, np.inf
    for count in range(most):
        finds = count in (FIRST - 1, FIRST)
        at = replace(at, each=_every(at, PROBES if finds else 0))
        N, g = _sums(at)
        unit = np.sqrt(np.maximum(np.diag(N), 1e-300))
        step = np.linalg.lstsq(N / np.outer(unit, unit), g / unit, rcond=1e-15)[0] / unit
        size = float(np.sqrt(max(step @ N @ step, 0.0)))
        if count > FIRST and (size < SETTLED or size > 0.5 * last):
            break
        at = replace(at, point=_stepped(at, step))
        last = size
        if finds:
            at, last = replace(at, point=replace(at.point, sizes=_noise(at, declared))), np.inf
    return replace(at, converged=size < UNSETTLED)


FIRST = 2  # Steps before and after which noise is found [1].

SETTLED, UNSETTLED = 1e-3, 0.1
"""Steps shorter than the first are none; what ends with a longer one than the second has not
converged [sd]."""


def _rough(spin: Spin) -> FloatArray:
    """Return the noise of readings by their third differences, (6,) [SI]."""
    return np.asarray(np.std(np.diff(spin.readings, 3, axis=0), axis=0) / np.sqrt(20.0))


def floor(spin: Spin, declared: ImuNoise | None) -> FloatArray:
    """Return the noise of a reading that the sensors have at least, (6,) [SI]."""
    if declared is None:
        return np.asarray(np.maximum(spin.rounding, np.repeat([1e-9, 1e-11], 3)))
    white = np.repeat([declared.accel.white, declared.gyro.white], 3)
    step = np.repeat([declared.accel.quantisation, declared.gyro.quantisation], 3)
    return np.asarray(
        np.maximum(np.sqrt(white**2 / spin.step + step**2 / 12), [1e-9] * 3 + [1e-11] * 3)
    )


def _every(at: Solved, draws: int) -> tuple[Passed, ...]:
    p = at.point
    return tuple(
        passed(s, p.grips[s.mounting], path, p.model, at.names, sizes, at.site, draws, last)
        for s, path, sizes, last in zip(
            at.spins, p.paths, p.sizes, at.each or (None,) * len(at.spins), strict=True
        )
    )


def _sums(at: Solved) -> tuple[FloatArray, FloatArray]:
    N, g = np.zeros((at.unknowns, at.unknowns)), np.zeros(at.unknowns)
    for k, one in enumerate(at.each):
        own = at.own(k)
        N[np.ix_(own, own)] += one.information
        g[own] += one.gradient
    for m, grip in enumerate(at.point.grips):
        mine = len(at.names) + GRIP * m + np.array([5, 6])
        N[mine, mine] += at.level_sd**-2
        g[mine] -= grip.level / at.level_sd**2
    return N, g


def _stepped(at: Solved, step: FloatArray) -> Point:
    p, n = at.point, len(at.names)
    grips = tuple(g.moved(step[n + GRIP * m : n + GRIP * (m + 1)]) for m, g in enumerate(p.grips))
    paths = tuple(
        one.path - one.moves @ step[at.own(k)] / one.unit for k, one in enumerate(at.each)
    )
    return Point(p.model.moved(at.names, step[:n]), grips, paths, p.sizes)


def _noise(at: Solved, declared: ImuNoise | None) -> tuple[Sizes, ...]:
    """Return the noise of every spin by what is left, each over what the phase left of it.

    Declared noise stands where what is left does not clearly exceed it; what exceeds is vibration.
    """
    out = []
    for spin, path, old, one in zip(at.spins, at.point.paths, at.point.sizes, at.each, strict=True):
        sd = old.sd * np.sqrt(np.sum(one.left**2, axis=0) / np.maximum(one.free, 1.0))
        least = floor(spin, declared)
        chance = 1 + CHANCE / np.sqrt(2 * np.maximum(one.free, 1.0))
        sd = np.where(sd > least * chance, sd, least)
        grip, now = at.point.grips[spin.mounting], replace(old, sd=sd)
        walk = _likeliest_walk(spin, grip, path, at.point.model, now, at.site)
        out.append(replace(now, walk=walk))
    return tuple(out)


CHANCE = 4.0  # By so many sd what is left has to exceed noise to be vibration, or sway [1].


# -- what is judged --------------------------------------------------------------------------------


def leaning(at: Solved) -> tuple[FloatArray, FloatArray]:
    """Return how the spin axis tilts within every spin, beyond noise.

    By what is left of the accelerometers along the axis over gravity, in quarters of a turn.
    Returns its sd (k,) [rad], and its slope with the noise of that, (k, 2) [rad/s].
    """
    sway, slope = np.zeros(len(at.spins)), np.zeros((len(at.spins), 2))
    for k, spin in enumerate(at.spins):
        own, e = at.point.sizes[k].sd[:3], at.point.grips[spin.mounting].C_bm[:, 2]
        many = max(round(2 * np.pi / SWAY_TURNS / abs(spin.rate) / spin.step), 1)
        n = len(spin.time) // many
        tilt = ((at.each[k].left[: n * many, :3] * own) @ e / at.site.gravity).reshape(n, many)
        tilt = tilt.mean(axis=1)
        noise = float(np.sqrt((e**2) @ own**2 / many)) / at.site.gravity
        chance = noise**2 * (1 + CHANCE * np.sqrt(2 / n))
        sway[k] = np.sqrt(max(float(np.mean(tilt**2)) - chance, 0.0))
        t = spin.time[: n * many].reshape(n, many).mean(axis=1)
        t = t - t.mean()
        slope[k] = (t @ tilt) / (t @ t), noise / np.sqrt(t @ t)
    return sway, slope
