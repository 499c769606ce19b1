"""What is not estimated as sources: against states, against refits, and by its own statistics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.infer import left_out, mixed
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.mixed import Linearisation, Source
from foucault.models.imu import LAYOUT

NAMES = ("accel.bias.x", "accel.scale.x", "accel.bias.y", "accel.scale.y")
NOISE, N = 1e-3, 40
SIZES = {"quadratic": 2, "drift": 1}


def design() -> tuple[FloatArray, dict[str, FloatArray]]:
    """Two axes: Jacobian (n, 2, 4), and columns of what is left out, of one size each."""
    f = 9.8 * np.cos(np.arange(N) * 2.4)[:, None] * [1.0, 0.0] + 9.8 * np.sin(np.arange(N) * 2.4)[
        :, None
    ] * [0.0, 1.0]
    J = np.zeros((N, 2, 4))
    for i in range(2):
        J[:, i, 2 * i], J[:, i, 2 * i + 1] = 1.0, f[:, i]
    quadratic = np.zeros((N, 2, 2))
    quadratic[:, [0, 1], [0, 1]] = 3e-5 * f**2
    drift = np.zeros((N, 2, 1))
    drift[:, :, 0] = 2e-3 * (np.arange(N) / (N - 1) - 0.5)[:, None]
    return J, {"quadratic": quadratic, "drift": drift}


@dataclass(frozen=True)
class Linear:
    """A linear model: exactly what the equations are about."""

    y: FloatArray  # (n, 2) [m/s^2]
    scatter: bool = False

    @property
    def layout(self) -> Layout:
        return LAYOUT.subset(NAMES)

    @property
    def start(self) -> FloatArray:
        return np.zeros(4)

    @property
    def kinds(self) -> dict[str, BoolArray]:
        return {"readings": np.ones((N, 2), bool)}

    def linearise(self, state: FloatArray) -> Linearisation:
        J = design()[0]
        noise = Source("noise", np.broadcast_to(np.eye(2), (N, 2, 2)), sd=NOISE, noise=True)
        more = Source("scatter", np.broadcast_to(np.eye(2), (N, 2, 2)), sd=None, unexplained=True)
        sources = (noise, more) if self.scatter else (noise,)
        return Linearisation(self.y - J @ state, J, sources)

    def retract(self, state: FloatArray, step: FloatArray) -> FloatArray:
        return state + step

    def values(self, state: FloatArray) -> FloatArray:
        return state


def sources(scale: float = 1.0) -> tuple[Source, ...]:
    return tuple(Source(n, shared=B, sd=scale) for n, B in design()[1].items())


def drawn(rng: np.random.Generator, sizes: dict[str, float]) -> Linear:
    """Draw readings of no coefficients, with so many sizes of each group."""
    y = NOISE * rng.standard_normal((N, 2))
    for name, B in design()[1].items():
        y += B @ (sizes.get(name, 0.0) * rng.standard_normal(B.shape[2]))
    return Linear(y)


def whole(model: Linear, prior: CoefficientVector | None = None, **sizes: float) -> mixed.Fit:
    return mixed.fit(left_out.With(model, sources(), sizes), prior)


PRIOR = CoefficientVector.prior(LAYOUT.subset(NAMES), {"accel.bias.x": (2e-3, 1e-3)})


@pytest.mark.parametrize("k", [1.0, 3.0])
@pytest.mark.parametrize("prior", [None, PRIOR])
def test_sources_are_states_with_a_prior(k, prior) -> None:
    model = drawn(np.random.default_rng(1), {"quadratic": 2.0, "drift": 1.0})
    at = whole(model, prior, quadratic=k)
    J, columns = design()
    B = np.concatenate([k * columns["quadratic"], columns["drift"]], axis=2)
    A = np.concatenate([J, B], axis=2).reshape(2 * N, -1) / NOISE
    information = A.T @ A
    information[4:, 4:] += np.eye(3)
    right = A.T @ model.y.ravel() / NOISE
    if prior is not None:
        information[0, 0] += 1e6
        right[0] += 2e-3 * 1e6
    cov = np.linalg.inv(information)
    x = cov @ right
    np.testing.assert_allclose(at.estimate.coefficients.values, x[:4], rtol=1e-9)
    np.testing.assert_allclose(at.estimate.coefficients.sd, np.sqrt(np.diag(cov)[:4]), rtol=1e-9)
    seen = left_out.tested(at)
    t = np.concatenate([seen["quadratic"].u, seen["drift"].u])
    np.testing.assert_allclose(t, x[4:], rtol=1e-9)
    np.testing.assert_allclose(seen["quadratic"].V, np.eye(2) - cov[4:6, 4:6], atol=1e-9)
    assert ("prior of accel.bias" in seen) is (prior is not None)


def unlikely(model: Linear, k: float) -> float:
    """Twice the negative restricted log-likelihood with the quadratic k times its size."""
    J, columns = design()
    V = NOISE**2 * np.eye(2 * N)
    for B in (k * columns["quadratic"], columns["drift"]):
        V += B.reshape(2 * N, -1) @ B.reshape(2 * N, -1).T
    A, y = J.reshape(2 * N, 4), model.y.ravel()
    W = np.linalg.inv(V)
    r = y - A @ np.linalg.solve(A.T @ W @ A, A.T @ W @ y)
    return float(r @ W @ r + np.linalg.slogdet(V)[1] + np.linalg.slogdet(A.T @ W @ A)[1])


def test_the_gain_of_a_size_is_that_of_the_restricted_likelihood_fitted_again() -> None:
    model = drawn(np.random.default_rng(2), {"quadratic": 6.0, "drift": 1.0})
    seen = left_out.tested(whole(model))["quadratic"]
    assert seen.k > 2
    assert seen.gain == pytest.approx(unlikely(model, 1.0) - unlikely(model, seen.k), rel=1e-6)
    near = [unlikely(model, seen.k * part) for part in (0.9, 1.1)]
    assert unlikely(model, seen.k) < min(near)


def test_while_every_term_has_its_size_the_test_is_chi_square() -> None:
    rng, T = np.random.default_rng(3), {"quadratic": [], "drift": []}
    for _ in range(400):
        seen = left_out.tested(whole(drawn(rng, {"quadratic": 1.0, "drift": 1.0})))
        for name in T:
            assert seen[name].dof == SIZES[name]
            T[name].append(seen[name].T)
    for name, values in T.items():
        assert kstest(values, chi2(SIZES[name]).cdf).pvalue > 0.01 / 2
        low, high = chi_square_limits(400 * SIZES[name], tests=2)
        assert low < sum(values) < high


def test_a_term_of_the_size_that_is_said_to_be_needed_is_named_in_nine_of_ten_sessions() -> None:
    rng, columns = np.random.default_rng(4), design()[1]["quadratic"]
    first = left_out.tested(whole(drawn(rng, {})))
    needed = left_out.detectable(first["quadratic"], len(first))
    size, named, trials = needed[0], 0, 300
    for _ in range(trials):
        model = drawn(rng, {"drift": 1.0})
        t = np.array([size, 0.0])
        y = model.y + columns @ t
        seen = left_out.tested(whole(Linear(y)))
        named += seen["quadratic"].p < 0.01 / len(seen)
    # The size is not drawn here, so that T scatters a little less than it is taken to.
    assert 0.9 - 3 * np.sqrt(0.09 / trials) < named / trials


def test_terms_that_matter_and_are_not_seen_are_counted_beside_one_that_is() -> None:
    seen = left_out.seen_of("source", np.zeros(4), np.diag([0.9, 1e-3, 4e-3, 1e-3]))
    needed = left_out.detectable(seen, 20)
    assert needed[0] < left_out.UNSEEN < needed[2] < needed[1]
    # The first is seen, the last does not matter.
    found = left_out.hidden(seen, 20, np.array([0.5, 0.5, 0.02, 0.009]))
    assert found == (2, pytest.approx(needed[2]))
    assert left_out.hidden(seen, 20, np.array([0.9, 0.0, 0.0, 0.0])) is None
    assert left_out.hidden(seen, 20, np.array([0.0, 0.5, 0.0, 0.0])) == (1, needed[1])


def test_what_is_not_there_or_looks_like_a_coefficient_is_no_suspect() -> None:
    model = drawn(np.random.default_rng(5), {})
    J = design()[0]
    dead = (
        Source("nothing", shared=np.zeros((N, 2, 1))),
        Source("alias", shared=1e-3 * J[:, :, 1:2]),
        Source("one", shared=design()[1]["drift"]),
        Source("same", shared=design()[1]["drift"]),
    )
    seen = left_out.tested(mixed.fit(left_out.With(model, dead)))
    assert "nothing" not in seen
    assert seen["alias"].dof == 0 and seen["alias"].T == 0.0 and seen["alias"].p == 1.0
    assert np.isinf(left_out.detectable(seen["alias"], 3)).all()
    assert pytest.approx(seen["same"].T, rel=1e-9) == seen["one"].T


def test_the_rule_names_what_is_larger_than_its_size_and_makes_the_fit_honest() -> None:
    rng, nees = np.random.default_rng(6), []
    for _ in range(60):
        model = replace(drawn(rng, {}), scatter=True)
        model = replace(model, y=model.y + design()[1]["quadratic"] @ [20.0, -20.0])
        at, judged = left_out.fit(model, lambda _: sources())
        assert [list(one) for one in judged.named] == [["quadratic"]]
        assert judged.named[0]["quadratic"] == pytest.approx(20.0, rel=0.5)
        assert not any(at.found.values())
        c = at.estimate.coefficients
        nees.append(c.values @ np.linalg.solve(c.cov, c.values))
    assert sum(nees) < chi_square_limits(4 * 60)[1]


def test_the_rule_names_nothing_while_all_have_their_size() -> None:
    rng, nees, named = np.random.default_rng(7), [], 0
    for _ in range(100):
        model = replace(drawn(rng, {"quadratic": 1.0, "drift": 1.0}), scatter=True)
        at, judged = left_out.fit(model, lambda _: sources())
        named += bool(judged.named)
        c = at.estimate.coefficients
        nees.append(c.values @ np.linalg.solve(c.cov, c.values))
    assert named <= 5  # 1 % of all sessions; six of a hundred come by chance in 5e-4
    low, high = chi_square_limits(4 * 100)
    assert low < sum(nees) < high


def test_scatter_of_no_cause_accuses_no_term() -> None:
    rng = np.random.default_rng(8)
    for _ in range(20):
        model = drawn(rng, {})
        model = Linear(model.y + 5 * NOISE * rng.standard_normal((N, 2)))
        at, judged = left_out.fit(model, lambda _: sources())
        assert not judged.named
        assert at.found["scatter of readings"] == pytest.approx(5 * NOISE, rel=0.4)


def test_a_prior_that_is_wrong_is_named_not_a_term() -> None:
    rng = np.random.default_rng(9)
    wrong = CoefficientVector.prior(LAYOUT.subset(NAMES), {"accel.bias.x": (20e-3, 1e-3)})
    at, judged = left_out.fit(drawn(rng, {}), lambda _: sources(), wrong)
    assert next(iter(judged.named[0])) == "prior of accel.bias"
    assert abs(at.estimate.coefficients.values[0]) < 4 * at.estimate.coefficients.sd[0]


@pytest.mark.parametrize("there", [0.0, 1.0])
def test_the_own_part_of_readings_is_as_noisy_as_it_should_be_whatever_they_share(there) -> None:
    rng, halves = np.random.default_rng(9), np.arange(2 * N) < N
    squares, free = np.zeros((300, 2)), np.zeros(2)
    for k in range(len(squares)):
        at = whole(drawn(rng, dict.fromkeys(SIZES, there)), quadratic=30.0, drift=30.0)
        z, free_of = at.own
        squares[k] = [np.sum(z[h] ** 2) for h in (halves, ~halves)]
        free = np.array([np.sum(free_of[h]) for h in (halves, ~halves)])
    J, columns = design()
    B = np.concatenate([J, *(30.0 * c for c in columns.values())], axis=2).reshape(2 * N, -1)
    Q = np.linalg.qr(B)[0]  # at 30 sizes it is nearly as if they were estimated
    np.testing.assert_allclose(free.sum(), 2 * N - Q.shape[1], rtol=1e-3)
    low, high = chi_square_limits(free.sum() * len(squares), tests=2)
    assert low <= squares.sum() <= high
    # The variance of a half is at most that of chi-square: a limit of its mean.
    off = (squares.mean(axis=0) - free) / np.sqrt(2 * free / len(squares))
    assert np.abs(off).max() < 3.3
