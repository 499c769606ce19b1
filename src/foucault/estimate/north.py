"""North from the stops of one gyro, and the calibration of what seeks it.

Where is north: the attitude of a set-up from the four numbers of its readings.

With ``M = w_y / w_ie`` and ``N = w_x / w_ie`` the third component of the Earth's rate has the size
``W = s sqrt(1 - M^2 - N^2)``, or follows from the latitude; pitch and roll come from gravity, and

    X = cos g N + sin g W,    q = cos g W - sin g N,    Y = cos t M - sin t q,
    Z = sin t M + cos t q,    heading = atan2(-X, Y),   L = atan2(Z, hypot(X, Y))

`closed_form` is that. `solve` is maximum likelihood: the four numbers with their covariance, and
the latitude as unknown, known roughly or known, decide together. It starts from every root and
keeps what else would fit, so that an ambiguity is seen and not guessed away.

Calibrate a north seeker on a turntable: known headings, level or tilted.

Every heading psi_i gives four numbers (`reduction`). On a table with one vertical axis

    y_i = A C_z(psi_i + d) exp(-[phi x]) (w_n, f_n) + b

with the errors A, b of the instrument, the table's axis off the vertical by phi about East and
North, and all headings off by d. Accelerometers show phi, because it turns with the heading while
their biases do not: it is an unknown then, for errors of accelerometers that are not found act by
how far it leans. On a table that was tilted on purpose, pitch and roll of every set-up come from
the accelerometers instead. Everything else that is uncertain is a source of error of known size
(`infer.mixed`): noise, random errors of the headings, and d, phi and the latitude with what was
known of them.

With 12 headings, level, exact headings and equal noise this is the regression of ref. [1] on
``[1, w_x, w_y]``.

References
----------
.. [1] Liu Cheng, "Parameter compensation algorithm for four-position FOG north seeker",
   Piezoelectrics & Acoustooptics, 2016, eqs. (20)-(49); the sign of the root in (33) is that of
   the rate along z_b, and (44) lists the last two parameters in the wrong order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.estimate.north_reduction import (
    EXACT,
    GYRO_DRIFT,
    GYRO_NOISE,
    GYRO_OFFSET,
    INDEXING,
    PLAUSIBLE,
    TILT_DRIFT,
    TILT_NOISE,
    Best,
    Hemisphere,
    Known,
    Pairs,
    Roots,
    best_of,
    compensated,
    horizontal_of,
    starts_of,
    tilt_of,
    widen,
)
from foucault.infer.mixed import Linearisation, Source
from foucault.models.earth import EARTH_RATE, Site, earth_rate_n
from foucault.models.north_seeker import (
    RATE_LEVEL,
    RATE_TILTED,
    SEEKER,
    Compensation,
    attitude,
)
from foucault.models.rotation import cross_matrix, exp, turned

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

LINEAR = float(np.radians(1.0))
"""A solution that is as sure as that stays the best with other weights [rad]."""


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
    slope: FloatArray  # (m, 4) of the heading against the four numbers as measured [1/SI]

    def __len__(self) -> int:
        return len(self.angles)

    @cached_property
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
            rate[rows].ravel(), up[rows].ravel(), place, sign, EARTH_RATE, rate_sd**2, up_sd**2,
            latitude_sd**2, angles[rows].ravel(), sd[rows].ravel(), status[rows],
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
    return settled(pairs, known, compensation, sought(pairs, known, compensation))


def sought(pairs: Pairs, known: Known, compensation: Compensation) -> Best:
    """Return every solution by the readings alone [rad]: what hangs on the attitude comes later.

    `pairs`: set-ups [SI].
    """
    pairs, _ = levelled(pairs, known, compensation)
    return best_of(pairs, pairs.cov, known, compensation, starts_of(pairs, known, compensation))


def settled(
    pairs: Pairs, known: Known, compensation: Compensation, at: Best | Fixes, budget: int = 4
) -> Fixes:
    """Weigh set-ups with what the calibration, and roots that `pairs` [SI] has, do at solutions.

    `at`: of `sought`, or fixes by other weights [rad]; `budget`: of how many angles variances are
    wanted by source too [1].
    """
    pairs, shared = levelled(pairs, known, compensation)
    starts = [at.angles, at.other]
    if isinstance(at, Fixes):  # what fits badly or hardly tells has other minima by other weights
        fits = (at.status == 0) & (at.square < PLAUSIBLE) & (at.sd[:, 0] < LINEAR)
        again = np.flatnonzero(~fits | at.ambiguous)
        if len(again):
            few, of = pairs.together(again), known.of(again)
            new = best_of(few, few.cov, of, compensation, starts_of(few, of, compensation))
            starts = [start.copy() for start in starts]
            starts[0][again], starts[1][again] = new.angles, new.other
    more = _calibration_roots(starts[0], known, compensation, shared)
    pairs = replace(pairs, roots=(*pairs.roots, *more))
    if isinstance(at, Fixes) or more:
        best = best_of(pairs, pairs.cov, known, compensation, starts)
    else:
        best = at
    some = np.ascontiguousarray(best.gain[:, :budget])
    gain, parts = best.gain[..., :4], pairs.shares(some) if budget else {}
    horizontal = horizontal_of(pairs, known, compensation)
    if known.latitude is not None:
        sd = np.reshape(np.maximum(known.latitude_sd, EXACT), (-1, 1))
        parts[LATITUDE] = some[..., 4] ** 2 * sd**2
    else:
        widen(best, horizontal, pairs, known, compensation, parts)
    slope = gain[:, 0] if shared is None else (gain[:, :1] @ shared)[:, 0]
    return Fixes(
        best.angles, best.cov, parts, best.square, best.other,
        best.other_square, _ambiguous(best, known), best.status, horizontal > 1.0, slope,
    )  # fmt: skip


def bound(pairs: Pairs, known: Known, compensation: Compensation, angles: FloatArray) -> FloatArray:
    """Return the sds that white noise and a perfect instrument alone allow, shape (m, 4) [rad].

    `pairs`: set-ups [SI]; `angles` (m, 4): solutions, by which this is another nearby [rad].
    """
    exact = Compensation(replace(compensation.coefficients, cov=None))
    known = replace(known, latitude_sd=0.0)
    pairs, _ = levelled(pairs.noise_alone, known, exact)
    best = best_of(pairs, pairs.cov, known, exact, [angles])
    if known.latitude is None:
        widen(best, horizontal_of(pairs, known, exact), pairs, known, exact, {})
    return best.sd


def _ambiguous(best: Best, known: Known) -> npt.NDArray[np.bool_]:
    """Tell where the other solution is possible, and says something else."""
    out = best.other_square < PLAUSIBLE + best.rank
    some = np.flatnonzero(out)
    away, sd = best.other[some] - best.angles[some], best.sd[some]
    apart = np.abs(turned(away[:, 0])) > sd[:, 0]
    if known.latitude is None:
        apart |= np.abs(away[:, 3]) > sd[:, 3]
    out[some] = apart
    return out


def levelled(
    pairs: Pairs, known: Known, compensation: Compensation
) -> tuple[Pairs, FloatArray | None]:
    """Weigh the specific forces with how level the case stands, as far as that is known.

    Returns the pairs, and how much of the specific forces as measured is in theirs, (m, 4, 4);
    None for all of them.
    """
    if known.level_sd is None:
        return pairs, None
    T = np.broadcast_to(np.eye(4), (len(pairs), 4, 4)).copy()
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
    roots = tuple(B.turned(T).felt for B in pairs.roots)
    return replace(pairs, values=values, sources=sources, roots=roots), T


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


def _calibration_roots(
    angles: FloatArray, known: Known, compensation: Compensation, shared: FloatArray | None
) -> tuple[Roots, ...]:
    """What the uncertainty of the coefficients does to the four numbers, by kind."""
    c = compensation.coefficients
    if c.cov is None or not len(c):
        return ()
    # Coefficients are tied to one another: a coupling that a level session cannot show, and the
    # bias that made up for it. In the order of SOURCES each counts with what follows it, so that
    # the parts are independent and none is negative.
    kinds = [next(k for k in SOURCES if name.startswith(k)) for name in c.names]
    order = sorted(range(len(c)), key=lambda i: list(SOURCES).index(kinds[i]))
    sd = np.sqrt(np.maximum(np.diag(c.cov), 1e-300))[order]
    tied = c.cov[np.ix_(order, order)] / np.outer(sd, sd) + 1e-12 * np.eye(len(c))
    root = np.empty_like(tied)
    root[order] = sd[:, None] * np.linalg.cholesky(tied)
    effect = compensation.spread(angles, known.gravity, root, shared)
    first = np.cumsum([0, *(kinds.count(start) for start in SOURCES)])
    return (Roots(effect, (*SOURCES.values(),), first).felt,)


Tilt = Literal["one axis", "each"]

BIASES = ("accel.bias.x", "accel.bias.y")
"""What a table with one vertical axis shows of the accelerometers."""

GYRO, ACCEL = "gyro over headings", "accel over headings"
"""Kinds of reading."""

LEVEL = "level of the table"
HEADINGS, COMMON_HEADING = "reference headings", "common error of the headings"

BASIS = {
    GYRO_DRIFT: "slow noise and drift as given",
    GYRO_OFFSET: "gyro_offset_sd as given",
    TILT_DRIFT: "slow noise as given",
    INDEXING: "index_sd and index_lag_sd as given",
}
"""What the sources of a set-up rest on that are not its noise."""


@dataclass(frozen=True)
class Rig:
    """The turntable and what is known of it."""

    heading: FloatArray  # (m,) reference heading of y_b in every set-up [rad]
    site: Site  # gravity, and the latitude, which must be known
    tilt: Tilt  # one vertical axis for all set-ups, or tilted on purpose
    accelerometers: bool  # whether there are readings of specific force
    heading_sd: float = 0.0  # of the error of every heading by itself [rad]
    heading_offset_sd: float = 0.0  # of the error that all headings share [rad]
    # of the tilt of the table's axis, infinite where the accelerometers have to find it [rad]
    level_sd: float = np.inf
    latitude_sd: float = 0.0  # of the latitude [rad]
    # source -> what its size rests on, where that was not given
    assumed: Mapping[str, str] = field(default_factory=dict)

    def basis(self, source: str, key: str) -> str:
        """Return what the size of a source rests on, of which the setting `key` may say it."""
        return self.assumed.get(source, f"{key} as given")


def names_of(rig_tilt: Tilt, accelerometers: bool, z_coupling: bool) -> tuple[str, ...]:
    """Return the coefficients that such a session shows, with `z_coupling` where it is wanted."""
    more = BIASES if accelerometers and rig_tilt == "one axis" else ()
    wanted = {*(RATE_TILTED if z_coupling else RATE_LEVEL), *more}
    return tuple(n for n in SEEKER.names if n in wanted)


def tilts(pairs: Pairs, gravity: float, compensation: Compensation) -> FloatArray:
    """Return pitch and roll of `pairs` [SI] by the accelerometers, at `gravity`, (m, 2) [rad]."""
    _, _, x, y = compensated(pairs.values, gravity, compensation).T
    return np.stack(tilt_of(x, y), 1)


@dataclass(frozen=True)
class OnTurntable:
    """A north seeker on a turntable, as `infer.mixed` solves it.

    A state is the coefficients, and the tilt of the axis about East and North [rad] where
    accelerometers show it.
    """

    pairs: Pairs  # four numbers of every set-up [SI]
    rig: Rig
    layout: Layout  # the coefficients that are found
    # errors of the accelerometers that are not found here, with covariance (its diagonal)
    known: Compensation = field(default_factory=Compensation)
    # type and basis of the noise
    noise: tuple[str, str] = ("B", "noise as declared in the campaign")

    @cached_property
    def start(self) -> FloatArray:
        """A perfect instrument on a level table."""
        return np.zeros(len(self.layout) + (2 if self._seen else 0))

    @property
    def _seen(self) -> bool:
        return self.rig.tilt == "one axis" and self.rig.accelerometers and self.rig.level_sd > 0

    @property
    def kinds(self) -> dict[str, BoolArray]:
        """Rates and, on one axis, specific forces."""
        gyro = np.broadcast_to(np.arange(self._used.shape[1]) < 2, self._used.shape[:2])
        return {GYRO: gyro} | ({ACCEL: ~gyro} if not gyro.all() else {})

    def retract(self, state: FloatArray, step: FloatArray) -> FloatArray:
        """Add `step` (p,) to `state` (p,) [SI]."""
        return state + step

    def values(self, state: FloatArray) -> FloatArray:
        """Return the coefficients of `state` (p,) [SI]."""
        return state[: len(self.layout)]

    def linearise(self, state: FloatArray) -> Linearisation:
        """Compare the four numbers, or two, with the model at `state` (p,) [SI]."""
        p = len(self.layout)
        w, f, dw, df = self.truth(state)
        whole = self._whole(state)
        model = whole.model
        by_table = np.concatenate([model.gyro_matrix[:2] @ dw, model.accel_matrix[:2] @ df], axis=1)
        left = (self.pairs.values - whole.predict(w, f))[..., None]
        both = self._used @ np.concatenate([whole.slopes(w, f), by_table, left], axis=2)
        by_own, by_table = both[..., p:-5], both[..., -5:-1]
        sources = self._sources(by_table, by_own)
        if not self._seen:
            return Linearisation(both[..., -1], both[..., :p], sources)
        J = np.concatenate([both[..., :p], by_table[..., :2]], axis=2)
        tie = np.eye(p + 2)[p:] / self.rig.level_sd
        known = (-tie @ state, tie) if tie.any() else None
        return Linearisation(both[..., -1], J, sources, known, (LEVEL, LEVEL))

    def residuals(self, state: FloatArray) -> FloatArray:
        """Return what the model at `state` (p,) leaves of the readings, shape (m, d) [SI]."""
        w, f, _, _ = self.truth(state)
        left = self.pairs.values - self._whole(state).predict(w, f)
        return np.asarray((self._used @ left[..., None])[..., 0])

    def _whole(self, state: FloatArray) -> Compensation:
        """All errors of the instrument at `state` (p,)."""
        return Compensation(CoefficientVector(*self._all(state[: len(self.layout)])))

    def _all(self, values: FloatArray) -> tuple[Layout, FloatArray]:
        """The coefficients that are found, then those that are not."""
        more = self.known.coefficients
        layout = SEEKER.subset([*self.layout.names, *(more.names[i] for i in self._own)])
        return layout, np.append(values, more.values[self._own])

    @cached_property
    def _own(self) -> list[int]:
        names = self.known.coefficients.names
        return [i for i, name in enumerate(names) if name not in self.layout.names]

    @cached_property
    def _angles(self) -> FloatArray:
        """Pitch and roll of the case on the table, (m, 2)."""
        if self.rig.tilt == "one axis":
            return np.zeros((len(self.pairs), 2))
        return tilts(self.pairs, self.rig.site.gravity, self.known)

    def truth(self, state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return w_b, f_b, each (m, 3), and their slopes, (m, 3, 4), at `state` (p,) [SI].

        Slopes are those against phi, an error of all headings, and one of the latitude.
        """
        site, phi = self.rig.site, state[len(self.layout) :] if self._seen else np.zeros(2)
        assert site.latitude is not None
        C = attitude(self.rig.heading, *self._angles.T)
        leaned = exp(-np.array([*phi, 0.0]))
        north = EARTH_RATE * np.array([0.0, -np.sin(site.latitude), np.cos(site.latitude)])
        down = np.array([0.0, 0.0, -1.0])  # heading is clockwise: about -up
        out, slopes = [], []
        for v, by_latitude in (
            (earth_rate_n(site.latitude), north), (np.array([0.0, 0.0, site.gravity]), np.zeros(3)),
        ):  # fmt: skip
            turn = cross_matrix(leaned @ v)  # d exp(-[phi x]) v = [v x] phi
            out.append(C @ leaned @ v)
            slopes.append(C @ np.column_stack([turn[:, :2], turn @ down, leaned @ by_latitude]))
        return out[0], out[1], slopes[0], slopes[1]

    @cached_property
    def _used(self) -> FloatArray:
        """What of the four numbers is read, (m, d, 4)."""
        one = self.rig.tilt == "one axis"
        used = np.eye(4)[: 4 if self.rig.accelerometers and one else 2]
        out = np.broadcast_to(used, (len(self.pairs), *used.shape)).copy()
        if not one:  # what is left of a rate has the error of the tilts in it
            out[:, :, 2:] = -self._by_force()
        return out

    def _by_force(self) -> FloatArray:
        """Slope of the true rates against specific force through the tilts, (m, 2, 2)."""
        site, values = self.rig.site, self.pairs.values
        w_n = earth_rate_n(site.latitude or 0.0)

        def rate(moved: FloatArray) -> FloatArray:
            angles = tilts(replace(self.pairs, values=values + moved), site.gravity, self.known)
            return (attitude(self.rig.heading, *angles.T) @ w_n)[:, :2]

        steps = 1e-6 * site.gravity * np.eye(4)[2:]
        return np.stack([(rate(h) - rate(-h)) / (2 * h.sum()) for h in steps], axis=2)

    @cached_property
    def _within(self) -> tuple[Source, ...]:
        """What every set-up has for itself."""
        out = []
        for name, cov in self.pairs.sources.items():
            size, axes = np.linalg.eigh(cov)
            root = self._used @ (axes * np.sqrt(np.maximum(size, 0.0))[:, None, :])
            noise = name in (GYRO_NOISE, TILT_NOISE)
            kind, basis = self.noise if noise else ("B", self.rig.assumed.get(name, BASIS[name]))
            out.append(Source(name, each=root, noise=noise, type=kind, basis=basis))
        return tuple(out)

    def _sources(self, by_table: FloatArray, by_own: FloatArray) -> tuple[Source, ...]:
        rig, c = self.rig, self.known.coefficients
        heading, latitude = by_table[..., 2:3], by_table[..., 3:]
        tilt = by_table[..., :2]
        if rig.tilt == "each":
            # A case tilted on a table that leans by (e, n) has another heading than the table says,
            # by tan(pitch) (e sin psi + n cos psi).
            turn = np.stack([np.sin(rig.heading), np.cos(rig.heading)], 1)
            tilt = heading * (np.tan(self._angles[:, :1]) * turn)[:, None, :]
        own = np.zeros(len(self._own)) if c.cov is None else np.sqrt(np.diag(c.cov)[self._own])
        every = (
            *self._within,
            Source(HEADINGS, each=heading, sd=rig.heading_sd,
                   basis=rig.basis(HEADINGS, "heading_sd")),
            Source(COMMON_HEADING, shared=heading, sd=rig.heading_offset_sd,
                   basis=rig.basis(COMMON_HEADING, "heading_offset_sd")),
            # What is known of it where it is an unknown is in rows of its own.
            Source(LEVEL, shared=None if self._seen else tilt, sd=rig.level_sd,
                   basis=rig.basis(LEVEL, "level_sd")),
            Source(LATITUDE, shared=latitude, sd=rig.latitude_sd,
                   basis=rig.basis(LATITUDE, "latitude_sd")),
            Source("tilt: accelerometers", shared=by_own * own,
                   basis="what is known beforehand of errors that this session does not show"),
        )  # fmt: skip
        effects = ((s, s.shared if s.each is None else s.each) for s in every if s.sd)
        return tuple(s for s, effect in effects if effect is None or effect.any())


def calibrate_batch(
    stops: FloatArray, heading: FloatArray, latitude: float, sd: float
) -> tuple[FloatArray, FloatArray]:
    """Calibrate many instruments that stood at the same headings, level, at four stops each.

    `stops` (n, m, 4): readings at the index angles 0, 180, 90, 270 deg in m headings [rad/s];
    `heading` (m,): of y_b [rad]; `latitude`: [rad]; `sd`: standard deviation of one reading
    [rad/s]. Returns `values` (n, 6): in the order of `RATE_LEVEL` [SI]; `cov` (6, 6): the same
    for all [SI].
    """
    w = EARTH_RATE * np.cos(latitude)
    design = np.stack([np.ones_like(heading), -w * np.sin(heading), w * np.cos(heading)], 1)
    # Least squares on [1, w_x, w_y], and the half differences of opposite stops, in one product:
    # bias and slopes of y from stops 0 and 180, of x from 90 and 270; eqs. (40)-(46) of ref. [1].
    inverse = np.linalg.pinv(design)
    m = len(heading)
    weights = np.zeros((m, 4, 6))
    order = {"y": (1, 5, 3), "x": (0, 2, 4)}  # bias, slope against w_x, slope against w_y
    for axis, (plus, minus) in (("y", (0, 1)), ("x", (2, 3))):
        for k, column in enumerate(order[axis]):
            weights[:, plus, column] = inverse[k] / 2
            weights[:, minus, column] = -inverse[k] / 2
    flat = weights.reshape(4 * m, 6)
    values = stops.reshape(len(stops), 4 * m) @ flat - np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    return values, sd**2 * flat.T @ flat
