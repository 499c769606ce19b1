"""Strapdown navigation: increments and a start state in, the trajectory out.

The mechanisation is that of `kernels.strapdown`; this module validates, calls it once, and says
what its states mean.

References
----------
.. [1] P. G. Savage, "Strapdown inertial navigation integration algorithm design", parts 1 and 2,
   *J. Guidance, Control, and Dynamics* 21 (1998) 19-28 and 208-221 (coning, sculling).
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, sections 5.3 (wander azimuth) and 5.6 (vertical channel).

Position, velocity and attitude at one instant, and how the kernels hold them.

The kernels carry a level frame l along with the instrument that does not turn about up (see
`kernels.strapdown`); people want East-North-Up, frame n. Both are the same where a run starts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import error, require, suggestion
from foucault.kernels.local_level import local_level
from foucault.kernels.strapdown import AIDED, FREE, HELD, strapdown
from foucault.models.earth import EQUATORIAL_GRAVITY, SEMI_MAJOR_AXIS, east_north_up
from foucault.models.rotation import angles_of
from foucault.navigate.increments import Increments
from foucault.tables import numbers
from foucault.units import plain


@dataclass(frozen=True)
class State:
    """Where the instrument is, how it moves and how it is turned.

    Attributes
    ----------
    latitude : float
        Geodetic, positive north [rad].
    longitude : float
        Positive east [rad].
    height : float
        Above the ellipsoid [m].
    velocity_n : ndarray, shape (3,)
        Velocity relative to the Earth: east, north, up [m/s].
    C_nb : ndarray, shape (3, 3)
        Attitude: ``x_n = C_nb @ x_b`` [1].
    """

    latitude: float
    longitude: float
    height: float
    velocity_n: FloatArray
    C_nb: FloatArray

    def __post_init__(self) -> None:
        for name in ("latitude", "longitude", "height"):
            require(name, getattr(self, name), Real)
        for name, shape in (("velocity_n", (3,)), ("C_nb", (3, 3))):
            object.__setattr__(self, name, numbers(name, getattr(self, name), shape))

    @classmethod
    def at_rest(
        cls, C_nb: FloatArray, latitude: float, longitude: float = 0.0, height: float = 0.0
    ) -> State:
        """Return the state of an instrument that stands still on the Earth.

        Parameters
        ----------
        C_nb : ndarray, shape (3, 3)
            Attitude [1].
        latitude, longitude : float, shape ()
            Where it stands [rad].
        height : float, shape ()
            Above the ellipsoid [m].
        """
        return cls(latitude, longitude, height, np.zeros(3), C_nb)

    @property
    def heading(self) -> float:
        """Direction of y_b, clockwise from north, 0 to 2 pi [rad]."""
        return float(angles_of(self.C_nb)[0])

    @property
    def pitch(self) -> float:
        """Angle of y_b above the horizon [rad]."""
        return float(angles_of(self.C_nb)[1])

    @property
    def roll(self) -> float:
        """Right side down [rad]."""
        return float(angles_of(self.C_nb)[2])

    def packed(self) -> FloatArray:
        """Return the state of the kernels, shape (12,); frame l is East-North-Up here [SI]."""
        self._check()
        return np.concatenate([
            quaternion_of(self.C_nb), self.velocity_n,
            quaternion_of(east_north_up(self.latitude, self.longitude)), [self.height],
        ])  # fmt: skip

    def _check(self) -> None:
        numbers = np.concatenate([
            [self.latitude, self.longitude, self.height], self.velocity_n, np.ravel(self.C_nb)
        ])  # fmt: skip
        if not np.isfinite(numbers).all():
            raise error("strapdown.state", what="state", given="not finite", allowed="finite")
        if abs(self.latitude) > np.pi / 2 + 1e-12:
            raise error("strapdown.state", what="latitude", given=f"{plain(self.latitude)} rad",
                        allowed="between -pi/2 and pi/2")  # fmt: skip
        if np.abs(self.C_nb @ self.C_nb.T - np.eye(3)).max() > 1e-6 or np.linalg.det(self.C_nb) < 0:
            raise error("strapdown.state", what="attitude C_nb", given="no rotation matrix",
                        allowed="orthonormal and right-handed")  # fmt: skip


MANY = 1000
"""Rows from which on a kernel turns states, once it is compiled or read; below, NumPy [1]."""


def states_of(x: FloatArray, *, frames: bool = True) -> dict[str, FloatArray]:
    """Return what the states of the kernels mean.

    `x` (..., 12): states of `kernels.strapdown` [SI]; `frames`: whether C_nb and C_nl are wanted;
    without them, those of many rows have none. Returns latitude, longitude [rad], height
    [m], each shape (...); velocity_n (..., 3) [m/s]; C_nb (..., 3, 3) and C_nl (..., 3, 3) [1];
    angles (..., 3): heading, pitch and roll [rad].
    """
    if x.ndim == 2 and len(x) >= MANY:
        m = len(x)
        position, velocity, angles = np.empty((m, 2)), np.empty((m, 3)), np.empty((m, 3))
        C_nb, C_nl = (np.empty((m if frames else 0, 3, 3)) for _ in "bl")
        local_level(np.ascontiguousarray(x), position, velocity, C_nb, C_nl, angles)
        latitude, longitude = position.T
    else:
        C_el = matrix_of(x[..., 7:11])
        up = C_el[..., :, 2]
        latitude = np.arctan2(up[..., 2], np.hypot(up[..., 0], up[..., 1]))
        longitude = np.arctan2(up[..., 1], up[..., 0])
        C_nl = np.swapaxes(east_north_up(latitude, longitude), -1, -2) @ C_el
        velocity = np.einsum("...ij,...j->...i", C_nl, x[..., 4:7])
        C_nb = C_nl @ matrix_of(x[..., :4])
        angles = angles_of(C_nb)
    return {
        "latitude": latitude, "longitude": longitude, "height": x[..., 11],
        "velocity_n": velocity, "C_nb": C_nb, "C_nl": C_nl, "angles": angles,
    }  # fmt: skip


def state_of(x: FloatArray) -> State:
    """Return the state that `x` (12,) of `kernels.strapdown` stands for [SI]."""
    found = states_of(x)
    return State(
        float(found["latitude"]), float(found["longitude"]), float(found["height"]),
        found["velocity_n"], found["C_nb"],
    )  # fmt: skip


def matrix_of(q: FloatArray) -> FloatArray:
    """Return the rotation matrices, (..., 3, 3), of quaternions `q` (..., 4), scalar first [1]."""
    a, b, c, d = np.moveaxis(q, -1, 0)
    out = np.empty((*a.shape, 3, 3))
    out[..., 0, 0] = a * a + b * b - c * c - d * d
    out[..., 1, 1] = a * a - b * b + c * c - d * d
    out[..., 2, 2] = a * a - b * b - c * c + d * d
    out[..., 0, 1], out[..., 1, 0] = 2 * (b * c - a * d), 2 * (b * c + a * d)
    out[..., 0, 2], out[..., 2, 0] = 2 * (b * d + a * c), 2 * (b * d - a * c)
    out[..., 1, 2], out[..., 2, 1] = 2 * (c * d - a * b), 2 * (c * d + a * b)
    return out


def quaternion_of(C: FloatArray) -> FloatArray:
    """Return the unit quaternion of a rotation matrix, shape (4,), scalar first.

    By the largest of the four squares, so that nothing is lost near any angle.

    `C` (3, 3): rotation matrix [1].
    """
    t = np.trace(C)
    squares = np.array([t, *(2 * np.diag(C) - t)])
    k = int(np.argmax(squares))
    if k == 0:
        q = np.array([1 + t, C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]])
    else:
        i = k - 1
        j, m = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = C[m, j] - C[j, m]
        q[1 + i] = 1 + squares[k]
        q[1 + j] = C[j, i] + C[i, j]
        q[1 + m] = C[m, i] + C[i, m]
    return np.asarray(q / np.linalg.norm(q))


Vertical = Literal["free", "held", "aided"]

VERTICAL = {"free": FREE, "held": HELD, "aided": AIDED}

HEIGHT_LOOP = 100.0
"""Time constant of the loop that aids the vertical channel by heights [s]."""


@dataclass(frozen=True)
class Trajectory:
    """States at the ends of intervals; with time running backward after a step back."""

    time: FloatArray  # (m,) when each state holds [s]
    history: FloatArray  # (m, 12) the states of `kernels.strapdown` [SI]

    def __len__(self) -> int:
        return len(self.time)

    def every(self, rows: int) -> Trajectory:
        """Return each `rows`-th [1] state, and the last."""
        keep = np.arange(0, len(self), rows)
        if keep[-1] != len(self) - 1:
            keep = np.append(keep, len(self) - 1)
        return Trajectory(self.time[keep], self.history[keep])

    def state(self, row: int) -> State:
        """Return the state of `row` [1], negative ones counted from the end."""
        return state_of(self.history[row])

    @cached_property
    def _meaning(self) -> dict[str, FloatArray]:
        return states_of(self.history, frames=False)

    @property
    def latitude(self) -> FloatArray:
        """Geodetic latitude, shape (m,) [rad]."""
        return self._meaning["latitude"]

    @property
    def longitude(self) -> FloatArray:
        """Longitude, shape (m,) [rad]."""
        return self._meaning["longitude"]

    @property
    def height(self) -> FloatArray:
        """Height above the ellipsoid, shape (m,) [m]."""
        return self._meaning["height"]

    @property
    def velocity_n(self) -> FloatArray:
        """Velocity east, north, up, shape (m, 3) [m/s]."""
        return self._meaning["velocity_n"]

    @cached_property
    def C_nb(self) -> FloatArray:  # noqa: N802  the symbol of the conventions
        """Attitude, shape (m, 3, 3) [1]."""
        return states_of(self.history)["C_nb"]

    @property
    def angles(self) -> FloatArray:
        """Heading, pitch and roll, shape (m, 3) [rad]."""
        return self._meaning["angles"]


def navigate(
    increments: Increments,
    state: State,
    *,
    first: int = 0,
    last: int | None = None,
    gravity_offset: float = 0.0,
    vertical: Vertical = "free",
    heights: FloatArray | None = None,
) -> Trajectory:
    """Navigate from one row to another, forward or backward.

    Parameters
    ----------
    increments : Increments
        Increments, errors of the instrument removed [SI].
    state : State
        State at the end of row `first`.
    first : int, shape ()
        Row at whose end the run starts [1].
    last : int or None, shape ()
        Row at whose end it stops; before `first` for a run backward. None: the last of all [1].
    gravity_offset : float, shape ()
        Measured local minus normal gravity [m/s^2].
    vertical : {"free", "held", "aided"}
        "free": height is integrated and runs away by and by. "held": height stays, vertical
        velocity is zero. "aided": a third-order loop of `HEIGHT_LOOP` follows `heights`.
    heights : ndarray, shape (n,), or None
        Height at the end of each row, NaN where unknown [m].

    Returns
    -------
    Trajectory
        States from row `first` to row `last`.

    Raises
    ------
    FoucaultError
        Rows outside the log, an impossible start, or samples that are not finite.

    Notes
    -----
    A run backward undoes a run forward to rounding (with free or held height).
    """
    n = len(increments)
    end = n - 1 if last is None else last
    for row in (first, end):
        if not 0 <= row < n:
            raise error("strapdown.rows", row=row, last=n - 1)
    if vertical not in VERTICAL:
        hint = suggestion(vertical, VERTICAL)
        raise error("strapdown.vertical", given=vertical, hint=hint, allowed=", ".join(VERTICAL))
    aid = _heights(heights, n) if vertical == "aided" else np.zeros(0)
    rate = 1.0 / HEIGHT_LOOP
    # The second gain also takes back what gravity, weaker with height, does to an error of it.
    pull = 2 * EQUATORIAL_GRAVITY / SEMI_MAJOR_AXIS
    gains = np.array([3 * rate, 3 * rate**2 + pull, rate**3])
    history = np.empty((abs(end - first) + 1, 12))
    strapdown(
        increments.dtheta_b, increments.dvel_b, increments.dt, *increments.bends, first, end,
        state.packed(), gravity_offset, VERTICAL[vertical], aid, gains, history,
    )  # fmt: skip
    rows = slice(first, end + 1) if end >= first else slice(first, end - 1 if end else None, -1)
    require_finite(history, increments, range(n)[rows])
    return Trajectory(increments.time[rows], history)


def require_finite(
    history: FloatArray, increments: Increments, rows: npt.NDArray[np.int64] | range
) -> None:
    """Refuse states that are not finite; the sample that made them so is named.

    `history` (m, 12): states [SI]; `rows` (m,): the rows at whose ends they hold [1].
    """
    if np.isfinite(history[-1]).all():  # what is not finite stays so
        return
    state = int(rows[np.argmin(np.isfinite(history).all(axis=1))])
    both = np.isfinite(increments.dtheta_b).all(axis=1) & np.isfinite(increments.dvel_b).all(axis=1)
    bad = np.flatnonzero(~both)  # a row shows in the ones beside it too
    row = int(bad[np.argmin(np.abs(bad - state))]) if len(bad) else state
    raise error("strapdown.not_finite", row=row, time=plain(float(increments.time[row]), 9))


def _heights(heights: FloatArray | None, n: int) -> FloatArray:
    if heights is None:
        raise error("strapdown.heights", given="no heights were given")
    if heights.shape != (n,):
        raise error("strapdown.heights", given=f"there are {len(heights)} heights for {n} rows")
    if not np.isfinite(heights).any():
        raise error("strapdown.heights", given="none of the heights is a number")
    return np.ascontiguousarray(heights, float)
