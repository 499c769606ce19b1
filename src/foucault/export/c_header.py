"""A C header without dependencies: constants and inline functions.

Receiver's convention: ours. Readings in m/s^2 and rad/s; the function returns true specific
force and angular rate in the same axes.
"""

from __future__ import annotations

from collections.abc import Mapping

from foucault.arrays import FloatArray
from foucault.escape import c_comment, commented
from foucault.export.numbers import inverse, number, row, rows, tensor
from foucault.export.request import FAMILIES, Counts, Request
from foucault.export.templates import pieces
from foucault.models.imu import ImuModel
from foucault.models.size_effect import SizeEffect

CAN = FAMILIES

NEWTON_STEPS = 8
"""Each step squares the relative error: from 10 % to rounding in 4; the rest is reserve."""


def text(wanted: Request) -> str:
    """Write the header."""
    model = wanted.model
    quadratic, bends = bool(model.accel_quadratic.any()), bool(model.deflection.any())
    parts = [
        "/*",
        commented(wanted.statement(), " *"),
        " *",
        " * Readings and results: accelerometers in m/s^2, gyros in rad/s. C99 and C++, nothing to",
        " * link, no state but the caller's; the results must not share memory with the readings."
        if wanted.size
        else " * link, no state; the results must not share memory with the readings.",
        " */",
        "#ifndef FOUCAULT_CALIBRATION_H",
        "#define FOUCAULT_CALIBRATION_H",
        "",
        "/* Inverse of the accelerometer matrix I + S_a + M_a, and bias [m/s^2]. */",
        _matrix("foucault_accel_inverse", inverse(model.accel_matrix)),
        _vector("foucault_accel_bias", model.accel_bias),
        *_gyro_matrix(model),
        _vector("foucault_gyro_bias", model.gyro_bias),
    ]
    if model.g_sensitivity.any():
        parts += [
            "/* g-sensitivity of the gyros [rad/s per m/s^2]. */",
            _matrix("foucault_g_sensitivity", model.g_sensitivity),
        ]
    if not model.accel_linear:
        parts += [
            "/* Asymmetry of the accelerometers' scale factors [1]. */",
            _vector("foucault_accel_asymmetry", model.accel_asymmetry),
        ]
    parts += [_SOLVE] if quadratic or bends else []
    if quadratic:
        parts += [
            "/* Accelerometer matrix [1], and quadratic terms [1/(m/s^2)]: columns fx^2, fy^2,"
            " fz^2, fx fy, fx fz, fy fz. */",
            _matrix("foucault_accel_matrix", model.accel_matrix),
            _matrix("foucault_accel_quadratic", model.accel_quadratic),
            _NEWTON.replace("STEPS", str(NEWTON_STEPS)),
        ]
    if not model.straight:
        parts += [
            "/* Asymmetry [1] and cubic term [1/(rad/s)^2] of the gyros' scale factors. */",
            _vector("foucault_gyro_asymmetry", model.gyro_asymmetry),
            _vector("foucault_gyro_cubic", model.gyro_cubic),
            _SENSED.replace("STEPS", str(NEWTON_STEPS)),
        ]
    parts += [_function(model)]
    if wanted.size:
        parts += _size_effect(wanted.size)
    parts += _from_counts(wanted.counts, bool(wanted.size))
    parts += ["#endif /* FOUCAULT_CALIBRATION_H */", ""]
    return "\n".join(parts)


def _matrix(name: str, matrix: FloatArray) -> str:
    m, n = matrix.shape
    return f"static const double {name}[{m}][{n}] = {{\n{rows(matrix, '{', '}')}}};\n"


def _gyro_matrix(model: ImuModel) -> list[str]:
    """Write the inverse; where the gyros bend, what is inverted at every sample instead."""
    if not model.deflection.any():
        return [
            "/* Inverse of the gyro matrix I + S_g + M_g, and bias [rad/s]. */",
            _matrix("foucault_gyro_inverse", inverse(model.gyro_matrix)),
        ]
    return [
        "/* Deflection: gyro, direction its axis bends to, specific force [rad/(m/s^2)]. */",
        "static const double foucault_deflection[3][3][3] = {\n"
        f"{tensor(model.deflection, '{', '}')}}};\n",
        "/* Gyro matrix I + S_g + M_g, and bias [rad/s]. */",
        _matrix("foucault_gyro_matrix", model.gyro_matrix),
    ]


def _function(model: ImuModel) -> str:
    """Put together what is done with every sample."""
    steps = {
        "SENSE": _UNLIKE if model.accel_asymmetry.any() else "",
        "NEWTON": _CALL if model.accel_quadratic.any() else "",
        "SENSED": "" if model.straight else _CALL_SENSED,
        "RATE": _CALL_BENT if model.deflection.any() else _CALL_RATE,
    }
    felt = _FELT if model.g_sensitivity.any() else ""
    out = _FUNCTION.replace("/*FELT*/", felt)
    for mark, lines in steps.items():
        out = out.replace(f"/*{mark}*/\n", lines)
    return out


def _size_effect(size: SizeEffect) -> list[str]:
    """Write what takes lever arms and delay away, from sample to sample."""
    return [
        "/* Places of the x, y and z accelerometer in rows [m], and how much later accelerometers"
        " read\n   than gyros [s]. */",
        _matrix("foucault_accel_places", size.arms),
        f"static const double foucault_accel_delay = {number(size.delay)};\n",
        _NEXT,
    ]


def _vector(name: str, vector: FloatArray) -> str:
    return f"static const double {name}[3] = {{{row(vector)}}};\n"


def _from_counts(counts: Mapping[str, Counts], stepping: bool) -> list[str]:
    """Write the entry for raw counts, where both triads were logged in counts."""
    if set(counts) != {"accel", "gyro"}:
        return []
    out = []
    for name, kind in (("accel", "m/s^2"), ("gyro", "rad/s")):
        triad = counts[name]
        out += [
            f"/* SI = (count - zero) * factor [{kind} per count]; counts in this order:"
            f" {c_comment(', '.join(triad.columns))}. */",
            _vector(f"foucault_{name}_zero", triad.zero),
            _vector(f"foucault_{name}_factor", triad.factor),
        ]
    return [*out, _COUNTS_NEXT if stepping else _COUNTS]


_UNLIKE = """\
    for (i = 0; i < 3; i++)
        a[i] /= a[i] < 0.0 ? 1.0 - foucault_accel_asymmetry[i] : 1.0 + foucault_accel_asymmetry[i];
"""

_FELT = """ - foucault_g_sensitivity[i][0] * f_b[0]
             - foucault_g_sensitivity[i][1] * f_b[1] - foucault_g_sensitivity[i][2] * f_b[2]"""

_CALL = "    foucault_solve_force(accel_raw, f_b);\n"

_CALL_SENSED = "    foucault_sensed_rate(w);\n"

_CODE = pieces("c_header")
_CALL_RATE = _CODE["call_rate"]

_CALL_BENT = _CODE["call_bent"]

_FUNCTION = _CODE["function"]

_SOLVE = _CODE["solve"]

_NEWTON = _CODE["newton"]

_SENSED = _CODE["sensed"]

_NEXT = _CODE["next"]

_COUNTS = _CODE["counts"]

_COUNTS_NEXT = _CODE["counts_next"]
