"""Distributions over a fleet, and who stands out of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from foucault.diagnose import compare

NAMES = ("accel.bias.x", "accel.bias.y", "gyro.bias.x")


def test_median_spread_and_extremes():
    x = np.array([[1.0], [2.0], [3.0], [4.0], [100.0], [np.nan]])
    (d,) = compare.distributions(NAMES[:1], x, 0.1 * x)
    assert (d.count, d.median, d.lowest, d.highest) == (5, 3.0, 1.0, 100.0)
    assert d.spread == pytest.approx(stats.median_abs_deviation(x[:5, 0], scale="normal"))
    assert d.sd == pytest.approx(0.3)


def test_a_column_of_nothing_has_no_distribution():
    assert compare.distributions(NAMES[:1], np.full((3, 1), np.nan), np.ones((3, 1))) == []


def test_outlying_instruments_are_named_with_what_differs():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(60, 3)) * [1.0, 5.0, 1e-3] + [10.0, 0.0, 1.0]
    x[7, 0] += 20.0
    x[31, 2] -= 0.012
    found = compare.outlying(NAMES, x)
    assert [(o.index, o.name) for o in found] == [(7, "accel.bias.x"), (31, "gyro.bias.x")]
    assert found[0].z > 15 and -18 < found[1].z < -8
    assert found[0].value == x[7, 0]


@pytest.mark.thorough
@pytest.mark.parametrize("n", [8, 12, 60])
def test_one_fleet_in_a_hundred_has_a_false_outlier(n):
    rng = np.random.default_rng(n)
    fleets, p = 500, 7
    names = [str(k) for k in range(p)]
    alarms = sum(bool(compare.outlying(names, rng.normal(size=(n, p)))) for _ in range(fleets))
    assert alarms <= stats.binom.ppf(0.999, fleets, 0.01)
    assert alarms > 0  # a limit that nothing passes would find nothing either


@pytest.mark.thorough
@pytest.mark.parametrize(("n", "size"), [(8, 16.0), (12, 10.0), (20, 8.0), (60, 7.0)])
def test_an_odd_instrument_is_found_among_few(n, size):
    """Limits of the median distance would take 30 standard deviations among eight."""
    rng, trials = np.random.default_rng(n), 100
    found = 0
    for _ in range(trials):
        x = rng.normal(size=(n, 18))
        x[3, 4] += size
        found += any(
            (o.index, o.name) == (3, "4") for o in compare.outlying([str(k) for k in range(18)], x)
        )
    assert found > 85


def test_two_odd_instruments_do_not_hide_each_other():
    x = np.random.default_rng(3).normal(size=(20, 3))
    x[[4, 11], 1] += 25.0
    assert {o.index for o in compare.outlying(NAMES, x)} == {4, 11}


def test_an_instrument_that_was_measured_worse_is_not_odd():
    x = np.random.default_rng(5).normal(size=(12, 1))
    x[7] = 25.0
    sd = np.full((12, 1), 0.1)
    assert [o.index for o in compare.outlying(NAMES[:1], x, sd)] == [7]
    sd[7] = 20.0
    assert compare.outlying(NAMES[:1], x, sd) == []


def test_few_instruments_and_instruments_all_alike_have_no_outliers():
    x = np.array([[0.0], [0.0], [0.0], [9.0]])
    assert compare.outlying(NAMES[:1], x) == []
    same = np.zeros((20, 1))
    same[3] = 9.0
    assert compare.outlying(NAMES[:1], same) == []


def test_noisy_instruments_are_named():
    rng = np.random.default_rng(4)
    chi = rng.chisquare(11, size=(50, 2))
    chi[5, 1] = 80.0
    red = np.full((50, 2), 11.0)
    (found,) = compare.noisy(chi, red)
    assert (found.index, found.name) == (5, "noise of the gyros")
    assert found.value == pytest.approx(np.sqrt(80 / 11)) and found.z > 1
    assert compare.noisy(chi, np.zeros((50, 2))) == []
    assert compare.noisy(np.full((2, 2), np.nan), red[:2]) == []
