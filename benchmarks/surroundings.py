"""What surrounds the kernels: reading, states as a user wants them, Allan deviations; see `run`.

Each is timed in turn with the least that has to be done for it, the limit, and with a peer that
does less or other work where the row says so: medians of the processor time of several rounds,
one after the other, so that what else runs on the machine falls on all of them.

Run these alone: python benchmarks/run.py surroundings
"""

from __future__ import annotations

IN_TURN = """
import json, time
import numpy as np
def in_turn(*functions, rounds=7):
    spent = [[] for _ in functions]
    for function in functions:
        function()
    for _ in range(rounds):
        for function, times in zip(functions, spent):
            start = time.process_time()
            function()
            times.append(time.process_time() - start)
    return [float(np.median(times)) for times in spent]
"""

# Limit: Arrow's parse or decoding, and the SHA-256 that a result names its log by.
READ = (
    IN_TURN
    + """
import hashlib, tempfile
from pathlib import Path
import pandas as pd
import pyarrow.parquet as pq
from pyarrow import csv
from foucault.logs import LogDescription, read, write
from foucault.tables import Log
rng = np.random.default_rng(0)
n = 1_000_000
log = Log(np.arange(n) / 100, rng.normal(size=(n, 3)), rng.normal(0, 0.1, (n, 3)) + [0, 0, 9.81])
def digest(path):
    with path.open("rb") as stream:
        hashlib.file_digest(stream, "sha256")
with tempfile.TemporaryDirectory() as folder:
    text, table = (Path(folder) / f"log.{suffix}" for suffix in ("csv", "parquet"))
    for path in (text, table):
        write(log, path)
    def ours(path):
        return lambda: read(LogDescription(file=path.name), Path(folder))
    def parsed():
        csv.read_csv(text, csv.ReadOptions(skip_rows=1)), digest(text)
    def decoded():
        pq.read_table(table, use_threads=False), digest(table)
    out = [in_turn(ours(text), parsed, lambda: pd.read_csv(text, comment="#")),
           in_turn(ours(table), decoded)]
print(json.dumps(out))
"""
)

# Limit: the kernels alone, into arrays that are used again.
STATES = (
    IN_TURN
    + """
from foucault.kernels.local_level import local_level
from foucault.models.earth import earth_rate_n, gravity_n
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State, navigate
rate, latitude, n = 100.0, 0.8, 1_000_000
t = np.arange(n) / rate
w = 0.05 * np.cos(np.outer(t, [1.1, 0.7, 1.9])) + earth_rate_n(latitude)
f = 0.3 * np.sin(np.outer(t, [0.9, 1.3, 2.1])) - gravity_n(latitude)
increments = Increments.of(t, w / rate, f / rate)
state = State.at_rest(np.eye(3), latitude)
def geodetic():
    way = navigate(increments, state)
    return way.latitude, way.longitude, way.velocity_n, way.angles
x = navigate(increments, state).history
room = [np.empty((n, *shape)) for shape in ((2,), (3,), (3,))]
none = np.empty((0, 3, 3))
def turned():
    local_level(x, room[0], room[1], none, none, room[2])
print(json.dumps([v / n for v in in_turn(lambda: navigate(increments, state), geodetic, turned)]))
"""
)

# Limit: the sums alone, of a phase that is there already.
ALLAN = (
    IN_TURN
    + """
from foucault.diagnose.allan import deviations, octaves
from foucault.kernels import allan
rate = np.random.default_rng(1).standard_normal(1_000_000)
m, phase = octaves(len(rate)), np.empty(1_000_001)
allan.integrate(rate, 0.0, phase)
runs = [lambda: deviations(rate, 1.0, m, "overlapping"), lambda: allan.overlapping(phase, m)]
try:
    import allantools
    runs.append(lambda: allantools.oadev(rate, rate=1.0, data_type="freq", taus=m.astype(float)))
except ImportError:
    pass
print(json.dumps((in_turn(*runs) + [None])[:3]))
"""
)

# One file of means to a judged table and its page; limit: the two batches of the kernel.
FLEET = """
import json, tempfile, time
from pathlib import Path
import numpy as np
from foucault import campaign, run_folder
from foucault.campaign import fleet
from foucault.cli.screen import written
from foucault.estimate.fleet import calibrate_batch
n = 20_000
described = campaign.parse(campaign.template("norm_observation").replace(
    'solution = "likelihood"', 'solution = "linear"'))
with tempfile.TemporaryDirectory() as folder:
    file = fleet.save_simulated(described, fleet.simulated(described, n), folder + "/bench")
    few = fleet.simulated(described, 20)
    fleet.run(campaign.load(fleet.save_simulated(described, few, folder + "/few")),
              folder + "/warm", table_only=True)
    start = time.process_time()
    table = fleet.run(campaign.load(file), folder + "/out", table_only=True)
    written(Path(folder + "/out"), "fleet", table, run_folder.about_of(folder + "/out", "fleet"))
    spent = time.process_time() - start
assert table.counts()["broken"] == 0
x, one = np.random.default_rng(1).normal(size=(n, 12, 3)), np.ones(12)
start = time.process_time()
for _ in range(2):
    calibrate_batch(x, one, x, one, x, one, one, 9.8, True)
print(json.dumps([spent / n, (time.process_time() - start) / n]))
"""
