"""A simulated systematic calibration against an independent simulation, and its errors."""

from __future__ import annotations

import time

import numpy as np
import pytest

from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import angles_of
from foucault.plans.manoeuvres import Rest, Rotate, Start
from foucault.plans.sequence import (
    CalibrationSequence,
    action_sequences,
    nineteen_positions,
    spin,
)
from foucault.simulate.motion import simulate_motion
from foucault.simulate.systematic import TableErrors, simulate_systematic
from make_sequence import ARCSEC, DEG, SITE, simulated
from refusals import refuses

QUIET = {"noise": ImuNoise()}
SHORT = CalibrationSequence(
    "short", np.eye(3), (
        Rest(3.0), Rotate("z", 58.3 * DEG, 10 * DEG), Rotate("east", -40 * DEG, 10 * DEG),
        spin("north", 1, 18 * DEG), Rest(4.0), Rotate("x", 0.5 * DEG, 10 * DEG), Rest(2.0),
    ),
)  # fmt: skip


def flawed(seed: int = 0) -> ImuModel:
    rng = np.random.default_rng(seed)
    draw = rng.standard_normal
    return ImuModel(
        np.eye(3) + 1e-3 * draw((3, 3)), 1e-2 * draw(3), 1e-5 * draw((3, 6)),
        np.eye(3) + 1e-3 * draw((3, 3)), 1e-5 * draw(3), 1e-6 * draw((3, 3)),
        1e-4 * draw(3), 1e-4 * draw(3),
    )  # fmt: skip


@pytest.mark.parametrize("rate", [5.0, 50.0, 200.0])
def test_it_says_what_the_general_simulation_says(rate: float) -> None:
    sequence = SHORT.on_samples(rate)
    start = Start(34 * DEG, 0.3, 380.0, *angles_of(sequence.start))
    other = simulate_motion(list(sequence.actions), start, rate=rate, model=flawed())
    ours = simulate_systematic(sequence, site=SITE, rate=rate, model=flawed())
    assert ours.log.time == pytest.approx(other.log.time, abs=1e-12)
    # The asymmetry of a gyro has a corner at rate zero, which no quadrature takes exactly.
    assert np.abs(ours.log.gyro - other.log.gyro).max() < 2e-8
    assert np.abs(ours.log.accel - other.log.accel).max() < 1e-9
    smooth = ImuModel(accel_matrix=flawed().accel_matrix, gyro_matrix=flawed().gyro_matrix)
    other = simulate_motion(list(sequence.actions), start, rate=rate, model=smooth)
    ours = simulate_systematic(sequence, site=SITE, rate=rate, model=smooth)
    assert np.abs(ours.log.gyro - other.log.gyro).max() < 1e-12
    assert np.abs(ours.log.accel - other.log.accel).max() < 2e-10
    assert np.abs(ours.attitude(ours.log.time) - other.truth.C_nb).max() < 1e-12


def test_lever_arms_are_felt_by_each_accelerometer_in_its_own_axis() -> None:
    arms = np.array([[0.03, -0.01, 0.02], [0.05, 0.04, -0.02], [-0.01, 0.06, 0.03]])
    rate = 400.0
    with_arms = simulated(SHORT, rate, arms=arms, **QUIET)
    without = simulated(SHORT, rate, **QUIET)
    felt = with_arms.log.accel - without.log.accel
    assert np.array_equal(with_arms.log.gyro, without.log.gyro)
    # The second difference of where an accelerometer is, seen from space.
    t, h = without.log.time - 0.5 / rate, 1e-2
    turn = lambda t: t[:, None] * earth_rate_n(SITE.latitude)  # noqa: E731
    place = lambda t: _exp(turn(t)) @ without.attitude(t) @ arms.T  # noqa: E731
    acceleration = (place(t + h) - 2 * place(t) + place(t - h)) / h**2
    C_ib = _exp(turn(t)) @ without.attitude(t)
    expected = np.einsum("nai,nai->ni", C_ib, acceleration)
    inside = slice(10, -10)
    assert np.abs(felt[inside]).max() > 5e-3
    assert felt[inside] == pytest.approx(expected[inside], abs=2e-3 * np.abs(felt).max())


def _exp(phi: np.ndarray) -> np.ndarray:
    from foucault.models.rotation import exp

    return exp(phi)


def test_a_delay_shifts_the_accelerometers_alone() -> None:
    rate = 100.0
    late = simulated(SHORT, rate, delay=0.02, model=flawed(), **QUIET).log
    now = simulated(SHORT, rate, model=flawed(), **QUIET).log
    assert np.array_equal(late.gyro, now.gyro)
    assert late.accel[2:] == pytest.approx(now.accel[:-2], abs=1e-12)
    half = simulated(SHORT, rate, delay=0.005, model=flawed(), **QUIET).log
    assert half.accel[2:-2] == pytest.approx(
        (9 * (now.accel[1:-3] + now.accel[2:-2]) - now.accel[:-4] - now.accel[3:-1]) / 16, abs=3e-4
    )


def test_table_errors_move_the_truth_and_not_the_plan() -> None:
    told = nineteen_positions(rest=20.0)
    start = (1 * DEG, -2 * DEG, 5 * DEG)
    done = simulated(told, table=TableErrors(600 * ARCSEC, start), seed=3, **QUIET)
    assert np.array_equal(done.sequence.times, done.told.times)
    errors = [
        a.angle - b.angle
        for a, b in zip(done.sequence.actions, told.actions, strict=True)
        if isinstance(a, Rotate)
    ]
    # 18 errors: chi-square limits of their sd at 1 %
    assert 0.59 < np.std(errors) / (600 * ARCSEC) < 1.45
    tilt = np.arccos(done.sequence.start[2] @ told.start[2])
    assert tilt == pytest.approx(np.hypot(1, 2) * DEG, rel=0.01)
    truth = done.truth_json()
    assert truth["C_nb_start"] == done.sequence.start.tolist()
    assert np.subtract(truth["angles"], errors) == pytest.approx(
        [a.angle for a in told.actions if isinstance(a, Rotate)]
    )
    f = done.log.accel[:10].mean(axis=0)
    assert f == pytest.approx(done.sequence.start.T @ [0, 0, SITE.gravity], abs=1e-9)


def test_noise_is_that_of_its_grade_and_seeded() -> None:
    a, b = simulated(SHORT, seed=1), simulated(SHORT, seed=1)
    assert np.array_equal(a.log.gyro, b.log.gyro)
    clean = simulated(SHORT, **QUIET).log
    sd = np.std(a.log.accel - clean.accel)
    assert sd == pytest.approx(5e-6 * 9.80665 * np.sqrt(50.0), rel=0.05)


@pytest.mark.thorough
def test_an_hour_and_a_half_takes_seconds() -> None:
    sequence = nineteen_positions().then(action_sequences())
    begin = time.process_time()
    log = simulated(sequence, 100.0, model=flawed(), arms=np.full((3, 3), 0.03), delay=5e-3).log
    assert len(log) == 550_551
    assert time.process_time() - begin < 8.0


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        ({"site": Site(9.8)}, "systematic.site", "latitude of the site is unknown"),
        ({"rate": 0.0}, "systematic.value", "`rate` of the simulation is 0.0"),
        ({"delay": np.nan}, "systematic.value", "`delay`"),
        ({"arms": np.zeros(3)}, "systematic.value", "`arms` .* three finite places"),
        ({"table": TableErrors(-1.0)}, "systematic.value", "`angle_sd`"),
    ],
)
def test_what_is_refused(more, code: str, words: str) -> None:
    with refuses(code, match=words):
        simulated(SHORT, **more)
