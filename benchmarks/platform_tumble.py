"""The benchmarks of the platform tumble, as code for processes of their own; see `run`.

Run these alone: python benchmarks/platform_tumble.py
"""

from __future__ import annotations

# The published tumble: 5400 s at 5 Hz, 27,000 intervals, errors of the usual size.
SESSION = """
import json, time
import numpy as np
from foucault.estimate import tumble as estimation
from foucault.estimate.tumble_solution import filter_angles
from foucault.estimate.tumble import look
from foucault.models.earth import Site
from foucault.plans import tumble as torquing
from foucault.procedures.platform_tumble.foresight import prior_of, tumble_of
from foucault.procedures.platform_tumble import settings as tumble
from foucault.procedures.platform_tumble import simulate
from foucault.procedures.platform_tumble.settings import Settings, draw_printed
site = Site(9.80665, np.radians(40.0))
settings = Settings(arms=(("5 cm", "0 m", "0 m"), ("0 m", "5 cm", "0 m"), ("0 m", "0 m", "5 cm")))
def make(seed):
    model = draw_printed(seed)
    return simulate(
        tumble.Session(), settings=settings, model=model, noise=tumble.NOISE, site=site, seed=seed
    )
made = make(1)
prior = prior_of(settings, site, {})
def problem(average, made=made):
    chosen = settings.model_copy(update={"average": average})
    return tumble_of(made.log, site, chosen, tumble.NOISE)[0]
truth = estimation.State(made.C_pn[0].T, made.model.packed(site.gravity))
def best(function, rounds=30, clock=time.thread_time):
    out = 1e9
    for _ in range(rounds):
        start = clock()
        function()
        out = min(out, clock() - start)
    return out
"""

PASS = (
    SESSION
    + """
every, averaged = problem(0.0), problem(1.0)
fit = estimation.solve(averaged, prior)
z = (fit.start.constants - truth.constants) / np.sqrt(np.diag(fit.cov))[3:45]
assert z @ z < 80
# Limit: turning the cluster 27,000 times, and the Gram matrix of the white rows.
from foucault.kernels.cluster_motion import integrate_exponential
n, rng = len(every.dt), np.random.default_rng(0)
C_pn, still, step = np.empty((n + 1, 3, 3)), np.zeros((n, 3)), float(every.dt[0])
C_pn[0] = truth.C_np.T
def turned():
    integrate_exponential(truth.constants, C_pn, every.command, still, every.w_ie_n, step)
white = [rng.standard_normal((3 * blocks, 48)) for blocks in (n, n // 5)]
grams = [best(lambda: w.T @ w) for w in white]
print(json.dumps([best(lambda: look(t, prior, truth)) for t in (every, averaged)]
                 + [best(lambda: filter_angles(every, prior, moments=2), 8),
                    best(lambda: estimation.solve(averaged, prior), 10)]
                 + [best(turned) + gram for gram in grams]))
"""
)

# What any filter of 45 states that carries its covariance must compute, its matrices being given:
# no model is evaluated, which flatters it.
DENSE = (
    SESSION
    + """
n, rng = 45, np.random.default_rng(0)
Phi = np.eye(n)
Phi[:3] += 1e-5 * rng.standard_normal((3, n))
H, R, Q = rng.standard_normal((3, n)), np.eye(3), np.zeros((n, n))
Q[:3, :3] = 1e-6 * np.eye(3)
z = rng.standard_normal((27_000, 3))
def numpy_filter(steps):
    x, P = np.zeros(n), np.eye(n)
    for k in range(steps):
        x, P = Phi @ x, Phi @ P @ Phi.T + Q
        PH = P @ H.T
        K = np.linalg.solve(H @ PH + R, PH.T).T
        x = x + K @ (z[k] - H @ x)
        P = P - K @ PH.T
    return P
steps = 3_000
print(json.dumps(best(lambda: numpy_filter(steps), 3) * 27_000 / steps))
"""
)

FILTERPY = DENSE.replace(
    "def numpy_filter(steps):",
    """from filterpy.kalman import KalmanFilter
def numpy_filter(steps):
    filter = KalmanFilter(dim_x=n, dim_z=3)
    filter.F, filter.H, filter.R, filter.Q = Phi, H, R, Q
    for k in range(steps):
        filter.predict()
        filter.update(z[k])
    return filter.P
def unused(steps):""",
)

STUDY = (
    SESSION
    + """
from concurrent.futures import ThreadPoolExecutor
def trial(seed):
    one = make(seed)
    return estimation.solve(problem(1.0, one), prior).status
trial(0)
start = time.perf_counter()
with ThreadPoolExecutor(2) as pool:
    status = list(pool.map(trial, range(500)))
took = time.perf_counter() - start
assert all(s == "converged" for s in status)
print(json.dumps(took))
"""
)

COMMAND = """
import json, tempfile, time
from pathlib import Path
from foucault import campaign
from foucault.campaign import study
text = campaign.template("platform_tumble")
with tempfile.TemporaryDirectory() as folder:
    asked = campaign.parse(text, Path(folder) / "campaign.toml")
    study.run(asked, 2, Path(folder) / "warm", workers=2)
    start = time.perf_counter()
    study.run(asked, 500, Path(folder) / "study", workers=2)
    print(json.dumps(time.perf_counter() - start))
"""

if __name__ == "__main__":
    from run import tumble_rows

    for row in tumble_rows():
        print(row.markdown())
