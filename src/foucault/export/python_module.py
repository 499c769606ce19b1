"""A Python module to paste anywhere: pure Python, no imports.

Receiver's convention: ours. Readings in m/s^2 and rad/s; true values in the same axes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.escape import commented, hash_comment
from foucault.export.c_header import NEWTON_STEPS
from foucault.export.numbers import inverse, number, row, rows, tensor
from foucault.export.request import FAMILIES, Request
from foucault.models.imu import ImuModel

CAN = FAMILIES


def text(wanted: Request) -> str:
    """Write the module."""
    model = wanted.model
    quadratic, bends = bool(model.accel_quadratic.any()), bool(model.deflection.any())
    parts = [
        commented(wanted.statement(), "#"),
        "# Readings and results: accelerometers in m/s^2, gyros in rad/s, three numbers each.",
        "",
        "# Inverse of the accelerometer matrix I + S_a + M_a, and bias [m/s^2].",
        _matrix("ACCEL_INVERSE", inverse(model.accel_matrix)),
        f"ACCEL_BIAS = ({row(model.accel_bias)})",
        *_gyro_matrix(model),
        f"GYRO_BIAS = ({row(model.gyro_bias)})",
    ]
    if model.g_sensitivity.any():
        parts += [
            "# g-sensitivity of the gyros [rad/s per m/s^2].",
            _matrix("G_SENSITIVITY", model.g_sensitivity),
        ]
    if not model.accel_linear:
        parts += [
            "# Asymmetry of the accelerometers' scale factors [1].",
            f"ACCEL_ASYMMETRY = ({row(model.accel_asymmetry)})",
        ]
    if quadratic:
        parts += [
            "# Accelerometer matrix [1] and quadratic terms [1/(m/s^2)]: columns fx^2, fy^2, fz^2,"
            " fx fy, fx fz, fy fz.",
            _matrix("ACCEL_MATRIX", model.accel_matrix),
            _matrix("ACCEL_QUADRATIC", model.accel_quadratic),
        ]
    if not model.straight:
        parts += [
            "# Asymmetry [1] and cubic term [1/(rad/s)^2] of the gyros' scale factors.",
            f"GYRO_ASYMMETRY = ({row(model.gyro_asymmetry)})",
            f"GYRO_CUBIC = ({row(model.gyro_cubic)})",
        ]
    parts += [_TIMES, _SOLVE] if quadratic or bends else [_TIMES]
    parts += [_NEWTON.replace("STEPS", str(NEWTON_STEPS))] if quadratic else []
    parts += [] if model.straight else [_SENSED.replace("STEPS", str(NEWTON_STEPS))]
    parts += [_function(model)]
    if wanted.size:
        parts += [
            "",
            "# Places of the x, y and z accelerometer in rows [m], and how much later they read",
            "# than gyros [s].",
            _matrix("ACCEL_PLACES", wanted.size.arms),
            f"ACCEL_DELAY = {number(wanted.size.delay)}",
            _NEXT,
        ]
    if set(wanted.counts) == {"accel", "gyro"}:
        for name in ("accel", "gyro"):
            counts = wanted.counts[name]
            parts += [
                "# SI = (count - zero) * factor; counts in this order: "
                f"{hash_comment(', '.join(counts.columns))}.",
                f"{name.upper()}_ZERO = ({row(counts.zero)})",
                f"{name.upper()}_FACTOR = ({row(counts.factor)})",
            ]
        parts += [_COUNTS_NEXT if wanted.size else _COUNTS]
    return "\n".join(parts)


def _gyro_matrix(model: ImuModel) -> list[str]:
    """Write the inverse; where the gyros bend, what is inverted at every sample instead."""
    if not model.deflection.any():
        return [
            "# Inverse of the gyro matrix I + S_g + M_g, and bias [rad/s].",
            _matrix("GYRO_INVERSE", inverse(model.gyro_matrix)),
        ]
    return [
        "# Deflection: gyro, direction its axis bends to, specific force [rad/(m/s^2)].",
        f"DEFLECTION = (\n{tensor(model.deflection, '(', ')')},\n)",
        "# Gyro matrix I + S_g + M_g, and bias [rad/s].",
        _matrix("GYRO_MATRIX", model.gyro_matrix),
    ]


def _function(model: ImuModel) -> str:
    """Put together what is done with every sample."""
    steps = {
        "SENSE": _UNLIKE if model.accel_asymmetry.any() else "",
        "NEWTON": _CALL if model.accel_quadratic.any() else "",
        "FELT": _FELT if model.g_sensitivity.any() else _UNFELT,
        "SENSED": "" if model.straight else _CALL_SENSED,
        "RATE": _CALL_BENT if model.deflection.any() else _CALL_RATE,
    }
    out = _FUNCTION
    for mark, lines in steps.items():
        out = out.replace(f"    #{mark}\n", lines)
    return out


def _matrix(name: str, matrix: npt.NDArray[np.float64]) -> str:
    return f"{name} = (\n{rows(matrix, '(', ')')},\n)"


_TIMES = """

def _times(matrix, vector):
    return [sum(m * v for m, v in zip(line, vector)) for line in matrix]
"""

_SOLVE = '''
def _solve(s, m):
    """Solve s x = m by cofactors; indices run on in a circle."""
    c = [
        [s[i - 2][j - 2] * s[i - 1][j - 1] - s[i - 2][j - 1] * s[i - 1][j - 2] for j in range(3)]
        for i in range(3)
    ]
    det = sum(s[0][j] * c[0][j] for j in range(3))
    return [sum(c[i][j] * m[i] for i in range(3)) / det for j in range(3)]
'''

_NEWTON = '''
def _solve_force(accel, f):
    """Newton's method for p + a |p| + b + K q(f) = accel, p = A f, a fixed number of steps."""
    for _ in range(STEPS):
        x, y, z = f
        q = (x * x, y * y, z * z, x * y, x * z, y * z)
        p, square = _times(ACCEL_MATRIX, f), _times(ACCEL_QUADRATIC, q)
        scale = [1.0 - e if v < 0.0 else 1.0 + e for v, e in zip(p, ACCEL_ASYMMETRY)]
        m = [scale[i] * p[i] + ACCEL_BIAS[i] + square[i] - accel[i] for i in range(3)]
        s = [
            (
                t * a[0] + 2 * k[0] * x + k[3] * y + k[4] * z,
                t * a[1] + 2 * k[1] * y + k[3] * x + k[5] * z,
                t * a[2] + 2 * k[2] * z + k[4] * x + k[5] * y,
            )
            for t, a, k in zip(scale, ACCEL_MATRIX, ACCEL_QUADRATIC)
        ]
        f = [v - change for v, change in zip(f, _solve(s, m))]
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

_UNLIKE = """\
    p = [v / (1.0 - e if v < 0.0 else 1.0 + e) for v, e in zip(p, ACCEL_ASYMMETRY)]
"""

_FELT = """\
    sensed = _times(G_SENSITIVITY, f)
    y = [gyro[i] - GYRO_BIAS[i] - sensed[i] for i in range(3)]
"""

_UNFELT = "    y = [gyro[i] - GYRO_BIAS[i] for i in range(3)]\n"

_CALL = "    f = _solve_force(accel, f)\n"

_CALL_RATE = "    return f, _times(GYRO_INVERSE, y)\n"

_CALL_BENT = """\
    s = [
        [m + sum(t * v for t, v in zip(bent, f)) for m, bent in zip(*lines)]
        for lines in zip(GYRO_MATRIX, DEFLECTION)
    ]
    return f, _solve(s, y)
"""

_CALL_SENSED = "    y = [_sensed(y[i], GYRO_ASYMMETRY[i], GYRO_CUBIC[i]) for i in range(3)]\n"

_FUNCTION = '''
def compensate(accel, gyro):
    """Return true specific force [m/s^2] and angular rate [rad/s] of readings accel and gyro."""
    p = [a - b for a, b in zip(accel, ACCEL_BIAS)]
    #SENSE
    f = _times(ACCEL_INVERSE, p)
    #NEWTON
    #FELT
    #SENSED
    #RATE
'''

_NEXT = '''

def compensate_next(before, dt, accel, gyro):
    """Do the same, and take away lever arms and delay of the accelerometers besides.

    before is what the call for the sample before returned last, None for a first sample and after
    a gap; dt is the time since then [s]. No sample is held back: how fast readings change is their
    difference from the sample before, which is half an interval old. Readings that are increments
    come divided by dt. Returns specific force, angular rate, and what the next call takes.
    """
    df, dw = [0.0] * 3, [0.0] * 3
    if before is not None and dt > 0.0:
        df = [(now - then) / dt for now, then in zip(accel, before[0])]
        dw = [(now - then) / dt for now, then in zip(gyro, before[1])]
    w = compensate(accel, gyro)[1]
    a = []
    for i, r in enumerate(ACCEL_PLACES):  # w x (w x r) + dw x r along the axis of accelerometer i
        j, k = (i + 1) % 3, (i + 2) % 3
        inward = w[i] * (w[j] * r[j] + w[k] * r[k]) - r[i] * (w[j] * w[j] + w[k] * w[k])
        a.append(accel[i] + ACCEL_DELAY * df[i] - inward - dw[j] * r[k] + dw[k] * r[j])
    f, w = compensate(a, gyro)
    return f, w, (tuple(accel), tuple(gyro))
'''

_COUNTS = '''

def compensate_counts(accel_counts, gyro_counts):
    """Do the same from raw counts, in the order stated above."""
    accel = [(accel_counts[i] - ACCEL_ZERO[i]) * ACCEL_FACTOR[i] for i in range(3)]
    gyro = [(gyro_counts[i] - GYRO_ZERO[i]) * GYRO_FACTOR[i] for i in range(3)]
    return compensate(accel, gyro)
'''

_COUNTS_NEXT = '''

def compensate_counts(before, dt, accel_counts, gyro_counts):
    """Do the same from raw counts, in the order stated above."""
    accel = [(accel_counts[i] - ACCEL_ZERO[i]) * ACCEL_FACTOR[i] for i in range(3)]
    gyro = [(gyro_counts[i] - GYRO_ZERO[i]) * GYRO_FACTOR[i] for i in range(3)]
    return compensate_next(before, dt, accel, gyro)
'''
