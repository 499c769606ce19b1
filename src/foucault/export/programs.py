"""What other programs read: tables, JSON, Kalibr, imucal, PX4, imu_calib."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.escape import commented, csv_cell
from foucault.export.request import (
    FAMILIES,
    LINEAR,
    OWN_AXES,
    Request,
    TemperatureTerms,
    inverse,
    number,
    row,
)
from foucault.models.imu import Gauge
from foucault.models.size_effect import SizeEffect

# -- The coefficients as a table: one row each, the covariance in further columns of the row -------
# Receiver's convention: ours. Values in SI units as the column ``unit`` says, in the axes of the
# result whatever axes are asked for elsewhere.


def csv_text(wanted: Request) -> str:
    """Write the table; lines that begin with # are comments."""
    if wanted.axes != OWN_AXES:
        raise error("export.axes_fixed", receiver="csv", given=wanted.axes, axes=OWN_AXES)
    vector = wanted.result.coefficients
    gone = set(wanted.dropped.names)
    keep = [i for i, name in enumerate(vector.names) if name not in gone]
    out = io.StringIO()
    print(commented(wanted.statement(), "#", table=True), file=out)
    print("# Columns cov:NAME hold the covariance with coefficient NAME, in the product of the"
          " two units; empty where unknown.", file=out)  # fmt: skip
    names = [vector.names[i] for i in keep]
    lines = csv.writer(out, lineterminator="\n")
    covariance = [] if vector.cov is None else [csv_cell(f"cov:{name}") for name in names]
    lines.writerow(["name", "symbol", "value", "sd", "unit", "free", "meaning", *covariance])
    for i in keep:
        c = vector.layout.coefficients[i]
        cov = [] if vector.cov is None else [_number(vector.cov[i, j]) for j in keep]
        sd = _number(vector.sd[i])
        value, free = repr(float(vector.values[i])), int(vector.free[i])
        words = [csv_cell(word) for word in (c.name, c.symbol, c.unit, c.meaning)]
        lines.writerow([*words[:2], value, sd, words[2], free, words[3], *cov])
    return out.getvalue()


def _number(value: float) -> str:
    return repr(float(value)) if value == value else ""


# -- Matrices and biases as plain JSON, forward and inverse, with the equations ------------------
# Receiver's convention: ours, whatever reads it.


FORMAT = "foucault.export/1"
"""Name and version of the document."""


def json_text(wanted: Request) -> str:
    """Write the document."""
    model = wanted.model
    out = {
        "format": FORMAT,
        "about": wanted.statement(),
        "instrument": wanted.result.instrument,
        "axes": wanted.axes,
        "units": {"accel": "m/s^2", "gyro": "rad/s"},
        "forward": {
            "equation": "accel = p + accel_asymmetry |p| + accel_bias + accel_quadratic q(f), "
            "axis by axis; p = accel_matrix f; "
            "gyro = r + gyro_asymmetry |r| + gyro_cubic r^3 + gyro_bias + g_sensitivity f, axis "
            "by axis; r = (gyro_matrix + D) w; D_ij = sum over k of deflection_ijk f_k; "
            "q(f) = (fx^2, fy^2, fz^2, fx fy, fx fz, fy fz)",
            "accel_matrix": model.accel_matrix.tolist(),
            "accel_bias": model.accel_bias.tolist(),
            "accel_quadratic": model.accel_quadratic.tolist(),
            "gyro_matrix": model.gyro_matrix.tolist(),
            "gyro_bias": model.gyro_bias.tolist(),
            "g_sensitivity": model.g_sensitivity.tolist(),
            "gyro_asymmetry": model.gyro_asymmetry.tolist(),
            "gyro_cubic": model.gyro_cubic.tolist(),
            "accel_asymmetry": model.accel_asymmetry.tolist(),
            "deflection": model.deflection.tolist(),
        },
        "inverse": {
            "equation": "f = accel_inverse p; p = (accel - accel_bias - accel_quadratic q(f)) / "
            "(1 + accel_asymmetry sign(p)), axis by axis, repeated until f stands still where "
            "accel_quadratic is not zero; w = gyro_inverse (r - D w), repeated until w stands "
            "still where deflection is not zero; "
            "r = (gyro - gyro_bias - g_sensitivity f - gyro_cubic r^3) / "
            "(1 + gyro_asymmetry sign(r)), axis by axis, repeated until r stands still where "
            "gyro_cubic is not zero",
            "accel_inverse": inverse(model.accel_matrix).tolist(),
            "gyro_inverse": inverse(model.gyro_matrix).tolist(),
        },
        **_size_effect(wanted.size),
        "dropped": dict(zip(wanted.dropped.names, wanted.dropped.values.tolist(), strict=True)),
    }
    if wanted.temperature is not None:
        out = _with_temperature(out, wanted.temperature)
    return json.dumps(out, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _with_temperature(out: dict[str, Any], terms: TemperatureTerms) -> dict[str, Any]:
    """Put terms in the place of constants, which would hold at one temperature only."""
    forward = {name: terms.block(name).tolist() for name in out["forward"] if name != "equation"}
    for part in ("forward", "inverse"):
        out[part] = {"equation": out[part]["equation"]}
    f = terms.functions
    out["temperature"] = {
        "equation": "every array of forward is the sum over k of terms[k] phi_k(T); phi_k is "
        + ("1 at knot k, 0 at every other, and straight between" if f.knots.size
           else "(T - reference)^k")
        + "; accel_inverse and gyro_inverse are the inverses of accel_matrix and gyro_matrix",
        "unit": "K",
        "low": f.low,
        "high": f.high,
        "reference": f.reference,
        "knots": f.knots.tolist(),
        "terms": forward,
    }  # fmt: skip
    return out


def _size_effect(size: SizeEffect) -> dict[str, Any]:
    """Return what several samples tell, where there is any."""
    if not size:
        return {}
    return {
        "size_effect": {
            "equation": "taken from accel before `inverse`: accel_i - (w x (w x r_i) + dw x r_i)_i "
            "+ accel_delay daccel_i, axis by axis; r_i row i of accel_places, w of `inverse` with "
            "accel as read, dw and daccel derivatives of gyro and accel as read",
            "accel_places": size.arms.tolist(),
            "accel_delay": size.delay,
        }
    }


# -- The imu.yaml of Kalibr: noise, and the blocks of its model ``scale-misalignment`` -----------
# Receiver's convention, from its source (``IccScaledMisalignedImu``)::
#
#     accel = M_a f_i + b_a
#     gyro  = M_g C_gyro_i w_i + A C_gyro_i f_i + b_g
#
# with M_a and M_g lower triangular, C_gyro_i a rotation, and frame i defined by the accelerometers
# as in our gauge of that name. It estimates the biases anew in every session and keeps none.

KALIBR_CAN = (
    "accel.scale",
    "accel.misalignment",
    "gyro.scale",
    "gyro.misalignment",
    "gyro.g_sensitivity",
)


def kalibr_text(wanted: Request) -> str:
    """Write the file."""
    model, C_ib = wanted.model.in_gauge(Gauge.LOWER)
    M_g, C_gyro_i = lower_times_rotation(model.gyro_matrix)
    A = model.g_sensitivity @ C_gyro_i.T
    turn = np.degrees(np.linalg.norm(C_ib - np.eye(3)) / np.sqrt(2))
    lines = [
        commented(wanted.statement(), "#"),
        "#",
        "# For Kalibr, model scale-misalignment, frame i as its accelerometers define it:",
        "#   accel = M f_i + bias,  gyro = M C_gyro_i w_i + A C_gyro_i f_i + bias",
        "# Kalibr writes these blocks into its results and estimates them anew; as input it reads",
        "# the noise, the rate and the topic. Biases have no place in the file.",
    ]
    if turn > 1e-9:
        lines += [f"# Frame i is turned by {turn:.3g} deg against the axes of the result."]
    lines += [
        "rostopic: /imu0",
        *_rate(wanted.result.validity),
        *_noise(wanted),
        "model: scale-misalignment",
        "accelerometers:",
        *_matrix("M", model.accel_matrix),
        "gyroscopes:",
        *_matrix("M", M_g),
        *_matrix("A", A),
        *_matrix("C_gyro_i", C_gyro_i),
    ]
    return "\n".join([*lines, ""])


def lower_times_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split `matrix`, shape (3, 3) [1], into a lower triangular matrix times a rotation."""
    Q, R = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(R))
    return np.tril((R * signs[:, None]).T), (Q * signs).T


def _matrix(name: str, matrix: FloatArray) -> list[str]:
    return [f"  {name}:", *(f"  - [{row(line)}]" for line in matrix)]


def _rate(validity: Mapping[str, Any]) -> list[str]:
    rate = validity.get("rate")
    if rate is None:
        return ["# update_rate: not known to the result; write it here [Hz]"]
    return [f"update_rate: {float(rate):.9g}"]


def _noise(wanted: Request) -> list[str]:
    """Write the noise; what is not known stays a comment, which Kalibr will ask for."""
    measured = wanted.result.diagnostics.get("noise") or {}
    out = []
    for name, key, unit in (
        ("accel", "accelerometer", "m/s^2"),
        ("gyro", "gyroscope", "rad/s"),
    ):
        triad = None if wanted.noise is None else getattr(wanted.noise, name)
        axes = measured.get(f"{name}_white")
        white = triad.white if triad and triad.white else _rms(axes)
        walk = triad.random_walk if triad and triad.random_walk else None
        for what, value, root in (
            ("noise_density", white, "sqrt(Hz)"),
            ("random_walk", walk, "sqrt(s)"),
        ):
            if value:
                out.append(f"{key}_{what}: {number(value)}  # {unit}/{root}")
            else:
                words = "not known to the result; measure it with foucault allan"
                out.append(f"# {key}_{what}: {words} [{unit}/{root}]")
    return out


def _rms(values: Any) -> float | None:
    """Kalibr has one number for three axes: their root mean square."""
    if values is None or None in values:
        return None
    return float(np.sqrt(np.mean(np.square(values))))


# -- The JSON file of imucal (``CalibrationInfo.from_json_file``) --------------------------------
# Receiver's convention, from its source (``FerrarisCalibrationInfo``, format version 2.0.0)::
#
#     acc_out = R_a^-1 K_a^-1 (acc - b_a)
#     gyr_out = R_g^-1 K_g^-1 (gyr - K_ga acc_out - b_g)
#
# in m/s^2 and deg/s. With K the diagonal of our matrix and R the rest, K R is our matrix.

IMUCAL_CAN = (*LINEAR, "gyro.g_sensitivity")


def imucal_text(wanted: Request) -> str:
    """Write the document."""
    model = wanted.model
    K_a, R_a = _split(model.accel_matrix)
    K_g, R_g = _split(model.gyro_matrix)
    out: dict[str, Any] = {
        "acc_unit": "m/s^2",
        "gyr_unit": "deg/s",
        "from_acc_unit": "m/s^2",
        "from_gyr_unit": "deg/s",
        "comment": "\n".join(wanted.statement()),
        "K_a": K_a.tolist(),
        "R_a": R_a.tolist(),
        "b_a": model.accel_bias.tolist(),
        "K_g": K_g.tolist(),
        "R_g": R_g.tolist(),
        "K_ga": np.rad2deg(model.g_sensitivity).tolist(),
        "b_g": np.rad2deg(model.gyro_bias).tolist(),
        "cal_type": "Ferraris",
        "_format_version": "2.0.0",
    }
    return json.dumps(out, indent=4, allow_nan=False) + "\n"


def _split(matrix: npt.NDArray[np.float64]) -> tuple[Any, Any]:
    diagonal = np.diag(matrix)
    return np.diag(diagonal), matrix / diagonal[:, None]


# -- Parameters of the PX4 autopilot, as ``param set`` lines for its shell -----------------------
# Receiver's convention, from its source (``src/lib/sensor_calibration``)::
#
#     accelerometer: (data - offset) * scale, axis by axis, then the rotation of the board
#     gyro:           data - offset, then the rotation of the board
#
# in m/s^2 and rad/s, with the axes of the board forward-right-down. There is no misalignment, and
# no scale factor of the gyros.

PX4_CAN = ("accel.bias", "accel.scale", "gyro.bias")


def px4_text(wanted: Request) -> str:
    """Write the file."""
    model = wanted.model
    numbers = {
        "ACC0_{}OFF": model.accel_bias,
        "ACC0_{}SCALE": 1.0 / np.diag(model.accel_matrix),
        "GYRO0_{}OFF": model.gyro_bias,
    }
    lines = [
        commented(wanted.statement(), "#"),
        "#",
        "# PX4 computes (data - OFF) * SCALE for accelerometers [m/s^2] and data - OFF for gyros",
        "# [rad/s], in the axes of sensor_accel and sensor_gyro, before it turns them by",
        "# SENS_BOARD_ROT. It keeps parameters in single precision.",
        "# The numbers are for the sensor in slot 0: CAL_ACC0_ID and CAL_GYRO0_ID must already",
        "# hold the device numbers of this sensor. Restart after setting them.",
    ]
    for key, values in numbers.items():
        lines += [
            f"param set CAL_{key.format(axis)} {number(value)}"
            for axis, value in zip("XYZ", values, strict=True)
        ]
    return "\n".join([*lines, "param save", ""])


# -- The calibration file of imu_calib's node ``apply_calib`` (ROS, and its ports to ROS 2) ------
# Receiver's convention, from its source (``AccelCalib::applyCalib``, repository
# dpkoch/imu_calib)::
#
#     corrected linear_acceleration = SM * raw - bias      [m/s^2], SM row by row
#
# The gyros have no place in the file: the node takes the mean of the first samples, at rest, as
# their bias. The ports to ROS 2 read the same keys.

ROS2_CAN = ("accel.bias", "accel.scale", "accel.misalignment")


def ros2_text(wanted: Request) -> str:
    """Write the file."""
    SM = inverse(wanted.model.accel_matrix)
    return "\n".join(
        [
            commented(wanted.statement(), "#"),
            "#",
            "# For imu_calib, node apply_calib, parameter calib_file:",
            "# corrected = SM * raw - bias [m/s^2], SM row by row; its bias is not the sensor's",
            "# bias b but SM * b. The node measures the bias of the gyros itself when it starts",
            "# (parameter calibrate_gyros): keep the instrument at rest then.",
            f"SM: [{row(SM.ravel())}]",
            f"bias: [{row(SM @ wanted.model.accel_bias)}]",
            "",
        ]
    )


WRITERS = {
    "csv": (FAMILIES, csv_text),
    "json": (FAMILIES, json_text),
    "kalibr": (KALIBR_CAN, kalibr_text),
    "imucal": (IMUCAL_CAN, imucal_text),
    "px4": (PX4_CAN, px4_text),
    "ros2": (ROS2_CAN, ros2_text),
}
"""Receiver -> the families it can express, and what writes its file."""
AT_TEMPERATURES = {"json": json_text}
"""The same of receivers that take coefficients which change with temperature."""
