"""A C header and a Python module that compensate readings, without dependencies.

Receiver's convention: ours. Readings in m/s^2 and rad/s; what comes out is true specific force and
angular rate in the same axes.

Both hold numbers, with what they mean, and functions, whose pieces are in ``templates``; a
`Language` says how they are written. Where coefficients change with temperature, functions get one
more argument: the coefficients at a temperature, which another function makes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.escape import c_comment, commented, hash_comment
from foucault.export.request import (
    FAMILIES,
    Request,
    TemperatureTerms,
    inverse,
    nested,
    number,
    pieces,
    row,
)
from foucault.models.imu import ImuModel

NEWTON_STEPS = "8"
"""Each step squares the relative error: from 10 % to rounding in 4; the rest is reserve."""

Meant = tuple[str, Mapping[str, FloatArray | float]]
"""What some numbers mean, and the numbers by name."""


@dataclass(frozen=True)
class Language:
    """How a program is written."""

    code: Mapping[str, str]  # its pieces
    remark: Callable[[str], str]  # a sentence -> a comment of one line
    constant: Callable[[str, FloatArray | float], str]  # name and numbers -> a line

    def numbers(self, some: Iterable[Meant]) -> list[str]:
        """Write numbers, each below what it means."""
        out = []
        for meaning, values in some:
            out += [self.remark(meaning), *map(self.constant, values, values.values())]
        return out

    def functions(self, model: ImuModel, wanted: Request) -> list[str]:
        """Write what is done with every sample; what is zero in `model` is left out."""
        quadratic, bends = bool(model.accel_quadratic.any()), bool(model.deflection.any())
        steps = {
            "sense": model.accel_asymmetry.any(), "solve_force": quadratic,
            "felt": model.g_sensitivity.any(), "sensed_rate": not model.straight,
            "bent": bends, "rate": not bends,
        }  # fmt: skip
        function = self.code["function"]
        for name, there in steps.items():
            function = function.replace(f"@{name}\n", self.code[f"call_{name}"] if there else "")
        counted = "counts_next" if wanted.size else "counts"
        parts = {
            "times": "times" in self.code, "solve": quadratic or bends, "newton": quadratic,
            "sensed": not model.straight, function: True, "next": bool(wanted.size),
            counted: set(wanted.counts) == {"accel", "gyro"},
        }  # fmt: skip
        return [self.code.get(name, name).replace("STEPS", NEWTON_STEPS)
                for name, there in parts.items() if there]  # fmt: skip


def _c_constant(name: str, values: FloatArray | float) -> str:
    size = "".join(f"[{n}]" for n in np.shape(values))
    return f"static const double foucault_{name}{size} = {_written(values, '{', '}')};"


def _python_constant(name: str, values: FloatArray | float) -> str:
    return f"{name.upper()} = {_written(values, '(', ')')}"


def _written(values: FloatArray | float, opening: str, closing: str) -> str:
    return nested(values, opening, closing) if isinstance(values, np.ndarray) else number(values)


C = Language(
    pieces("c_header") | pieces("c_temperature"), lambda text: f"/* {c_comment(text)} */",
    _c_constant,
)  # fmt: skip
PYTHON = Language(
    pieces("python_module") | pieces("python_temperature"), lambda text: f"# {hash_comment(text)}",
    _python_constant,
)  # fmt: skip


def _of_model(model: ImuModel) -> Iterator[Meant]:
    """Yield the matrices of a model, and of what is inverted at every sample the terms."""
    inverses = {"accel_inverse": model.accel_matrix, "gyro_inverse": model.gyro_matrix}
    bends = bool(model.deflection.any())
    for there, names, meaning in (
        (True, "accel_inverse accel_bias",
         "Inverse of the accelerometer matrix I + S_a + M_a, and bias [m/s^2]."),
        (not bends, "gyro_inverse gyro_bias",
         "Inverse of the gyro matrix I + S_g + M_g, and bias [rad/s]."),
        (bends, "deflection",
         "Deflection: gyro, direction its axis bends to, specific force [rad/(m/s^2)]."),
        (bends, "gyro_matrix gyro_bias", "Gyro matrix I + S_g + M_g, and bias [rad/s]."),
        (model.g_sensitivity.any(), "g_sensitivity",
         "g-sensitivity of the gyros [rad/s per m/s^2]."),
        (not model.accel_linear, "accel_asymmetry",
         "Asymmetry of the accelerometers' scale factors [1]."),
        (model.accel_quadratic.any(), "accel_matrix accel_quadratic",
         "Accelerometer matrix [1], and quadratic terms [1/(m/s^2)]: columns fx^2, fy^2, fz^2, "
         "fx fy, fx fz, fy fz."),
        (not model.straight, "gyro_asymmetry gyro_cubic",
         "Asymmetry [1] and cubic term [1/(rad/s)^2] of the gyros' scale factors."),
    ):  # fmt: skip
        if there:
            yield (
                meaning,
                {
                    name: inverse(inverses[name]) if name in inverses else getattr(model, name)
                    for name in names.split()
                },
            )


def _beside(wanted: Request) -> Iterator[Meant]:
    """Yield lever arms and delay, and what makes counts SI, where both triads were in counts."""
    if wanted.size:
        late = "and how much later they read than gyros [s]."
        yield f"Places of the x, y and z accelerometer in rows [m], {late}", {
            "accel_places": wanted.size.arms, "accel_delay": wanted.size.delay,
        }  # fmt: skip
    for name, kind in (("accel", "m/s^2"), ("gyro", "rad/s")):
        if set(wanted.counts) == {"accel", "gyro"}:
            triad = wanted.counts[name]
            order = f"counts in this order: {', '.join(triad.columns)}."
            yield f"SI = (count - zero) * factor [{kind} per count]; {order}", {
                f"{name}_zero": triad.zero, f"{name}_factor": triad.factor,
            }  # fmt: skip


def c_text(wanted: Request) -> str:
    """Write the header; its results must not share memory with the readings."""
    some = C.numbers((*_of_model(wanted.model), *_beside(wanted)))
    return _header(wanted.statement(), [*some, "", *C.functions(wanted.model, wanted)])


def _header(statement: list[str], parts: list[str]) -> str:
    begins = ["/*", commented(statement, " *"), C.code["begin"]]
    return "\n".join([*begins, *parts, C.code["end"]])


def python_text(wanted: Request) -> str:
    """Write the module."""
    some = PYTHON.numbers((*_of_model(wanted.model), *_beside(wanted)))
    return "\n".join([commented(wanted.statement(), "#"), PYTHON.code["begin"], *some,
                      *PYTHON.functions(wanted.model, wanted)])  # fmt: skip


# -- Where coefficients change with temperature ----------------------------------------------------
# The functions are the same, with the coefficients at a temperature for their first argument. A
# program makes these as often as its temperature changes, and compensates as often as it reads.

INVERSES = {"accel_matrix": "accel_inverse", "gyro_matrix": "gyro_inverse"}
MATRICES = tuple(f.name for f in fields(ImuModel))

_C_CALLED = re.compile(
    r"\bfoucault_(solve_force|sensed_rate|compensate_next|compensate_counts|compensate)\("
)
_PYTHON_CALLED = re.compile(r"\b(_solve_force|compensate_next|compensate_counts|compensate)\(")


def c_text_at_temperatures(wanted: Request) -> str:
    """Write the header where coefficients change with temperature."""
    terms = wanted.temperature
    assert terms is not None
    model = terms.pattern
    always = ("accel_matrix", "accel_bias", "gyro_matrix", "gyro_bias")
    blocks = {name: getattr(model, name).shape for name in MATRICES
              if name in always or getattr(model, name).any()
              or (name == "accel_asymmetry" and not model.accel_linear)
              or (name in ("gyro_asymmetry", "gyro_cubic") and not model.straight)}  # fmt: skip
    sizes = {name: "".join(f"[{n}]" for n in shape) for name, shape in blocks.items()}
    members = sizes | dict.fromkeys(INVERSES.values(), "[3][3]")
    parts = [
        "/* The coefficients at one temperature; foucault_at makes them. */",
        "typedef struct {",
        *(f"    double {name}{size};" for name, size in members.items()),
        "} foucault_coefficients;",
        "",
        "/* What each function of temperature multiplies, one line after the other [SI]. */",
    ]
    for name in blocks:
        flat = terms.block(name).reshape(len(terms.terms), -1)
        listed = ",\n".join(f"    {row(line)}" for line in flat)
        parts.append(f"static const double foucault_terms_{name}[{flat.size}] = {{\n{listed}}};\n")
    f = terms.functions
    filled = {
        "COUNT": str(len(terms.terms)), "KNOTS": row(f.knots), "REFERENCE": number(f.reference),
        "LOW": number(f.low), "HIGH": number(f.high),
        "SUMS": "\n".join(
            f"    foucault_sum(foucault_terms_{name}, {int(np.prod(shape))}, phi, "
            f"&c->{name}{'[0]' * len(shape)});" for name, shape in blocks.items()),
        "INVERSES": "\n".join(f"    foucault_invert(c->{one}, c->{other});"
                              for one, other in INVERSES.items()),
    }  # fmt: skip
    helpers = "\n".join(
        C.code[k] for k in ("piecewise" if f.knots.size else "powers", "sum", "make")
    )
    parts.append(re.sub("|".join(filled), lambda found: filled[found[0]], helpers))
    code = "\n".join(C.functions(model, wanted))
    code = re.sub(rf"\bfoucault_({'|'.join(members)})\b", r"at->\1", code)
    lines = []
    for line in code.splitlines():
        first = "const foucault_coefficients *at" if line.startswith("static inline") else "at"
        lines.append(_C_CALLED.sub(rf"foucault_\1({first}, ", line))
    parts += [*C.numbers(_beside(wanted)), "", *lines, "", C.code["at"]]
    return _header([*wanted.statement(), terms.statement()], parts)


def python_text_at_temperatures(wanted: Request) -> str:
    """Write the module where coefficients change with temperature."""
    terms = wanted.temperature
    assert terms is not None
    f = terms.functions
    phi = PYTHON.code["piecewise" if f.knots.size else "powers"]
    names = "|".join(name.upper() for name in (*MATRICES, *INVERSES.values()))
    code = "\n".join(PYTHON.functions(terms.pattern, wanted))
    code = re.sub(rf"\b({names})\b", lambda found: f'at["{found[1].lower()}"]', code)
    parts = [
        commented([*wanted.statement(), terms.statement()], "#"),
        PYTHON.code["begin"],
        "# Range in which the coefficients are known, and temperature that powers count from [K].",
        f"LOW, HIGH = {number(f.low)}, {number(f.high)}",
        f"REFERENCE = {number(f.reference)}",
        f"KNOTS = ({row(f.knots)}{',' if f.knots.size == 1 else ''})",
        "# What each function of temperature multiplies, one after the other [SI].",
        "TERMS = {",
        *(f'    "{name}": (\n{_lines(terms, name)},\n    ),' for name in MATRICES),
        "}",
        *PYTHON.numbers(_beside(wanted)),
        PYTHON.code["make"].replace("PHI\n", phi.replace("COUNT", str(len(terms.terms)))),
        _PYTHON_CALLED.sub(r"\1(at, ", code),
        PYTHON.code["compensate_at"],
    ]
    return "\n".join(parts)


def _lines(terms: TemperatureTerms, name: str) -> str:
    def tuples(values: Any) -> str:
        some = isinstance(values, list)
        return f"({', '.join(map(tuples, values))})" if some else number(values)

    return ",\n".join(f"        {tuples(v)}" for v in terms.block(name).tolist())


WRITERS = {"c": (FAMILIES, c_text), "python": (FAMILIES, python_text)}
"""Receiver -> the families it can express, and what writes its file."""
AT_TEMPERATURES = {"c": c_text_at_temperatures, "python": python_text_at_temperatures}
"""The same of receivers that take coefficients which change with temperature."""
