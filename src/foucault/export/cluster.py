"""A torqued cluster in C, Python and JSON: readings and command in, specific force and rate out.

Receiver's convention: ours. Accelerometers in m/s^2, commanded rate in rad/s, both in cluster axes
p; what comes out is in the same axes. See `models.cluster` for the equations.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.escape import commented
from foucault.export.c_header import NEWTON_STEPS
from foucault.export.numbers import inverse, nested
from foucault.export.request import about
from foucault.export.templates import pieces
from foucault.models.cluster import EQUATION, INVERSE, ClusterModel
from foucault.result import Result

AXES = "Axes: those of the cluster, p"


def _constants(model: ClusterModel) -> dict[str, tuple[str, FloatArray]]:
    """Return what the code needs: name -> meaning and numbers."""
    return {
        "accel_bias": ("Accelerometers: bias [m/s^2]", model.accel_bias),
        "accel_slope": ("1 + scale factor error [1]", 1 + model.accel_scale),
        "accel_quadratic": ("Quadratic term [1/(m/s^2)]", model.accel_quadratic),
        "accel_inverse": ("Inverse of I + misalignments [1]",
                          inverse(np.eye(3) + model.accel_misalignment)),
        "gyro_axes": ("Gyros: input, output and spin axis of each [1]", model.gyro_axes),
        "drift": ("Drift, actual minus commanded [rad/s]", model.drift),
        "drift_g": ("Drift along I, O, S, one gyro in a row [rad/s/(m/s^2)]", model.drift_g),
        "drift_g2": ("Drift with I O, I S, O S [rad/s/(m/s^2)^2]", model.drift_g2),
        "torquer_slope": ("1 + torquer scale factor error [1]", 1 + model.torquer_scale),
        "input_inverse": ("Inverse of the input axes T [1]", inverse(model.input_axes)),
    }  # fmt: skip


def c(result: Result) -> str:
    """Write a C header."""
    parts = [
        "/*",
        commented(about(result, AXES), " *"),
        " *",
        " * Readings of the accelerometers in m/s^2, commanded rates in rad/s. C99 and C++,",
        " * nothing to link, no state; the results must not share memory with the readings.",
        " */",
        "#ifndef FOUCAULT_CALIBRATION_H",
        "#define FOUCAULT_CALIBRATION_H",
        "",
    ]
    for name, (meaning, values) in _constants(_model(result)).items():
        size = "".join(f"[{n}]" for n in values.shape)
        numbers = nested(values, "{", "}")
        parts += [f"/* {meaning}. */", f"static const double foucault_{name}{size} = {numbers};"]
    return "\n".join([*parts, "", _C.replace("STEPS", str(NEWTON_STEPS))])


def python(result: Result) -> str:
    """Write a Python module without imports."""
    parts = [
        commented(about(result, AXES), "#"),
        "# Readings of the accelerometers in m/s^2, commanded rates in rad/s, three numbers each.",
        "",
    ]
    for name, (meaning, values) in _constants(_model(result)).items():
        parts += [f"# {meaning}.", f"{name.upper()} = {nested(values, '(', ')')}"]
    return "\n".join([*parts, _PYTHON.replace("STEPS", str(NEWTON_STEPS))])


def document(result: Result) -> str:
    """Write the matrices as JSON."""
    constants = _constants(_model(result))
    out: Mapping[str, Any] = {
        "format": "foucault.export.cluster/1",
        "about": about(result, AXES),
        "instrument": result.instrument,
        "axes": "cluster",
        "units": {"accel": "m/s^2", "command": "rad/s"},
        "equation": EQUATION,
        "inverse": INVERSE,
        "meaning": {name: meaning for name, (meaning, _) in constants.items()},
        **{name: values.tolist() for name, (_, values) in constants.items()},
    }
    return json.dumps(out, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _model(result: Result) -> ClusterModel:
    return ClusterModel.from_coefficients(result.coefficients)


WRITERS = {"c": c, "python": python, "json": document}

_CODE = pieces("cluster")
_C = _CODE["c"]

_PYTHON = _CODE["python"]
