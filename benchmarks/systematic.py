"""The benchmarks of systematic calibration, as code for processes of their own; see `run`.

Run these alone: python benchmarks/systematic.py
"""

from __future__ import annotations

from pathlib import Path

# VALIDATION and DATA are folders; `best` is the smallest CPU time of some runs, compiled.
SETTING = """
import json, sys, time
from pathlib import Path
import numpy as np
sys.path.insert(0, VALIDATION)
def best(function, rounds=6):
    function()
    out = 1e9
    for _ in range(rounds):
        start = time.thread_time()
        function()
        out = min(out, time.thread_time() - start)
    return out
"""

# The published session of 92 min at 200 Hz: 39 states over all of it, and the two steps.
BOTH_STEPS = (
    SETTING
    + """
from systematic_setting import FULL, NOISE, PHI_SD, PLAIN, SITE, Session, both_steps, instrument
from systematic_setting import spread_of
from foucault.coefficients import CoefficientVector
from foucault.estimate.systematic import second_step
from foucault.simulate.systematic import simulate_systematic
sd = spread_of(FULL)
truth = sd * np.random.default_rng(1).standard_normal(len(sd))
plan, part = both_steps()
session = Session(simulate_systematic(
    plan, site=SITE, model=instrument(FULL, truth), noise=NOISE, rate=200.0, seed=1))
n, rests = len(session.increments), session.rests
prior = CoefficientVector(FULL.layout, np.zeros(len(sd)), prior_sd=sd)
def published():
    first = session.solve(PLAIN, rests=rests[:part])
    return second_step(session.model(FULL), first, first.estimate, prior)[0]
for found in (session.solve(FULL), published()):
    assert np.all(np.abs(found.estimate.values - truth) < 6 * found.estimate.sd)
print(json.dumps([n, best(lambda: session.solve(FULL)), best(published)]))
"""
)

# The nineteen positions of another program: five passes with lever arms and delay.
THIRD_PARTY = (
    SETTING
    + """
import systematic_third_party as other
log = other.read(other.DESCRIPTION, Path(DATA))
problem = other.problem_of(log, other.SITE, other.SETTINGS, None, {})
print(json.dumps([len(log), 9 + len(problem.sensors), other.five_passes(problem)]))
"""
)


def code(case: str, root: Path, data: Path) -> str:
    """Return the code of a case with its folders."""
    return f"VALIDATION, DATA = {str(root / 'validation')!r}, {str(data)!r}\n{case}"


if __name__ == "__main__":
    from run import systematic_rows

    for row in systematic_rows():
        print(row.markdown())
