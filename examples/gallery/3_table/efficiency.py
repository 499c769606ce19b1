"""
How good is a set of positions?
===============================

The determinant of the information of nine coefficients, for each position by itself. One is as
good as positions can be.
"""

import matplotlib.pyplot as plt

from foucault.models.turntable import up_k
from foucault.plans.directions import named_angles
from foucault.plans.efficiency import efficiency

names = (
    "12 edges",
    "icosahedron 12",
    "14 faces and corners",
    "18 faces and edges",
    "dodecahedron 20",
    "24 on great circles",
    "26 faces, edges and corners",
)
good = [efficiency(up_k(named_angles(name))).d_efficiency for name in names]
plt.barh(names, good)
plt.gca().invert_yaxis()
plt.xlim(0.8, 1.0)
plt.xlabel("D-efficiency")
plt.show()
