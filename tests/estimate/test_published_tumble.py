"""The single-pass filters of a tumble: what they reach, and how they fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.errors import Status
from foucault.estimate import tumble as estimation
from foucault.estimate.tumble import Prior, State, Tumble
from foucault.estimate.tumble_solution import (
    ANNEALED,
    LITERAL,
    Options,
    filter_angles,
    filter_misalignment,
)
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.cluster import (
    CONSTANTS,
    SOURCE_SYMBOLS,
    ClusterModel,
    attitude_of,
    normalised,
)
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp, log
from foucault.plans import tumble as torquing
from foucault.simulate.tumble import Acquisition, simulate_tumble
from make_cluster import ARCSEC, DEG_H, G

DEG = np.radians(1.0)
SITE = Site(G, 40 * DEG)
NOISE = ImuNoise(
    TriadNoise(white=1e-6 * G * np.sqrt(0.2)), TriadNoise(white=0.05 * DEG_H * np.sqrt(0.002))
)
# Mean and sd of the source, in local g.
SOURCE = {
    "drift": (DEG_H, 0.2 * DEG_H), "drift_input": (0.5 * DEG_H, 0.1 * DEG_H),
    "drift_output": (0.5 * DEG_H, 0.1 * DEG_H), "drift_spin": (0.5 * DEG_H, 0.1 * DEG_H),
    "drift_input_output": (0.01 * DEG_H, 0.005 * DEG_H),
    "drift_input_spin": (0.01 * DEG_H, 0.005 * DEG_H),
    "drift_output_spin": (0.01 * DEG_H, 0.005 * DEG_H), "torquer_scale": (4e-4, 5e-5),
    "misalignment": (120 * ARCSEC, 20 * ARCSEC), "bias": (1e-4, 1e-5), "scale": (1e-4, 1e-5),
    "quadratic": (1e-4, 1e-5),
}  # fmt: skip
MEAN, SD = np.array([SOURCE[name.split(".")[1]] for name in CONSTANTS.names]).T
SIGN = np.array([SOURCE_SYMBOLS[name][1] for name in CONSTANTS.names])


def session(seed, start=(2.0, 3.0, 5.0), size=1.0, attitude_sd=5.0):
    """Return a tumble of the source, the prior of its filter, and truth: C_np there, at the end."""
    rng = np.random.default_rng(seed)
    constants = size * SIGN * (MEAN + SD * rng.standard_normal(42))
    model = ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, constants / normalised(G)))
    made = simulate_tumble(
        torquing.PUBLISHED, model=model, noise=NOISE, site=SITE, start=np.array(start) * DEG,
        acquisition=Acquisition(), seed=seed,
    )  # fmt: skip
    dt = np.diff(made.log.time)
    tumble = Tumble(
        dt, np.ascontiguousarray(made.log.gyro[:-1]), made.log.accel[1:] / G,
        np.ones(len(dt), bool), earth_rate_n(SITE.latitude), G, NOISE.gyro.white**2, 1e-12,
    )  # fmt: skip
    prior = Prior(State(np.eye(3), np.zeros(42)), np.array([*3 * [attitude_sd * DEG], *MEAN, 0.0]))
    prior = replace(prior, mean=State(attitude_of(np.zeros(3)).T, np.zeros(42)))
    truth = State(made.C_pn[0].T, constants), made.C_pn[1].T
    return tumble, prior, truth


def errors(filtered, truth):
    """Attitude, a rotation vector in p, and constants: estimate minus truth."""
    return np.concatenate(
        [log(truth[1].T @ filtered.C_np), filtered.constants - truth[0].constants]
    )


def all_finite(filtered):
    course = filtered.course
    arrays = (filtered.C_np, filtered.constants, filtered.cov, filtered.angles, course.angles)
    more = (course.constants, course.sd, course.innovation, course.time)
    return all(np.isfinite(a).all() for a in (*arrays, *more)) and np.isfinite(filtered.innovation)


@pytest.fixture(scope="module")
def first():
    return session(0)


@pytest.fixture(scope="module")
def bound(first):
    """The bound: the sd of a linear filter about the truth."""
    tumble, prior, truth = first
    exact = filter_misalignment(tumble, replace(prior, mean=truth[0]))
    return np.sqrt(np.diag(exact.cov)), exact


def test_about_the_truth_it_is_consistent_and_knows_the_bound(first, bound):
    """Innovations inside two-sided chi-square limits; sd as the information says."""
    sd, exact = bound
    assert exact.status is Status.CONVERGED and exact.intervals == 27000
    count = exact.course.readings.sum()
    low, high = chi_square_limits(count)
    assert count == 81000
    assert low < (exact.course.innovation * exact.course.readings).sum() < high
    tumble, prior, truth = first
    information = estimation.bound(tumble, prior, truth[0])
    other = np.sqrt(np.diag(information.cov)[:45])
    np.testing.assert_allclose(sd, other, rtol=0.01)
    # Mean bound of 500 other clusters of the same kind.
    known = {
        "gyro.drift.x": 0.00025 * DEG_H, "gyro.drift_output.z": 0.00049 * DEG_H,
        "gyro.torquer_scale.x": 0.79966e-6, "accel.bias.z": 0.04279e-6,
        "gyro.misalignment.xy": 0.38376 * ARCSEC, "accel.misalignment.zx": 0.02185 * ARCSEC,
    }  # fmt: skip
    for name, value in known.items():
        assert abs(sd[3 + CONSTANTS.names.index(name)] / value - 1) < 0.05, name


def test_the_literal_filter_diverges_and_the_annealed_one_does_not(first, bound):
    """A thousand times the bound, and a few times: over three runs, medians of all 45."""
    ratios = []
    for tumble, prior, truth in (first, session(1), session(2)):
        literal, annealed = (filter_angles(tumble, prior, o) for o in (LITERAL, ANNEALED))
        assert literal.status is Status.NOT_CONVERGED and "diverged" in literal.advice
        assert literal.innovation > 100 and all_finite(literal)
        assert annealed.status is Status.CONVERGED and annealed.innovation < 1
        assert all_finite(annealed)
        ratios.append([np.abs(errors(f, truth)) / bound[0] for f in (literal, annealed)])
    diverged, few = np.median(ratios, axis=(0, 2))
    assert diverged > 300
    assert 1.5 < few < 8  # worse than the bound, by far better than what diverges


def test_course_and_end_agree(first):
    tumble, prior, _ = first
    filtered = filter_angles(tumble, prior, moments=50)
    course = filtered.course
    assert course.time.shape == (50,) and abs(course.time[-1] - 5400) < 1e-6
    np.testing.assert_allclose(course.angles[-1], filtered.angles, atol=1e-12)
    np.testing.assert_array_equal(course.constants[-1], filtered.constants)
    np.testing.assert_allclose(course.sd[-1, 3:], np.sqrt(np.diag(filtered.cov)[3:]), rtol=1e-12)
    assert course.readings.sum() == 81000


@pytest.mark.parametrize("filters", [filter_angles, filter_misalignment])
def test_the_prior_of_the_start_is_carried(first, filters):
    """Without readings, constants and noise the attitude is as well known at the end."""
    tumble, _, _ = first
    sd = np.array([0.01, 0.02, 0.03, *np.zeros(43)])
    start = State(attitude_of(np.array([0.3, -0.4, 0.5])).T, np.zeros(42))
    short = slice(0, 50)
    blind = replace(
        tumble, dt=tumble.dt[short], command=tumble.command[short],
        reading=tumble.reading[short], used=np.zeros(50, bool), gyro_psd=0.0,
    )  # fmt: skip
    filtered = filters(blind, Prior(start, sd))
    C = (exp(tumble.w_ie_n * 10.0) @ filtered.C_np).T  # from n as it was at the start
    np.testing.assert_allclose(
        filtered.cov[:3, :3], C @ np.diag(sd[:3] ** 2) @ C.T, rtol=1e-6, atol=1e-12
    )
    assert not filtered.cov[3:].any() and filtered.status is Status.CONVERGED


@pytest.mark.thorough
def test_a_misalignment_filter_is_right_for_small_angles_alone():
    """Perfect instruments of which the filter does not know: the start alone is to tell.

    Worst of 45 errors in units of their sd; at 0.001 deg all of them together are consistent.
    """
    worst = {}
    for angle in (0.001, 0.01, 0.05, 0.5, 5.0):
        tumble, prior, truth = session(3, 3 * (angle,), 0.0, 2 * angle)
        both = filter_angles(tumble, prior), filter_misalignment(tumble, prior)
        integrated = filter_misalignment(tumble, prior, integrated=True)
        assert all(all_finite(f) for f in (*both, integrated))
        sd = np.sqrt(np.diag(both[1].cov))
        worst[angle] = [np.max(np.abs(errors(f, truth)) / sd) for f in (*both, integrated)]
        if angle == 0.001:
            low, high = chi_square_limits(45, tests=2)
            for small in (both[1], integrated):
                e = errors(small, truth)
                assert low < e @ np.linalg.solve(small.cov, e) < high
                assert small.status is Status.CONVERGED
        if angle >= 0.5:
            assert both[1].status is integrated.status is Status.NOT_CONVERGED
    free, planned, integrated = np.array(list(worst.values())).T[:, 1:]
    assert planned[0] < 5 and integrated[0] < 5
    assert planned[1] > 10 and integrated[1] > 10 and free[1] < 5
    assert planned[2] > 50 * free[2] and integrated[2] > 50 * free[2]
    assert planned[3] > 10 * free[3] and integrated[3] > 10 * free[3]
    assert 30 < planned[2] / planned[1] < 300  # they grow with the square of the angle


def test_what_moves_the_cluster_from_its_plan_is_not_small():
    """Drift and scale factors alone lead the planned form astray, the integrated one not."""
    tumble, prior, _ = session(4, 3 * (0.01,), 1.0, 0.02)
    planned = filter_misalignment(tumble, prior)
    integrated = filter_misalignment(tumble, prior, integrated=True)
    assert planned.status is Status.NOT_CONVERGED and planned.innovation > 10
    assert integrated.status is Status.CONVERGED and integrated.innovation < 1.1


def test_a_prior_that_is_too_wide_is_seen(first):
    """A hundred times wider against 1 ug: whatever becomes of it, numbers and no false claim."""
    tumble, prior, _ = first
    for scale in (100.0, 1e6, 1e12):
        filtered = filter_angles(tumble, replace(prior, sd=scale * prior.sd), LITERAL)
        assert filtered.status in (Status.NOT_CONVERGED, Status.NOT_FINITE)
        assert all_finite(filtered)
        assert (np.diag(filtered.cov) >= 0).all()


def test_lost_sign_lost_numbers_and_a_singular_attitude(first):
    tumble, prior, _ = first
    wide = replace(prior, sd=np.where(np.arange(46) < 3, 1.0, 1e4 * prior.sd))
    lost = filter_angles(replace(tumble, accel_variance=1e-24), wide, LITERAL)
    assert lost.status is Status.NOT_CONVERGED and all_finite(lost)
    assert "lost its sign" in lost.advice and f"interval {lost.intervals}" in lost.advice
    reading = tumble.reading.copy()
    reading[700] = np.inf
    broken = filter_angles(replace(tumble, reading=reading), prior)
    assert broken.status is Status.NOT_FINITE and broken.intervals == 700 and all_finite(broken)
    assert len(broken.course.time) == 5 and "not finite" in broken.advice
    gimbal = State(attitude_of(np.array([0.1, np.pi / 2 - 1e-9, 0.2])).T, np.zeros(42))
    still = replace(tumble, command=np.tile(gimbal.C_np.T @ tumble.w_ie_n, (27000, 1)))
    locked = filter_angles(replace(still, used=np.zeros(27000, bool)), replace(prior, mean=gimbal))
    assert locked.status is Status.NOT_CONVERGED and "90 deg" in locked.advice
    assert locked.intervals == 0 and all_finite(locked) and len(locked.course.time) == 0


def test_noise_that_fades():
    options = Options(extra_sd=1e-4, fading=100.0)
    sd = np.sqrt(options.variance(np.array([0.0, 100.0, 1e5]), 1e-6))
    np.testing.assert_allclose(sd[:, 0], [1.01e-4, 1e-6 + 1e-4 / np.e, 1e-6])
    assert sd.shape == (3, 3)
    assert (LITERAL.variance(np.zeros(2), 1e-6) == 1e-12).all()
