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

_C = """\
/* Solve s x = m by Cramer's rule. */
static inline void foucault_solve2(double s[2][2], const double m[2], double x[2])
{
    const double det = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    x[0] = (m[0] * s[1][1] - s[0][1] * m[1]) / det;
    x[1] = (s[0][0] * m[1] - m[0] * s[1][0]) / det;
}

/* Components x and y of readings at n stops, three or more: reading = o + x sin a + y cos a by
   least squares, a the index angle [rad], clockwise seen from above. */
static inline void foucault_components(int n, const double index[], const double reading[],
                                       double xy[2])
{
    double ms = 0.0, mc = 0.0, mr = 0.0, s[2][2] = {{0.0, 0.0}, {0.0, 0.0}}, m[2] = {0.0, 0.0};
    int k;
    for (k = 0; k < n; k++) {
        ms += sin(index[k]) / n;
        mc += cos(index[k]) / n;
        mr += reading[k] / n;
    }
    for (k = 0; k < n; k++) {
        const double a = sin(index[k]) - ms, b = cos(index[k]) - mc, r = reading[k] - mr;
        s[0][0] += a * a;
        s[0][1] += a * b;
        s[1][1] += b * b;
        m[0] += a * r;
        m[1] += b * r;
    }
    s[1][0] = s[0][1];
    foucault_solve2(s, m, xy);
}

/* Heading, pitch and roll [rad] from the components of gyro [rad/s] and accelerometer [m/s^2] at
   a latitude [rad], positive north, with local gravity [m/s^2]; the case is not upside down. */
static inline void foucault_north(const double gyro[2], const double accel[2], double latitude,
                                  double gravity, double *heading, double *pitch, double *roll)
{
    const double up = foucault_earth_rate * sin(latitude);
    double u[3], w[3], s[2][2], m[2], north[3];
    int i, j;
    for (i = 0; i < 2; i++) {
        m[i] = (accel[i] - foucault_accel_bias[i]) / gravity;
        for (j = 0; j < 2; j++)
            s[i][j] = foucault_accel_matrix[i][j];
    }
    foucault_solve2(s, m, u);
    u[2] = sqrt(1.0 - u[0] * u[0] - u[1] * u[1]);
    for (i = 0; i < 2; i++) {    /* w . u = up takes the place of the third row */
        const double *g = foucault_gyro_matrix[i];
        m[i] = gyro[i] - foucault_gyro_bias[i] - g[2] * up / u[2];
        for (j = 0; j < 2; j++)
            s[i][j] = g[j] - g[2] * u[j] / u[2];
    }
    foucault_solve2(s, m, w);
    w[2] = (up - w[0] * u[0] - w[1] * u[1]) / u[2];
    for (i = 0; i < 3; i++)
        north[i] = w[i] - up * u[i];
    *heading = atan2(north[2] * u[0] - north[0] * u[2], north[1]);
    *pitch = atan2(u[1], sqrt(u[0] * u[0] + u[2] * u[2]));
    *roll = atan2(-u[0], u[2]);
}
#endif /* FOUCAULT_CALIBRATION_H */
"""

_PYTHON = '''

def _solve(s, m):
    det = s[0][0] * s[1][1] - s[0][1] * s[1][0]
    return [(m[0] * s[1][1] - s[0][1] * m[1]) / det, (s[0][0] * m[1] - m[0] * s[1][0]) / det]


def components(index, reading):
    """Return x and y of readings at three stops or more: reading = o + x sin a + y cos a.

    index is the angle a of every stop [rad], clockwise seen from above.
    """
    n = len(index)
    a, b, r = [sin(k) for k in index], [cos(k) for k in index], list(reading)
    a, b, r = ([v - sum(x) / n for v in x] for x in (a, b, r))
    ab = sum(x * y for x, y in zip(a, b))
    s = [[sum(x * x for x in a), ab], [ab, sum(x * x for x in b)]]
    return _solve(s, [sum(x * y for x, y in zip(a, r)), sum(x * y for x, y in zip(b, r))])


def north(gyro, accel, latitude, gravity):
    """Return heading, pitch and roll [rad] from components of gyro [rad/s] and accelerometer.

    latitude in rad, positive north; gravity in m/s^2; the case is not upside down.
    """
    up = EARTH_RATE * sin(latitude)
    u = _solve(ACCEL_MATRIX, [(accel[i] - ACCEL_BIAS[i]) / gravity for i in range(2)])
    u.append(sqrt(1.0 - u[0] * u[0] - u[1] * u[1]))
    s = [[g[j] - g[2] * u[j] / u[2] for j in range(2)] for g in GYRO_MATRIX]
    m = [gyro[i] - GYRO_BIAS[i] - GYRO_MATRIX[i][2] * up / u[2] for i in range(2)]
    w = _solve(s, m)  # w . u = up takes the place of the third row
    w.append((up - w[0] * u[0] - w[1] * u[1]) / u[2])
    n = [w[i] - up * u[i] for i in range(3)]
    heading = atan2(n[2] * u[0] - n[0] * u[2], n[1])
    return heading, atan2(u[1], hypot(u[0], u[2])), atan2(-u[0], u[2])
'''
