"""
A bias over temperature
=======================

Five calibrations at five temperatures make a function of temperature. Which terms it needs is
found from the results; the band is twice the standard deviation, scatter of the switch-on
included.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import foucault
from foucault.procedures import hand_rotated
from foucault.procedures.temperature import Session, calibrate
from foucault.simulate.hand_rotated import draw_errors

site = foucault.Site.at(np.radians(48.8), 60.0)
made = hand_rotated.simulate(
    hand_rotated.Session(rests=20, rest_time=4.0, rate=50.0),
    model=draw_errors("mems", 4),
    noise=foucault.grade("mems").noise,
    site=site,
    seed=1,
)
room = hand_rotated.calibrate(made.log, site=site)
rng, sessions = np.random.default_rng(5), []
for degrees in (-20, 0, 20, 40, 60):  # the errors move; here by a formula and some scatter
    v = room.coefficients.with_values(
        {
            name: room.coefficients.value(name)
            + 2e-5 * degrees
            + 3e-7 * degrees**2
            + 5e-5 * rng.standard_normal()
            for name in ("gyro.bias.x", "gyro.bias.y", "gyro.bias.z")
        }
    )
    result = replace(room, coefficients=v, provenance={})
    sessions.append(Session.of(f"at {degrees}", result, 273.15 + degrees))
model = calibrate(sessions).temperature

T = np.linspace(-20, 60, 81)
at = model.layout.names.index("gyro.bias.x")
bias, sd = model.values(273.15 + T)[:, at], model.sd(273.15 + T, scatter=True)[:, at]
plt.fill_between(T, np.degrees(bias - 2 * sd), np.degrees(bias + 2 * sd), alpha=0.25)
plt.plot(T, np.degrees(bias), label="model")
plt.plot(
    [-20, 0, 20, 40, 60],
    [np.degrees(s.result.coefficients.value("gyro.bias.x")) for s in sessions],
    "ko",
    label="sessions",
)
plt.xlabel("temperature [°C]")
plt.ylabel("gyro bias x [deg/s]")
plt.legend()
plt.show()
