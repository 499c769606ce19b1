"""
Is the standard deviation right?
================================

In a simulation the truth is known: the error of each coefficient over its standard deviation.
About two of three lie within one, and hardly any beyond three.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
truth, noise = draw_errors("tactical", 7), foucault.grade("tactical").noise
made = hand_rotated.simulate(
    hand_rotated.Session(rests=20, rest_time=4.0, rate=50.0),
    model=truth,
    noise=noise,
    site=site,
    seed=2,
)
found = hand_rotated.calibrate(made.log, site=site, noise=noise).coefficients
error = (found.values - truth.coefficients(found.names).values) / found.sd

names = np.arange(len(error))
plt.axvspan(-1, 1, color="0.85", zorder=0)
plt.axvline(0, color="k", lw=1)
plt.errorbar(error, names, xerr=1, fmt="o")
plt.yticks(names, found.names, fontsize=8)
plt.xlim(-4, 4)
plt.xlabel("error over standard deviation")
plt.show()
