"""Systematic calibration: all errors back from the velocity at rest, and as sure as it says."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.estimate.systematic import BETWEEN, AtRest, SystematicModel, attitude_at_start
from foucault.estimate.systematic import Start as RecordingStart
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site, displaced
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import angles_of, exp
from foucault.models.size_effect import with_size_effect
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.ins_filter import start_cov
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


def at_start(phi_sd):
    return start_cov(np.diag(phi_sd**2), 0.01, 0.01, np.zeros(0))


def solved(increments, C_nb, sensors, rests, sd, at_rest=None):
    """Return what one pass finds of the coefficients, zero give or take their sd beforehand."""
    model = SystematicModel(increments, SITE, sensors, rests, NOISE, at_rest or AtRest())
    start = RecordingStart(0, C_nb, at_start(PHI_SD))
    return model.filtered([start], np.zeros(len(sd)), sd).estimate


def test_noise_free_session_gives_everything_back(session):
    plan, start, rows = session
    sensors = Sensors.of(NAMES)
    sd = spread_of(sensors)
    truth = sd * np.random.default_rng(1).normal(size=len(sd))
    model = ImuModel.from_coefficients(CoefficientVector(sensors.layout, truth))
    made = simulate_motion(plan, start, rate=RATE, model=model, sampled="increment", seed=0,
                           noise=ImuNoise())  # fmt: skip
    C_nb = exp(PHI_SD * [1, -1, 1]) @ made.truth.C_nb[0]
    model = SystematicModel(increments_of(made.log), SITE, sensors, rows, NOISE, AtRest(1e-5, 1e-4))
    passes = [np.zeros(len(sd))]
    for _ in range(3):
        start = RecordingStart(0, C_nb, at_start(10 * PHI_SD))
        found = model.filtered([start], passes[-1], 10 * sd, keep=True)
        passes.append(found.estimate.values)
        C_nb = attitude_at_start(found, C_nb)
    missed = np.abs(np.array(passes[1:]) - truth) / sd
    assert missed[0].max() < 0.1  # second order in the start errors
    assert missed[2].max() < 2e-3
    np.testing.assert_allclose(passes[3], passes[2], rtol=0, atol=2e-3 * sd.max())


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


@pytest.mark.thorough
def test_consistent(session):
    """NEES of 12 sessions inside two-sided limits at 1 %; a covariance too small is not."""
    plan, start, rows = session
    motion, _ = motion_of(plan, start)
    time = np.arange(round(motion.end * RATE) + 1) / RATE
    samples = motion.increments(time)
    true = motion.trajectory(time[:1]).C_nb[0]
    sensors = Sensors.of(NAMES)
    sd = spread_of(sensors)
    rests = [(max(a - 1, 0), b - 1) for a, b in rows]
    rng, nees, runs = np.random.default_rng(3), [], 12
    for _ in range(runs):
        truth, increments = drawn(motion, sensors, sd, rng, samples)
        C_nb = exp(-PHI_SD * rng.normal(size=3)) @ true
        found = solved(increments, C_nb, sensors, rests, sd)
        err = found.values - truth
        nees.append(err @ np.linalg.solve(found.cov, err))
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


def test_velocity_in_turns_is_measured_where_its_sd_is_said(session):
    rows = session[2]
    n = rows[-1][1] + 1
    quiet = Increments.of(np.arange(n) / RATE, np.zeros((n, 3)), np.zeros((n, 3)))
    updates = AtRest(turning_sd=0.02).updates(quiet, rows, SITE, 0)
    turning = updates.sd[:, 0] == 0.02
    between = np.ones(n, bool)
    for a, b in rows:
        between[a : b + 1] = False
    assert between[updates.rows[turning]].all() and turning.sum() == 18 * 9
    assert np.isinf(updates.sd[turning, 3:]).all()  # not where it is: the arms of the table
    assert np.diff(updates.rows).max() == RATE


def test_what_a_restart_forgets_turns_measured_give_back(session):
    """Velocity known in turns makes up for some of what starting each rest anew costs."""
    plan, start, rows = session
    motion, _ = motion_of(plan, start)
    time = np.arange(round(motion.end * RATE) + 1) / RATE
    true = motion.trajectory(time[:1]).C_nb[0]
    sensors = Sensors.of(NAMES)
    sd = spread_of(sensors)
    increments = drawn(motion, sensors, sd, np.random.default_rng(4), motion.increments(time))[1]
    rests = [(max(a - 1, 0), b - 1) for a, b in rows]

    def scale_sd(at_rest):
        return solved(increments, true, sensors, rests, sd, at_rest)["gyro.scale"].sd.mean()

    full, forgetful = scale_sd(AtRest()), scale_sd(AtRest(decorrelate=True))
    measured = scale_sd(AtRest(decorrelate=True, turning_sd=1e-3))
    assert full < measured < 0.95 * forgetful


class Missed(AtRest):
    """Rests somewhere near the place, as a table without a centre leaves them."""

    def updates(self, increments, rests, site, first):
        out = super().updates(increments, rests, site, first)
        rng = np.random.default_rng(6)
        for a, b in rests[1:]:
            there = (out.rows >= a) & (out.rows <= b)
            anew = np.flatnonzero(there & out.restart)
            if len(anew):
                there[anew[0] :] = False  # from then on that is the place
            off = self.position_sd * rng.normal(size=3)
            out.position[there] = np.stack(displaced(site.latitude, 0.0, site.height, off))
        return out


def test_a_place_missed_counts_once_a_rest(session):
    """What misses of `position_sd` do to the result is within what is promised."""
    plan, start, rows = session
    motion, _ = motion_of(plan, start)
    time = np.arange(round(motion.end * RATE) + 1) / RATE
    true = motion.trajectory(time[:1]).C_nb[0]
    plain = Sensors.of(NAMES)
    rng = np.random.default_rng(4)
    increments = drawn(motion, plain, spread_of(plain), rng, motion.increments(time))[1]
    sensors = with_size_effect(plain)  # what turns do to the place is told by lever arms and delay
    sd = np.concatenate([spread_of(plain), [0.1] * 6, [0.02]])
    rests = [(max(a - 1, 0), b - 1) for a, b in rows]
    here, missed = (
        solved(increments, true, sensors, rests, sd, kind(1e-3, 0.01)) for kind in (AtRest, Missed)
    )
    moved = missed.values - here.values
    assert np.abs(moved / here.sd).max() > 0.05  # it does something
    assert moved @ np.linalg.solve(here.cov, moved) < chi_square_limits(len(moved), 0.01)[1]
