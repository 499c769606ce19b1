"""
A drive, and what navigation makes of it
========================================

The same drive by an instrument as it comes and by one that was calibrated to a tenth of its
errors. Nothing else corrects them.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.models.earth import displacement
from foucault.navigate.strapdown import navigate
from foucault.plans.manoeuvres import Accelerate, Rest, Start, Straight, Turn

start = Start(np.radians(47.0), 0.15, 430.0, heading=np.radians(35.0))
block = [Straight(60.0), Turn(np.pi / 2, 20.0, banked=False)]
drive = [Rest(30.0), Accelerate(15.0, 10.0), *block, *block, *block, Straight(60.0)]
bias = np.array([2.0, -1.0, 1.5]) * np.radians(1 / 3600)


def path(model: foucault.ImuModel) -> np.ndarray:
    """Return the way that is navigated from the true start, north and east [m]."""
    run = foucault.simulate_motion(drive, start, model=model, rate=100.0)
    way = navigate(foucault.increments_of(run.log), run.truth.state(0))
    place = (start.latitude, start.longitude, start.height)
    return displacement(*place, way.latitude, way.longitude, way.height)


for label, size in (("truth", 0.0), ("calibrated", 0.1), ("as it comes", 1.0)):
    way = path(foucault.ImuModel(gyro_bias=5 * size * bias, accel_bias=np.full(3, 0.005 * size)))
    plt.plot(way[:, 0], way[:, 1], label=label)
plt.axis("equal")
plt.xlabel("east [m]")
plt.ylabel("north [m]")
plt.legend()
plt.show()
