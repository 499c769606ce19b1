"""
Specific force at rest, before and after
========================================

At rest an accelerometer reads gravity whichever way it lies. The reading of an uncalibrated IMU
depends on how it lies; after the calibration it does not.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
made = hand_rotated.simulate(
    hand_rotated.Session(rests=20, rest_time=4.0, rate=50.0),
    model=draw_errors("mems", 4),
    noise=foucault.grade("mems").noise,
    site=site,
    seed=1,
)
result = hand_rotated.calibrate(made.log, site=site)

rests = result.tables["rests"]
plt.axhline(site.gravity, color="k", lw=1, label="gravity")
plt.plot(rests["norm_before"], "o", label="before")
plt.plot(rests["norm_after"], "o", label="after")
plt.xlabel("rest")
plt.ylabel("norm of specific force [m/s²]")
plt.title(f"verdict: {result.verdict.level}")
plt.legend()
plt.show()
