"""The benchmarks of the search for plans, as code for processes of their own; see `run`.

Run these alone: python benchmarks/plans.py
"""

from __future__ import annotations

SPACE = """
import json, tempfile, time
from dataclasses import replace
from pathlib import Path
import numpy as np
from foucault import campaign
from foucault.campaign import optimisation
head, _, tail = campaign.template("platform_tumble").partition("[procedure]\\n")
text = head + '[procedure]\\nrate_limit = "0.2 deg/s"\\n' + tail
text = text.replace('# rate_limit = "0.2 deg/s"\\n', "")
asked = campaign.parse(text)
# Latitude and gravity known for sure: what is compared then is the bound.
asked = replace(asked, settings=asked.settings.model_copy(update={"latitude_sd": 0.0}),
                site=replace(asked.site, gravity_sd=0.0))
"""

# A plan of 5400 s in 360 steps of 15 s.
BOUND = (
    SPACE
    + """
space = optimisation.space_of(asked)
rng = np.random.default_rng(0)
# Where three axes may turn together, a slot is half as long; the same turns about one of them.
fine = replace(space, allowed=replace(space.allowed, together=True))
alone = np.flatnonzero((fine.allowed.turns != 0).sum(axis=1) == 1)
assert (fine.allowed.turns[alone] == space.allowed.turns).all()
assert (space.allowed.slot, fine.allowed.slot) == (30.0, 15.0)
turns = rng.integers(0, 6, 12).tolist()
steps = tuple((int(alone[t]), 30) for t in turns)
ratio = fine.bound(steps) / space.bound(tuple((t, 15) for t in turns))
assert abs(np.log(ratio)).max() < 0.2
def best(function, rounds=300):
    out = 1e9
    for _ in range(rounds):
        start = time.thread_time()
        function()
        out = min(out, time.thread_time() - start)
    return out
plan = space.draw(rng)
print(json.dumps([best(lambda: fine.bound(steps)), best(lambda: space.cost(plan))]))
"""
)

# What any covariance filter of 45 states must compute for the same bound, its matrices being given.
DENSE = """
import json, time
import numpy as np
n, rng = 45, np.random.default_rng(0)
Phi = np.eye(n)
Phi[:3] += 1e-5 * rng.standard_normal((3, n))
H, R, Q = rng.standard_normal((3, n)), np.eye(3), 1e-6 * np.eye(n)
def bound(steps=360):
    P = np.eye(n)
    for _ in range(steps):
        P = Phi @ P @ Phi.T + Q
        PH = P @ H.T
        P = P - np.linalg.solve(H @ PH + R, PH.T).T @ PH.T
    return np.sqrt(np.diag(P))
best = 1e9
for _ in range(20):
    start = time.thread_time()
    bound()
    best = min(best, time.thread_time() - start)
print(json.dumps(best))
"""

SEARCH = (
    SPACE
    + """
with tempfile.TemporaryDirectory() as folder:
    optimisation.run(asked, Path(folder) / "warm", restarts=2, evaluations=40)
    start = time.perf_counter()
    found = optimisation.run(asked, Path(folder) / "search", workers=2)
    took = time.perf_counter() - start
print(json.dumps([took, found.evaluations, found.geometric_mean[0]]))
"""
)

if __name__ == "__main__":
    from run import plan_rows

    for row in plan_rows():
        print(row.markdown())
