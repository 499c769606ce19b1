"""
Rests in a log
==============

An IMU is laid down and turned by hand. Rests are found by the scatter of the readings in short
windows, against a threshold that the log itself gives.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.detect.stretches import find_rests
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
made = hand_rotated.simulate(
    hand_rotated.Session(rests=8, rest_time=4.0, rate=50.0),
    model=draw_errors("mems", 1),
    noise=foucault.grade("mems").noise,
    site=site,
    seed=1,
)
log = made.log
rests = find_rests(log)

time = log.time - log.time[0]
plt.plot(time, log.accel, lw=1, label=["x", "y", "z"])
for first, last in zip(rests.first, rests.last, strict=True):
    plt.axvspan(time[first], time[last], color="0.85", zorder=0)
plt.xlabel("time [s]")
plt.ylabel("specific force [m/s²]")
plt.title(f"{len(rests.first)} rests (grey)")
plt.legend(loc="upper right")
plt.show()
