"""The batch as the rest of the package sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.estimate import fleet
from foucault.estimate.fleet import FleetReadings
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import grade
from foucault.models.turntable import mean_rate
from foucault.plans.directions import table_plan
from foucault.simulate.table import Fleet, simulate_readings
from refusals import refuses

SITE = Site.at(np.radians(48.8), 60.0)


def _made(n, plan="dodecahedron 20", seed=3):
    p = table_plan(plan, spin_rate=np.radians(10.0), rest_time=60.0, turns=4)
    models = Fleet.draw("tactical", n, seed)
    return simulate_readings(
        p, models=models, noise=grade("tactical").noise, site=SITE, seed=seed + 1
    )


def _readings(made):
    spin = made.plan.rate != 0
    return FleetReadings(
        made.accel[:, ~spin], made.accel[:, spin], made.gyro[:, spin],
        made.accel_variance[None, ~spin], made.accel_variance[None, spin],
        made.gyro_variance[None, spin], mean_rate(made.plan.rate, SITE.latitude)[spin],
        SITE.gravity,
    )  # fmt: skip


def test_names_and_units_are_in_the_order_of_the_model():
    made = _made(1)
    quiet = simulate_readings(
        made.plan, models=Fleet.draw("mems", 4, 8), noise=type(grade("mems").noise)(), site=SITE
    )
    readings = _readings(quiet)
    readings = replace(readings, gyro_variance=np.full((1, 20), 1e-12))
    found = fleet.calibrate(replace(
        readings, rest_variance=np.full((1, 20), 1e-8), accel_variance=np.full((1, 20), 1e-8)
    ))  # fmt: skip
    truth = quiet.fleet.values(LINEAR_LOWER)
    np.testing.assert_allclose(found.values, truth, rtol=0, atol=1e-12)
    assert found.coefficients(2).value("gyro.misalignment.yz") == pytest.approx(
        truth[2, LINEAR_LOWER.index("gyro.misalignment.yz")], abs=1e-12
    )
    cov = found.cov(1)
    np.testing.assert_array_equal(cov, cov.T)
    np.testing.assert_array_equal(np.sqrt(np.diag(cov)), found.sd[1])
    assert np.linalg.eigvalsh(cov / np.outer(found.sd[1], found.sd[1]))[0] > 0


def test_chi_square_and_noise_are_those_of_the_readings():
    n = 2000
    made = _made(n)
    found = fleet.calibrate(_readings(made))
    assert found.redundancy.tolist() == [11.0, 11.0]
    low, high = chi_square_limits(11 * n, tests=2)
    assert ((found.chi_square.sum(axis=0) > low) & (found.chi_square.sum(axis=0) < high)).all()
    true = np.sqrt([made.accel_variance[0], made.gyro_variance[-1]])
    rms = np.sqrt(np.mean(found.noise**2, axis=0))
    np.testing.assert_allclose(rms, true, rtol=0.02)
    assert {fleet.STATUS[k] for k in found.status} == {"solved"}


def test_four_times_the_variance_is_a_quarter_of_chi_square_and_twice_the_sd():
    readings = _readings(_made(3))
    one = fleet.calibrate(readings)
    four = fleet.calibrate(readings.with_variance_times(np.full(1, 4.0), np.full(1, 4.0)))
    np.testing.assert_array_equal(four.values, one.values)
    np.testing.assert_allclose(four.chi_square, one.chi_square / 4, rtol=1e-12)
    np.testing.assert_allclose(four.sd, 2 * one.sd, rtol=1e-12)
    np.testing.assert_allclose(four.noise, one.noise, rtol=1e-12)


def test_each_instrument_may_have_its_own_noise():
    readings = _readings(_made(4))
    factor = np.array([1.0, 9.0, 1.0, 4.0])
    mixed = fleet.calibrate(readings.with_variance_times(factor, factor))
    one = fleet.calibrate(readings)
    np.testing.assert_array_equal(mixed.values, one.values)
    np.testing.assert_allclose(mixed.sd, one.sd * np.sqrt(factor)[:, None], rtol=1e-12)
    np.testing.assert_allclose(mixed.chi_square, one.chi_square / factor[:, None], rtol=1e-12)
    some = np.array([False, True, True, False])
    part = fleet.calibrate(readings.with_variance_times(factor, factor)[some])
    np.testing.assert_array_equal(part.packed, mixed.packed[some])


def test_a_broken_instrument_has_words_and_no_numbers():
    readings = _readings(_made(4))
    readings.rest[1, 0, 0] = np.nan
    readings.gyro[2, :] = readings.gyro[2, :1]  # does not respond
    found = fleet.calibrate(readings)
    words = [fleet.STATUS[k] for k in found.status]
    assert words == ["solved", "not finite", "singular", "solved"]
    assert found.solved.tolist() == [True, False, False, True]
    for k in (1, 2):
        assert np.isnan(found.values[k]).all() and np.isnan(found.packed[k]).all()
        assert np.isnan(found.lever_arm[k]).all() and np.isnan(found.chi_square[k]).all()
    assert np.isfinite(found.values[[0, 3]]).all() and np.isfinite(found.sd[[0, 3]]).all()


def test_nine_positions_leave_nothing_redundant():
    made = _readings(_made(2))
    nine = [3, 6, 7, 8, 9, 12, 15, 16, 17]  # a well-conditioned choice
    found = fleet.calibrate(FleetReadings(
        made.rest[:, nine], made.accel, made.gyro, made.rest_variance[:, nine],
        made.accel_variance, made.gyro_variance, made.rate, made.gravity,
    ))  # fmt: skip
    assert found.redundancy.tolist() == [0.0, 11.0]
    assert found.solved.all() and np.isnan(found.noise[:, 0]).all()
    assert np.isnan(found.ratio[:, 0]).all() and np.isfinite(found.ratio[:, 1]).all()


def test_arrays_that_do_not_belong_together_are_refused():
    readings = _readings(_made(2))
    with refuses("fleet.shape", match=r"'gyro' has shape \(2, 19, 3\)"):
        fleet.calibrate(replace(readings, gyro=readings.gyro[:, 1:]))
    with pytest.raises(FoucaultError, match="rest_variance"):
        fleet.calibrate(replace(readings, rest_variance=np.ones((3, 20))))
