"""The list of mistakes, and which of them is said to explain readings."""

import numpy as np
import pytest

from foucault.guard.mistakes import (
    DEGREE,
    Mistake,
    columns,
    exchange_words,
    exchanges,
    explain,
    factors,
    likely,
    one_unit,
    plainly,
)
from foucault.guard.rest import _Turns
from foucault.models.rotation import exp
from foucault.tables import Log

SWAP = np.eye(3)[[1, 0, 2]]


def test_every_signed_exchange_is_there_once_and_the_simplest_come_first():
    every = exchanges()
    assert len({x.tobytes() for x in every}) == 48
    for x in every:
        np.testing.assert_array_equal(x @ x.T, np.eye(3))
    np.testing.assert_array_equal(every[0], np.eye(3))
    assert all(np.trace(x) == 1 and np.trace(np.abs(x)) == 3 for x in every[1:4])  # one sign


def test_what_is_undone_is_what_was_done():
    x = np.random.default_rng(1).normal(size=(5, 3))
    for E in exchanges():
        wrong = x @ E / 7.0  # columns as declared: E takes them to axes
        mistake = Mistake(factor=7.0, exchange=E, of="accel")
        np.testing.assert_allclose(mistake.right(wrong, "accel"), x)
        assert mistake.right(wrong, "gyro") is wrong
        assert mistake.left_handed == (np.linalg.det(E) < 0)
    lost = np.array([[np.nan, 1.0, 2.0]])
    np.testing.assert_array_equal(Mistake(exchange=SWAP).right(lost), [[1.0, np.nan, 2.0]])


def test_exchanges_in_words():
    E = np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 1.0]])
    assert exchange_words(E) == "x = +y, y = -x, z = +z"
    assert plainly(E) == "gyro x and y are exchanged, gyro x is reversed"
    assert columns(E, ("outer", "middle", "inner")) == ["middle", "-outer", "inner"]


@pytest.mark.parametrize(
    ("triad", "ratio", "words"),
    [
        ("gyro", 1 / DEGREE, "the unit is deg/s and was declared as rad/s"),
        ("gyro", 3600.0, "the unit is deg/h or arcsec/s and was declared as deg/s"),
        ("gyro", 0.005, "increments were declared as rates"),
        ("accel", 200.0, "rates were declared as increments"),
        ("accel", 1 / 9.80665, "the unit is g and was declared as m/s^2"),
        ("accel", 1000.0, "the unit is mg and was declared as g"),
        ("accel", 3.0, None),
        ("accel", 0.0, None),
    ],
)
def test_factors_in_words(triad, ratio, words):
    for off in (0.95, 1.0, 1.05):
        assert likely(off * ratio, factors(triad, 0.005)) == words


def test_readings_that_fit_are_nobodys_business_and_alike_explanations_are_all_named():
    left = {"": 10.0, "a": 1.0, "b": 1.05, "c": 3.0}
    tried = [Mistake("c"), Mistake("b"), Mistake("a")]

    def named(**rules):
        return [m.words for m in explain(lambda m: left[m.words], tried, **rules).by]

    assert named(wrong=11.0) == []
    assert named(wrong=5.0) == ["a"]
    assert named(wrong=5.0, alike=1.1) == ["b", "a"]
    assert named(wrong=5.0, within=4.0) == ["c", "b", "a"]
    assert named(wrong=5.0, fits=0.5) == []
    assert named(wrong=5.0, better=0.05) == []
    left[""] = np.nan
    assert named(wrong=5.0) == []


@pytest.mark.parametrize("summed", [False, True])
def test_a_turn_without_a_mistake_is_integrated_once_for_all_axes(summed):
    """Two integrations stand for 48: each is the same as if its own columns were integrated."""
    rng = np.random.default_rng(2)
    time = np.arange(200) * 0.01
    rate = np.cumsum(rng.normal(scale=0.3, size=(200, 3)), axis=0)
    log = Log(time, rate, np.zeros((200, 3)), "increment" if summed else "rate")
    up = np.array([exp(v)[2] for v in rng.normal(size=(3, 3))])
    at = np.array([0, 100]), np.array([99, 199])
    turns = _Turns(log, up, np.array([0.1, -0.2, 0.3]), *at)
    for mistake in [Mistake(factor=0.5, exchange=E) for E in exchanges()] + one_unit("gyro", [3.0]):
        own = Log(time, mistake.right(rate - turns.bias), log.accel, log.sampled)
        alone = _Turns(own, up, np.zeros(3), *at).miss(Mistake())
        assert turns.miss(mistake) == pytest.approx(alone, abs=1e-9)
