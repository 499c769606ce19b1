"""What an instrument said on its six faces, and while it was turned about an axis of its case.

Case axes k are those of the faces: in a rest on a face one of them is vertical. Directions are
nominal ones; how far the instrument really was from them is part of the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.tables import AXES

SIX = tuple((axis, sign) for axis in range(3) for sign in (1, -1))
"""The six faces: the case axis that is vertical, and +1 where it points up."""


@dataclass(frozen=True)
class FaceReadings:
    """Means over rests on faces."""

    up_k: FloatArray  # (n, 3) nominal direction of up, a case axis or its opposite [1]
    accel: FloatArray  # (n, 3) mean specific force as measured [m/s^2]
    gyro: FloatArray | None  # (n, 3) mean rate as measured [rad/s]
    # start, time: (n,) beginning and length of each rest [s]
    start: FloatArray
    time: FloatArray
    # (n,) rests with the same number are one placement: nothing but whole turns between them
    group: IntArray

    def __len__(self) -> int:
        return len(self.up_k)

    @property
    def axis(self) -> IntArray:
        """Number of the case axis that is vertical, shape (n,)."""
        return np.asarray(np.argmax(np.abs(self.up_k), axis=1), dtype=np.int64)

    @property
    def sign(self) -> FloatArray:
        """+1 where that axis points up, -1 where down, shape (n,) [1]."""
        return np.asarray(self.up_k.sum(axis=1))


@dataclass(frozen=True)
class TurnReadings:
    """Integrals over turns about case axes."""

    axis_k: FloatArray  # (m, 3) the case axis turned about, positive [1]
    angle: FloatArray  # (m,) angle turned about it, positive by the right hand [rad]
    up_k: FloatArray  # (m, 3) nominal direction of up when the turn starts [1]
    gyro: FloatArray  # (m, 3) integral of the rate as measured [rad]
    accel: FloatArray  # (m, 3) integral of the specific force as measured [m/s]
    # start, time: (m,) beginning and length of each integral [s]
    start: FloatArray
    time: FloatArray
    group: IntArray  # (m,) the placement, as in `FaceReadings`
    # first, last: (m,) first sample of each integral and the sample after its last
    first: IntArray
    last: IntArray

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def axis(self) -> IntArray:
        """Number of the case axis turned about, shape (m,)."""
        return np.asarray(np.argmax(self.axis_k, axis=1), dtype=np.int64)

    @property
    def about_up(self) -> FloatArray:
        """+1 where the axis points up, -1 where down, 0 where it is level, shape (m,) [1]."""
        return np.asarray(np.sum(self.axis_k * self.up_k, axis=1))


def face_name(axis: int, sign: float) -> str:
    """Return a face in words, such as "x up".

    `axis`: 0, 1 or 2 for x, y or z [1]; `sign`: +1 where it points up [1].
    """
    return f"{AXES[axis]} {'up' if sign > 0 else 'down'}"


def turn_name(axis: int, angle: float, about_up: float) -> str:
    """Return a turn in words, such as "about x, x up, clockwise seen from above".

    `axis`: 0, 1 or 2 for x, y or z [1]; `angle`: angle about that axis [rad]; `about_up`: +1
    where the axis points up, -1 where down, 0 where it is level [1].
    """
    name = AXES[axis]
    if about_up == 0:
        return f"about {name}, {name} level, {'positive' if angle > 0 else 'negative'} sense"
    sense = "counter-clockwise" if angle * about_up > 0 else "clockwise"
    return f"about {name}, {face_name(axis, about_up)}, {sense} seen from above"
