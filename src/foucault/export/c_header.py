"""A C header without dependencies: constants and inline functions.

Receiver's convention: ours. Readings in m/s^2 and rad/s; the function returns true specific
force and angular rate in the same axes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from foucault.arrays import FloatArray
from foucault.escape import c_comment, commented
from foucault.export.request import (
    FAMILIES,
    Counts,
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
from foucault.models.size_effect import SizeEffect

NEWTON_STEPS = 8
"""Each step squares the relative error: from 10 % to rounding in 4; the rest is reserve."""


def c_text(wanted: Request) -> str:
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


# -- The C header where coefficients change with temperature -------------------------------------
# The functions are those of `c_header`, with one more argument: the coefficients at a temperature,
# which ``foucault_at`` makes. A program makes them as often as its temperature changes, and
# compensates as often as it reads.

INVERSES = {"accel_matrix": "accel_inverse", "gyro_matrix": "gyro_inverse"}

_ARGUMENT = re.compile(
    r"\bfoucault_(solve_force|sensed_rate|compensate_next|compensate_counts|compensate)\("
)


def c_text_at_temperatures(wanted: Request) -> str:
    """Write the header."""
    terms = wanted.temperature
    assert terms is not None
    model = terms.pattern
    blocks = _blocks(model)
    body = [_SOLVE] if _solves(model) else []  # the parts of a header are one family's own
    if model.accel_quadratic.any():
        body += [_NEWTON.replace("STEPS", str(NEWTON_STEPS))]
    if not model.straight:
        body += [_SENSED.replace("STEPS", str(NEWTON_STEPS))]
    body += [_function(model)]
    body += _size_effect(wanted.size) if wanted.size else []
    body += _from_counts(wanted.counts, bool(wanted.size))
    return "\n".join([
        "/*",
        commented([*wanted.statement(), terms.statement()], " *"),
        " *",
        " * Readings and results: accelerometers in m/s^2, gyros in rad/s. C99 and C++, nothing to",
        " * link, no state but the caller's; the results must not share memory with the readings.",
        " * foucault_at makes the coefficients at a temperature, the others use them.",
        " */",
        "#ifndef FOUCAULT_CALIBRATION_H",
        "#define FOUCAULT_CALIBRATION_H",
        "",
        _struct(blocks),
        "/* What each function of temperature multiplies, one line after the other [SI]. */",
        *[_terms(terms, name) for name in blocks],
        *_functions(terms, blocks),
        _c_with_argument("\n".join(body), [*blocks, *INVERSES.values()]),
        _AT,
        "#endif /* FOUCAULT_CALIBRATION_H */",
        "",
    ])  # fmt: skip


def _c_with_argument(code: str, names: list[str]) -> str:
    """Turn constants into members of the coefficients, which functions get as first argument."""
    code = re.sub(rf"\bfoucault_({'|'.join(names)})\b", r"at->\1", code)
    lines = []
    for line in code.splitlines():
        head = "const foucault_coefficients *at" if line.startswith("static inline") else "at"
        lines.append(_ARGUMENT.sub(rf"foucault_\1({head}, ", line))
    return "\n".join(lines) + "\n"


def _blocks(model: ImuModel) -> dict[str, tuple[int, ...]]:
    """Return the matrices that are computed, with their shapes."""
    always = ("accel_matrix", "accel_bias", "gyro_matrix", "gyro_bias")
    some = {
        "g_sensitivity": bool(model.g_sensitivity.any()),
        "accel_asymmetry": not model.accel_linear,
        "accel_quadratic": bool(model.accel_quadratic.any()),
        "gyro_asymmetry": not model.straight,
        "gyro_cubic": not model.straight,
        "deflection": bool(model.deflection.any()),
    }
    names = [*always, *(name for name, there in some.items() if there)]
    return {name: getattr(model, name).shape for name in names}


def _solves(model: ImuModel) -> bool:
    return bool(model.accel_quadratic.any() or model.deflection.any())


def _struct(blocks: dict[str, tuple[int, ...]]) -> str:
    rows = [f"    double {name}{_shape(shape)};" for name, shape in blocks.items()]
    rows += [f"    double {name}[3][3];" for name in INVERSES.values()]
    head = ["/* The coefficients at one temperature. */", "typedef struct {"]
    return "\n".join([*head, *rows, "} foucault_coefficients;", ""])


def _shape(shape: tuple[int, ...]) -> str:
    return "".join(f"[{n}]" for n in shape)


def _terms(terms: TemperatureTerms, name: str) -> str:
    values = terms.block(name)
    flat = values.reshape(len(values), -1)
    rows = ",\n".join(f"    {row(line)}" for line in flat)
    return f"static const double foucault_terms_{name}[{flat.size}] = {{\n{rows}}};\n"


def _functions(terms: TemperatureTerms, blocks: dict[str, tuple[int, ...]]) -> list[str]:
    f = terms.functions
    count = len(terms.terms)
    if f.knots.size:
        phi = _PIECEWISE.replace("COUNT", str(count)).replace("KNOTS", row(f.knots))
    else:
        phi = _POWERS.replace("COUNT", str(count)).replace("REFERENCE", number(f.reference))
    sums = "\n".join(
        f"    foucault_sum(foucault_terms_{name}, {int(np.prod(shape))}, phi, "
        f"&c->{name}{'[0]' * len(shape)});"
        for name, shape in blocks.items()
    )
    inverses = "\n".join(
        f"    foucault_invert(c->{one}, c->{other});" for one, other in INVERSES.items()
    )
    make = _MAKE.replace("COUNT", str(count)).replace("SUMS", sums).replace("INVERSES", inverses)
    make = make.replace("LOW", number(f.low)).replace("HIGH", number(f.high))
    return [phi, _SUM.replace("COUNT", str(count)), make]


_AT_TEMPERATURES_CODE = pieces("c_temperature")
_POWERS = _AT_TEMPERATURES_CODE["powers"]

_PIECEWISE = _AT_TEMPERATURES_CODE["piecewise"]

_SUM = _AT_TEMPERATURES_CODE["sum"]

_MAKE = _AT_TEMPERATURES_CODE["make"]

_AT = _AT_TEMPERATURES_CODE["at"]

WRITERS = {"c": (FAMILIES, c_text)}
AT_TEMPERATURES = {"c": c_text_at_temperatures}
