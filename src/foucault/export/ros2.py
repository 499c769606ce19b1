"""The calibration file of imu_calib's node ``apply_calib`` (ROS, and its ports to ROS 2).

Receiver's convention, from its source (``AccelCalib::applyCalib``, repository
dpkoch/imu_calib)::

    corrected linear_acceleration = SM * raw - bias      [m/s^2], SM row by row

The gyros have no place in the file: the node takes the mean of the first samples, at rest, as
their bias. The ports to ROS 2 read the same keys.
"""

from __future__ import annotations

from foucault.escape import commented
from foucault.export.numbers import inverse, row
from foucault.export.request import Request

CAN = ("accel.bias", "accel.scale", "accel.misalignment")


def text(wanted: Request) -> str:
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
