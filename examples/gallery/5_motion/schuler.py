"""
A day of Schuler
================

An inertial navigator that starts with a small tilt does not drift away: it swings with a period
of 84 minutes, and the plane of the swing turns with the Earth, as Foucault's pendulum does.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.models.earth import EARTH_RATE, displacement, gravity
from foucault.models.rotation import exp
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State, navigate

L = np.radians(45.0)
n = 24 * 3600
w = EARTH_RATE * np.array([0.0, np.cos(L), np.sin(L)])
f = np.array([0.0, 0.0, gravity(L)])
log = Increments.of(np.arange(n + 1.0), np.tile(w, (n + 1, 1)), np.tile(f, (n + 1, 1)))
tilted = exp(np.array([1e-5, 0.0, 0.0]))
run = navigate(log, State.at_rest(tilted, L, 0.0, 0.0), vertical="held")

east = displacement(L, 0.0, 0.0, run.latitude, run.longitude, run.height)
plt.plot(east[:, 0], east[:, 1], lw=1)
plt.plot(0, 0, "ko")
plt.axis("equal")
plt.xlabel("east [m]")
plt.ylabel("north [m]")
plt.show()
