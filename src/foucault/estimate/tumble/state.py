"""The log of a tumble as the kernels take it, what is wanted of it, and what is known beforehand.

Local gravity is 1 in all of it, and n is East-North-Up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.models.rotation import exp, log, right_jacobian_inverse

STATES = 46
"""Attitude at the start 3, constants 42, delay 1."""

DELAY_UNIT = 0.01
"""A delay that is not estimated is tested in units of this [s]."""


@dataclass(frozen=True)
class Tumble:
    """A log of a torqued cluster, ready for the kernels: local gravity is 1."""

    dt: FloatArray  # (n,) length of the intervals [s]
    command: FloatArray  # (n, 3) rate commanded during each [rad/s]
    # (n, 3) of the accelerometers, at the end of each or its mean over each [local g]
    reading: FloatArray
    used: npt.NDArray[np.bool_]  # (n,) which readings count
    w_ie_n: FloatArray  # (3,) the Earth's rate in n [rad/s]
    gravity: float  # local gravity [m/s^2]
    gyro_psd: float  # white noise of the gyros [rad^2/s]
    accel_variance: float  # variance of one reading [local g^2]
    # (3, 3) positions of the accelerometers in its rows, frame p [m]
    arms: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    mean: bool = False  # whether readings are means over the interval
    block: int = 1  # so many readings are averaged to one residual [1]
    # correlation of the noise of neighbouring averages, from -0.5 where it is rounding alone that
    # is carried to the next reading to 0 [1]
    shared: float = 0.0
    # by how much all readings are older than that, whatever delay is estimated besides [s]
    late: float = 0.0


@dataclass(frozen=True)
class State:
    """What is wanted of a tumble."""

    C_np: FloatArray  # (3, 3) attitude at the start [1]
    # (42,) in the order of `models.cluster.CONSTANTS` and packed: local gravity is 1
    constants: FloatArray
    delay: float = 0.0  # of the readings against the command [s]

    def moved(self, x: FloatArray) -> State:
        """Return the state after a step.

        `x` (46,): rotation in n [rad], constants [packed], delay [s].
        """
        return State(exp(x[:3]) @ self.C_np, self.constants + x[3:45], self.delay + float(x[45]))


@dataclass(frozen=True)
class Prior:
    """What is known of it beforehand."""

    mean: State
    # (46,) standard deviations: of the attitude at the start about East, North, Up [rad], of the
    # constants [packed], of the delay [s]; zero holds a value
    sd: FloatArray

    @property
    def unit(self) -> FloatArray:
        """What the entries of a step are in units of, shape (46,)."""
        return np.where(self.sd > 0, self.sd, DELAY_UNIT)

    @property
    def sought(self) -> IntArray:
        """Entries that are estimated."""
        return np.flatnonzero(self.sd > 0)

    def rows(self, at: State) -> tuple[FloatArray, FloatArray]:
        """Return the white residuals, shape (46,), and their slopes by x / sd, shape (46, 46)."""
        safe = np.where(self.sd > 0, self.sd, 1.0)
        phi = log(at.C_np @ self.mean.C_np.T)
        slope = np.eye(STATES)
        left = right_jacobian_inverse(phi).T  # Log(Exp(x) Exp(phi)) = phi + left x
        slope[:3, :3] = left * self.sd[:3] / safe[:3, None]
        ahead = np.concatenate(
            [phi, at.constants - self.mean.constants, [at.delay - self.mean.delay]]
        )
        return np.where(self.sd > 0, -ahead / safe, 0.0), slope
