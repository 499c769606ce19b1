"""What a session on a table hands to the report, where part of it is missing or wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import Status
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER
from foucault.models.noise import grade
from foucault.procedures import norm_observation
from foucault.simulate.hand_rotated import draw_errors

SITE = Site(9.81, np.radians(45.0))
NOISE = grade("tactical").noise
MILLI_G = 9.80665e-3


@pytest.fixture(scope="module")
def log():
    module = norm_observation
    model = draw_errors("tactical", 5)
    return module.simulate(
        module.Session(rows="means"), settings=module.Settings(plan="dodecahedron 20"),
        model=model, noise=NOISE, site=SITE, seed=1, judged=None,
    ).log  # fmt: skip


def calibrate(log, noise=NOISE):
    settings = norm_observation.Settings(plan="dodecahedron 20")
    return norm_observation.calibrate(log, site=SITE, settings=settings, noise=noise)


def test_a_reading_left_out_shows_its_whole_residual(log):
    rest = int(np.flatnonzero(log.table.rate == 0)[4])
    accel = log.accel.copy()
    up = accel[rest] / np.linalg.norm(accel[rest])
    accel[rest] += MILLI_G * up
    table = calibrate(replace(log, accel=accel)).tables["readings"]
    left = np.flatnonzero(table["accel_weight"] < 0.5)
    assert left.tolist() == [rest] and (table["gyro_weight"] > 0.5).all()
    error = (table["norm_after"][rest] - SITE.gravity) / table["norm_sd"][rest]
    assert table["accel_residual"][rest] == pytest.approx(error, rel=0.1)
    assert table["accel_residual"][rest] > 10


def test_rates_after_are_as_close_as_their_sd_says(log):
    table = calibrate(log).tables["readings"]
    spin = table["rate"] != 0
    z = ((table["rate_after"] - table["rate_true"]) / table["rate_sd"])[spin]
    assert np.isnan(table["rate_sd"][~spin]).all()
    assert 0.1 < np.sqrt(np.mean(z**2)) < 1.5


def test_without_gyros_spins_serve_the_accelerometers_and_no_lever_arm(log):
    result = calibrate(replace(log, gyro=None))
    assert result.status is Status.CONVERGED
    assert len(result.tables["rig"]["name"]) == 0
    assert (result.tables["readings"]["rate"] != 0).any()


def test_noise_that_nothing_tells_gives_no_bound(log):
    assert calibrate(log).diagnostics["noise"]["source"] == "declared"
    blind = calibrate(log, noise=None).diagnostics
    assert blind["noise"]["source"].startswith("unknown")
    assert "bound" not in blind and "weakest" not in blind
    assert len(calibrate(log).diagnostics["bound"]) == len(LINEAR_LOWER)
