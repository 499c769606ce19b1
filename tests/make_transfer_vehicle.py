"""The log of a real vehicle: a MEMS slave beside a fibre-optic master, and how a user describes it.

100 s of driving north, the slave at 100 Hz and the master at 10 Hz, with swings in roll to 33 deg
between 30 and 75 s. The numbers shipped with the log and those of another program (PSINS, 21
states) are estimates too: they are not truth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault import campaign
from foucault.campaign.running import read_log
from foucault.models.rotation import exp
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.strapdown import State, navigate
from foucault.procedures import transfer_alignment
from foucault.procedures.transfer_alignment.settings import SlaveLog
from make_alignment import REAL

FOLDER = REAL / "fog_mems_transfer"
ARCMIN, ARCSEC, DEG_H = np.pi / 10800, np.pi / 648000, np.pi / 648000
UG, PPM, MS = 9.80665e-6, 1e-6, 1e-3
UNITS = {"gyro.bias": (DEG_H, "deg/h"), "gyro.scale": (PPM, "ppm"), "accel.bias": (UG, "ug"),
         "installation": (ARCMIN, "arcmin"), "master.delay": (MS, "ms")}  # fmt: skip
SHIPPED = {
    "gyro.bias": (-213.6429, 158.9276, 84.4742),
    "accel.bias": (2896.85, -7254.28, -4706.58),
    "installation": (-5.303661, 2.471417, -17.573716),
}
PSINS = {
    "gyro.bias": (-214.51, 159.68, 76.14),
    "accel.bias": (2446.98, -4281.23, -4417.49),
    "installation": (-5.4449, 2.5122, -17.5871),
}

TEXT = """
[site]
latitude = "34.43 deg"
height = "170 m"
[log]
file = "transfer_align_fog_mems.mat"
variable = "mimu"
time = { column = 6, unit = "s" }
gyro = { columns = [0, 1, 2], unit = "rad", kind = "increment" }
accel = { columns = [3, 4, 5], unit = "m/s", kind = "increment" }
[master]
file = "transfer_align_fog_mems.mat"
variable = "fogavp"
time = { column = 9, unit = "s" }
velocity = { columns = [3, 4, 5], unit = "m/s" }
attitude = { columns = [2, 0, 1], unit = "rad", sense = "counter-clockwise" }
position = { columns = [6, 7, 8], unit = "rad" }
[procedure]
name = "transfer_alignment"
"""
PRIORS = """
[prior]
"gyro.bias" = { mean = "0 deg/h", sd = "300 deg/h" }
"gyro.scale" = { mean = "0 ppm", sd = "2000 ppm" }
"accel.bias" = { mean = "0 mg", sd = "10 mg" }
"installation" = { mean = "0 arcmin", sd = "30 arcmin" }
"""
"""What is known of MEMS sensors of this class, and of a case that was screwed on by eye."""

NOISE = """
[noise.gyro]
white = "{gyro:.4g} deg/sqrt(h)"
[noise.accel]
white = "{accel:.4g} ug/sqrt(Hz)"
"""
FOUND = {"velocity": 1.5e-3, "attitude": 5.6, "accel": 145.0, "gyro": 0.15}
"""What makes the innovations of every other second likeliest: m/s, arcsec, ug/sqrt(Hz),
deg/sqrt(h)."""

LEVER = (-0.020, -0.073, -0.100)
"""The likeliest lever arm [m]."""


def described(keys="", noise=None, lever=None, *, priors=PRIORS):
    """Return the campaign; `noise` as `FOUND`, `lever` as `LEVER`, `keys` of [procedure]."""
    text = TEXT + keys + "\n"
    if lever is not None:
        arm = ", ".join(f'"{x:.4f} m"' for x in lever)
        text += f"lever_arm = [{arm}]\n"
    if noise is not None:
        text += f'velocity_sd = "{noise["velocity"]:.4g} m/s"\n'
        text += f'attitude_sd = "{noise["attitude"]:.4g} arcsec"\n'
        text += NOISE.format(**noise)
    return campaign.parse(text + priors, FOLDER / "campaign.toml")


def logged():
    """Return the slave's log beside its master."""
    return read_log(described())


def calibrated(c, log):
    return transfer_alignment.calibrate(
        log, site=c.site, settings=c.settings, noise=c.noise, prior=c.prior
    )


def on_one_clock(log, drift):
    """Return the log with the stamps of the master on the slave's clock; the mean stays."""
    t = log.messages.time
    return replace(log, master=replace(log.messages, time=t - drift * (t - t.mean())))


def half(log, second):
    """Return a half of the log: half a minute and twenty seconds of either have the swings."""
    slave = slice(4900, None) if second else slice(0, 5150)
    return SlaveLog.of(log[slave], log.messages[slice(500, None) if second else slice(0, 500)])


def apart(c, log):
    """Return by how many of their sds two halves differ, each coefficient, and chi-square."""
    one, two = (calibrated(c, half(log, second)).coefficients for second in (False, True))
    gap, cov = one.values - two.values, one.cov + two.cov
    return dict(zip(one.names, gap / np.sqrt(np.diag(cov)), strict=True)), float(
        gap @ np.linalg.solve(cov, gap)
    )


def in_units(group, values):
    return np.array(values) * UNITS[group][0]


def closure(log, gyro_bias, accel_bias, mu, delay, begin=0.0):
    """Navigate the slave alone from the master's attitude; return time and heading error [rad]."""
    x, said = increments_of(log), log.messages
    alone = Increments.of(x.time, x.dtheta_b - gyro_bias * x.dt[:, None],
                          x.dvel_b - accel_bias * x.dt[:, None])  # fmt: skip
    valid, C_ms = said.time - delay, exp(np.asarray(mu))
    used = np.flatnonzero(valid > max(x.time[0], begin))
    k = used[0]
    first = int(np.searchsorted(x.time, valid[k]))
    ahead = alone.dtheta_b[first] / x.dt[first] * (x.time[first] - valid[k])
    start = State(float(said.latitude[k]), float(said.longitude[k]), float(said.height[k]),
                  said.velocity_n[k], said.C_nb[k] @ C_ms @ exp(ahead))  # fmt: skip
    run = navigate(alone, start, first=first)
    last = np.searchsorted(run.time, valid[used], side="right") - 1
    last = np.clip(last, 0, len(run.time) - 2)
    part = (valid[used] - run.time[last]) / (run.time[last + 1] - run.time[last])
    C, after = run.C_nb[last], run.C_nb[last + 1]
    step = rotation_vector(np.swapaxes(C, 1, 2) @ after)
    C_nm = C @ exp(step * part[:, None]) @ C_ms.T
    err = rotation_vector(C_nm @ np.swapaxes(said.C_nb[used], 1, 2))
    return said.time[used], err[:, 2]
