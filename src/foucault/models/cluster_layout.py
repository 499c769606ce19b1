"""The coefficients of the torqued cluster `models.cluster`: names, symbols, kinds and meanings."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, Layout
from foucault.models.imu_layout import LAYOUT as IMU_LAYOUT
from foucault.tables import AXES

_DRIFT = (
    ("drift", "d", "angular rate", "acceleration-insensitive drift rate"),
    ("drift_input", "d_I", "g-sensitivity", "drift rate per specific force along its input axis"),
    ("drift_output", "d_O", "g-sensitivity", "drift rate per specific force along its output axis"),
    ("drift_spin", "d_S", "g-sensitivity", "drift rate per specific force along its spin axis"),
    ("drift_input_output", "d_IO", "g-squared sensitivity",
     "drift rate per product of specific force along input and output axis"),
    ("drift_input_spin", "d_IS", "g-squared sensitivity",
     "drift rate per product of specific force along input and spin axis"),
    ("drift_output_spin", "d_OS", "g-squared sensitivity",
     "drift rate per product of specific force along output and spin axis"),
    ("torquer_scale", "K_", "scale factor error", "torquer scale factor error, actual minus "
     "commanded rate"),
)  # fmt: skip

GYRO_MISALIGNMENTS = ("xy", "xz", "yx", "yz", "zx", "zy")
ACCEL_MISALIGNMENTS = ("yx", "zx", "zy")


def _symbol(letter: str, axis: str) -> str:
    return f"{letter}{axis}" if "_" in letter else f"{letter}_{axis}"


def _coefficients() -> tuple[Coefficient, ...]:
    drifts = [
        Coefficient(f"gyro.{word}.{a}", _symbol(letter, a), kind, f"gyro {a}: {meaning}")
        for word, letter, kind, meaning in _DRIFT
        for a in AXES
    ]
    known = [
        *(f"gyro.misalignment.{oi}" for oi in GYRO_MISALIGNMENTS),
        *(f"accel.{word}.{a}" for word in ("bias", "scale") for a in AXES),
        *(f"accel.misalignment.{oi}" for oi in ACCEL_MISALIGNMENTS),
        *(f"accel.quadratic.{a}" for a in AXES),
    ]
    return (*drifts, *IMU_LAYOUT.subset(known).coefficients)


CONSTANTS = Layout(_coefficients())
"""The 42 coefficients of gyros and accelerometers, in the order of the kernels."""

ATTITUDE = Layout(
    (
        Coefficient("attitude.outer", "alpha", "angle", "outer angle of the attitude, about North"),
        Coefficient("attitude.middle", "beta", "angle", "middle angle, azimuth while outer is 0"),
        Coefficient("attitude.inner", "gamma", "angle", "inner angle of the attitude"),
    )
)
"""The attitude at the end of the session."""

LAYOUT = Layout((*CONSTANTS.coefficients, *ATTITUDE.coefficients))
"""All 45 that a tumble estimates."""

SOURCE_SYMBOLS = {
    **{
        f"gyro.{word}.{a}": (f"{symbol}{a}", 1.0)
        for word, symbol in (
            ("drift", "kg0"), ("drift_input", "kg11"), ("drift_output", "kg12"),
            ("drift_spin", "kg13"), ("drift_input_output", "kg31"), ("drift_input_spin", "kg32"),
            ("drift_output_spin", "kg33"), ("torquer_scale", "dK"),
        )
        for a in AXES
    },
    **{
        f"accel.{word}.{a}": (f"{symbol}{a}", 1.0)
        for word, symbol in (("bias", "ka0"), ("scale", "ka1"), ("quadratic", "ka2"))
        for a in AXES
    },
    "gyro.misalignment.xy": ("Dxy", 1.0), "gyro.misalignment.xz": ("Dxz", -1.0),
    "gyro.misalignment.yx": ("Dyx", -1.0), "gyro.misalignment.yz": ("Dyz", 1.0),
    "gyro.misalignment.zx": ("Dzy", 1.0), "gyro.misalignment.zy": ("Dzx", -1.0),
    "accel.misalignment.yx": ("th_yz", -1.0), "accel.misalignment.zx": ("th_zy", 1.0),
    "accel.misalignment.zy": ("th_zx", -1.0),
    "attitude.outer": ("alpha", 1.0), "attitude.middle": ("beta", 1.0),
    "attitude.inner": ("gamma", 1.0),
}  # fmt: skip
"""Name -> symbol in ref. [1] and the sign with which it enters."""

_PER_G = {
    name: power
    for word, power in (
        ("gyro.drift_input", 1), ("gyro.drift_output", 1), ("gyro.drift_spin", 1),
        ("gyro.drift_input_output", 2), ("gyro.drift_input_spin", 2), ("gyro.drift_output_spin", 2),
        ("accel.bias", -1), ("accel.quadratic", 1),
    )
    for name in (f"{word}.{a}" for a in AXES)
}  # fmt: skip
POWERS = np.array([_PER_G.get(name, 0) for name in CONSTANTS.names], float)
"""Power of gravity that turns each constant from SI into units where gravity is 1."""


def normalised(gravity: float) -> FloatArray:
    """Return the factors, shape (42,), that turn SI into units where local gravity is 1.

    The kernels and ref. [1] work with a specific force of size 1 at rest.

    `gravity`: local gravity [m/s^2].
    """
    return np.asarray(gravity**POWERS)
