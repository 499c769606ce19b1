"""The model of steps on a rate table: derivatives, and uncertainties by formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.coefficients import CoefficientVector
from foucault.infer import mixed
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.rests_and_turns import mean_force_of_steps
from foucault.procedures.rate_table.model import RateTable, Settings
from make_rates import LATITUDE, SPEEDS, make_steps

FAMILIES = ("bias", "scale", "misalignment", "g_sensitivity", "asymmetry", "cubic")
NAMES = tuple(n for n in LAYOUT.names if n.startswith("gyro.") and n.split(".")[1] in FAMILIES)
PLAIN = tuple(n for n in NAMES if "g_sensitivity" not in n)
SIZE = {"bias": 0.02, "scale": 0.02, "misalignment": 0.01, "g_sensitivity": 2e-4,
        "asymmetry": 1e-3, "cubic": 1e-3}  # fmt: skip


def table(steps, names=PLAIN, latitude=LATITUDE, noise="declared", **settings):
    chosen = Settings(**{"repeatability": False} | settings)
    return RateTable(steps, names, chosen, latitude, noise)


def source(model, name, state=None):
    at = model.linearise(state or ImuModel())
    return next(s for s in at.sources if s.name == name)


def solved(*args, **settings):
    return mixed.fit(table(*args, **settings)).estimate


def bent(seed=2, names=NAMES):
    rng = np.random.default_rng(seed)
    values = [SIZE[n.split(".")[1]] * rng.uniform(-1, 1) for n in names]
    return ImuModel.from_coefficients(CoefficientVector(LAYOUT.subset(names), np.array(values)))


@pytest.mark.parametrize("what", ["rate of the table", "unknown Earth rate", "fixture"])
def test_one_sd_of_a_cause_does_what_the_instrument_reads_of_it(what):
    steps, state = make_steps(bent(5)), bent(6)
    model = table(steps, NAMES, None, table_rate_sd=1e-5, fixture_sd=1e-4)
    one = source(model, what, state)
    w = steps.rate[:, None] * steps.up
    for k in range(one.shared.shape[2]):
        h, f, rate = 1e-6, steps.force, w
        if what == "rate of the table":
            rate = (1 + h) * w
        elif what == "unknown Earth rate":
            rate = w + h * steps.up
        else:  # towards the first or second level axis, in one placement
            mine = (steps.placement == k // 2)[:, None]
            turned = np.where(mine, steps.up + h * steps.level[:, :, k % 2], steps.up)
            rate, f = steps.rate[:, None] * turned, 9.81 * turned
        moved = (state.measure(f, rate)[1] - state.measure(steps.force, w)[1]) / h
        np.testing.assert_allclose(one.shared[:, :, k], moved, atol=1e-5)


def test_a_vector_in_any_direction_has_a_third_of_its_square_along_each():
    still = make_steps(axes=("x up",), rates=np.zeros(2))
    unknown = table(replace(still, azimuth=np.zeros(2)), latitude=None)
    along, level = (source(unknown, name) for name in ("unknown Earth rate", "level Earth rate"))
    total = along.sd**2 * along.shared[0] @ along.shared[0].T
    total += level.sd**2 * level.shared[0] @ level.shared[0].T
    np.testing.assert_allclose(total, EARTH_RATE**2 / 3 * np.eye(3), atol=1e-20)


@pytest.mark.parametrize("turned", [False, True])
def test_rests_show_whether_the_table_stood_at_one_angle_where_it_did_not_tell(turned):
    rng, size = np.random.default_rng(5), EARTH_RATE * np.cos(LATITUDE)
    steps = make_steps(axes=("x up",), rates=np.r_[SPEEDS, np.zeros(8)], sd=1e-6)
    angle = 0.3 + turned * 2 * np.pi * rng.uniform(size=14)
    level = size * np.column_stack([np.zeros(14), np.cos(angle), np.sin(angle)])
    gyro = steps.gyro + level * (steps.rate == 0)[:, None] + 1e-6 * rng.normal(size=(14, 3))
    names = ("gyro.bias.x", "gyro.bias.y", "gyro.bias.z", "gyro.scale.x")
    found = mixed.fit(table(replace(steps, gyro=gyro), names))
    there = found.found["angle of the table"]
    assert there == (pytest.approx(size / np.sqrt(2), rel=0.5) if turned else 0.0)
    assert found.after["steps"].inside


def test_uncertainties_of_a_straight_line_are_those_of_the_textbook():
    names = ("gyro.bias.z", "gyro.scale.z", "gyro.asymmetry.z")
    steps = make_steps(axes=("z up",), sd=2e-6)
    x = steps.rate + EARTH_RATE * np.sin(LATITUDE)
    rows = np.column_stack([np.ones_like(x), x, np.abs(x)])
    want = 2e-6 * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(solved(steps, names).coefficients.sd, want, rtol=1e-6)


def test_an_error_that_all_rates_share_is_an_error_of_all_scale_factors():
    alone, found = (solved(make_steps(), table_rate_sd=sd) for sd in (0.0, 3e-6))
    for a in "xyz":
        i = PLAIN.index(f"gyro.scale.{a}")
        want = np.hypot(alone.coefficients.sd[i], 3e-6)
        # The Earth's rate, which has no such error, tells a little of it.
        assert found.coefficients.sd[i] == pytest.approx(want, rel=2e-3)
    cov = found.coefficients["gyro.scale"].cov
    assert cov[0, 1] == pytest.approx(3e-6**2, rel=1e-2)
    same = [PLAIN.index(n) for n in PLAIN if "misalignment" in n]
    np.testing.assert_allclose(found.coefficients.sd[same], alone.coefficients.sd[same], rtol=1e-4)


@pytest.mark.parametrize(("axes", "share"), [(("x up", "y up", "z up"), 1.0), (None, 0.5**0.5)])
def test_a_fixture_out_of_square_is_a_misalignment(axes, share):
    found = solved(make_steps(axes=axes) if axes else make_steps(), fixture_sd=1e-4)
    np.testing.assert_allclose(found.coefficients["gyro.misalignment"].sd, 1e-4 * share, rtol=2e-3)


def test_an_unknown_latitude_is_a_bias_of_axes_that_only_point_up():
    names = tuple(n for n in PLAIN if n.split(".")[1] in ("bias", "scale", "misalignment"))
    found = solved(make_steps(axes=("x up", "x down", "y up", "z up")), names, None)
    sd = found.coefficients["gyro.bias"].sd
    assert sd[0] < 1e-7  # up and down: the Earth's rate changes its sign
    one_way = solved(make_steps(axes=("z up",)), ("gyro.bias.z", "gyro.scale.z"), None)
    assert one_way.coefficients.sd[0] == pytest.approx(EARTH_RATE / np.sqrt(3), rel=1e-3)


def test_parts_of_turns_leave_a_part_of_the_horizontal_earth_rate():
    left = EARTH_RATE * np.cos(LATITUDE) * np.sin(np.pi * 2.25) / (np.pi * 2.25)
    parts = source(table(make_steps(axes=("z up",), turns=2.25)), "parts of turns")
    cov = parts.sd**2 * parts.each[0] @ parts.each[0].T
    np.testing.assert_allclose(cov, np.diag([left**2 / 2, left**2 / 2, 0.0]), rtol=1e-9)
    assert not source(table(make_steps(turns=3.0)), "parts of turns").each.any()


def test_jitter_weighs_fast_steps_less():
    jitter = source(table(make_steps(axes=("y up",)), rate_sd=1e-5), "rate jitter")
    np.testing.assert_allclose(jitter.sd * jitter.each[:, 1, 0], 1e-5 * SPEEDS, rtol=1e-12)
    assert not jitter.each[:, 0].any()


def test_scatter_is_found_where_there_is_some():
    steps = make_steps(sd=1e-8)
    rng = np.random.default_rng(3)
    shaken = steps.gyro * (1 + 2e-5 * rng.normal(size=(len(steps), 1)))
    shaken += 1e-8 * rng.normal(size=shaken.shape)
    found = mixed.fit(table(replace(steps, gyro=shaken), repeatability=True))
    assert 1.2e-5 < found.found["rate scatter"] < 3e-5
    assert found.after["steps"].ratio == pytest.approx(1.0, rel=0.1)
    assert found.found["bias drift"] == 0


def test_noise_that_nobody_knows_is_taken_from_the_residuals():
    steps = make_steps(sd=1e-7)
    white = np.sqrt(np.median(steps.time) / steps.time)[:, None]
    drawn = white * np.random.default_rng(4).normal(size=(36, 3))
    noisy = replace(steps, gyro=steps.gyro + 5e-6 * drawn)
    found = mixed.fit(table(noisy, noise="unknown", repeatability=True))
    assert 40 < found.sds["gyro noise"] < 60
    assert found.dof["gyro noise"] == pytest.approx(3 * 36 - 18, rel=1e-3)
    assert set(found.found) == {"gyro noise"}


def test_noise_that_nobody_knows_averages_out():
    steps = make_steps(sd=1e-7)
    root = table(
        replace(steps, time=steps.time * np.tile([1.0, 4.0], 18)), noise="unknown"
    ).noise_root
    each = np.sqrt(np.tile([1.0, 4.0], 18) * steps.time)
    np.testing.assert_allclose(root[:, 1, 1] * each, root[0, 0, 0] * each[0], rtol=1e-12)


def test_force_holds_the_centripetal_part_that_the_accelerometers_saw():
    steps = make_steps(axes=("x up", "z down"))
    arm = np.array([0.1, -0.2, 0.3])
    across = arm - (steps.up @ arm)[:, None] * steps.up
    true = 9.81 * steps.up - (steps.rate**2)[:, None] * across
    accel = true + np.array([0.5, -0.2, 0.1])  # a bias says nothing of the rate
    found = mean_force_of_steps(steps.up, steps.placement, steps.rate, accel, Site(9.81))
    np.testing.assert_allclose(found, true, atol=1e-12)
    still = mean_force_of_steps(steps.up, steps.placement, steps.rate, None, Site(9.81))
    np.testing.assert_allclose(still, 9.81 * steps.up)


def test_a_bad_step_is_left_out():
    steps = make_steps(sd=1e-6)
    gyro = steps.gyro.copy()
    gyro[4, 0] += 1e-3
    for sd in (0.0, 1e-3):
        model = table(replace(steps, gyro=gyro), fixture_sd=sd)
        assert mixed.fit(model, robust=True).outliers.tolist() == [4]


@pytest.mark.parametrize("axis", ["x up", "y down"])
def test_rests_at_other_table_angles_see_the_same_earth_turned(axis):
    steps = make_steps(ImuModel(), axes=(axis,), rates=np.zeros(3))
    angle = np.array([0.0, 0.7, -2.0])
    steps = replace(steps, azimuth=angle)
    model = table(steps, latitude=0.8)
    slope = source(model, "level Earth rate").shared
    at_zero = slope[0] @ [0.6, -0.8]
    for k, a in enumerate(angle):  # what stands still turns back about up, seen from the table
        back = Rotation.from_rotvec(-a * steps.up[k])
        np.testing.assert_allclose(slope[k] @ [0.6, -0.8], back.apply(at_zero), atol=1e-15)
    assert np.linalg.norm(at_zero) == pytest.approx(1.0)
    assert "angle of the table" not in [s.name for s in model.linearise(ImuModel()).sources]
    unknown = table(replace(steps, azimuth=np.array([0.0, np.nan, np.nan])))
    assert source(unknown, "angle of the table").each.any(axis=(1, 2)).tolist() == [
        False,
        True,
        True,
    ]
