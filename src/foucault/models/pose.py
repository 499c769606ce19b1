"""A pose beside an IMU: its table, and what ties the two together.

`m` is the tracked body, `v` the world of the pose. ``C_bm`` turns the axes of the tracked body into
those of the IMU, ``l_b`` points from the accelerometers to the point whose position the pose gives,
and what the pose stamps t holds at ``t + tau + kappa (t - t_mid)`` of the IMU's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import Layout, coefficients_of
from foucault.errors import Finding

LAYOUT = Layout(coefficients_of("pose"))
"""What is found of a pose beside the errors of an IMU."""

BASE = Layout(coefficients_of("antennas"))
"""What is found of two antennas in place of a rotation."""

READINGS = {
    "w x y z, body to world": ((0, 1, 2, 3), 1.0),
    "x y z w, body to world": ((3, 0, 1, 2), 1.0),
    "w x y z, world to body": ((0, 1, 2, 3), -1.0),
    "x y z w, world to body": ((3, 0, 1, 2), -1.0),
}
"""How four numbers are a quaternion -> which are w, x, y, z, and the sign of its vector."""


@dataclass(frozen=True)
class Second:
    """A second antenna, or prism, beside the tracked point; rows that are NaN were not measured."""

    place: FloatArray  # (k, 3) as `told` says, world of the pose [m]
    # What it is: "position" of the antenna; "base", the vector from the first one to it, measured
    # by itself; "direction" of that, of length 1, whose length is not measured.
    told: str = "position"

    def __getitem__(self, rows: BoolArray | IntArray | slice) -> Second:
        """Return some of the rows."""
        return replace(self, place=self.place[rows])

    def base(self, position: FloatArray) -> FloatArray:
        """Return the vector from the first antenna, at `position` (k, 3) [m], (k, 3) [m]."""
        return self.place - position if self.told == "position" else self.place


@dataclass(frozen=True)
class PoseTable:
    """What a tracking system said, by its own clock and in its own world."""

    time: FloatArray  # (k,) stamps, rising [s]
    position: FloatArray  # (k, 3) position of the tracked point, world of the pose [m]
    # (k, 4) the quaternion, its numbers in the order of the file [1]; None: position alone
    quaternion: FloatArray | None = None
    reading: str | None = None  # a key of `READINGS`, None: the data tell
    second: Second | None = None  # a second antenna, in place of a quaternion
    findings: tuple[Finding, ...] = ()
    source: dict[str, Any] = field(default_factory=dict)  # file and hash

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: BoolArray | slice) -> PoseTable:
        """Return some of the rows."""
        q = None if self.quaternion is None else self.quaternion[rows]
        return replace(self, time=self.time[rows], position=self.position[rows], quaternion=q,
                       second=self.second and self.second[rows])  # fmt: skip

    def attitude(self, reading: str) -> FloatArray:
        """Return C_vm, shape (k, 3, 3), as a key of `READINGS` has it [1]."""
        assert self.quaternion is not None
        order, sign = READINGS[reading]
        w, x, y, z = (self.quaternion / np.linalg.norm(self.quaternion, axis=1)[:, None])[
            :, order
        ].T
        x, y, z = sign * x, sign * y, sign * z
        return np.moveaxis(
            np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
                ]
            ),
            2,
            0,
        )
