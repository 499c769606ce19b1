"""
Three grades of gyros
=====================

What the names of grades stand for in simulations: white noise falls with the averaging time, and
what is left is bias instability.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.diagnose.allan import deviations
from foucault.models.noise import GRADES
from foucault.simulate.noise import draw_noise

time = np.arange(0, 3600, 0.05)
for name in GRADES:
    noise = foucault.grade(name).noise.gyro
    rate = draw_noise(noise, time, np.random.default_rng(2))[:, 0]
    tau, deviation = deviations(rate, 0.05)
    plt.loglog(tau, np.degrees(deviation) * 3600, label=name)
plt.xlabel("averaging time [s]")
plt.ylabel("Allan deviation [deg/h]")
plt.legend()
plt.show()
