"""The error of a stationary navigator is fitted by its seven terms, with the right signs."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.diagnose import schuler
from foucault.diagnose.navigation import error_of
from foucault.diagnose.schuler import (
    STATES,
    TERMS,
    Place,
    dynamics,
    noise_covariance,
    responses,
)
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs.reference import Reference
from foucault.models.earth import earth_rate_n, gravity
from foucault.models.rotation import exp, matrix_of
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State, navigate

LATITUDE, HEIGHT = np.radians(47.3), 430.0
PLACE = Place(LATITUDE, HEIGHT, float(gravity(LATITUDE, HEIGHT)))
HEADING, PITCH, ROLL = np.radians([63.0, 4.0, -7.0])
C_NB = matrix_of(HEADING, PITCH, ROLL)
ARW, VRW = np.radians(0.002) / 60, 5e-5  # [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]


def drifted(duration, *, phi=(0, 0, 0), velocity=(0, 0), eps_n=(0, 0, 0), bias_n=(0, 0), step=0.1):
    """Navigate readings at rest with these errors in n; return age and horizontal error."""
    n = round(duration / step) + 1
    w = C_NB.T @ (earth_rate_n(LATITUDE) + np.asarray(eps_n, float))
    f = C_NB.T @ (np.array([0, 0, PLACE.gravity]) + np.array([*bias_n, 0.0]))
    readings = Increments.of(np.arange(n) * step, np.tile(w * step, (n, 1)),
                             np.tile(f * step, (n, 1)))  # fmt: skip
    start = State(LATITUDE, 0.1, HEIGHT, np.array([*velocity, 0.0]), exp(-np.array(phi)) @ C_NB)
    run = navigate(readings, start, vertical="held")
    found = error_of(run, Reference.site(run.time, LATITUDE, 0.1, HEIGHT))
    return found.age, found.position[:, :2]


def at_end(fit):
    """Return what each term contributes at the end of a fit, by name."""
    return {name: fit.parts[-1, :, k] for k, name in enumerate(TERMS)}


DRIFT = np.radians(0.01) / 3600
ONE = {
    "velocity east": ({"velocity": (0.05, 0)}, 0.05),
    "velocity north": ({"velocity": (0, 0.05)}, 0.05),
    "tilt about east": ({"phi": (5e-5, 0, 0)}, 5e-5),
    "tilt about north": ({"phi": (0, 5e-5, 0)}, 5e-5),
    "drift about east": ({"eps_n": (DRIFT, 0, 0)}, DRIFT),
    "drift about north": ({"eps_n": (0, DRIFT, 0)}, DRIFT),
    "drift about up": ({"eps_n": (0, 0, DRIFT)}, DRIFT),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("hours", [1.5, 12.0])
def test_one_error_comes_back_as_itself_and_nothing_else(name: str, hours: float) -> None:
    """Through the strapdown: 12 h hold most of a Foucault period and half a day."""
    injected, value = ONE[name]
    age, error = drifted(3600 * hours, **injected)
    fit = schuler.fit(age, error, PLACE, gyro_white=1e-9, accel_white=1e-7)
    k = TERMS.index(name)
    assert fit.values[k] == pytest.approx(value, rel=2e-3)
    others = np.delete(np.abs(fit.parts).max(axis=(0, 1)), k)
    assert others.max() < 5e-3 * np.abs(error).max()


def test_what_acts_alike_is_found_as_one_term() -> None:
    """A heading error is an east gyro drift; an accelerometer bias is a tilt and two drifts."""
    w_n, w_u = PLACE.earth_rate
    age, error = drifted(6 * 3600, phi=(0, 0, 2e-4))
    fit = schuler.fit(age, error, PLACE, gyro_white=1e-9, accel_white=1e-7)
    assert fit.values[TERMS.index("drift about east")] == pytest.approx(2e-4 * w_n, rel=2e-3)
    assert "a heading error of 41." in str(fit.rows()[4]["same_as"])
    for axis, sign, tilt, cross in (
        (0, -1, "tilt about north", "drift about east"),
        (1, 1, "tilt about east", "drift about north"),
    ):
        bias = np.eye(2)[axis] * 1e-3
        age, error = drifted(12 * 3600, bias_n=bias)
        fit = schuler.fit(age, error, PLACE, gyro_white=1e-9, accel_white=1e-7)
        assert fit.values[TERMS.index(tilt)] == pytest.approx(sign * 1e-3 / PLACE.gravity, rel=2e-3)
        drift = -w_u * 1e-3 / PLACE.gravity
        assert fit.values[TERMS.index(cross)] == pytest.approx(drift, rel=5e-3)
        row = fit.rows()[TERMS.index(tilt)]
        assert f"102 ug to the {('east', 'north')[axis]}" in str(row["same_as"])


def test_the_solution_is_made_of_the_terms_in_the_books() -> None:
    t = np.array([300.0, 900.0, 1800.0])
    w = 2 * np.pi / PLACE.schuler_period
    r_n, r_e = PLACE.radii
    w_n, _ = PLACE.earth_rate
    R = responses(t, PLACE)
    drift = t - np.sin(w * t) / w
    near = {"rel": 0.02}  # over half an hour the 24 h period shows by a percent
    assert R[:, 0, 0] == pytest.approx(np.sin(w * t) / w, **near)
    assert R[:, 1, 2] == pytest.approx(r_n * (1 - np.cos(w * t)), **near)
    assert R[:, 0, 3] == pytest.approx(-r_e * (1 - np.cos(w * t)), **near)
    assert R[:, 1, 4] == pytest.approx(-r_n * drift, **near)
    assert R[:, 0, 5] == pytest.approx(r_e * drift, **near)
    azimuth = r_n * w_n * (t**2 / 2 - (1 - np.cos(w * t)) / w**2)
    assert R[:, 1, 6] == pytest.approx(azimuth, **near)
    assert PLACE.schuler_period / 60 == pytest.approx(84.4, abs=0.1)


def test_the_solution_has_the_schuler_and_the_earth_period() -> None:
    """Eigenvalues: Schuler split by the Foucault rate, and the Earth's rate."""
    rates = np.sort(np.abs(np.linalg.eigvals(dynamics(PLACE)).imag))[::2]
    w_s, (_, w_u) = 2 * np.pi / PLACE.schuler_period, PLACE.earth_rate
    assert rates[-2:] == pytest.approx([w_s - w_u, w_s + w_u], rel=2e-3)
    assert np.min(np.abs(rates / 7.292115e-5 - 1)) < 5e-3


def test_noise_alone_is_the_integral_that_it_should_be() -> None:
    t = np.linspace(5.0, 100.0, 20)
    P = noise_covariance(t, PLACE, 0.0, VRW)
    north = STATES.index("north")
    assert P[-1, 3, -1, 3] == pytest.approx(VRW**2 * 100, rel=1e-2)
    assert P[-1, north, -1, north] == pytest.approx(VRW**2 * 100**3 / 3, rel=1e-2)
    early = VRW**2 * (t[4] ** 2 * t[-1] / 2 - t[4] ** 3 / 6)
    assert P[-1, north, 4, north] == pytest.approx(early, rel=1e-2)
    P = noise_covariance(t, PLACE, ARW, 0.0)
    assert P[-1, 4, -1, 4] == pytest.approx(ARW**2 * 100, rel=1e-3)
    whole = P.reshape(140, 140)
    assert np.allclose(whole, whole.T, atol=1e-12 * np.abs(whole).max())


@pytest.mark.thorough
@pytest.mark.parametrize("of", ["position", "velocity"])
def test_the_standard_deviations_are_right(of: str) -> None:
    """NEES and chi-square of 60 runs inside two-sided limits; sd twice too small must fail."""
    rng = np.random.default_rng(5)
    t = np.linspace(0, 5400, 541)
    some = t[schuler._epochs(t)]
    P = noise_covariance(some, PLACE, ARW, VRW)
    rows = [0, 1] if of == "position" else [2, 3]
    m = len(some)
    half = np.linalg.cholesky(
        P[:, rows][:, :, :, rows].reshape(2 * m, 2 * m) + 1e-12 * np.eye(2 * m)
    )
    truth = np.array([0.01, -0.02, 2e-5, -1e-5, DRIFT, -DRIFT, 2 * DRIFT])
    clean = responses(some, PLACE)[:, rows] @ truth
    error = np.zeros((len(t), 2))
    nees, fits = 0.0, 0.0
    for _ in range(60):
        error[schuler._epochs(t)] = clean + (half @ rng.normal(size=2 * m)).reshape(m, 2)
        fit = schuler.fit(t, error, PLACE, gyro_white=ARW, accel_white=VRW, of=of)
        off = fit.values - truth
        scale = max(1.0, fit.chi_square / fit.dof)
        nees += off @ np.linalg.solve(fit.cov / scale, off)
        fits += fit.chi_square
    low, high = chi_square_limits(60 * len(TERMS), tests=2)
    assert low < nees < high
    assert not low < 4 * nees < high
    low, high = chi_square_limits(60 * fit.dof, tests=2)
    assert low < fits < high


def test_a_run_hardly_tells_a_drift_from_the_growing_heading_error() -> None:
    """About east and up: the second drives the first. With a coarse reference others join."""
    terms = {"phi": (5e-5, 0, 0), "eps_n": (DRIFT, 0, 0)}
    age, error = drifted(600, **terms)
    fit = schuler.fit(age, error, PLACE, gyro_white=ARW, accel_white=VRW)
    pairs = fit.combinations()
    assert {"drift about east", "drift about up"} in [{p.first, p.second} for p in pairs]
    for pair in pairs:
        i, j = TERMS.index(pair.first), TERMS.index(pair.second)
        weights = np.zeros(len(TERMS))
        weights[[i, j]] = 1.0, pair.factor
        assert pair.sd == pytest.approx(np.sqrt(weights @ fit.cov @ weights), rel=1e-6)
        assert pair.value == pytest.approx(weights @ fit.values, rel=1e-9)
        assert pair.sd < 0.55 * fit.sd[i]
        assert "This run hardly tells" in pair.sentence() and "±" in pair.sentence()
    assert fit.sd[TERMS.index("drift about east")] > DRIFT  # and ten minutes are few
    coarse = schuler.fit(age, error, PLACE, gyro_white=ARW, accel_white=VRW, error_sd=5.0)
    found = [{p.first, p.second} for p in coarse.combinations()]
    assert {"tilt about east", "drift about east"} in found and len(found) > len(pairs)


def test_terms_add_up_to_the_error() -> None:
    age, error = drifted(7200, phi=(3e-5, -2e-5, 1e-4), eps_n=(DRIFT, DRIFT, -DRIFT),
                         velocity=(0.01, -0.02))  # fmt: skip
    fit = schuler.fit(age, error, PLACE, gyro_white=1e-9, accel_white=1e-7)
    assert sum(at_end(fit).values()) == pytest.approx(error[-1], rel=5e-3)
    assert fit.parts.sum(axis=2) == pytest.approx(fit.observed, abs=5e-3 * np.abs(error).max())


def test_a_wandering_bias_widens_the_standard_deviations() -> None:
    age, error = drifted(3600, eps_n=(DRIFT, 0, 0))
    calm = schuler.fit(age, error, PLACE, gyro_white=ARW, accel_white=VRW)
    shaken = error + 30 * np.sin(age / 60)[:, None]
    fit = schuler.fit(age, shaken, PLACE, gyro_white=ARW, accel_white=VRW)
    assert fit.chi_square > fit.limits[1] and np.all(fit.sd > 3 * calm.sd)
