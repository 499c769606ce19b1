"""A north seeker: one gyro on an indexing base, and the tilt of the case from gravity.

The case b is right-forward-up; its attitude is heading psi (of y_b, clockwise from north), pitch
theta (nose up) and roll gamma (right side down)::

    C_bn = C_y(gamma) C_x(theta) C_z(psi)
    w_b  = C_bn (0, cos L, sin L) w_ie        the Earth's rate
    f_b  = C_bn (0, 0, g)                     specific force, up

At the index angle a, clockwise seen from above, the sensing axis is ``e(a) = (sin a, cos a, 0)``.
What sensor and base do wrong repeats with the index angle, so that it acts like the errors of a
gyro with two axes, x and y, whose readings the base resolves::

    gyro(a)  = offset + drift t + e(a) . ((I + S_g + M_g) w_b + b_g)
    accel(a) = offset + e(a) . ((I + S_a + M_a) f_b + b_a)

with the coefficients of `models.imu`; z is no output axis, but an input axis. Accelerometers that
stay with the case read the two components directly, without offset.

References
----------
.. [1] Liu Cheng, "Parameter compensation algorithm for four-position FOG north seeker",
   Piezoelectrics & Acoustooptics, 2016, eqs. (6)-(11), (34)-(39).
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 5.5.1 (gyrocompassing).

What a north seeker said: one mean per stop of its base, or per piece of a rotation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray, chosen
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import Finding
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.imu_layout import coefficient_slot

EQUATION = (
    "gyro(a) = o + d t + e(a) . ((I + S_g + M_g) w + b_g);  "
    "accel(a) = o_a + e(a) . ((I + S_a + M_a) f + b_a);  e(a) = (sin a, cos a, 0);  "
    "w: true angular rate, f: true specific force, both in body axes; a: index angle, clockwise "
    "seen from above; o, d: offset and drift of the gyro, found in every set-up"
)
"""The model equation in words, as stored in results."""

RATE_LEVEL = (
    "gyro.bias.x", "gyro.bias.y", "gyro.scale.x", "gyro.scale.y",
    "gyro.misalignment.xy", "gyro.misalignment.yx",
)  # fmt: skip
"""The six parameters of the gyro that a level turntable shows."""

RATE_TILTED = (*RATE_LEVEL, "gyro.misalignment.xz", "gyro.misalignment.yz")
"""The eight that a tilted one shows."""

FORCE = ("accel.bias.x", "accel.bias.y", "accel.scale.x", "accel.scale.y",
         "accel.misalignment.yx")  # fmt: skip
"""Errors of the accelerometer that matter."""

SEEKER = Layout(tuple(c for c in LAYOUT.coefficients if c.name in (*RATE_TILTED, *FORCE)))
"""All coefficients of a north seeker."""


def attitude(heading: FloatArray, pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """Return C_bn, shape (..., 3, 3): maps East-North-Up to the case.

    `heading` (...): of y_b, clockwise from north [rad]; `pitch` (...): nose up [rad]; `roll`
    (...): right side down [rad].
    """
    sf, cf = np.sin(heading), np.cos(heading)
    st, ct = np.sin(pitch), np.cos(pitch)
    sg, cg = np.sin(roll), np.cos(roll)
    rows = (
        (cg * cf + sg * st * sf, sg * st * cf - cg * sf, -sg * ct),
        (ct * sf, ct * cf, st),
        (sg * cf - cg * st * sf, -sg * sf - cg * st * cf, cg * ct),
    )
    return np.stack([np.stack(np.broadcast_arrays(*row), -1) for row in rows], -2)


def earth_rate_b(
    heading: FloatArray, pitch: FloatArray, roll: FloatArray, latitude: FloatArray
) -> FloatArray:
    """Return the Earth's rate in the case, shape (..., 3) [rad/s].

    `heading` (...): of y_b, clockwise from north [rad]; `pitch` (...): nose up [rad]; `roll`
    (...): right side down [rad]; `latitude` (...): positive north [rad].
    """
    C = attitude(heading, pitch, roll)
    cl, sl = np.cos(latitude)[..., None], np.sin(latitude)[..., None]
    return np.asarray(EARTH_RATE * (C[..., 1] * cl + C[..., 2] * sl))  # eqs. (6)-(8) of ref. [1]


def up_b(pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """Return up in the case, shape (..., 3) [1]; specific force at rest is g times it.

    `pitch` (...): nose up [rad]; `roll` (...): right side down [rad].
    """
    ct = np.cos(pitch)
    return np.stack(  # minus eqs. (9)-(11) of ref. [1], which are gravity
        np.broadcast_arrays(-np.sin(roll) * ct, np.sin(pitch), np.cos(roll) * ct), -1
    )


@dataclass(frozen=True)
class Compensation:
    """What is known of the instrument: its coefficients with covariance."""

    # some of `SEEKER`, with covariance where they were calibrated [SI]
    coefficients: CoefficientVector = field(
        default_factory=lambda: CoefficientVector.zeros(SEEKER.subset(()))
    )
    serial: str = ""  # of which instrument; empty where unknown

    @cached_property
    def model(self) -> ImuModel:
        """The same as matrices."""
        return ImuModel.from_coefficients(self.coefficients)

    def predict(self, w_b: FloatArray, f_b: FloatArray) -> FloatArray:
        """Return what the base resolves: gyro x, y and accelerometer x, y, shape (..., 4) [SI].

        `w_b` (..., 3): true rate in the case [rad/s]; `f_b` (..., 3): true specific force in the
        case [m/s^2].
        """
        model = self.model
        rate = w_b @ model.gyro_matrix[:2].T + model.gyro_bias[:2]
        force = f_b @ model.accel_matrix[:2].T + model.accel_bias[:2]
        return np.concatenate([rate, force], axis=-1)

    def slopes(self, w_b: FloatArray, f_b: FloatArray) -> FloatArray:
        """Return d predict / d coefficients, shape (..., 4, n) [SI].

        `w_b` (..., 3): true rate in the case [rad/s]; `f_b` (..., 3): true specific force in the
        case [m/s^2].
        """
        slopes = self.model.slopes(f_b, w_b, self.coefficients.names)
        return np.concatenate([slopes.gyro[..., :2, :], slopes.accel[..., :2, :]], axis=-2)

    def spread(
        self, angles: FloatArray, gravity: float | FloatArray, root: FloatArray,
        share: FloatArray | None = None,
    ) -> FloatArray:  # fmt: skip
        """Return what a `root` (n, c) of a covariance of coefficients does to the four numbers.

        `angles` (m, 4): heading, pitch, roll, latitude, taken for 0 where they are not finite
        [rad]; `gravity` (m,): [m/s^2]; `share` (m, 4, 4) or None: what of that is in them, None for
        all [1]. Returns (m, 4, c) [SI].
        """
        from foucault.kernels.north_seeking import calibration_batch

        at = [coefficient_slot(name) for name in self.coefficients.names]
        places = [one if isinstance(one, tuple) else (one,) for _, one in at]
        output = [2 * (b[0] == "a") + p[0] for (b, _), p in zip(at, places, strict=True)]
        factor = [0 if len(p) == 1 else p[1] + (1 if b[0] == "a" else 4)
                  for (b, _), p in zip(at, places, strict=True)]  # fmt: skip
        out = np.empty((len(angles), 4, root.shape[1]))
        calibration_batch(
            np.where(np.isfinite(angles), angles, 0.0), np.full(len(angles), gravity), EARTH_RATE,
            np.array(output, np.int64), np.array(factor, np.int64), np.ascontiguousarray(root),
            np.zeros((0, 4, 4)) if share is None else share, out,
        )  # fmt: skip
        return out


@dataclass(frozen=True)
class Dwells:
    """Means of one gyro and its accelerometers, n of them over m set-ups."""

    setup: IntArray  # (n,) number of the set-up of each row, from 0, in order [1]
    names: Sequence[str]  # name of each set-up: a survey mark, or a position of the turntable
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

    @cached_property
    def first(self) -> IntArray:
        """Number of the first row of each set-up, and of all rows, shape (m + 1,) [1]."""
        return np.cumsum(np.append(0, np.bincount(self.setup, minlength=len(self.names))))

    def of(self, setup: int) -> Dwells:
        """Return the rows of one set-up.

        `setup`: its number [1].
        """
        return self.rows(np.arange(*self.first[setup : setup + 2]))

    def setups(self, some: IntArray) -> Dwells:
        """Return some set-ups, numbered anew.

        `some` (k,): their numbers, rising [1].
        """
        first, last = self.first[some], self.first[some + 1]
        count = last - first
        before = np.cumsum(count) - count
        if len(some) and some[-1] - some[0] == len(some) - 1:  # one block: no copies
            whole = self.rows(slice(int(first[0]), int(last[-1])))
        else:
            whole = self.rows(np.arange(count.sum()) + np.repeat(first - before, count))
        said = ((name, getattr(self, name)) for name in ("heading", "latitude", "latitude_sd"))
        each: dict[str, Any] = {name: None if x is None else x[some] for name, x in said}
        return replace(
            whole,
            setup=np.repeat(np.arange(len(some)), count),
            names=chosen(self.names, some),
            **each,
        )

    def rows(self, keep: IntArray | slice) -> Dwells:
        """Return some rows; set-ups keep their numbers.

        `keep` (k,): numbers of the rows, or which they are [1].
        """
        names = ("setup", "start", "time", "index", "cosine", "sine", "gyro")
        some: dict[str, Any] = {name: getattr(self, name)[keep] for name in names}
        for name in ("accel", "turning"):
            whole = getattr(self, name)
            some[name] = None if whole is None else whole[keep]
        return replace(self, **some)
