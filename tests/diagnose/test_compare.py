"""Results compared: limits that hold their rate of false alarms, changes named, drift and step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from foucault.diagnose.comparable import constant, line, step
from foucault.diagnose.compare import YEAR, between, history, pair
from foucault.infer.gauss_newton import chi_square_limits
from make_compare import make_series

NAMES = ("accel.bias.x", "accel.scale.x", "gyro.bias.x", "gyro.bias.y", "gyro.scale.z")


def shifted(series, k, by):
    """Add `by`, one number for each result in sd of the first, to coefficient k."""
    values = series.values.copy()
    values[:, k] += np.asarray(by) * series.sd[0, k]
    return replace(series, values=values)


@pytest.mark.thorough
@pytest.mark.parametrize("n", [2, 4])
def test_one_comparison_in_a_hundred_of_the_unchanged_is_a_false_alarm(n):
    trials = 400
    found = [history(make_series(n, NAMES, seed)) for seed in range(trials)]
    alarms = sum(h.changed for h in found)
    # Tests that share one percent are not independent: there may be fewer alarms, not more.
    assert alarms <= binom.ppf(0.995, trials, 0.01)
    assert alarms >= binom.ppf(0.005, trials, 0.01 / 3)  # and the omnibus alone makes so many
    low, high = chi_square_limits(trials * found[0].dof)
    assert low < sum(h.chi_square for h in found) < high
    # Coefficient by coefficient, and slopes, as large as their sd say.
    low, high = chi_square_limits(trials * (n - 1))
    assert low < sum(h.courses[2].chi_square for h in found) < high
    low, high = chi_square_limits(trials)
    assert low < sum((h.courses[1].drift / h.courses[1].drift_sd) ** 2 for h in found) < high
    assert low < sum(h.pairs[0].w[3] ** 2 for h in found) < high


@pytest.mark.thorough
def test_a_covariance_that_is_too_small_is_found():
    alarms = 0
    for seed in range(200):
        series = make_series(3, NAMES, seed)
        alarms += history(replace(series, cov=series.cov / 4)).changed
    assert alarms > 150


def test_two_results_are_the_usual_difference():
    series = make_series(2, NAMES, 5)
    d = series.values[1] - series.values[0]
    S = series.cov[0] + series.cov[1]
    h = history(series)
    assert h.chi_square == pytest.approx(d @ np.linalg.solve(S, d))
    assert h.dof == 5 and len(h.pairs) == 1
    p = h.pairs[0]
    np.testing.assert_allclose(p.z, d / np.sqrt(np.diag(S)))
    assert p.chi_square == pytest.approx(h.chi_square)
    assert p.chi_square == pytest.approx(h.chi_square) and h.pair_limit == h.high
    assert h.z_limit == pytest.approx(np.sqrt(h.limit))
    for k, course in enumerate(h.courses):
        assert course.chi_square == pytest.approx(p.z[k] ** 2)
        # Left out, a coefficient takes with it what a change of it alone would explain.
        assert course.left == pytest.approx(h.chi_square - p.w[k] ** 2)


def test_correlations_inside_a_result_count():
    # Two errors that are nearly the same: their sum is badly known, their difference well.
    cov = np.array([[1.0, 0.999], [0.999, 1.0]])
    series = replace(
        make_series(2, NAMES[:2], 1), values=np.array([[0.0, 0.0], [0.5, -0.5]]),
        cov=np.stack([cov, cov]),
    )  # fmt: skip
    h = history(series)
    assert np.abs(h.pairs[0].z).max() < 0.4  # each alone is nothing
    assert h.changed and not h.standing_out
    assert h.chi_square == pytest.approx(1.0 / (4 * 0.001))


@pytest.mark.parametrize("k", [0, 3])
def test_a_change_is_named_with_its_size(k):
    alone = 0
    for seed in range(40):
        same = make_series(2, NAMES, seed)
        size = 12 * pair(same, 0, 1).sd[k]
        h = history(shifted(same, k, [0.0, size / same.sd[0, k]]))
        p = h.pairs[0]
        assert abs(p.change[k] - size) < 4.5 * p.sd[k]
        assert h.changed and h.standing_out == (k,) and h.likeliest == k
        assert h.courses[k].how == "change"  # of two results, no more can be said
        assert h.alone == (p.alone == k)
        alone += h.alone
    assert alone >= binom.ppf(0.001, 40, 0.99)  # what is left is refused once in a hundred


@pytest.mark.thorough
def test_drift_step_and_scatter_are_told_apart():
    said = {"drift": 0, "step": 0, "scatter": 0}
    wanted = {
        "drift": np.arange(6) * 9.0,
        "step": np.array([0, 0, 0, 30.0, 30, 30]),
        "scatter": np.array([0, 30, 0, -25, 25, -20.0]),
    }
    for seed in range(30):
        same = make_series(6, NAMES, seed)
        same = replace(same, cov=np.repeat(same.cov[:1], 6, axis=0))
        errors = (
            np.random.default_rng(seed + 99).normal(size=(6, 5)) @ np.linalg.cholesky(same.cov[0]).T
        )
        same = replace(same, values=0.02 + errors)
        for how, by in wanted.items():
            h = history(shifted(same, 2, by))
            assert h.standing_out[0] == 2
            said[how] += h.courses[2].how == how
            if how == "drift":
                c = h.courses[2]
                assert abs(c.drift - 9 * same.sd[0, 2]) < 4.5 * c.drift_sd and c.drifts
            if how == "step":
                assert h.courses[2].step_after == 2
                assert abs(h.courses[2].step - 30 * same.sd[0, 2]) < 4.5 * h.courses[2].step_sd
    # A line or step that is right is refused once in a hundred.
    assert all(count >= binom.ppf(0.001, 30, 0.99) for count in said.values()), said


def test_without_dates_there_is_a_step_but_no_drift():
    series = shifted(make_series(4, NAMES, 3), 1, [0, 0, 200.0, 200.0])
    h = history(replace(series, time=np.full(4, np.nan)))
    assert h.courses[1].how == "step" and np.isnan(h.courses[1].drift)
    assert not any(c.drifts for c in h.courses)
    for hours, told in ((0.0, False), (23.0, False), (25.0, True)):
        h = history(replace(series, time=1.7e9 + np.linspace(0.0, 3600.0 * hours, 4)))
        assert np.isfinite(h.courses[1].drift) == told


def test_weighted_least_squares_of_one_coefficient():
    series = make_series(5, NAMES, 8).only([2])
    x, weight = series.values[:, 0], 1 / series.cov[:, 0, 0]
    fit = constant(series)
    assert fit.values[0, 0] == pytest.approx(np.sum(weight * x) / np.sum(weight))
    assert fit.sd[0, 0] == pytest.approx(1 / np.sqrt(np.sum(weight)))
    slope, cov = np.polyfit(series.time / YEAR, x, 1, w=np.sqrt(weight), cov="unscaled")
    found = line(series)
    assert found.values[1, 0] * YEAR == pytest.approx(slope[0])
    assert found.sd[1, 0] * YEAR == pytest.approx(np.sqrt(cov[0, 0]))
    assert found.dof == 3
    after, stepped = step(series)
    assert stepped.chi_square <= constant(series).chi_square and 0 <= after < 4


def test_an_error_that_results_share_drops_out_of_their_difference():
    series = make_series(3, NAMES, 4)
    shared = np.random.default_rng(1).normal(size=(5, 1)) * 50 * series.sd[0][:, None]
    L = np.repeat(shared[None], 3, axis=0)
    together = replace(
        series, values=series.values + 1.3 * shared[:, 0],
        cov=series.cov + L @ L.swapaxes(1, 2), shared=L,
    )  # fmt: skip
    a, b = history(series), history(together)
    assert b.chi_square == pytest.approx(a.chi_square, rel=1e-6)
    np.testing.assert_allclose(pair(together, 0, 2).sd, pair(series, 0, 2).sd, rtol=1e-9)
    assert b.courses[1].drift_sd == pytest.approx(a.courses[1].drift_sd, rel=1e-6)
    # Taken for independent, it hides what each coefficient does.
    apart = history(replace(together, shared=np.zeros((3, 5, 0))))
    for hidden, seen in zip(apart.courses, a.courses, strict=True):
        assert hidden.chi_square < 0.1 * seen.chi_square


def test_instruments_that_differ_are_told_apart_and_an_odd_one_is_named():
    series = make_series(12, NAMES, 6)
    same = between(series)
    assert not any(s.told_apart for s in same.spreads) and same.outlying == ()
    rng = np.random.default_rng(2)
    wide = replace(series, values=series.values + 30 * series.sd[0] * rng.normal(size=(12, 5)))
    apart = between(wide)
    assert all(s.told_apart for s in apart.spreads) and apart.outlying == ()
    assert apart.spreads[0].spread == pytest.approx(wide.values[:, 0].std(ddof=1))
    values = wide.values.copy()
    values[7, 3] += 1500 * series.sd[0, 3]
    odd = between(replace(wide, values=values)).outlying
    assert [(o.index, o.name) for o in odd] == [(7, "gyro.bias.y")]
