"""What is left out as states of a filter: against the covariance form, and by what is named."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.infer import left_out, left_out_states, mixed
from foucault.infer.gauss_newton import Component, chi_square_limits
from foucault.infer.left_out_states import Group, Posterior
from foucault.infer.mixed import Linearisation, Source
from foucault.models.imu import LAYOUT

N, NOISE = 60, 1e-3
ASKED = ("accel.bias.x", "accel.scale.x")
QUADRATIC, CROSS = "accel.quadratic.x", "accel.cross.xyy"
PRIOR_SD = {"accel.bias.x": 0.05, "accel.scale.x": np.inf}
SIZES = {QUADRATIC: 3e-4, CROSS: 2e-4}


def columns() -> dict[str, FloatArray]:
    """What one unit of each does to the readings, shape (n,)."""
    angle = np.arange(N) * 2.4
    x, y = 9.8 * np.cos(angle), 9.8 * np.sin(angle) * np.linspace(0.5, 1.0, N)
    return dict(zip((*ASKED, QUADRATIC, CROSS), (np.ones(N), x, x**2, y**2), strict=True))


class Linear:
    """The readings of one axis as `infer.mixed` takes them."""

    kinds: Mapping[str, BoolArray] = {"readings": np.ones((N, 1), bool)}
    layout = LAYOUT.subset(ASKED)
    start = np.zeros(2)

    def __init__(self, y: FloatArray) -> None:
        self.y = y

    def linearise(self, state: FloatArray) -> Linearisation:
        J = np.stack([columns()[n] for n in ASKED], axis=-1)[:, None]
        noise = Source("noise", np.ones((N, 1, 1)), sd=NOISE, noise=True)
        return Linearisation(self.y[:, None] - J @ state, J, (noise,))

    def retract(self, state: FloatArray, step: FloatArray) -> FloatArray:
        return state + step

    def values(self, state: FloatArray) -> FloatArray:
        return state


def made(seed: int = 0, **sizes: float) -> FloatArray:
    """Return readings with noise, and with terms of so many sizes."""
    rng = np.random.default_rng(seed)
    off = sum(k * SIZES[n] * columns()[n] for n, k in zip(SIZES, sizes.values(), strict=False))
    return 0.02 + 1e-3 * columns()[ASKED[1]] + off + NOISE * rng.standard_normal(N)


def known() -> CoefficientVector:
    """What is known beforehand of all states."""
    layout = Layout((*LAYOUT.subset(ASKED).coefficients, *LAYOUT.subset(SIZES).coefficients))
    sd = np.array([*PRIOR_SD.values(), *SIZES.values()])
    return CoefficientVector(layout, np.zeros(4), prior_sd=sd)


GROUPS = {
    "accel.quadratic": Group("source", (QUADRATIC,), SIZES[QUADRATIC]),
    "accel.cross": Group("source", (CROSS,), SIZES[CROSS]),
    "prior of accel.bias": Group("prior", ("accel.bias.x",)),
}


def solved(y: FloatArray, prior: CoefficientVector) -> Posterior:
    """Return the posterior of all states by plain least squares."""
    J = np.stack(list(columns().values()), axis=-1) / NOISE
    cov = np.linalg.inv(J.T @ J + np.diag(prior.prior_sd**-2.0))
    found = CoefficientVector(prior.layout, cov @ J.T @ y / NOISE, cov, prior_sd=prior.prior_sd)
    left = y / NOISE - J @ found.values
    square = float(left @ left)
    one = Component(square, N - 2.0, *chi_square_limits(N - 2.0, 0.01), N)
    return Posterior(found, prior.values, {"readings": one})


def fitted(y: FloatArray) -> tuple[Posterior, left_out.Judgement]:
    prior = known()
    return left_out_states.fit(
        lambda k: solved(y, left_out_states.widened(prior, GROUPS, k)), lambda at: at, GROUPS, ASKED
    )


def by_covariance(y: FloatArray) -> tuple[mixed.Fit, left_out.Judgement]:
    more = tuple(
        Source(n.rpartition(".")[0], shared=(s * columns()[n])[:, None, None])
        for n, s in SIZES.items()
    )
    prior = CoefficientVector(Linear.layout, np.zeros(2), prior_sd=known().prior_sd[:2])
    return left_out.fit(Linear(y), lambda _: more, prior, robust=False)


@pytest.mark.parametrize("sizes", [(), (0.5, -1.0), (12.0,), (0.0, 15.0)])
def test_states_and_covariance_are_the_same_estimator(sizes):
    y = made(**{f"k{i}": k for i, k in enumerate(sizes)})
    (at, judged), (fit, other) = fitted(y), by_covariance(y)
    found, cov = fit.estimate.coefficients, np.asarray(at.states.cov)
    np.testing.assert_allclose(at.states.values[:2], found.values, rtol=1e-6)
    np.testing.assert_allclose(cov[:2, :2], found.cov, rtol=1e-5)
    for name in GROUPS:
        a, b = judged.seen[name], other.seen[name]
        np.testing.assert_allclose(a.V, b.V, atol=1e-8)
        np.testing.assert_allclose(a.u, b.u, rtol=1e-5, atol=1e-7)
        assert judged.needed[name] == pytest.approx(other.needed[name], rel=1e-6)
    assert [set(n) for n in judged.named] == [set(n) for n in other.named]
    for group in judged.groups:
        assert judged.share[group] == pytest.approx(other.share[group], rel=1e-4, abs=1e-9)
    assert {n: k for n, (k, _) in judged.hidden.items()} == {
        n: k for n, (k, _) in other.hidden.items()
    }


def test_the_term_is_named_and_enlarged_and_the_bias_is_right_again():
    (at, judged), sure = fitted(made(k=12.0)), solved(made(k=12.0), known())
    assert next(iter(judged.named[0])) == "accel.quadratic"
    assert judged.named[0]["accel.quadratic"] == pytest.approx(12.0, rel=0.3)
    assert abs(at.states.values[0] - 0.02) < 3 * at.states.sd[0]
    assert at.states.sd[0] > sure.states.sd[0]


def test_noise_that_is_larger_than_declared_names_no_term():
    rng = np.random.default_rng(3)
    y = made() + 4 * NOISE * rng.standard_normal(N)
    assert "scatter of readings" in left_out.guilty(fitted(y)[1].seen)
    assert fitted(y)[1].named == ()


def test_a_prior_that_is_contradicted_is_named():
    judged = fitted(made() + 20 * PRIOR_SD["accel.bias.x"])[1]
    assert "prior of accel.bias" in judged.named[0]


def test_what_nothing_shows_and_nothing_hangs_on_is_not_there():
    prior = known()
    at = solved(made(), prior)
    cov = np.asarray(at.states.cov).copy()
    cov[3, :3] = cov[:3, 3] = 0.0
    cov[3, 3] = prior.prior_sd[3] ** 2
    alone = CoefficientVector(prior.layout, at.states.values, cov, prior_sd=prior.prior_sd)
    seen = left_out_states.tested(Posterior(alone, prior.values, at.innovations), GROUPS)
    assert "accel.cross" not in seen
    assert "accel.quadratic" in seen
