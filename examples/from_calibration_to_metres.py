"""From calibration to metres: what is a calibration worth where somebody navigates with it?

Run it as a script, or cell by cell in an editor that knows `# %%`. It leaves a folder
`from_calibration_to_metres` with two reports, and two logs to try on the command line:

    cd from_calibration_to_metres
    foucault navigate parked.csv --calibration run --serial 0001 --latitude "48.8462 deg" \
        --height "60 m" -o parked
    foucault navigate drive.csv --calibration run --serial 0001 --reference reference.csv -o drive
"""

# %% [markdown]
# ## Calibrate
# A navigation-grade instrument on a three-axis table whose angles are known to some arc-seconds.

# %%
from pathlib import Path

import numpy as np

import foucault
from foucault import campaign, report
from foucault.campaign import navigation
from foucault.campaign.tables import Said
from foucault.navigate.align import align
from foucault.navigate.increments import increments_of
from foucault.navigate.strapdown import State, navigate
from foucault.plans.manoeuvres import Accelerate, Rest, Start, Straight, Turn
from foucault.plans.sequence import navigation_test
from foucault.procedures import systematic
from foucault.procedures.navigation.start import Settings
from foucault.report import navigation as page
from foucault.simulate.motion import simulate_motion
from foucault.simulate.systematic import simulate_systematic

folder = Path("from_calibration_to_metres")
text = campaign.template("turntable").replace('grade = "mems"', 'grade = "navigation"')
session = campaign.simulate(campaign.parse(text))
result = campaign.calibrate(campaign.save_session(session, folder / "session"))
foucault.save_result(result, folder / "run")
print("calibration:", result.verdict.level)

# %% [markdown]
# ## Apply it
# The log of the session itself, before and after: in its first ten seconds, at rest, the norm of
# specific force is gravity.

# %%
site, log = foucault.Site.at(np.radians(48.8462), 60.0), session.simulation.log
first = log.time < log.time[0] + 10.0
for name, some in (("before", log), ("after", result.apply(log))):
    norm = np.linalg.norm(some.accel[first].mean(axis=0))
    print(f"{name}: {1e6 * (norm / site.gravity - 1):+.1f} ppm of g")

# %% [markdown]
# ## Drive with it
# The same instrument in a parked vehicle, and on a drive with two turns beside a satellite
# receiver.

# %%
noise = foucault.grade("navigation").noise
start = Start(site.latitude, np.radians(2.3464), site.height, heading=np.radians(40.0))
drive = [Rest(300.0), Accelerate(15.0, 10.0), Straight(120.0)]
drive += [Turn(np.radians(90.0), 20.0, banked=False), Straight(200.0)] * 2
drive += [Accelerate(0.0, 10.0), Rest(30.0)]
runs = {
    name: simulate_motion(
        plan, start, rate=50.0, model=session.simulation.model, noise=noise, seed=seed
    )
    for seed, (name, plan) in enumerate({"drive": drive, "parked": [Rest(1200.0)]}.items(), 1)
}
for name, run in runs.items():
    foucault.write_log(run.log, folder / f"{name}.csv")
truth = runs["drive"].truth
titles = "time (s),latitude (deg),longitude (deg),height (m)"
angles = np.degrees([truth.latitude, truth.longitude])
rows = np.column_stack([truth.time, *angles, truth.height])[::50]
reference = folder / "reference.csv"
np.savetxt(reference, rows, "%.9f", ",", header=titles, comments="")

# %% [markdown]
# ## The metres
# Navigated with and without the calibration; what every coefficient would have cost; and whether
# the error that is left is as large as its uncertainty says.

# %%
place = {"latitude": start.latitude, "height": start.height}
said = {
    "parked": (Said(**place, serial="0001"), Settings(align=600.0)),
    "drive": (Said(serial="0001"), Settings()),
}
for name, (beside, settings) in said.items():
    against = reference if name == "drive" else None
    test = navigation.run(
        folder / f"{name}.csv", beside, settings, calibration=folder / "run", reference=against
    )
    print(f"{name}: {test.verdict.level}", *test.verdict.reasons)
    for run in test.runs:
        last = run.growth[-1]
        print(f"  {run.name}: {last.horizontal:.0f} m off after {last.age / 60:.0f} min")
    for k in test.budget.ranked(test.budget.worth)[:3]:
        east, north = test.budget.worth[-1, 6:8, k]
        print(f"  {test.budget.names[k]}: {np.hypot(east, north):.0f} m")
    record = navigation.record(test).save(folder / name)
    print("  report:", report.save(page.document(record), folder / name / "report.html"))

# %% [markdown]
# ## When the model is too small
# Laser gyros on dither springs bend under specific force, and a model without it costs metres too.
# Such a one, calibrated on a table whose angles nobody knows; which model of bending the session
# shows is chosen by likelihood.

# %%
settings = systematic.Settings(sequence=["19 positions", "spins, simple 6"], deflection="choose")
bent = systematic.simulate(
    systematic.Session(rest_time=60.0),
    settings=settings,
    model=systematic.draw_errors("navigation", seed=3),
    noise=noise,
    site=site,
    seed=3,
)
found = {
    name: systematic.calibrate(
        bent.log, site=site, settings=settings.model_copy(update={"deflection": kind})
    )
    for name, kind in (("stiff", "none"), ("bending", "choose"))
}
print(found["bending"].diagnostics["choice"]["verdict"])

# %% [markdown]
# The same instrument turned ten times about north, then at rest: the velocity it thinks it has.

# %%
plan = navigation_test("north")
turned = simulate_systematic(plan, site=site, model=bent.model, noise=noise, rate=50.0, seed=4).log
logs = {"before": turned} | {name: one.apply(turned) for name, one in found.items()}
for name, log in logs.items():
    increments = increments_of(log)
    state = State.at_rest(align(increments, site, end=300.0).C_nb, site.latitude, 0.0, site.height)
    run = navigate(increments, state, first=increments.row_at(300.0), vertical="held")
    print(f"{name}: {np.hypot(*run.velocity_n[-1, :2]):.3f} m/s after 500 s at rest")
