"""Reset a free run that has gone astray, and say what that makes of its errors.

Errors of attitude, velocity and position are vectors in space: seen from the Earth, those of the
new run are those of the old one and a difference that is known without noise. Only the axes of the
level frame, which belong to the computed place, are others::

    psi_new = C_l'l psi_old - log(C_eb_new C_eb_old')     and likewise of v and r
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.geodesy import displaced, east_north_up, ecef
from foucault.models.rotation import exp, log
from foucault.navigate.state import State, state_of, states_of


@dataclass(frozen=True)
class Reset:
    """Where a run goes on, and what that makes of its errors."""

    state: State  # where, how fast and how turned
    # (9, 9) axes of the new level frame from those of the old one, for (psi, dv, dr) [1]
    turn: FloatArray
    jump: FloatArray  # (9,) what is added to the errors, in the new level frame [SI]

    @classmethod
    def of(cls, state: State) -> Reset:
        """Return the beginning of a run."""
        return cls(state, np.eye(9), np.zeros(9))

    @classmethod
    def by(cls, row: FloatArray, turned: FloatArray, faster: FloatArray, away: FloatArray) -> Reset:
        """Return the reset that takes out what a run is thought to be wrong by.

        `row` (12,): state of `kernels.strapdown` at the end of the run [SI]; `turned` (3,):
        rotation vector from the true to the computed attitude, frame n [rad]; `faster` (3,):
        computed less true velocity, frame n [m/s]; `away` (3,): computed less true position,
        frame n [m].
        """
        old = state_of(row)
        latitude, longitude, height = displaced(old.latitude, old.longitude, old.height, -away)
        new = State(float(latitude), float(longitude), float(height), old.velocity_n - faster,
                    exp(-turned) @ old.C_nb)  # fmt: skip
        before, after = _in_space(row), _in_space(new.packed())
        psi = -log(after[0] @ before[0].T)
        C_le = after[3].T
        turn = np.asarray(np.kron(np.eye(3), C_le @ before[3]), np.float64)
        jump = np.concatenate([C_le @ d for d in (psi, after[1] - before[1], after[2] - before[2])])
        return cls(new, turn, jump)


def _in_space(row: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return C_eb, velocity and position in frame e, and C_el of a state."""
    x = states_of(row)
    C_en = east_north_up(float(x["latitude"]), float(x["longitude"]))
    place = ecef(float(x["latitude"]), float(x["longitude"]), float(x["height"]))
    return C_en @ x["C_nb"], C_en @ x["velocity_n"], place, C_en @ x["C_nl"]
