"""
Poses for spins
===============

Gyros that bend under gravity are seen by spins about a level axis. Some sets of six poses tell
the six coefficients apart better than others, and a search finds sets of any number.
"""

import matplotlib.pyplot as plt

from foucault.plans.sequence import NAMES, best_poses, poses, quality

sets = {name: poses(name) for name in NAMES}
sets |= {f"found, {n} poses": best_poses(n, starts=5) for n in (6, 7, 8, 9)}
plt.barh(list(sets), [quality(angles).spread for angles in sets.values()])
plt.gca().invert_yaxis()
plt.xlabel("sd of a coefficient over that of one tilt")
plt.show()
