"""What a calibration on a table says of itself: every check, and the words it uses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.table import checks, detectable, name_of, readings_table, rig_table
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.layouts import with_references
from make_table import ACCEL_NAMES, ARCSEC, SITE, fitted, plan_of, simulated, trusting

MILLI = 9.81e-3


def readings(plan="icosahedron 12", spins=True, **more):
    r = simulated(plan_of(plan, spins), position=5 * ARCSEC, **more).readings(0)
    return r if spins else replace(r, gyro=None)


def evidence(r, trust=None, **options):
    names = ACCEL_NAMES if r.gyro is None else LINEAR_LOWER
    return fitted(r, trust, names, **options)


def found(e):
    return {c.name: c for c in checks(e)}


def up(r, k):
    return r.accel[k] / np.linalg.norm(r.accel[k])


def test_a_clean_session_passes_every_check():
    got = found(evidence(readings()))
    assert all(c.passed for c in got.values())
    assert got["outliers"].sentence == "No reading differs from the others by more than chance."
    words = got["noise of specific force at rest"].sentence
    assert "times what the noise says" in words


@pytest.mark.parametrize("trust", [None, trusting(5 * ARCSEC, 5 * ARCSEC)])
def test_a_gyro_bias_that_moved_between_rests_and_spins_is_told(trust):
    r = readings()
    moved = r.gyro + np.where(r.spin[:, None], 20 * ARCSEC, 0.0) * [0.0, 1.0, 0.0]
    told, before = (found(evidence(x, trust))["gyro bias at rest"]
                    for x in (replace(r, gyro=moved), r))  # fmt: skip
    assert before.passed
    assert before.sentence.startswith("The gyros have the same bias at rest as in spins")
    assert not told.passed
    assert "At rest gyro.bias.y is -" in told.sentence
    assert "What is stated is that of the spins" in told.sentence


def test_twelve_rests_say_that_a_wrong_one_could_not_have_been_named():
    e = evidence(readings(spins=False))
    words = found(e)["control of the rests"].sentence
    assert "could not have been named: 12 of 12 positions look like another" in words
    worst = detectable(e).max() / 9.80665e-6
    assert f"from {worst:.0f} ug on" in words
    # 30 ug/sqrt(Hz) over a minute, a quarter of it redundant.
    assert worst == pytest.approx(4.13 * 2 * 30 / np.sqrt(60), rel=0.01)


def test_twenty_rests_would_have_named_it():
    words = found(evidence(readings("dodecahedron 20", spins=False)))["control of the rests"]
    assert "noticed and named from" in words.sentence


@pytest.mark.parametrize("plan", ["dodecahedron 20", "26 faces, edges and corners"])
def test_a_milli_g_is_named_with_rest_and_time(plan):
    r = readings(plan, spins=False)
    r.accel[6] += MILLI * up(r, 6)
    c = found(evidence(r))["outliers"]
    assert c.passed
    assert c.sentence == "Left out as wrong: specific force of rest 7 (360 s)."


def test_a_milli_g_in_one_of_twelve_is_one_of_two():
    r = readings(spins=False)
    r.accel[6] += MILLI * up(r, 6)
    c = found(evidence(r))["outliers"]
    assert not c.passed
    assert "specific force of rest 7 (360 s)" in c.sentence
    assert c.sentence.startswith("One of these readings is wrong")
    assert "None was left out" in c.sentence


def loud(declared, factor=3.0):
    r = readings("26 faces, edges and corners", spins=False)
    noise = np.random.default_rng(3).normal(size=r.accel.shape)
    sd = np.sqrt(r.accel_cov[0, 0, 0])
    return replace(r, accel=r.accel + np.sqrt(factor**2 - 1) * sd * noise, declared=declared)


def test_declared_noise_that_is_too_small_fails():
    c = found(evidence(loud(True)))["noise of specific force at rest"]
    assert not c.passed
    assert "the declared noise is too small. The uncertainties include the scatter" in c.sentence


def test_measured_noise_that_is_too_small_is_made_up_for():
    got = found(evidence(loud(False)))
    c = got["noise of specific force at rest"]
    assert c.passed
    assert "the scatter was estimated" in c.sentence
    assert got["scatter of specific force [ug]"].passed


def test_scatter_left_out_is_said():
    c = found(evidence(loud(False), repeatability=False))["noise of specific force at rest"]
    assert not c.passed
    assert "the uncertainties do not know it" in c.sentence


def test_declared_noise_that_is_too_large_fails():
    r = readings("26 faces, edges and corners", spins=False)
    c = found(evidence(replace(r, accel_cov=9 * r.accel_cov)))["noise of specific force at rest"]
    assert not c.passed
    assert "the noise is overstated" in c.sentence
    assert found(evidence(replace(r, accel_cov=9 * r.accel_cov, declared=False)))[
        "noise of specific force at rest"
    ].passed


def test_readings_that_do_not_belong_together_are_unusable():
    r = readings("26 faces, edges and corners", spins=False)
    wild = 0.1 * np.random.default_rng(3).normal(size=r.accel.shape)
    c = found(evidence(replace(r, accel=r.accel + wild, declared=False)))
    assert not c["scatter of specific force [ug]"].passed
    assert "do not belong together" in c["scatter of specific force [ug]"].sentence


def test_a_table_worse_than_declared_is_seen():
    s = simulated(plan_of(), position=300 * ARCSEC, noise="navigation")
    good = found(evidence(s.readings(0), trusting(300 * ARCSEC, 300 * ARCSEC)))
    assert good["errors of the table"].passed
    bad = found(evidence(s.readings(0), trusting(60 * ARCSEC, 60 * ARCSEC)))
    assert not bad["errors of the table"].passed
    assert "worse than it was said to be" in bad["errors of the table"].sentence


def test_names_count_rests_and_spins_apart():
    r, n = readings(), 24
    assert name_of(r, 0) == "specific force of rest 1 (0 s)"
    assert name_of(r, 12) == "specific force of spin 1 (720 s)"
    assert name_of(r, n + 13) == "rate of spin 2 (900 s)"


def test_tables_hold_true_norms_and_what_was_found():
    r = readings(lever_arm=0.3)
    e = evidence(r, trusting(5 * ARCSEC, 5 * ARCSEC))
    table = readings_table(e)
    off = (table["norm_after"] - SITE.gravity) / table["norm_sd"]
    assert np.abs(off).max() < 5
    rest = ~r.spin
    assert np.isnan(table["rate_after"][rest]).all()
    assert np.abs((table["rate_after"] - table["rate_true"]) / table["rate_sd"])[r.spin].max() < 5
    rig = rig_table(e)
    assert list(rig["name"][:6]) == [
        "lever_arm.x", "lever_arm.y", "lever_arm.z", "mounting.x", "mounting.y", "mounting.z",
    ]  # fmt: skip
    arm = e.estimate.state.lever_arm
    np.testing.assert_allclose(rig["value"][:3], arm)
    assert (rig["sd"] > 0).all()
    assert "table.heading" in rig["name"]
    assert np.isinf(rig["prior_sd"][rig["name"] == "table.heading"]).all()


def test_gravity_and_rate_of_the_table_are_in_the_covariance():
    e = evidence(readings())
    c = e.estimate.coefficients
    site = replace(SITE, gravity_sd=1e-3)
    more = with_references(c, site, 1e-4)
    extra = np.diag(more.cov - c.cov)
    model = ImuModel.from_coefficients(c)
    for i, name in enumerate(c.names):
        wanted = 0.0
        if name.startswith("accel.scale"):
            k = "xyz".index(name[-1])
            wanted = (model.accel_matrix[k, k] * 1e-3 / 9.81) ** 2
        if name.startswith("gyro.scale"):
            k = "xyz".index(name[-1])
            wanted = (model.gyro_matrix[k, k] * 1e-4) ** 2
        if "misalignment" not in name:
            assert extra[i] == pytest.approx(wanted, rel=1e-6, abs=1e-22), name
