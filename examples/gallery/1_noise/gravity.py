"""
Gravity where you are
=====================

An accelerometer is calibrated against the gravity of the place. Half a degree of latitude or 150 m
of height is some 50 ppm of it: that much all scale factors would be wrong.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.models.earth import gravity

latitude, height = np.linspace(-90, 90, 181), np.linspace(0, 3000, 61)
g = gravity(np.radians(latitude)[None, :], height[:, None])
lines = plt.contourf(latitude, height, g, 20, cmap="viridis")
plt.colorbar(lines, label="gravity [m/s²]")
plt.xlabel("latitude [deg]")
plt.ylabel("height [m]")
plt.show()
