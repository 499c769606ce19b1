"""Information, bound, weakest combinations and the budget of uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.estimate.hand_rotated import RestsAndTurns, first_guess
from foucault.infer import mixed
from foucault.infer.information import information
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.layouts import gravity_slope
from foucault.models.noise import ImuNoise, SessionNoise, TriadNoise, grade
from foucault.models.rests_and_turns import Session
from foucault.plans.directions import hand_plan
from foucault.procedures import hand_rotated
from foucault.result import Linearised
from foucault.simulate.hand_rotated import draw_errors, simulate

LAYOUT = Layout(tuple(Coefficient(n, n, "angle", n) for n in ("a", "b", "c")))


def linearised(J: np.ndarray) -> Linearised:
    return Linearised(np.zeros(len(J)), J, np.arange(len(J)))


def test_bound_is_the_inverse_information_with_nuisance_eliminated() -> None:
    J = np.random.default_rng(0).normal(size=(30, 7)) * np.logspace(-3, 3, 7)
    info = information(linearised(J), LAYOUT)
    full = np.linalg.inv(J.T @ J)[:3, :3]
    np.testing.assert_allclose(info.cov, full, rtol=1e-9)
    np.testing.assert_allclose(info.matrix, np.linalg.inv(full), rtol=1e-9)
    assert info.rank == 3
    c = CoefficientVector(LAYOUT, np.zeros(3), 4 * full)
    np.testing.assert_allclose(c.sd / info.sd, 2.0)
    np.testing.assert_allclose(np.diag(info.correlation()), 1.0)


def test_a_combination_that_is_not_seen_is_named_and_has_no_bound() -> None:
    J = np.random.default_rng(1).normal(size=(20, 3))
    J[:, 1] = 5.0 * J[:, 0]
    info = information(linearised(J), LAYOUT)
    assert info.rank == 2
    assert np.isinf(info.sd[:2]).all()
    assert np.isfinite(info.sd[2])
    (worst,) = info.weakest()
    assert worst.words == "+0.71 a -0.71 b: not seen at all"


def test_a_weak_combination_says_how_weak() -> None:
    J = np.eye(3)
    J[:2, :2] = [[1.0, 0.99], [0.99, 1.0]]
    (worst,) = information(linearised(J), LAYOUT).weakest()
    s = np.linalg.svd(J / np.linalg.norm(J, axis=0), compute_uv=False)
    assert worst.factor == pytest.approx(1 / s[-1])
    assert set(worst.shares) == {"a", "b"}


NOISE = ImuNoise(
    TriadNoise(white=1e-3, bias_instability=1e-3, correlation_time=40.0, random_walk=1e-5),
    TriadNoise(white=1e-4, bias_instability=2e-5, correlation_time=40.0, random_walk=1e-6),
)


@pytest.mark.parametrize("latitude", [0.8, None])
@pytest.mark.parametrize("noise", [grade("mems").noise, NOISE])
def test_budget_adds_up_to_the_covariance(latitude: float | None, noise: ImuNoise) -> None:
    site = Site(9.81, latitude, gravity_sd=3e-4)
    simulation = simulate(
        hand_plan(14, 2.0, 1.5, 3.0), model=draw_errors("mems", 2), noise=noise,
        site=site, rate=50.0,
    )  # fmt: skip
    prior = {f"gyro.bias.{axis}": (0.0, 1e-2) for axis in "xyz"}
    alone, given = (
        hand_rotated.calibrate(simulation.log, site=site, noise=noise, prior=p)
        for p in (None, prior)
    )
    budget = {k: np.array(v) for k, v in given.diagnostics["budget"].items()}
    assert ("unknown Earth rate" in budget) == (latitude is None)
    assert set(given.diagnostics["sources"]) == set(budget)
    slow = {"slow noise of accelerometers", "slow noise of gyros"}
    assert slow <= set(budget) if noise is NOISE else not slow & set(budget)
    expected = (gravity_slope(given.coefficients) * 3e-4 / 9.81) ** 2
    np.testing.assert_allclose(budget["local gravity"], expected)
    for result in (alone, given):
        parts = [np.array(v) for v in result.diagnostics["budget"].values()]
        own = result.coefficients.sd**2
        np.testing.assert_allclose(np.sum(parts, axis=0), own, rtol=1e-6)
    # The share of a prior is what remains; without one nothing does.
    assert "prior" in budget and "prior" not in alone.diagnostics["budget"]


def test_a_wrong_gravity_changes_the_coefficients_as_the_slope_says() -> None:
    site = Site(9.81, 0.8)
    simulation = simulate(
        hand_plan(14, 2.0, 1.5, 3.0), model=draw_errors("mems", 2), noise=ImuNoise(),
        site=site, rate=200.0,
    )  # fmt: skip
    noise = SessionNoise.declared(grade("mems").noise, simulation.log.interval)

    def fitted(gravity: float) -> CoefficientVector:
        where = replace(site, gravity=gravity)
        data = Session.reduce(simulation.log, simulation.first, simulation.last, where)
        start = first_guess(data)
        assert start is not None
        return mixed.fit(RestsAndTurns(data, LINEAR_LOWER, start, noise)).estimate.coefficients

    step = 1e-5
    change = (fitted(9.81 * (1 + step)).values - fitted(9.81 * (1 - step)).values) / (2 * step)
    slope = gravity_slope(fitted(9.81))
    # The slope is that of the accelerometers; gyros do not know g.
    np.testing.assert_allclose(change, slope, atol=2e-4)
    assert ImuModel.from_coefficients(fitted(9.81)).accel_matrix[0, 0] == pytest.approx(
        simulation.model.accel_matrix[0, 0], abs=1e-6
    )
