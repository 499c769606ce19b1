"""A torqued cluster: three floated gyros and three accelerometers on a platform that is turned.

The loop of the platform holds the gyros at null, so that the command *is* what the gyros measure.
Cluster axes p are those of the accelerometers: x_p along the input axis of x, y_p in the plane of x
and y. With the command w_c, the specific force f in p, and the axes I, O, S (input, output, spin)
of each gyro::

    w_ip_p = T^-1 ((I + K) w_c + e)                     true rate of the cluster
    e      = d + d_I I + d_O O + d_S S + d_IO I O + d_IS I S + d_OS O S   drift, gyro by gyro
    accel  = (1 + s) W + b + k W^2,   W = (I + M) (f + lever arms)

T = I + (misalignments of the gyros) holds the input axes in its rows. The axes of each gyro, with
m the misalignments and I, O, S the components of the specific force::

    x: I = (1, m_xy, m_xz) . f    O = (-m_xy, 1, 0) . f    S = (-m_xz, 0, 1) . f
    y: I = (m_yx, 1, m_yz) . f    O = (1, -m_yx, 0) . f    S = (0, m_yz, -1) . f
    z: I = (m_zx, m_zy, 1) . f    O = (1, 0, -m_zx) . f    S = (0, 1, -m_zy) . f

Signs: drift and torquer scale factor error are *actual minus commanded* rate, opposite to the bias
of a strapdown gyro, which is measured minus true; those of the accelerometers are measured minus
true, as everywhere.

The attitude is ``C_np = C_1(outer) C_2(middle) C_3(inner)`` with passive rotations about the first,
second and third axis, n resolved as North-Up-East [1]_; here n is East-North-Up throughout, and
`attitude_of` and `angles_of` translate.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015, eqs. (1)-(23); the matrices of eqs. (5)-(8), not the
   rotation strings beside them.
.. [2] IEEE Std 528-2019 (drift rate, acceleration-sensitive drift rate, torquer scale factor).

The coefficients of the torqued cluster `models.cluster`: names, symbols, kinds and meanings.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout, coefficients_of
from foucault.errors import error
from foucault.models.imu_layout import LAYOUT as IMU_LAYOUT
from foucault.models.rotation import cross_matrix
from foucault.tables import AXES, Log

GYRO_MISALIGNMENTS = ("xy", "xz", "yx", "yz", "zx", "zy")
ACCEL_MISALIGNMENTS = ("yx", "zx", "zy")


def _coefficients() -> tuple[Coefficient, ...]:
    known = [
        *(f"gyro.misalignment.{oi}" for oi in GYRO_MISALIGNMENTS),
        *(f"accel.{word}.{a}" for word in ("bias", "scale") for a in AXES),
        *(f"accel.misalignment.{oi}" for oi in ACCEL_MISALIGNMENTS),
        *(f"accel.quadratic.{a}" for a in AXES),
    ]
    return (*coefficients_of("cluster_drift"), *IMU_LAYOUT.subset(known).coefficients)


CONSTANTS = Layout(_coefficients())
"""The 42 coefficients of gyros and accelerometers, in the order of the kernels."""

ATTITUDE = Layout(coefficients_of("cluster_attitude"))
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


__all__ = [
    "ATTITUDE", "CONSTANTS", "EQUATION", "INVERSE", "LAYOUT", "POWERS", "SOURCE_SYMBOLS",
    "ClusterModel", "angle_rates", "angles_of", "attitude_of", "normalised",
]  # fmt: skip

EQUATION = (
    "w = T^-1 ((I + K) w_c + e);  "
    "e = d + d_I f_I + d_O f_O + d_S f_S + d_IO f_I f_O + d_IS f_I f_S + d_OS f_O f_S;  "
    "accel = (1 + s) a + b + k a^2;  a = (I + M) f;  w: true rate, w_c: commanded rate, "
    "f: true specific force, all in cluster axes; T = I + misalignments of the gyros; "
    "f_I, f_O, f_S: f along input, output and spin axis of each gyro"
)
"""The model equation in words, as stored in results."""

INVERSE = "a = (accel - b - k a^2) / (1 + s);  f = (I + M)^-1 a;  w = T^-1 ((I + K) w_c + e(f))"
"""The same solved for what is true, as `ClusterModel.compensate` does it."""

# Axis k of gyro i, as unit axis plus misalignments: (row, column, sign, misalignment).
_NOMINAL = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
        [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    ],
    float,
)


@dataclass(frozen=True)
class ClusterModel:
    """Errors of a torqued cluster as matrices."""

    # (3,) d, actual minus commanded rate [rad/s]
    drift: FloatArray = field(default_factory=lambda: np.zeros(3))
    # (3, 3) d_I, d_O, d_S in columns, one gyro per row [rad/s/(m/s^2)]
    drift_g: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    # (3, 3) d_IO, d_IS, d_OS in columns, one gyro per row [rad/s/(m/s^2)^2]
    drift_g2: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    # (3,) diagonal of K, actual minus commanded rate [1]
    torquer_scale: FloatArray = field(default_factory=lambda: np.zeros(3))
    # (3, 3) T - I, zero diagonal [rad]
    gyro_misalignment: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    accel_bias: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) b [m/s^2]
    accel_scale: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) s [1]
    # (3, 3) M, below the diagonal [rad]
    accel_misalignment: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    accel_quadratic: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) k [1/(m/s^2)]

    @classmethod
    def from_coefficients(cls, vector: CoefficientVector) -> ClusterModel:
        """Build the matrices from named coefficients; names not in `vector` are zero."""

        values = dict(zip(vector.names, vector.values.tolist(), strict=True))

        def triad(word: str) -> FloatArray:
            return np.array([values.get(f"{word}.{a}", 0.0) for a in AXES])

        def square(word: str, names: tuple[str, ...]) -> FloatArray:
            out = np.zeros((3, 3))
            for oi in names:
                place = AXES.index(oi[0]), AXES.index(oi[1])
                out[place] = values.get(f"{word}.misalignment.{oi}", 0.0)
            return out

        return cls(
            drift=triad("gyro.drift"),
            drift_g=np.column_stack(
                [triad(f"gyro.drift_{word}") for word in ("input", "output", "spin")]
            ),
            drift_g2=np.column_stack(
                [
                    triad(f"gyro.drift_{word}")
                    for word in ("input_output", "input_spin", "output_spin")
                ]
            ),
            torquer_scale=triad("gyro.torquer_scale"),
            gyro_misalignment=square("gyro", GYRO_MISALIGNMENTS),
            accel_bias=triad("accel.bias"),
            accel_scale=triad("accel.scale"),
            accel_misalignment=square("accel", ACCEL_MISALIGNMENTS),
            accel_quadratic=triad("accel.quadratic"),
        )

    def coefficients(self) -> CoefficientVector:
        """Return the 42 coefficients of these matrices [SI]."""
        off = [(AXES.index(oi[0]), AXES.index(oi[1])) for oi in GYRO_MISALIGNMENTS]
        low = [(AXES.index(oi[0]), AXES.index(oi[1])) for oi in ACCEL_MISALIGNMENTS]
        values = np.concatenate(
            [
                self.drift,
                self.drift_g.T.ravel(),
                self.drift_g2.T.ravel(),
                self.torquer_scale,
                [self.gyro_misalignment[at] for at in off],
                self.accel_bias,
                self.accel_scale,
                [self.accel_misalignment[at] for at in low],
                self.accel_quadratic,
            ]
        )
        return CoefficientVector(CONSTANTS, values)

    def packed(self, gravity: float) -> FloatArray:
        """Return the coefficients, (42,), in units where local `gravity` [m/s^2] is 1."""
        return self.coefficients().values * normalised(gravity)

    @cached_property
    def input_axes(self) -> FloatArray:
        """T, shape (3, 3): the input axes of the gyros in its rows [1]."""
        return np.eye(3) + self.gyro_misalignment

    @cached_property
    def gyro_axes(self) -> FloatArray:
        """Axes I, O, S of every gyro in cluster axes, shape (3, 3, 3): gyro, axis, component."""
        m, out = self.gyro_misalignment, _NOMINAL.copy()
        out[:, 0] += m
        out[0, 1, 0], out[1, 1, 1], out[2, 1, 2] = -m[0, 1], -m[1, 0], -m[2, 0]
        out[0, 2, 0], out[1, 2, 1], out[2, 2, 2] = -m[0, 2], m[1, 2], -m[2, 1]
        return out

    def drift_rate(self, f_p: FloatArray) -> FloatArray:
        """Return the drift e of each gyro, (..., 3) [rad/s], at a force `f_p` (..., 3) [m/s^2]."""
        along = np.einsum("gac,...c->...ga", self.gyro_axes, f_p)
        i, o, s = along[..., 0], along[..., 1], along[..., 2]
        pairs = np.stack([i * o, i * s, o * s], axis=-1)
        linear = np.sum(self.drift_g * along, axis=-1)
        return np.asarray(self.drift + linear + np.sum(self.drift_g2 * pairs, axis=-1))

    def rate(self, command: FloatArray, f_p: FloatArray) -> FloatArray:
        """Return the true rate w_ip_p, shape (..., 3) [rad/s].

        `command` (..., 3): commanded rate [rad/s]; `f_p` (..., 3): specific force, frame p [m/s^2].
        """
        actual = (1 + self.torquer_scale) * command + self.drift_rate(f_p)
        return np.asarray(actual @ np.linalg.inv(self.input_axes).T)

    def read(
        self, f_p: FloatArray, w_ip_p: FloatArray | None = None, arms: FloatArray | None = None,
        dw_p: FloatArray | None = None,
    ) -> FloatArray:  # fmt: skip
        """Return what the accelerometers say, shape (..., 3) [m/s^2].

        `f_p` (..., 3): specific force at the origin of the cluster, frame p [m/s^2]; `w_ip_p`
        (..., 3): true rate, needed with lever arms [rad/s]; `arms` (3, 3) or None: position of the
        x, y and z accelerometer in its rows, frame p [m]; `dw_p` (..., 3): angular acceleration,
        None for none [rad/s^2].
        """
        felt = np.broadcast_to(f_p[..., None, :], (*f_p.shape[:-1], 3, 3))
        if arms is not None and w_ip_p is not None:
            W = cross_matrix(w_ip_p)
            turning = W @ W
            if dw_p is not None:
                turning = turning + cross_matrix(dw_p)
            felt = felt + np.einsum("...ij,kj->...ki", turning, arms)
        axes = np.eye(3) + self.accel_misalignment
        sensed = np.sum(axes * felt, axis=-1)
        quadratic = self.accel_quadratic * sensed**2
        return np.asarray((1 + self.accel_scale) * sensed + self.accel_bias + quadratic)

    def compensate(self, accel: FloatArray, command: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what is true from what the cluster says: the inverse, without lever arms.

        `accel` (..., 3): readings of the accelerometers [m/s^2]; `command` (..., 3): commanded rate
        [rad/s]. Returns specific force [m/s^2] and rate [rad/s], frame p, shape (..., 3) each.
        """
        f_p = self._force(accel)
        return f_p, self.rate(command, f_p)

    def _force(self, accel: FloatArray) -> FloatArray:
        known, slope = accel - self.accel_bias, 1 + self.accel_scale
        # The root near known / slope of k W^2 + slope W = known, without cancellation.
        root = np.sqrt(slope**2 + 4 * self.accel_quadratic * known)
        sensed = 2 * known / (slope + root)
        return np.asarray(sensed @ np.linalg.inv(np.eye(3) + self.accel_misalignment).T)

    def apply(self, log: Log) -> Log:
        """Remove these errors from a `log` [SI] whose gyro columns hold the command."""
        if log.accel is None:
            raise error("apply.needs_accel", file=log.source.get("file", "The log"))
        f_p = self._force(log.accel)
        return replace(log, accel=f_p, gyro=None if log.gyro is None else self.rate(log.gyro, f_p))


# -- attitude --------------------------------------------------------------------------------

_NUE_FROM_ENU = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Resolves North-Up-East what is resolved East-North-Up."""


def attitude_of(angles: FloatArray) -> FloatArray:
    """Return C_pn, shape (..., 3, 3): maps East-North-Up to the cluster.

    `angles` (..., 3): outer, middle and inner angle [rad].
    """
    (so, sm, si), (co, cm, ci) = (np.moveaxis(f(angles), -1, 0) for f in (np.sin, np.cos))
    rows = (  # C_1(outer) C_2(middle) C_3(inner), eq. (9)
        (cm * ci, cm * si, -sm),
        (so * sm * ci - co * si, so * sm * si + co * ci, so * cm),
        (co * sm * ci + so * si, co * sm * si - so * ci, co * cm),
    )
    C = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(np.swapaxes(C, -1, -2) @ _NUE_FROM_ENU)


def angles_of(C_pn: FloatArray) -> FloatArray:
    """Return outer, middle and inner angle, shape (..., 3) [rad].

    `C_pn` (..., 3, 3): maps East-North-Up to the cluster [1].
    """
    C = _NUE_FROM_ENU @ np.swapaxes(C_pn, -1, -2)
    middle = np.arctan2(-C[..., 0, 2], np.hypot(C[..., 0, 0], C[..., 0, 1]))
    outer = np.arctan2(C[..., 1, 2], C[..., 2, 2])
    inner = np.arctan2(C[..., 0, 1], C[..., 0, 0])
    return np.stack([outer, middle, inner], axis=-1)


def angle_rates(angles: FloatArray) -> FloatArray:
    """Return T, shape (3, 3): ``d(outer, middle, inner)/dt = T w_np_p``, eq. (14).

    `angles` (3,): outer, middle and inner angle, singular where middle is 90 deg [rad].
    """
    _, middle, inner = angles
    cm, tm, si, ci = np.cos(middle), np.tan(middle), np.sin(inner), np.cos(inner)
    return np.array([[-ci / cm, -si / cm, 0.0], [si, -ci, 0.0], [-ci * tm, -si * tm, -1.0]])
