"""
What a session will show
========================

Before anybody has turned anything: the standard deviation of each coefficient after a session,
as part of what was known before. Near 1 nothing is learned.
"""

import matplotlib.pyplot as plt

from foucault import campaign
from foucault.campaign import optimisation as preflight

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
[noise.accel]
white = "30 ug/sqrt(Hz)"
[noise.gyro]
white = "0.06 deg/sqrt(h)"
[simulate]
profile = "straight"
rate = "20 Hz"
"""
for profile in ("straight", "survey"):
    seen = preflight.foresee(campaign.parse(POD.replace('"straight"', f'"{profile}"')))
    names = [row["name"] for row in seen.rows()]
    plt.plot([row["of_prior"] for row in seen.rows()], names, "o", label=profile)
plt.xscale("log")
plt.gca().invert_yaxis()
plt.tick_params(axis="y", labelsize=8)
plt.xlabel("sd after over sd before")
plt.legend()
plt.show()
