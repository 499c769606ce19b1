"""Do dithered gyros bend under specific force? Choose the model, calibrate, and turn with it."""

# %% A session on a table whose angles nobody knows, with turns about axes that stand askew
import numpy as np

import foucault
from foucault.navigate.align import align
from foucault.navigate.increments import increments_of
from foucault.navigate.state import State
from foucault.navigate.strapdown import navigate
from foucault.plans.systematic_sequences import navigation_test
from foucault.procedures import systematic
from foucault.simulate.systematic import simulate_systematic

site = foucault.Site.at(np.radians(39.8), 50.0)
noise = foucault.grade("navigation").noise
settings = systematic.Settings(sequence=["19 positions", "spins, simple 6"], deflection="choose")
simulation = systematic.simulate(
    systematic.Session(rest_time=60.0),
    settings=settings,
    model=systematic.draw_errors("navigation", seed=3),
    noise=noise,
    site=site,
    seed=3,
)

# %% Calibrate: nothing but the log and the place; which model is found by likelihood
result = systematic.calibrate(simulation.log, site=site, settings=settings)
print(result.verdict.level)
print(result.diagnostics["choice"]["verdict"])
print(result.coefficients)

# %% The same instrument: ten turns about north at 18 deg/s, then 500 s of rest
test = simulate_systematic(
    navigation_test("north"), site=site, model=simulation.model, noise=noise, rate=50.0, seed=4
)
for name, log in (("before", test.log), ("after", result.apply(test.log))):
    increments = increments_of(log)
    start = align(increments, site, end=300.0)
    state = State.at_rest(start.C_nb, site.latitude, 0.0, site.height)
    run = navigate(increments, state, first=increments.row_at(300.0), vertical="held")
    print(f"{name}: {np.hypot(*run.velocity_n[-1, :2]):.3f} m/s after 500 s at rest")
