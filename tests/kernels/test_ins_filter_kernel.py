"""The error-state filter, compiled and as plain Python, against its dense twin."""

from __future__ import annotations

import numpy as np
import pytest

import reference
from foucault.kernels import ins_filter as module
from foucault.models.earth import displaced
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate import ins_filter
from foucault.navigate.strapdown import matrix_of
from foucault.plans.manoeuvres import Start
from make_ins import DEG, FLIGHT, errors, increments, made, off, unit
from make_strapdown import packed
from plain_kernels import kernel

NOISE = ImuNoise(accel=TriadNoise(white=1e-4), gyro=TriadNoise(white=1e-6))


def unpacked(x):
    return matrix_of(x[:4]), x[4:7], matrix_of(x[7:11]), x[11]


def case(names, samples, every, latitude=48.0, speed=250.0, seed=3, scale=1.0):
    """A flight with wrong start and sensors, measured by velocity, position, height, or nothing."""
    rng = np.random.default_rng(seed)
    motion, time, state = made(
        FLIGHT, Start(latitude * DEG, 0.3, 900.0, 0.7, 0.05, -0.1, speed), headings="start"
    )
    first = 600
    time = time[first : first + samples]
    truth = motion.trajectory(time)
    log = increments(motion, time)
    sensors = Sensors.of(names)
    sd = scale * np.concatenate([
        [1e-5] * 2, [1e-4], [1e-3] * 3, [0.1] * 3, [unit(n) for n in sensors.layout.names]
    ])  # fmt: skip
    root = np.eye(len(sd)) + 0.3 * rng.standard_normal((len(sd), len(sd))) / np.sqrt(len(sd))
    P0 = sd[:, None] * root @ root.T * sd
    state = off(truth.state(0), sd[:9] * rng.standard_normal(9))
    rows = np.arange(every, samples, every)
    updates = ins_filter.Updates.none(rows)
    shaken = 1e-3 * scale * rng.standard_normal((len(rows), 3))
    updates.velocity_n[:] = truth.velocity_n[rows] + shaken
    d = 0.1 * scale * rng.standard_normal((len(rows), 3))
    place = displaced(truth.latitude[rows], truth.longitude[rows], truth.height[rows], d)
    updates.position[:] = np.stack(place, axis=-1)
    updates.sd[0::4, :3] = 1e-3 * scale
    updates.sd[1::4, 3:] = 0.1 * scale
    updates.sd[2::4, 5] = 0.1 * scale
    updates.sd[0::8, 3:] = 0.1 * scale
    return log, state, sensors, updates, P0


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["compiled", "python"])
@pytest.mark.parametrize(
    ("names", "latitude"),
    [(("gyro", "accel"), 48.0), (("accel.bias.y", "gyro.scale"), 89.0), ((), -30.0),
     (("accel",), -30.0), (("gyro.bias",), 10.0)],
)  # fmt: skip
def test_it_is_the_dense_filter(monkeypatch, form, names, latitude):
    n, every = (200, 13) if form == "compiled" else (24, 4)
    log, state, sensors, updates, P0 = case(names, n, every, latitude)
    monkeypatch.setattr(ins_filter, "ins_filter", kernel(form, module, "ins_filter"))
    estimate = 0.3 * np.array([unit(name) for name in sensors.layout.names])
    walk = {"gyro.bias": 1e-9} if "gyro.bias.x" in sensors.layout else {}
    found = ins_filter.run(
        log, state, sensors, updates, P0, NOISE, estimate=estimate, wander=walk,
        gravity_offset=3e-4,
    )  # fmt: skip
    q = np.zeros(len(P0))
    q[:3], q[3:6] = NOISE.gyro.white**2, NOISE.accel.white**2
    for name, value in walk.items():
        q[9 + sensors.layout.group(name)] = value**2
    epochs = list(zip(updates.rows, updates.velocity_n, updates.position, updates.sd, strict=True))
    end, twin, P, nis = reference.ins_filter(
        log, unpacked(state.packed()), sensors, epochs, P0, q, estimate, 3e-4
    )
    # The kernel adds its transition up to second order in the turn of an interval, 1e-3 rad here.
    sd = np.sqrt(np.diag(P))
    assert np.max(np.abs(found.cov - P) / np.outer(sd, sd)) < 1e-5
    e = errors(found.trajectory.history[-1:], packed(end)[None])[0]
    assert np.max(np.abs(e) / sd[:9]) < 1e-3
    assert np.max(np.abs(found.coefficients[-1] - twin) / sd[9:], initial=0.0) < 1e-3
    np.testing.assert_allclose(found.nis, nis, rtol=0, atol=2e-3)
    assert np.ptp(found.measured) == 6 and not found.measured[3]


@pytest.mark.parametrize("form", ["compiled", "python"])
@pytest.mark.parametrize("held", [False, True])
def test_a_free_run_is_a_filter_to_which_nothing_is_told(monkeypatch, form, held):
    """Epochs of no rows, of some, and of more than are gone through at a time."""
    log, state, sensors, *_ = case(("gyro", "accel.bias", "accel.scale.y"), 120, 13)
    rows = np.array([3, 7, 30, 110])
    estimate = 0.3 * np.array([unit(name) for name in sensors.layout.names])
    told = ins_filter.run(
        log, state, sensors, ins_filter.Updates.none(rows), np.zeros((9 + len(sensors),) * 2),
        ImuNoise(), first=3, estimate=estimate, gravity_offset=3e-4, held=held, keep=True,
    )  # fmt: skip
    monkeypatch.setattr(ins_filter, "transitions_of", kernel(form, module, "transitions_of"))
    wide = np.full((4, 10, 11 + len(sensors)), np.nan)
    free = ins_filter.free_run(log, state, sensors, rows, wide, first=3, estimate=estimate,
                               gravity_offset=3e-4, held=held)  # fmt: skip
    found = wide[:, :9, : 9 + len(sensors)]
    blocks = (4, 3, 3, 9 + len(sensors))  # attitude, velocity and position have units of their own
    size = np.abs(told.transitions).reshape(blocks).max(axis=(0, 2))
    apart = np.abs(found - told.transitions).reshape(blocks).max(axis=(0, 2))
    assert (apart <= 1e-11 * size).all()
    assert not wide[:, :9, 9 + len(sensors) :].any() and np.isnan(wide[:, 9]).all()
    np.testing.assert_array_equal(found[0], np.eye(9, 9 + len(sensors)))
    moved = errors(free.history, told.trajectory.history)
    assert np.abs(moved).max() < 1e-8


@pytest.mark.parametrize("form", ["compiled", "python"])
def test_errors_are_taken_out_again(form):
    """What is left of an error is of its second order."""
    rng = np.random.default_rng(4)
    _, state, *_ = case((), 24, 4, latitude=70.0)
    given = 1e-5 * rng.standard_normal((5, 9)) * np.repeat([1.0, 10.0, 100.0], 3)
    wrong = np.array([off(state, e).packed() for e in given])
    found = kernel(form, module, "corrected")(wrong, given)
    left = errors(found, np.tile(state.packed(), (5, 1)))
    assert np.max(np.abs(left) / np.abs(given).max(axis=0)) < 1e-3
    np.testing.assert_allclose(errors(wrong, np.tile(state.packed(), (5, 1))), given, rtol=1e-3,
                               atol=1e-8)  # fmt: skip
