"""A magnetometer beside an IMU in a hand, in a field that may change from place to place."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, Protocol

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import Site
from foucault.models.magnetometer import Magnetometer
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.turning import Turning
from foucault.simulate.noise import Simulated, noisy_log
from foucault.tables import whole_samples


class Session(Protocol):
    """What is done, and where."""

    motion: Literal["free", "rests"]  # turned all the time, or from rest to rest
    time: float  # length of the free turning [s]
    pace: float  # how fast it is turned, rms [rad/s]
    rests: int  # number of rests [1]
    rest_time: float  # length of a rest [s]
    turn_time: float  # length of a turn [s]
    rate: float  # of the samples [Hz]
    kind: Literal["rate", "increment"]  # instantaneous rates, or means over each interval
    intensity: float  # of the field [T]
    dip: float  # of the field, positive where it points down [rad]
    noise_sd: float  # of a reading of the magnetometer [T]
    wander_sd: float  # how much the field changes from place to place [T]
    wander_time: float  # for how long it stays the same [s]


LEAD = 0.12
"""How long before its first row a late magnetometer may see [s]."""

FINE = 8
"""Steps that a motion is simulated with between two samples [1]."""


def draw_errors(grade_name: str, seed: int) -> Magnetometer:
    """Draw the errors of a magnetometer; the class of the IMU makes none; `seed`: seed [1]."""
    rng = np.random.default_rng([seed, 4])
    soft = rng.standard_normal((3, 3)) * 0.02
    A = exp(np.radians(2.0) * rng.standard_normal(3)) @ (np.eye(3) + soft + soft.T)
    A = A @ np.diag(1.0 + 0.03 * rng.standard_normal(3))
    iron, delay = 30e-6 * rng.standard_normal(3), float(rng.uniform(0.0, 0.01))
    # With the mean of the gains of three axes 5 percent of all: as uncertain as a field is that
    # the readings alone tell.
    gain = 1.0 + 0.04 * rng.standard_normal()
    return Magnetometer(gain * A, iron, delay)


def simulate_field(
    session: Session, settings: Any, model: Magnetometer, noise: ImuNoise, site: Site,
    seed: int,
) -> Simulated:  # fmt: skip
    """Simulate a session: `seed` [1] gives one of its motion and one of its `noise` [SI]."""
    from scipy.signal import lfilter

    motion, sensors = (np.random.default_rng(s) for s in np.random.SeedSequence([seed, 5]).spawn(2))
    rest, turn = session.rest_time, session.turn_time
    free = session.motion == "free"
    starts = np.asarray(rest + np.arange(1 if free else session.rests - 1) * (rest + turn), float)
    length = np.full(len(starts), session.time if free else turn)
    n = whole_samples((starts[-1] + length[-1] + rest) * session.rate) + 1
    fine = FINE * session.rate
    time = np.asarray(np.arange(-round(LEAD * fine), (n - 1) * FINE + 1) / fine, float)
    w = _rates(session, starts, length, time, motion)
    chain = Turning(time, w).chain(0.0, np.zeros(3), np.zeros((3, 3)))
    C = exp(motion.standard_normal(3)) @ chain.C
    sampled = slice(round(LEAD * fine), None, FINE)
    B = session.intensity + (settings.intensity_sd or 0.0) * sensors.standard_normal()
    m_n = B * np.array([0.0, np.cos(session.dip), -np.sin(session.dip)])
    keep = np.exp(-1.0 / fine / session.wander_time)
    push = session.wander_sd * sensors.standard_normal((len(time), 3))
    push[1:] *= np.sqrt(1 - keep**2)
    wander = lfilter([1.0], [1.0, -keep], push, axis=0) if session.wander_sd else push
    field_b = np.einsum("nji,nj->ni", C, m_n + wander)
    late = np.column_stack([np.interp(time[sampled] - model.delay, time, field_b[:, k])
                            for k in range(3)])  # fmt: skip
    mag = model.measure(late) + session.noise_sd * sensors.standard_normal((n, 3))
    f_b, rate = site.gravity * C[sampled, 2], w[sampled]
    if session.kind == "increment":
        middle = 0.5 * (w + np.roll(w, 1, axis=0))  # the rate is straight from step to step
        rate = np.diff(np.cumsum(middle, 0)[sampled], axis=0, prepend=np.nan) / FINE
        rate[0] = w[sampled][0]
    s = settings
    gyros = s.gyro_misalignment_sd * sensors.standard_normal((3, 3))
    np.fill_diagonal(gyros, s.gyro_scale_sd * sensors.standard_normal(3))
    # The inverse of how it is taken away: w = w_m - bias - matrix w_m.
    bias = s.gyro_bias_sd * sensors.standard_normal(3)
    measured = np.asarray(np.linalg.solve(np.eye(3) - gyros, (rate + bias).T).T, float)
    force = f_b + s.accel_bias_sd * sensors.standard_normal(3)
    log = noisy_log(time[sampled], force, measured, sampled=session.kind, noise=noise, rng=sensors)
    return Simulated(replace(log, mag=mag), model, {"dip": session.dip})


def _rates(
    session: Session, starts: FloatArray, length: FloatArray, time: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Return the rate of the body at `time` (n,) [s], shape (n, 3) [rad/s]: still between turns."""
    w = np.zeros((len(time), 3))
    for begin, long in zip(starts, length, strict=True):
        now = (time > begin) & (time < begin + long)
        t = (time[now] - begin)[:, None]
        if session.motion == "free":
            f, phase = rng.uniform(0.05, 0.6, (4, 3)), rng.uniform(-np.pi, np.pi, (4, 3))
            one = sum(np.sin(2 * np.pi * f[j] * t + phase[j]) for j in range(4)) / np.sqrt(2.0)
            ends = np.clip(np.minimum(t, long - t), 0.0, 1.0)
            w[now] = session.pace / np.sqrt(3.0) * one * np.sin(0.5 * np.pi * ends) ** 2
        else:
            axis = rng.standard_normal(3)
            angle = rng.uniform(0.5, 1.0) * np.pi / np.linalg.norm(axis)
            tau = t / long
            w[now] = axis * angle * 30 * (tau * (1 - tau)) ** 2 / long
    return w
