"""What errors do to a run without measurements: responses, and the covariance that grows."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.estimate.ins_filter import Updates, run, seen_at_place
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments
from foucault.navigate.state import State

LONGEST = 30.0
"""White noise is right to 1e-3 of a variance where no epoch of a long run is longer [s]."""


def sensitivity(
    increments: Increments,
    state: State,
    sensors: Sensors,
    rows: IntArray,
    *,
    first: int = 0,
    gravity_offset: float = 0.0,
    held: bool = False,
) -> FloatArray:
    """Return how start errors and coefficients show in a run without measurements.

    `increments`: increments [SI]; `rows` (m,): rows to look at, rising [1]; `first`: row at whose
    end the run starts [1]; `gravity_offset`: measured local minus normal gravity [m/s^2]. Returns
    (m, 9, 9 + p): errors at each row (phi, velocity, position as seen at the place, frame n) per
    unit of the errors at the start (psi, dv, dr) and of each coefficient [SI].
    """
    found = run(
        increments, state, sensors, Updates.none(rows), np.zeros((9 + len(sensors),) * 2),
        ImuNoise(), first=first, gravity_offset=gravity_offset, held=held, keep=True,
    )  # fmt: skip
    out = np.empty_like(found.transitions)
    total = np.eye(9, 9 + len(sensors))
    seen = seen_at_place(found.trajectory.history)
    for k, Phi in enumerate(found.transitions):
        total = Phi[:, :9] @ total
        total[:, 9:] += Phi[:, 9:]
        out[k] = seen[k] @ total
    return out


def spread(
    increments: Increments,
    state: State,
    sensors: Sensors,
    rows: IntArray,
    P0: FloatArray,
    noise: ImuNoise,
    *,
    first: int = 0,
    gravity_offset: float = 0.0,
    held: bool = False,
) -> FloatArray:
    """Return the covariance of a run without measurements, as seen at the place.

    `increments`: increments [SI]; `rows` (m,): rows to look at, rising [1]; `P0` (9 + p, 9 + p):
    covariance at the start, see `start_cov` [SI]; `noise`: white noise of the triads [SI];
    `first`: row at whose end the run starts [1]; `gravity_offset`: measured local minus normal
    gravity [m/s^2]. Returns (m, 9, 9): covariance of phi [rad], velocity [m/s] and position [m]
    errors, frame n.
    """
    # Noise is put in where epochs begin and end: they must be short against what it does.
    time = increments.time[first : int(rows[-1]) + 1]
    marks = np.arange(time[0] + LONGEST, time[-1], LONGEST)
    epochs = np.union1d(rows, first + np.searchsorted(time, marks))
    found = run(
        increments, state, sensors, Updates.none(epochs), P0, noise, first=first,
        gravity_offset=gravity_offset, held=held, keep=True,
    )  # fmt: skip
    wanted = np.searchsorted(epochs, rows)
    A = seen_at_place(found.trajectory.history[wanted])
    return np.asarray(A @ found.after[wanted, :9, :9] @ np.swapaxes(A, 1, 2))
