"""
Scale factor over the rate
==========================

A rate table turns at several rates in both senses. A scale factor that changes with the rate is
seen at once: an asymmetry is a step at zero, a cubic term a parabola.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import rate_table
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
session = rate_table.Session(rows="means")
made = rate_table.simulate(
    session,
    model=draw_errors("tactical", 3),
    noise=foucault.grade("tactical").noise,
    site=site,
    seed=3,
)
result = rate_table.calibrate(made.log, site=site, noise=foucault.grade("tactical").noise)

rates = np.linspace(-100, 100, 401)
for axis in "xyz":
    value = {
        n: result.coefficients[f"gyro.{n}.{axis}"].values[0]
        for n in ("scale", "asymmetry", "cubic")
    }
    w = np.radians(rates)
    error = value["scale"] + value["asymmetry"] * np.sign(w) + value["cubic"] * w**2
    plt.plot(rates, 1e6 * (error - value["scale"]), label=axis)
plt.xlabel("rate [deg/s]")
plt.ylabel("scale factor less its mean [ppm]")
plt.legend()
plt.show()
