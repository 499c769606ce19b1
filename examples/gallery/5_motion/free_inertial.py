"""
How far does it drift?
======================

The spread of position of a navigator at rest for two hours, by its own covariance: biases of the
gyros and accelerometers, drawn as a navigation-grade instrument has them.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import spread, start_cov
from foucault.navigate.strapdown import State

L, n = np.radians(45.0), 7200
w = EARTH_RATE * np.array([0.0, np.cos(L), np.sin(L)])
log = Increments.of(
    np.arange(n + 1.0), np.tile(w, (n + 1, 1)), np.tile([0.0, 0.0, gravity(L)], (n + 1, 1))
)
state = State.at_rest(np.eye(3), L, 0.0, 0.0)
rows = np.arange(60, n + 1, 60)
DEG_H, UG = np.radians(1 / 3600), 9.80665e-6
for label, gyro, accel in (
    ("gyro bias 0.01 deg/h", 0.01, 1e-3),
    ("accelerometer bias 30 ug", 1e-6, 30.0),
):
    sd = np.repeat([gyro * DEG_H, accel * UG], 3)
    P0 = start_cov(np.diag([1e-12] * 3), 1e-6, 1e-6, sd)
    cov = spread(
        log, state, Sensors.of(("gyro.bias", "accel.bias")), rows, P0, ImuNoise(), held=True
    )
    plt.plot(rows / 60, np.sqrt(cov[:, 6, 6] + cov[:, 7, 7]), label=label)
plt.xlabel("time [min]")
plt.ylabel("sd of the position [m]")
plt.legend()
plt.show()
