"""The benchmarks of north seeking, as code for processes of their own; see `run`.

Run these alone: python benchmarks/north_seeking.py
"""

from __future__ import annotations

# A million set-ups of four stops, from the readings to heading, pitch, roll, latitude and their sd.
SETUPS = """
import json, time
import numpy as np
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.north_seeker import earth_rate_b, up_b
n = COUNT
rng = np.random.default_rng(1)
latitude = np.radians(45.0)
heading = rng.uniform(0, 2 * np.pi, n)
pitch, roll = np.radians(rng.uniform(-10, 10, (2, n)))
w, u = earth_rate_b(heading, pitch, roll, np.full(n, latitude)), up_b(pitch, roll)
rate_sd, up_sd = np.radians(0.01 / 3600), 30e-6
stops = np.stack([w[:, 1], -w[:, 1], w[:, 0], -w[:, 0]], 1)
stops += 3e-6 + rate_sd * rng.standard_normal((n, 4))
lean = np.stack([u[:, 1], -u[:, 1], u[:, 0], -u[:, 0]], 1)
lean += 1e-3 + up_sd * rng.standard_normal((n, 4))
def best(function, rounds=9, clock=time.perf_counter):
    out = 1e9
    for _ in range(rounds):
        start = clock()
        function()
        out = min(out, clock() - start)
    return out
"""

CLOSED_FORM = (
    SETUPS.replace("COUNT", "1_000_000")
    + """
from foucault.estimate.north import closed_form
rate, up = np.empty((n, 2)), np.empty((n, 2))
def solve(threads, known=latitude):
    for out, four in ((rate, stops), (up, lean)):
        np.subtract(four[:, 2], four[:, 3], out=out[:, 0])
        np.subtract(four[:, 0], four[:, 1], out=out[:, 1])
        out *= 0.5
    root = np.sqrt(2.0)
    return closed_form(rate, up, latitude=known, rate_sd=rate_sd / root, up_sd=up_sd / root,
                       threads=threads)
angles, sd, status = solve(2)
miss = (angles[:, 0] - heading + np.pi) % (2 * np.pi) - np.pi
assert abs(np.std(miss / sd[:, 0]) - 1) < 0.01 and not status.any()
clocks = {1: time.process_time, 2: time.perf_counter}
out = {f"{t} {k}": best(lambda: solve(t, v), clock=clocks[t]) / n
       for t in (1, 2) for k, v in (("known", latitude), ("unknown", None))}
# Limit: the kernel alone, into arrays that are used again.
from foucault.kernels.north_seeking import closed_form_batch
few = 65_536
x, y, angles, sd = (a[:few].ravel() for a in (rate, up, angles, sd))
def kernel():
    closed_form_batch(x, y, latitude, 1.0, EARTH_RATE, rate_sd**2 / 2, up_sd**2 / 2, 0.0,
                      angles, sd, status[:few])
out["kernel"] = best(kernel, clock=time.process_time) / few
print(json.dumps(out))
"""
)

# The same closed form as one would write it in NumPy, without standard deviations.
NUMPY = (
    SETUPS.replace("COUNT", "1_000_000")
    + """
def solve():
    N, M = ((stops[:, k] - stops[:, k + 1]) / 2 / EARTH_RATE for k in (2, 0))
    st, x = (lean[:, 0] - lean[:, 1]) / 2, (lean[:, 2] - lean[:, 3]) / 2
    ct = np.sqrt(1 - st**2)
    sg = -x / ct
    cg = np.sqrt(1 - sg**2)
    W = (np.sin(latitude) + sg * ct * N - st * M) / (cg * ct)
    X, Y = cg * N + sg * W, ct * M - st * (cg * W - sg * N)
    return np.arctan2(-X, Y) % (2 * np.pi), np.arcsin(st), np.arcsin(sg)
miss = (solve()[0] - heading + np.pi) % (2 * np.pi) - np.pi
assert np.abs(miss).max() < 0.01
print(json.dumps(best(solve, clock=time.process_time) / n))
"""
)

LIKELIHOOD = (
    SETUPS.replace("COUNT", "20_000")
    + """
from foucault.estimate.north_reduction import Pairs
from foucault.estimate.north import Known, solve
g = 9.81
values = np.stack([(stops[:, 2] - stops[:, 3]) / 2, (stops[:, 0] - stops[:, 1]) / 2,
                   (lean[:, 2] - lean[:, 3]) / 2 * g, (lean[:, 0] - lean[:, 1]) / 2 * g], 1)
cov = np.diag([rate_sd**2 / 2] * 2 + [(g * up_sd) ** 2 / 2] * 2)
cov = np.broadcast_to(cov, (n, 4, 4)).copy()
none = np.zeros(n)
pairs = Pairs(values, {"gyro noise": cov}, none, none, np.zeros((n, 4)), none, none, none,
              np.zeros((n, 2)), np.zeros((n, 2), int))
known = Known(g, latitude)
miss = (solve(pairs, known).angles[:, 0] - heading + np.pi) % (2 * np.pi) - np.pi
assert np.abs(miss).max() < 0.01
print(json.dumps([best(lambda: solve(pairs, known), clock=time.process_time) / n,
                  best(lambda: solve(pairs, Known(g)), clock=time.process_time) / n]))
"""
)

# The command over a file of all of them, one set-up in 500 with a disturbed reading; with its page.
COMMAND = (
    SETUPS.replace("COUNT", "1_000_000")
    + """
import os, subprocess, sys, tempfile
from pathlib import Path
import pyarrow as pa
from pyarrow import parquet
gyro = stops + np.where(rng.random(n) < 1 / 500, 20 * rate_sd, 0.0)[:, None] * [0, 0, 1, 0]
table = {"setup": np.repeat(np.char.add("M", np.arange(n).astype(str)), 4),
         "time (s)": (400.0 * np.arange(n)[:, None] + 80.0 * np.arange(4)).ravel(),
         "dwell (s)": np.full(4 * n, 60.0), "index (deg)": np.tile([0.0, 180.0, 90.0, 270.0], n),
         "gyro (deg/h)": 3600 * np.degrees(gyro.ravel()), "specific force (g)": lean.ravel()}
with tempfile.TemporaryDirectory() as folder:
    parquet.write_table(pa.table(table), Path(folder) / "readings.parquet")
    words = [sys.executable, "-m", "foucault", "-q", "north", f"{folder}/readings.parquet",
             "--latitude", "45 deg", "--gyro-noise", "0.0013 deg/sqrt(h)", "--accel-noise",
             "232 ug/sqrt(Hz)", "-o", f"{folder}/out"]
    out = []
    for _ in range(3):
        before, start = os.times(), time.perf_counter()
        assert subprocess.run(words, stdout=subprocess.DEVNULL).returncode == 3  # some doubtful
        wall, after = time.perf_counter() - start, os.times()
        used = after.children_user + after.children_system
        out.append((wall, used - before.children_user - before.children_system))
    found = parquet.read_table(Path(folder) / "out" / "fixes.parquet", columns=["heading",
                                                                               "heading_sd"])
    miss = (np.asarray(found["heading"]) - heading + np.pi) % (2 * np.pi) - np.pi
    assert 0.5 < np.median(np.abs(miss) / np.asarray(found["heading_sd"])) / 0.6745 < 1.05
print(json.dumps(min(out)))
"""
)

# The likelihood of one set-up over its eight readings, as one would write it with SciPy.
SCIPY = (
    SETUPS.replace("COUNT", "50")
    + """
from scipy.optimize import least_squares
def model(p):
    f, t, r = (np.array([v]) for v in p[:3])
    w = earth_rate_b(f, t, r, np.array([latitude]))[0]
    u = up_b(t, r)[0]
    gyro = np.array([w[1], -w[1], w[0], -w[0]]) + p[3] * 1e-6
    tilt = np.array([u[1], -u[1], u[0], -u[0]]) + p[4]
    return gyro, tilt
def one(i):
    def left(p):
        gyro, tilt = model(p)
        return np.concatenate([(stops[i] - gyro) / rate_sd, (lean[i] - tilt) / up_sd])
    return least_squares(left, [heading[i] + 0.01, 0.0, 0.0, 0.0, 0.0], method="lm").x
assert abs(one(0)[0] - heading[0]) < 0.01
start = time.process_time()
for i in range(n):
    one(i)
print(json.dumps((time.process_time() - start) / n))
"""
)

CALIBRATION = """
import json, time
import numpy as np
from foucault.estimate.north import calibrate_batch
from foucault.models.earth import EARTH_RATE
n, latitude = 100_000, np.radians(29.5)
heading = np.radians(np.arange(12) * 30.0)
rng = np.random.default_rng(1)
w = EARTH_RATE * np.cos(latitude)
x, y = -w * np.sin(heading), w * np.cos(heading)
stops = np.stack([y, -y, x, -x], 1) + 5e-8 * rng.standard_normal((n, 12, 4))
values, cov = calibrate_batch(stops, heading, latitude, 5e-8)
assert abs((values / np.sqrt(np.diag(cov))).std() - 1) < 0.01
best = 1e9
for _ in range(7):
    start = time.process_time()
    calibrate_batch(stops, heading, latitude, 5e-8)
    best = min(best, time.process_time() - start)
print(json.dumps(best / n))
"""


def main() -> None:
    from run import measure

    cases = {
        "closed form with sd, per set-up [s], threads and latitude": CLOSED_FORM,
        "the same in NumPy, no sd, latitude known [s]": NUMPY,
        "likelihood, latitude known and unknown, CPU [s]": LIKELIHOOD,
        "likelihood in SciPy, one set-up, CPU [s]": SCIPY,
        "calibration, 12 headings, per instrument, CPU [s]": CALIBRATION,
    }
    for name, code in cases.items():
        print(name, measure(code))


if __name__ == "__main__":
    main()
