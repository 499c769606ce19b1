"""
Nineteen positions
==================

The classic sequence of systematic calibration: quarter turns about the axes of the instrument.
What each accelerometer reads says which way it lies.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.plans.sequence import nineteen_positions

sequence = nineteen_positions(rest=150.0)
up = np.array([position.C_nb[2] for position in sequence.positions])
start = [position.start / 60 for position in sequence.positions]
end = [position.end / 60 for position in sequence.positions]
for k in range(3):
    for s, e, u in zip(start, end, up[:, k], strict=True):
        plt.plot([s, e], [u - 3 * k] * 2, color=f"C{k}", lw=4)
    plt.axhline(-3 * k, color="0.85", zorder=0)
plt.yticks([0, -3, -6], ["x", "y", "z"])
plt.xlabel("time [min]")
plt.ylabel("specific force along the axis, ±1 g")
plt.show()
