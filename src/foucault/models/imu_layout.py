"""The coefficients of the IMU error model `models.imu`: names, symbols, kinds and meanings."""

from __future__ import annotations

from foucault.coefficients import Coefficient, Layout
from foucault.tables import AXES

PRODUCTS = (("x", "x"), ("y", "y"), ("z", "z"), ("x", "y"), ("x", "z"), ("y", "z"))
"""The second-order inputs q(f), in the order of the columns of K_a."""


def _triad_coefficients(triad: str, letter: str, kind: str, what: str) -> list[Coefficient]:
    out = [
        Coefficient(f"{triad}.bias.{a}", f"b_{letter}{a}", kind, f"{what} bias, {a} axis")
        for a in AXES
    ]
    out += [
        Coefficient(
            f"{triad}.scale.{a}",
            f"s_{letter}{a}",
            "scale factor error",
            f"{what} scale factor error, {a} axis",
        )
        for a in AXES
    ]
    out += [
        Coefficient(
            f"{triad}.misalignment.{o}{i}",
            f"m_{letter}{o}{i}",
            "misalignment",
            f"{what} {o} output per {i} input",
        )
        for o in AXES
        for i in AXES
        if o != i
    ]
    return out


LAYOUT = Layout(
    (
        *_triad_coefficients("accel", "a", "specific force", "accelerometer"),
        *(
            Coefficient(
                f"accel.quadratic.{a}",
                f"k_{a}{a}{a}",
                "quadratic",
                f"accelerometer {a} output per square of the {a} input",
            )
            for a in AXES
        ),
        *(
            Coefficient(
                f"accel.cross.{o}{i}{j}",
                f"k_{o}{i}{j}",
                "quadratic",
                f"accelerometer {o} output per product of the {i} and {j} inputs",
            )
            for o in AXES
            for i, j in PRODUCTS
            if not o == i == j
        ),
        *_triad_coefficients("gyro", "g", "angular rate", "gyro"),
        *(
            Coefficient(
                f"gyro.g_sensitivity.{o}{i}",
                f"g_{o}{i}",
                "g-sensitivity",
                f"gyro {o} output per specific force along {i}",
            )
            for o in AXES
            for i in AXES
        ),
        *(
            Coefficient(
                f"gyro.asymmetry.{a}",
                f"a_g{a}",
                "scale factor error",
                f"gyro {a}: half the difference of the scale factors for positive and negative "
                "rates, per scale factor",
            )
            for a in AXES
        ),
        *(
            Coefficient(
                f"gyro.cubic.{a}",
                f"c_g{a}",
                "cubic",
                f"gyro {a}: output per third power of the rate sensed",
            )
            for a in AXES
        ),
    )
)
"""Every coefficient the model knows. A procedure estimates a subset; the rest is zero."""

LINEAR_LOWER = tuple(
    n
    for n in LAYOUT.names
    if n.split(".")[1] in ("bias", "scale", "misalignment")
    and not (n.startswith("accel.misalignment.") and n[-2] < n[-1])
)
"""Names of the 21 linear coefficients in the gauge `Gauge.LOWER`."""
