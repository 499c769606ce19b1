"""
Six faces, three turns or two dozen rests?
==========================================

The same IMU by three procedures. Six faces give the accelerometers and the biases of the gyros,
three turns the gyros' scale factors and misalignments too. Two dozen rests in any orientation give
all of it without a cube. The faces are laid down perfectly here; a real cube never lies so well.
"""

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import ferraris, hand_rotated, six_position
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
model, noise = draw_errors("mems", 4), foucault.grade("mems").noise
sd = {}
for procedure, session in (
    (six_position, six_position.Session()),
    (ferraris, ferraris.Session()),
    (hand_rotated, hand_rotated.Session(rest_time=4.0, rate=50.0)),
):
    made = procedure.simulate(session, model=model, noise=noise, site=site, seed=1)
    found = procedure.calibrate(made.log, site=site, noise=noise).coefficients
    sd[procedure.__name__.rpartition(".")[2]] = dict(zip(found.names, found.sd, strict=True))

names = list(sd["hand_rotated"])
for name, marker in zip(sd, "os^", strict=True):
    at = [i for i, n in enumerate(names) if n in sd[name]]
    plt.semilogx([sd[name][names[i]] for i in at], at, marker, label=name)
plt.yticks(range(len(names)), names, fontsize=8)
plt.gca().invert_yaxis()
plt.xlabel("standard deviation [SI]")
plt.legend()
plt.show()
