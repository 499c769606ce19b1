"""What a north seeker said: one mean per stop of its base, or per piece of a rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Finding


@dataclass(frozen=True)
class Dwells:
    """Means of one gyro and its accelerometers, n of them over m set-ups."""

    setup: IntArray  # (n,) number of the set-up of each row, from 0, in order [1]
    names: tuple[str, ...]  # name of each set-up: a survey mark, or a position of the turntable
    # start, time: (n,) beginning and length of each mean [s]
    start: FloatArray
    time: FloatArray
    # (n,) index angle, clockwise seen from above; the middle one of a piece of a rotation [rad]
    index: FloatArray
    # cosine, sine: (n,) means of its cosine and sine over the row [1]
    cosine: FloatArray
    sine: FloatArray
    gyro: FloatArray  # (n,) mean rate as measured [rad/s]
    # (n, 1) or (n, 2) mean specific force as measured: along the sensing axis, or right and forward
    # of two accelerometers that stay with the case [m/s^2]
    accel: FloatArray | None
    heading: FloatArray  # (m,) heading of y_b by another reference, NaN where unknown [rad]
    interval: float = 0.0  # sample interval of the log, 0 where it held means [s]
    findings: tuple[Finding, ...] = ()  # what was noticed when they were made
    # (n,) which rows are pieces of a rotation; None where all are stops
    turning: npt.NDArray[np.bool_] | None = None
    # latitude, latitude_sd: (m,) latitude of each set-up and its standard deviation, NaN where the
    # log does not say it [rad]
    latitude: FloatArray | None = None
    latitude_sd: FloatArray | None = None

    @property
    def rotates(self) -> bool:
        """Whether all rows are pieces of a rotation."""
        return self.turning is not None and bool(self.turning.all())

    def __len__(self) -> int:
        return len(self.gyro)

    def of(self, setup: int) -> Dwells:
        """Return the rows of one set-up.

        `setup`: its number [1].
        """
        return self.rows(np.flatnonzero(self.setup == setup))

    def rows(self, keep: IntArray) -> Dwells:
        """Return some rows; set-ups keep their numbers.

        `keep` (k,): numbers of the rows [1].
        """
        names = ("setup", "start", "time", "index", "cosine", "sine", "gyro")
        some: dict[str, Any] = {name: getattr(self, name)[keep] for name in names}
        for name in ("accel", "turning"):
            whole = getattr(self, name)
            some[name] = None if whole is None else whole[keep]
        return replace(self, **some)
