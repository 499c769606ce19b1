"""Position, velocity and attitude at one instant, and how the kernels hold them.

The kernels carry a level frame l along with the instrument that does not turn about up (see
`kernels.strapdown`); people want East-North-Up, frame n. Both are the same where a run starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.attitude import angles_of
from foucault.models.geodesy import east_north_up
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
        shapes = np.shape(self.velocity_n), np.shape(self.C_nb)
        if shapes != ((3,), (3, 3)):
            raise error("strapdown.state", what="velocity_n and C_nb", given=f"of shapes {shapes}",
                        allowed="of shapes ((3,), (3, 3))")  # fmt: skip
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


def states_of(x: FloatArray) -> dict[str, FloatArray]:
    """Return what the states of the kernels mean.

    `x` (..., 12): states of `kernels.strapdown` [SI]. Returns latitude, longitude [rad], height
    [m], each shape (...); velocity_n (..., 3) [m/s]; C_nb (..., 3, 3) and C_nl (..., 3, 3) [1].
    """
    C_el = matrix_of(x[..., 7:11])
    up = C_el[..., :, 2]
    latitude = np.arctan2(up[..., 2], np.hypot(up[..., 0], up[..., 1]))
    longitude = np.arctan2(up[..., 1], up[..., 0])
    C_nl = np.swapaxes(east_north_up(latitude, longitude), -1, -2) @ C_el
    return {
        "latitude": latitude,
        "longitude": longitude,
        "height": x[..., 11],
        "velocity_n": np.einsum("...ij,...j->...i", C_nl, x[..., 4:7]),
        "C_nb": C_nl @ matrix_of(x[..., :4]),
        "C_nl": C_nl,
    }


def state_of(x: FloatArray) -> State:
    """Return the state that an x of the kernels stands for.

    `x` (12,): state of `kernels.strapdown` [SI].
    """
    found = states_of(x)
    return State(
        float(found["latitude"]), float(found["longitude"]), float(found["height"]),
        found["velocity_n"], found["C_nb"],
    )  # fmt: skip


def matrix_of(q: FloatArray) -> FloatArray:
    """Return the rotation matrices, shape (..., 3, 3), of unit quaternions.

    `q` (..., 4): quaternions, scalar first [1].
    """
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
