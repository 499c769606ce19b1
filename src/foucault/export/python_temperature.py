"""The Python module where coefficients change with temperature: pure Python, no imports.

Its functions are those of `python_module`, with one more argument: the coefficients at a
temperature, which ``coefficients_at`` makes.
"""

from __future__ import annotations

import re
from dataclasses import fields

from foucault.escape import commented, hash_comment
from foucault.export import python_module as plain
from foucault.export.c_header import NEWTON_STEPS
from foucault.export.numbers import number, row
from foucault.export.request import Request
from foucault.export.temperature_terms import TemperatureTerms
from foucault.export.templates import pieces
from foucault.models.imu import ImuModel

NAMES = (*(f.name for f in fields(ImuModel)), "accel_inverse", "gyro_inverse")

_CONSTANT = re.compile(rf"\b({'|'.join(n.upper() for n in NAMES)})\b")
_ARGUMENT = re.compile(r"\b(_solve_force|compensate_next|compensate_counts|compensate)\(")


def text(wanted: Request) -> str:
    """Write the module."""
    terms = wanted.temperature
    assert terms is not None
    model = terms.pattern
    quadratic = bool(model.accel_quadratic.any())
    body = [plain._TIMES, plain._SOLVE]  # the parts of a module are one family's own
    body += [plain._NEWTON.replace("STEPS", str(NEWTON_STEPS))] if quadratic else []
    body += [] if model.straight else [plain._SENSED.replace("STEPS", str(NEWTON_STEPS))]
    body += [plain._function(model)]
    constants: list[str] = []
    if wanted.size:
        constants += [
            "# Places of the x, y and z accelerometer in rows [m], and how much later they read",
            "# than gyros [s].",
            plain._matrix("ACCEL_PLACES", wanted.size.arms),
            f"ACCEL_DELAY = {number(wanted.size.delay)}",
        ]
        body += [plain._NEXT]
    if set(wanted.counts) == {"accel", "gyro"}:
        for name in ("accel", "gyro"):
            counts = wanted.counts[name]
            constants += [
                "# SI = (count - zero) * factor; counts in this order: "
                f"{hash_comment(', '.join(counts.columns))}.",
                f"{name.upper()}_ZERO = ({row(counts.zero)})",
                f"{name.upper()}_FACTOR = ({row(counts.factor)})",
            ]
        body += [plain._COUNTS_NEXT if wanted.size else plain._COUNTS]
    return "\n".join([
        commented([*wanted.statement(), terms.statement()], "#"),
        "# Readings and results: accelerometers in m/s^2, gyros in rad/s, three numbers each.",
        "# coefficients_at makes the coefficients at a temperature, the others use them.",
        "",
        *_terms(terms),
        *constants,
        _at(terms),
        with_argument("\n".join(body)),
        _COMPENSATE_AT,
    ])  # fmt: skip


def with_argument(code: str) -> str:
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

_CODE = pieces("python_temperature")
_PIECEWISE = _CODE["piecewise"]

_MAKE = _CODE["make"]

_COMPENSATE_AT = _CODE["compensate_at"]
