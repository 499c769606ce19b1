"""Calibrate a north seeker on a turntable: known headings, level or tilted.

Every heading psi_i gives four numbers (`reduction`). On a table with one vertical axis

    y_i = A C_z(psi_i + d) exp(-[phi x]) (w_n, f_n) + b

with the errors A, b of the instrument, the table's axis off the vertical by phi about East and
North, and all headings off by d. Accelerometers show phi, because it turns with the heading while
their biases do not. On a table that was tilted on purpose, pitch and roll of every set-up come from
the accelerometers instead. Least squares with everything that is uncertain in it: noise, random
errors of the headings, and d, phi and the latitude with what was known of them.

With 12 headings, level, exact headings and equal noise this is the regression of ref. [1] on
``[1, w_x, w_y]``.

References
----------
.. [1] Liu Cheng, "Parameter compensation algorithm for four-position FOG north seeker",
   Piezoelectrics & Acoustooptics, 2016, eqs. (39)-(49); its (44) lists the last two parameters in
   the wrong order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.estimate.north.reduction import Pairs
from foucault.estimate.north.roots import compensated, tilt_of
from foucault.models.earth import EARTH_RATE, Site, earth_rate_n
from foucault.models.north_seeker import (
    RATE_LEVEL,
    RATE_TILTED,
    SEEKER,
    Compensation,
    attitude,
)
from foucault.models.rotation import cross_matrix, exp
from foucault.result import Estimate, Linearised, Problem

Tilt = Literal["one axis", "each"]

BIASES = ("accel.bias.x", "accel.bias.y")
"""What a table with one vertical axis shows of the accelerometers."""


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


@dataclass(frozen=True)
class State:
    """What is estimated."""

    values: FloatArray  # (n,) the coefficients [SI]
    # (4 + k,) tilt of the axis about East and North, error of all headings and of the latitude
    # [rad]; errors of accelerometers that give the tilt of every set-up [SI]
    table: FloatArray


def names_of(rig_tilt: Tilt, accelerometers: bool, z_coupling: bool) -> tuple[str, ...]:
    """Return the coefficients that such a session shows.

    `z_coupling`: whether the coupling of the rate along z_b is wanted.
    """
    more = BIASES if accelerometers and rig_tilt == "one axis" else ()
    wanted = {*(RATE_TILTED if z_coupling else RATE_LEVEL), *more}
    return tuple(n for n in SEEKER.names if n in wanted)


def tilts(pairs: Pairs, gravity: float, compensation: Compensation) -> FloatArray:
    """Return pitch and roll of every set-up from its accelerometers, shape (m, 2) [rad].

    `pairs`: the set-ups [SI]; `gravity`: [m/s^2].
    """
    _, _, x, y = compensated(pairs.values, gravity, compensation).T
    return np.stack(tilt_of(x, y), 1)


def build(
    pairs: Pairs,
    rig: Rig,
    names: tuple[str, ...],
    prior: CoefficientVector | None = None,
    known: Compensation | None = None,
    table: FloatArray | None = None,
) -> Problem:
    """State the calibration as a least-squares problem.

    `pairs`: four numbers of every set-up [SI]; `prior` or None: what is known of them [SI];
    `known` or None: errors of the accelerometers that are not found here, with covariance (its
    diagonal); `table` (4,) or None: tilt of the table, if it was found before: what wrong
    headings do depends on it [rad].
    """
    known = known or Compensation()
    scene = _Scene(pairs, rig, names, known)
    root = np.linalg.cholesky(np.asarray(sum(scene.covariance(table).values())))
    m = len(pairs)
    blocks = np.repeat(np.arange(m), scene.used.size)
    sd = np.where(scene.free, scene.table_sd, 1.0)

    def linearise(state: State, weights: FloatArray) -> Linearised:
        predicted, J = scene.predict(state)
        left = (pairs.values[:, scene.used] - predicted)[..., None]
        share = np.sqrt(weights)[:, None, None]
        white = np.linalg.solve(root, np.concatenate([J, left], axis=2)) * share
        flat = white.reshape(m * scene.used.size, -1)
        tied = np.flatnonzero(scene.free & np.isfinite(sd))
        rows = np.zeros((len(tied), flat.shape[1] - 1))
        columns = len(names) + np.flatnonzero(np.isin(np.flatnonzero(scene.free), tied))
        rows[np.arange(len(tied)), columns] = 1.0 / sd[tied]
        return Linearised(
            np.concatenate([flat[:, -1], -state.table[tied] / sd[tied]]),
            np.concatenate([flat[:, :-1], rows]),
            np.concatenate([blocks, np.full(len(tied), -1)]),
        )

    def retract(state: State, step: FloatArray) -> State:
        table = state.table.copy()
        table[scene.free] += step[len(names) :]
        return State(state.values + step[: len(names)], table)

    start = np.zeros(len(names)) if prior is None else prior.values
    layout = SEEKER.subset(names)
    state = State(start, np.zeros(len(sd)))
    return Problem(layout, state, linearise, retract, lambda s: s.values, m, prior)


def covariance_parts(
    pairs: Pairs, rig: Rig, table: FloatArray | None = None
) -> dict[str, FloatArray]:
    """Return the covariance of the numbers that are used, by source, shape (m, k, k) each [SI].

    `pairs`: four numbers of every set-up [SI]; `table` (4,) or None: tilt of the table, if it was
    found before [rad].
    """
    return _Scene(pairs, rig, (), Compensation()).covariance(table)


def fit(problem: Problem) -> Estimate:
    """Solve it."""
    return gauss_newton.solve(problem)


@dataclass
class _Scene:
    """What is predicted for a state, and how sure the observations are."""

    pairs: Pairs
    rig: Rig
    names: tuple[str, ...]
    known: Compensation

    def __post_init__(self) -> None:
        rig, m = self.rig, len(self.pairs)
        one = rig.tilt == "one axis"
        self.used = np.arange(4 if rig.accelerometers and one else 2)
        angles = np.zeros((m, 2))
        if not one:
            angles = tilts(self.pairs, rig.site.gravity, self.known)
        # Errors of the accelerometers that are not found here are unknowns with a known size.
        c = self.known.coefficients
        self.own = [i for i, n in enumerate(c.names) if n not in self.names]
        own = np.zeros(len(c)) if c.cov is None else np.sqrt(np.diag(c.cov))
        own = own[self.own] if rig.accelerometers else np.zeros(len(self.own))
        level = rig.level_sd if one else 0.0
        self.table_sd = np.array(
            [level, level, rig.heading_offset_sd, rig.latitude_sd, *own.tolist()]
        )
        self.free = self.table_sd > 0
        self.angles = angles
        self.by_force = np.zeros((m, 2, 2)) if one else self._by_force()

    def truth(self, table: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return w_b, f_b, each (m, 3), and their slopes against the table, (m, 3, 4)."""
        site = self.rig.site
        assert site.latitude is not None
        latitude = site.latitude + table[3]
        w_n, f_n = earth_rate_n(latitude), np.array([0.0, 0.0, site.gravity])
        heading = self.rig.heading + table[2]
        C = attitude(heading, self.angles[:, 0], self.angles[:, 1])
        leaned = exp(-np.array([table[0], table[1], 0.0]))
        out, slopes = [], []
        slope_n = EARTH_RATE * np.array([0.0, -np.sin(latitude), np.cos(latitude)])
        down = np.array([0.0, 0.0, -1.0])  # heading is clockwise: about -up
        for v, by_latitude in ((w_n, slope_n), (f_n, np.zeros(3))):
            turned = leaned @ v
            slope = np.empty((3, 4))
            slope[:, :2] = cross_matrix(turned)[:, :2]  # d exp(-[phi x]) v = [v x] phi
            slope[:, 2] = cross_matrix(turned) @ down
            slope[:, 3] = leaned @ by_latitude
            out.append(C @ turned)
            slopes.append(C @ slope)
        return out[0], out[1], slopes[0], slopes[1]

    def predict(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the numbers predicted, (m, k), and their slopes, (m, k, n)."""
        found = Compensation(CoefficientVector(SEEKER.subset(self.names), state.values))
        w, f, dw, df = self.truth(state.table)
        model = found.model
        by_table = np.concatenate([model.gyro_matrix[:2] @ dw, model.accel_matrix[:2] @ df], axis=1)
        by_own = self.known.slopes(w, f)[..., self.own]
        if self.rig.tilt == "each":  # they turn the rate through the tilts that they give
            by_own[:, :2] = -self.by_force @ by_own[:, 2:]
        predicted = found.predict(w, f) + by_own @ state.table[4:]
        tied = np.concatenate([by_table, by_own], axis=2)[..., self.free]
        J = np.concatenate([found.slopes(w, f), tied], axis=2)
        return predicted[:, self.used], J[:, self.used]

    def covariance(self, table: FloatArray | None = None) -> dict[str, FloatArray]:
        """Return the covariance of the numbers used by source, (m, k, k) each."""
        _, _, dw, df = self.truth(np.zeros(4) if table is None else table)
        by_heading = np.concatenate([dw[:, :2, 2], df[:, :2, 2]], axis=1)
        parts = dict(self.pairs.sources)
        # A case tilted on a table that leans has another heading than the table says.
        lean = self.rig.level_sd if self.rig.tilt == "each" else 0.0
        lean = lean if np.isfinite(lean) else 0.0
        tilt = np.hypot(*np.tan(self.angles.T))
        variance = self.rig.heading_sd**2 + (lean * tilt) ** 2
        if np.any(variance > 0):
            each = np.einsum("n,ni,nj->nij", variance, by_heading, by_heading)
            parts["reference headings"] = each
        if self.rig.tilt == "each":  # what is left of a rate has the error of the tilts in it
            turn = np.broadcast_to(np.eye(4), (len(dw), 4, 4)).copy()
            turn[:, :2, 2:] = -self.by_force
            parts = {k: turn @ S @ np.swapaxes(turn, 1, 2) for k, S in parts.items()}
        used = {k: v[:, self.used][:, :, self.used] for k, v in parts.items()}
        return {k: v for k, v in used.items() if v.any()}

    def _by_force(self) -> FloatArray:
        """Slope of the true rates against specific force through the tilts, (m, 2, 2)."""
        w_n = earth_rate_n(self.rig.site.latitude or 0.0)
        gravity, step = self.rig.site.gravity, 1e-6
        slope = np.zeros((len(self.pairs), 2, 2))
        for k in range(2):
            ends = []
            for sign in (1.0, -1.0):
                values = self.pairs.values.copy()
                values[:, 2 + k] += sign * step * gravity
                angles = tilts(replace(self.pairs, values=values), gravity, self.known)
                ends.append(attitude(self.rig.heading, *angles.T) @ w_n)
            slope[:, :, k] = (ends[0] - ends[1])[:, :2] / (2 * step * gravity)
        return slope


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
