"""Simulate a hand-rotated session, calibrate it, apply the result to the log."""

# %% A session as a user would record it, and the instrument that made it
import numpy as np

import foucault
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8462), 60.0)
simulation = hand_rotated.simulate(
    hand_rotated.Session(),
    model=draw_errors("mems", seed=4),
    noise=foucault.grade("mems").noise,
    site=site,
    seed=4,
)

# %% Calibrate: nothing but the log and the place
result = hand_rotated.calibrate(simulation.log, site=site)
print(result.verdict.level)
print(result.coefficients)

# %% Compare with the truth, in standard deviations
truth = simulation.model.coefficients(result.coefficients.names)
z = (result.coefficients.values - truth.values) / result.coefficients.sd
print("largest error:", f"{np.abs(z).max():.1f} sd")

# %% Apply: the norm of specific force at rest is gravity again
calibrated = result.apply(simulation.log)
rests = result.tables["rests"]
first = slice(int(rests["first"][0]), int(rests["last"][0]))
for name, log in (("before", simulation.log), ("after", calibrated)):
    norm = np.linalg.norm(log.accel[first].mean(axis=0))
    print(f"{name}: {1e6 * (norm / site.gravity - 1):+.0f} ppm of g")
