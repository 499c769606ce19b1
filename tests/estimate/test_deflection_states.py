"""Parameters of a model of deflection as states of the filter: they come back, and are applied."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.deflection import deflection_model
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.ins_filter import run, start_cov
from foucault.plans.manoeuvres import Start
from make_ins import SITE, increments, made, still, tumble

QUIET = ImuNoise(accel=TriadNoise(white=1e-7), gyro=TriadNoise(white=1e-9))
MOTION, TIME, STATE = made(tumble(4.0, 0.8), Start(*SITE, heading=0.4, pitch=0.03, roll=-0.05))
ROWS = np.arange(50, len(TIME), 50)


def found(model, injected, sensors, size):
    log = increments(MOTION, TIME, ImuModel(deflection=model.tensor(injected)))
    sd = np.full(len(sensors), 10 * size)
    P0 = start_cov(np.diag([1e-8] * 3), 1e-4, 1e-3, sd)
    return run(log, STATE, sensors, still(ROWS, 1e-5, 1e-4), P0, QUIET)


@pytest.mark.parametrize(
    ("name", "chirality"),
    [
        ("coupled6", -1),
        ("coupled6", 1),
        ("direct6+transverse3", -1),
        ("lateral3+axial6", -1),
        ("direct12", -1),
    ],
)
def test_one_parameter_comes_back_and_no_other(name, chirality):
    """All of a model are states; one was injected, without noise: far inside what is predicted."""
    model = deflection_model(name, chirality)
    sensors = Sensors.of(()).with_deflection(model)
    for k in range(len(model)):
        theta = 3e-6 * np.eye(len(model))[k]
        got = found(model, theta, sensors, 3e-6).estimate
        assert (got.sd < 0.2 * 3e-6).all()
        assert np.max(np.abs(got.values - theta) / got.sd) < 0.2


def test_what_comes_back_is_applied_as_general_coefficients():
    """Beside other coefficients: the readings compensated by names alone are the true ones."""
    model = deflection_model("coupled6")
    sensors = Sensors.of(("gyro.bias", "accel.bias", "accel.asymmetry")).with_deflection(model)
    theta = 3e-6 * np.array([1.0, -0.5, 0.3, 0.8, -1.0, 0.6])
    got = model.general(found(model, theta, sensors, 3e-6).estimate)
    assert "gyro.deflection.xyz" in got.names
    made_of = ImuModel.from_coefficients(got)
    truth = ImuModel(deflection=model.tensor(theta))
    f, w = np.array([[3.0, -5.0, 8.0]]), np.array([[0.5, 0.8, -1.0]])
    back = made_of.compensate(*truth.measure(f, w))
    np.testing.assert_allclose(back[1], w, rtol=0, atol=1e-2 * 3e-6 * 10)
    assert np.abs(truth.measure(f, w)[1] - w).max() > 1e-5
