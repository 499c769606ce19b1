"""Exchanged gyro axes on a table are named from the directions of the spins alone."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.guard.mistakes import plainly
from foucault.guard.table import check_gyro_axes, explain_spins
from foucault.models.earth import Site
from foucault.models.noise import Readings
from foucault.procedures import norm_observation, turntable
from make_table_log import DEG, GRAVITY, ICO, Session, plan_of
from refusals import refuses

GOLDEN = (1 + 5**0.5) / 2
UP = np.array([[0, a, b * GOLDEN] for a in (1, -1) for b in (1, -1)])
UP = np.concatenate([UP, UP[:, [1, 2, 0]], UP[:, [2, 0, 1]]]) / np.hypot(1, GOLDEN)


def made(order=(0, 1, 2), signs=(1, 1, 1), rate=10 * DEG, bias=2 * DEG, up=UP, rest_sd=1e-5):
    """Return rests and spins whose columns of the gyros are exchanged."""
    rng = np.random.default_rng(1)
    h = np.concatenate([np.zeros(len(up)), rate * np.where(np.arange(len(up)) % 3, 1, -1)])
    both = np.concatenate([up, up])
    w = h[:, None] * both @ (np.eye(3) + 0.01 * rng.normal(size=(3, 3))) + bias
    w += rest_sd * rng.normal(size=w.shape)
    f = GRAVITY * both + np.array([0.3, -0.2, 0.1])
    n = len(h)
    return Readings(
        np.full((n, 3), np.nan), h, np.where(h, 2.0, 0.0), 40.0 * np.arange(n), np.full(n, 30.0),
        f, w[:, list(order)] * np.array(signs), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), 0.01,
    )  # fmt: skip


CASES = [
    ((0, 1, 2), (-1, 1, 1), "spin.left_handed", "gyro x is reversed, and", "x = -x, y = +y"),
    ((0, 1, 2), (1, -1, -1), "spin.axes", "gyro y and z are reversed:", "y = -y, z = -z"),
    ((1, 0, 2), (1, 1, 1), "spin.left_handed", "x and y are exchanged, and", "x = +y, y = +x"),
    # Column x is true y; that of y is true -x.
    ((1, 0, 2), (1, -1, 1), "spin.axes", "gyro x and y are exchanged, gyro y is", "x = -y, y = +x"),
    ((1, 2, 0), (1, 1, 1), "spin.axes", "exchanged in a circle:", "x = +z, y = +x, z = +y"),
]  # fmt: skip


@pytest.mark.parametrize(("order", "signs", "code", "words", "exchange"), CASES)
def test_an_exchange_is_named(order, signs, code, words, exchange):
    with refuses(code) as problem:
        check_gyro_axes(made(order, signs))
    assert words in problem.value.message and exchange in problem.value.message
    assert "[log.accel]" in problem.value.cure


@pytest.mark.parametrize(
    "readings",
    [
        made(),
        made(signs=(-1, -1, -1)),  # the table turns the other way, or all gyros are reversed
        made((1, 0, 2), rate=10 * DEG, rest_sd=1 * DEG),  # lost in what the rests show
        made(signs=(-1, 1, 1), up=np.array([[0, 0, 1.0], [1, 0, 0]])),  # the y axis is not seen
        replace(made((1, 0, 2)), accel=None),
        replace(made((1, 0, 2)), gyro=None),
        made((1, 0, 2))[np.arange(12)],  # rests alone
    ],
    ids=["right", "reversed", "noisy", "in a plane", "no accel", "no gyro", "no spins"],
)
def test_nothing_is_said_where_nothing_is_wrong_or_known(readings):
    check_gyro_axes(readings)


def test_a_table_that_turned_the_other_way_in_some_spins_exchanges_no_axes():
    readings = made()
    rate = readings.rate.copy()
    rate[12:20] *= -1
    check_gyro_axes(replace(readings, rate=rate))
    # One spin of unknown sense does not hide an exchange.
    swapped = made((1, 0, 2))
    rate = swapped.rate.copy()
    rate[15] *= -1
    with pytest.raises(FoucaultError, match="x and y are exchanged"):
        check_gyro_axes(replace(swapped, rate=rate))


def test_the_miss_is_the_angle_between_rate_and_up():
    # Turned by 90 deg about z: (1, 0, 0) and (0, 1, 0) are off by 90 deg, (0, 0, 1) by none.
    f = GRAVITY * np.eye(3)
    w = f @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]).T
    seen = explain_spins(f, -w, np.full(3, -0.1))
    np.testing.assert_allclose(seen.now, np.pi / 2 * np.sqrt(2 / 3))
    np.testing.assert_allclose(seen.least, 0, atol=1e-7)
    assert plainly(seen.by[0].exchange) == "gyro x and y are exchanged, gyro x is reversed"


@pytest.mark.parametrize("procedure", [norm_observation, turntable])
@pytest.mark.parametrize("table", [("angles",), ()], ids=["angles", "silent"])
def test_the_procedures_name_it_before_the_sense_of_spins_misleads(procedure, table):
    rates = np.repeat([0.0, 10 * DEG], 12)
    plan = plan_of(np.concatenate([ICO, ICO]), rates, time=5.0, turns=1.2)
    made = Session(plan, 20.0, gyro_noise=0.05 * DEG, accel_noise=0.01)
    log = made.log(table)
    words = [[f"{angle:.4f} deg" for angle in row] for row in np.degrees(ICO)]
    settings = procedure.Settings(positions=words, spin_rate=10 * DEG)
    with refuses("spin.left_handed"):
        procedure.calibrate(
            replace(log, gyro=log.gyro[:, [1, 0, 2]]), site=Site(GRAVITY, 45 * DEG),
            settings=settings,
        )  # fmt: skip
