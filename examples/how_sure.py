"""Are the uncertainties right? Errors of many simulated instruments against their sd."""

# %% A short session, so that this example is quick
from foucault import campaign
from foucault.campaign import study

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

# %% Forty instruments; the same command again continues an interrupted study
result = study.run(campaign.parse(CAMPAIGN), 40, "study", seed=1)
for check in result.checks():
    print("ok  " if check.passed else "FAIL", check.sentence)
for row in result.rows()[:3]:
    print(row["name"], f"RMS / sd {row['ratio']:.2f}, RMS / bound {row['rms_over_bound']:.2f}")
