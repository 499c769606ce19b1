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

_C = """\
/* True specific force f_p [m/s^2] and rate w_p [rad/s] of the cluster from readings and command. */
static inline void foucault_compensate(const double accel_raw[3], const double command[3],
                                       double f_p[3], double w_p[3])
{
    double s[3], rate[3];
    int i, j, step;
    for (i = 0; i < 3; i++) {    /* Newton's method for slope s + k s^2 = reading - bias */
        const double known = accel_raw[i] - foucault_accel_bias[i];
        const double a = foucault_accel_slope[i], k = foucault_accel_quadratic[i];
        s[i] = known / a;
        for (step = 0; step < STEPS; step++)
            s[i] -= (a * s[i] + k * s[i] * s[i] - known) / (a + 2.0 * k * s[i]);
    }
    for (i = 0; i < 3; i++)
        f_p[i] = foucault_accel_inverse[i][0] * s[0] + foucault_accel_inverse[i][1] * s[1]
               + foucault_accel_inverse[i][2] * s[2];
    for (i = 0; i < 3; i++) {
        double along[3];         /* specific force along input, output and spin axis */
        const double *d = foucault_drift_g[i], *e = foucault_drift_g2[i];
        for (j = 0; j < 3; j++)
            along[j] = foucault_gyro_axes[i][j][0] * f_p[0]
                     + foucault_gyro_axes[i][j][1] * f_p[1]
                     + foucault_gyro_axes[i][j][2] * f_p[2];
        rate[i] = foucault_torquer_slope[i] * command[i] + foucault_drift[i]
                + d[0] * along[0] + d[1] * along[1] + d[2] * along[2]
                + e[0] * along[0] * along[1] + e[1] * along[0] * along[2]
                + e[2] * along[1] * along[2];
    }
    for (i = 0; i < 3; i++)
        w_p[i] = foucault_input_inverse[i][0] * rate[0] + foucault_input_inverse[i][1] * rate[1]
               + foucault_input_inverse[i][2] * rate[2];
}
#endif /* FOUCAULT_CALIBRATION_H */
"""

_PYTHON = '''

def _times(matrix, vector):
    return [sum(m * v for m, v in zip(line, vector)) for line in matrix]


def _sensed(known, slope, k):
    """Newton's method for slope s + k s^2 = known, a fixed number of steps."""
    s = known / slope
    for _ in range(STEPS):
        s -= (slope * s + k * s * s - known) / (slope + 2.0 * k * s)
    return s


def compensate(accel, command):
    """Return true specific force [m/s^2] and rate [rad/s] of the cluster, in its axes."""
    s = [_sensed(accel[i] - ACCEL_BIAS[i], ACCEL_SLOPE[i], ACCEL_QUADRATIC[i]) for i in range(3)]
    f = _times(ACCEL_INVERSE, s)
    rate = []
    for i in range(3):
        along = _times(GYRO_AXES[i], f)  # input, output and spin axis
        pairs = (along[0] * along[1], along[0] * along[2], along[1] * along[2])
        rate.append(
            TORQUER_SLOPE[i] * command[i] + DRIFT[i]
            + sum(d * a for d, a in zip(DRIFT_G[i], along))
            + sum(d * a for d, a in zip(DRIFT_G2[i], pairs))
        )
    return f, _times(INPUT_INVERSE, rate)
'''
