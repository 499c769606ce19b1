"""Outputs in steps that the noise does not blur leave an error that no averaging removes."""

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.cells import SAMPLES, _State
from foucault.detect.means import Glimpses
from foucault.detect.noise import lattice
from foucault.detect.readings import find_readings
from foucault.detect.spins import Window
from foucault.models.earth import Site
from foucault.procedures import norm_observation, turntable
from foucault.tables import Log
from make_table_log import DEG, FACES, GRAVITY, ICO, Session, plan_of

STEP = 0.0625 * DEG


def coarse(log, gyro=STEP, accel=0.0):
    out = replace(log, gyro=np.round(log.gyro / gyro) * gyro)
    return replace(out, accel=np.round(log.accel / accel) * accel) if accel else out


def test_a_gyro_that_shows_no_step_at_rest_has_the_rounding_of_its_moves():
    rates = np.repeat([0.0, 10 * DEG], 6)
    session = Session(
        plan_of(np.concatenate([FACES, FACES]), rates, turns=1.2), 20.0,
        gyro_bias=(2.01 * DEG, -1.02 * DEG, 0.51 * DEG), ramp=7.3 * DEG,
    )  # fmt: skip
    log = coarse(session.log(("angles",)))
    got = find_readings(log)
    rest = ~got.spin
    part = (log.time >= got.start[0]) & (log.time < got.start[0] + got.time[0])
    assert np.ptp(log.gyro[part], axis=0).max() == 0  # nothing moves at rest
    # Each axis reads its bias in six rests and in the four spins across it: ten times the same.
    var = got.gyro_cov[:, range(3), range(3)]
    np.testing.assert_allclose(var[rest], 10 * STEP**2 / 12, rtol=1e-3)
    # Along the axis a spin is alone, except that steps may hide the noise: its own rounding.
    along = np.abs(got.gyro[got.spin]) > 5 * DEG
    assert along.sum() == 6
    np.testing.assert_allclose(var[got.spin][along], STEP**2 / 12, rtol=0.05)


def test_what_is_given_bounds_every_combination_of_shared_roundings():
    windows = [Window(float(k), k + 1.0) for k in range(5)]
    seen = Glimpses(windows)
    time = np.arange(0, 5, 0.01)
    level = np.array([0, 0, 0, 3, 7])[np.minimum(time.astype(int), 4)] * 0.5
    x = np.stack([level, level + 1, -level], axis=1)
    x[::50] += 0.5  # now and then a step
    seen.see(Log(time, x, None))
    shared = seen.shared("gyro", np.full(3, 0.5))
    np.testing.assert_array_equal(shared[:, 0], [3, 3, 3, 1, 1])
    true = np.zeros((5, 5))
    true[:3, :3] = 1
    true[3, 3] = true[4, 4] = 1
    assert np.linalg.eigvalsh(np.diag(shared[:, 0]) - true).min() > -1e-12


def test_a_signal_that_is_not_rounded_has_no_steps():
    rng = np.random.default_rng(1)
    still = np.repeat(rng.normal(size=50), 100)  # constant, fifty times, not on steps
    assert lattice(still) == 0
    assert lattice(rng.normal(size=5000)) == 0
    assert lattice(np.full(100, 3.0)) == 0 and lattice(np.empty(0)) == 0
    written = np.round(np.round(rng.normal(size=5000) * 20) * STEP, 8)  # in eight decimals
    assert lattice(written) == pytest.approx(STEP, rel=1e-4)


def test_of_a_long_log_only_a_part_is_kept_from_beginning_to_end():
    time = np.arange(150_000.0)
    log = Log(time, np.outer(time, np.ones(3)), None)
    state = _State(log)
    for k in range(0, len(log), 5000):
        state.cells_of(log[k : k + 5000])
    kept = state.kept["gyro"][:, 0]
    assert SAMPLES / 2 < len(kept) <= SAMPLES
    assert kept[0] == 0 and kept[-1] >= 149_990
    np.testing.assert_array_equal(np.diff(kept), 4.0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("gyro", "accel"), [(0.0625, 0.0), (0.5, 0.0), (0.5, 0.05)], ids=["fine", "coarse", "both"]
)
@pytest.mark.parametrize("which", ["turntable", "norm", "norm with g"])
def test_coarse_outputs_do_not_make_results_that_are_too_sure(gyro, accel, which):
    rates = np.repeat([0.0, 10 * DEG], 12)
    plan = plan_of(np.concatenate([ICO, ICO]), rates, time=10.0, turns=1.2)
    bias = np.array([0.31, -0.12, 0.27]) * DEG
    made = Session(plan, 20.0, gyro_noise=0.004 * DEG, accel_noise=1e-3, gyro_bias=tuple(bias),
                   accel_bias=(0.03, -0.02, 0.013), seed=3)  # fmt: skip
    log = coarse(made.log(("angles",)), gyro * DEG, accel)
    procedure = turntable if which == "turntable" else norm_observation
    words = [[f"{angle:.4f} deg" for angle in row] for row in np.degrees(ICO)]
    more = {"g_sensitivity": True} if which == "norm with g" else {}
    result = procedure.calibrate(
        log, site=Site(GRAVITY, 45 * DEG),
        settings=procedure.Settings(positions=words, spin_rate=10 * DEG, **more),
    )  # fmt: skip
    got = result.coefficients
    names = list(got.layout.names)
    true = np.zeros(len(names))
    for i, axis in enumerate("xyz"):
        true[names.index(f"gyro.bias.{axis}")] = bias[i]
        true[names.index(f"accel.bias.{axis}")] = (0.03, -0.02, 0.013)[i]
    error = got.values - true
    assert error @ np.linalg.solve(got.cov, error) < 1.8 * len(names)
    # A rounding common to all rests cannot be known better than it is.
    sd = np.sqrt(np.diag(got.cov))[names.index("gyro.bias.z")]
    assert sd > 0.1 * gyro * DEG
