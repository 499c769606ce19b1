"""Parameters of the PX4 autopilot, as ``param set`` lines for its shell.

Receiver's convention, from its source (``src/lib/sensor_calibration``)::

    accelerometer: (data - offset) * scale, axis by axis, then the rotation of the board
    gyro:           data - offset, then the rotation of the board

in m/s^2 and rad/s, with the axes of the board forward-right-down. There is no misalignment, and
no scale factor of the gyros.
"""

from __future__ import annotations

import numpy as np

from foucault.escape import commented
from foucault.export.numbers import number
from foucault.export.request import Request

CAN = ("accel.bias", "accel.scale", "gyro.bias")


def text(wanted: Request) -> str:
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
