"""Where a motion leads on the ellipsoid: its velocity integrated to the last digits.

Level frame l, in one of two kinds:

north
    East-North-Up. The state is latitude, longitude and height::

        L' = v_N / (RM + h)      lon' = v_E / ((RN + h) cos L)      h' = v_U

carried along
    East-North-Up at the start (at a pole: of the longitude given), then carried along without
    turning about up relative to the Earth, w_el has no up component. Nothing grows near the poles,
    and a straight run along the ellipsoid is a geodesic. The state is C_el and the height::

        C_el' = C_el [w_el x]    w_el = c0 (z x v) + c1 (v . p) (z x p)

    with the Earth's axis p in l (third row of C_el), c0 = 1 / (RN + h) and c0 + c1 cos^2 L =
    1 / (RM + h).

Velocity is a known function of time, so that the rates depend on the state through the slow change
of radii and axis alone. The integral equation is solved for all times at once by Picard's
iteration: velocities at the Gauss-Legendre nodes of short panels, the integral of their
interpolating polynomials, new rates, and so on until no digit changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.earth import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS, radii
from foucault.models.geodesy import east_north_up
from foucault.models.rotation import cross_matrix, turned
from foucault.plans.manoeuvres import Start

NORTHERNMOST = np.radians(89.9)
"""Up to here headings may be from north; 11 km from the pole north turns by 5 deg in 1 km [rad]."""

NODES, WEIGHTS = legendre.leggauss(8)
"""Quadrature on a panel, from -1 to 1 [1]."""

# Values at the nodes -> Legendre coefficients of their integral from -1, times half a panel.
_INTEGRAL = legendre.legint(np.linalg.inv(legendre.legvander(NODES, 7)), lbnd=-1)
_TO_NODES = legendre.legvander(NODES, 8) @ _INTEGRAL
_MOST_ROUNDS = 100


@dataclass(frozen=True)
class Path:
    """Position over time, as polynomials on panels."""

    edges: FloatArray  # (p + 1,) edges of the panels, 0 is one of them [s]
    # (p, m) state at the beginning of each panel [rad, m]: latitude, longitude and height, or C_el
    # row by row and height
    begin: FloatArray
    shape: FloatArray  # (p, 9, m) legendre coefficients of its change in the panel [rad, m]

    @property
    def carried(self) -> bool:
        """Whether frame l is carried along."""
        return len(self.begin[0]) == 10

    def _state(self, time: FloatArray, which: slice) -> FloatArray:
        panel = np.clip(np.searchsorted(self.edges, time, side="right") - 1, 0, len(self.begin) - 1)
        left, right = self.edges[panel], self.edges[panel + 1]
        x = (2.0 * time - left - right) / (right - left)
        powers = legendre.legvander(x, 8)
        change = np.einsum("nk,nkm->nm", powers, self.shape[panel, :, which])
        return np.asarray(self.begin[panel, which] + change)

    def axis_and_height(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the Earth's axis, frame l, shape (n, 3) [1], and height, shape (n,) [m].

        `time` (n,): when [s].
        """
        if self.carried:
            y = self._state(time, slice(6, 10))
            return y[:, :3], y[:, 3]
        y = self._state(time, slice(0, 3))
        return np.stack([np.zeros(len(y)), np.cos(y[:, 0]), np.sin(y[:, 0])], axis=-1), y[:, 2]

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return latitude, longitude [rad], height [m], shape (n,), and C_nl, shape (n, 3, 3).

        `time` (n,): when [s].
        """
        y = self._state(time, slice(None))
        if not self.carried:
            alike = np.broadcast_to(np.eye(3), (len(y), 3, 3))
            return y[:, 0], turned(y[:, 1]), y[:, 2], alike
        C_el = y[:, :9].reshape(-1, 3, 3)
        up = C_el[:, :, 2]
        latitude = np.arctan2(up[:, 2], np.hypot(up[:, 0], up[:, 1]))
        longitude = np.arctan2(up[:, 1], up[:, 0])
        C_nl = np.swapaxes(east_north_up(latitude, longitude), 1, 2) @ C_el
        return latitude, longitude, y[:, 9], C_nl


def level_rate(p: FloatArray, height: FloatArray, v: FloatArray, carried: bool) -> FloatArray:
    """Return w_el, frame l, shape (n, 3) [rad/s].

    `p` (n, 3): the Earth's axis, frame l [1]; `height` (n,): height [m]; `v` (n, 3): velocity,
    frame l [m/s]; `carried`: whether l is carried along, without a rate about up, or stays
    East-North-Up.
    """
    d = 1.0 - ECCENTRICITY_SQUARED * p[:, 2] ** 2
    RN = SEMI_MAJOR_AXIS / np.sqrt(d)
    RM = RN * (1.0 - ECCENTRICITY_SQUARED) / d
    c0 = 1.0 / (RN + height)
    c1 = c0 * RN * ECCENTRICITY_SQUARED / (d * (RM + height))
    along = c1 * (v[:, 0] * p[:, 0] + v[:, 1] * p[:, 1])
    x, y = -c0 * v[:, 1] - along * p[:, 1], c0 * v[:, 0] + along * p[:, 0]
    z = np.zeros_like(x) if carried else y * p[:, 2] / p[:, 1]
    return np.stack([x, y, z], axis=-1)


def path_of(
    start: Start, edges: FloatArray, velocity: Callable[[FloatArray], FloatArray], carried: bool
) -> Path:
    """Integrate a velocity that is known as a function of time.

    `edges` (p + 1,): edges of the panels, in order, 0 is one of them [s]; `velocity`: times,
    shape (n,) [s] -> velocity, frame l, shape (n, 3) [m/s]; `carried`: whether l is carried
    along, or stays East-North-Up.
    """
    half = np.diff(edges) / 2
    middle = edges[:-1] + half
    v = velocity((middle[:, None] + half[:, None] * NODES).ravel())
    first = [start.latitude, start.longitude, start.height]
    if carried:
        first = [*east_north_up(start.latitude, start.longitude).ravel(), start.height]
    y0 = np.array(first)
    zero = int(np.flatnonzero(edges == 0.0)[0])
    y = np.broadcast_to(y0, (len(half), len(NODES), len(y0)))
    slope = _carried_slope if carried else _north_slope
    before = np.inf
    for _ in range(_MOST_ROUNDS):
        rate = slope(y.reshape(-1, len(y0)), v).reshape(y.shape)
        whole = np.einsum("p,k,pkm->pm", half, WEIGHTS, rate)
        begin = np.concatenate([np.zeros((1, len(y0))), np.cumsum(whole, axis=0)])
        begin += y0 - begin[zero]
        new = begin[:-1, None] + half[:, None, None] * np.einsum("jk,pkm->pjm", _TO_NODES, rate)
        change = float(np.abs(new[..., :-1] - y[..., :-1]).max())
        y = new
        if not carried:
            _require_far_from_poles(y[..., 0])
        if change == 0.0 or (change < 1e-14 and change >= before):
            break
        before = change
    shape = half[:, None, None] * np.einsum("jk,pkm->pjm", _INTEGRAL, rate)
    return Path(edges, begin[:-1], shape)


def _north_slope(y: FloatArray, v: FloatArray) -> FloatArray:
    RM, RN = radii(y[:, 0])
    h = y[:, 2]
    east = v[:, 0] / ((RN + h) * np.cos(y[:, 0]))
    return np.stack([v[:, 1] / (RM + h), east, v[:, 2]], axis=-1)


def _carried_slope(y: FloatArray, v: FloatArray) -> FloatArray:
    C_el = y[:, :9].reshape(-1, 3, 3)
    turn = C_el @ cross_matrix(level_rate(y[:, 6:9], y[:, 9], v, True))
    return np.concatenate([turn.reshape(-1, 9), v[:, 2:]], axis=1)


def _require_far_from_poles(latitude: FloatArray) -> None:
    farthest = latitude.flat[np.argmax(np.abs(latitude))]
    if not abs(farthest) < NORTHERNMOST:
        limit = np.degrees(NORTHERNMOST)
        raise error("manoeuvre.pole", given=np.degrees(farthest), limit=f"{limit:.4g}")
