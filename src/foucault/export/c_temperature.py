"""The C header where coefficients change with temperature.

The functions are those of `c_header`, with one more argument: the coefficients at a temperature,
which ``foucault_at`` makes. A program makes them as often as its temperature changes, and
compensates as often as it reads.
"""

from __future__ import annotations

import re

import numpy as np

from foucault.escape import commented
from foucault.export import c_header as plain
from foucault.export.numbers import number, row
from foucault.export.request import Request
from foucault.export.temperature_terms import TemperatureTerms
from foucault.export.templates import pieces
from foucault.models.imu import ImuModel

INVERSES = {"accel_matrix": "accel_inverse", "gyro_matrix": "gyro_inverse"}

_ARGUMENT = re.compile(
    r"\bfoucault_(solve_force|sensed_rate|compensate_next|compensate_counts|compensate)\("
)


def text(wanted: Request) -> str:
    """Write the header."""
    terms = wanted.temperature
    assert terms is not None
    model = terms.pattern
    blocks = _blocks(model)
    body = [plain._SOLVE] if _solves(model) else []  # the parts of a header are one family's own
    if model.accel_quadratic.any():
        body += [plain._NEWTON.replace("STEPS", str(plain.NEWTON_STEPS))]
    if not model.straight:
        body += [plain._SENSED.replace("STEPS", str(plain.NEWTON_STEPS))]
    body += [plain._function(model)]
    body += plain._size_effect(wanted.size) if wanted.size else []
    body += plain._from_counts(wanted.counts, bool(wanted.size))
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
        with_argument("\n".join(body), [*blocks, *INVERSES.values()]),
        _AT,
        "#endif /* FOUCAULT_CALIBRATION_H */",
        "",
    ])  # fmt: skip


def with_argument(code: str, names: list[str]) -> str:
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


_CODE = pieces("c_temperature")
_POWERS = _CODE["powers"]

_PIECEWISE = _CODE["piecewise"]

_SUM = _CODE["sum"]

_MAKE = _CODE["make"]

_AT = _CODE["at"]
