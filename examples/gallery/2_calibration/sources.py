"""
Where the uncertainty comes from
================================

Every result says which source of error makes how much of each variance. Here the biases are
limited by noise, the scale factors of the accelerometers by how well gravity is known.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
made = hand_rotated.simulate(
    hand_rotated.Session(rests=20, rest_time=4.0, rate=50.0),
    model=draw_errors("tactical", 4),
    noise=foucault.grade("tactical").noise,
    site=site,
    seed=1,
)
result = hand_rotated.calibrate(made.log, site=site)

names, left = result.coefficients.names, 0.0
parts = {source: np.array(v) for source, v in result.diagnostics["budget"].items()}
total = sum(parts.values())
for source, variance in parts.items():
    if (variance / total).max() > 0.02:
        plt.barh(names, 100 * variance / total, left=left, label=source)
        left = left + 100 * variance / total
plt.gca().invert_yaxis()
plt.tick_params(axis="y", labelsize=8)
plt.xlabel("share of the variance [%]")
plt.figlegend(loc="outside lower center", ncols=3, fontsize=8)
plt.show()
