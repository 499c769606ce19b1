"""The published unification of the frames: signs, what cancels, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.estimate import norm_observation
from foucault.models import turntable
from foucault.models.noise import Readings
from refusals import refuses

G = 9.81
H = np.radians(10.0)
REST = np.radians([[0, 0, 0], [0, 90, 0], [180, 0, 0], [180, 90, 0]])
SPIN = np.radians([[40, 0, 0], [-70, 90, 0]])
THETA = np.array([1.0e-4, -2.0e-4, 3.0e-4])
LAMBDA = np.array([-2.5e-4, 1.5e-4, 0.5e-4])
ACCEL_BIAS = np.array([0.03, -0.02, 0.01])
GYRO_BIAS = np.array([1e-5, -2e-5, 3e-5])


def small(v):
    """I + [v x], the matrices of the paper."""
    return np.eye(3) + np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def session(plumb=(0.0, 0.0), middle=(0,) * 6, keep=slice(None)):
    """Four rests and two spins of instruments without scale errors, from the paper's matrices."""
    angles = np.concatenate([REST, SPIN])
    errors = turntable.TableErrors(*plumb)
    position = np.column_stack([np.asarray(middle, float), np.zeros(6)])
    at = turntable.chain(angles, errors, position)
    C_bk, C_dk = small(-THETA), small(-LAMBDA)
    rate = np.array([0, 0, 0, 0, H, H])
    accel = G * at.up_k @ C_bk.T + ACCEL_BIAS
    gyro = rate[:, None] * at.outer_k @ C_dk.T + GYRO_BIAS
    eye = np.broadcast_to(np.eye(3), (6, 3, 3))
    r = Readings(angles, rate, rate, rate * 0, rate * 0 + 1, accel, gyro, eye, eye)
    return r[np.arange(6)[keep]]


def unified(readings):
    h = np.where(readings.spin, H, 0.0)
    return norm_observation.unify_four_positions(readings, ACCEL_BIAS, GYRO_BIAS, h, G)


def angles_of(C):
    """Small rotation vector of C = I + [v x]."""
    return np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) / 2


def test_mounting_of_both_frames_with_the_settled_signs():
    # C_bd = C_bk C_kd = I + [(lambda - theta) x], eq. (22)
    got = angles_of(unified(session()))
    np.testing.assert_allclose(got, LAMBDA - THETA, atol=2 * 4e-4**2)


def test_gyro_matrix_follows_eq_23():
    x, y, z = LAMBDA - THETA
    C_db = unified(session()).T
    wanted = np.array([[1, z, -y], [-z, 1, x], [y, -x, 1]])
    np.testing.assert_allclose(C_db, wanted, atol=2 * 4e-4**2)


def test_the_plumb_error_cancels_to_first_order():
    clean, tilted = (angles_of(unified(session(p))) for p in ((0, 0), (3e-4, -4e-4)))
    np.testing.assert_allclose(tilted, clean, atol=4e-7)


@pytest.mark.parametrize("position", range(6))
def test_an_error_of_the_middle_angle_enters_as_the_equations_say(position):
    e = 1e-4
    middle = np.zeros(6)
    middle[position] = e
    # (25): theta_x is the mean over the rests at middle 0; (27): lambda_x is that of the spin.
    theta_x = {0: e / 2, 2: e / 2}.get(position, 0.0)
    lambda_x = {4: e}.get(position, 0.0)
    got = angles_of(unified(session(middle=middle))) - angles_of(unified(session()))
    np.testing.assert_allclose(got, [lambda_x - theta_x, 0, 0], atol=2e-7)


def test_lambda_z_belongs_to_the_second_spin():
    r = session()
    r.gyro[5, 0] += 1e-4 * H
    moved = angles_of(unified(r)) - angles_of(unified(session()))
    np.testing.assert_allclose(moved, [0, 0, 1e-4], atol=1e-7)


def test_spins_may_start_anywhere_and_turns_may_be_counted():
    r = session()
    r.angles[:, 0] += 2 * np.pi
    r.angles[4, 0] = 1.234
    np.testing.assert_allclose(unified(r), unified(session()), atol=1e-16)


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        (1, "rest at outer angle 0 deg, middle angle 90 deg"),
        (2, "rest at outer angle 180 deg, middle angle 0 deg"),
        (5, "spin middle angle 90 deg"),
    ],
)
def test_a_missing_position_is_named(missing, words):
    keep = [k for k in range(6) if k != missing]
    with refuses("unification.four_positions") as caught:
        unified(session(keep=keep))
    assert words in str(caught.value)


def test_positions_of_unknown_angle_do_not_count():
    r = session()
    r.angles[0] = np.nan
    with pytest.raises(FoucaultError, match="outer angle 0 deg"):
        unified(r)
