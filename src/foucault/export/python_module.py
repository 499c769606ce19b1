"""A Python module to paste anywhere: pure Python, no imports.

Receiver's convention: ours. Readings in m/s^2 and rad/s; true values in the same axes.
"""

from __future__ import annotations

import re
from dataclasses import fields

import numpy as np
import numpy.typing as npt

from foucault.escape import commented, hash_comment
from foucault.export.c_header import NEWTON_STEPS
from foucault.export.request import (
    FAMILIES,
    Request,
    TemperatureTerms,
    inverse,
    number,
    pieces,
    row,
    rows,
    tensor,
)
from foucault.models.imu import ImuModel


def python_text(wanted: Request) -> str:
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


_CODE = pieces("python_module")
_TIMES = _CODE["times"]

_SOLVE = _CODE["solve"]

_NEWTON = _CODE["newton"]

_SENSED = _CODE["sensed"]

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

_CALL_BENT = _CODE["call_bent"]

_CALL_SENSED = "    y = [_sensed(y[i], GYRO_ASYMMETRY[i], GYRO_CUBIC[i]) for i in range(3)]\n"

_FUNCTION = _CODE["function"]

_NEXT = _CODE["next"]

_COUNTS = _CODE["counts"]

_COUNTS_NEXT = _CODE["counts_next"]


# -- The Python module where coefficients change with temperature: pure Python, no imports -------
# Its functions are those of `python_module`, with one more argument: the coefficients at a
# temperature, which ``coefficients_at`` makes.

NAMES = (*(f.name for f in fields(ImuModel)), "accel_inverse", "gyro_inverse")

_CONSTANT = re.compile(rf"\b({'|'.join(n.upper() for n in NAMES)})\b")
_ARGUMENT = re.compile(r"\b(_solve_force|compensate_next|compensate_counts|compensate)\(")


def python_text_at_temperatures(wanted: Request) -> str:
    """Write the module."""
    terms = wanted.temperature
    assert terms is not None
    model = terms.pattern
    quadratic = bool(model.accel_quadratic.any())
    body = [_TIMES, _SOLVE]  # the parts of a module are one family's own
    body += [_NEWTON.replace("STEPS", str(NEWTON_STEPS))] if quadratic else []
    body += [] if model.straight else [_SENSED.replace("STEPS", str(NEWTON_STEPS))]
    body += [_function(model)]
    constants: list[str] = []
    if wanted.size:
        constants += [
            "# Places of the x, y and z accelerometer in rows [m], and how much later they read",
            "# than gyros [s].",
            _matrix("ACCEL_PLACES", wanted.size.arms),
            f"ACCEL_DELAY = {number(wanted.size.delay)}",
        ]
        body += [_NEXT]
    if set(wanted.counts) == {"accel", "gyro"}:
        for name in ("accel", "gyro"):
            counts = wanted.counts[name]
            constants += [
                "# SI = (count - zero) * factor; counts in this order: "
                f"{hash_comment(', '.join(counts.columns))}.",
                f"{name.upper()}_ZERO = ({row(counts.zero)})",
                f"{name.upper()}_FACTOR = ({row(counts.factor)})",
            ]
        body += [_COUNTS_NEXT if wanted.size else _COUNTS]
    return "\n".join([
        commented([*wanted.statement(), terms.statement()], "#"),
        "# Readings and results: accelerometers in m/s^2, gyros in rad/s, three numbers each.",
        "# coefficients_at makes the coefficients at a temperature, the others use them.",
        "",
        *_terms(terms),
        *constants,
        _at(terms),
        _python_with_argument("\n".join(body)),
        _COMPENSATE_AT,
    ])  # fmt: skip


def _python_with_argument(code: str) -> str:
    """Turn constants into entries of the coefficients, which functions get as first argument."""
    code = _CONSTANT.sub(lambda found: f'at["{found[1].lower()}"]', code)
    return _ARGUMENT.sub(r"\1(at, ", code)


def _terms(terms: TemperatureTerms) -> list[str]:
    f = terms.functions
    out = [
        "# Range in which the coefficients are known, and temperature that powers count from [K].",
        f"LOW, HIGH = {number(f.low)}, {number(f.high)}",
        f"REFERENCE = {number(f.reference)}",
        f"KNOTS = ({row(f.knots)}{',' if f.knots.size == 1 else ''})",
        "# What each function of temperature multiplies, one after the other [SI].",
        "TERMS = {",
    ]
    for field in fields(ImuModel):
        values = terms.block(field.name).tolist()
        rows = ",\n".join(f"        {_nested(v)}" for v in values)
        out.append(f'    "{field.name}": (\n{rows},\n    ),')
    return [*out, "}"]


def _nested(values: float | list[float]) -> str:
    if isinstance(values, list):
        return "(" + ", ".join(_nested(v) for v in values) + ")"
    return number(values)


def _at(terms: TemperatureTerms) -> str:
    phi = _PIECEWISE if terms.functions.knots.size else _POWERS
    return _MAKE.replace("PHI\n", phi.replace("COUNT", str(len(terms.terms))))


_POWERS = """\
    phi = [(kelvin - REFERENCE) ** k for k in range(COUNT)]
"""

_AT_TEMPERATURES_CODE = pieces("python_temperature")
_PIECEWISE = _AT_TEMPERATURES_CODE["piecewise"]

_MAKE = _AT_TEMPERATURES_CODE["make"]

_COMPENSATE_AT = _AT_TEMPERATURES_CODE["compensate_at"]

WRITERS = {"python": (FAMILIES, python_text)}
AT_TEMPERATURES = {"python": python_text_at_temperatures}
