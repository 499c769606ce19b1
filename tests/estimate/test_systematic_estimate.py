"""Systematic calibration: all errors back from the velocity at rest, and as sure as it says."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.ins_filter import start_cov
from foucault.estimate.systematic import BETWEEN, AtRest, solve
from foucault.models.attitude import angles_of
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.navigate.increments import Increments, increments_of
from foucault.plans.manoeuvres import Rest, Rotate, Start
from foucault.simulate.motion import motion_of, simulate_motion

DEG, RATE = np.pi / 180, 50.0
ARCSEC, UG = DEG / 3600, 9.80665e-6
NAMES = (
    "gyro.bias", "gyro.scale", "gyro.misalignment", "accel.bias", "accel.scale",
    "accel.misalignment.yx", "accel.misalignment.zx", "accel.misalignment.zy",
)  # fmt: skip
SPREAD = {
    "gyro.bias": 0.02 * ARCSEC, "gyro.scale": 1e-4, "gyro.misalignment": 100 * ARCSEC,
    "accel.bias": 200 * UG, "accel.scale": 2e-4, "accel.misalignment": 100 * ARCSEC,
}  # fmt: skip
NOISE = ImuNoise(TriadNoise(white=5 * UG), TriadNoise(white=0.0007 * DEG / 60))
PHI_SD = np.array([60, 60, 600]) * ARCSEC
UP_EAST_NORTH = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
SITE = Site.at(40 * DEG)
TURNS = ["+y"] * 3 + ["-y"] * 3 + ["+z"] + ["+x"] * 3 + ["-x"] * 3 + ["+z"] * 2 + ["-z"] * 3


@pytest.fixture(scope="module")
def session():
    """Make 19 positions with rests of 40 s: plan, start, and the rows of the rests."""
    plan, rests, t = [Rest(40.0)], [(0.0, 40.0)], 40.0
    for sign, axis in TURNS:
        turn = Rotate(axis, float(f"{sign}90") * DEG, 10 * DEG)
        plan += [turn, Rest(40.0)]
        rests.append((t + turn.time, t + turn.time + 40.0))
        t += turn.time + 40.0
    heading, pitch, roll = angles_of(UP_EAST_NORTH)
    start = Start(SITE.latitude, 0.0, 0.0, heading, pitch, roll)
    rows = [(round(a * RATE), round(b * RATE)) for a, b in rests]
    return plan, start, rows


def spread_of(sensors):
    names = sensors.layout.names
    return np.array([next(v for k, v in SPREAD.items() if n.startswith(k)) for n in names])


def test_noise_free_session_gives_everything_back(session):
    plan, start, rows = session
    sensors = Sensors.of(NAMES)
    sd = spread_of(sensors)
    truth = sd * np.random.default_rng(1).normal(size=len(sd))
    model = ImuModel.from_coefficients(CoefficientVector(sensors.layout, truth))
    made = simulate_motion(plan, start, rate=RATE, model=model, sampled="increment", seed=0,
                           noise=ImuNoise())  # fmt: skip
    C_nb = exp(PHI_SD * [1, -1, 1]) @ made.truth.C_nb[0]
    loose = start_cov(np.diag(100 * PHI_SD**2), 0.01, 0.01, 10 * sd)
    still = AtRest(1e-5, 1e-4)
    found = solve(increments_of(made.log), C_nb, SITE, sensors, rows, loose, NOISE,
                  at_rest=still, passes=3)  # fmt: skip
    missed = np.abs(np.array(found.passes) - truth) / sd
    assert missed[0].max() < 0.1  # second order in the start errors
    assert missed[2].max() < 2e-3
    np.testing.assert_allclose(found.passes[2], found.passes[1], rtol=0, atol=2e-3 * sd.max())


def drawn(motion, sensors, sd, rng, samples):
    """Draw errors, and what the instrument says with noise."""
    truth = sd * rng.normal(size=len(sd))
    model = ImuModel.from_coefficients(CoefficientVector(sensors.layout, truth))
    mean = [x * RATE for x in samples]
    accel, gyro = model.measure(mean[1], mean[0])
    root = np.sqrt(RATE)
    gyro = gyro + NOISE.gyro.white * root * rng.normal(size=gyro.shape)
    accel = accel + NOISE.accel.white * root * rng.normal(size=accel.shape)
    time = np.arange(1, len(gyro) + 1) / RATE
    return truth, Increments.of(time, gyro / RATE, accel / RATE)


def test_consistent(session):
    """NEES of 12 sessions inside two-sided limits at 1 %; a covariance too small is not."""
    plan, start, rows = session
    motion, _ = motion_of(plan, start)
    time = np.arange(round(motion.end * RATE) + 1) / RATE
    samples = motion.increments(time)
    true = motion.trajectory(time[:1]).C_nb[0]
    sensors = Sensors.of(NAMES)
    sd = spread_of(sensors)
    P0 = start_cov(np.diag(PHI_SD**2), 0.01, 0.01, sd)
    rests = [(max(a - 1, 0), b - 1) for a, b in rows]
    rng, nees, runs = np.random.default_rng(3), [], 12
    for _ in range(runs):
        truth, increments = drawn(motion, sensors, sd, rng, samples)
        C_nb = exp(-PHI_SD * rng.normal(size=3)) @ true
        found = solve(increments, C_nb, SITE, sensors, rests, P0, NOISE)
        err = found.estimate.values - truth
        nees.append(err @ np.linalg.solve(found.estimate.cov, err))
    low, high = chi_square_limits(runs * len(sd), 0.01)
    assert low < sum(nees) < high
    assert not low < sum(nees) / 0.7 < high


def test_epochs_are_short_and_only_rests_are_measured(session):
    rows = session[2]
    n = rows[-1][1] + 1
    quiet = Increments.of(np.arange(n) / RATE, np.zeros((n, 3)), np.zeros((n, 3)))
    updates = AtRest(decorrelate=True).updates(quiet, rows, SITE, 0)
    assert updates.rows[0] == 0 and np.isinf(updates.sd[0]).all()
    assert np.diff(updates.rows).max() <= BETWEEN * RATE
    measured = np.isfinite(updates.sd).all(axis=1)
    inside = np.zeros(n, bool)
    for a, b in rows:
        inside[a : b + 1] = True
    assert inside[updates.rows[measured]].all() and measured.sum() == 19 * 40
    assert updates.restart.sum() == 18 and measured[updates.restart].all()
