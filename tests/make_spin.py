"""Spins of a rigid body, by no code of the package: positions and attitudes are differenced.

A tool turns about an axis that may lean, nod and sway; the body sits in its chuck, may slip there,
and is shaken. Attitudes are products of elementary rotations at 1600 Hz, their differences give
the rate, second differences of the position of the accelerometers the specific force; both sensors
have matrices of their own. Nothing is taken from what is tested but the container of a log.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from foucault.tables import Log

FINE = 16  # steps between two readings
EARTH = 7.292115e-5
DEG = np.pi / 180
G0 = 9.80665


@dataclass(frozen=True)
class Tool:
    """What turns, and what is wrong with it."""

    rates: tuple[float, ...] = (4.0, -7.0, 10.0)  # rad/s
    seconds: float = 10.0
    axes: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    mounting: float = 3.0 * DEG
    tilt: float = 1.5 * DEG
    arm: float = 0.02
    wander: float = 0.01  # of the rate, over 3 s
    ripple: tuple[tuple[int, float], ...] = ()  # (times a turn, part of the rate)
    sway: float = 0.0  # rad rms, over 0.3 s
    nods: tuple[tuple[int, float], ...] = ()  # (times a turn, rad): run-out, an oval bearing
    vibration: float = 0.0  # m/s^2 rms of a reading, each axis
    cable: float = 0.0  # rad: pulls the axis over as a cable winds up in a spin
    shifted: float = 0.0  # m: slips across the axis before the last spin
    turned: float = 0.0  # rad: turns in the chuck half-way through every spin
    accel_noise: float = 150e-6 * G0  # m/s^2/sqrt(Hz)
    gyro_noise: float = 0.006 * DEG  # rad/s/sqrt(Hz)
    gyro_walk: float = 0.0  # rad/s after the whole of a session
    latitude: float = 48.0 * DEG
    gravity: float = 9.81
    hertz: float = 100.0
    averaged: bool = False  # readings are means over their interval


@dataclass(frozen=True)
class Unit:
    """Errors of an instrument: reading = matrix true + bias (+ squares, + force)."""

    A: np.ndarray = field(default_factory=lambda: np.eye(3))
    a: np.ndarray = field(default_factory=lambda: np.zeros(3))
    K: np.ndarray = field(default_factory=lambda: np.zeros(3))
    W: np.ndarray = field(default_factory=lambda: np.eye(3))
    b: np.ndarray = field(default_factory=lambda: np.zeros(3))
    D: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def named(self) -> dict[str, float]:
        """The same by the names of coefficients."""
        out = {}
        for i, x in enumerate("xyz"):
            out |= {f"accel.bias.{x}": self.a[i], f"gyro.bias.{x}": self.b[i],
                    f"accel.quadratic.{x}": self.K[i]}  # fmt: skip
            for j, y in enumerate("xyz"):
                out[f"gyro.g_sensitivity.{x}{y}"] = self.D[i, j]
                for one, M in (("accel", self.A), ("gyro", self.W)):
                    if i == j:
                        out[f"{one}.scale.{x}"] = M[i, i] - 1
                    else:
                        out[f"{one}.misalignment.{x}{y}"] = M[i, j]
        return out


def draw_unit(rng: np.random.Generator) -> Unit:
    """3e-3 of scale and misalignment, 20 mg, 0.3 deg/s, 0.3 mg/g^2, 0.05 deg/s/g."""
    A, W = (np.eye(3) + 3e-3 * rng.standard_normal((3, 3)) for _ in range(2))
    return Unit(
        np.tril(A), 20e-3 * G0 * rng.standard_normal(3), 0.3e-3 / G0 * rng.standard_normal(3),
        W, 0.3 * DEG * rng.standard_normal(3), 0.05 * DEG / G0 * rng.standard_normal((3, 3)),
    )  # fmt: skip


def about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotations of a column vector by angles about one of the axes, (n, 3, 3)."""
    out = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = c
    out[:, i, j], out[:, j, i] = -s, s
    return out


def smooth(rng: np.random.Generator, t: np.ndarray, every: float) -> np.ndarray:
    """A smooth random curve of unit variance."""
    knots = np.arange(t[0] - 4 * every, t[-1] + 4 * every, every)
    x = rng.standard_normal(len(knots))
    distance = (t[:, None] - knots) / every
    weight = np.exp(-(distance**2))
    return (weight @ x) / np.sqrt(np.sum(weight**2, axis=1))


def unit_of(rng: np.random.Generator, axis: np.ndarray, sd: float) -> np.ndarray:
    """A frame whose third axis is near `axis`."""
    z = axis / np.linalg.norm(axis) + sd * rng.standard_normal(3)
    z /= np.linalg.norm(z)
    x = np.cross(rng.standard_normal(3), z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def spun(tool: Tool, unit: Unit, seed: int) -> Log:
    """The log of a session."""
    rng = np.random.default_rng([seed, 77])
    h = 1.0 / tool.hertz / FINE
    parts = []
    for m, axis in enumerate(tool.axes):
        B = unit_of(rng, np.array(axis, float), tool.mounting)  # of the chuck in the body
        lean = tool.tilt * rng.standard_normal()
        round_ = rng.uniform(0, 2 * np.pi)
        east = np.array(
            [np.cos(round_) * np.cos(lean), np.sin(round_) * np.cos(lean), np.sin(lean)]
        )
        C_tool = unit_of(rng, east, 0.0)  # x_n = C_tool x_tool, third axis: the spin
        arm = tool.arm * rng.standard_normal(2)
        for k, rate in enumerate(tool.rates):
            t = np.arange(-2, round((tool.seconds + 1.5) * tool.hertz) * FINE + 3) * h
            edge = np.clip(np.minimum(t, tool.seconds + 1.5 - t) / 0.7, 0, 1)
            ramp = np.sin(np.pi / 2 * edge) ** 2
            w = rate * ramp * (1 + tool.wander * smooth(rng, t, 3.0))
            turn = np.cumsum(w) * h
            for times, part in tool.ripple:
                turn = turn + part / times * np.sin(times * turn + rng.uniform(0, 6)) * ramp
            turn = turn + rng.uniform(0, 2 * np.pi)
            late = t > tool.seconds / 2
            sit = turn + tool.turned * np.where(late, 1 - np.exp(-(t - tool.seconds / 2) / 0.05), 0)
            x, y = tool.sway * smooth(rng, t, 0.3), tool.sway * smooth(rng, t, 0.3)
            for times, angle in tool.nods:
                x = x + angle * np.cos(times * turn)
                y = y + angle * np.sin(times * turn)
            x = x + tool.cable * t / t[-1]
            C = C_tool @ about(0, x) @ about(1, y) @ about(2, sit) @ B.T  # x_n = C x_b
            last = m == len(tool.axes) - 1 and k == len(tool.rates) - 1
            here = arm + np.array([tool.shifted, 0.0]) * last
            p = C @ (B[:, :2] @ here)
            parts.append(differenced(C, p, h, tool))
    f, w = (np.concatenate([part[i] for part in parts]) for i in range(2))
    if tool.averaged:
        f, w = (x.reshape(-1, FINE, 3).mean(axis=1) for x in (f, w))
    else:
        f, w = f[FINE - 1 :: FINE], w[FINE - 1 :: FINE]
    n = len(f)
    root = np.sqrt(tool.hertz)
    accel = f @ unit.A.T + unit.a + unit.K * f**2 + tool.vibration * rng.standard_normal((n, 3))
    gyro = w @ unit.W.T + unit.b + f @ unit.D.T
    walk = np.cumsum(rng.standard_normal((n, 3)), axis=0) * tool.gyro_walk / np.sqrt(n)
    gyro += walk + tool.gyro_noise * root * rng.standard_normal((n, 3))
    accel += tool.accel_noise * root * rng.standard_normal((n, 3))
    return Log(np.arange(n) / tool.hertz, gyro, accel, "increment" if tool.averaged else "rate")


def differenced(C: np.ndarray, p: np.ndarray, h: float, tool: Tool) -> tuple[np.ndarray, ...]:
    """Specific force and rate in the body, at all but two instants at either end."""
    a = (p[4:] * -1 + 16 * p[3:-1] - 30 * p[2:-2] + 16 * p[1:-3] - p[:-4]) / (12 * h**2)
    f_n = a + np.array([0.0, 0.0, tool.gravity])
    C_now = C[2:-2]
    dC = (-C[4:] + 8 * C[3:-1] - 8 * C[1:-3] + C[:-4]) / (12 * h)
    wx = np.swapaxes(C_now, 1, 2) @ dC
    w = np.stack(
        [wx[:, 2, 1] - wx[:, 1, 2], wx[:, 0, 2] - wx[:, 2, 0], wx[:, 1, 0] - wx[:, 0, 1]], 1
    )
    earth = EARTH * np.array([0.0, np.cos(tool.latitude), np.sin(tool.latitude)])
    w = w / 2 + earth @ C_now
    f = np.einsum("nji,nj->ni", C_now, f_n)
    return f[: len(f) // FINE * FINE], w[: len(w) // FINE * FINE]
