"""A node of ROS 2 that corrects the readings of an IMU as they come.

    python3 ros2_imu_node.py --ros-args -p run:=path/to/run -r imu/raw:=/imu/data

It needs rclpy, sensor_msgs and foucault, and is one file: copy it into a package of yours. It
subscribes to `imu/raw` and publishes `imu/corrected`, `sensor_msgs/Imu` both. Specific force and
angular rate are corrected, in axes forward-left-up (parameter `axes` says otherwise); stamps,
covariances and orientation stay as they are. An orientation that a driver made of raw readings is
no better for it. A result that is unusable, or that changes with temperature, which messages do not
hold, is refused.
"""

from __future__ import annotations

from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu

import foucault
from foucault.export.stream import BODY, Corrector


class ImuCorrection(Node):
    """Correct every message of one topic and publish it on another."""

    def __init__(self) -> None:
        super().__init__("imu_correction")
        run = self.declare_parameter("run", "run").value
        axes = self.declare_parameter("axes", BODY).value
        self._correct = Corrector(foucault.load_result(run), axes)
        self._out = self.create_publisher(Imu, "imu/corrected", qos_profile_sensor_data)
        self.create_subscription(Imu, "imu/raw", self._received, qos_profile_sensor_data)

    def _received(self, message: Any) -> None:
        self._out.publish(self._correct.message(message))


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    node = ImuCorrection()
    try:
        rclpy.spin(node)
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
