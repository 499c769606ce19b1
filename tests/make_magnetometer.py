"""Sessions with a magnetometer, made without any code of the program but its noise-free constants.

Motion is a rotation of SciPy, taken in steps of 1 ms; sensors are read off it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from foucault.tables import Log

G = 9.80665
DEG = np.pi / 180
FINE = 1000.0  # Hz


@dataclass(frozen=True)
class Truth:
    """A magnetometer, and the IMU beside it."""

    A: np.ndarray
    h: np.ndarray
    delay: float = 0.0
    gyro: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    gyro_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    accel_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))


def draw(rng: np.random.Generator, *, gyro: float = 1.0) -> Truth:
    """Scale 3 %, axes 1 deg, soft iron 5 %, rotation 2 deg, hard iron 30 uT; gyro residuals .1 %,
    .5 mrad and 10 deg/h, accelerometers 1 mg."""
    low = np.tril(rng.normal(0, DEG, (3, 3)), -1) + np.diag(1 + rng.normal(0, 0.03, 3))
    soft = rng.normal(0, 0.05 / np.sqrt(6), (3, 3))
    turn = Rotation.from_rotvec(rng.normal(0, 2 * DEG / np.sqrt(3), 3)).as_matrix()
    E = rng.normal(0, 0.5e-3, (3, 3))
    np.fill_diagonal(E, rng.normal(0, 1e-3, 3))
    return Truth(
        low @ (np.eye(3) + (soft + soft.T) / 2) @ turn, rng.normal(0, 30e-6, 3), 0.0, gyro * E,
        gyro * rng.normal(0, 10 * DEG / 3600, 3), rng.normal(0, 1e-3 * G, 3),
    )  # fmt: skip


def free(rng: np.random.Generator, time: float = 60.0, pace: float = 2.5) -> np.ndarray:
    """Rates of free turning between two short rests, (n, 3) [rad/s] every ms."""
    t = np.arange(0.0, time + 3.0, 1 / FINE)
    w = np.zeros((len(t), 3))
    for k in range(3):
        for f in rng.uniform(0.08, 0.7, 5):
            w[:, k] += np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi))
    w *= pace / np.sqrt(np.mean(np.sum(w**2, axis=1)))
    ramp = np.clip(np.minimum(t - 1.5, time + 1.5 - t), 0.0, 0.5) / 0.5
    return w * (ramp**2 * (3 - 2 * ramp))[:, None]


def rests(
    rng: np.random.Generator, count: int = 24, rest: float = 2.0, turn: float = 1.5
) -> np.ndarray:
    """Rates of turns between rests, (n, 3) [rad/s] every ms."""
    tau = np.arange(round(turn * FINE)) / (turn * FINE)
    bump = (1 - np.cos(2 * np.pi * tau)) / turn
    parts = [np.zeros((round(rest * FINE), 3))]
    for _ in range(count - 1):
        axis = rng.standard_normal(3)
        angle = rng.uniform(1.2, 3.0)
        parts += [np.outer(bump, angle * axis / np.linalg.norm(axis)), parts[0]]
    return np.concatenate(parts)


def products(parts: np.ndarray) -> np.ndarray:
    """Return the running products of matrices (n, 3, 3): of rows of them, and then of the rows."""
    n = len(parts)
    long = int(np.ceil(np.sqrt(n)))
    rows = np.tile(np.eye(3), (long * long, 1, 1))
    rows[:n] = parts
    rows = rows.reshape(long, long, 3, 3)
    for k in range(1, long):
        rows[:, k] = rows[:, k - 1] @ rows[:, k]
    for k in range(1, long):
        rows[k] = rows[k - 1, -1] @ rows[k]
    return rows.reshape(-1, 3, 3)[:n]


def session(
    w: np.ndarray, truth: Truth, rng: np.random.Generator, *, noise: float = 0.3e-6,
    intensity: float = 49e-6, dip: float = 66 * DEG, rate: float = 50.0,
    arw: float = 0.007 * DEG, wander: tuple[float, float] | None = None,
    step: np.ndarray | None = None,
) -> Log:  # fmt: skip
    """Read gyros, accelerometers and magnetometer off a motion.

    `arw` [rad/s/sqrt(Hz)]; `wander`: sd [T] and time [s] of a field that changes; `step` (3,): what
    the hard iron changes by half-way [T].
    """
    n = len(w)
    every = Rotation.from_rotvec((w[:-1] + w[1:]) / 2 / FINE)
    first = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    C = products(np.concatenate([first[None], every.as_matrix()]))
    m_n = np.tile(intensity * np.array([0.0, np.cos(dip), -np.sin(dip)]), (n, 1))
    if wander is not None:
        sd, tau = wander
        keep = np.exp(-1 / FINE / tau)
        x = np.zeros((n, 3))
        x[0] = rng.standard_normal(3)
        push = np.sqrt(1 - keep**2) * rng.standard_normal((n, 3))
        for k in range(1, n):
            x[k] = keep * x[k - 1] + push[k]
        m_n += sd * x
    m_b = np.einsum("nji,nj->ni", C, m_n)
    skip = round(FINE / rate)
    rows = np.arange(0, n, skip)
    late = np.maximum(rows - truth.delay * FINE, 0.0)
    low = np.minimum(late.astype(int), n - 2)
    m = m_b[low] + (late - low)[:, None] * (m_b[low + 1] - m_b[low])
    mag = m @ truth.A.T + truth.h + noise * rng.standard_normal(m.shape)
    if step is not None:
        mag[len(mag) // 2 :] += step
    gyro = w[rows] @ (np.eye(3) + truth.gyro).T + truth.gyro_bias
    gyro += arw * np.sqrt(rate) * rng.standard_normal(gyro.shape)
    accel = G * C[rows, 2] + truth.accel_bias + 1e-3 * np.sqrt(rate) * rng.standard_normal(m.shape)
    return Log(rows / FINE, gyro, accel, mag=mag)


def held(log: Log, rng: np.random.Generator, times: float = 1.0) -> Log:
    """Return a log with so many times what a consumer MEMS has beside the model, all of it drawn.

    A magnetometer that bends at the whole field it sits in, hard iron that drifts, gyros that
    follow specific force, bend, turn with the load and drift, accelerometers that bend and drift.
    """
    ramp = ((log.time - log.time[0]) / np.ptp(log.time) - 0.5)[:, None]
    f, w, x = log.accel / G, log.gyro, log.mag / 50e-6
    mag = 50e-6 * (rng.normal(0, 500e-6, 3) * x**2 + rng.normal(0, 250e-6, 3) * x**3)
    mag += ramp * rng.normal(0, 50e-9, 3)
    bend = rng.normal(0, 50e-6, (3, 3, 3))  # of output by rate and force
    bend[np.arange(3), np.arange(3)] = 0
    gyro = f @ rng.normal(0, 100 * DEG / 3600, (3, 3)).T + rng.normal(0, 200e-6, 3) * np.abs(w)
    gyro += rng.normal(0, 60e-9, 3) * DEG * (w / DEG) ** 3 + np.einsum("ijk,nj,nk->ni", bend, w, f)
    gyro += ramp * (rng.normal(0, 20 * DEG / 3600, 3) + rng.normal(0, 200e-6, 3) * w)
    pairs = np.stack([f[:, 1] * f[:, 2], f[:, 0] * f[:, 2], f[:, 0] * f[:, 1]], axis=1)
    accel = rng.normal(0, 500e-6, 3) * f**2 + pairs @ rng.normal(0, 250e-6, (3, 3))
    accel += rng.normal(0, 200e-6, 3) * np.abs(f)
    accel += ramp * (rng.normal(0, 500e-6, 3) + rng.normal(0, 200e-6, 3) * f)
    return replace(
        log, gyro=w + times * gyro, accel=log.accel + times * G * accel, mag=log.mag + times * mag
    )


def level_headings(A: np.ndarray, h: np.ndarray, truth: Truth, dip: float = 66 * DEG) -> np.ndarray:
    """Errors of 72 level headings after a correction by A and h [rad]."""
    psi = np.arange(72) * 5 * DEG
    C = Rotation.from_euler("z", -psi[:, None]).as_matrix()  # body to East-North-Up
    m_n = 49e-6 * np.array([0.0, np.cos(dip), -np.sin(dip)])
    mag = np.einsum("nji,j->ni", C, m_n) @ truth.A.T + truth.h
    m = np.linalg.solve(A, (mag - h).T).T
    found = np.einsum("nij,nj->ni", C, m)
    return np.arctan2(found[:, 0], found[:, 1])
