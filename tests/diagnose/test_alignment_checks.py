"""Every fault of an alignment is made, and named."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.alignment import azimuth, checked, motion
from foucault.errors import FoucaultError
from foucault.guard import rest
from foucault.guard.mistakes import exchange_words, exchanges
from foucault.guard.rest import contradictions, of_increments
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.align import align, sensor_errors
from foucault.navigate.increments import Increments
from foucault.plans.manoeuvres import Accelerate, Rest, Rotate, Straight, Sway
from make_alignment import DPH, moving, resting, with_errors

SITE = Site.at(np.radians(47.0), 400.0)
NOISE = ImuNoise(TriadNoise(white=5e-5), TriadNoise(white=5e-7))
WORDS = {"noise": NOISE, "gyro_bias_sd": 0.02 * DPH, "accel_bias_sd": 5e-4}


def _errors(increments):
    return sensor_errors(increments, **WORDS)


def _rest(site=SITE, angles=(0.7, 0.3, -0.2), seed=1):
    exact, _ = resting(site, 120.0, 0.02, *angles)
    return with_errors(exact, _errors(exact), np.random.default_rng(seed))


def _changed(increments, gyro=1.0, accel=1.0):
    """Multiply increments by a number, or a matrix from the left."""

    def by(x, a):
        return x @ a.T if isinstance(a, np.ndarray) else x * a

    return Increments.of(increments.time, by(increments.dtheta_b, gyro),
                         by(increments.dvel_b, accel))  # fmt: skip


def _raised(increments, site=SITE):
    with pytest.raises(FoucaultError) as caught:
        contradictions(increments, site, _errors(increments))
    return caught.value


@pytest.mark.parametrize("latitude", [-60.0, -5.0, 20.0, 70.0])
def test_a_good_rest_says_nothing(latitude):
    site = Site.at(np.radians(latitude))
    for seed in range(5):
        made = _rest(site, seed=seed)
        found = checked(made, site, align(made, site, **WORDS), _errors(made))
        assert found.findings == ()


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (0.02, "increments were declared as rates"),
        (50.0, "rates were declared as increments"),
        (1 / 9.80665, "the unit is g and was declared as m/s^2"),
        (9.80665, "the unit is m/s^2 and was declared as g"),
        (3.0, "no usual mistake makes this"),
    ],
)
def test_increments_read_as_rates_and_the_reverse(factor, cause):
    problem = _raised(_changed(_rest(), gyro=factor, accel=factor))
    assert problem.code == "alignment.force"
    assert cause in str(problem) and f"{factor:.2g}"[:3] in str(problem)


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (180 / np.pi, "the unit is deg/s and was declared as rad/s"),
        (50.0, "rates were declared as increments"),
        (0.02, "increments were declared as rates"),
        (np.pi / 180, "the unit is rad/s and was declared as deg/s"),
    ],
)
def test_gyros_in_the_wrong_unit(factor, cause):
    """Seen by the Earth's rate alone, where the accelerometers are right."""
    quiet, _ = resting(SITE, 120.0, 0.02, 0.7, 0.3, -0.2)
    problem = _raised(_changed(quiet, gyro=factor))
    assert problem.code == "alignment.gyro_unit"
    assert cause in str(problem) and "multiplied by" in str(problem)


@pytest.mark.parametrize("fault", ["latitude", "gravity"])
def test_the_sign_of_what_lies_along_up(fault):
    made, site = _rest(), SITE
    if fault == "latitude":
        site = replace(SITE, latitude=-SITE.latitude)
    else:
        made = _changed(made, accel=-1.0)
    problem = _raised(made, site)
    assert problem.code == "alignment.vertical_sign"
    assert "`latitude` has the wrong sign" in str(problem)
    assert 'reads = "gravity"' in str(problem)
    assert "mirrored" not in str(problem), "f . w stays as it is"


@pytest.mark.parametrize("number", range(1, 48))
def test_every_exchange_of_gyro_axes(number, monkeypatch):
    """In this attitude each one shows, and is among those that are named."""
    monkeypatch.setattr(rest, "SHOWN", 48)
    exchange = exchanges()[number]
    exact, C_nb = resting(SITE, 120.0, 0.02, 0.7, 0.3, -0.2)
    made = _changed(exact, gyro=exchange)
    wrong, right = (C_nb[2] @ x.dtheta_b.mean(axis=0) for x in (made, exact))
    assert abs(wrong - right) > 0.03 * EARTH_RATE * 0.02
    problem = _raised(made)
    if abs(wrong + right) < 0.01 * right:
        assert problem.code == "alignment.vertical_sign"
    else:
        assert problem.code == "alignment.axes"
        assert exchange_words(exchange.T) in str(problem)


def test_a_swap_is_named():
    swap = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    problem = _raised(_changed(_rest(), gyro=swap))
    assert problem.code == "alignment.axes"
    assert "x = +x, y = +z, z = +y" in str(problem)
    assert "two rests with a turn" in str(problem)


def test_the_wrong_latitude():
    """A rest with one axis up: no exchange makes up for a latitude that is 3 deg off."""
    made = _rest(angles=(0.7, 0.0, 0.0))
    site = replace(SITE, latitude=SITE.latitude + np.radians(3.0))
    (found,) = contradictions(made, site, _errors(made))
    assert found.code == "alignment.latitude"
    assert (
        "latitude of 46.99 deg (sd 0.12)" in found.message
        and "50.00 deg was given" in found.message
    )


def test_a_bias_beyond_what_was_declared():
    exact, _ = resting(SITE, 120.0, 0.02, 0.7)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0),
                       np.array([[0, 0, 4.0 * DPH], [0, 0, 0]]))  # fmt: skip
    found = checked(made, SITE, align(made, SITE, **WORDS), _errors(made)).findings
    assert [f.code for f in found] == ["alignment.earth_rate"]
    assert "15" in found[0].message


@pytest.mark.parametrize("heading", [0.0, 90.0])
@pytest.mark.parametrize("bias", [0.028, 0.1, 0.3])
def test_a_small_bias_is_no_exchange_of_axes(heading, bias):
    """An axis near east reads so little that its sign would make up for the bias of another."""
    exact, _ = resting(SITE, 300.0, 0.02, np.radians(heading), 0.017, -0.035)
    sensors = sensor_errors(exact, ImuNoise(TriadNoise(white=2e-5), TriadNoise(white=1e-8)))
    made = with_errors(exact, sensors, np.random.default_rng(3),
                       np.array([[0, 0, bias * DPH], [0, 0, 0]]))  # fmt: skip
    found = contradictions(made, SITE, sensors)
    assert [f.code for f in found] in (["alignment.latitude"], ["alignment.earth_rate"])


@pytest.mark.parametrize("bias", [0.0, 1.0])
def test_sway_is_told_whatever_bias_is_declared(bias):
    """A bias turns the level steadily; what comes and goes it does not explain."""
    sway = {"angles": (0.001, 0.002, 0.001), "shift": (0.01, 0.01, 0.01), "tones": 2}
    exact, _ = moving([Sway(300.0, 4.0, seed=2, **sway)], SITE, 20.0)
    sensors = sensor_errors(exact, NOISE, bias * DPH)
    made = with_errors(exact, sensors, np.random.default_rng(0), np.zeros((2, 3)))
    assert [f.code for f in motion(made, SITE, sensors)] == ["alignment.sway"]


def test_a_wrong_latitude_is_not_called_sway():
    """The Earth turns otherwise than believed; the instrument does not."""
    exact, _ = resting(SITE, 300.0, 0.02, 0.7, 0.0, 0.0)
    sensors = sensor_errors(exact, ImuNoise(TriadNoise(white=1e-5), TriadNoise(white=1e-8)))
    made = with_errors(exact, sensors, np.random.default_rng(0), np.zeros((2, 3)))
    site = replace(SITE, latitude=SITE.latitude + np.radians(1.0))
    found = checked(made, site, align(made, site), sensors).findings
    assert [f.code for f in found] == ["alignment.latitude"]


def test_poor_gyros_are_not_accused():
    """Where the Earth's rate does not stand out, its sign and axes are nobody's business."""
    made = _rest()
    poor = sensor_errors(made, NOISE, 20 * DPH, 5e-4)
    assert contradictions(_changed(made, gyro=-1.0), SITE, poor) == ()


def test_a_turn_between_two_rests_shows_swapped_axes():
    """About up alone: of the exchanges that put the turn along up, one is named."""
    plan = [Rest(30.0), Rotate("up", np.radians(-120.0), 0.2), Rest(30.0)]
    exact, _ = moving(plan, SITE, 50.0, pitch=0.2, roll=-0.1)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0))
    rests = ((0.0, 30.0), (float(made.time[-1]) - 30.0, float(made.time[-1])))
    of_increments(made, rests)
    swap = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    with pytest.raises(FoucaultError) as caught:
        of_increments(_changed(made, gyro=swap), rests)
    assert caught.value.code in ("gyro.axes", "gyro.left_handed")
    assert "y = +z, z = +y" in str(caught.value)


def test_the_turn_between_two_positions_is_no_fault():
    plan = [Rest(60.0), Rotate("up", np.pi, 0.2), Rest(60.0)]
    exact, _ = moving(plan, SITE, 50.0)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0))
    end = float(made.time[-1])
    rests = ((0.0, 60.0), (end - 60.0, end))
    found = align(made, SITE, method="two_position", rests=rests, **WORDS)
    assert checked(made, SITE, found, _errors(made)).findings == ()


def test_a_given_velocity_is_no_fault():
    exact, truth = moving([Accelerate(15.0, 30.0), Straight(60.0)], SITE, 20.0)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0))
    found = align(made, SITE, method="kalman", velocity_n=truth.velocity_n, **WORDS)
    assert checked(made, SITE, found, _errors(made)).findings == ()
    blind = align(made, SITE, **WORDS)
    codes = [f.code for f in checked(made, SITE, blind, _errors(made)).findings]
    assert "alignment.left_place" in codes


def test_sway_is_harmless():
    """People walk about, and one gets off: the vehicle tilts by 0.2 deg."""
    sway = {"angles": (0.01, 0.01, 0.02), "shift": (0.02, 0.02, 0.02), "tones": 3}
    plan = [Sway(60.0, 4.0, seed=1, **sway), Rotate("x", np.radians(0.2), 0.01),
            Sway(60.0, 4.0, seed=2, **sway)]  # fmt: skip
    exact, _ = moving(plan, SITE, 50.0)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0))
    (found,) = checked(made, SITE, align(made, SITE, **WORDS), _errors(made)).findings
    assert found.code == "alignment.sway" and found.severity == "note"
    assert "level by 719 arcsec between start and end" in found.message


def test_a_turn_in_a_rest():
    plan = [Rest(60.0), Rotate("up", np.radians(-30.0), 0.1), Rest(60.0)]
    exact, _ = moving(plan, SITE, 50.0)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0))
    (found,) = checked(made, SITE, align(made, SITE, **WORDS), _errors(made)).findings
    assert found.code == "alignment.turned" and found.severity == "warning"
    assert "turned by 30.0" in found.message and "-30.0" in found.message


def test_leaving_the_place():
    plan = [Rest(60.0), Accelerate(2.0, 10.0), Accelerate(0.0, 10.0), Rest(60.0)]
    exact, _ = moving(plan, SITE, 50.0)
    made = with_errors(exact, _errors(exact), np.random.default_rng(0))
    codes = {f.code: f for f in motion(made, SITE, _errors(made))}
    assert set(codes) == {"alignment.left_place"}
    assert "m/s" in codes["alignment.left_place"].message


def test_gyros_too_poor_for_north():
    made = _rest()
    words = WORDS | {"gyro_bias_sd": 10 * DPH}
    found = azimuth(align(made, SITE, **words), SITE)
    assert [f.code for f in found] == ["alignment.azimuth"]
    assert "Give a heading from elsewhere" in found[0].cure
    assert azimuth(align(made, SITE, **WORDS), SITE) == ()


def test_near_a_pole_the_azimuth_grows():
    site = Site.at(np.radians(89.0))
    made = _rest(site)
    found = align(made, site, **WORDS)
    usual = align(_rest(), SITE, **WORDS)
    assert found.heading_sd > 20 * usual.heading_sd
    codes = [f.code for f in azimuth(found, site)]
    assert codes == ["alignment.azimuth", "alignment.near_pole"] or codes == ["alignment.near_pole"]
    assert "1.7 %" in azimuth(found, site)[-1].message


@pytest.mark.parametrize("factor", [1.011, 0.997])
def test_gravity_that_the_rest_contradicts(factor):
    """Too far from gravity for instruments to navigate with, too near for another unit."""
    made = _rest()
    found = contradictions(_changed(made, accel=factor), SITE, _errors(made))
    assert [f.code for f in found] == ["alignment.gravity"]
    assert f"{100 * (factor - 1):+.2g} % off" in found[0].message
    assert contradictions(_changed(made, accel=1.001), SITE, _errors(made)) == ()
