"""
North near the pole
===================

North is where the horizontal part of the Earth's rate points. Near the pole there is little of
it, and the heading of the same gyro gets worse as one over the cosine of the latitude.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.models.earth import EARTH_RATE

latitude = np.linspace(0, 88, 89)
for bias in (0.001, 0.01, 0.1):
    heading = np.radians(bias / 3600) / (EARTH_RATE * np.cos(np.radians(latitude)))
    plt.semilogy(latitude, np.degrees(heading) * 60, label=f"{bias:g} deg/h")
plt.xlabel("latitude [deg]")
plt.ylabel("error of the heading [arcmin]")
plt.legend(title="error of the east gyro")
plt.show()
