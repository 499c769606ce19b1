"""Strapdown navigation: increments and a start state in, the trajectory out.

The mechanisation is that of `kernels.strapdown`; this module validates, calls it once, and says
what its states mean.

References
----------
.. [1] P. G. Savage, "Strapdown inertial navigation integration algorithm design", parts 1 and 2,
   *J. Guidance, Control, and Dynamics* 21 (1998) 19-28 and 208-221 (coning, sculling).
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, sections 5.3 (wander azimuth) and 5.6 (vertical channel).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.kernels.strapdown import AIDED, FREE, HELD, strapdown
from foucault.models.attitude import angles_of
from foucault.models.earth import EQUATORIAL_GRAVITY, SEMI_MAJOR_AXIS
from foucault.navigate.increments import Increments
from foucault.navigate.state import State, state_of, states_of
from foucault.units import plain

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
        """Return every so manieth state, and the last.

        `rows`: steps from one to the next [1].
        """
        keep = np.arange(0, len(self), rows)
        if keep[-1] != len(self) - 1:
            keep = np.append(keep, len(self) - 1)
        return Trajectory(self.time[keep], self.history[keep])

    def state(self, row: int) -> State:
        """Return the state of a row, negative ones counted from the end.

        `row`: its number [1].
        """
        return state_of(self.history[row])

    @cached_property
    def _meaning(self) -> dict[str, FloatArray]:
        return states_of(self.history)

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

    @property
    def C_nb(self) -> FloatArray:  # noqa: N802  the symbol of the conventions
        """Attitude, shape (m, 3, 3) [1]."""
        return self._meaning["C_nb"]

    @cached_property
    def angles(self) -> FloatArray:
        """Heading, pitch and roll, shape (m, 3) [rad]."""
        return angles_of(self.C_nb)


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
    history = strapdown(
        increments.dtheta_b, increments.dvel_b, increments.dt, *increments.bends, first, end,
        state.packed(), gravity_offset, VERTICAL[vertical], aid, gains,
    )  # fmt: skip
    rows = np.arange(first, end + 1) if end >= first else np.arange(first, end - 1, -1)
    require_finite(history, increments, rows)
    return Trajectory(increments.time[rows], history)


def require_finite(
    history: FloatArray, increments: Increments, rows: npt.NDArray[np.int64]
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
