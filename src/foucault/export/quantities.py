"""What receivers ask for, by name: formulas of the calibration's matrices, there and back.

Readings are ``accel = M_a f + b_a`` and ``gyro = M_g w + G f + b_g`` (`models.imu`). A receiver may
have the matrix or its inverse, parts of either, and the bias before or after it. Every name here is
one such form.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.models.imu import Gauge, ImuModel
from foucault.models.magnetometer import Magnetometer, halves

OFF_DIAGONAL = ([1, 2, 2, 0, 0, 1], [0, 0, 1, 1, 2, 2])
"""Rows and columns of what is not on the diagonal, in the order of PSINS."""


@dataclass(frozen=True)
class MagKnown:
    """The same of a magnetometer, in the axes of the receiver [SI]."""

    model: Magnetometer = field(default_factory=Magnetometer)
    intensity: float = 0.0  # of the field [T]
    # (3, 3) covariance of one corrected reading [T^2]
    cov: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True)
class Known:
    """What an export knows, in the axes and the gauge of the receiver [SI]."""

    model: ImuModel
    # noise: (3,) N [unit/sqrt(Hz)] and K [unit/sqrt(s)] by name: accel.white ... gyro.walk, and
    # under the same name with "one:" before it the number that stands for three axes, shape ()
    noise: Mapping[str, FloatArray] = field(default_factory=dict)
    sd: Mapping[str, FloatArray] = field(default_factory=dict)  # (3,) of biases and scale factors
    rate: float | None = None  # of the messages [Hz]
    gravity: float = 0.0  # [m/s^2]
    correlation: float | None = None  # correlation time of a Markov process like the walk [s]
    # biases over temperature, where they change: by name, temperatures [degC], others [SI]
    warm: Mapping[str, FloatArray] = field(default_factory=dict)
    mag: MagKnown = field(default_factory=MagKnown)
    # (3,) of which axes biases and scale factors were calibrated, by name; all where it is not said
    seen: Mapping[str, BoolArray] = field(default_factory=dict)

    def have(self, triad: str, what: str) -> BoolArray:
        """Return of which axes `what` (bias, scale) of a triad is calibrated, (3,)."""
        return np.asarray(self.seen.get(f"{triad}.{what}", np.ones(3, bool)))


_TRIADS = "accel", "gyro"

COMPLETE = Known(
    ImuModel(),
    {f"{one}{triad}.{name}": np.ones(() if one else 3)
     for one in ("", "one:") for triad in _TRIADS for name in ("white", "walk")},
    {f"{triad}.{name}": np.ones(3) for triad in _TRIADS for name in ("bias", "scale")},
    1.0, 1.0, 1.0,
    {f"{triad}.warm_{n}": np.ones(3) for triad in _TRIADS for n in (1, 2, 3)}
    | {f"warm.{name}": np.ones(()) for name in ("low", "high", "reference", "calibrated")},
)  # fmt: skip
"""Something of everything, to see how many numbers a key has."""


def in_gauge(model: ImuModel, gauge: str) -> tuple[ImuModel, FloatArray]:
    """Return a model with the body axes that a receiver has, and the rotation to them, (3, 3)."""
    if gauge == "lower":
        return model.in_gauge(Gauge.LOWER)
    if gauge == "gyro":
        C_cb = _upper_times_rotation(model.gyro_matrix)[1]
        return model.rotated(C_cb), C_cb
    return model, np.eye(3)


def lower_times_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split `matrix`, shape (3, 3) [1], into a lower triangular matrix times a rotation."""
    Q, R = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(R))
    return np.tril((R * signs[:, None]).T), (Q * signs).T


def _upper_times_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    lower, rotation = lower_times_rotation(matrix[::-1, ::-1])
    return lower[::-1, ::-1], rotation[::-1, ::-1]


def _triad(name: str) -> dict[str, Callable[[ImuModel], FloatArray]]:
    """Return the forms that both triads have."""

    def matrix(m: ImuModel) -> FloatArray:
        return np.asarray(getattr(m, f"{name}_matrix"))

    def bias(m: ImuModel) -> FloatArray:
        return np.asarray(getattr(m, f"{name}_bias"))

    return {
        "bias": bias,
        "true_bias": lambda m: np.linalg.inv(matrix(m)) @ bias(m),
        "matrix": matrix,
        "inverse": lambda m: np.asarray(np.linalg.inv(matrix(m))),
        "correction": lambda m: np.linalg.inv(matrix(m)) - np.eye(3),
        "scale": lambda m: np.diag(matrix(m)) - 1.0,
        "diagonal_inverse": lambda m: 1.0 / np.diag(matrix(m)),
        "diagonal_matrix": lambda m: np.diag(np.diag(matrix(m))),
        "rest": lambda m: matrix(m) / np.diag(matrix(m))[:, None],
        "off_diagonal": lambda m: matrix(m)[OFF_DIAGONAL],
        "lower": lambda m: lower_times_rotation(matrix(m))[0],
        "rotation": lambda m: lower_times_rotation(matrix(m))[1],
        "upper": lambda m: _upper_times_rotation(matrix(m))[0],
        "upper_rotation": lambda m: _upper_times_rotation(matrix(m))[1],
    }


FORMS: dict[str, Callable[[ImuModel], FloatArray]] = {
    **{f"{t}.{name}": form for t in ("accel", "gyro") for name, form in _triad(t).items()},
    "gyro.g": lambda m: m.g_sensitivity,
    "gyro.g_rotated": lambda m: m.g_sensitivity @ lower_times_rotation(m.gyro_matrix)[1].T,
}
"""Name -> what it is of a model [SI]: the parts of the calibration that receivers have."""


BESIDE = ([0, 0, 1], [1, 2, 2])
"""Rows and columns of what stands beside the diagonal of a symmetric matrix: xy, xz, yz."""


MAG_FORMS: dict[str, Callable[[MagKnown], FloatArray]] = {
    "mag.bias": lambda m: m.model.bias,
    "mag.inner_diagonal": lambda m: np.diag(halves(m.model.matrix)[0]),
    "mag.inner_beside": lambda m: halves(m.model.matrix)[0][BESIDE],
    "mag.outer_diagonal": lambda m: np.diag(halves(m.model.matrix)[1]),
    "mag.outer_beside": lambda m: halves(m.model.matrix)[1][BESIDE],
    "mag.of_rows": lambda m: np.asarray(np.linalg.inv(m.model.matrix).T),
    "mag.intensity": lambda m: np.asarray(m.intensity),
    "mag.covariance": lambda m: m.cov,
}
"""Name -> what it is of a magnetometer [SI]."""


def value_of(name: str, known: Known, *, each: bool) -> FloatArray | None:
    """Return what a receiver asks for [SI], None where it is not known.

    `each`: one number for each axis of a triad, else one for all.
    """
    if name in FORMS:
        return FORMS[name](known.model)
    if name in MAG_FORMS:
        return MAG_FORMS[name](known.mag)
    if name.endswith((".white", ".walk")):
        noise = known.noise.get(name if each else f"one:{name}")
        # No sensor is without noise: an axis at zero was not measured.
        return noise if noise is not None and (np.isfinite(noise) & (noise > 0)).all() else None
    if name.startswith("warm.") or ".warm_" in name:
        return known.warm.get(name)
    if name.endswith("_sd"):
        sd = known.sd.get(name.removesuffix("_sd"))
        return sd if sd is not None and (sd > 0).all() else None  # 0: an axis is not calibrated
    single = {"rate": known.rate, "gravity": known.gravity, "correlation": known.correlation}[name]
    if single is None:
        return None
    return np.full(3, single) if each else np.asarray(single)
