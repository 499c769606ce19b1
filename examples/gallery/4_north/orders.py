"""
Four stops, seven or a rotation?
================================

A north seeker turns its gyro to several stops. White noise makes no difference
between orders of stops; with slow noise those that come back sooner are better.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault import parse_unit
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans import north_orders as orders
from foucault.plans.north_stops import Conditions

noise = ImuNoise(
    TriadNoise(white=parse_unit("5 ug/sqrt(Hz)", "velocity random walk")),
    TriadNoise(
        white=parse_unit("0.003 deg/sqrt(h)", "angle random walk"),
        bias_instability=parse_unit("0.03 deg/h", "angular rate"),
    ),
)
task = orders.Task(Conditions(np.radians(47.0), noise), move=5.0)
total = np.geomspace(120, 3600, 12)
for order in (
    orders.PUBLISHED,
    orders.PALINDROME,
    orders.PUBLISHED.repeated(3),
    orders.continuous(5),
):
    sd = [np.degrees(orders.at_time(order, t, task).sd) for t in total]
    plt.loglog(total / 60, sd, "o-", label=order.name)
plt.xticks([2, 5, 10, 20, 60], ["2", "5", "10", "20", "60"])
plt.yticks([0.05, 0.1, 0.2], ["0.05", "0.1", "0.2"])
plt.minorticks_off()
plt.xlabel("time [min]")
plt.ylabel("sd of the heading [deg]")
plt.legend()
plt.show()
