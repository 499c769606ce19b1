"""The published sums of squares: their minima are those a general optimiser finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from foucault.estimate.hand_rotated import (
    ACCEL_NAMES,
    GYRO_NAMES,
    fit_directions,
    fit_norms,
)
from foucault.kernels.rotation import integrate_turns, integrate_turns_rk4
from foucault.models.imu import LINEAR_LOWER, ImuModel
from make_session import SITE, model_of, quiet_session, seen_by

TIGHT = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "x_scale": "jac"}


def _errors():
    rng = np.random.default_rng(13)
    return model_of({n: rng.normal(0, 0.01) for n in LINEAR_LOWER})


def _noisy():
    simulation = quiet_session(100.0)
    log = seen_by(_errors(), simulation)
    rng = np.random.default_rng(14)
    noisy = replace(
        log,
        accel=log.accel + rng.normal(0, 0.02, log.accel.shape),
        gyro=log.gyro + rng.normal(0, 0.002, log.gyro.shape),
    )
    return simulation, noisy


def test_fit_norms_is_at_the_optimum():
    simulation, log = _noisy()
    readings = np.concatenate([log.accel[a : a + 50] for a in simulation.first])
    got = fit_norms(readings, SITE.gravity, ImuModel())

    def miss(x):
        f_b, _ = model_of(dict(zip(ACCEL_NAMES, x, strict=True))).compensate(readings, None)
        return SITE.gravity - np.linalg.norm(f_b, axis=1)

    want = least_squares(miss, np.zeros(9), **TIGHT)
    # The optimum is flat: the cost fixes it to sqrt(rounding) of the uncertainty, 1e-7 sd.
    np.testing.assert_allclose(
        (got.coefficients.values - want.x) / got.coefficients.sd, 0, atol=1e-4
    )
    assert got.chi_square == pytest.approx(2 * want.cost, rel=1e-10)
    J = want.jac
    cov = np.linalg.inv(J.T @ J) * 2 * want.cost / (len(readings) - 9)
    # scipy's Jacobian is a forward difference, good to 1e-7 or so, squared by the condition.
    np.testing.assert_allclose(got.coefficients.sd, np.sqrt(np.diag(cov)), rtol=1e-4)


@pytest.mark.parametrize("runge_kutta", [True, False])
def test_fit_directions_is_at_the_optimum(runge_kutta):
    simulation, log = _noisy()
    f_b, _ = _errors().compensate(
        np.array(
            [
                log.accel[a:b].mean(axis=0)
                for a, b in zip(simulation.first, simulation.last, strict=True)
            ]
        ),
        None,
    )
    up_b = f_b / np.linalg.norm(f_b, axis=1)[:, None]
    first, last = simulation.last[:-1] - 1, simulation.first[1:]
    held = ImuModel(gyro_bias=_errors().gyro_bias)
    got = fit_directions(log, up_b, first, last, held, runge_kutta=runge_kutta)

    def miss(x):
        model = replace(model_of(dict(zip(GYRO_NAMES, x, strict=True))), gyro_bias=held.gyro_bias)
        _, w = model.compensate(None, log.gyro)
        if runge_kutta:
            C_se = integrate_turns_rk4(log.time, w, first, last)
        else:
            C_se = integrate_turns(log.time, w, w, np.zeros((3, 3)), first, last, False)[0]
        return (up_b[1:] - np.einsum("nji,nj->ni", C_se, up_b[:-1])).ravel()

    want = least_squares(miss, np.zeros(9), **TIGHT)
    # The sensitivities of the better rule serve the Runge-Kutta cost too: its own minimum is
    # met to the difference of the two rules, a few arcseconds of 1e-2 of the residuals.
    np.testing.assert_allclose(
        (got.coefficients.values - want.x) / got.coefficients.sd, 0, atol=1e-3
    )
    assert got.chi_square == pytest.approx(2 * want.cost, rel=1e-7)
    assert np.array_equal(got.state.gyro_bias, held.gyro_bias)
