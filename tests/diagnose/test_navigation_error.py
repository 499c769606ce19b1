"""Errors against a reference, their growth, and what sources contribute to them."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.diagnose.navigation import (
    MOST,
    NavigationError,
    budget,
    circular_error,
    common_epochs,
    error_of,
    growth,
    normalised_square,
    radial_rate,
)
from foucault.errors import FoucaultError
from foucault.logs.reference import Reference
from foucault.models.earth import displaced
from foucault.models.rotation import exp
from foucault.navigate.increments import increments_of
from foucault.navigate.strapdown import Trajectory, navigate
from make_navigation import DRIVE, logged, reference_of


@pytest.fixture(scope="module")
def drive():
    """A drive without errors of the instrument, as navigated from its true start."""
    run = logged(DRIVE, noise=None, rate=50.0)
    return run, navigate(increments_of(run.log), run.truth.state(0))


def test_between_samples_the_error_is_that_of_the_samples(drive) -> None:
    """References half-way between samples: interpolation adds less than a tenth of a millimetre."""
    run, trajectory = drive
    middle = run.motion.trajectory(np.arange(10.013, run.log.time[-1] - 1, 0.731))
    position = np.column_stack([middle.latitude, middle.longitude, middle.height])
    known = Reference(middle.time, position, middle.velocity_n, middle.angles)
    found = error_of(trajectory, known)
    at_samples = error_of(trajectory, reference_of(run, 1))
    for name, limit in (("position", 1e-4), ("velocity", 2e-3), ("angles", 1e-5)):
        x, y = getattr(found, name), getattr(at_samples, name)
        near = np.stack([np.interp(found.time, at_samples.time, c) for c in y.T], axis=-1)
        assert np.abs(x - near).max() < limit, name


def test_a_known_offset_comes_back(drive) -> None:
    run, trajectory = drive
    offset = np.array([3.0, -4.0, 12.0])
    known = reference_of(run)
    moved = np.column_stack(displaced(*known.position.T, -offset))
    angles = known.angles + np.array([0.01, -0.02, 0.03])
    shifted = Reference(known.time, moved, known.velocity_n - [1.0, 2.0, 3.0], angles)
    exact, found = error_of(trajectory, known), error_of(trajectory, shifted)
    whole = np.ones((len(found), 1))
    assert found.position - exact.position == pytest.approx(whole * offset, abs=2e-5)
    assert found.velocity - exact.velocity == pytest.approx(whole * [1.0, 2.0, 3.0])
    assert found.angles - exact.angles == pytest.approx(whole * [-0.01, 0.02, -0.03])
    assert growth(found)[-1].horizontal == pytest.approx(5.0, abs=0.01)
    assert growth(found)[-1].vertical == pytest.approx(12.0, abs=0.05)


def test_heading_errors_do_not_jump_at_north(drive) -> None:
    run, trajectory = drive
    known = reference_of(run)
    angles = known.angles.copy()
    angles[:, 0] = (angles[:, 0] + 1e-3) % (2 * np.pi)
    found = error_of(trajectory, Reference(known.time, known.position, angles=angles))
    assert np.abs(found.angles[:, 0] + 1e-3).max() < 1e-6


def test_what_the_reference_does_not_say_is_not_known(drive) -> None:
    run, trajectory = drive
    flat = reference_of(run, velocity_n=None, angles=None, has_height=False)
    found = error_of(trajectory, flat)
    assert np.isnan(found.velocity).all() and np.isnan(found.angles).all()
    assert np.isnan(found.position[:, 2]).all() and np.isfinite(found.position[:, :2]).all()
    fast = error_of(trajectory, reference_of(run, position=None, angles=None))
    assert np.isnan(fast.position).all() and np.isfinite(fast.velocity).all()
    assert np.isnan(radial_rate(fast))
    with pytest.raises(FoucaultError, match="fewer than two epochs are common") as caught:
        error_of(trajectory, Reference.site(np.arange(1e6, 1e6 + 10), 0.8, 0.1, 0.0))
    assert "shift the time of the reference" in caught.value.cure


def test_growth_is_listed_at_round_ages_between_epochs() -> None:
    """The nearest epoch is another age; far from every epoch nothing is known."""
    age = np.arange(0.3, 1000.0, 1.0)
    rows = growth(made(age, age**2))
    assert [row.age for row in rows[:-1]] == [60, 120, 300, 600]
    assert [row.horizontal for row in rows[:-1]] == pytest.approx([60**2, 120**2, 300**2, 600**2],
                                                                  rel=1e-3)  # fmt: skip
    sparse = np.arange(0.0, 1650.0, 100.0)
    assert [row.age for row in growth(made(sparse, sparse))] == [600, 1200, 1600]
    assert [row.age for row in growth(made(age[:605], age[:605]))] == [60, 120, 300, 604.3]
    wrapped = made(age, age)
    wrapped.angles[:, 0] = np.where(age < 60, 3.1, -3.1)
    assert abs(growth(wrapped)[0].heading) > 3.1


def test_many_epochs_are_thinned_and_the_listed_ages_kept() -> None:
    time = np.arange(0.0, 900.0, 0.01)
    run = Trajectory(time, np.zeros((len(time), 12)))
    kept = common_epochs(run, Reference.site(time, 0.8, 0.0, 0.0))
    assert MOST <= len(kept) < 1.05 * MOST and kept[-1] == time[-1]
    assert np.isin([60.0, 120.0, 300.0, 600.0], kept).all()


def made(age, east):
    zero = np.zeros((len(age), 3))
    return NavigationError(age, 0.0, np.column_stack([east, zero[:, 0], zero[:, 0]]), zero, zero)


def test_growth_lists_the_ages_that_were_reached() -> None:
    age = np.arange(1.0, 1000.0)
    rows = growth(made(age, 2 * age))
    assert [row.age for row in rows] == [60, 120, 300, 600, 999]
    assert [row.horizontal for row in rows] == [120, 240, 600, 1200, 1998]
    holes = np.concatenate([np.arange(1.0, 100.0), np.arange(500.0, 1000.0)])
    assert [row.age for row in growth(made(holes, holes))][-1] == 999
    assert radial_rate(made(age, 2 * age)) == pytest.approx(2.0)


@pytest.mark.parametrize("ratio", [0.0, 0.02, 0.3, 0.7, 1.0])
def test_half_of_all_errors_lie_in_the_circle(ratio: float) -> None:
    rng = np.random.default_rng(3)
    C = exp(np.array([0, 0, 0.7]))[:2, :2]
    cov = C @ np.diag([4.0, 4 * ratio**2]) @ C.T
    x = rng.normal(size=(100_000, 2)) * [2.0, 2 * ratio]
    inside = np.mean(np.hypot(*x.T) < circular_error(cov))
    assert inside == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(1e5))
    if ratio == 1:
        assert circular_error(cov) == pytest.approx(2 * 1.17741, rel=1e-4)


def test_a_budget_adds_up_and_level_errors_cancel() -> None:
    """An accelerometer bias that also tilted the alignment makes no velocity at first."""
    g, t = 9.81, np.array([1.0, 10.0])
    transition = np.zeros((2, 9, 10))
    transition[:, 3, 1], transition[:, 3, 9] = -g * t, t  # dv_E of phi_N, of an accelerometer bias
    transition[:, 6, 1], transition[:, 6, 9] = -g * t**2 / 2, t**2 / 2
    aligned = np.zeros((3, 1))
    aligned[1] = 1 / g
    some = (("accel.bias.x",), np.array([1e-3]), np.array([[1e-8]]))
    phi_cov, noise = np.diag([0.0, 1e-10, 0.0]), np.tile(np.eye(9), (2, 1, 1))
    tied = budget(t, transition, aligned, some, phi_cov, noise)
    assert np.allclose(tied.worth[:, [3, 6]], 0, atol=1e-15)
    assert np.allclose(tied.coefficients[:, 6, 6], 0, atol=1e-30)
    free = budget(t, transition, 0 * aligned, some, phi_cov, noise, velocity_sd=0.1)
    assert free.worth[:, 6, 0] == pytest.approx(1e-3 * t**2 / 2)
    assert free.left[:, 6, 0] == pytest.approx(1e-4 * t**2 / 2)
    assert free.coefficients[:, 6, 6] == pytest.approx((1e-4 * t**2 / 2) ** 2)
    assert free.alignment[:, 6, 6] == pytest.approx(1e-10 * (g * t**2 / 2) ** 2)
    assert np.allclose(free.cov, free.coefficients + free.alignment + noise)
    unknown = budget(t, transition, aligned, (some[0], some[1], None), phi_cov, noise)
    assert np.isnan(unknown.sd).all() and not unknown.coefficients.any() and not unknown.left.any()


def test_a_normalised_square_is_one_at_one_standard_deviation() -> None:
    assert normalised_square(np.array([3.0, 0.0]), np.diag([9.0, 1.0])) == pytest.approx(1.0)
