"""The benchmarks of strapdown navigation, as code for processes of their own; see `run`.

Run these alone: python benchmarks/strapdown.py
"""

from __future__ import annotations

# An instrument that rocks about its axes; n samples.
ROCKING = """
import json, time
import numpy as np
from foucault.models.earth import earth_rate_n, gravity_n
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State
rate, latitude = 100.0, 0.8
t = np.arange(n) / rate
w = 0.05 * np.cos(np.outer(t, [1.1, 0.7, 1.9])) + earth_rate_n(latitude)
f = 0.3 * np.sin(np.outer(t, [0.9, 1.3, 2.1])) - gravity_n(latitude)
increments = Increments.of(t, w / rate, f / rate)
state = State.at_rest(np.eye(3), latitude)
def best(function, rounds=9):
    function()
    out = 1e9
    for _ in range(rounds):
        start = time.thread_time()
        function()
        out = min(out, time.thread_time() - start)
    return out
"""

# A history of 24 MB stands in memory that is used again; one of 96 MB gets fresh pages every time.
MODERATE, LONG = "n = 250_000\n", "n = 1_000_000\n"

# All states kept: free, held and aided height, and back again.
STRAPDOWN = (
    ROCKING
    + """
from foucault.navigate.strapdown import navigate
end, heights = navigate(increments, state, vertical="held").state(-1), np.zeros(n)
# Limit: the kernel alone, into a history that is used again.
from foucault.kernels.strapdown import FREE, strapdown
room = np.empty((n, 12))
def kernel():
    strapdown(increments.dtheta_b, increments.dvel_b, increments.dt, *increments.bends, 0, n - 1,
              state.packed(), 0.0, FREE, np.zeros(0), np.zeros(3), room)
print(json.dumps([best(run) / n for run in (
    lambda: navigate(increments, state),
    lambda: navigate(increments, state, vertical="held"),
    lambda: navigate(increments, state, vertical="aided", heights=heights),
    lambda: navigate(increments, end, first=n - 1, last=0, vertical="held"),
    kernel,
)]))
"""
)

# Errors of attitude, velocity and position; bias, scale and misalignments of both triads.
FILTER = (
    LONG
    + ROCKING
    + """
from foucault.navigate.ins_filter import Updates, run, start_cov
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
kinds = ("bias", "scale", "misalignment")
sensors = Sensors.of(f"{triad}.{kind}" for triad in ("gyro", "accel") for kind in kinds)
P0 = start_cov(1e-6 * np.eye(3), 0.01, 1.0, np.full(len(sensors), 1e-4))
assert len(P0) == 33
noise = ImuNoise(TriadNoise(white=1e-4), TriadNoise(white=1e-6))
# A base that is not quite at rest: what it does is far within the sd.
updates = Updates.at_rest(np.arange(int(rate), n, int(rate)), velocity_sd=1.0)
print(json.dumps(best(lambda: run(increments, state, sensors, updates, P0, noise), 5) / n))
"""
)

# The steps of the navigation in NumPy, matrices for quaternions: what a loop in Python costs.
NUMPY = (
    MODERATE
    + ROCKING
    + """
import sys
sys.path.insert(0, TESTS)
import reference
from foucault.models.earth import east_north_up
start = state.C_nb, state.velocity_n, east_north_up(latitude, 0.0), 0.0
few, i = 300, increments
print(json.dumps(best(lambda: reference.strapdown_run(
    start, i.dtheta_b, i.dvel_b, i.dt, i.joined, 0, few), 3) / few))
"""
)

if __name__ == "__main__":
    from run import navigation_rows

    for row in navigation_rows():
        print(row.markdown())
