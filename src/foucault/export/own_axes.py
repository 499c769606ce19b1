"""Results that are no IMU's in C, Python and JSON, in their own axes: cluster, north seeker, mag.

Receiver's convention: ours, in rad/s and m/s^2.

Cluster: accelerometers and commanded rate in cluster axes p; specific force and rate come out in
the same axes. See `models.cluster` for the equations.

North seeker: readings of gyro and accelerometer at index angles clockwise from above; heading of
y_b clockwise from north, pitch nose up, roll right side down come out. The latitude is given, so
that the rate about up is known. See `models.north_seeker`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.escape import commented
from foucault.export.code import NEWTON_STEPS, PYTHON, C, Language, Meant
from foucault.export.request import OWN_AXES, about, inverse, pieces
from foucault.models import cluster, magnetometer, north_seeker
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import ImuModel
from foucault.result import Result

Constants = dict[str, tuple[str, FloatArray]]  # What the code needs: name -> meaning and numbers.

AXES = {
    "cluster": "Axes: those of the cluster, p",
    "north_seeker": f"Axes: those of the case, {OWN_AXES}",
    "magnetometer": f"Axes: those of the IMU, {OWN_AXES}",
}

INVERSE = (
    "f = g u: I + S_a + M_a, rows x and y, solved for u_x, u_y, and u_z = sqrt(1 - u_x^2 - u_y^2); "
    "w: I + S_g + M_g, rows x and y, solved with w . u = w_ie sin(latitude); "
    "north = w - (w . u) u; east = north x u; heading = atan2(east_y, north_y), "
    "pitch = atan2(u_y, hypot(u_x, u_z)), roll = atan2(-u_x, u_z)"
)
"""That of a north seeker."""


def _of_cluster(result: Result) -> Constants:
    model = cluster.ClusterModel.from_coefficients(result.coefficients)
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


def _of_north_seeker(result: Result) -> Constants:
    model = ImuModel.from_coefficients(result.coefficients)
    return {
        "gyro_matrix": ("Gyro: rows x and y of I + S_g + M_g [1]", model.gyro_matrix[:2]),
        "gyro_bias": ("Bias, resolved by the base [rad/s]", model.gyro_bias[:2]),
        "accel_matrix": ("Accelerometer: rows x and y of I + S_a + M_a [1]",
                         model.accel_matrix[:2, :2]),
        "accel_bias": ("Bias, resolved by the base [m/s^2]", model.accel_bias[:2]),
    }  # fmt: skip


def _of_magnetometer(result: Result) -> Constants:
    model = magnetometer.Magnetometer.from_coefficients(result.coefficients)
    return {
        "mag_inverse": ("Inverse of A [1]", inverse(model.matrix)),
        "mag_bias": ("Hard iron h [T]", model.bias),
        "mag_bias_temperature": ("Its change h_T [T/K]", model.bias_temperature),
    }


def _parts(result: Result) -> tuple[str, Constants]:
    if result.procedure == "magnetometer":
        return "magnetometer", _of_magnetometer(result)
    if result.procedure == "north_seeking":
        return "north_seeker", _of_north_seeker(result)
    return "cluster", _of_cluster(result)


def _program(result: Result, language: Language, mark: str, before: str) -> str:
    name, constants = _parts(result)
    code, own = pieces(name), list[Meant]()
    if name == "north_seeker":
        own.append(("Rate of the Earth [rad/s].", {"earth_rate": EARTH_RATE}))
    if name == "magnetometer":
        told = "Readings are of the field so long before their time [s]; temperature of h [K]."
        delay = result.coefficients.value("mag.delay")
        own.append((told, {"mag_delay": delay, "mag_reference": magnetometer.REFERENCE}))
    own += [(f"{meaning}.", {key: values}) for key, (meaning, values) in constants.items()]
    kind = "c" if language is C else "python"
    return "\n".join([
        *([before] if before else []), commented(about(result, AXES[name]), mark),
        code[f"{kind}_about"], *language.numbers(own), *([""] if before else []),
        code[kind].replace("STEPS", NEWTON_STEPS),
    ])  # fmt: skip


def c(result: Result) -> str:
    """Write a C header."""
    return _program(result, C, " *", "/*")


def python(result: Result) -> str:
    """Write a Python module."""
    return _program(result, PYTHON, "#", "")


def document(result: Result) -> str:
    """Write the matrices as JSON."""
    name, constants = _parts(result)
    own: dict[str, dict[str, Any]] = {
        "cluster": {
            "axes": "cluster",
            "units": {"accel": "m/s^2", "command": "rad/s"},
            "equation": cluster.EQUATION,
            "inverse": cluster.INVERSE,
        },
        "north_seeker": {
            "axes": OWN_AXES,
            "units": {"accel": "m/s^2", "gyro": "rad/s", "angles": "rad"},
            "equation": north_seeker.EQUATION,
            "inverse": INVERSE,
            "earth_rate": EARTH_RATE,
        },
        "magnetometer": {
            "axes": OWN_AXES,
            "units": {"mag": "T", "gyro": "rad/s", "temperature": "K"},
            "equation": magnetometer.EQUATION,
            "inverse": magnetometer.INVERSE,
            "reference": magnetometer.REFERENCE,
        },
    }
    out = {
        "format": f"foucault.export.{name}/1",
        "about": about(result, AXES[name]),
        "instrument": result.instrument,
        **own[name],
        "meaning": {key: meaning for key, (meaning, _) in constants.items()},
        **{key: values.tolist() for key, (_, values) in constants.items()},
    }
    return json.dumps(out, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


WRITERS: dict[str, Callable[[Result], str]] = {"c": c, "python": python, "json": document}
