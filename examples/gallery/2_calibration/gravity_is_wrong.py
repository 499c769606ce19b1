"""
What no check can see
=====================

Gravity that is too large by 300 ppm looks like three accelerometers that read too little by
300 ppm: every check passes, and the scale factors are wrong together. Only the place can tell.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
noise = foucault.grade("tactical").noise
model = draw_errors("tactical", 4)
made = hand_rotated.simulate(
    hand_rotated.Session(rests=20, rest_time=4.0, rate=50.0),
    model=model,
    noise=noise,
    site=site,
    seed=1,
)
for height, place in ((60.0, "right height"), (1060.0, "1 km too high")):
    found = hand_rotated.calibrate(
        made.log, site=foucault.Site.at(np.radians(48.8), height), noise=noise
    )
    c = found.coefficients["accel.scale"]
    off = c.values - model.coefficients(c.names).values
    plt.errorbar(
        ["x", "y", "z"],
        1e6 * off,
        yerr=2e6 * c.sd,
        fmt="o",
        capsize=5,
        label=f"{place}: {found.verdict.level}",
    )
plt.axhline(0, color="k", lw=1)
plt.ylabel("error of the scale factor, ± 2 sd [ppm]")
plt.xlabel("accelerometer")
plt.legend()
plt.show()
