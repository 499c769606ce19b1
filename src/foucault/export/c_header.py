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

_CALL_RATE = """\
    for (i = 0; i < 3; i++)
        w_b[i] = foucault_gyro_inverse[i][0] * w[0] + foucault_gyro_inverse[i][1] * w[1]
               + foucault_gyro_inverse[i][2] * w[2];
"""

_CALL_BENT = """\
    {
        double s[3][3];
        int j;
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++)
                s[i][j] = foucault_gyro_matrix[i][j] + foucault_deflection[i][j][0] * f_b[0]
                        + foucault_deflection[i][j][1] * f_b[1]
                        + foucault_deflection[i][j][2] * f_b[2];
        foucault_solve(s, w, w_b);
    }
"""

_FUNCTION = """\
/* True specific force f_b [m/s^2] and angular rate w_b [rad/s] from readings. */
static inline void foucault_compensate(const double accel_raw[3], const double gyro_raw[3],
                                       double f_b[3], double w_b[3])
{
    double a[3], w[3];
    int i;
    for (i = 0; i < 3; i++)
        a[i] = accel_raw[i] - foucault_accel_bias[i];
/*SENSE*/
    for (i = 0; i < 3; i++)
        f_b[i] = foucault_accel_inverse[i][0] * a[0] + foucault_accel_inverse[i][1] * a[1]
               + foucault_accel_inverse[i][2] * a[2];
/*NEWTON*/
    for (i = 0; i < 3; i++)
        w[i] = gyro_raw[i] - foucault_gyro_bias[i]/*FELT*/;
/*SENSED*/
/*RATE*/
}
"""

_SOLVE = """\
/* Solve s x = m by cofactors. */
static inline void foucault_solve(double s[3][3], const double m[3], double x[3])
{
    double c[3][3], det;
    int i, j;
    for (i = 0; i < 3; i++)      /* indices run on in a circle */
        for (j = 0; j < 3; j++)
            c[i][j] = s[(i + 1) % 3][(j + 1) % 3] * s[(i + 2) % 3][(j + 2) % 3]
                    - s[(i + 1) % 3][(j + 2) % 3] * s[(i + 2) % 3][(j + 1) % 3];
    det = s[0][0] * c[0][0] + s[0][1] * c[0][1] + s[0][2] * c[0][2];
    for (i = 0; i < 3; i++)
        x[i] = (c[0][i] * m[0] + c[1][i] * m[1] + c[2][i] * m[2]) / det;
}
"""

_NEWTON = """\
/* Newton's method for p + a |p| + b + K q(f) = reading, p = A f, a fixed number of steps from f. */
static inline void foucault_solve_force(const double accel_raw[3], double f[3])
{
    int step, i, j;
    for (step = 0; step < STEPS; step++) {
        const double q[6] = {f[0] * f[0], f[1] * f[1], f[2] * f[2],
                             f[0] * f[1], f[0] * f[2], f[1] * f[2]};
        double m[3], s[3][3], change[3];
        for (i = 0; i < 3; i++) {
            const double *k = foucault_accel_quadratic[i];
            const double *a = foucault_accel_matrix[i];
            const double p = a[0] * f[0] + a[1] * f[1] + a[2] * f[2];
            const double e = foucault_accel_asymmetry[i], scale = p < 0.0 ? 1.0 - e : 1.0 + e;
            m[i] = scale * p + foucault_accel_bias[i] - accel_raw[i];
            for (j = 0; j < 6; j++)
                m[i] += k[j] * q[j];
            s[i][0] = scale * a[0] + 2.0 * k[0] * f[0] + k[3] * f[1] + k[4] * f[2];
            s[i][1] = scale * a[1] + 2.0 * k[1] * f[1] + k[3] * f[0] + k[5] * f[2];
            s[i][2] = scale * a[2] + 2.0 * k[2] * f[2] + k[4] * f[0] + k[5] * f[1];
        }
        foucault_solve(s, m, change);
        for (i = 0; i < 3; i++)
            f[i] -= change[i];
    }
}
"""

_SENSED = """\
/* Newton's method for r + a |r| + c r^3 = y, axis by axis: y comes in w, r goes out. */
static inline void foucault_sensed_rate(double w[3])
{
    int step, i;
    for (i = 0; i < 3; i++) {
        const double y = w[i], a = foucault_gyro_asymmetry[i], c = foucault_gyro_cubic[i];
        const double k = y < 0.0 ? 1.0 - a : 1.0 + a;
        double r = y / k;
        for (step = 0; step < STEPS; step++)
            r -= (k * r + c * r * r * r - y) / (k + 3.0 * c * r * r);
        w[i] = r;
    }
}
"""

_NEXT = """\
/* What is kept of the sample before. Begin with foucault_state state = {0}, and after a gap. */
typedef struct {
    int known;
    double accel[3], gyro[3];
} foucault_state;

/* The same as foucault_compensate, and lever arms and delay of the accelerometers besides; dt is
   the time since the sample before [s]. No sample is held back: how fast readings change is their
   difference from the sample before, which is half an interval old. Of a first sample, and where dt
   is not above 0, they are taken not to change. Readings that are increments come divided by dt. */
static inline void foucault_compensate_next(foucault_state *state, double dt,
                                            const double accel_raw[3], const double gyro_raw[3],
                                            double f_b[3], double w_b[3])
{
    double a[3], df[3] = {0.0, 0.0, 0.0}, dw[3] = {0.0, 0.0, 0.0};
    int i;
    for (i = 0; i < 3; i++) {
        if (state->known && dt > 0.0) {
            df[i] = (accel_raw[i] - state->accel[i]) / dt;
            dw[i] = (gyro_raw[i] - state->gyro[i]) / dt;
        }
        state->accel[i] = accel_raw[i];
        state->gyro[i] = gyro_raw[i];
    }
    state->known = 1;
    foucault_compensate(accel_raw, gyro_raw, f_b, w_b);
    for (i = 0; i < 3; i++) {    /* w x (w x r) + dw x r along the axis of the accelerometer */
        const double *r = foucault_accel_places[i];
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        a[i] = accel_raw[i] + foucault_accel_delay * df[i]
             - w_b[i] * (w_b[j] * r[j] + w_b[k] * r[k])
             + r[i] * (w_b[j] * w_b[j] + w_b[k] * w_b[k])
             - dw[j] * r[k] + dw[k] * r[j];
    }
    foucault_compensate(a, gyro_raw, f_b, w_b);
}
"""

_COUNTS = """\
/* The same from raw counts, in the order stated above. */
static inline void foucault_compensate_counts(const double accel_counts[3],
                                              const double gyro_counts[3],
                                              double f_b[3], double w_b[3])
{
    double accel_raw[3], gyro_raw[3];
    int i;
    for (i = 0; i < 3; i++) {
        accel_raw[i] = (accel_counts[i] - foucault_accel_zero[i]) * foucault_accel_factor[i];
        gyro_raw[i] = (gyro_counts[i] - foucault_gyro_zero[i]) * foucault_gyro_factor[i];
    }
    foucault_compensate(accel_raw, gyro_raw, f_b, w_b);
}
"""

_COUNTS_NEXT = """\
/* The same from raw counts, in the order stated above. */
static inline void foucault_compensate_counts(foucault_state *state, double dt,
                                              const double accel_counts[3],
                                              const double gyro_counts[3],
                                              double f_b[3], double w_b[3])
{
    double accel_raw[3], gyro_raw[3];
    int i;
    for (i = 0; i < 3; i++) {
        accel_raw[i] = (accel_counts[i] - foucault_accel_zero[i]) * foucault_accel_factor[i];
        gyro_raw[i] = (gyro_counts[i] - foucault_gyro_zero[i]) * foucault_gyro_factor[i];
    }
    foucault_compensate_next(state, dt, accel_raw, gyro_raw, f_b, w_b);
}
"""
