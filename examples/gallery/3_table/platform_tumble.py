"""
A platform is turned through gravity
====================================

A gyro platform has no table: it is turned by torquing its own gyros. What its accelerometers read
while it tumbles, and how the motion comes back to where it began.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.plans.tumble import nominal, published

plan = published()
motion = nominal(plan, np.radians(40.0), interval=10.0)
up = motion.C_pn[:, :, 2]  # of east, north, up
plt.plot(motion.time / 60, up, label=["x", "y", "z"])
plt.xlabel("time [min]")
plt.ylabel("specific force [g]")
plt.legend(title="cluster axis")
plt.show()
