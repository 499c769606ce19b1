"""Where is north: the attitude of a set-up from the four numbers of its readings.

With ``M = w_y / w_ie`` and ``N = w_x / w_ie`` the third component of the Earth's rate has the size
``W = s sqrt(1 - M^2 - N^2)``, or follows from the latitude; pitch and roll come from gravity, and

    X = cos g N + sin g W,    q = cos g W - sin g N,    Y = cos t M - sin t q,
    Z = sin t M + cos t q,    heading = atan2(-X, Y),   L = atan2(Z, hypot(X, Y))

`closed_form` is that. `solve` is maximum likelihood: the four numbers with their covariance, and
the latitude as unknown, known roughly or known, decide together. It starts from every root and
keeps what else would fit, so that an ambiguity is seen and not guessed away.

References
----------
.. [1] Liu Cheng, "Parameter compensation algorithm for four-position FOG north seeker",
   Piezoelectrics & Acoustooptics, 2016, eqs. (20)-(33), (48), (49); the sign of the root in (33)
   is that of the rate along z_b.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.estimate.north_reduction import UNSEEN, Pairs
from foucault.models.earth import EARTH_RATE
from foucault.models.north_seeker import Compensation, earth_rate_b, up_b

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Hemisphere = Literal["north", "south"]

ROUNDS = 60
"""Gauss-Newton steps at most [1]."""

EXACT = 1e-9
"""Standard deviation of a latitude that is known exactly [rad]."""

DISTINCT = 1e-5
"""Solutions nearer than this are one [rad]."""

PLAUSIBLE = 25.0
"""Another solution is possible where its sum of squares is larger by less than this, five sd: where
the rate along z_b is small, errors of the latitude are far from Gaussian [1]."""

AGAINST = 1e3
"""What speaks against the opposite hemisphere, a heading opposite to the rough one, or a case that
hangs upside down, which two components of gravity cannot tell from one that stands [1]."""

DEFAULT = 1e-3
"""What speaks against the other sign of the rate along z_b, where both give the same hemisphere:
less than anything that is known, more than rounding [1]."""

LOST = 10.0
"""The rate along z_b is lost in the noise where its square is below this many sd of the horizontal
rate [1]: five sd of its own."""

CHUNK = 65536
"""Set-ups that one thread takes at a time [1]."""

SOURCES = {
    "gyro.misalignment": "coupling",
    "gyro.scale": "scale factor",
    "gyro.bias": "calibration: bias",
    "accel": "tilt: calibration",
}
"""Coefficients by the beginning of their names, and what the budget calls them."""

LATITUDE = "latitude"


@dataclass(frozen=True)
class Fixes:
    """Solutions of m set-ups; angles are heading, pitch, roll and latitude.

    Attributes
    ----------
    angles : ndarray, shape (m, 4)
        Heading clockwise from north, pitch, roll, latitude [rad].
    cov : ndarray, shape (m, 4, 4)
        Their covariance [rad^2].
    sources : dict of str to ndarray, shape (m, 4)
        Variance of each angle by source [rad^2].
    square : ndarray, shape (m,)
        Sum of squares that the solution leaves; chi-square with one degree of freedom where the
        latitude was known beforehand, else 0 [1].
    misfit : ndarray, shape (m, 4)
        The four numbers minus what is predicted [SI].
    other : ndarray, shape (m, 4)
        The next best solution, NaN where there is none [rad].
    other_square : ndarray, shape (m,)
        Its sum of squares with what speaks against it, infinite where there is none [1].
    ambiguous : ndarray of bool, shape (m,)
        Where the other solution is possible, and its heading another one.
    status : ndarray of int, shape (m,)
        0 where solved; else see `kernels.north_seeking`.
    clamped : ndarray of bool, shape (m,)
        Where the horizontal rate exceeds the Earth's.
    """

    angles: FloatArray
    cov: FloatArray
    sources: dict[str, FloatArray]
    square: FloatArray
    misfit: FloatArray
    other: FloatArray
    other_square: FloatArray
    ambiguous: npt.NDArray[np.bool_]
    status: npt.NDArray[np.int8]
    clamped: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (m, 4) [rad]."""
        return np.asarray(np.sqrt(np.einsum("nii->ni", self.cov)))


@dataclass(frozen=True)
class Known:
    """What is known of the place and of the attitude before the readings.

    Attributes
    ----------
    gravity : float
        [m/s^2].
    latitude : float or None
        Positive north [rad]; None where unknown.
    latitude_sd : float
        Its standard deviation [rad].
    hemisphere : {"north", "south"}
        Decides between roots where the latitude is unknown.
    near : float, ndarray of shape (m,), or None
        Rough heading, which decides between solutions that fit alike [rad].
    level_sd : float or None
        How far from level the case may stand, about each axis; None where only the accelerometers
        know [rad].
    """

    gravity: float
    latitude: float | None = None
    latitude_sd: float = 0.0
    hemisphere: Hemisphere = "north"
    near: float | FloatArray | None = None
    level_sd: float | None = None


def closed_form(
    rate: FloatArray,
    up: FloatArray,
    *,
    latitude: float | None,
    rate_sd: float,
    up_sd: float,
    latitude_sd: float = 0.0,
    hemisphere: Hemisphere = "north",
    threads: int = 2,
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int8]]:
    """Solve many set-ups in closed form, with standard deviations.

    Parameters
    ----------
    rate : ndarray, shape (n, 2)
        Compensated rate along x_b and y_b [rad/s].
    up : ndarray, shape (n, 2)
        Compensated specific force along x_b and y_b over gravity [1].
    latitude : float or None
        Of all of them [rad]; None where unknown.
    rate_sd, up_sd : float
        Standard deviation of each component of `rate` [rad/s] and `up` [1].
    latitude_sd : float
        Of the latitude [rad].
    hemisphere : {"north", "south"}
        Sign of the rate along z_b where the latitude is unknown; see `solve` for other cases.
    threads : int, shape ()
        Threads to use [1].

    Returns
    -------
    angles : ndarray, shape (n, 4)
        Heading, pitch, roll, latitude [rad].
    sd : ndarray, shape (n, 4)
        Their standard deviations [rad].
    status : ndarray of int, shape (n,)
        See `kernels.north_seeking`.
    """
    from foucault.kernels.north_seeking import closed_form_batch

    place = np.nan if latitude is None else latitude
    sign = 1.0 if hemisphere == "north" else -1.0
    n = len(rate)
    angles, sd, status = np.empty((n, 4)), np.empty((n, 4)), np.empty(n, np.int8)

    def part(rows: slice) -> None:
        closed_form_batch(
            rate[rows], up[rows], place, sign, EARTH_RATE, rate_sd**2, up_sd**2, latitude_sd**2,
            angles[rows], sd[rows], status[rows],
        )  # fmt: skip

    _spread(part, n, threads)
    return angles, sd, status


def _spread(part: Callable[[slice], None], n: int, threads: int) -> None:
    """Call `part` with slices of n rows, in threads: the kernels hold no lock."""
    slices = [slice(i, min(i + CHUNK, n)) for i in range(0, n, CHUNK)]
    if threads < 2 or len(slices) < 2:
        for rows in slices:
            part(rows)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(part, slices))


def solve(pairs: Pairs, known: Known, compensation: Compensation | None = None) -> Fixes:
    """Find the attitude of every set-up by maximum likelihood.

    Parameters
    ----------
    pairs : Pairs
        Four numbers of each [SI].
    known : Known
        Place, and what decides between solutions.
    compensation : Compensation or None
        Errors of the instrument with covariance; None takes an instrument without errors.
    """
    compensation = compensation or Compensation()
    pairs = _levelled(pairs, known)
    starts, horizontal = _starts(pairs, known, compensation)
    best = _best(pairs, pairs.cov, known, compensation, starts)
    more = _calibration_sources(best.angles, known, compensation)
    sources = pairs.sources | more
    if more:  # they change the weights a little: once more, from what was found
        again = [best.angles, np.where(np.isfinite(best.other), best.other, best.angles)]
        best = _best(pairs, np.asarray(sum(sources.values())), known, compensation, again)
    budget = {
        name: np.einsum("nai,nij,naj->na", best.gain[..., :4], S, best.gain[..., :4])
        for name, S in sources.items()
    }
    if known.latitude is not None:
        budget[LATITUDE] = best.gain[..., 4] ** 2 * max(known.latitude_sd, EXACT) ** 2
    else:
        _widen(best, horizontal, pairs, known, compensation)
    clamped = horizontal > 1.0
    ambiguous = (best.other_square < PLAUSIBLE + best.square) & (
        np.abs(turned(best.other[:, 0] - best.angles[:, 0])) > np.sqrt(best.cov[:, 0, 0])
    )
    return Fixes(
        best.angles, best.cov, budget, best.square, pairs.values - best.predicted, best.other,
        best.other_square, ambiguous, best.status, clamped,
    )  # fmt: skip


def turned(angle: FloatArray) -> FloatArray:
    """Return `angle`, shape (...) [rad], between -pi and pi."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def _widen(
    best: _Best, horizontal: FloatArray, pairs: Pairs, known: Known, compensation: Compensation
) -> None:
    """Where the rate along z_b is lost in the noise, let the uncertainty cover both its signs.

    W = sqrt(1 - r^2) has no slope where r, the horizontal rate, is 1: there W is nothing better
    than sqrt(2 k) for an error k of r.
    """
    direction = pairs.values[:, :2] / np.maximum(
        np.linalg.norm(pairs.values[:, :2], axis=1, keepdims=True), 1e-300
    )
    sd = np.sqrt(np.einsum("ni,nij,nj->n", direction, pairs.cov[:, :2, :2], direction)) / EARTH_RATE
    lost = (1.0 - horizontal**2 < LOST * sd) & np.isfinite(best.angles[:, 0])
    if not lost.any():
        return
    N, M, x, s = compensated(pairs.values[lost], known.gravity, compensation).T
    excess = np.maximum(np.hypot(N, M), 1.0)
    W = np.sqrt(LOST * sd[lost])
    pitch, roll = _tilt(x, s)
    ends = [_attitude_of(N / excess, M / excess, sign * W, pitch, roll) for sign in (1.0, -1.0)]
    across = np.stack([-direction[lost, 1], direction[lost, 0]], 1)
    turn = np.einsum("ni,nij,nj->n", across, pairs.cov[lost, :2, :2], across) / EARTH_RATE**2
    tilt = np.einsum("nii->n", pairs.cov[lost, 2:, 2:]) / known.gravity**2
    for axis, k, other in ((0, 0, turn), (3, 1, tilt)):
        half = turned(ends[0][k] - ends[1][k]) / 2
        best.cov[lost, axis, :], best.cov[lost, :, axis] = 0.0, 0.0
        best.cov[lost, axis, axis] = half**2 + other
    best.status[lost] = 1


def _levelled(pairs: Pairs, known: Known) -> Pairs:
    """Weigh the specific forces with how level the case stands, as far as that is known."""
    if known.level_sd is None:
        return pairs
    level = (known.gravity * known.level_sd) ** 2 * np.eye(2)
    T = np.broadcast_to(np.eye(4), (len(pairs), 4, 4)).copy()
    T[:, 2:, 2:] = level @ np.linalg.inv(level + pairs.cov[:, 2:, 2:])
    rest = np.eye(4) - T
    prior = np.zeros((4, 4))
    prior[2:, 2:] = level
    sources = {k: T @ S @ np.swapaxes(T, 1, 2) for k, S in pairs.sources.items()}
    sources["tilt: level"] = rest @ prior @ np.swapaxes(rest, 1, 2)
    values = np.einsum("nij,nj->ni", T, pairs.values)
    return replace(pairs, values=values, sources={k: v for k, v in sources.items() if v.any()})


def compensated(values: FloatArray, gravity: float, compensation: Compensation) -> FloatArray:
    """Return the four numbers without the errors of the instrument, shape (m, 4) [1].

    Parameters
    ----------
    values : ndarray, shape (m, 4)
        As measured [SI].
    gravity : float
        [m/s^2].
    compensation : Compensation
        Errors of the instrument; couplings of z are left in, as they need the attitude.

    Returns
    -------
    ndarray, shape (m, 4)
        Rates over the Earth's rate, specific forces over gravity, along x_b and y_b [1].
    """
    model = compensation.model
    rate = np.linalg.solve(model.gyro_matrix[:2, :2], (values[:, :2] - model.gyro_bias[:2]).T).T
    force = np.linalg.solve(model.accel_matrix[:2, :2], (values[:, 2:] - model.accel_bias[:2]).T).T
    return np.hstack([rate / EARTH_RATE, force / gravity])


def _starts(
    pairs: Pairs, known: Known, compensation: Compensation
) -> tuple[list[FloatArray], FloatArray]:
    """Return where to start from, each (m, 4), and the horizontal rate over the Earth's (m,)."""
    N, M, x, s = compensated(pairs.values, known.gravity, compensation).T
    pitch, roll = _tilt(x, s)
    seen = pairs.cov[:, [0, 1], [0, 1]].max(axis=1) < 1e-3 * UNSEEN * EARTH_RATE**2
    horizontal = np.where(seen, np.hypot(N, M), 0.0)
    starts = []
    square = np.sqrt(np.maximum(1 - M**2 - N**2, 1e-6))
    for sign in (1.0, -1.0) if known.hemisphere == "north" else (-1.0, 1.0):
        heading, latitude = _attitude_of(N, M, sign * square, pitch, roll)
        if known.latitude is not None:
            latitude = np.full_like(latitude, known.latitude)
        starts.append(np.stack([heading, pitch, roll, latitude], 1))
    if known.latitude is not None and not seen.all():
        for heading in np.radians(np.arange(0.0, 360.0, 30.0)):
            same = np.ones_like(pitch)
            starts.append(np.stack([heading * same, pitch, roll, known.latitude * same], 1))
    return starts, horizontal


def _tilt(x: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pitch and roll of two components of up, made shorter than 1 where they are not."""
    shorter = np.maximum(np.hypot(s, x) / 0.99999, 1.0)
    s, x = s / shorter, x / shorter
    return np.arcsin(s), np.arctan2(-x, np.sqrt(np.maximum(1 - s**2 - x**2, 0.0)))


def _attitude_of(
    N: FloatArray, M: FloatArray, W: FloatArray, pitch: FloatArray, roll: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return heading and latitude of three components of the Earth's rate."""
    X = np.cos(roll) * N + np.sin(roll) * W
    q = np.cos(roll) * W - np.sin(roll) * N
    Y = np.cos(pitch) * M - np.sin(pitch) * q
    Z = np.sin(pitch) * M + np.cos(pitch) * q
    return np.arctan2(-X, Y) % (2 * np.pi), np.arctan2(Z, np.hypot(X, Y))


@dataclass
class _Best:
    """The best solution of each set-up, and the next best."""

    angles: FloatArray
    cov: FloatArray
    gain: FloatArray
    square: FloatArray
    predicted: FloatArray
    status: npt.NDArray[np.int8]
    other: FloatArray
    other_square: FloatArray


def _best(
    pairs: Pairs, covariance: FloatArray, known: Known, compensation: Compensation,
    starts: list[FloatArray],
) -> _Best:  # fmt: skip
    found = [_from(pairs, covariance, known, compensation, start) for start in starts]
    angles = np.stack([f[0] for f in found])
    solved = np.stack([f[5] == 0 for f in found])
    square = np.stack([np.where(np.isfinite(f[3]), f[3], np.inf) for f in found])
    latitude_var = np.stack([f[1][:, 3, 3] for f in found])
    # An unfinished solution is better than none, where no other is better.
    rank = square + _preference(angles, latitude_var, known) + np.where(solved, 0.0, 1e6)
    order = np.argsort(rank, axis=0, kind="stable")
    each = np.arange(len(pairs))
    pick = order[0]
    best = angles[pick, each]
    other, other_square = np.full_like(best, np.nan), np.full(len(pairs), np.inf)
    for k in order[1:][::-1]:  # the best of those that differ is written last
        there = angles[k, each]
        apart = _apart(there, best)
        take = (apart > DISTINCT) & solved[k, each]
        other[take], other_square[take] = there[take], rank[k, each][take]
    cov, gain, square, predicted, status = (
        np.stack([f[i] for f in found])[pick, each] for i in (1, 2, 3, 4, 5)
    )
    return _Best(best, cov, gain, square, predicted, status, other, other_square)


def _apart(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return how far two solutions are apart in heading or latitude, shape (m,) [rad]."""
    return np.maximum(np.abs(turned(a[:, 0] - b[:, 0])), np.abs(a[:, 3] - b[:, 3]))


def _preference(angles: FloatArray, latitude_var: FloatArray, known: Known) -> FloatArray:
    """Return what speaks against solutions that fit alike, in squares of a sd, (k, m) [1]."""
    out = np.where(np.abs(angles[..., 2]) > np.pi / 2, AGAINST, 0.0)
    if known.latitude is None:  # no reading knows the hemisphere
        sign = 1.0 if known.hemisphere == "north" else -1.0
        beyond = np.maximum(-sign * angles[..., 3], 0.0)
        out += np.minimum(beyond**2 / np.maximum(latitude_var, EXACT**2), AGAINST)
        along_z = earth_rate_b(*np.moveaxis(angles, -1, 0))[..., 2]
        out += np.where(sign * along_z < 0, DEFAULT, 0.0)
    if known.near is not None:
        out += AGAINST * (1 - np.cos(angles[..., 0] - known.near))
    return out


def _from(
    pairs: Pairs, cov: FloatArray, known: Known, compensation: Compensation, start: FloatArray
) -> tuple[FloatArray, ...]:
    from foucault.kernels.north_seeking import likelihood_batch

    model = compensation.model
    A = np.vstack([model.gyro_matrix[:2], model.accel_matrix[:2]])
    b = np.concatenate([model.gyro_bias[:2], model.accel_bias[:2]])
    m = len(pairs)
    latitude = np.full(m, 0.0 if known.latitude is None else known.latitude)
    sd = np.full(m, np.inf if known.latitude is None else max(known.latitude_sd, EXACT))
    found: tuple[FloatArray, ...] = likelihood_batch(
        pairs.values, cov, start, A, b, np.full(m, known.gravity), EARTH_RATE, latitude, sd, ROUNDS
    )
    return found


def _calibration_sources(
    angles: FloatArray, known: Known, compensation: Compensation
) -> dict[str, FloatArray]:
    """What the uncertainty of the coefficients does to the four numbers, by kind."""
    c = compensation.coefficients
    if c.cov is None or not len(c):
        return {}
    finite = np.where(np.isfinite(angles), angles, 0.0)
    w_b = earth_rate_b(*finite.T)
    J = compensation.slopes(w_b, known.gravity * up_b(finite[:, 1], finite[:, 2]))
    # Coefficients are tied to one another: a coupling that a level session cannot show, and the
    # bias that made up for it. In the order of SOURCES each counts with what follows it, so that
    # the parts are independent and none is negative.
    kinds = [next(k for k in SOURCES if name.startswith(k)) for name in c.names]
    order = sorted(range(len(c)), key=lambda i: list(SOURCES).index(kinds[i]))
    sd = np.sqrt(np.maximum(np.diag(c.cov), 1e-300))[order]
    tied = c.cov[np.ix_(order, order)] / np.outer(sd, sd) + 1e-12 * np.eye(len(c))
    effect = J[..., order] @ (sd[:, None] * np.linalg.cholesky(tied))
    out: dict[str, FloatArray] = {}
    for start, words in SOURCES.items():
        mine = effect[..., [kinds[i] == start for i in order]]
        if mine.any():
            out[words] = np.einsum("nik,njk->nij", mine, mine)
    return out
