"""Can my motion see it? What a session will show is known before anybody has flown or turned it.

Run it as a script, or cell by cell in an editor that knows `# %%`. It leaves a folder
`can_my_motion_see_it` with the report of a search for a better motion.
"""

# %% [markdown]
# ## Straight on
# The IMU of a survey pod hangs beside the INS of its aircraft; the campaign says how noisy it is.
# Four minutes straight on: which of its errors will they show?

# %%
from pathlib import Path

from foucault import campaign, report
from foucault.campaign import optimisation
from foucault.report import optimisation as search_report

POD = """
[site]
latitude = "48.8462 deg"
height = "60 m"
[log]
file = "log.csv"
[master]
file = "master.csv"
velocity = { columns = ["ve", "vn", "vu"], unit = "m/s" }
attitude = { columns = ["heading", "pitch", "roll"], unit = "deg" }
[procedure]
name = "transfer_alignment"
mounting_heading = "90 deg"
lever_arm = ["0.4 m", "-1.2 m", "-0.6 m"]
[noise.accel]
white = "30 ug/sqrt(Hz)"
[noise.gyro]
white = "0.06 deg/sqrt(h)"
[simulate]
profile = "straight"
rate = "50 Hz"
"""
straight = optimisation.foresee(campaign.parse(POD))
print(f"straight on, {straight.duration:.0f} s: rank {straight.rank} of {straight.states}")
for words in straight.unseen:
    print("  hardly seen:", words)

# %% [markdown]
# ## What a little more would buy
# The same minutes with one manoeuvre added: what is left of the standard deviations in the mean
# (1: all), and of that of the coefficient that gains most. A turn shows the delay of the messages;
# more of the same does not.

# %%
for more in straight.more:
    name, gain = more.best[0]
    print(f"  {more.what} (+{more.time:.0f} s): {more.ratio:.2f}; most of all {name}, {gain:.3f}")

# %% [markdown]
# ## The motion of a survey
# Turns, a climb and changes of speed in the same four minutes see everything.

# %%
survey = optimisation.foresee(campaign.parse(POD.replace('"straight"', '"survey"')))
print(f"survey, {survey.duration:.0f} s: rank {survey.rank} of {survey.states}")
print("sd that is left of what was known before:    straight  survey")
for before, after in zip(straight.rows(), survey.rows(), strict=True):
    print(f"  {before['name']:40}{before['of_prior']:10.1%}{after['of_prior']:8.1%}")

# %% [markdown]
# ## Seen, but hard to tell apart
# A platform is turned by commands through gravity. One turn about one axis: much is seen in sum and
# not apart, and the words say what. Four turns about three axes separate all of it.

# %%
PLATFORM = """
[site]
latitude = "48.1351 deg"
[log]
file = "log.csv"
[procedure]
name = "platform_tumble"
rate_limit = "0.2 deg/s"
[noise.accel]
white = "0.45 ug/sqrt(Hz)"
[noise.gyro]
white = "3.7e-05 deg/sqrt(h)"
"""
platform = campaign.parse(PLATFORM)
for plan in ("-x", "-x -z -y +z"):
    seen = optimisation.foresee(
        platform, {"plan": plan, "segment": f"{5400 // len(plan.split())} s"}
    )
    print(f"plan {plan}: rank {seen.rank} of {seen.states}")
    for words in (*seen.unseen, *seen.weakest)[:3]:
        print("  ", words)

# %% [markdown]
# ## Let it search
# `foucault optimise` tries other motions of the same length within the limits of the rig; a real
# search takes some minutes and cores, and judges by several instruments that may be (`truths`), not
# by one. Its report shows the motion found beside the one to beat.

# %%
folder = Path("can_my_motion_see_it")
quick = campaign.parse(PLATFORM + "[optimise]\ntruths = 1\n")
found = optimisation.run(quick, folder, restarts=2, evaluations=40, seed=1)
print("report:", report.save(search_report.document(found, folder), folder / "report.html"))
