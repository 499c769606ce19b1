"""What can be wrong with a session on a rate table, and what is said of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.rate_table import Commanded, name_of, rate_steps
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.procedures.rate_table import Settings, from_readings
from make_rates import ALL, LATITUDE, SPEEDS, make_readings, make_steps, up_of
from refusals import refuses
from sessions import codes

SITE = Site(9.81, LATITUDE)
MODEL = ImuModel(
    np.eye(3), np.array([0.3, -0.2, 0.1]),
    gyro_matrix=np.eye(3) + 0.01 * np.array([[1, 0.5, -0.3], [0.2, -1, 0.4], [-0.6, 0.1, 0.8]]),
    gyro_bias=np.radians([0.4, -0.3, 0.2]),
)  # fmt: skip
STEPS = make_steps(MODEL)
NONE = Commanded(np.empty(0))
GIVEN = Commanded(SPEEDS)


def refused(readings, commanded=NONE, told=True, code=""):
    with refuses(f"rate_table.{code}") as caught:
        rate_steps(readings, commanded, told=told, site=SITE)
    return str(caught.value)


def turned(readings, sign=-1.0):
    return replace(readings, gyro=sign * readings.gyro)


@pytest.mark.parametrize("accel", [True, False])
def test_axes_senses_and_rates_are_found(accel):
    steps, found = rate_steps(make_readings(STEPS, accel), NONE, told=True, site=SITE)
    assert found == []
    np.testing.assert_array_equal(steps.up, STEPS.up)
    np.testing.assert_array_equal(steps.placement, STEPS.placement)
    np.testing.assert_array_equal(steps.rate, SPEEDS.tolist() * 6)
    np.testing.assert_array_equal(steps.axis, np.repeat([0, 0, 1, 1, 2, 2], 6))
    np.testing.assert_array_equal(steps.sense, np.repeat([1, -1] * 3, 6))


@pytest.mark.parametrize("accel", [True, False])
def test_commanded_rates_are_matched_by_what_the_gyros_say(accel):
    order = np.concatenate([np.random.default_rng(k).permutation(6) + 6 * k for k in range(6)])
    readings = make_readings(STEPS, accel, rate=np.full(36, np.nan))[order]
    commanded = Commanded(SPEEDS, ALL)
    steps, found = rate_steps(readings, commanded, told=False, site=SITE)
    np.testing.assert_array_equal(steps.rate, STEPS.rate[order])
    assert found == []


@pytest.mark.parametrize("accel", [True, False])
@pytest.mark.parametrize("axes", [("z up",), ("z down", "z up")])
@pytest.mark.parametrize("bias", [0.04, -3.0, 7.0])
def test_the_bias_of_an_axis_that_is_never_level_is_no_rate(bias, axes, accel):
    """One axis on a rate table, in any order, with a slow rate that a bias may hide."""
    speeds = np.radians([1.0, -1.0, 10.0, -10.0, 80.0, -80.0])
    model = replace(MODEL, gyro_bias=np.radians([0.3, -0.2, bias]))
    readings = make_readings(
        make_steps(model, axes, speeds), accel, rate=np.full(6 * len(axes), np.nan)
    )
    steps, found = rate_steps(readings, Commanded(speeds, axes), told=False, site=SITE)
    np.testing.assert_array_equal(steps.rate, np.tile(speeds, len(axes)))
    assert found == []
    # Rates that are really other ones are still told.
    text = refused(readings, Commanded(1.5 * speeds, axes), told=False, code="other_rate")
    assert "Correct `rates` in [procedure]" in text


def test_names_of_placements():
    for name in ("x up", "x down", "y up", "y down", "z up", "z down"):
        assert name_of(up_of(name)) == name


def test_no_gyro():
    assert "no gyro readings" in refused(replace(make_readings(STEPS), gyro=None), code="no_gyro")


def test_no_rates():
    assert 'rates = ["1 deg/s"' in refused(make_readings(STEPS), told=False, code="no_rates")


def test_nothing_says_which_axis_is_up():
    readings = make_readings(STEPS, accel=False)
    refused(readings, GIVEN, told=False, code="no_up")
    still = replace(readings, rate=np.zeros(36))
    assert "tells which axis was along the vertical" in refused(still, code="no_up")


def test_an_axis_between():
    readings = make_readings(STEPS)
    readings.accel[7] = 9.81 * np.array([0.6, 0.0, 0.8])
    text = refused(readings, code="between_axes")
    assert "In step 8" in text
    assert "is z, 37 deg from it" in text


def test_other_placements_than_declared():
    text = refused(make_readings(STEPS), Commanded(SPEEDS, ("x up", "x down", "z up")), code="axes")
    assert "x up, x down, y up, y down, z up, z down. [procedure] says: x up, x down, z up" in text


def test_steps_do_not_fit_the_declared_placements():
    some = make_readings(STEPS, accel=False)[np.arange(35)]
    text = refused(some, Commanded(SPEEDS, ALL), told=False, code="count")
    assert "35 steps were found; 6 placements with 6 rates" in text


@pytest.mark.parametrize("told", [True, False])
def test_a_sense_reversed(told):
    text = refused(turned(make_readings(STEPS)), GIVEN, told=told, code="sense")
    assert "counter-clockwise seen from above" in text
    assert ("36 of 36" if told else "6 of 6") in text


def test_one_placement_reversed_in_order():
    readings = make_readings(STEPS)
    readings.gyro[6:12] = 2 * np.radians([0.4, -0.3, 0.2]) - readings.gyro[6:12]
    text = refused(readings, GIVEN, told=False, code="sense")
    assert "with x down" in text


def test_rates_of_one_sense_that_turn_the_other_way():
    ahead = np.abs(SPEEDS[::2])
    readings = make_readings(make_steps(MODEL, rates=-ahead))
    text = refused(readings, Commanded(ahead), told=False, code="sense")
    assert "3 of 3 steps" in text


@pytest.mark.parametrize(("factor", "likely"), [(180 / np.pi, "deg/s"), (np.pi / 180, "rad/s")])
def test_a_wrong_unit(factor, likely):
    text = refused(make_readings(STEPS), Commanded(SPEEDS * factor), told=False, code="unit")
    assert f"Write `rates` in {likely}" in text


def test_a_rate_that_was_not_commanded():
    listed = np.delete(SPEEDS, 3)  # without -40 deg/s
    text = refused(make_readings(STEPS), Commanded(listed), told=False, code="other_rate")
    assert "In step 4, with x up" in text
    assert "nearest of the commanded rates is -10 deg/s" in text


def test_a_step_missing_is_told_and_the_rest_is_used():
    gone = np.delete(np.arange(36), [9, 20])
    readings = make_readings(STEPS)[gone]
    steps, found = rate_steps(readings, GIVEN, told=False, site=SITE)
    assert [f.code for f in found] == ["rate_table.missing"]
    assert "-40 deg/s with x down; 40 deg/s with y down" in found[0].message
    np.testing.assert_array_equal(steps.rate, STEPS.rate[gone])


# -- what the calibration says -------------------------------------------------------------------


def calibrated(steps, **settings):
    return from_readings(make_readings(steps), Settings(**settings), told=True, site=SITE)


def noisy(seed=1, **changes):
    steps = make_steps(MODEL, sd=1e-5, **changes)
    rng = np.random.default_rng(seed)
    return replace(steps, gyro=steps.gyro + 1e-5 * rng.normal(size=steps.gyro.shape))


def undetermined(steps, code="undetermined", **settings):
    with refuses(f"rate_table.{code}") as caught:
        calibrated(steps, **settings)
    return str(caught.value)


def test_an_axis_that_was_not_turned_about():
    text = undetermined(make_steps(axes=("x up", "y up")))
    assert "12 steps do not determine" in text
    assert "gyro.scale.z" in text
    assert "no step turns about z" in text
    assert "gyro.scale.x" not in text


def test_one_sense_does_not_show_the_asymmetry():
    text = undetermined(make_steps(rates=np.abs(SPEEDS[::2]), axes=("x up", "y up", "z up")))
    assert "gyro.asymmetry.x" in text
    assert "about x all steps turn the same way" in text


def test_one_speed_does_not_show_the_cubic_term():
    text = undetermined(make_steps(rates=SPEEDS[:2]))
    assert "gyro.cubic.x" in text
    assert "about x all steps have the same speed" in text
    assert calibrated(make_steps(rates=SPEEDS[:2]), cubic=False).status == "converged"


def test_a_prior_makes_up_for_a_missing_axis():
    steps = make_steps(axes=("x up", "y up"))
    groups = ("gyro.scale", "gyro.misalignment", "gyro.asymmetry")
    prior = dict.fromkeys(groups, (0.0, 1e-3))
    result = from_readings(
        make_readings(steps), Settings(cubic=False), told=True, site=SITE, prior=prior
    )
    sd = dict(zip(result.coefficients.names, result.coefficients.sd, strict=True))
    assert sd["gyro.scale.z"] == pytest.approx(1e-3, rel=1e-3)
    assert sd["gyro.scale.x"] < 1e-6
    assert "prior" in [c.name for c in result.checks]


def test_placements_up_only_do_not_show_the_g_sensitivity():
    text = undetermined(
        make_steps(axes=("x up", "y up", "z up")), "g_sensitivity", g_sensitivity=True
    )
    assert "(x up, y up, z up)" in text
    assert "Place every axis up and down" in text


def test_a_bad_step_is_named():
    steps = noisy()
    steps.gyro[8, 0] += 1e-3
    result = calibrated(steps, repeatability=False)
    assert "rate_table.outlier" in codes(result)
    message = next(f for f in result.findings if f.code == "rate_table.outlier").message
    assert message.startswith("Step 9 (40 deg/s, x down)")


def test_scatter_beyond_the_noise_is_added_and_makes_the_result_doubtful():
    steps = noisy()
    rng = np.random.default_rng(8)
    shaken = replace(steps, gyro=steps.gyro * (1 + 1e-4 * rng.normal(size=(36, 1))))
    result = calibrated(shaken, loss="squares")
    assert "rate_table.scatter" in codes(result)
    assert result.verdict.level == "doubtful"
    assert 0.5e-4 < result.diagnostics["rate_scatter"] < 2e-4
    hidden = calibrated(shaken, loss="squares", repeatability=False)
    assert "the uncertainties do not know it" in " ".join(hidden.verdict.reasons)
    np.testing.assert_array_less(
        hidden.coefficients["gyro.scale"].sd, result.coefficients["gyro.scale"].sd
    )


def test_declared_noise_too_large_is_told():
    steps = noisy()
    result = calibrated(replace(steps, cov=steps.cov * 25))
    assert result.verdict.level == "doubtful"
    assert "overstated" in result.verdict.reasons[0]


def test_no_latitude_is_told():
    result = calibrated(noisy(), earth_rate=False)
    assert "rate_table.no_latitude" in codes(result)
    assert "8.7 deg/h" in result.findings[-1].message


def test_a_wrong_scale_is_no_gyro():
    halved = ImuModel(gyro_matrix=0.5 * np.eye(3))
    result = calibrated(make_steps(halved))
    assert result.verdict.level == "unusable"
    assert "wrong unit or count scale" in result.verdict.reasons[0]


def test_terms_that_are_saturation():
    bent = ImuModel(gyro_asymmetry=np.array([0.2, 0.0, 0.0]))
    result = calibrated(make_steps(bent))
    assert "saturation" in " ".join(result.verdict.reasons)


def test_few_steps_are_told():
    result = calibrated(
        make_steps(axes=("x up", "y up", "z up"), rates=SPEEDS[2:4]),
        cubic=False, asymmetry=False, repeatability=False,
    )  # fmt: skip
    check = next(c for c in result.checks if c.name == "redundancy")
    assert check.value == 6
    assert check.passed


def test_too_few_steps_to_notice_a_bad_one():
    steps = make_steps(axes=("x up", "y up", "z up"), rates=SPEEDS[2:4])
    some = make_readings(steps)[np.arange(5)]
    settings = Settings(cubic=False, asymmetry=False, repeatability=False)
    result = from_readings(some, settings, told=True, site=SITE)
    check = next(c for c in result.checks if c.name == "redundancy")
    assert check.value == 3
    assert not check.passed
