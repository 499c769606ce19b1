"""
Twelve directions of up
=======================

The corners of an icosahedron spread twelve positions as evenly as twelve can be. A search without
any constraint finds nothing better.
"""

import matplotlib.pyplot as plt

from foucault.plans.directions import directions

axes = plt.figure().subplots(1, 2, subplot_kw={"projection": "3d"})
for ax, name in zip(axes, ("icosahedron 12", "26 faces, edges and corners"), strict=True):
    up = directions(name)
    for x, y, z in up:
        ax.plot([0, x], [0, y], [0, z], color="0.8", lw=1)
    ax.scatter(*up.T, s=40, depthshade=False)
    ax.set_title(name, fontsize=10)
    ax.set_box_aspect((1, 1, 1), zoom=1.4)
    ax.set_axis_off()
plt.show()
