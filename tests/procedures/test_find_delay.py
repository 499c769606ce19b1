"""The offset of two logs, and what is said of logs that show none, or a wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.imu import ImuModel
from foucault.models.rotation import exp, matrix_of
from foucault.models.transfer import MasterTable
from foucault.plans.manoeuvres import Climb, Start, Straight, STurn, Turn
from foucault.plans.transfer import TransferProfile
from foucault.procedures.delay import FoundDelay, find_delay
from foucault.result import Level
from foucault.simulate.transfer import (
    Link,
    MasterNoise,
    Slave,
    TransferSimulation,
    draw_slave,
    simulate_transfer,
    turn_on_grade,
)
from foucault.tables import Log
from make_transfer import ARCMIN, DEG
from refusals import refuses

START = Start(45 * DEG, 9 * DEG, 800.0, heading=20 * DEG, speed=45.0)
FLIGHT = TransferProfile(
    "s-turns", START, (
        STurn(40 * DEG, 10.0), Climb(4.0, angle=20 * DEG), Turn(60 * DEG, 8.0),
        Climb(4.0, angle=-5 * DEG), STurn(-50 * DEG, 10.0), Climb(4.0, angle=0.0),
    ),
    (Straight(1.0),),
)  # fmt: skip
STRAIGHT = TransferProfile("straight", START, (Straight(40.0),), (Straight(1.0),))
NOISE = turn_on_grade().noise
CLEAN = MasterNoise(attitude=(0.1 * ARCMIN,) * 3)
ALONG = np.eye(3)


def flown(
    delay: float = 0.08, *, profile: TransferProfile = FLIGHT, C_0=None, seed: int = 3,
    noise: MasterNoise = CLEAN, **link,
) -> TransferSimulation:  # fmt: skip
    slave = draw_slave(np.random.default_rng(seed))
    slave = slave if C_0 is None else replace(slave, C_0=C_0)
    return simulate_transfer(profile, rate=100.0, slave=slave, link=Link(delay=delay, **link),
                             noise=noise, seed=seed)  # fmt: skip


def two_gyros(
    seed: int, drift: float = 0.0, rate: float = 100.0, noise: float = 0.01, delay: float = 0.0374
) -> tuple[Log, Log]:
    """Return two logs of a body in a hand, 100 Hz; the first has the noisier gyros [rad/s]."""
    rng = np.random.default_rng(seed)
    size, phase = rng.normal(size=(300, 3)) / 20, rng.uniform(0, 6.3, (300, 3))
    cycles = 2 * np.pi * rng.uniform(0.05, 2.5, 300)

    def log_of(clock, time, C, sd):
        w = np.stack([np.sin(np.outer(clock, cycles) + p) @ a
                      for p, a in zip(phase.T, size.T, strict=True)], axis=1)  # fmt: skip
        return Log(time, w @ C + sd * rng.normal(size=w.shape), None)

    slow, fast = np.arange(0, 40, 0.01), np.arange(0, 40, 1 / rate)
    # What the second stamps t was true at t - delay - drift t by the clock of the first.
    return (log_of(slow, slow, matrix_of(0.5, 0.1, -0.2), noise),
            log_of(fast - delay - drift * fast, fast, np.eye(3), noise / 10))  # fmt: skip


def codes(found: FoundDelay) -> set[str]:
    return {f.code for f in found.findings}


def angled(table: MasterTable, H: int = 1, P: int = 1, R: int = 1) -> MasterTable:
    """Return a table whose angles count the other way."""
    angles = table.angles * [H, P, R]
    return replace(table, C_nb=matrix_of(*angles.T))


@pytest.mark.parametrize("delay", [0.0237, 0.1, 0.19])
def test_a_delay_and_what_comes_with_it(delay: float) -> None:
    run = flown(delay)
    found = find_delay(run.log, run.master, C_ms=ALONG)
    one = found.delay
    assert one.delay == pytest.approx(run.delay, abs=min(4 * one.delay_sd, 1e-3))
    assert found.verdict.level is Level.PASS and codes(found) == set()
    true = exp(np.array(run.slave.mu))
    off = 4 * np.sqrt(np.diag(one.mu_cov))
    assert np.all(np.abs(one.C_ms.T @ true - np.eye(3)) < off.max())
    assert len(one.part_delay) == 4 and one.drift == 0.0


def test_the_bias() -> None:
    """Without errors of scale, which times the mean rate look like one."""
    bias = np.array([40.0, -30.0, 10.0]) * DEG / 3600
    slave = Slave(mu=(0.001, -0.002, 0.003), model=ImuModel(gyro_bias=bias), noise=NOISE)
    run = simulate_transfer(FLIGHT, rate=100.0, slave=slave, noise=CLEAN, seed=4)
    one = find_delay(run.log, run.master).delay
    z = (one.bias - bias) / np.sqrt(np.diag(one.bias_cov))
    assert np.all(np.abs(z) < 4) and np.max(one.bias_cov) ** 0.5 < 3 * DEG / 3600
    nowhere = replace(run.master, latitude=None, longitude=None, height=None)
    found = find_delay(run.log, nowhere)
    assert "delay.earth" in codes(found)
    assert np.linalg.norm(found.delay.bias - bias) > 5 * DEG / 3600


def test_an_unknown_mounting_is_found() -> None:
    C_0 = matrix_of(130 * DEG, -20 * DEG, 160 * DEG)
    run = flown(C_0=C_0)
    found = find_delay(run.log, run.master)
    assert found.delay.delay == pytest.approx(run.delay, abs=5e-4)
    assert np.allclose(found.delay.C_ms, C_0 @ exp(np.array(run.slave.mu)), atol=2 * ARCMIN)
    wrong = find_delay(run.log, run.master, C_ms=ALONG)
    assert wrong.verdict.level is not Level.PASS


def test_a_slave_in_other_axes_is_named() -> None:
    swapped = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    run = flown(C_0=swapped)
    found = find_delay(run.log, run.master)
    assert codes(found) == {"delay.north_east_down"} and found.verdict.level is Level.PASS
    (told,) = found.findings
    assert "forward, right, down of the master" in told.message
    turned = flown(C_0=matrix_of(25 * DEG, 0.0, 0.0))
    (told,) = find_delay(turned.log, turned.master, C_ms=ALONG).findings
    assert told.code == "delay.axes" and "mounted 25" in told.message


@pytest.mark.thorough
@pytest.mark.parametrize("place", [0, 1, 2])
def test_an_angle_that_counts_the_other_way(place: int) -> None:
    run = flown()
    signs = 1 - 2 * np.eye(3, dtype=int)[place]
    wrong = angled(run.master, *signs)
    found = find_delay(run.log, wrong, C_ms=ALONG)
    (told,) = (f for f in found.findings if f.code == "delay.sense")
    assert f"the {('heading', 'pitch', 'roll')[place]} of the master is reversed" in told.message
    assert found.verdict.level is not Level.PASS
    unknown = find_delay(run.log, wrong)  # one is then as good as another
    assert "delay.sense" in codes(unknown)
    assert unknown.delay.delay == pytest.approx(run.delay, abs=5e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("mounting", [None, ALONG])
def test_a_gyro_that_is_reversed(mounting) -> None:
    run = flown()
    for wrong, axes in (
        (run.log.gyro * [1, 1, -1], "x, y, -z"),
        (run.log.gyro[:, [1, 0, 2]], "y, x, z"),
    ):
        found = find_delay(replace(run.log, gyro=wrong), run.master, C_ms=mounting)
        (told,) = (f for f in found.findings if f.code == "transfer.mirror")
        assert f"x, y, z point along {axes}" in told.message
        assert not {"delay.scale", "delay.axes"} & codes(found)
        assert found.verdict.level is not Level.PASS


def test_stamps_of_validity() -> None:
    run = flown(0.1, stamped="validity")
    found = find_delay(run.log, run.master, C_ms=ALONG)
    assert codes(found) == {"delay.validity"} and found.verdict.level is Level.DOUBTFUL
    ahead = flown(0.1, stamped="validity", offset=-0.3)
    early = find_delay(ahead.log, ahead.master, C_ms=ALONG)
    assert codes(early) == {"delay.negative"}
    assert early.delay.delay == pytest.approx(-0.3, abs=1e-3)


def test_stamp_and_arrival_beside_each_other() -> None:
    run = flown(0.1, stamped="both", offset=0.25, jitter=0.004)
    found = find_delay(run.log, run.master, C_ms=ALONG)
    assert found.delay.delay == pytest.approx(0.25, abs=1e-3)
    assert found.transport is not None
    assert found.transport.mean() == pytest.approx(0.1, abs=2e-3)
    assert found.transport.std() == pytest.approx(0.004, rel=0.2)


def test_clocks_that_drift() -> None:
    run = flown(0.1, stamped="validity", drift=300e-6, offset=0.1)
    found = find_delay(run.log, run.master, C_ms=ALONG)
    one = found.delay
    assert "delay.drift" in codes(found)
    assert one.drift == pytest.approx(300e-6, abs=4 * one.drift_sd)
    at = 0.1 + 300e-6 * one.middle
    assert one.delay == pytest.approx(at, abs=1e-3)


def test_a_delay_that_jumps() -> None:
    run = flown(0.05)
    late = np.where(run.master.time > 12, 0.02, 0.0) * (run.master.time < 30)
    found = find_delay(run.log, replace(run.master, time=run.master.time + late), C_ms=ALONG)
    assert "delay.wanders" in codes(found) and found.verdict.level is Level.DOUBTFUL


def test_a_heading_averaged_across_its_wrap() -> None:
    run = flown()
    H, P, R = run.master.angles.T.copy()
    H[[90, 200]] = [180 * DEG, 10 * DEG]
    found = find_delay(run.log, replace(run.master, C_nb=matrix_of(H, P, R)), C_ms=ALONG)
    assert "delay.wild" in codes(found)
    assert found.delay.wild.sum() == 4
    assert found.delay.delay == pytest.approx(run.delay, abs=1e-3)


def test_messages_that_are_lost_or_come_twice() -> None:
    run = flown(lost=0.1, repeated=0.1)
    found = find_delay(run.log, run.master, C_ms=ALONG)
    # A copy comes later, and is left out.
    assert found.delay.delay == pytest.approx(0.08, abs=1e-3)
    assert {"master.repeated", "master.gaps"} <= codes(found)
    assert found.verdict.level is Level.PASS


@pytest.mark.thorough
def test_a_delay_outside_its_bracket() -> None:
    run = flown(0.19)
    found = find_delay(run.log, run.master, C_ms=ALONG, bracket=(-0.1, 0.1))
    assert found.verdict.level is Level.UNUSABLE
    assert "delay.edge" in codes(found)
    late = replace(run.master, time=run.master.time + 4.0)
    far = find_delay(run.log, late, C_ms=ALONG)
    (told,) = (f for f in far.findings if f.code == "delay.edge")
    assert "4190.00 ms fits best" in told.message


def test_clocks_that_are_far_apart() -> None:
    run = flown()
    late = replace(run.master, time=run.master.time + 7.3)
    with refuses("delay.apart") as problem:
        find_delay(run.log, replace(run.master, time=run.master.time + 1e5))
    assert "--bracket any" in problem.value.cure
    for shift in (7.3, 1e5):
        late = replace(run.master, time=run.master.time + shift)
        found = find_delay(run.log, late, C_ms=ALONG, bracket=None)
        assert found.delay.delay == pytest.approx(shift + 0.08, abs=1e-3)
        assert found.verdict.level is Level.PASS


@pytest.mark.thorough
def test_a_straight_run_shows_nothing() -> None:
    run = flown(profile=STRAIGHT)
    found = find_delay(run.log, run.master, C_ms=ALONG)
    assert found.verdict.level is Level.UNUSABLE
    assert codes(found) & {"delay.not_seen", "delay.unlike"}
    assert not found.delay.seen


@pytest.mark.thorough
def test_a_steady_turn_does_not_show_when() -> None:
    """Both turn alike, at one rate: nothing says when."""
    time = np.arange(0, 60, 0.01)
    rng = np.random.default_rng(1)
    gyro = np.array([0.0, 0.0, 0.1]) + 1e-4 * rng.standard_normal((len(time), 3))
    up = np.outer(np.arange(0, 59.9, 0.1), [0.0, 0.0, 0.1])
    master = MasterTable(np.arange(0, 59.9, 0.1), np.zeros_like(up), exp(up))
    found = find_delay(Log(time, gyro, None), master, C_ms=ALONG)
    assert found.verdict.level is Level.UNUSABLE


def test_one_axis_shows_the_delay_but_not_the_mounting() -> None:
    time = np.arange(0, 60, 0.01)
    rng = np.random.default_rng(1)
    rate = 0.3 * np.cos(2 * time) * np.sin(0.3 * time)
    gyro = np.outer(rate, [0.0, 1.0, 0.0]) + 1e-3 * rng.standard_normal((len(time), 3))
    at = np.arange(0.1, 59.0, 0.1)
    angle = np.interp(at - 0.05, time[:-1] + 0.005, np.cumsum(rate)[:-1] * 0.01)
    roll = angle[:, None] * [0.0, 1.0, 0.0] + 1e-5 * rng.standard_normal((len(at), 3))
    found = find_delay(Log(time, gyro, None), MasterTable(at, np.zeros((len(at), 3)), exp(roll)))
    assert found.delay.seen and {"delay.mounting", "delay.earth"} <= codes(found)
    (told,) = (f for f in found.findings if f.code == "delay.mounting")
    assert "(0.00, 1.00, 0.00)" in told.message
    assert found.verdict.level is Level.PASS


def test_motion_that_repeats_itself() -> None:
    time = np.arange(0, 60, 0.01)
    rng = np.random.default_rng(2)
    rate = 0.2 * np.sin(2 * np.pi * time / 0.8)
    gyro = np.outer(rate, [1.0, 0.0, 0.0]) + 3e-2 * rng.standard_normal((len(time), 3))
    at = np.arange(0.1, 59.0, 0.1)
    angle = -0.2 * 0.8 / (2 * np.pi) * np.cos(2 * np.pi * (at - 0.05) / 0.8)
    master = MasterTable(at, np.zeros((len(at), 3)), exp(np.outer(angle, [1.0, 0.0, 0.0])))
    found = find_delay(Log(time, gyro, None), master, C_ms=ALONG)
    assert "delay.rivals" in codes(found) and found.verdict.level is Level.DOUBTFUL


def second(run: TransferSimulation, offset: float, C: np.ndarray, seed: int = 8) -> Log:
    """Return the log of another IMU on the same body, its clock ahead, without accelerometers."""
    motion, rate = run.motion, 50.0
    time = np.arange(0.3, 40.0, 1 / rate)
    dtheta, _ = motion.increments(time)
    noise = NOISE.gyro.white * np.sqrt(rate)
    drawn = noise * np.random.default_rng(seed).standard_normal(dtheta.shape)
    return Log(time[1:] + offset, dtheta @ C * rate + drawn, None, "increment")


def test_two_imus() -> None:
    run = flown()
    C = matrix_of(-90 * DEG, 5 * DEG, 0.0)
    found = find_delay(run.log, second(run, 0.35, C))
    assert found.delay.delay == pytest.approx(0.35, abs=4 * found.delay.delay_sd)
    assert found.delay.delay_sd < 1e-3
    assert np.allclose(found.delay.C_ms, C.T @ exp(np.array(run.slave.mu)), atol=3 * ARCMIN)
    assert not found.messages and codes(found) == set()
    zero = find_delay(run.log, second(run, 0.0, C))
    assert codes(zero) == set(), "two IMUs may well have one clock"


def test_two_imus_of_which_one_is_mirrored() -> None:
    run = flown()
    wrong = second(run, 0.1, np.diag([1.0, -1.0, 1.0]))
    assert "delay.mirror" in codes(find_delay(run.log, wrong))


def test_a_wrong_unit() -> None:
    run = flown()
    log = replace(run.log, gyro=np.degrees(run.log.gyro))
    found = find_delay(log, run.master, C_ms=ALONG)
    assert "the unit is deg/s and was declared as rad/s" in next(
        f.message for f in found.findings if f.code == "delay.scale"
    )
    assert found.verdict.level is not Level.PASS


def test_gaps_in_both_logs_are_gone_around() -> None:
    run = flown(0.08)
    keep = np.ones(len(run.log), bool)
    keep[1000:1130] = False
    log = Log(run.log.time[keep], run.log.gyro[keep], run.log.accel[keep], "increment")
    found = find_delay(log, run.master, C_ms=ALONG)
    assert found.delay.delay == pytest.approx(run.delay, abs=1e-3)
    assert "strapdown.bridged" in codes(found)
    other = second(run, 0.2, np.eye(3))
    some = np.r_[0:600, 700:1900]
    other = Log(other.time[some], other.gyro[some], None, "increment")
    found = find_delay(run.log, other, C_ms=ALONG)
    assert found.delay.delay == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_one_sample_in_ten_that_is_lost_hides_nothing(seed: int) -> None:
    run = flown(0.08)
    keep = np.random.default_rng(seed).random(len(run.log)) > 0.1
    log = Log(run.log.time[keep], run.log.gyro[keep], run.log.accel[keep], "increment")
    found = find_delay(log, run.master).delay
    assert found.seen and found.delay_sd < 2e-5
    assert abs(found.delay - run.delay) < 4 * found.delay_sd


def test_a_log_without_gyros() -> None:
    run = flown()
    with pytest.raises(FoucaultError, match="no gyros"):
        find_delay(replace(run.log, gyro=None), run.master)


@pytest.mark.thorough
@pytest.mark.parametrize(("drift", "rate"), [(0.0, 100.0), (-4e-5, 100.0), (4e-5, 171.0)])
def test_two_logs_of_gyros_that_sample_as_often(drift: float, rate: float) -> None:
    """Noise between two samples is smaller than at one: it must not draw the delay there.

    Weighted by slopes of the slave's own, the error is 14, 37 and 4 deviations, rms.
    """
    z, drifts = [], []
    for seed in range(8):
        found = find_delay(*two_gyros(seed, drift, rate)).delay
        z.append((found.delay - 0.0374 - drift * found.middle) / found.delay_sd)
        drifts.append((found.drift - drift) / found.drift_sd)
    low, high = chi_square_limits(len(z), tests=6)
    assert low < np.sum(np.square(z)) < high
    assert np.sum(np.square(drifts)) < high


@pytest.mark.parametrize("noise", [1e-6, 0.003])
def test_a_drift_is_followed_before_anything_is_weighed(noise: float) -> None:
    """What drifts is like the motion itself: as noise it would take all weight from that."""
    found = find_delay(*two_gyros(3, 4e-5, noise=noise)).delay
    assert found.drift == pytest.approx(4e-5, abs=max(4 * found.drift_sd, 1e-8))
    assert found.drift_sd < 1e-7 + 1e-3 * noise
    assert found.delay == pytest.approx(0.0374 + 4e-5 * found.middle, abs=4 * found.delay_sd + 1e-7)
