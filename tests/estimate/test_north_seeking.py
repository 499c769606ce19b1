"""Attitudes from four numbers: exact, the right root, and as sure as is promised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.study import nees
from foucault.estimate.north import LATITUDE, Known, closed_form, solve
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.north_seeker import Compensation
from make_dwells import (
    FIELD,
    FOUR,
    PALINDROME,
    QUIET,
    attitudes,
    errors,
    level,
    make_dwells,
    turn,
)

DEG = np.radians(1.0)


def known(latitude, **words):
    """Known(...) at a latitude; latitude=None in `words` hides it."""
    return Known(gravity(latitude), words.pop("given", latitude), **words)


def tilted(m, total, seed=0):
    """Headings all around, tilted by `total` [deg] in random directions."""
    towards = 2 * np.pi * np.random.default_rng(seed).random(m)
    size = np.radians(total)
    up = np.column_stack([np.sin(size) * np.cos(towards), np.sin(size) * np.sin(towards)])
    pitch = np.arcsin(up[:, 1])
    roll = np.arctan2(-up[:, 0], np.cos(size))
    return np.column_stack([2 * np.pi * (np.arange(m) + 0.3) / m, pitch, roll])


# -- exact ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [-75.0, -30.0, 2.0, 47.0, 80.0, 88.5])
@pytest.mark.parametrize("tilt", [0.0, 10.0, 60.0, 89.0])
def test_noise_free_readings_give_back_the_attitude(latitude, tilt):
    lat = latitude * DEG
    poses = tilted(24, tilt)
    ours = errors(seed=5)
    dwells = make_dwells(poses, lat, instrument=ours, offset=3e-6, accel_offset=0.01)
    fixes = solve(reduce(dwells, QUIET), known(lat), ours)
    assert not fixes.status.any()
    off = np.abs(turn(fixes.angles[:, :3], poses))
    # At 89 deg heading and roll turn about nearly the same axis.
    assert off.max() < 2e-8 / np.cos(tilt * DEG) + 1e-9 * np.tan(tilt * DEG)
    np.testing.assert_allclose(fixes.angles[:, 3], lat, atol=1e-9)
    np.testing.assert_allclose(fixes.square, 0.0, atol=1e-3)


@pytest.mark.parametrize("hemisphere", ["north", "south"])
@pytest.mark.parametrize("latitude", [25.0, 47.0, 80.0])
def test_without_latitude_too_with_the_root_of_the_hemisphere(hemisphere, latitude):
    """Tilted less than the latitude, so that the rate along z has the hemisphere's sign."""
    lat = latitude * DEG * (1 if hemisphere == "north" else -1)
    for tilt in (0.0, 8.0, 20.0):
        poses = tilted(24, tilt)
        dwells = make_dwells(poses, lat, offset=3e-6)
        fixes = solve(reduce(dwells, QUIET), known(lat, given=None, hemisphere=hemisphere))
        assert np.abs(turn(fixes.angles[:, :3], poses)).max() < 2e-7
        np.testing.assert_allclose(fixes.angles[:, 3], lat, atol=1e-7)


@pytest.mark.parametrize("latitude", [-75.0, -30.0, -2.0, 2.0, 47.0, 80.0])
def test_without_latitude_at_any_tilt_the_truth_is_one_of_two(latitude):
    """Tilted further than the latitude, both signs of the rate along z may fit."""
    lat = latitude * DEG
    hemisphere = "north" if lat > 0 else "south"
    for tilt in (45.0, 70.0, 89.0):
        poses = tilted(40, tilt, seed=int(tilt))
        pairs = reduce(make_dwells(poses, lat), QUIET)
        fixes = solve(pairs, known(lat, given=None, hemisphere=hemisphere))
        truth = np.column_stack([poses, np.full(len(poses), lat)])
        off, other = (np.abs(turn(x, truth)).max(axis=1) for x in (fixes.angles, fixes.other))
        found = off < 1e-4 / np.cos(tilt * DEG)
        also = fixes.ambiguous & (other < 1e-4 / np.cos(tilt * DEG))
        covered = off < 5 * np.max(fixes.sd, axis=1)
        assert (found | also | covered).all()


def test_an_ambiguity_near_the_equator_is_seen_and_a_rough_latitude_settles_it():
    lat, poses = 3.0 * DEG, tilted(36, 12.0)
    pairs = reduce(make_dwells(poses, lat, noise=FIELD, dwell=120.0), FIELD)
    blind = solve(pairs, known(lat, given=None))
    right, other = (
        np.abs(turn(x[:, 0], poses[:, 0])) < 0.3 * DEG for x in (blind.angles, blind.other)
    )
    covered = np.abs(turn(blind.angles[:, 0], poses[:, 0])) < 3 * blind.sd[:, 0]
    assert (right | other | covered).all(), "one of both is the truth, or the uncertainty says so"
    wrong = ~right & ~covered
    assert wrong.any() and blind.ambiguous[wrong].all(), "no wrong one goes unnoticed"
    rough = solve(pairs, known(lat, given=lat + 0.3 * DEG, latitude_sd=0.5 * DEG))
    assert (np.abs(turn(rough.angles[:, 0], poses[:, 0])) < 4 * rough.sd[:, 0]).all()
    assert not rough.ambiguous[wrong].any()


def test_far_from_the_equator_nothing_is_ambiguous():
    lat = 47 * DEG
    pairs = reduce(make_dwells(tilted(36, 10.0), lat, noise=FIELD), FIELD)
    for given in (lat, None):
        fixes = solve(pairs, known(lat, given=given))
        assert not fixes.ambiguous.any() and not fixes.clamped.any()


def test_the_wrong_hemisphere_gives_the_wrong_heading_and_is_the_other_solution():
    lat, poses = -20 * DEG, tilted(24, 10.0)
    pairs = reduce(make_dwells(poses, lat), FIELD)
    fixes = solve(pairs, known(lat, given=None, hemisphere="north"))
    np.testing.assert_allclose(fixes.other[:, 3], lat, atol=1e-4)
    np.testing.assert_allclose(turn(fixes.other[:, 0], poses[:, 0]), 0.0, atol=1e-4)


@pytest.mark.parametrize("stops", [(90.0, 270.0), (0.0, 180.0)])
def test_two_stops_and_a_rough_heading(stops):
    lat, poses = 47 * DEG, attitudes(12, 5.0)
    dwells = make_dwells(poses, lat, stops=stops, offset=3e-6, accel="case")
    pairs = reduce(dwells, QUIET)
    truth = poses[:, 0]
    # Along the meridian one component alone hardly tells the heading.
    turned = truth if stops[0] == 90.0 else truth + np.pi / 2
    clear = np.abs(np.cos(turned)) > 0.3
    near = truth + 0.15
    fixes = solve(pairs, known(lat, near=near))
    np.testing.assert_allclose(turn(fixes.angles[clear, 0], truth[clear]), 0.0, atol=1e-6)
    # Without it there is a second heading that fits, and it is said.
    blind = solve(pairs, known(lat))
    assert blind.ambiguous[clear].all()
    best = np.minimum(
        np.abs(turn(blind.angles[:, 0], truth)), np.abs(turn(blind.other[:, 0], truth))
    )
    np.testing.assert_allclose(best[clear], 0.0, atol=1e-6)


def test_more_rate_than_the_earths_is_clamped_and_said():
    lat, poses = 0.5 * DEG, level(12)
    dwells = make_dwells(poses, lat)
    dwells = replace(dwells, gyro=1.02 * dwells.gyro)
    fixes = solve(reduce(dwells, FIELD), known(lat, given=None))
    assert fixes.clamped.all()
    assert np.isfinite(fixes.angles).all() and np.isfinite(fixes.sd).all()
    np.testing.assert_allclose(turn(fixes.angles[:, 0], poses[:, 0]), 0.0, atol=0.01)
    assert not solve(reduce(make_dwells(poses, 0.7), FIELD), known(0.7, given=None)).clamped.any()


def test_a_reading_that_is_no_number_spoils_its_set_up_alone():
    lat, poses = 0.8, attitudes(5)
    dwells = make_dwells(poses, lat)
    dwells.gyro[5] = np.nan
    fixes = solve(reduce(dwells, QUIET), known(lat))
    assert list(fixes.status) == [0, 4, 0, 0, 0]
    assert np.isnan(fixes.angles[1]).all()
    good = [0, 2, 3, 4]
    np.testing.assert_allclose(turn(fixes.angles[good, :3], poses[good]), 0.0, atol=1e-7)


def test_the_closed_form_and_the_likelihood_agree_where_both_are_good():
    """With the latitude free both solve four equations with four unknowns."""
    lat, poses = 0.7, attitudes(40, 25.0)
    pairs = reduce(make_dwells(poses, lat, noise=FIELD), FIELD)
    fixes = solve(pairs, known(lat, given=None))
    rate, up = pairs.values[:, :2], pairs.values[:, 2:] / gravity(lat)
    sds = np.sqrt(pairs.cov[0, [0, 2], [0, 2]]) / [1.0, gravity(lat)]
    words = {"rate_sd": float(sds[0]), "up_sd": float(sds[1])}
    angles, sd, status = closed_form(rate, up, latitude=None, **words)
    assert not status.any()
    np.testing.assert_allclose(turn(angles, fixes.angles), 0.0, atol=1e-8)
    np.testing.assert_allclose(sd, fixes.sd, rtol=1e-5)
    many = closed_form(np.tile(rate, (4000, 1)), np.tile(up, (4000, 1)), latitude=lat, **words)
    one = closed_form(rate, up, latitude=lat, **words, threads=1)
    for a, b in zip(many, one, strict=True):  # in threads as well as at once
        np.testing.assert_array_equal(a[-40:], b)
    south = closed_form(rate * [1, 1], up, latitude=None, hemisphere="south", **words)
    assert (south[0][:, 3] < 0.6).all()


# -- the uncertainty -----------------------------------------------------------------------------


def test_level_the_uncertainty_is_the_formula():
    """sqrt(2 / N) sigma / (w cos L), and tan L times the tilt about north."""
    lat = 0.8
    dwells = make_dwells(level(12), lat, dwell=60.0)
    pairs = reduce(dwells, FIELD)
    fixes = solve(pairs, known(lat))
    gyro = FIELD.gyro.white / np.sqrt(60.0) / np.sqrt(2) / (EARTH_RATE * np.cos(lat))
    tilt = FIELD.accel.white / np.sqrt(60.0) / np.sqrt(2) / gravity(lat)
    np.testing.assert_allclose(fixes.sources["gyro noise"][:, 0], gyro**2, rtol=1e-4)
    np.testing.assert_allclose(
        fixes.sources["tilt: noise"][:, 0], (tilt * np.tan(lat)) ** 2, rtol=1e-2
    )
    np.testing.assert_allclose(fixes.sd[:, 1:3], tilt, rtol=1e-2)


@pytest.mark.parametrize("given", ["known", "rough", "unknown"])
def test_the_budget_adds_up_to_the_variance(given):
    lat = 0.7
    ours = errors(seed=3, cov=True)
    dwells = make_dwells(attitudes(8, 20.0), lat, stops=PALINDROME, instrument=ours)
    pairs = reduce(dwells, FIELD, Nuisance(0.0, 1e-8, 1e-10, 1e-4))
    place = known(lat, given=None if given == "unknown" else lat,
                  latitude_sd=1e-3 if given == "rough" else 0.0)  # fmt: skip
    fixes = solve(pairs, place, ours)
    total = np.sum(list(fixes.sources.values()), axis=0)
    size = np.einsum("nii->ni", fixes.cov)
    np.testing.assert_allclose(total, size, rtol=1e-6, atol=1e-16)
    assert all((v >= 0).all() for v in fixes.sources.values())
    assert (LATITUDE in fixes.sources) == (given != "unknown")
    more = {"coupling", "scale factor", "calibration: bias", "tilt: calibration", "indexing"}
    assert more < set(fixes.sources)
    # Knowing the latitude worse never helps.
    if given == "rough":
        sure = solve(pairs, known(lat), ours)
        assert (sure.sd[:, 0] <= fixes.sd[:, 0] * (1 + 1e-9)).all()


def test_without_accelerometers_the_levelling_counts():
    lat, poses = 0.9, level(12)
    dwells = make_dwells(poses, lat, accel=None)
    sd = np.radians(1 / 60)
    fixes = solve(reduce(dwells, QUIET), known(lat, level_sd=sd))
    np.testing.assert_allclose(turn(fixes.angles[:, 0], poses[:, 0]), 0.0, atol=1e-7)
    # About north the tilt turns the heading; about east the rate itself tells, so that it is known.
    np.testing.assert_allclose(
        np.sqrt(fixes.sources["tilt: level"][:, 0]), sd * np.tan(lat), rtol=1e-3
    )
    np.testing.assert_allclose(fixes.cov[:, 0, 0], fixes.sources["tilt: level"][:, 0], rtol=1e-3)


CASES = {
    "level": (0.8, level(60), {}),
    "tilted": (0.8, tilted(60, 10.0), {}),
    "steep": (0.8, tilted(60, 70.0), {}),
    "nearly upright": (0.5, tilted(60, 88.0), {}),
    "south": (-1.2, tilted(60, 30.0), {}),
    "equator": (0.02, tilted(60, 20.0), {}),
    "latitude unknown": (0.8, tilted(60, 10.0), {"given": None}),
    "latitude rough": (0.8, tilted(60, 20.0), {"latitude_sd": 2e-3}),
}


@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
def test_errors_have_the_size_that_was_promised(case):
    """Every set-up has its own noise and its own instrument, known as well as is said."""
    lat, poses, words = CASES[case]
    rng = np.random.default_rng(list(CASES).index(case))
    poses = np.tile(poses, (10, 1))
    m = len(poses)
    ours = errors(seed=2, cov=True)
    c = ours.coefficients
    true = lat
    place = known(lat, **words)
    if words.get("latitude_sd"):
        true = lat + words["latitude_sd"] * rng.standard_normal()
    values = []
    for pose in poses:
        drawn = c.values + np.sqrt(np.diag(c.cov)) * rng.standard_normal(len(c))
        its = Compensation(replace(c, values=drawn, cov=None))
        if words.get("latitude_sd"):
            true = lat + words["latitude_sd"] * rng.standard_normal()
        values.append(make_dwells([pose], true, stops=FOUR, dwell=240.0, instrument=its,
                                  noise=FIELD, seed=int(rng.integers(1 << 30))))  # fmt: skip
    first = values[0]
    setup = np.repeat(np.arange(m), 4)
    joined = replace(
        first, setup=setup, names=tuple(map(str, range(m))), heading=np.full(m, np.nan),
        **{k: np.concatenate([getattr(v, k) for v in values])
           for k in ("start", "time", "index", "cosine", "sine", "gyro", "accel")},
    )  # fmt: skip
    fixes = solve(reduce(joined, FIELD), place, ours)
    axes = [0, 1, 2, 3] if "given" in words else [0, 1, 2]
    err = turn(fixes.angles[:, axes], np.column_stack([poses, np.full(m, true)])[:, axes])
    keep = ~fixes.ambiguous
    assert keep.sum() > 0.9 * m
    cov = fixes.cov[np.ix_(np.flatnonzero(keep), axes, axes)]
    total = float(nees(err[keep], cov).sum())
    low, high = chi_square_limits(len(axes) * int(keep.sum()), tests=len(CASES))
    assert low < total < high
    # A standard deviation that is wrong by 10 % is rejected.
    assert not low < total / 0.9**2 < high
    assert not low < total / 1.1**2 < high
