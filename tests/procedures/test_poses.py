"""A table of means, one row per pose: what it shows, and with which uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.procedures import hand_rotated, norm_observation
from foucault.procedures.hand_rotated import Settings
from foucault.result import Level
from foucault.tables import Log

SITE = Site(9.8093, np.radians(48.8), 60.0, gravity_sd=0.0)
MEAN = 10.0
ACCEL, GYRO = 3e-4, 2e-5
"""Noise of a mean [m/s^2] and [rad/s]."""
NOISE = ImuNoise(TriadNoise(white=ACCEL * MEAN**0.5), TriadNoise(white=GYRO * MEAN**0.5))
SHOWN = tuple(n for n in LINEAR_LOWER if n.startswith(("accel.", "gyro.bias")))


def poses(seed=0, n=24, gyro=GYRO, slope=3e-3):
    """Means over poses in any attitude and heading, and the instrument that they are of."""
    rng = np.random.default_rng(seed)
    C_bn = Rotation.random(n, rng=rng).as_matrix()
    sizes = {"accel.bias": 0.05, "gyro.bias": 0.01, "gyro.scale": slope, "gyro.misalignment": slope}
    errors = {n: rng.normal(0, sizes.get(n[: n.rindex(".")], 3e-3)) for n in LINEAR_LOWER}
    vector = ImuModel().coefficients(LINEAR_LOWER)
    model = ImuModel.from_coefficients(vector.with_values(errors))
    accel, rate = model.measure(SITE.gravity * C_bn[:, :, 2], C_bn @ earth_rate_n(SITE.latitude))
    log = Log(
        60.0 * np.arange(n), rate + rng.normal(0, gyro, (n, 3)),
        accel + rng.normal(0, ACCEL, (n, 3)), averaged=np.full(n, MEAN),
    )  # fmt: skip
    return log, model.coefficients(SHOWN).values


def nees(result, truth):
    miss = result.coefficients.values - truth
    return float(miss @ np.linalg.solve(result.coefficients.cov, miss))


def test_means_of_poses_calibrate_accelerometers_and_gyro_bias():
    log, truth = poses()
    result = hand_rotated.calibrate(log, site=SITE, noise=NOISE)
    assert result.procedure == "hand_rotated"
    assert result.coefficients.names == SHOWN
    assert nees(result, truth) < chi_square_limits(len(SHOWN))[1]
    assert result.verdict.level is Level.PASS
    assert len(result.diagnostics["bound"]) == len(SHOWN)
    assert {"gyro noise", "unknown heading"} < set(result.diagnostics["budget"])
    assert {"noise of angular rate at rest", "held-out readings"} < {c.name for c in result.checks}
    assert any("do not hold the turns" in words for words in result.diagnostics["unseen"])
    assert not any("rate of the table" in words for words in result.diagnostics["unseen"])


def test_means_of_poses_agree_with_norm_observation():
    log, _ = poses(1)
    for noise in (NOISE, None):
        ours = hand_rotated.calibrate(log, site=SITE, noise=noise).coefficients["accel"]
        theirs = norm_observation.calibrate(log, site=SITE, noise=noise).coefficients["accel"]
        sd = np.sqrt(np.diag(theirs.cov))
        assert np.abs((ours.values - theirs.values) / sd).max() < 0.01
        np.testing.assert_allclose(np.sqrt(np.diag(ours.cov)), sd, rtol=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize(("gyro", "slope"), [(1e-7, 0.0), (5e-7, 3e-3), (GYRO, 3e-3), (5e-4, 3e-3)])
@pytest.mark.parametrize("declared", [True, False])
def test_uncertainties_of_means_of_poses_are_true(gyro, slope, declared):
    """The quietest gyros show scale factor errors of 0.3 % of the Earth's rate: they have none."""
    noise = replace(NOISE, gyro=TriadNoise(white=gyro * MEAN**0.5)) if declared else None
    total, count = {"accel": 0.0, "gyro": 0.0}, 60
    for seed in range(count):
        log, truth = poses(100 + seed, gyro=gyro, slope=slope)
        found = hand_rotated.calibrate(log, site=SITE, noise=noise).coefficients
        for triad in total:
            mine = [n.startswith(triad) for n in SHOWN]
            miss = (found.values - truth)[mine]
            total[triad] += miss @ np.linalg.solve(found.cov[np.ix_(mine, mine)], miss)
    for triad, n in (("accel", 9), ("gyro", 3)):
        low, high = chi_square_limits(n * count, tests=12)
        # Of Student's distribution the sum scatters more than chi-square; its mean is the same.
        assert low * (1 if declared else 0.85) < total[triad] < high * (1 if declared else 1.2)


def test_a_wrong_row_among_means_of_poses_is_left_out_and_named():
    log, truth = poses(2)
    wrong = log.accel.copy()
    wrong[7] *= 1.01
    result = hand_rotated.calibrate(replace(log, accel=wrong), site=SITE)
    assert result.tables["readings"]["weight"][7] < 0.5
    assert nees(result, truth) < chi_square_limits(len(SHOWN))[1]


def test_means_of_poses_without_gyros_or_latitude():
    log, _ = poses(3)
    alone = hand_rotated.calibrate(replace(log, gyro=None), site=SITE)
    assert all(n.startswith("accel.") for n in alone.coefficients.names)
    assert "session.no_gyro" in [f.code for f in alone.findings]
    unknown = hand_rotated.calibrate(log, site=replace(SITE, latitude=None))
    assert "session.no_latitude" in [f.code for f in unknown.findings]
    assert "unknown Earth rate" in unknown.diagnostics["budget"]
    told = {"gyro.bias.x": (0.0, 1e-9)}
    known = hand_rotated.calibrate(log, site=SITE, noise=NOISE, prior=told).coefficients
    assert known.sd[known.names.index("gyro.bias.x")] < 1.01e-9
    chosen = Settings(accel_quadratic=True, g_sensitivity=True)
    more = hand_rotated.calibrate(log, site=SITE, settings=chosen).coefficients
    assert "accel.quadratic.z" in more.names and "gyro.bias.z" in more.names


def test_too_few_means_of_poses():
    with pytest.raises(FoucaultError, match="8 rests"):
        hand_rotated.calibrate(poses(n=8)[0], site=SITE)
