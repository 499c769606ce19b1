"""The batch of norm observation, compiled and as plain Python, against its obvious twins."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import reference
from foucault.estimate.fleet import STATUS
from foucault.infer.gauss_newton import chi_square_limits
from foucault.kernels import norm_observation as module
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import grade
from foucault.models.turntable import mean_rate
from foucault.plans.directions import table_plan
from foucault.simulate.table import Fleet, Rig, simulate_readings
from plain_kernels import kernel

SITE = Site.at(np.radians(48.8), 60.0)
FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def _batch(form):
    return kernel(form, module, "calibrate_batch")


def _simulated(grade_name, n, *, both=False, plan="icosahedron 12", seed=1, draws=None):
    p = table_plan(plan, spin_rate=np.radians(10.0), rest_time=60.0, turns=4, both_senses=both)
    rng = np.random.default_rng(seed)
    rig = Rig(position_sd=3e-4, mounting=3e-3 * rng.normal(size=(n, 3)),
              lever_arm=0.05 * rng.normal(size=(n, 3)))  # fmt: skip
    fleet = Fleet.draw(grade_name, n, seed)
    return simulate_readings(
        p, models=fleet, noise=grade(grade_name).noise, site=SITE, rig=rig, seed=seed + 1
    ), rig.lever_arm


def _arguments(made, lever_arm=True):
    spin = made.plan.rate != 0
    h = mean_rate(made.plan.rate, SITE.latitude)[spin]
    blocks = [made.accel[:, ~spin], made.accel[:, spin], made.gyro[:, spin]]
    rest, accel, gyro = (np.ascontiguousarray(b) for b in blocks)
    va, vw = made.accel_variance, made.gyro_variance
    return [rest, va[~spin], accel, va[spin], gyro, vw[spin], h, SITE.gravity, lever_arm]


def _values(found):
    Ma, ba, Mg, bg = found[:4]
    i = np.arange(3)
    off = [(a, b) for a in range(3) for b in range(3) if a != b]
    parts = [ba, Ma[:, i, i] - 1, np.stack([Ma[:, 1, 0], Ma[:, 2, 0], Ma[:, 2, 1]], 1)]
    parts += [bg, Mg[:, i, i] - 1, np.stack([Mg[:, a, b] for a, b in off], 1)]
    return np.concatenate(parts, axis=1)


def _unpacked(packed):
    rows, columns = np.tril_indices(21)
    cov = np.zeros((len(packed), 21, 21))
    cov[:, rows, columns] = cov[:, columns, rows] = packed
    return cov


@FORMS
@pytest.mark.parametrize("lever_arm", [True, False])
@pytest.mark.parametrize(("grade_name", "both"), [("mems", False), ("navigation", True)])
def test_values_are_those_of_the_twin(form, grade_name, both, lever_arm):
    made, _ = _simulated(grade_name, 3, both=both)
    rest, va, accel, vf, gyro, vw, h, g, _ = _arguments(made)
    assert both == bool((h < 0).any())
    found = _batch(form)(rest, va, accel, vf, gyro, vw, h, g, lever_arm)
    assert not found[-1].any()
    values = _values(found)
    sd = np.sqrt(np.diagonal(_unpacked(found[5]), axis1=1, axis2=2))
    for i in range(3):
        want, arm = reference.norm_observation(rest[i], accel[i], gyro[i], h, g, lever_arm)
        assert np.max(np.abs(values[i] - want) / sd[i]) < 1e-5
        np.testing.assert_allclose(found[4][i], arm, rtol=0, atol=1e-7)


@cache
def _moved(grade_name, both, lever_arm):
    """Readings of unlike noise, and the covariance by moving each of them."""
    made, _ = _simulated(grade_name, 1, both=both)
    rest, va, accel, vf, gyro, vw, h, g, _ = _arguments(made)
    va, vw = va * np.linspace(0.5, 2, len(va)), vw * np.linspace(2, 0.5, len(vw))
    blocks = [rest[0], accel[0], gyro[0]]
    cov = reference.norm_observation_covariance(
        blocks, [va, vf, vw], [1e-4, 1e-4, 1e-6], h, g, lever_arm
    )
    return (rest, va, accel, vf, gyro, vw, h, g, lever_arm), cov


@pytest.mark.thorough
@FORMS
@pytest.mark.parametrize("lever_arm", [True, False])
@pytest.mark.parametrize(("grade_name", "both"), [("mems", False), ("navigation", True)])
def test_covariance_is_that_of_moving_every_reading(form, grade_name, both, lever_arm):
    readings, cov = _moved(grade_name, both, lever_arm)
    found = _batch(form)(*readings)
    sd = np.sqrt(np.diag(cov))
    got = np.zeros((24, 24))
    got[:21, :21] = _unpacked(found[5])[0]
    n = 24 if lever_arm else 21
    got[21:, 21:] = found[6][0]
    got[21:, :21], got[:21, 21:] = cov[21:, :21], cov[:21, 21:]  # is not returned
    scaled = (got - cov)[:n, :n] / np.outer(sd[:n], sd[:n])
    # First-order propagation at readings with noise: residuals times curvature are left out.
    assert np.max(np.abs(scaled)) < 3e-3
    if not lever_arm:
        assert not found[6].any()


@FORMS
def test_without_noise_the_truth_comes_back(form):
    made, arm = _simulated("mems", 2)
    made = simulate_readings(
        made.plan, models=made.fleet, noise=type(grade("mems").noise)(), site=SITE,
        rig=Rig(mounting=np.array([0.01, -0.02, 0.03]), lever_arm=arm),
    )  # fmt: skip
    args = _arguments(made)
    args[1], args[3], args[5] = np.full(12, 1e-8), np.full(12, 1e-8), np.full(12, 1e-12)
    found = _batch(form)(*args)
    np.testing.assert_allclose(_values(found), made.fleet.values(LINEAR_LOWER), rtol=0, atol=3e-13)
    np.testing.assert_allclose(found[4], arm, rtol=0, atol=1e-10)


@FORMS
def test_a_broken_instrument_is_a_status_and_touches_no_other(form):
    made, _ = _simulated("mems", 5)
    args = _arguments(made)
    alone = _batch("compiled")(*args)
    args[0][1, 3, 2] = np.nan
    args[4][2, 0, 0] = np.inf
    args[2][3, 5, 1] = np.nan
    with np.errstate(all="ignore"):
        found = _batch(form)(*args)
    status = found[-1]
    assert status[0] == status[4] == 0 and (status[1:4] != 0).all()
    for k in (0, 4):
        np.testing.assert_allclose(_values(found)[k], _values(alone)[k], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found[5][k], alone[5][k], rtol=1e-7, atol=1e-30)


@FORMS
def test_a_plan_that_cannot_tell_is_singular(form):
    made, _ = _simulated("mems", 2, plan="26")
    corners = np.abs(np.abs(made.direction[0]) - 3**-0.5).max(axis=1) < 0.1
    args = _arguments(made)
    rests = corners[made.plan.rate == 0]
    args[0], args[1] = np.ascontiguousarray(args[0][:, rests]), args[1][rests]
    assert rests.sum() == 8  # fewer than nine
    assert (_batch(form)(*args)[-1] == STATUS.index("singular")).all()
    twice = [np.repeat(args[0], 2, axis=1), np.repeat(args[1], 2)]
    # Sixteen readings in eight directions, free of noise: their squares are all alike.
    exact = np.repeat(made.direction[:, corners & (made.plan.rate == 0)], 2, axis=1)
    nominal = np.sign(exact) / np.sqrt(3.0) * SITE.gravity
    args[:2] = [np.ascontiguousarray(nominal), twice[1]]
    assert (_batch(form)(*args)[-1] == STATUS.index("singular")).all()


@FORMS
def test_readings_that_lie_on_no_ellipsoid(form):
    made, _ = _simulated("mems", 1)
    args = _arguments(made)
    x = args[0][0]
    up = x / np.linalg.norm(x, axis=1, keepdims=True)
    # On the hyperboloid x^2 + y^2 - z^2 / 4 = 1 instead.
    size = 1 / np.sqrt(np.abs(up[:, 0] ** 2 + up[:, 1] ** 2 - up[:, 2] ** 2 / 4))
    sheet = (up[:, 0] ** 2 + up[:, 1] ** 2 > up[:, 2] ** 2 / 4).sum()
    assert sheet >= 9
    args[0] = (up * size[:, None] * SITE.gravity)[None]
    with np.errstate(all="ignore"):
        assert _batch(form)(*args)[-1][0] in (
            STATUS.index("no ellipsoid"),
            STATUS.index("not finite"),
        )


@pytest.mark.thorough
@pytest.mark.parametrize(("grade_name", "both"), [("mems", False), ("navigation", True)])
def test_the_covariance_is_right_in_five_thousand_draws(grade_name, both):
    n = 5000
    made, arm = _simulated(grade_name, n, both=both, seed=20)
    found = module.calibrate_batch(*_arguments(made))
    assert not found[-1].any()
    truth = made.fleet.values(LINEAR_LOWER)
    e = _values(found) - truth
    cov = _unpacked(found[5])
    sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    correlation = cov / (sd[:, :, None] * sd[:, None, :])
    z = e / sd
    nees = np.einsum("ni,ni->n", z, np.linalg.solve(correlation, z[:, :, None])[:, :, 0])
    low, high = chi_square_limits(21 * n)
    assert low < nees.sum() < high
    assert not low < nees.sum() * 1.1**2 < high and not low < nees.sum() / 1.1**2 < high
    low, high = chi_square_limits(n, tests=42)
    assert ((z**2).sum(axis=0) > low).all() and ((z**2).sum(axis=0) < high).all()
    r = found[4] - arm
    squares = np.einsum("ni,ni->", r, np.linalg.solve(found[6], r[:, :, None])[:, :, 0])
    low, high = chi_square_limits(3 * n)
    assert low < squares < high
