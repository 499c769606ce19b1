"""Increments without error for strapdown navigation, the true motion by another way, formulas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from foucault.models.earth import (
    EARTH_RATE,
    displacement,
    earth_rate_n,
    east_north_up,
    ecef,
    geodetic,
    gravity,
    gravity_n,
    radii,
)
from foucault.models.rotation import cross_matrix, exp, matrix_of
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State, Trajectory, navigate, quaternion_of

DEG = np.pi / 180
Signal = Callable[[np.ndarray], np.ndarray]
"""Times (m,) to vectors (m, 3)."""


def gathered(w: Signal, f: Signal, time: np.ndarray, points: int = 8) -> Increments:
    """Integrate rate and force over each interval by Gauss and Legendre, exact to rounding.

    The first row is the interval before time[0].
    """
    x, weight = np.polynomial.legendre.leggauss(points)
    start = np.concatenate([[2 * time[0] - time[1]], time[:-1]])
    h = time - start
    at = (start[:, None] + h[:, None] * (x + 1) / 2).ravel()
    total = [
        np.einsum("p,npc,n->nc", weight / 2, signal(at).reshape(len(time), points, 3), h)
        for signal in (w, f)
    ]
    return Increments.of(time, *total)


# -- the true motion, in frame e ---------------------------------------------------------------


def true_state(w: Signal, f: Signal, state: State, start: float, end: float) -> State:
    """Integrate the equations of motion in frame e with a Runge-Kutta method of order 8."""
    earth = cross_matrix(np.array([0.0, 0.0, EARTH_RATE]))
    C_en = east_north_up(state.latitude, state.longitude)
    origin = ecef(state.latitude, state.longitude, state.height)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        C, v, r = y[:9].reshape(3, 3), y[9:12], origin + y[12:]
        L, lon, h = geodetic(r)
        g = east_north_up(L, lon) @ gravity_n(L, h)
        at = np.array([t])
        turn = C @ cross_matrix(w(at)[0]) - earth @ C
        return np.concatenate([turn.ravel(), C @ f(at)[0] + g - 2 * earth @ v, v])

    y = np.concatenate([(C_en @ state.C_nb).ravel(), C_en @ state.velocity_n, np.zeros(3)])
    done = solve_ivp(slope, (start, end), y, "DOP853", rtol=3e-14,
                     atol=np.repeat([1e-15, 1e-12, 1e-10], [9, 3, 3]))  # fmt: skip
    y = done.y[:, -1]
    L, lon, h = (float(q) for q in geodetic(origin + y[12:]))
    C_ne = east_north_up(L, lon).T
    return State(L, lon, h, C_ne @ y[9:12], C_ne @ y[:9].reshape(3, 3))


def errors(found: State, true: State) -> np.ndarray:
    """Errors of attitude [rad], velocity [m/s] and position [m] as lengths, measured in frame e."""
    C = [east_north_up(s.latitude, s.longitude) for s in (found, true)]
    turn = rotation_vector(C[0] @ found.C_nb @ (C[1] @ true.C_nb).T)
    speed = C[0] @ found.velocity_n - C[1] @ true.velocity_n
    away = displacement(true.latitude, true.longitude, true.height,
                        found.latitude, found.longitude, found.height)  # fmt: skip
    return np.array([np.linalg.norm(e) for e in (turn, speed, away)])


def rocking(angle: float, frequency: np.ndarray, phase: np.ndarray, mean: np.ndarray) -> Signal:
    """Rates of axes that rock by an angle each, and turn at a mean rate."""
    return lambda t: mean + angle * frequency * np.cos(np.outer(t, frequency) + phase)


def shaken(C_nb: np.ndarray, size: float, frequency: np.ndarray, phase: np.ndarray) -> Signal:
    """Force that carries the instrument as long as it keeps its attitude, and shakes it."""
    up = C_nb.T @ np.array([0.0, 0.0, gravity(0.8)])
    return lambda t: up + size * np.sin(np.outer(t, frequency) + phase)


def vehicle(
    latitude: float,
    longitude: float,
    height: float,
    velocity_n: np.ndarray,
    *,
    turn: float = 0.0,
    angle: float = 0.3,
) -> tuple[State, Signal, Signal]:
    """A start, and smooth rates and forces: rocking by some degrees, pushes of 3 m/s^2."""
    C_nb = matrix_of(np.arctan2(velocity_n[0], velocity_n[1]), 0.05, -0.1)
    state = State(latitude, longitude, height, velocity_n, C_nb)
    w = rocking(angle, np.array([1.9, 1.1, 2.3]), np.array([0.3, 1.7, 2.9]),
                np.array([0.0, 0.0, turn]))  # fmt: skip
    return state, w, shaken(C_nb, 3.0, np.array([1.3, 2.1, 0.9]), np.array([2.0, 0.4, 1.1]))


VEHICLES = {
    "survey vehicle, turning": vehicle(47 * DEG, 8 * DEG, 500.0, np.array([5.0, 20.0, 0.5]),
                                       turn=0.05),
    "aircraft over the pole": vehicle(89.95 * DEG, 20 * DEG, 1e4, np.array([3.0, 300.0, 0.0])),
    "aircraft over the date line": vehicle(-35 * DEG, 179.97 * DEG, 1e4,
                                           np.array([290.0, -60.0, 4.0])),
    "drone, rocking by a radian": vehicle(10 * DEG, -75 * DEG, 50.0, np.array([4.0, -9.0, 1.0]),
                                          angle=1.0),
}  # fmt: skip


def order_run(name: str, steps: tuple[float, ...], duration: float) -> np.ndarray:
    """Errors of attitude, velocity and position at the end, shape (steps, 3)."""
    state, w, f = VEHICLES[name]
    true = true_state(w, f, state, 0.0, duration)
    out = []
    for dt in steps:
        time = np.arange(round(duration / dt) + 1) * dt
        out.append(errors(navigate(gathered(w, f, time), state).state(-1), true))
    return np.array(out)


# -- at rest -----------------------------------------------------------------------------------


def standing(
    latitude: float,
    duration: float,
    dt: float,
    *,
    C_nb: np.ndarray | None = None,
    height: float = 0.0,
    gyro_n: tuple[float, float, float] = (0.0, 0.0, 0.0),
    accel_n: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Increments, State]:
    """Increments of an instrument that stands still, plus constant errors along east, north, up."""
    C_nb = np.eye(3) if C_nb is None else C_nb
    n = round(duration / dt) + 1
    w_b = C_nb.T @ (earth_rate_n(latitude) + gyro_n)
    f_b = C_nb.T @ (accel_n - gravity_n(latitude, height))
    increments = Increments.of(np.arange(n) * dt, np.tile(w_b * dt, (n, 1)),
                               np.tile(f_b * dt, (n, 1)))  # fmt: skip
    return increments, State.at_rest(C_nb, latitude, height=height)


def disturbed(state: State, tilt: np.ndarray, velocity: np.ndarray) -> State:
    """Return a start with an attitude error phi (C_est = Exp(-phi) C) and a velocity error."""
    return State(state.latitude, state.longitude, state.height, state.velocity_n + velocity,
                 exp(-np.asarray(tilt)) @ state.C_nb)  # fmt: skip


def error_history(run: Trajectory, state: State) -> np.ndarray:
    """phi (E, N, U), velocity (E, N), latitude and longitude errors, shape (m, 7)."""
    phi = np.array([-rotation_vector(C @ state.C_nb.T) for C in run.C_nb])
    return np.column_stack([
        phi, run.velocity_n[:, :2], run.latitude - state.latitude, run.longitude - state.longitude
    ])  # fmt: skip


def static_error_matrix(latitude: float, height: float = 0.0) -> np.ndarray:
    """F of the errors (phi E, N, U; velocity E, N; latitude, longitude) of one that stands still.

    ``phi' = -w_ie x phi + d w_ie + d w_en``, ``dv' = f x phi - 2 w_ie x dv``; height held.
    """
    s, c, t = np.sin(latitude), np.cos(latitude), np.tan(latitude)
    RM, RN = (r + height for r in radii(latitude))
    w, g = EARTH_RATE, gravity(latitude, height)
    F = np.zeros((7, 7))
    F[:3, :3] = -cross_matrix(earth_rate_n(latitude))
    F[0, 4], F[1, 3], F[2, 3] = -1 / RM, 1 / RN, t / RN
    F[1, 5], F[2, 5] = -w * s, w * c
    F[3, 1], F[4, 0] = -g, g
    F[3, 4], F[4, 3] = 2 * w * s, -2 * w * s
    F[5, 4], F[6, 3] = 1 / RM, 1 / (RN * c)
    return F


def schuler_rate(latitude: float) -> float:
    """sqrt(g / R) along the meridian [rad/s]."""
    return float(np.sqrt(gravity(latitude) / radii(latitude)[0]))


def textbook(latitude: float, t: np.ndarray) -> dict[str, tuple[dict, np.ndarray]]:
    """Northward position errors of the books, which leave out the Earth's rotation.

    Name: (arguments of `standing` and `disturbed`, position error north [m]).
    """
    w, R, g = schuler_rate(latitude), radii(latitude)[0], gravity(latitude)
    tilt, speed, push, rate, azimuth = 1e-5, 0.01, 1e-4, 1e-8, 1e-4
    drift = R * (t - np.sin(w * t) / w)
    return {
        "initial tilt about east": ({"tilt": (tilt, 0, 0)}, R * tilt * (1 - np.cos(w * t))),
        "initial velocity north": ({"velocity": (0, speed, 0)}, speed / w * np.sin(w * t)),
        "accelerometer bias north": (
            {"accel_n": (0, push, 0)}, push * R / g * (1 - np.cos(w * t))
        ),
        "gyro bias east": ({"gyro_n": (rate, 0, 0)}, -rate * drift),
        "initial azimuth error": (
            {"tilt": (0, 0, azimuth)}, -azimuth * EARTH_RATE * np.cos(latitude) * drift
        ),
    }  # fmt: skip


def standing_run(
    latitude: float, duration: float, dt: float, *, tilt=(0, 0, 0), velocity=(0, 0, 0), **more
) -> tuple[Trajectory, State]:
    """Navigate one that stands still with errors, height held; also return the truth."""
    increments, state = standing(latitude, duration, dt, **more)
    start = disturbed(state, np.asarray(tilt, float), np.asarray(velocity, float))
    return navigate(increments, start, vertical="held"), state


def swing_direction(run: Trajectory, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Direction in which velocity swings, from east towards north, period by period [rad]."""
    dt = run.time[1] - run.time[0]
    n = round(period / dt)
    z = run.velocity_n[:, 0] + 1j * run.velocity_n[:, 1]
    count = (len(z) - 1) // n
    squares = (z[: count * n] ** 2).reshape(count, n).sum(axis=1)
    middle = run.time[: count * n].reshape(count, n).mean(axis=1)
    return middle, np.unwrap(np.angle(squares)) / 2


# -- coning and sculling -----------------------------------------------------------------------


def coning(angle: float, frequency: float, time: np.ndarray, latitude: float = 0.7):
    """Increments of a cone about x_b while standing, start and true attitude at the end.

    The attitude is the rotation by `angle` about an axis that turns in the y-z plane.
    """
    w = 2 * np.pi * frequency
    earth, up = earth_rate_n(latitude), -gravity_n(latitude)

    def attitude(t):
        zero = np.zeros_like(t)
        return exp(angle * np.stack([zero, np.cos(w * t), np.sin(w * t)], axis=-1))

    def rate(t):
        s = np.sin(angle)
        own = w * np.stack([np.full_like(t, -2 * np.sin(angle / 2) ** 2), -s * np.sin(w * t),
                            s * np.cos(w * t)], axis=-1)  # fmt: skip
        return own + np.einsum("tji,j->ti", attitude(t), earth)

    def force(t):
        return np.einsum("tji,j->ti", attitude(t), up)

    state = State.at_rest(attitude(time[:1])[0], latitude)
    return gathered(rate, force, time), state, attitude(time[-1:])[0]


def sculling(angle: float, push: float, frequency: float, time: np.ndarray, latitude: float = 0.7):
    """Increments of rocking about x_b with a force along y_b in phase; what is felt besides.

    Returns increments, start and the velocity in frame n that the force really gives, of which
    the upward part is ``angle push / 2`` times the duration.
    """
    w = 2 * np.pi * frequency
    earth, up = earth_rate_n(latitude), -gravity_n(latitude)

    def attitude(t):
        zero = np.zeros_like(t)
        return exp(np.stack([angle * np.sin(w * t), zero, zero], axis=-1))

    def rate(t):
        zero = np.zeros_like(t)
        own = np.stack([angle * w * np.cos(w * t), zero, zero], axis=-1)
        return own + np.einsum("tji,j->ti", attitude(t), earth)

    def own_force(t):
        zero = np.zeros_like(t)
        return np.stack([zero, push * np.sin(w * t), zero], axis=-1)

    def force(t):
        return own_force(t) + np.einsum("tji,j->ti", attitude(t), up)

    state = State.at_rest(attitude(time[:1])[0], latitude)
    return gathered(rate, force, time), state, (rate, force)


def residual(x: np.ndarray | float, compensated: bool) -> np.ndarray | float:
    """Part of coning or sculling that is missed, per radian x = 2 pi frequency dt of the cone.

    Of the true ``(x - sin x) / 2`` an algorithm of this and the last sample finds
    ``sin(x) sin(x/2)^2 / 3``: what is left is x^5 / 60 at first.
    """
    return (x - np.sin(x)) / 2 - compensated * np.sin(x) * np.sin(x / 2) ** 2 / 3


def packed(state):
    """Return attitude in l, velocity, C_el and height as the kernels take them, (12,) [SI]."""
    C_lb, v, C_el, h = state
    return np.concatenate([quaternion_of(C_lb), v, quaternion_of(C_el), [h]])
