"""How an instrument was turned on a table: directions, and how they change with the unknowns.

Either nothing is believed of the table (`Free`: every reading has a direction of its own, two
unknowns each), or its angles are believed with errors of known size (`Angles`: the mounting, six
errors that all positions share, two more in every position, and the heading).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.models import turntable
from foucault.models.rotation import cross_matrix, exp


@dataclass(frozen=True)
class Axis:
    """The outer axis: the Earth's rate along it, its cosine with up, and their derivatives."""

    earth: float  # Earth's rate along the outer axis [rad/s]
    level: float  # cosine of the angle between the outer axis and up [1]
    # earth_slope, level_slope: (u,) derivatives by the unknowns of the geometry
    earth_slope: FloatArray
    level_slope: FloatArray


class Geometry(Protocol):
    """How the instrument was turned: directions, rest rates, and their derivatives."""

    def directions(self) -> FloatArray:
        """Return up (rest) or the outer axis (spin) in body axes, shape (n, 3) [1]."""
        ...

    def directions_slope(self) -> FloatArray:
        """Return the derivative of `directions` by the unknowns, shape (n, 3, u) [1 / rad]."""
        ...

    def earth(self) -> tuple[FloatArray, FloatArray]:
        """Return the Earth's rate in body axes at rest and its derivative by the unknowns.

        Shapes (n, 3) [rad/s] and (n, 3, u).
        """
        ...

    def axis(self) -> Axis:
        """Return what the tilt of the outer axis does to spins."""
        ...

    def moved(self, step: FloatArray) -> Geometry:
        """Return the geometry after a `step`, shape (u,) [rad]."""
        ...

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the unknowns that have a prior of mean zero, over their sd, and the sd.

        Both shape (u,) [1] and [rad]; an infinite sd where there is none.
        """
        ...


@dataclass(frozen=True)
class Free:
    """Nothing is believed of the table: every reading has its own direction."""

    o: FloatArray  # (n, 3) directions, body axes [1]
    vertical: float = 0.0  # vertical part of the Earth's rate, 0 where unknown [rad/s]

    def directions(self) -> FloatArray:
        """Return `o`."""
        return self.o

    def directions_slope(self) -> FloatArray:
        """Return two tangents per direction, each an unknown of its own."""
        n = len(self.o)
        out = np.zeros((n, 3, n, 2))
        out[np.arange(n), :, np.arange(n), :] = tangents(self.o)
        return out.reshape(n, 3, 2 * n)

    def earth(self) -> tuple[FloatArray, FloatArray]:
        """Return the vertical part; the horizontal part is in the covariance of the readings."""
        return self.vertical * self.o, self.vertical * self.directions_slope()

    def axis(self) -> Axis:
        """Take the outer axis for vertical; `State.level` is there for the specific force."""
        none = np.zeros(2 * len(self.o))
        return Axis(self.vertical, 1.0, none, none)

    def moved(self, step: FloatArray) -> Free:
        """Return the directions moved along their tangents by `step`, shape (2 n,) [rad]."""
        shift = np.einsum("nik,nk->ni", tangents(self.o), step.reshape(-1, 2))
        size = np.linalg.norm(shift, axis=1, keepdims=True)
        o = np.cos(size) * self.o + np.sinc(size / np.pi) * shift
        return replace(self, o=o / np.linalg.norm(o, axis=1, keepdims=True))

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return that nothing is known."""
        n = 2 * len(self.o)
        return np.zeros(n), np.full(n, np.inf)


def tangents(o: FloatArray) -> FloatArray:
    """Return two unit vectors across each direction, shape (n, 3, 2) [1].

    `o` (n, 3): unit vectors [1].
    """
    least = np.eye(3)[np.argmin(np.abs(o), axis=1)]
    first = np.cross(o, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(o, first)], axis=2)


@dataclass(frozen=True)
class Trust:
    """How far the angles of a table are believed."""

    # (6,) sd of the errors that all positions share, in the order of `turntable.COMMON`; 0 where an
    # error is excluded [rad]
    common_sd: FloatArray
    # sd of the errors that differ from one position to the next; 0 excludes them [rad]
    position_sd: float
    latitude: float | None  # latitude, for the Earth's rate at rest [rad]


DOUBTED = np.radians(30.0)
"""Sd of an angle that is not believed: wide enough to say nothing, and finite, since an inner angle
about the vertical is seen by nothing else [rad]."""

STRAIGHT = 1e-6
"""Steps smaller than this need no correction: its square is beyond any reading [rad]."""


@dataclass(frozen=True)
class Angles:
    """The angles of the table are believed, with errors of known size."""

    readings_angles: FloatArray  # (n, 3) outer, middle and inner angle as the table says [rad]
    spin: npt.NDArray[np.bool_]  # (n,) which readings are spins
    trust: Trust  # sizes of the errors
    C_bk: FloatArray  # (3, 3) mounting [1]
    common: FloatArray  # (6,) errors that all positions share [rad]
    position: FloatArray  # (n, 2) errors of the middle and inner angle in each position [rad]
    heading: float | None  # azimuth of table y [rad]; None where no rest says anything of it
    doubted: tuple[int, ...] = ()  # (k,) readings whose middle and inner angle are not believed [1]

    @property
    def used(self) -> npt.NDArray[np.intp]:
        """Which of the common errors are unknowns, shape (<= 6,)."""
        return np.flatnonzero(self.trust.common_sd > 0)

    @cached_property
    def _chain(self) -> turntable.Chain:
        errors = turntable.TableErrors.of(self.common)
        return turntable.chain(self.readings_angles, errors, self.position)

    def directions(self) -> FloatArray:
        """Return up (rest) or the outer axis (spin)."""
        at = self._chain
        return np.where(self.spin[:, None], at.outer_k, at.up_k) @ self.C_bk.T

    def directions_slope(self) -> FloatArray:
        """Return the derivative by mounting, common errors, position errors and heading."""
        at = self._chain
        o = np.where(self.spin[:, None], at.outer_k, at.up_k) @ self.C_bk.T
        axes = self.C_bk @ at.axes
        # What comes before the outer axis does not move it.
        axes[self.spin, :, : turntable.OUTER + 1] = 0.0
        return self._slope(o, axes, np.zeros_like(o))

    def _slope(self, v: FloatArray, axes: FloatArray, heading: FloatArray) -> FloatArray:
        """Return how vectors v, shape (n, 3), turn: ``dv = v x a de`` for every axis a."""
        n = len(v)
        cross = cross_matrix(v)
        turned = cross @ axes
        columns = [cross, turned[:, :, [turntable.COMMON_AXES[k] for k in self.used]]]
        if self.trust.position_sd > 0:
            each = np.zeros((n, 3, n, 2))
            each[np.arange(n), :, np.arange(n), :] = turned[
                :, :, [turntable.MIDDLE, turntable.INNER]
            ]
            columns.append(each.reshape(n, 3, 2 * n))
        if self.heading is not None:
            columns.append(heading[:, :, None])
        return np.concatenate(columns, axis=2)

    def earth(self) -> tuple[FloatArray, FloatArray]:
        """Return the Earth's rate at rest."""
        at = self._chain
        n = len(self.spin)
        if self.heading is None or self.trust.latitude is None:
            zero = np.zeros((n, 3))
            return zero, self._slope(zero, np.zeros((n, 3, 7)), zero)
        C_bt = self.C_bk @ np.swapaxes(at.C_tk, 1, 2)
        w_t = turntable.earth_rate_t(self.trust.latitude, self.heading)
        w = C_bt @ w_t
        quarter = turntable.earth_rate_t(self.trust.latitude, self.heading + np.pi / 2)
        by_heading = C_bt @ np.array([quarter[0], quarter[1], 0.0])
        return w, self._slope(w, self.C_bk @ at.axes, by_heading)

    def axis(self) -> Axis:
        """Return what the plumb errors of the table do."""
        x, y = self.common[:2]
        o = np.array([np.sin(y), -np.sin(x) * np.cos(y), np.cos(x) * np.cos(y)])
        by_x = np.array([0.0, -np.cos(x) * np.cos(y), -np.sin(x) * np.cos(y)])
        by_y = np.array([np.cos(y), np.sin(x) * np.sin(y), -np.cos(x) * np.sin(y)])
        w, quarter = np.zeros(3), np.zeros(3)
        if self.trust.latitude is not None:
            w = turntable.earth_rate_t(self.trust.latitude, self.heading or 0.0)
            quarter = turntable.earth_rate_t(self.trust.latitude, (self.heading or 0.0) + np.pi / 2)
            quarter[2] = 0.0
        if self.heading is None:
            w[:2] = 0.0
        earth, level = np.zeros(len(self.prior()[0])), np.zeros(len(self.prior()[0]))
        for k, by in ((0, by_x), (1, by_y)):
            for at in 3 + np.flatnonzero(self.used == k):
                earth[at], level[at] = w @ by, by[2]
        if self.heading is not None:
            earth[-1] = quarter @ o
        return Axis(float(w @ o), float(o[2]), earth, level)

    def moved(self, step: FloatArray) -> Angles:
        """Return the geometry after a `step`, shape (u,) [rad].

        Directions follow the step along straight lines: readings tell them far better than the
        angles, and an iteration that left them would bend its way along a narrow valley.
        """
        used, n = self.used, len(self.spin)
        common = self.common.copy()
        common[used] += step[3 : 3 + len(used)]
        at = 3 + len(used)
        heading = None if self.heading is None else self.heading + float(step[-1])
        new = replace(self, C_bk=exp(-step[:3]) @ self.C_bk, common=common, heading=heading)
        if self.trust.position_sd == 0:
            return new
        new = replace(new, position=self.position + step[at : at + 2 * n].reshape(n, 2))
        if np.abs(step).max() < STRAIGHT:
            return new
        o = self.directions() + self.directions_slope() @ step
        return new.pointed(o / np.linalg.norm(o, axis=1, keepdims=True))

    def pointed(self, o: FloatArray) -> Angles:
        """Change the angles of every position until they give directions.

        `o` (n, 3): directions wanted, body axes [1].
        """
        new = self
        for _ in range(4):
            at = new._chain
            now = np.where(new.spin[:, None], at.outer_k, at.up_k) @ new.C_bk.T
            axes = new.C_bk @ at.axes[:, :, [turntable.MIDDLE, turntable.INNER]]
            # The inner angle does nothing where its axis is vertical: it is left as it is then.
            back = np.linalg.pinv(cross_matrix(now) @ axes, rcond=1e-2)
            turn = np.einsum("nij,nj->ni", back, o - now)
            new = replace(new, position=new.position + turn)
        return new

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the errors of the table over their sds, and the sds."""
        none, free = np.zeros(3), np.full(3, np.inf)
        values, sds = [none, self.common[self.used]], [free, self.trust.common_sd[self.used]]
        if self.trust.position_sd > 0:
            values.append(self.position.reshape(-1))
            each = np.full(self.position.shape, self.trust.position_sd)
            each[list(self.doubted)] = DOUBTED
            sds.append(each.reshape(-1))
        if self.heading is not None:
            values.append(np.zeros(1))
            sds.append(np.full(1, np.inf))
        sd = np.concatenate(sds)
        return np.concatenate(values) / sd, sd
