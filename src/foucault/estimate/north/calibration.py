"""Calibrate a north seeker on a turntable: known headings, level or tilted.

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
   Piezoelectrics & Acoustooptics, 2016, eqs. (39)-(49); its (44) lists the last two parameters in
   the wrong order.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.estimate.north.reduction import (
    GYRO_DRIFT,
    GYRO_NOISE,
    GYRO_OFFSET,
    INDEXING,
    TILT_DRIFT,
    TILT_NOISE,
    Pairs,
)
from foucault.estimate.north.roots import compensated, tilt_of
from foucault.infer.mixed import Linearisation, Source
from foucault.models.earth import EARTH_RATE, Site, earth_rate_n
from foucault.models.north_seeker import (
    RATE_LEVEL,
    RATE_TILTED,
    SEEKER,
    Compensation,
    attitude,
)
from foucault.models.rotation import cross_matrix, exp

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
        w, f, dw, df = self._truth(state[p:] if self._seen else np.zeros(2))
        whole = Compensation(CoefficientVector(*self._all(state[:p])))
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

    def _truth(self, phi: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return w_b, f_b, each (m, 3), and their slopes, (m, 3, 4).

        Slopes are those against phi, an error of all headings, and one of the latitude.
        """
        site = self.rig.site
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
            kind, basis = self.noise if noise else ("B", BASIS[name])
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
            Source(HEADINGS, each=heading, sd=rig.heading_sd, basis="heading_sd as given"),
            Source(COMMON_HEADING, shared=heading, sd=rig.heading_offset_sd,
                   basis="heading_offset_sd as given"),
            # What is known of it where it is an unknown is in rows of its own.
            Source(LEVEL, shared=None if self._seen else tilt, sd=rig.level_sd,
                   basis="level_sd as given"),
            Source("latitude", shared=latitude, sd=rig.latitude_sd, basis="latitude_sd as given"),
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
