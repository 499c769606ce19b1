"""Simulated spins on a level axis: an electric tool that wanders, sways, shakes and lets slip.

Attitudes are products of rotations; specific force and rates follow from their axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.spin import across
from foucault.simulate.noise import Simulated, noisy_log
from foucault.tables import whole_samples

Mounting = Literal["x", "y", "z", "-x", "-y", "-z", "skew"]
"""Axis of the instrument along the spin axis."""


@dataclass(frozen=True)
class SpinPlan:
    """What is done, and what is wrong with the tool."""

    rates: tuple[float, ...]  # of the spins in each mounting, negative backwards [rad/s]
    mountings: tuple[str, ...]  # axes along the spin axis: x, -z, skew
    spin_time: float  # length of each spin [s]
    mounting_sd: float  # sd of the axis of a mounting about each of two axes [rad]
    tilt_sd: float  # sd of the tilt of the spin axis [rad]
    lever_arm: float  # sd of the lever arm across the axis, each component [m]
    wander: float  # sd of the rate, over 3 s [1]
    unbalance: float  # what the rate varies once a turn [1]
    sway: float  # sd of the direction of the axis, over 0.3 s [rad]
    vibration: float  # rms of each axis [m/s^2]
    slip: float  # by how much it moves in the chuck before the last spin [m]
    rate: float  # of the samples [Hz]
    kind: Literal["rate", "increment"]  # instantaneous, or means over each interval


RAMP, PAUSE = 1.0, 1.5
"""How long a tool takes to its speed, and a hand to set the next one [s]."""


def simulate_spins(
    plan: SpinPlan, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> Simulated:  # fmt: skip
    """Simulate a session: `seed` [1] gives one of its motion and one of its `noise` [SI]."""
    draw, sensors = (np.random.default_rng(s) for s in np.random.SeedSequence([seed, 6]).spawn(2))
    long = plan.spin_time + 2 * RAMP + PAUSE
    count = len(plan.rates) * len(plan.mountings)
    n = whole_samples(count * long * plan.rate) + 1
    fine = FINE if plan.kind == "increment" else 1
    time = np.asarray(np.arange(-(fine - 1), (n - 1) * fine + 1) / (fine * plan.rate), float)
    f, w = np.empty((2, len(time), 3))
    shake = plan.vibration * sensors.standard_normal((n, 3))
    grips = []
    for m, axis in enumerate(plan.mountings):
        grips.append(_grip(axis, plan, draw))
        for k, rate in enumerate(plan.rates):
            number = m * len(plan.rates) + k
            mine = (time >= number * long - (number == 0)) & (time < (number + 1) * long)
            mine |= (number == count - 1) & (time >= number * long)
            arm = grips[-1][2] + plan.slip * (number == count - 1) * np.array([1.0, 0.0, 0.0])
            f[mine], w[mine] = _spun(
                time[mine] - number * long, rate, plan, site, (*grips[-1][:2], arm), draw
            )
    if fine > 1:
        f, w = (x.reshape(n, fine, 3).mean(axis=1) for x in (f, w))
    accel, gyro = model.measure(f, w)
    log = noisy_log(time[fine - 1 :: fine], accel + shake, gyro, sampled=plan.kind, noise=noise,
                    rng=sensors)  # fmt: skip
    tilts = [float(g[1][0]) for g in grips]
    return Simulated(log, model, {"tilts": tilts, "arms": [g[2].tolist() for g in grips]})


FINE = 16
"""Steps within an interval over which a reading is a mean [1]."""


def _grip(
    axis: str, plan: SpinPlan, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw ``C_bm``, tilt and azimuth [rad], and the lever arm [m] of a mounting."""
    unit = np.ones(3) / np.sqrt(3.0) if axis == "skew" else np.eye(3)["xyz".index(axis[-1])]
    unit = -unit if axis[0] == "-" else unit
    C = across(unit) @ exp(rng.uniform(-np.pi, np.pi) * np.array([0.0, 0.0, 1.0]))
    C = exp(plan.mounting_sd * rng.standard_normal(3)) @ C
    angles = np.array([plan.tilt_sd * rng.standard_normal(), rng.uniform(-np.pi, np.pi)])
    return C, angles, plan.lever_arm * np.append(rng.standard_normal(2), 0.0)


def _spun(
    t: FloatArray, rate: float, plan: SpinPlan, site: Site,
    grip: tuple[FloatArray, FloatArray, FloatArray], rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return specific force and rate in the body of one spin with its ramps, (n, 3) each [SI]."""
    from scipy.interpolate import CubicSpline

    C_bm, (tilt, azimuth), arm = grip
    knots = np.arange(-2 * KNOT, t[-1] + 3 * KNOT, KNOT)
    keep = np.exp(-KNOT / 3.0)
    walk = rng.standard_normal(len(knots))
    for k in range(1, len(walk)):
        walk[k] = keep * walk[k - 1] + np.sqrt(1 - keep**2) * walk[k]
    slow = CubicSpline(knots, plan.wander * walk)
    shape = np.clip(np.minimum(t / RAMP, (plan.spin_time + 2 * RAMP - t) / RAMP), 0.0, 1.0)
    ramp = shape**3 * (10 - 15 * shape + 6 * shape**2)
    ramped = 30 * shape**2 * (1 - shape) ** 2 / RAMP * np.sign(plan.spin_time / 2 + RAMP - t)
    turn = rate * t + rng.uniform(-np.pi, np.pi)
    u = plan.unbalance
    w = rate * ramp * (1 + slow(t) + u * np.cos(turn))
    al = rate * (ramped * (1 + slow(t) + u * np.cos(turn))
                 + ramp * (slow(t, 1) - u * rate * np.sin(turn)))  # fmt: skip
    middle = rate * ramp * (1 + slow(t))
    th = CubicSpline(t, middle + rate * ramp * u * np.cos(turn)).antiderivative()(t)
    th += rng.uniform(-np.pi, np.pi)
    lean = np.zeros((len(t), 3))
    if plan.sway:
        few = rng.standard_normal((int((t[-1] - t[0]) / 0.3) + 4, 2))
        at = CubicSpline(t[0] - 0.3 + 0.3 * np.arange(len(few)), plan.sway * few)
        lean[:, :2] = at(t)
        leaning = np.column_stack([at(t, 1), np.zeros(len(t))])
    # Axes h: along the spin axis, level across it, and the third; z up where the axis is level.
    e = np.array([np.sin(azimuth) * np.cos(tilt), np.cos(azimuth) * np.cos(tilt), np.sin(tilt)])
    C_na = across(e)
    C_am = exp(th[:, None] * np.array([0.0, 0.0, 1.0]))
    C_nm = C_na @ (exp(lean) @ C_am if plan.sway else C_am)
    w_m = w[:, None] * np.array([0.0, 0.0, 1.0])
    if plan.sway:
        w_m = w_m + np.einsum("nji,nj->ni", C_am, leaning)
    if site.latitude is not None:
        w_m = w_m + earth_rate_n(site.latitude) @ C_nm
    centripetal = -(w**2)[:, None] * arm + al[:, None] * np.array([-arm[1], arm[0], 0.0])
    f_m = site.gravity * C_nm[:, 2] + centripetal
    return f_m @ C_bm.T, w_m @ C_bm.T


KNOT = 0.25
"""Time between the knots of the wander of the rate [s]."""
