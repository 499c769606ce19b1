"""A model of something that drifts and is late, and everything that follows from stating it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest

from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.errors import FoucaultError, error
from foucault.infer import filtered
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.linear_filter import (
    LinearSystem,
    by_prior,
    extended,
    h_infinity,
    kalman,
    least_gamma,
)

EPOCHS, TURN = 120, 0.3
DRIFT, NOISE, OTHER = 1e-4, 0.02, 0.05
OFFSET_SD, DELAY_SD = 0.3, 1.0
TIME = np.arange(EPOCHS) * 1.0


@dataclass(frozen=True)
class Late:
    """``z = sin(w (t - tau)) + offset`` twice, the offset a random walk: linear about a delay."""

    z: np.ndarray
    start: float = 0.0
    noise: float = NOISE
    pull: float = 0.0  # what else is thought to be in z
    lowest: float = -3.0

    names: ClassVar = ("offset", "delay")
    first: ClassVar = 1
    kinds: ClassVar = {"fine": slice(0, 1), "coarse": slice(1, 2)}

    def about(self, point: float) -> LinearSystem:
        if point > 3.0:
            raise error("strapdown.not_finite", row=1, time="1")
        phase = TURN * (TIME - point)
        row = np.stack([np.ones(EPOCHS), -TURN * np.cos(phase)], axis=1)
        z = self.z - self.pull - np.sin(phase)[:, None]
        R = np.tile([self.noise**2, OTHER**2], (EPOCHS, 1))
        half = np.tile([DRIFT**2 / 2, 0.0], (EPOCHS, 1))
        P0 = np.diag([OFFSET_SD**2, DELAY_SD**2])
        return LinearSystem(np.tile([[[1.0, 0.0]]], (EPOCHS, 1, 1)), half,
                            np.stack([row, row], axis=1), z, R,
                            np.array([0.0, self.start - point]), P0)  # fmt: skip

    def retract(self, point: float, x: np.ndarray) -> float | None:
        return None if point + x[1] < self.lowest else point + float(x[1])

    def values(self, point: float) -> np.ndarray:
        return np.array([point])


def drawn(seed: int, noise: float = NOISE, **more) -> tuple[Late, float]:
    rng = np.random.default_rng(seed)
    tau = DELAY_SD * rng.standard_normal()
    offset = OFFSET_SD * rng.standard_normal() + DRIFT * rng.standard_normal(EPOCHS).cumsum()
    clean = np.sin(TURN * (TIME - tau)) + offset
    sd = np.array([noise, OTHER])
    return Late(clean[:, None] + sd * rng.standard_normal((EPOCHS, 2)), **more), tau


@pytest.mark.thorough
def test_passes_end_where_they_should_and_errors_are_as_large_as_told():
    total, runs = 0.0, 400
    for seed in range(runs):
        model, tau = drawn(seed)
        found = filtered.fit(model, passes=8, settled=0.01)
        assert found.moved.max() < 0.01 and len(found.passes) < 8
        assert found.point == pytest.approx(found.values[0], abs=found.cov[0, 0] ** 0.5)
        total += (found.values[0] - tau) ** 2 / found.cov[0, 0]
    low, high = chi_square_limits(runs)
    assert low < total < high
    assert not low < total / 0.7 < high and not low < total * 0.7 < high


def test_one_pass_is_linear_about_the_prior_and_later_ones_keep_it():
    """The prior is the same about any point: the last pass is a fixed point of the next."""
    model, _ = drawn(1)
    long = filtered.fit(model, passes=12)
    again = filtered.fit(replace(model, start=0.0), passes=13)
    np.testing.assert_allclose(again.values, long.values, rtol=1e-9)
    sure = kalman(replace(model.about(0.2), R=np.full((EPOCHS, 2), np.inf)))
    assert sure.states[-1, 1] == pytest.approx(-0.2)  # nothing measured: the mean of the prior


@pytest.mark.parametrize("astray", [{"lowest": 9.0}, {}])
def test_passes_that_go_astray_end_with_what_is_there(astray):
    model, _ = drawn(2)
    if not astray:
        model = replace(model, z=model.z + 4.0 * np.cos(TURN * TIME)[:, None] * [-1.0, -1.0])
        with pytest.raises(FoucaultError):
            model.about(model.retract(0.0, np.array([0.0, 4.0])))
    found = filtered.fit(replace(model, **astray), passes=5)
    assert len(found.passes) == 1 and found.point == 0.0
    np.testing.assert_array_equal(found.system.z, model.about(0.0).z)


def test_innovations_are_judged_by_kind_from_both_sides():
    outside = 0
    for seed in range(40):
        found = filtered.components(filtered.fit(drawn(seed)[0], passes=4))
        assert found.keys() == Late.kinds.keys() and found["fine"].count == EPOCHS
        assert found["fine"].redundancy <= EPOCHS
        outside += any(not c.inside for c in found.values())
    assert outside <= 3  # more by chance: 0.1 %
    for wrong, side in ((1.5 * NOISE, "narrow"), (NOISE / 1.5, "wide")):
        found = filtered.components(filtered.fit(replace(drawn(3)[0], noise=wrong), passes=4))
        one = found["fine"]
        assert one.chi_square < one.low if side == "narrow" else one.chi_square > one.high


def test_as_many_are_independent_as_their_squares_scatter_like():
    rng, rho, n, runs = np.random.default_rng(0), 0.7, 400, 400
    sums, counted = np.empty(runs), np.empty(runs)
    for k in range(runs):
        e, u = rng.standard_normal(n + 100), np.zeros(n + 100)
        for i in range(1, n + 100):
            u[i] = rho * u[i - 1] + np.sqrt(1 - rho**2) * e[i]
        sums[k], counted[k] = np.mean(u[100:] ** 2), filtered.independent(u[100:])
    assert counted.mean() == pytest.approx(2.0 / sums.var(), rel=0.2)
    assert counted.mean() == pytest.approx(n * (1 - rho**2) / (1 + rho**2), rel=0.1)


def test_innovations_that_depend_on_one_another_are_told():
    beyond = 0
    for seed in range(40):
        worst, limit = filtered.dependence(filtered.fit(drawn(seed)[0], passes=4).run)
        beyond += worst > limit
    assert beyond <= 3
    model, _ = drawn(5)
    wave = 2 * NOISE * np.sin(1.1 * TIME)[:, None]
    worst, limit = filtered.dependence(filtered.fit(replace(model, z=model.z + wave)).run)
    assert worst > limit


def test_the_budget_is_what_each_source_does_through_the_filter_and_adds_up():
    model, _ = drawn(6)
    z = model.z.copy()
    z[40:45] = np.nan
    at = filtered.fit(replace(model, z=z), passes=1)
    system = replace(at.system, R=np.where(np.isnan(z), np.inf, at.system.R))
    at = replace(at, system=system, run=kalman(system))
    both = np.arange(2)
    parts = filtered.budget(at, {"prior": both}, {"process": both})
    assert parts.keys() == {"prior", "process", *Late.kinds}
    np.testing.assert_allclose(sum(parts.values()), np.diag(at.cov), rtol=1e-9)
    # A filter is linear: what one reading does is a column of what all of them do.
    column = np.zeros(EPOCHS)
    for k in range(EPOCHS):
        other = system.z.copy()
        other[k, 0] += 1.0
        column[k] = kalman(replace(system, z=other)).states[-1, 1] - at.run.states[-1, 1]
    by_fine = np.nansum(column**2) * NOISE**2
    assert parts["fine"][0] == pytest.approx(by_fine, rel=1e-9)
    moved = [kalman(replace(system, x0=system.x0 + e)).states[-1, 1] for e in np.eye(2)]
    by_prior_sd = (np.array(moved) - at.run.states[-1, 1]) * [OFFSET_SD, DELAY_SD]
    assert parts["prior"][0] == pytest.approx(np.sum(by_prior_sd**2), rel=1e-9)


def test_parts_are_predicted_as_the_dense_covariance_of_all_measurements_says():
    """Against the conditional distribution of a part given the others, without any recursion."""
    model, _ = drawn(12)
    at = filtered.fit(model, passes=1)
    s, edges = at.system, np.array([0, 30, 75, EPOCHS])
    found = filtered.parts_out(at, edges)
    walk = np.minimum(*np.meshgrid(TIME + 1.0, TIME + 1.0)) * DRIFT**2
    x = np.kron(s.P0[0, 0] + walk, [[1.0, 0.0], [0.0, 0.0]])
    x[1::2, 1::2] = s.P0[1, 1]
    H = np.zeros((2 * EPOCHS, 2 * EPOCHS))
    for k in range(EPOCHS):
        H[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = s.H[k]
    C = H @ x @ H.T + np.diag(s.R.ravel())
    left = (s.z - np.einsum("kqn,n->kq", s.H, s.x0)).ravel()
    for k, (a, b) in enumerate(pairwise(2 * edges)):
        F = (np.arange(2 * EPOCHS) >= a) & (np.arange(2 * EPOCHS) < b)
        gain = np.linalg.solve(C[np.ix_(~F, ~F)], C[np.ix_(~F, F)]).T
        e = left[F] - gain @ left[~F]
        score = e @ np.linalg.solve(C[np.ix_(F, F)] - gain @ C[np.ix_(~F, F)], e)
        assert found.scores[k] == pytest.approx(score, rel=1e-8)
        assert found.counts[k] == b - a


def test_the_worst_part_is_judged_and_clean_sessions_pass_at_the_stated_rate():
    edges, beyond, noticed, before = np.linspace(0, EPOCHS, 5).astype(int), 0, 0, 0
    for seed in range(60):
        model, _ = drawn(seed)
        at = filtered.fit(model, passes=4)
        found = filtered.parts_out(at, edges, 0.05)
        assert found.high == found.limits[found.worst] > found.count
        beyond += found.score > found.high
        # A quarter of the readings is noisier than was said.
        z = model.z.copy()
        z[30:60] += (
            0.9 * np.array([NOISE, OTHER]) * np.random.default_rng(seed).normal(size=(30, 2))
        )
        at = filtered.fit(replace(model, z=z), passes=4)
        found = filtered.parts_out(at, edges, 0.05)
        noticed += found.score > found.high and found.worst == 1
        before += any(c.chi_square > c.high for c in filtered.components(at, 0.05).values())
    assert beyond <= 9  # 3 are expected, more than 9 come by chance once in a thousand
    assert noticed > 30 and noticed > before


def test_parts_of_white_rows_are_predicted_as_by_solving_without_them():
    rng, n = np.random.default_rng(3), 4
    J, prior = rng.normal(size=(50, 3, n)), np.eye(n)
    y = rng.normal(size=(50, 3))
    N = np.einsum("bqi,bqj->ij", J, J) + prior
    x = np.linalg.solve(N, np.einsum("bqi,bq->i", J, y))
    rows = filtered.Whitened(y - J @ x, J, np.linalg.inv(N))
    assert rows.leverage.sum() == pytest.approx(n - np.trace(np.linalg.inv(N)))
    pieces = rows.parts(7)
    found = rows.parts_out(pieces)
    for k, piece in enumerate(pieces):
        others = np.setdiff1d(np.arange(50), piece)
        N = np.einsum("bqi,bqj->ij", J[others], J[others]) + prior
        x = np.linalg.solve(N, np.einsum("bqi,bq->i", J[others], y[others]))
        A, e = J[piece].reshape(-1, n), (y - J @ x)[piece].ravel()
        score = e @ np.linalg.solve(np.eye(len(e)) + A @ np.linalg.solve(N, A.T), e)
        assert found.scores[k] == pytest.approx(score, rel=1e-9)
    sums, cov = rows.sums(5)
    assert sums.shape == (15,) and np.linalg.matrix_rank(cov) == 15
    value, dof = rows.square(slice(None), 1)
    assert value == pytest.approx(np.sum(rows.residuals[:, 1] ** 2))
    assert dof == pytest.approx(50 - rows.leverage[:, 1].sum())


def test_a_planned_run_is_foreseen_without_measurements():
    model, tau = drawn(7)
    plan = replace(model, z=np.zeros_like(model.z), start=tau)
    found = filtered.fit(model, passes=6)
    np.testing.assert_allclose(filtered.foreseen(plan).cov, found.cov, rtol=0.02)


def test_a_robust_filter_is_less_certain_than_that_of_kalman():
    at = filtered.fit(drawn(8)[0])
    assert at.nominal
    L = by_prior(at.system)
    robust = replace(at, run=h_infinity(at.system, L, 1.5 * least_gamma(at.system, L)))
    assert not robust.nominal and (np.diag(robust.cov) > np.diag(at.cov)).all()


def test_another_model_is_what_it_does_about_the_same_point():
    model, _ = drawn(9)
    at = filtered.fit(model, passes=6)
    pulled = replace(model, pull=0.05 * np.cos(TURN * TIME)[:, None])
    moved = filtered.fit(pulled, passes=6).values - at.values
    np.testing.assert_allclose(filtered.response(at, pulled), moved, rtol=0.05)
    np.testing.assert_array_equal(filtered.response(at, model), 0.0)


def test_more_states_are_more_columns():
    """The delay as a state that is added is the delay that was one from the beginning."""
    whole = drawn(10)[0].about(0.0)
    alone = replace(whole, half=whole.half[:, :1], H=whole.H[:, :, :1], Phi=whole.Phi[:, :, :1],
                    x0=whole.x0[:1], P0=whole.P0[:1, :1])  # fmt: skip
    both = kalman(extended(alone, whole.H[:, :, 1:], DELAY_SD))
    np.testing.assert_array_equal(both.states, kalman(whole).states)
    np.testing.assert_array_equal(both.cov, kalman(whole).cov)


# -- another prior ---------------------------------------------------------------------------------


def measured(A: np.ndarray, y: np.ndarray, mean: np.ndarray, sd: np.ndarray) -> CoefficientVector:
    """Estimate ``y = A x + e`` with a prior, e of unit variance, by its triangular factor."""
    Q, R = np.linalg.qr(np.vstack([A, np.diag(1 / sd)]))
    root = np.linalg.inv(R)
    names = [f"x{k}" for k in range(len(sd))]
    layout = Layout(tuple(Coefficient(n, "x", "scale factor error", n) for n in names))
    values = root @ Q.T @ np.concatenate([y, mean / sd])
    return CoefficientVector(layout, values, root @ root.T, prior_sd=sd)


@pytest.mark.parametrize("seed", range(5))
def test_another_prior_is_as_if_it_had_been_there_from_the_start(seed: int) -> None:
    """Wider, narrower, infinite, and elsewhere: by the information of a well-conditioned case."""
    rng = np.random.default_rng(seed)
    A, y = rng.normal(size=(9, 5)), rng.normal(size=9)
    mean, sd = rng.normal(size=5), rng.uniform(0.2, 2.0, 5)
    times = np.array([3.0, 0.3, 1.0, np.inf, 0.01])
    found = measured(A, y, mean, sd)
    wanted = replace(found, values=rng.normal(size=5), prior_sd=sd * times)
    got = filtered.exchanged(found, (mean, sd), wanted)
    D = np.diag(1 / wanted.prior_sd**2)
    cov = np.linalg.inv(A.T @ A + D)
    np.testing.assert_allclose(got.cov, cov, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(got.values, cov @ (A.T @ y + D @ wanted.values), rtol=1e-9)
    assert got.prior_sd is wanted.prior_sd
    back = filtered.exchanged(got, (wanted.values, wanted.prior_sd), replace(got, values=mean,
                              prior_sd=np.where(np.isfinite(times), sd, np.inf)))  # fmt: skip
    known = np.where(np.isfinite(times), 1 / sd**2, 0.0)
    np.testing.assert_allclose(back.cov, np.linalg.inv(A.T @ A + np.diag(known)), rtol=1e-6)


def test_a_prior_is_exchanged_beside_a_sum_that_is_known_for_certain() -> None:
    """Of two states the sum is known to 1e-9, each little; two are hardly seen, or never."""
    A = np.diag([1e9, 0.5, 1.0, 1e-9, 0.0])
    A[0, 1] = 1e9
    y, mean, sd = np.array([3e8, 0.1, -0.4, 0.0, 0.0]), np.zeros(5), np.ones(5)
    times = np.array([40.0, 3.0, 1.0, 40.0, 1e3])
    found, want = measured(A, y, mean, sd), measured(A, y, mean, sd * times)
    assert found.cov is not None and want.cov is not None
    with suppress(np.linalg.LinAlgError):  # by information
        other = np.linalg.inv(np.linalg.inv(found.cov) + np.diag(1 / times**2 - 1))
        assert np.abs(other / want.cov - 1)[:2, :2].max() > 0.1
    got = filtered.exchanged(found, (mean, sd), replace(found, values=mean, prior_sd=sd * times))
    np.testing.assert_allclose(got.cov, want.cov, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(got.values, want.values, atol=1e-6)
    never = filtered.exchanged(found, (mean, sd), replace(found, values=mean, prior_sd=sd * np.inf))
    assert never.cov is not None and np.isfinite(never.cov).all()
    assert never.sd[4] > 1e7 and never.sd[1] == pytest.approx(2.0)
    certain = filtered.exchanged(found, (mean, sd), replace(found, prior_sd=np.zeros(5)))
    np.testing.assert_allclose(certain.sd, 0.0, atol=1e-12)


def test_a_part_of_which_all_was_left_out_is_not_the_worst():
    found = filtered.HeldOut(np.array([0.0, 5.0, 9.0]), np.array([0.0, 4.0, 4.0]))
    assert (found.worst, found.count) == (2, 4.0)
    assert filtered.HeldOut(np.zeros(2), np.zeros(2)).count == 0
