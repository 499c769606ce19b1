"""The equations of errors against the navigator itself: differences of nonlinear runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from foucault.models.earth import EARTH_RATE, displacement, gravity, radii
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.models.ins_errors import STATES, Sensors, dynamics
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.navigate.ins_filter import Updates, run, sensitivity
from foucault.navigate.strapdown import matrix_of, navigate
from foucault.plans.manoeuvres import Start, Straight, Turn
from make_ins import DEG, FLIGHT, chained, errors, increments, made, off, unit, with_one

STEPS = np.repeat([1e-6, 1e-2, 10.0], 3)


def central(log_of, state, names, rows, **how):
    """Central differences of the navigator: (m, 9, 9 + p), in l."""

    def history(log, start):
        return navigate(log, start, **how).history[rows]

    plain = log_of(None)
    base = history(plain, state)
    columns = []
    for i, step in enumerate(STEPS):
        e = step * np.eye(9)[i]
        pair = (errors(history(plain, off(state, sign * e)), base) for sign in (1, -1))
        columns.append((next(pair) - next(pair)) / (2 * step))
    for name in names:
        step = unit(name)
        models = (with_one(name, sign * step) for sign in (1, -1))
        pair = (errors(history(log_of(m), state), base) for m in models)
        columns.append((next(pair) - next(pair)) / (2 * step))
    return np.stack(columns, axis=-1)


def _sizes(J):
    """Length of the response of psi, dv and dr, (9, n), to compare errors of each part with."""
    size = np.linalg.norm(np.linalg.norm(J, axis=0).reshape(3, 3, -1), axis=1)
    return np.maximum(size.repeat(3, axis=0), 1e-30)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("latitude", "names"),
    [(48.0, LAYOUT.names), (-30.0, LAYOUT.names[::5]), (89.99, LAYOUT.names[2::5])],
)
def test_transitions_are_the_slopes_of_the_navigator(latitude, names):
    """Start errors and every coefficient, at 250 m/s, in turns, climbs and sway."""
    start = Start(latitude * DEG, 0.2, 3000.0, 0.5, 0.05, -0.1, speed=250.0)
    motion, time, state = made(FLIGHT, start, rate=50, headings="start")
    sensors = Sensors.of(names)
    names = sensors.layout.names
    rows = np.array([1500, len(time) - 1])
    slopes = central(
        lambda model: increments(motion, time, model), state, names, rows
    )  # fmt: skip
    found = run(increments(motion, time), state, sensors, Updates.none(rows),
                np.zeros((9 + len(sensors),) * 2), ImuNoise(), keep=True)  # fmt: skip
    got = chained(found.transitions)
    # psi knows nothing of velocity, position and accelerometers: differences leave rounding.
    deaf = np.array([not n.startswith(("attitude", "gyro")) for n in sensors.states.names])
    assert not got[:, :3, deaf].any()
    assert (
        np.max(np.abs(slopes[:, :3, deaf]) * np.append(STEPS, [unit(n) for n in names])[deaf])
        < 1e-12
    )
    off_by = np.abs(got - slopes) / _sizes(slopes)
    # One radius for both directions and height in the gradient of gravity: 2 e^2 of it, and of
    # what it does. The rest: inputs averaged over an interval of 20 ms, and the second order.
    assert np.nanmax(off_by[:, 3:6, 6:9]) < 0.0134
    off_by[:, 3:6, 6:9] = 0.0
    off_by[:, :3, deaf] = 0.0
    worst = np.unravel_index(np.argmax(off_by), off_by.shape)
    assert off_by.max() < 2e-3, ((*STATES.names, *names)[worst[2]], off_by[worst])


def test_transitions_with_the_height_held():
    start = Start(48 * DEG, 0.2, 3000.0, 0.5, speed=250.0)
    plan = [s for s in FLIGHT if isinstance(s, (Straight, Turn))]
    motion, time, state = made(plan, start, rate=50)
    names = ("gyro.bias.x", "accel.bias.z", "accel.scale.x")
    rows = np.array([1000, len(time) - 1])
    slopes = central(lambda m: increments(motion, time, m), state, names, rows, vertical="held")
    sensors = Sensors.of(names)
    found = run(increments(motion, time), state, sensors, Updates.none(rows),
                np.zeros((12, 12)), ImuNoise(), held=True, keep=True)  # fmt: skip
    got = chained(found.transitions)
    order = [*range(9), *(9 + names.index(n) for n in sensors.layout.names)]
    off_by = np.abs(got - slopes[:, :, order]) / _sizes(slopes[:, :, order])
    assert off_by[:, [3, 4, 5, 6, 7, 8]][:, :, [0, 1, 2, 9, 10, 11]].max() < 2e-3
    np.testing.assert_allclose(got[:, 8, 8], 1.0)
    assert np.abs(got[:, 8, :8]).max() == 0.0


@pytest.mark.parametrize("latitude", [48.0, 89.0])
def test_sensitivity_is_what_is_seen_at_the_place(latitude):
    """Heading, velocity and place as people see them, by differences of two runs."""
    start = Start(latitude * DEG, 0.2, 3000.0, 0.5, 0.05, -0.1, speed=250.0)
    motion, time, state = made(FLIGHT, start, rate=50, headings="start")
    log = increments(motion, time)
    rows = np.array([len(time) - 1])
    sensors = Sensors.of(("gyro.bias", "accel.bias"))
    J = sensitivity(log, state, sensors, rows)[0]
    base = navigate(log, state).state(-1)
    for k, name in enumerate(sensors.layout.names):
        step = 1e2 * unit(name)
        end = navigate(increments(motion, time, with_one(name, step)), state).state(-1)
        d = -displacement(end.latitude, end.longitude, end.height,
                          base.latitude, base.longitude, base.height)  # fmt: skip
        # The meridian of the computed place points elsewhere: that is not in J.
        turn = (end.longitude - base.longitude) * np.sin(base.latitude)
        C = exp(np.array([0.0, 0.0, -turn]))
        v = end.velocity_n - C @ base.velocity_n
        scale = np.linalg.norm(J[:, 9 + k].reshape(3, 3), axis=1) * step
        phi = C @ base.C_nb @ end.C_nb.T
        phi = np.array([phi[2, 1] - phi[1, 2], phi[0, 2] - phi[2, 0], phi[1, 0] - phi[0, 1]]) / 2
        seen = np.concatenate([phi, v, d])
        assert np.max(np.abs(J[:, 9 + k] * step - seen) / scale.repeat(3)) < 0.01, name


@pytest.mark.parametrize("names", [LINEAR_LOWER, ("gyro", "accel")])
def test_dynamics_and_the_kernel_are_the_same_equations(names):
    """A, integrated by fine exponentials along the true motion, against the kernel's Phi."""
    start = Start(-30 * DEG, 0.2, 3000.0, 0.5, 0.05, -0.1, speed=250.0)
    motion, time, _ = made(FLIGHT, start, rate=200)
    time = time[3000:3401]
    log, truth = increments(motion, time), motion.trajectory(time)
    sensors = Sensors.of(names)
    n = 9 + len(sensors)
    found = run(log, truth.state(0), sensors, Updates.none(np.array([400])), np.zeros((n, n)),
                ImuNoise(), keep=True)  # fmt: skip
    x = navigate(log, truth.state(0)).history
    middles = (time[1:] + time[:-1]) / 2
    f, w = motion.truth(middles)
    x = (x[1:] + x[:-1]) / 2
    F = np.eye(n)
    for k in range(400):
        C_el = matrix_of(x[k, 7:11] / np.linalg.norm(x[k, 7:11]))
        C_lb = matrix_of(x[k, :4] / np.linalg.norm(x[k, :4]))
        p, v = C_el[2], x[k, 4:7]
        w_el = _transport(p, x[k, 11], v)
        g = gravity(np.arcsin(p[2]), x[k, 11])
        A = dynamics(sensors, C_lb, w[k], f[k], EARTH_RATE * p, w_el,
                     g / (6378137.0 / np.sqrt(1 - 6.69438e-3 * p[2] ** 2) + x[k, 11]))  # fmt: skip
        F = expm(A * (time[k + 1] - time[k])) @ F
    off_by = np.abs(found.transitions[0] - F[:9]) / _sizes(F[None, :9])
    assert off_by[:, 9:].max() < 1e-4
    assert off_by[:, :9].max() < 1e-5


def _transport(p, h, v):
    north = np.array([p[0], p[1], 0.0]) / np.hypot(p[0], p[1])
    east = np.array([north[1], -north[0], 0.0])
    RM, RN = radii(np.arcsin(p[2]))
    return -(v @ north) / (RM + h) * east + (v @ east) / (RN + h) * north
