"""From logs to increments: rates, increments, gaps, times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.strapdown import navigate
from foucault.tables import Log
from make_strapdown import VEHICLES, errors, gathered, standing
from refusals import refuses

STATE, W, F = VEHICLES["survey vehicle, turning"]


def rates(time: np.ndarray) -> Log:
    return Log(time, W(time), F(time))


def means(time: np.ndarray) -> Log:
    whole = gathered(W, F, time)
    over = np.diff(time, prepend=2 * time[0] - time[1])[:, None]
    return Log(time, whole.dtheta_b / over, whole.dvel_b / over, "increment")


def both(increments: Increments) -> np.ndarray:
    return np.column_stack([increments.dtheta_b, increments.dvel_b])


def even(n: int, dt: float, start: float = 0.0) -> np.ndarray:
    return start + np.arange(n) * dt


def test_means_times_the_interval():
    time = even(200, 0.01)
    found, want = increments_of(means(time)), gathered(W, F, time)
    np.testing.assert_allclose(both(found), both(want), rtol=1e-12, atol=1e-16)
    np.testing.assert_array_equal(found.time, time)
    np.testing.assert_allclose(found.dt, 0.01, rtol=1e-12)
    assert not found.joined[0] and found.joined[1:].all() and found.findings == ()


def test_rates_by_a_cubic():
    """Per interval the cubic is wrong by 11/720 dt^5 x''''; a straight line by dt^3 x'' / 12."""
    off = []
    for n in (101, 201, 401):
        time = np.linspace(0.0, 4.0, n)
        missed = both(increments_of(rates(time))) - both(gathered(W, F, time))
        off.append(np.abs(missed[2:-1]).max())
    order = np.log2(np.array(off[:-1]) / off[1:])
    np.testing.assert_allclose(order, 5.0, atol=0.1)
    t = even(50, 0.1)
    exact = replace(rates(t), gyro=np.column_stack([t**3, t**2, t]), accel=np.outer(t, np.ones(3)))
    np.testing.assert_allclose(
        increments_of(exact).dtheta_b[2:-1],
        np.column_stack([np.diff(t**4) / 4, np.diff(t**3) / 3, np.diff(t**2) / 2])[1:-1],
        rtol=1e-12, atol=1e-15,
    )  # fmt: skip


def test_rates_at_the_ends_and_beside_a_change_of_rate_by_a_straight_line():
    time = np.concatenate([even(20, 0.01), even(20, 0.013, 0.19 + 0.013)])
    log = rates(time)
    found = both(increments_of(log))
    mean = np.column_stack([log.gyro, log.accel])
    line = (mean[1:] + mean[:-1]) / 2 * np.diff(time)[:, None]
    by_line = np.flatnonzero(np.abs(found[1:] - line).max(axis=1) < 1e-16) + 1
    np.testing.assert_array_equal(by_line, [1, 19, 20, 39])


@pytest.mark.parametrize("make", [rates, means])
def test_navigation_from_either_kind(make):
    time = even(1001, 0.01)
    exact = navigate(gathered(W, F, time), STATE).state(-1)
    found = navigate(increments_of(make(time)), STATE).state(-1)
    assert np.all(errors(found, exact) < ([3e-7, 2e-5, 2e-4] if make is rates else 1e-8))


@pytest.mark.parametrize("make", [rates, means])
@pytest.mark.parametrize("n", [2, 3, 4])
def test_short_logs(make, n):
    found = increments_of(make(even(n, 0.01)))
    assert len(found) == n and np.isfinite(both(found)).all()
    np.testing.assert_allclose(both(found)[1:], both(gathered(W, F, even(n, 0.01)))[1:], rtol=0.01)


def test_irregular_times():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.008, 0.012, 2000))
    found, want = increments_of(means(time)), gathered(W, F, time)
    np.testing.assert_allclose(both(found)[1:], both(want)[1:], rtol=1e-12, atol=1e-16)
    np.testing.assert_array_equal(found.dt[1:], np.diff(time))
    assert found.dt[0] == np.median(np.diff(time))
    exact = navigate(want, STATE).state(-1)
    by_rates = navigate(increments_of(rates(time)), STATE).state(-1)
    assert np.all(errors(by_rates, exact) < [3e-5, 5e-3, 5e-2])


@pytest.mark.parametrize("start", [0.0, 604700.0, 1.7e9])
def test_large_times_are_evened(start):
    """Seconds of the week or of the epoch: their rounding is no jitter."""
    time = even(5000, 1 / 300, start)
    found = increments_of(means(time))
    assert np.ptp(found.dt) <= np.spacing(found.dt[0])
    np.testing.assert_allclose(found.dt[0], 1 / 300, rtol=2e-8)
    late, soon = (
        navigate(increments_of(Log(t, W(t - t[0]), F(t - t[0]), "increment")), STATE).state(-1)
        for t in (time, even(5000, 1 / 300))
    )
    assert np.all(errors(late, soon) < [1e-6, 1e-4, 1e-3])


def gappy(lost: slice, make=means) -> Log:
    log = make(even(400, 0.01))
    keep = np.ones(400, bool)
    keep[lost] = False
    return replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])


def test_a_gap_stops():
    with refuses("strapdown.gap", match=r"missing at 0\.99 s \(1 in all, the longest"):
        increments_of(gappy(slice(100, 110)))


@pytest.mark.parametrize("make", [rates, means])
def test_a_gap_is_bridged_by_halves(make):
    log = gappy(slice(100, 110), make)
    found = increments_of(log, gaps="bridge")
    (told,) = found.findings
    assert (told.code, told.severity) == ("strapdown.bridged", "warning")
    assert "0.99 s" in told.message
    assert found.dt[100] == pytest.approx(0.11)
    half = 0.5 * (log.gyro[99] + log.gyro[100])
    # An increment after a gap is that of its own interval, and of the rest nobody knows.
    own = 0.01 * log.gyro[100] + 0.1 * half if make is means else 0.11 * half
    np.testing.assert_allclose(found.dtheta_b[100], own, rtol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(~found.joined), [0, 100, 101])
    # Nothing else is touched by the gap.
    whole = both(increments_of(make(even(400, 0.01))))
    far = np.r_[2:98, 103:388]
    np.testing.assert_allclose(both(found)[far], whole[np.where(far < 100, far, far + 10)],
                               rtol=1e-9, atol=1e-15)  # fmt: skip


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_what_grows_evenly_is_bridged_exactly(sampled):
    time, slope = even(200, 0.01), np.array([0.3, -0.2, 0.5])
    middle = time - (0.005 if sampled == "increment" else 0.0)
    kept = np.random.default_rng(0).random(200) > 0.1
    kept[[0, 1, 2, -1]] = True
    x = (middle[:, None] * slope)[kept]
    found = increments_of(Log(time[kept], x, x, sampled), gaps="bridge")
    whole = found.dtheta_b[1:].sum(axis=0)
    np.testing.assert_allclose(whole, slope * time[-1] ** 2 / 2, rtol=1e-12)
    ends = found.time[1:, None]
    np.testing.assert_allclose(np.cumsum(found.dtheta_b[1:], axis=0), slope * ends**2 / 2,
                               rtol=1e-9, atol=1e-15)  # fmt: skip


def test_many_gaps_are_counted():
    log = means(even(400, 0.01))
    keep = np.ones(400, bool)
    keep[[50, 51, 100, 101, 150, 200, 201, 202]] = False
    log = replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])
    with pytest.raises(FoucaultError, match=r"0\.49 s, 0\.99 s, 1\.49 s \.\.\. \(4 in all"):
        increments_of(log)


@pytest.mark.parametrize(
    ("code", "words", "change"),
    [
        ("strapdown.no_triad", "has no accel", {"accel": None}),
        ("strapdown.no_triad", "has no gyro", {"gyro": None}),
        ("strapdown.averaged", "mean over a position", {"averaged": np.ones(30)}),
    ],
)
def test_logs_that_cannot_be_navigated(code, words, change):
    with refuses(code, match=words):
        increments_of(replace(rates(even(30, 0.01)), **change))


def test_rows():
    increments, _ = standing(0.7, 10.0, 0.5)
    part = increments[4:10]
    assert len(part) == 6
    np.testing.assert_array_equal(part.time, increments.time[4:10])
    np.testing.assert_array_equal(part.dtheta_b, increments.dtheta_b[4:10])
    asked = (-3.0, 0.0, 0.24, 0.26, 4.9, 5.0, 9.8, 99.0)
    assert [increments.row_at(t) for t in asked] == [0, 0, 0, 1, 10, 10, 20, 20]


def test_given_increments():
    made = Increments.of(np.array([1.0, 1.5, 2.1]), np.ones((3, 3)), np.zeros((3, 3)))
    np.testing.assert_allclose(made.dt[1:], [0.5, 0.6])
    np.testing.assert_array_equal(made.joined, [False, True, True])


@pytest.mark.parametrize("made", [rates, means])
def test_recordings_in_a_row_are_counted_as_each_is(made):
    parts = [increments_of(made(t0 + 0.01 * np.arange(20))) for t0 in (0.0, 5.0)]
    assert Increments.chained(parts).counted == parts[0].counted == (made is means)
