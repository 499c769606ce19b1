"""The equations of `models.imu` in words, as results store and reports typeset them."""

from __future__ import annotations

_ACCEL = "accel = (I + S_a + M_a) f + b_a + K_a q(f);  "
_WORDS = (
    "f: true specific force, w: true angular rate, both in body axes; "
    "q(f) = (fx^2, fy^2, fz^2, fx fy, fx fz, fy fz)"
)
_ACCEL_INVERSE = "f = (I + S_a + M_a)^-1 (accel - b_a - K_a q(f));  "

EQUATION = f"{_ACCEL}gyro = (I + S_g + M_g) w + b_g + G f;  {_WORDS}"
"""The model equation in words, as stored in results."""

INVERSE = f"{_ACCEL_INVERSE}w = (I + S_g + M_g)^-1 (gyro - b_g - G f)"
"""The same solved for what is true, as `ImuModel.compensate` does it."""

SCALE_EQUATION = (
    f"{_ACCEL}gyro = r + A_g |r| + C_g r^3 + b_g + G f;  r = (I + S_g + M_g) w;  {_WORDS}; "
    "A_g and C_g are diagonal, |r| and r^3 are taken axis by axis"
)
"""The model equation where a gyro's scale factor is no constant."""

SCALE_INVERSE = (
    f"{_ACCEL_INVERSE}r + A_g |r| + C_g r^3 = gyro - b_g - G f;  w = (I + S_g + M_g)^-1 r"
)
"""The same solved for what is true."""

FULL_EQUATION = (
    "accel = p + A_a |p| + b_a + K_a q(f);  p = (I + S_a + M_a) f;  "
    "gyro = r + A_g |r| + C_g r^3 + b_g + G f;  r = (I + S_g + M_g + D(f)) w;  "
    f"D_ij(f) = T_ijx fx + T_ijy fy + T_ijz fz;  {_WORDS}; "
    "A_a, A_g and C_g are diagonal, |p|, |r| and r^3 are taken axis by axis; "
    "T_ijk: angle that the input axis of gyro i bends towards j per specific force along k"
)
"""The model equation with all there is: asymmetries, and gyros that bend under specific force."""

FULL_INVERSE = (
    "p + A_a |p| = accel - b_a - K_a q(f);  f = (I + S_a + M_a)^-1 p;  "
    "r + A_g |r| + C_g r^3 = gyro - b_g - G f;  w = (I + S_g + M_g + D(f))^-1 r"
)
"""The same solved for what is true."""

SIZE_EQUATION = FULL_EQUATION.replace("K_a q(f);", "K_a q(f) + e;", 1) + (
    ";  e_i = (w x (w x r_i) + dw x r_i)_i - tau df_i;  "
    "dw and df: derivatives of rate and specific force as read; r_i: place of accelerometer i; "
    "tau: how much later accelerometers read than gyros"
)
"""The model equation of accelerometers that are not at one place, or late (see
`models.size_effect`)."""

SIZE_INVERSE = FULL_INVERSE.replace("K_a q(f);", "K_a q(f) - e;", 1)
"""The same solved for what is true."""

INVERSES = {
    EQUATION: INVERSE, SCALE_EQUATION: SCALE_INVERSE, FULL_EQUATION: FULL_INVERSE,
    SIZE_EQUATION: SIZE_INVERSE,
}  # fmt: skip
"""Equation that a result may store -> the same solved for what is true."""
