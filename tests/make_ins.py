"""Runs of a navigator for tests: errors between two runs, steps, and what a plan makes."""

from __future__ import annotations

import numpy as np

from foucault.models.earth import EARTH_RATE, displaced, east_north_up, ecef, gravity_n
from foucault.models.imu import ImuModel, coefficient_slot
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp, log
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import Updates
from foucault.navigate.strapdown import State, matrix_of, states_of
from foucault.plans.manoeuvres import Climb, Plan, Rest, Rotate, Start, Straight, STurn, Sway, Turn
from foucault.simulate.motion import Motion, motion_of

DEG = np.pi / 180

SITE = (50 * DEG, 0.2, 100.0)
"""Latitude, longitude [rad] and height [m] where instruments stand."""

FLIGHT: Plan = [
    Straight(5.0), Turn(70 * DEG, 15.0), Climb(10.0, height=100.0), STurn(40 * DEG, 20.0),
    Sway(10.0, 3.0, (2 * DEG, 3 * DEG, 4 * DEG), (0.5, 0.5, 0.5), tones=3),
    Turn(-100 * DEG, 20.0),
]  # fmt: skip

UNITS = {"bias": 1e-7, "scale": 1e-5, "misalignment": 1e-5, "asymmetry": 1e-5, "cubic": 1e-5,
         "quadratic": 1e-6, "cross": 1e-6, "g_sensitivity": 1e-8, "deflection": 1e-6}  # fmt: skip
"""Sizes of coefficients at which a run stays linear [SI]."""


def unit(name: str) -> float:
    return 1e-5 if name.startswith("accel.bias") else UNITS[name.split(".")[1]]


def with_one(name: str, value: float) -> ImuModel:
    """Return an instrument with one error."""
    model = ImuModel()
    block, where = coefficient_slot(name)
    getattr(model, block)[where] += value
    return model


class Ridden(Motion):
    """A motion that remembers what was felt: many instruments go the same way."""

    def truth(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        kept, key = self.__dict__.setdefault("_kept", {}), time.tobytes()
        if key not in kept:
            kept[key] = super().truth(time)
        return kept[key]


def made(
    plan: Plan, start: Start, rate: float = 100.0, **how: str
) -> tuple[Motion, np.ndarray, State]:
    """Return the motion, the times of its samples and the true state at the first."""
    motion, _ = motion_of(plan, start, **how)
    motion = Ridden(motion.pieces, motion.path, motion.gravity_offset)
    time = np.arange(round(motion.end * rate) + 1) / rate
    return motion, time, motion.trajectory(time[:1]).state(0)


def increments(
    motion: Motion, time: np.ndarray, model: ImuModel | None = None, noise=None, rng=None
) -> Increments:
    """Return what an instrument says, with white noise where asked for."""
    dt = time[1] - time[0]
    reading = None if model is None else model.measure
    dtheta, dvel = motion.increments(np.append(time[0] - dt, time), reading)
    if noise is not None:
        dtheta = dtheta + noise.gyro.white * np.sqrt(dt) * rng.standard_normal(dtheta.shape)
        dvel = dvel + noise.accel.white * np.sqrt(dt) * rng.standard_normal(dvel.shape)
    return Increments.of(time, dtheta, dvel)


def errors(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return psi, dv and dr, shape (m, 9), of states (m, 12), in frame l of the estimate."""
    C_el, C_et = matrix_of(estimate[:, 7:11]), matrix_of(truth[:, 7:11])
    C_eb, C_tb = C_el @ matrix_of(estimate[:, :4]), C_et @ matrix_of(truth[:, :4])
    psi_e = -log(C_eb @ np.swapaxes(C_tb, 1, 2))
    v_e = np.einsum("kij,kj->ki", C_el, estimate[:, 4:7])
    v_e -= np.einsum("kij,kj->ki", C_et, truth[:, 4:7])
    r_e = points(estimate) - points(truth)
    back = [np.einsum("kji,kj->ki", C_el, x) for x in (psi_e, v_e, r_e)]
    return np.concatenate(back, axis=1)


def points(x: np.ndarray) -> np.ndarray:
    found = states_of(x)
    return ecef(found["latitude"], found["longitude"], found["height"])


def off(state: State, e: np.ndarray) -> State:
    """Return a state that is wrong by psi, dv, dr, shape (9,)."""
    place = displaced(state.latitude, state.longitude, state.height, e[6:9])
    C = east_north_up(*place[:2]).T @ east_north_up(state.latitude, state.longitude)
    return State(
        float(place[0]), float(place[1]), float(place[2]), C @ (state.velocity_n + e[3:6]),
        C @ exp(-e[:3]) @ state.C_nb,
    )  # fmt: skip


def tumble(rest: float, rate: float = 2.0, turns: int = 12) -> Plan:
    """Return rests and quarter turns about all axes in both senses: every coefficient shows."""
    order = (("x", 1), ("y", 1), ("z", 1), ("x", 1), ("z", -1), ("y", -1), ("z", 1), ("y", 1),
             ("x", -1), ("y", 1), ("z", -1), ("x", -1))  # fmt: skip
    plan: Plan = [Rest(rest)]
    for axis, sense in order[:turns]:
        plan = [*plan, Rotate(axis, sense * 90 * DEG, rate), Rest(rest)]
    return plan


def at_rest(length, *, rate=20, model=None, noise=None, seed=0):
    """Increments of an instrument that stands still, and its true state."""
    state = State.at_rest(np.eye(3), *SITE)
    n = length * rate + 1
    w = EARTH_RATE * np.array([0.0, np.cos(SITE[0]), np.sin(SITE[0])])
    accel, gyro = (model or ImuModel()).measure(-gravity_n(SITE[0], SITE[2]), w)
    rng, noise = np.random.default_rng(seed), noise or ImuNoise()
    root = 1 / np.sqrt(rate)
    dtheta = gyro / rate + noise.gyro.white * root * rng.standard_normal((n, 3))
    dvel = accel / rate + noise.accel.white * root * rng.standard_normal((n, 3))
    return Increments.of(np.arange(n) / rate, dtheta, dvel), state


def still(rows, velocity_sd, position_sd, rng=None):
    """Zero velocity and the site as measurements, with the scatter that they say."""
    updates = Updates.at_rest(rows, velocity_sd=velocity_sd, position=SITE, position_sd=position_sd)
    if rng is not None:
        updates.velocity_n[:] = velocity_sd * rng.standard_normal((len(rows), 3))
        d = position_sd * rng.standard_normal((len(rows), 3))
        updates.position[:] = np.stack(displaced(*SITE, d), axis=-1)
    return updates


def chained(transitions: np.ndarray) -> np.ndarray:
    """Return the transitions from the start to each epoch, of those from one to the next."""
    total, out = np.eye(*transitions.shape[1:]), []
    for Phi in transitions:
        total = Phi[:, :9] @ total
        total[:, 9:] += Phi[:, 9:]
        out.append(total)
    return np.array(out)
