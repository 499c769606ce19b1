"""What gyros say on a rate table: several constant rates about each axis, and what spoils them.

In step k the table turns at the rate W_k about the vertical, and the placement of the instrument
says which of its axes is there: ``u`` in fixture axes. Over whole turns the mean rate is that of
table and Earth along u; with ``r = (I + S + M) w``::

    w = (W + v) u        gyro = r + A |r| + C r^3 + b + G f        f = g u + (centripetal)

v is the Earth's rate along up. What is not known of table, fixture, place and bias is a source of
error each: an error that all rates share, another one in every step, the tilts of u, the Earth's
rate where the latitude is unknown and where a step is no whole turn, a bias that moves.

References
----------
.. [1] IEEE Std 647-2006, annex A, and IEEE Std 952-1997, section 12 (rate table tests).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import Layout
from foucault.infer.mixed import NOISE_BASIS, UNEXPLAINED_BASIS, Linearisation, Source
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT, ImuModel, Slopes
from foucault.models.rate_steps import Steps
from foucault.models.readings import wander
from foucault.procedures.rate_table.session import Settings

TIMES = (np.inf, 1.0, 0.5, 0.25, 0.12, 0.06)
"""Correlation times that are tried, as parts of the session; infinite: a straight line [1]."""

PRICE = {"rate scatter": 6.0, "bias drift": 8.0}
"""Twice the log-likelihood that each kind of scatter must gain: that of the bias is the larger one
because it is chosen among several that differ in their correlation time [1]."""

FEWEST = 6
"""With fewer readings beyond the unknowns no scatter is looked for [1]."""


@dataclass(frozen=True)
class RateTable:
    """The steps of a session, as `infer.mixed` has them."""

    steps: Steps
    names: tuple[str, ...]
    settings: Settings
    latitude: float | None = None  # geodetic latitude, positive north; None where unknown [rad]
    # where the noise is from; one that is unknown is found from the residuals
    noise: Literal["declared", "measured", "unknown"] = "declared"
    # correlation time of a bias that moves, if it does; 0: another bias in every step; infinite: a
    # straight line [s]
    bias_time: float = 0.0

    @property
    def layout(self) -> Layout:
        """The coefficients."""
        return LAYOUT.subset(self.names)

    @property
    def kinds(self) -> Mapping[str, BoolArray]:
        """All steps are of one kind."""
        return {"steps": np.ones((len(self.steps), 3), bool)}

    @property
    def vertical(self) -> float:
        """The Earth's rate along up, 0 where unknown [rad/s]."""
        return 0.0 if self.latitude is None else float(EARTH_RATE * np.sin(self.latitude))

    @property
    def level_sd(self) -> float:
        """Sd of the Earth's rate along each direction across up [rad/s].

        Its size is known with the latitude, its azimuth is not. A vector of which nothing is known,
        all places being alike, has a third of its square along any direction, along up too.
        """
        share = 1 / np.sqrt(3) if self.latitude is None else np.cos(self.latitude) / np.sqrt(2)
        return float(EARTH_RATE * abs(share))

    @property
    def looks_for_scatter(self) -> bool:
        """Whether scatter beyond the noise is looked for; it is not told from unknown noise."""
        enough = self.steps.gyro.size - len(self.names) >= FEWEST
        return self.settings.repeatability and self.noise != "unknown" and enough

    @cached_property
    def noise_root(self) -> FloatArray:
        """What the noise of each gyro does to each step, of any size if unknown, (n, 3, 3) [rad/s].

        Of noise that nobody knows it is taken that it is white: it averages out.
        """
        root = np.linalg.cholesky(self.steps.cov)
        if self.noise == "unknown":
            root = root * np.sqrt(np.median(self.steps.time) / self.steps.time)[:, None, None]
        return np.asarray(root)

    @property
    def start(self) -> ImuModel:
        """The straight lines through all readings, where there are enough to have them."""
        s, h = self.steps, self.steps.rate + self.vertical
        size = float(np.abs(h).max()) or 1.0
        rows = np.column_stack([h[:, None] * s.up / size, np.ones(len(h))])
        solved, _, rank, _ = np.linalg.lstsq(rows, s.gyro, rcond=1e-9)
        if rank < 4:
            return ImuModel()
        return ImuModel(gyro_matrix=np.asarray(solved[:3].T / size), gyro_bias=solved[3])

    def linearise(self, state: ImuModel) -> Linearisation:
        """Compare the readings with those of an instrument."""
        s = self.steps
        w = (s.rate + self.vertical)[:, None] * s.up
        slopes = state.slopes(s.force, w, self.names)
        miss = s.gyro - state.measure(s.force, w)[1]
        return Linearisation(miss, slopes.gyro, self._sources(slopes))

    def retract(self, state: ImuModel, step: FloatArray) -> ImuModel:
        """Add `step` (m,) to the coefficients [SI]."""
        return state.moved(self.names, step)

    def values(self, state: ImuModel) -> FloatArray:
        """Return the coefficients of an instrument [SI]."""
        return state.coefficients(self.names).values

    def _sources(self, slopes: Slopes) -> tuple[Source, ...]:
        s, chosen = self.steps, self.settings
        by_rate = slopes.gyro_by_rate @ s.up[:, :, None]  # by the rate about up
        jitter = by_rate * s.rate[:, None, None]
        h = (s.rate + self.vertical)[:, None, None]
        g = np.linalg.norm(s.force, axis=1)[:, None, None]
        tilted = (h * slopes.gyro_by_rate + g * slopes.gyro_by_force) @ s.level
        still = s.rate == 0.0
        level = slopes.gyro_by_rate @ s.level_at_zero * still[:, None, None]
        # A part of a turn begins at any azimuth. What is left of whole turns is rounding.
        left = np.abs(np.sinc(s.turns))[:, None, None] * ~still[:, None, None]
        parts = slopes.gyro_by_rate @ s.level * np.where(left > 1e-9, left, 0.0)
        kind, basis = NOISE_BASIS[self.noise]
        size = None if self.noise == "unknown" else 1.0
        out = [
            Source("gyro noise", self.noise_root, sd=size, noise=True, price=0.0,
                   type=kind, basis=basis),
            Source("rate of the table", shared=jitter, sd=chosen.table_rate_sd,
                   basis="table_rate_sd as given in the campaign"),
            Source("rate jitter", jitter, sd=chosen.rate_sd,
                   basis="rate_sd as given in the campaign"),
            Source("fixture", shared=self._of_placements(tilted), sd=chosen.fixture_sd,
                   basis="fixture_sd as given in the campaign"),
            Source("level Earth rate", shared=self._of_placements(level), sd=self.level_sd,
                   basis="Earth rate across the axis at rest, in any direction"),
            Source("parts of turns", parts, sd=self.level_sd,
                   basis="Earth rate across the axis that a part of a turn leaves"),
        ]  # fmt: skip
        if self.latitude is None:
            out.append(Source("unknown Earth rate", shared=by_rate, sd=self.level_sd,
                              basis="latitude not given: any direction"))  # fmt: skip
        if (lost := still & ~s.azimuth_known).any():
            # Rests of one placement are at one angle, as whole turns leave them, or else scatter.
            kind, basis = "A", "scatter of the rests, whose table angles the log does not tell"
            out.append(Source("angle of the table", level * lost[:, None, None], sd=None,
                              type=kind, basis=basis))  # fmt: skip
        if s.slow is not None:
            out.append(Source("slow noise of gyros", shared=self._slow, noise=True,
                              basis="slow noise as given in the campaign"))  # fmt: skip
        if self.looks_for_scatter:
            kind, basis = UNEXPLAINED_BASIS
            each, shared = self._bias
            out += [
                Source("rate scatter", jitter, sd=None, price=PRICE["rate scatter"],
                       unexplained=True, type=kind, basis=basis),
                # Another bias in every step is not told from noise that is larger than was said.
                Source("bias drift", each, shared, sd=None, price=PRICE["bias drift"],
                       unexplained=self.bias_time == 0.0, type=kind, basis=basis),
            ]  # fmt: skip
        return tuple(out)

    def _of_placements(self, each: FloatArray) -> FloatArray:
        """Let the steps of a placement share their causes: (n, 3, c) -> (n, 3, p c)."""
        n, _, c = each.shape
        wide = np.zeros((n, 3, int(self.steps.placement.max()) + 1, c))
        wide[np.arange(n), :, self.steps.placement] = each
        return wide.reshape(n, 3, -1)

    @cached_property
    def _slow(self) -> FloatArray:
        """What wander of the bias that was declared does, white causes, shape (n, 3, 3 n)."""
        assert self.steps.slow is not None
        return _alike(wander(self.steps.slow, self.steps.middle, self.steps.time))

    @cached_property
    def _bias(self) -> tuple[FloatArray | None, FloatArray | None]:
        """What a bias that moves by 1 rad/s does: in each step, or shared by them.

        A Gauss-Markov process, or a straight line of that root mean square about the middle of the
        session.
        """
        s = self.steps
        if self.bias_time == 0.0:
            return np.broadcast_to(np.eye(3), s.cov.shape), None
        if np.isinf(self.bias_time):
            line = s.middle - s.half_time
            line /= max(float(np.sqrt(np.mean(line**2))), 1e-12)
            return None, line[:, None, None] * np.eye(3)
        return None, _alike(np.exp(-np.abs(s.middle[:, None] - s.middle) / self.bias_time))


def _alike(cov: FloatArray) -> FloatArray:
    """Return white causes of what three axes do, each with the covariance `cov` over the steps."""
    least = max(1e-9 * float(np.diag(cov).max()), 1e-40)
    root = np.linalg.cholesky(cov + least * np.eye(len(cov)))
    return np.asarray(np.einsum("nk,ij->nikj", root, np.eye(3)).reshape(len(cov), 3, -1))
