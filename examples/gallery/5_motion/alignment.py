"""
Alignment at rest
=================

Level is found at once, north takes minutes. What is left after a long rest is the bias of the
east gyro: no time helps against it.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.navigate.align import align
from foucault.plans.manoeuvres import Rest, Start

site = foucault.Site.at(np.radians(47.0), 430.0)
start = Start(np.radians(47.0), 0.15, 430.0, heading=np.radians(35.0))
noise = foucault.grade("navigation").noise
log = foucault.simulate_motion([Rest(600.0)], start, noise=noise, rate=50.0, seed=2).log
bias = foucault.parse_unit("0.02 deg/h", "angular rate")

times = (20, 40, 80, 150, 300, 600)
for label, sd in (("gyro without bias", 0.0), ("bias of 0.02 deg/h (sd)", bias)):
    heading = [
        align(log, site, start=0.0, end=t, noise=noise, gyro_bias_sd=sd).cov[2, 2] ** 0.5
        for t in times
    ]
    plt.loglog(times, np.degrees(heading) * 60, "o-", label=label)
plt.xticks(times, times)
plt.yticks([2, 5, 10, 20], ["2", "5", "10", "20"])
plt.minorticks_off()
plt.xlabel("rest [s]")
plt.ylabel("sd of the heading [arcmin]")
plt.legend()
plt.show()
