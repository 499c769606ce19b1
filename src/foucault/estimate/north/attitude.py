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

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.estimate.north.reduction import Pairs
from foucault.estimate.north.roots import (
    EXACT,
    PLAUSIBLE,
    Best,
    Hemisphere,
    Known,
    best_of,
    compensated,
    starts_of,
    widen,
)
from foucault.models.earth import EARTH_RATE
from foucault.models.north_seeker import Compensation, earth_rate_b, up_b
from foucault.models.rotation import turned

__all__ = [
    "LATITUDE", "PLAUSIBLE", "Fixes", "Hemisphere", "Known", "closed_form", "compensated",
    "level_square", "solve",
]  # fmt: skip

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
    """Solutions of m set-ups; angles are heading, pitch, roll and latitude."""

    angles: FloatArray  # (m, 4) heading clockwise from north, pitch, roll, latitude [rad]
    cov: FloatArray  # (m, 4, 4) their covariance [rad^2]
    sources: dict[str, FloatArray]  # (m, 4) variance of each angle by source [rad^2]
    # (m,) sum of squares that the solution leaves; chi-square with one degree of freedom where the
    # latitude was known beforehand, else 0 [1]
    square: FloatArray
    other: FloatArray  # (m, 4) the next best solution, NaN where there is none [rad]
    # (m,) its sum of squares with what speaks against it, infinite where there is none [1]
    other_square: FloatArray
    # (m,) where the other solution is possible, and its heading another one
    ambiguous: npt.NDArray[np.bool_]
    status: npt.NDArray[np.int8]  # (m,) 0 where solved; else see `kernels.north_seeking`
    clamped: npt.NDArray[np.bool_]  # (m,) where the horizontal rate exceeds the Earth's

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (m, 4) [rad]."""
        return np.asarray(np.sqrt(np.einsum("nii->ni", self.cov)))


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

    `rate` (n, 2): compensated rate along x_b and y_b [rad/s]; `up` (n, 2): compensated specific
    force along x_b and y_b over gravity [1]; `latitude`: of all of them, None where unknown [rad];
    `rate_sd`, `up_sd`: standard deviation of each component of `rate` [rad/s] and `up` [1];
    `latitude_sd`: of the latitude [rad]; `hemisphere`: sign of the rate along z_b where the
    latitude is unknown, see `solve` for other cases; `threads`: threads to use [1]. Returns
    `angles` (n, 4): heading, pitch, roll, latitude [rad]; `sd` (n, 4): their standard deviations
    [rad]; `status` (n,): see `kernels.north_seeking`.
    """
    from foucault.kernels.north_seeking import closed_form_batch

    place = np.nan if latitude is None else latitude
    sign = 1.0 if hemisphere == "north" else -1.0
    n = len(rate)
    rate, up = np.ascontiguousarray(rate), np.ascontiguousarray(up)  # one layout, one compilation
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

    `pairs`: four numbers of each [SI]; `compensation`: errors of the instrument with covariance,
    None takes an instrument without errors.
    """
    compensation = compensation or Compensation()
    pairs, shared = _levelled(pairs, known, compensation)
    starts, horizontal = starts_of(pairs, known, compensation)
    best = best_of(pairs, pairs.cov, known, compensation, starts)
    more = _calibration_sources(best.angles, known, compensation, shared)
    sources = pairs.sources | more
    if more:  # they change the weights a little: once more, from what was found
        again = [best.angles, np.where(np.isfinite(best.other), best.other, best.angles)]
        best = best_of(pairs, np.asarray(sum(sources.values())), known, compensation, again)
    budget = {
        name: np.einsum("nai,nij,naj->na", best.gain[..., :4], S, best.gain[..., :4])
        for name, S in sources.items()
    }
    if known.latitude is not None:
        sd = np.reshape(np.maximum(known.latitude_sd, EXACT), (-1, 1))
        budget[LATITUDE] = best.gain[..., 4] ** 2 * sd**2
    else:
        widen(best, horizontal, pairs, known, compensation, budget)
    return Fixes(
        best.angles, best.cov, budget, best.square, best.other,
        best.other_square, _ambiguous(best, known), best.status, horizontal > 1.0,
    )  # fmt: skip


def _ambiguous(best: Best, known: Known) -> npt.NDArray[np.bool_]:
    """Tell where the other solution is possible, and says something else."""
    sd = np.sqrt(np.einsum("nii->ni", best.cov))
    apart = np.abs(turned(best.other[:, 0] - best.angles[:, 0])) > sd[:, 0]
    if known.latitude is None:
        apart |= np.abs(best.other[:, 3] - best.angles[:, 3]) > sd[:, 3]
    return np.asarray(apart & (best.other_square < PLAUSIBLE + best.rank))


def _levelled(pairs: Pairs, known: Known, compensation: Compensation) -> tuple[Pairs, FloatArray]:
    """Weigh the specific forces with how level the case stands, as far as that is known.

    Returns the pairs, and how much of the specific forces as measured is in theirs, (m, 4, 4).
    """
    T = np.broadcast_to(np.eye(4), (len(pairs), 4, 4)).copy()
    if known.level_sd is None:
        return pairs, T
    g = np.reshape(known.gravity, (-1, 1, 1))  # of all, or of each
    level = (g * known.level_sd) ** 2 * np.eye(2)
    T[:, 2:, 2:] = level @ np.linalg.inv(level + pairs.cov[:, 2:, 2:])
    rest = np.eye(4) - T
    prior = np.zeros((len(g), 4, 4))
    prior[:, 2:, 2:] = level
    sources = {k: T @ S @ np.swapaxes(T, 1, 2) for k, S in pairs.sources.items()}
    sources["tilt: level"] = rest @ prior @ np.swapaxes(rest, 1, 2)
    upright = compensation.predict(np.zeros((len(g), 3)), g[:, 0] * [0.0, 0.0, 1.0])
    upright[:, :2] = 0.0
    values = np.einsum("nij,nj->ni", T, pairs.values) + (rest @ upright[..., None])[..., 0]
    sources = {k: v for k, v in sources.items() if v.any()}
    return replace(pairs, values=values, sources=sources), T


def level_square(pairs: Pairs, known: Known, compensation: Compensation) -> FloatArray:
    """Return how far the accelerometers depart from level, shape (m,) [1].

    A sum of squares, chi-square with two degrees of freedom where `level_sd` is right.

    `pairs`: set-ups [SI].
    """
    g = np.reshape(known.gravity, (-1, 1, 1))
    up, none = g[:, 0] * [0.0, 0.0, 1.0], np.zeros((len(g), 3))
    miss = (pairs.values - compensation.predict(none, up))[:, 2:]
    own = compensation.coefficients.cov
    J = compensation.slopes(none, up)[:, 2:]
    calibrated = np.zeros((2, 2)) if own is None else J @ own @ np.swapaxes(J, 1, 2)
    level = (g * (known.level_sd or 0.0)) ** 2 * np.eye(2)
    total = pairs.cov[:, 2:, 2:] + calibrated + level
    return np.asarray(np.einsum("ni,ni->n", miss, np.linalg.solve(total, miss[..., None])[..., 0]))


def _calibration_sources(
    angles: FloatArray, known: Known, compensation: Compensation, shared: FloatArray
) -> dict[str, FloatArray]:
    """What the uncertainty of the coefficients does to the four numbers, by kind."""
    c = compensation.coefficients
    if c.cov is None or not len(c):
        return {}
    finite = np.where(np.isfinite(angles), angles, 0.0)
    w_b = earth_rate_b(*finite.T)
    J = shared @ compensation.slopes(
        w_b, np.reshape(known.gravity, (-1, 1)) * up_b(finite[:, 1], finite[:, 2])
    )
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
