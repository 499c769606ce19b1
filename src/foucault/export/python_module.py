"""A Python module to paste anywhere: pure Python, no imports.

Receiver's convention: ours. Readings in m/s^2 and rad/s; true values in the same axes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.export.c_header import NEWTON_STEPS
from foucault.export.numbers import commented, inverse, row, rows
from foucault.export.request import FAMILIES, Request

CAN = FAMILIES


def text(wanted: Request) -> str:
    """Write the module."""
    model = wanted.model
    quadratic, straight = bool(model.accel_quadratic.any()), model.straight
    parts = [
        commented(wanted.statement(), "#"),
        "# Readings and results: accelerometers in m/s^2, gyros in rad/s, three numbers each.",
        "",
        "# Inverse of the accelerometer matrix I + S_a + M_a, and bias [m/s^2].",
        _matrix("ACCEL_INVERSE", inverse(model.accel_matrix)),
        f"ACCEL_BIAS = ({row(model.accel_bias)})",
        "# Inverse of the gyro matrix I + S_g + M_g, and bias [rad/s].",
        _matrix("GYRO_INVERSE", inverse(model.gyro_matrix)),
        f"GYRO_BIAS = ({row(model.gyro_bias)})",
        "# g-sensitivity of the gyros [rad/s per m/s^2].",
        _matrix("G_SENSITIVITY", model.g_sensitivity),
    ]
    if quadratic:
        parts += [
            "# Accelerometer matrix [1] and quadratic terms [1/(m/s^2)]: columns fx^2, fy^2, fz^2,"
            " fx fy, fx fz, fy fz.",
            _matrix("ACCEL_MATRIX", model.accel_matrix),
            _matrix("ACCEL_QUADRATIC", model.accel_quadratic),
        ]
    if not straight:
        parts += [
            "# Asymmetry [1] and cubic term [1/(rad/s)^2] of the gyros' scale factors.",
            f"GYRO_ASYMMETRY = ({row(model.gyro_asymmetry)})",
            f"GYRO_CUBIC = ({row(model.gyro_cubic)})",
        ]
    parts += [_TIMES, _NEWTON.replace("STEPS", str(NEWTON_STEPS)) if quadratic else ""]
    solve = "    f = _solve_quadratic(accel, f)\n" if quadratic else ""
    parts += [] if straight else [_SENSED.replace("STEPS", str(NEWTON_STEPS))]
    function = _FUNCTION.replace("    #NEWTON\n", solve)
    parts += [function.replace("    #SENSED\n", "" if straight else _CALL_SENSED)]
    if set(wanted.counts) == {"accel", "gyro"}:
        for name in ("accel", "gyro"):
            counts = wanted.counts[name]
            parts += [
                "# SI = (count - zero) * factor; counts in this order: "
                f"{', '.join(counts.columns)}.",
                f"{name.upper()}_ZERO = ({row(counts.zero)})",
                f"{name.upper()}_FACTOR = ({row(counts.factor)})",
            ]
        parts += [_COUNTS]
    return "\n".join(parts)


def _matrix(name: str, matrix: npt.NDArray[np.float64]) -> str:
    return f"{name} = (\n{rows(matrix, '(', ')')},\n)"


_TIMES = """

def _times(matrix, vector):
    return [sum(m * v for m, v in zip(line, vector)) for line in matrix]
"""

_NEWTON = '''
def _solve_quadratic(accel, f):
    """Newton's method for A f + b + K q(f) = accel, a fixed number of steps."""
    for _ in range(STEPS):
        x, y, z = f
        q = (x * x, y * y, z * z, x * y, x * z, y * z)
        linear, square = _times(ACCEL_MATRIX, f), _times(ACCEL_QUADRATIC, q)
        m = [linear[i] + ACCEL_BIAS[i] + square[i] - accel[i] for i in range(3)]
        s = [
            (
                a[0] + 2 * k[0] * x + k[3] * y + k[4] * z,
                a[1] + 2 * k[1] * y + k[3] * x + k[5] * z,
                a[2] + 2 * k[2] * z + k[4] * x + k[5] * y,
            )
            for a, k in zip(ACCEL_MATRIX, ACCEL_QUADRATIC)
        ]
        c = [  # cofactors: indices run on in a circle
            [
                s[i - 2][j - 2] * s[i - 1][j - 1] - s[i - 2][j - 1] * s[i - 1][j - 2]
                for j in range(3)
            ]
            for i in range(3)
        ]
        det = sum(s[0][j] * c[0][j] for j in range(3))
        f = [f[j] - sum(c[i][j] * m[i] for i in range(3)) / det for j in range(3)]
    return f
'''

_SENSED = '''
def _sensed(y, a, c):
    """Newton's method for r + a |r| + c r^3 = y, one axis, a fixed number of steps."""
    k = 1.0 - a if y < 0.0 else 1.0 + a
    r = y / k
    for _ in range(STEPS):
        r -= (k * r + c * r**3 - y) / (k + 3.0 * c * r * r)
    return r
'''

_CALL_SENSED = "    y = [_sensed(y[i], GYRO_ASYMMETRY[i], GYRO_CUBIC[i]) for i in range(3)]\n"

_FUNCTION = '''
def compensate(accel, gyro):
    """Return true specific force [m/s^2] and angular rate [rad/s] of readings accel and gyro."""
    f = _times(ACCEL_INVERSE, [a - b for a, b in zip(accel, ACCEL_BIAS)])
    #NEWTON
    sensed = _times(G_SENSITIVITY, f)
    y = [gyro[i] - GYRO_BIAS[i] - sensed[i] for i in range(3)]
    #SENSED
    return f, _times(GYRO_INVERSE, y)
'''

_COUNTS = '''

def compensate_counts(accel_counts, gyro_counts):
    """Do the same from raw counts, in the order stated above."""
    accel = [(accel_counts[i] - ACCEL_ZERO[i]) * ACCEL_FACTOR[i] for i in range(3)]
    gyro = [(gyro_counts[i] - GYRO_ZERO[i]) * GYRO_FACTOR[i] for i in range(3)]
    return compensate(accel, gyro)
'''
