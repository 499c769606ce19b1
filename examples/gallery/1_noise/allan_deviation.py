"""
Allan deviation of a gyro
=========================

An hour of a gyro at rest. The slope of the deviation tells which noise it is: -1/2 is white noise,
flat is bias instability, +1/2 is a random walk of the rate. The band holds 95 % of what another
hour would show.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.diagnose.allan import measure
from foucault.models.noise import TriadNoise
from foucault.simulate.noise import draw_noise

DEG_H = np.radians(1 / 3600)
noise = TriadNoise(white=np.radians(0.15) / 60, bias_instability=2 * DEG_H, random_walk=1e-7)
time = np.arange(0, 3600, 0.01)
rate = draw_noise(noise, time, np.random.default_rng(1))[:, 0]
gyro = measure(rate, 0.01)

plt.loglog(gyro.tau, gyro.deviation / DEG_H, "o-", label="measured")
plt.fill_between(gyro.tau, gyro.low / DEG_H, gyro.high / DEG_H, alpha=0.25)
plt.loglog(gyro.tau, gyro.curve / DEG_H, "k--", label="noise that fits it")
plt.xlabel("averaging time [s]")
plt.ylabel("Allan deviation [deg/h]")
plt.legend()
plt.show()
