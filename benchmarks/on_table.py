"""The benchmarks of turntable calibration, as code for processes of their own; see `run`.

Run these alone: python benchmarks/on_table.py
"""

from __future__ import annotations

from pathlib import Path

PLAN = """
import json, time
import numpy as np
from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.models.turntable import mean_rate
from foucault.plans.directions import table_plan
from foucault.simulate.table import Fleet, Rig, simulate_readings
site = Site.at(np.radians(45.0))
plan = table_plan("icosahedron 12", spin_rate=np.radians(10), rest_time=60.0, turns=5)
rig = Rig(lever_arm=np.array([0.1, -0.05, 0.02]), mounting=np.radians([0.2, -0.1, 0.1]))
s = simulate_readings(
    plan, models=Fleet.draw("tactical", FLEET, 1), noise=grade("tactical").noise, site=site,
    rig=rig, seed=1,
)
spin = plan.rate != 0
h = mean_rate(plan.rate[spin], site.latitude)
rest, f_spin, w_spin = (
    np.ascontiguousarray(x) for x in (s.accel[:, ~spin], s.accel[:, spin], s.gyro[:, spin])
)
"""

BATCH = (
    PLAN.replace("FLEET", "10_000")
    + """
from foucault.kernels.norm_observation import calibrate_batch
rest_var, f_var, w_var = (
    np.ascontiguousarray(x)
    for x in (s.accel_variance[~spin], s.accel_variance[spin], s.gyro_variance[spin])
)
def solve():
    return calibrate_batch(
        rest, rest_var, f_spin, f_var, w_spin, w_var, h, site.gravity, True
    )
assert not solve()[-1].any()
best = 1e9
for _ in range(9):
    start = time.process_time()
    solve()
    best = min(best, time.process_time() - start)
print(json.dumps(best / 10_000))
"""
)

# The same norms as one would write them with SciPy: one instrument, no covariance, no lever arm.
ONE_AT_A_TIME = (
    PLAN.replace("FLEET", "20")
    + """
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
LOWER = np.tril_indices(3)
def triad(readings, norm):
    def split(k):
        L = np.zeros((3, 3))
        L[LOWER] = k[:6]
        return L, k[6:]
    def residuals(k):
        L, b = split(k)
        return np.linalg.norm(np.linalg.solve(L, (readings / norm - b).T), axis=0) - 1
    start = np.concatenate([np.eye(3)[LOWER], np.zeros(3)])
    L, b = split(least_squares(residuals, start, xtol=1e-12, ftol=1e-12, gtol=1e-12).x)
    return L, b * norm
def calibrate(i):
    Ma, ba = triad(rest[i], site.gravity)
    Mg, bg = triad(w_spin[i], float(h.mean()))
    f = (f_spin[i] - ba) @ np.linalg.inv(Ma).T
    u = (w_spin[i] - bg) @ np.linalg.inv(Mg).T
    C_bd, _ = Rotation.align_vectors(f, u)
    return Ma, ba, Mg @ C_bd.as_matrix().T, bg
Ma, ba, Mg, bg = calibrate(0)
assert np.abs(Ma - s.fleet.models.accel_matrix[0, 0]).max() < 1e-4
assert np.abs(Mg - s.fleet.models.gyro_matrix[0, 0]).max() < 1e-3
start = time.process_time()
for i in range(20):
    calibrate(i)
print(json.dumps((time.process_time() - start) / 20))
"""
)

# What a single instrument costs: the command from its start, and the solve within.
COMMAND = """
import json, subprocess, sys, tempfile, time
from pathlib import Path
from foucault.campaign import parse, read_log, simulate, template
from foucault.logs import write
from foucault.procedures import norm_observation, on_table
text = template("norm_observation").replace('rate = "20 Hz"', 'rate = "0.803 Hz"')
campaign = parse(text, "template.toml")
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "campaign.toml"
    file.write_text(text)
    write(simulate(campaign, 1).simulation.log, Path(folder) / "log.csv")
    command = [sys.executable, "-m", "foucault", "-q", "calibrate", str(file)]
    command += ["-o", folder + "/run"]
    whole = 1e9
    for _ in range(4):
        start = time.perf_counter()
        code = subprocess.run(command, capture_output=True).returncode
        assert code in (0, 3), code  # 3: done, and doubtful
        whole = min(whole, time.perf_counter() - start)
    log = read_log(parse(text, str(file)))
    task = norm_observation.task_of(campaign.settings)
    readings = on_table.read_positions(log, task, None)
    spent = []
    def timed(function):
        def call(*arguments):
            start = time.perf_counter()
            out = function(*arguments)
            spent.append(time.perf_counter() - start)
            return out
        return call
    on_table._start, on_table.fit = timed(on_table._start), timed(on_table.fit)
    for _ in range(9):
        on_table.from_readings(readings, task, site=campaign.site)
    solve = min(spent[0::2]) + min(spent[1::2])
print(json.dumps([solve, whole, len(log)]))
"""

# imucal's own example session, with the recipe of each for sections, turns of -360 deg, g 9.81.
FERRARIS = """
import json, time
from pathlib import Path
import numpy as np
from foucault.logs import LogDescription, read
from foucault.models.earth import Site
from foucault.procedures import ferraris
folder = Path(FOLDER)
log = read(LogDescription.model_validate({
    "file": "example_ferraris_session.csv", "rate": "102.4 Hz",
    "accel": {"columns": ["acc_x", "acc_y", "acc_z"], "unit": "m/s^2"},
    "gyro": {"columns": ["gyr_x", "gyr_y", "gyr_z"], "unit": "deg/s"},
}), folder)
rows = json.loads((folder / "example_ferraris_session_list.json").read_text())
sections = {name: (row["start"], row["end"]) for name, row in rows.items()}
settings = ferraris.Settings(solution="published", sections=sections)
def best(function):
    out = 1e9
    for _ in range(7):
        start = time.process_time()
        function()
        out = min(out, time.process_time() - start)
    return out
ours = best(lambda: ferraris.calibrate(log, site=Site(9.81), settings=settings))
try:
    import pandas as pd
    from imucal import FerrarisCalibration, ferraris_regions_from_section_list
    data = pd.DataFrame(
        np.column_stack([log.accel, np.degrees(log.gyro)]),
        columns=["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"],
    )
    def theirs():
        regions = ferraris_regions_from_section_list(
            data, pd.DataFrame(rows).T[["start", "end"]].astype(int)
        )
        return FerrarisCalibration(grav=9.81).compute(
            regions, 102.4, from_acc_unit="m/s^2", from_gyr_unit="deg/s"
        )
    peer = best(theirs)
except ImportError:
    peer = None
print(json.dumps([ours, peer]))
"""


def ferraris_code(data: Path) -> str | None:
    """Return the benchmark of Ferraris' method, None where its log is not at hand."""
    folder = data / "ferraris_session"
    return FERRARIS.replace("FOLDER", repr(str(folder))) if folder.is_dir() else None


if __name__ == "__main__":
    from run import table_rows

    for row in table_rows():
        print(row.markdown())
