"""Is my result right? Five questions to a calibration, from its own checks to what none can show.

Run it as a script, or cell by cell in an editor that knows `# %%`. It leaves a folder
`is_my_result_right` with two run folders and their reports.
"""

# %% [markdown]
# ## A session
# Somebody has rested an IMU in two dozen orientations and turned it by hand in between. Here the
# session is simulated, so that the truth is known at the end; nothing below uses it before.

# %%
from pathlib import Path

import numpy as np

import foucault
from foucault import campaign, report
from foucault.campaign import comparison, study
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

folder = Path("is_my_result_right")
site = foucault.Site.at(np.radians(48.8462), 60.0)
instrument, noise = draw_errors("tactical", seed=4), foucault.grade("tactical").noise


def session(seed: int) -> foucault.Log:
    """Simulate a session with the same instrument."""
    plan = hand_rotated.Session(rests=20, rest_time=4.0, rate=50.0)
    return hand_rotated.simulate(plan, model=instrument, noise=noise, site=site, seed=seed).log


log = session(1)
result = hand_rotated.calibrate(log, site=site)
print(result.coefficients)

# %% [markdown]
# ## 1. Does it agree with itself?
# Every check is a number against limits that a right result breaks in one of a hundred cases; rests
# that were left out are predicted from the others. The verdict is the worst of them.

# %%
print("verdict:", result.verdict.level, *result.verdict.reasons)
for check in result.checks:
    print("ok  " if check.passed else "FAIL", check.sentence)

# %% [markdown]
# ## 2. What was hardly seen?
# A calibration can be right and of little use. These combinations are known least.

# %%
for words in result.diagnostics["weakest"][:3]:
    print(words)

# %% [markdown]
# ## 3. Does another session say the same?
# The strongest evidence there is without a better instrument: do it again, and compare the changes
# with their joint uncertainty.

# %%
for name, found in (("january", result), ("june", hand_rotated.calibrate(session(2), site=site))):
    foucault.save_result(found, folder / name)
    print("report:", report.write(folder / name))
again = comparison.run(
    [folder / "january", folder / "june"], dates="2026-01-12,2026-06-15", same=True
)
print("compared:", again.verdict.level, *again.verdict.reasons)

# %% [markdown]
# ## 4. Are the uncertainties of this procedure right at all?
# Many simulated instruments, each calibrated from a session of its own: the errors must scatter as
# their standard deviations say (a ratio of 1), and not miss the truth more often. `foucault
# montecarlo` does the same with hundreds. The same call again continues an interrupted study.

# %%
CAMPAIGN = """
[site]
latitude = "48.8462 deg"
[log]
file = "log.csv"
[procedure]
name = "hand_rotated"
[simulate]
grade = "tactical"
rests = 16
rest_time = "2.5 s"
rate = "50 Hz"
"""
many = study.run(campaign.parse(CAMPAIGN), 40, folder / "study", seed=1)
for check in many.checks():
    print("ok  " if check.passed else "FAIL", check.sentence)
for row in many.rows()[:3]:
    print(row["name"], f"RMS / sd {row['ratio']:.2f}, RMS / bound {row['rms_over_bound']:.2f}")

# %% [markdown]
# ## 5. What would no check notice?
# All accelerometers that read too much look like a place with more gravity. Two kilometres of wrong
# height pass every check and move the three scale factors together. In a campaign gravity has a
# standard deviation too, and the report says how much of every uncertainty it makes.

# %%
wrong = hand_rotated.calibrate(log, site=foucault.Site.at(np.radians(48.8462), 2060.0))
moved = wrong.coefficients["accel.scale"].values - result.coefficients["accel.scale"].values
print(f"2 km too high: {wrong.verdict.level}, scale factors moved by {1e6 * moved.mean():+.0f} ppm")

# %% [markdown]
# ## And the truth?
# Known here alone.

# %%
truth = instrument.coefficients(result.coefficients.names)
z = (result.coefficients.values - truth.values) / result.coefficients.sd
print(f"errors: {np.sqrt(np.mean(z**2)):.2f} sd RMS, {np.abs(z).max():.1f} sd at most")
