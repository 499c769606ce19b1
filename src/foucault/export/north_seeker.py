"""A north seeker in C, Python and JSON: its stops in; heading, pitch and roll out.

Receiver's convention: ours. Readings of gyro and accelerometer at index angles clockwise from
above, in rad/s and m/s^2; heading of y_b clockwise from north, pitch nose up, roll right side down.
The latitude is given, so that the rate about up is known. See `models.north_seeker`.
"""

from __future__ import annotations

import json
from typing import Any

from foucault.arrays import FloatArray
from foucault.escape import commented
from foucault.export.numbers import nested, number
from foucault.export.request import OWN_AXES, about
from foucault.export.templates import pieces
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import ImuModel
from foucault.models.north_seeker import EQUATION
from foucault.result import Result

AXES = f"Axes: those of the case, {OWN_AXES}"

INVERSE = (
    "f = g u: I + S_a + M_a, rows x and y, solved for u_x, u_y, and u_z = sqrt(1 - u_x^2 - u_y^2); "
    "w: I + S_g + M_g, rows x and y, solved with w . u = w_ie sin(latitude); "
    "north = w - (w . u) u; east = north x u; heading = atan2(east_y, north_y), "
    "pitch = atan2(u_y, hypot(u_x, u_z)), roll = atan2(-u_x, u_z)"
)


def _constants(result: Result) -> dict[str, tuple[str, FloatArray]]:
    model = ImuModel.from_coefficients(result.coefficients)
    return {
        "gyro_matrix": ("Gyro: rows x and y of I + S_g + M_g [1]", model.gyro_matrix[:2]),
        "gyro_bias": ("Bias, resolved by the base [rad/s]", model.gyro_bias[:2]),
        "accel_matrix": ("Accelerometer: rows x and y of I + S_a + M_a [1]",
                         model.accel_matrix[:2, :2]),
        "accel_bias": ("Bias, resolved by the base [m/s^2]", model.accel_bias[:2]),
    }  # fmt: skip


def c(result: Result) -> str:
    """Write a C header."""
    parts = [
        "/*", commented(about(result, AXES), " *"), " *",
        " * C99 and C++; link with the library of math.h. No state.", " */",
        "#ifndef FOUCAULT_CALIBRATION_H", "#define FOUCAULT_CALIBRATION_H", "",
        "#include <math.h>", "",
        "/* The Earth's rate [rad/s]. */",
        f"static const double foucault_earth_rate = {number(EARTH_RATE)};",
    ]  # fmt: skip
    for name, (meaning, values) in _constants(result).items():
        size = "".join(f"[{n}]" for n in values.shape)
        numbers = nested(values, "{", "}")
        parts += [f"/* {meaning}. */", f"static const double foucault_{name}{size} = {numbers};"]
    return "\n".join([*parts, "", _C])


def python(result: Result) -> str:
    """Write a Python module."""
    parts = [
        commented(about(result, AXES), "#"), "",
        "from math import atan2, cos, hypot, sin, sqrt", "",
        "# The Earth's rate [rad/s].", f"EARTH_RATE = {number(EARTH_RATE)}",
    ]  # fmt: skip
    for name, (meaning, values) in _constants(result).items():
        parts += [f"# {meaning}.", f"{name.upper()} = {nested(values, '(', ')')}"]
    return "\n".join([*parts, _PYTHON])


def document(result: Result) -> str:
    """Write the matrices as JSON."""
    constants = _constants(result)
    out: dict[str, Any] = {
        "format": "foucault.export.north_seeker/1",
        "about": about(result, AXES),
        "instrument": result.instrument,
        "axes": OWN_AXES,
        "units": {"accel": "m/s^2", "gyro": "rad/s", "angles": "rad"},
        "equation": EQUATION,
        "inverse": INVERSE,
        "earth_rate": EARTH_RATE,
        "meaning": {name: meaning for name, (meaning, _) in constants.items()},
        **{name: values.tolist() for name, (_, values) in constants.items()},
    }
    return json.dumps(out, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


WRITERS = {"c": c, "python": python, "json": document}

_CODE = pieces("north_seeker")
_C = _CODE["c"]

_PYTHON = _CODE["python"]
