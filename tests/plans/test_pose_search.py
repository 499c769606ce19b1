"""Poses for spins about a level axis: the design, the published sets, and better ones."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.rotation import exp
from foucault.plans.directions import spread_directions
from foucault.plans.sequence import (
    COEFFICIENTS,
    NAMES,
    best_poses,
    design,
    poses,
    poses_named,
    quality,
    spin_axis,
)
from refusals import refuses


def sensitivity(T, f):
    """Return M of the error dw = M w: the gyros i lean towards j by T, eqs. (9) and (10)."""
    t = dict(zip(COEFFICIENTS, T, strict=True))
    M = np.zeros((3, 3))
    M[0, 1], M[0, 2] = t["xyy"] * f[1] - t["xzz"] * f[2], t["xzz"] * f[2] + t["xyy"] * f[1]
    M[1, 2], M[1, 0] = t["yzz"] * f[2] - t["yxx"] * f[0], t["yxx"] * f[0] + t["yzz"] * f[2]
    M[2, 0], M[2, 1] = t["zxx"] * f[0] - t["zyy"] * f[1], t["zyy"] * f[1] + t["zxx"] * f[0]
    return M


def tilt(T, angles, turns=1, steps=36):
    """Integrate the attitude error of a spin about North, East component, for g = 1 (24)."""
    a, b = angles
    C_0 = exp(np.array([b, 0, 0.0])) @ exp(np.array([0, 0, a]))
    total = np.zeros(3)
    for theta in (np.arange(steps) + 0.5) * 2 * np.pi / steps:
        C = exp(np.array([0, theta, 0.0])) @ C_0
        w_b = C.T @ [0.0, 1.0, 0.0]
        f_b = C.T @ [0.0, 0.0, 1.0]
        total -= C @ sensitivity(T, f_b) @ w_b * 2 * np.pi / steps
    return turns * total


def test_the_design_is_the_integral_over_a_turn():
    rng, ratios = np.random.default_rng(1), []
    for angles in rng.uniform(-np.pi, np.pi, (6, 2)):
        T = rng.normal(size=6)
        east, north, _ = tilt(T, angles)
        row = design(spin_axis(angles[None]))[0]
        ratios.append(east / (np.pi * row @ T))
        assert abs(north) < 1e-9
    np.testing.assert_allclose(np.abs(ratios), 1.0, rtol=1e-9)
    assert len(set(np.sign(ratios))) == 1


def test_ten_turns_without_tilting_the_case_are_62_83_arcsec():
    assert 10 * np.pi * design(spin_axis(np.zeros((1, 2))))[0].sum() == pytest.approx(
        62.83, abs=0.005
    )


@pytest.mark.parametrize(
    ("name", "condition", "spread"),
    [("simple 6", 7.05, 2.18), ("face diagonals 6", 5.46, 1.70), ("icosahedral 6", 5.31, 1.66)],
)
def test_the_known_sets_are_as_good_as_published(name, condition, spread):
    found = quality(poses(name))
    assert found.condition == pytest.approx(condition, abs=0.005)
    assert found.spread == pytest.approx(spread, abs=0.005)


def test_three_poses_along_the_axes_show_sums_only():
    assert quality(poses("simple 6")[:3]).rank == 3
    assert np.isinf(quality(poses("simple 6")[:5]).sd).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_six_poses_as_good_as_any_known(seed):
    found = quality(best_poses(6, starts=6, seed=seed))
    assert found.spread <= 1.44 and found.condition == pytest.approx(4.13, abs=0.005)
    assert found.sd == pytest.approx(np.full(6, 1.438), rel=0.01)


def test_more_poses_gain_by_the_root_of_their_number_only():
    """Six poses reach what any number spread over the sphere gives per pose."""
    rms = {n: quality(best_poses(n, starts=6)).spread * np.sqrt(n) for n in (6, 7, 8, 9)}
    assert list(rms.values()) == pytest.approx([3.5227] * 4, rel=1e-4)


def test_gimbals_that_turn_less_cost_something():
    limits = (-np.pi / 4, np.pi / 4)
    angles = best_poses(6, starts=6, about_east=limits)
    assert np.abs(angles[:, 1]).max() <= np.pi / 4
    assert 1.45 < quality(angles).spread < 1.52 < quality(poses("icosahedral 6")).spread


@pytest.mark.parametrize("limits", [{"count": 5}, {"about_east": (0.0, 0.0)}])
def test_poses_that_cannot_do_are_refused(limits):
    with refuses("poses.singular"):
        best_poses(**limits, starts=3)


def test_sets_by_name():
    name, angles = poses_named("Optimized 7")
    assert (name, angles.shape) == ("optimised 7", (7, 2))
    assert poses_named("simple 6")[0] in NAMES
    with refuses("poses.unknown", "Did you mean 'simple 6'"):
        poses_named("simple6")


def test_no_pose_would_add_more_than_those_found():
    """The equivalence theorem: the found set is A-optimal among sets of any number of poses."""
    A = design(spin_axis(best_poses(6, starts=6)))
    inverse = np.linalg.inv(A.T @ A / 6)
    gain = np.sum((design(spread_directions(20000)) @ inverse) ** 2, axis=1)
    assert gain.max() == pytest.approx(np.trace(inverse), rel=1e-3)
