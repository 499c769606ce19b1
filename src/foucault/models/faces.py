"""What an instrument said on its six faces, and while it was turned about an axis of its case.

Case axes k are those of the faces: in a rest on a face one of them is vertical. Directions are
nominal ones; how far the instrument really was from them is part of the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.tables import AXES

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SIX = tuple((axis, sign) for axis in range(3) for sign in (1, -1))
"""The six faces: the case axis that is vertical, and +1 where it points up."""


@dataclass(frozen=True)
class FaceReadings:
    """Means over rests on faces.

    Attributes
    ----------
    up_k : ndarray, shape (n, 3)
        Nominal direction of up, a case axis or its opposite [1].
    accel : ndarray, shape (n, 3)
        Mean specific force as measured [m/s^2].
    gyro : ndarray, shape (n, 3), or None
        Mean rate as measured [rad/s].
    start, time : ndarray, shape (n,)
        Beginning and length of each rest [s].
    group : ndarray of int, shape (n,)
        Rests with the same number are one placement: nothing but whole turns between them.
    """

    up_k: FloatArray
    accel: FloatArray
    gyro: FloatArray | None
    start: FloatArray
    time: FloatArray
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
    """Integrals over turns about case axes.

    Attributes
    ----------
    axis_k : ndarray, shape (m, 3)
        The case axis turned about, positive [1].
    angle : ndarray, shape (m,)
        Angle turned about it, positive by the right hand [rad].
    up_k : ndarray, shape (m, 3)
        Nominal direction of up when the turn starts [1].
    gyro : ndarray, shape (m, 3)
        Integral of the rate as measured [rad].
    accel : ndarray, shape (m, 3)
        Integral of the specific force as measured [m/s].
    start, time : ndarray, shape (m,)
        Beginning and length of each integral [s].
    group : ndarray of int, shape (m,)
        The placement, as in `FaceReadings`.
    first, last : ndarray of int, shape (m,)
        First sample of each integral and the sample after its last.
    """

    axis_k: FloatArray
    angle: FloatArray
    up_k: FloatArray
    gyro: FloatArray
    accel: FloatArray
    start: FloatArray
    time: FloatArray
    group: IntArray
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

    Parameters
    ----------
    axis : int, shape ()
        0, 1 or 2 for x, y or z [1].
    sign : float
        +1 where it points up [1].
    """
    return f"{AXES[axis]} {'up' if sign > 0 else 'down'}"


def turn_name(axis: int, angle: float, about_up: float) -> str:
    """Return a turn in words, such as "about x, x up, clockwise seen from above".

    Parameters
    ----------
    axis : int, shape ()
        0, 1 or 2 for x, y or z [1].
    angle : float
        Angle about that axis [rad].
    about_up : float
        +1 where the axis points up, -1 where down, 0 where it is level [1].
    """
    name = AXES[axis]
    if about_up == 0:
        return f"about {name}, {name} level, {'positive' if angle > 0 else 'negative'} sense"
    sense = "counter-clockwise" if angle * about_up > 0 else "clockwise"
    return f"about {name}, {face_name(axis, about_up)}, {sense} seen from above"
