"""Simulate an instrument, calibrate it on a table, drive with it: what is it worth in metres?

It leaves two logs to try on the command line:

    foucault navigate navigation/parked.csv --calibration navigation/run --serial 0001 \
        --latitude "48.8462 deg" --height "60 m" -o navigation/parked
    foucault navigate navigation/drive.csv --calibration navigation/run --serial 0001 \
        --reference navigation/reference.csv -o navigation/drive
"""

# %% Calibrate a navigation-grade instrument on a three-axis table
from pathlib import Path

import numpy as np

import foucault
from foucault import campaign, run_folder
from foucault.campaign import navigation, navigation_folder
from foucault.plans.manoeuvres import Accelerate, Rest, Start, Straight, Turn
from foucault.procedures.navigation_settings import Settings
from foucault.report import navigation as page
from foucault.simulate.motion import simulate_motion

folder = Path("navigation")
folder.mkdir(exist_ok=True)
text = campaign.template("turntable").replace('grade = "mems"', 'grade = "navigation"')
session = campaign.simulate(campaign.parse(text))
result = campaign.calibrate(campaign.save_session(session, folder / "session"))
run_folder.save(result, folder / "run")
print("calibration:", result.verdict.level)

# %% The same instrument in a parked vehicle, and on a drive with two turns
noise = foucault.grade("navigation").noise
start = Start(np.radians(48.8462), np.radians(2.3464), 60.0, heading=np.radians(40.0))
drive = [Rest(300.0), Accelerate(15.0, 10.0), Straight(120.0)]
drive += [Turn(np.radians(90.0), 20.0, banked=False), Straight(200.0)] * 2
drive += [Accelerate(0.0, 10.0), Rest(30.0)]
runs = {
    name: simulate_motion(
        plan, start, rate=50.0, model=session.simulation.model, noise=noise, seed=seed
    )
    for seed, (name, plan) in enumerate({"drive": drive, "parked": [Rest(1800.0)]}.items(), 1)
}
for name, run in runs.items():
    foucault.write_log(run.log, folder / f"{name}.csv")

# %% A reference for the drive, once a second
truth = runs["drive"].truth
titles = "time (s),latitude (deg),longitude (deg),height (m)"
angles = np.degrees([truth.latitude, truth.longitude])
rows = np.column_stack([truth.time, *angles, truth.height])[::50]
np.savetxt(folder / "reference.csv", rows, "%.9f", ",", header=titles, comments="")

# %% Navigate with and without the calibration
site = {"latitude": start.latitude, "height": start.height}
said = navigation.Said(site, Settings(align=600.0), serial="0001")
parked = navigation.run(folder / "parked.csv", said, calibration=folder / "run")
reference = folder / "reference.csv"
driven = navigation.run(
    folder / "drive.csv",
    navigation.Said(serial="0001"),
    calibration=folder / "run",
    reference=reference,
)
for name, test in (("parked", parked), ("drive", driven)):
    print(f"{name}: {test.verdict.level}")
    for run in test.runs:
        last = run.growth[-1]
        print(f"  {run.name}: {last.horizontal:.0f} m off after {last.age / 60:.0f} min")
    for k in test.budget.ranked(test.budget.worth)[:3]:
        east, north = test.budget.worth[-1, 6:8, k]
        print(f"  {test.budget.names[k]}: {np.hypot(east, north):.0f} m")
    record = navigation_folder.save(test, folder / name)
    page.write(record, folder / name / "report.html")
