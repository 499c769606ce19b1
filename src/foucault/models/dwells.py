"""What a north seeker said: one mean per stop of its base, or per piece of a rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.errors import Finding

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Dwells:
    """Means of one gyro and its accelerometers, n of them over m set-ups.

    Attributes
    ----------
    setup : ndarray of int, shape (n,)
        Number of the set-up of each row, from 0, in order [1].
    names : tuple of str, length m
        Name of each set-up: a survey mark, or a position of the turntable.
    start, time : ndarray, shape (n,)
        Beginning and length of each mean [s].
    index : ndarray, shape (n,)
        Index angle, clockwise seen from above; the middle one of a piece of a rotation [rad].
    cosine, sine : ndarray, shape (n,)
        Means of its cosine and sine over the row [1].
    gyro : ndarray, shape (n,)
        Mean rate as measured [rad/s].
    accel : ndarray, shape (n, 1) or (n, 2), or None
        Mean specific force as measured: along the sensing axis, or right and forward of two
        accelerometers that stay with the case [m/s^2].
    heading : ndarray, shape (m,)
        Heading of y_b by another reference, NaN where unknown [rad].
    interval : float
        Sample interval of the log, 0 where it held means [s].
    findings : tuple of Finding
        What was noticed when they were made.
    turning : ndarray of bool, shape (n,), or None
        Which rows are pieces of a rotation; None where all are stops.
    latitude, latitude_sd : ndarray, shape (m,), or None
        Latitude of each set-up and its standard deviation, NaN where the log does not say it [rad].
    """

    setup: IntArray
    names: tuple[str, ...]
    start: FloatArray
    time: FloatArray
    index: FloatArray
    cosine: FloatArray
    sine: FloatArray
    gyro: FloatArray
    accel: FloatArray | None
    heading: FloatArray
    interval: float = 0.0
    findings: tuple[Finding, ...] = ()
    turning: npt.NDArray[np.bool_] | None = None
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

        Parameters
        ----------
        setup : int, shape ()
            Its number [1].
        """
        return self.rows(np.flatnonzero(self.setup == setup))

    def rows(self, keep: IntArray) -> Dwells:
        """Return some rows; set-ups keep their numbers.

        Parameters
        ----------
        keep : ndarray of int, shape (k,)
            Numbers of the rows [1].
        """
        names = ("setup", "start", "time", "index", "cosine", "sine", "gyro")
        some: dict[str, Any] = {name: getattr(self, name)[keep] for name in names}
        for name in ("accel", "turning"):
            whole = getattr(self, name)
            some[name] = None if whole is None else whole[keep]
        return replace(self, **some)
