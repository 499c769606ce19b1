"""IMUs on one plate: by a simulator of its own, and mistakes that people make."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import make_pose
import make_two
from commands import run
from foucault.estimate import two_imus as engine
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.left_out import ByNoise
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.two_imus import LAYOUT, layout_of
from foucault.procedures import two_imus
from foucault.procedures.two_imus import ImuLogs, Settings
from foucault.result import Level
from foucault.run_folder import load_result
from foucault.tables import Log
from refusals import refuses
from sessions import Case, codes, made
from sessions import errors as found_errors
from sessions import solved as solved_case

SITE = replace(Site.at(np.radians(48.0)), gravity=9.80665, gravity_sd=0.0)
NOISE = ImuNoise(TriadNoise(white=2e-3), TriadNoise(white=1.6e-4))


@cache
def session(seed=1, **how):
    made, truths = make_two.session(seed, **({"duration": 20.0} | how))
    kind = "increment" if how.get("summed") else "rate"
    master, slaves = Log(*made[0]), [Log(*one, kind) for one in made[1:]]
    return ImuLogs.of(slaves[0], master, slaves[1:]), truths


def solved(log, *, noise=None, **settings):
    return two_imus.trial(log, site=SITE, settings=Settings(**settings), noise=noise)


def off(result, truths):
    names = layout_of(len(truths)).names
    true = dict(zip(names, np.concatenate([make_two.values(t) for t in truths]), strict=True))
    c = result.coefficients
    return c.values - np.array([true[n] for n in c.names]), c.cov


@pytest.mark.parametrize("how", [
    {}, {"late": 1.5e-3}, {"slaves": 2}, {"master": (1.6e-4, 2e-3)},
    {"summed": True},  # means of the one beside values of the other
])  # fmt: skip
def test_it_finds_what_another_simulator_put_in(how):
    log, truths = session(3, **how)
    result = solved(log)
    e, cov = off(result, truths)
    low, high = chi_square_limits(len(e), tests=5)
    assert low < e @ np.linalg.solve(cov, e) < high
    assert result.verdict.level is Level.PASS
    assert result.coefficients["second.lever"].sd.max() < 1e-4


@pytest.mark.thorough
@pytest.mark.parametrize(("how", "rms"), [  # 3.3 rad/s about each axis
    ({"duration": 60.0, "vigour": 1.0}, (0.28, 0.025, 2.0, 0.12)),
    ({"duration": 15.0, "vigour": 1.0}, (0.64, 0.055, 3.3, 0.89)),
])  # fmt: skip
def test_errors_are_those_that_are_promised(how, rms):
    """NEES inside two-sided limits over 20 sessions, and the accuracy that was asked for.

    Standard deviations wrong by a factor of 1.2 are found out in 99 %.
    """
    total, found, n = 0.0, [], 20
    for seed in range(n):
        log, truths = session.__wrapped__(seed, **how)
        result = solved(log)
        e, cov = off(result, truths)
        total += e @ np.linalg.solve(cov, e)
        at = {n: k for k, n in enumerate(result.coefficients.names)}
        found.append([np.mean(e[[at[f"second.{what}{a}"] for a in axes]] ** 2) for what, axes in (
            ("rotation.", "xyz"), ("lever.", "xyz"), ("delay", [""]), ("clock", [""]))
        ])  # fmt: skip
    low, high = chi_square_limits(n * len(e), tests=2)
    assert low < total < high
    assert not low < 1.5 * total < high
    size = np.sqrt(np.mean(found, axis=0)) * [60 * np.degrees(1), 1e3, 1e6, 1e6]
    assert (size < 1.1 * np.array(rms)).all()


@pytest.mark.thorough
@pytest.mark.parametrize("slaves", [1, 2])
def test_terms_that_are_not_estimated_are_counted(slaves):
    """They make numbers wrong by far more than is said; counted, by no more than is said."""
    log, truths = session(2, slaves=slaves, rate=100.0)
    first, *others = (make_pose.with_terms(x, t, k) for k, (x, t)
                      in enumerate(zip(log.all[1:], truths, strict=True), 4))  # fmt: skip
    log = replace(log, gyro=first.gyro, accel=first.accel, others=tuple(others))
    bare, told = (two_imus.calibrate(log, site=SITE, sizes=x) for x in (None, ByNoise()))
    nees = []
    for result in (bare, told):
        e, cov = off(result, truths)
        nees.append(float(e @ np.linalg.solve(cov, e)))
    assert told.verdict.level is Level.PASS
    assert {"accel.quadratic", "gyro.cubic"} <= told.diagnostics["budget"].keys()
    total = np.sum(list(told.diagnostics["budget"].values()), axis=0)
    np.testing.assert_allclose(total, told.coefficients.sd**2, rtol=1e-6)
    assert nees[1] < chi_square_limits(len(e), 0.01)[1] < nees[0] / 2


@pytest.mark.thorough
def test_terms_of_the_first_are_counted():
    """As those of the others: it has them too, of the class that its own noise tells."""
    log, truths = session(2, duration=30.0, rate=100.0, vigour=0.6, master=(1.6e-4, 2e-3))
    none = {"M_g": np.zeros((3, 3)), "M_a": np.zeros((3, 3)), "G": np.zeros((3, 3)),
            "b_g": np.zeros(3), "b_a": np.zeros(3)}  # fmt: skip
    one = make_pose.with_terms(log, truths[0], 42)
    first = make_pose.with_terms(log.master, none, 92)
    log = replace(log, gyro=one.gyro, accel=one.accel, master=first)
    result = two_imus.calibrate(log, site=SITE, sizes=ByNoise())
    assert result.verdict.level is Level.PASS
    e, cov = off(result, truths)
    low, high = chi_square_limits(len(e), 0.01)
    assert low < e @ np.linalg.solve(cov, e) < high


def test_any_of_them_may_be_the_first():
    """Where none has errors: those of the first are taken for none."""
    log, _ = session(5, errors=0.0)
    one, other = (solved(x).coefficients for x in (log, ImuLogs.of(log.master, log)))
    C = Rotation.from_rotvec(one["second.rotation"].values)
    lever = -C.apply(one["second.lever"].values)
    sd = one["second.lever"].sd.max()
    assert np.abs(other["second.lever"].values - lever).max() < 0.2 * sd + 1e-5
    back = C * Rotation.from_rotvec(other["second.rotation"].values)
    assert back.magnitude() < 3 * one["second.rotation"].sd.max()
    twice = one.value("second.clock") + other.value("second.clock")
    assert abs(twice) < 0.2 * np.sqrt(one.cov[-1, -1])


def test_derivatives_are_those_of_the_readings():
    """Columns cancel where a motion does not show them: nearly exact would be wrong."""
    log, truths = session(3, late=1.5e-3)
    t = truths[0]
    readings = [engine.Readings.of(one) for one in log.all]
    slave = engine.Slave(
        t["C_cb"], t["lever"], t["tau"], t["kappa"], (t["b_g"], np.eye(3) + t["M_g"]),
        (t["b_a"], np.eye(3) + t["M_a"]), 1.5e-3, t["G"],
    )  # fmt: skip
    problem = engine.problem_of(readings, [slave], {}, [None, None], 0.02, ())
    rng = np.random.default_rng(1)
    spline = np.cumsum(rng.standard_normal((problem.knots, 6)), axis=0) * 0.05
    var = np.array([[1e12, 1e12], [1.0, 1.0]])
    at = engine.normal(problem, [slave], spline, var)
    for k in range(engine.kernels.COLUMNS):
        step = np.zeros(engine.kernels.COLUMNS)
        step[k] = 1e-6
        a, b = (engine.normal(problem, [slave.moved(x * step)], spline, var).left[1]
                for x in (1, -1))  # fmt: skip
        column = -(a - b) / 2e-6
        used = np.isfinite(column) & np.isfinite(at.left[1])
        score = np.sum(column[used] * at.left[1][used])
        assert at.gradient[k] == pytest.approx(
            score, rel=1e-4, abs=1e-4 * np.linalg.norm(column[used])
        )


def of_motion(name):
    """Return logs of a motion that does not show all."""
    rng = np.random.default_rng(4)
    k = np.arange(-2.0, 24.0, 0.31)
    angle = make_interp_spline(k, 0.8 * rng.standard_normal(len(k)), k=5)
    place = make_interp_spline(k, 0.055 * rng.standard_normal((len(k), 3)), k=5)
    still = name == "translation only"

    def attitude(x):
        return make_pose._about(2, (0.0 if still else 1.0) * angle(x))

    def rate(x):
        return np.outer((0.0 if still else 1.0) * angle(x, 1), [0.0, 0.0, 1.0])

    made, truths = make_two.session(4, 20.0, motion=(attitude, rate, None, lambda x: place(x, 2)))
    master, slave = (Log(*one) for one in made)
    return ImuLogs.of(slave, master), truths


def test_what_the_motion_does_not_show_is_said():
    log, truths = of_motion("one axis")
    result = solved(log)
    unseen = result.diagnostics["unseen"]
    assert "second.lever.z" in unseen
    assert "second.lever.x" not in unseen
    assert sum(n.startswith(("gyro.scale", "gyro.misalignment")) for n in unseen) >= 5
    assert result.verdict.level is not Level.PASS
    e, cov = off(result, truths)
    assert np.abs(e / np.sqrt(np.diag(cov))).max() < 5.0
    with refuses("imus.apart"):
        solved(of_motion("translation only")[0])


def test_lost_samples_and_drifting_clocks_are_told():
    log, _ = session(6, duration=60.0, kappa=2.4e-3)
    result = solved(log)
    assert result.coefficients.value("second.clock") == pytest.approx(2.4e-3, abs=1e-6)
    assert "imus.clock" in {f.code for f in result.findings}
    # A hundred samples lost one by one, where the time is only counted.
    kept = np.sort(np.random.default_rng(1).permutation(len(log))[100:])
    t = log.time[: len(kept)]
    spoilt = replace(log, time=t, gyro=log.gyro[kept], accel=log.accel[kept])
    result = solved(spoilt)
    assert result.verdict.level is not Level.PASS
    assert {"imus.stamps", "imus.coloured"} & {f.code for f in result.findings}


@pytest.mark.parametrize("which", ["master", "slave"])
def test_seconds_that_one_of_them_lost_are_not_compared(which):
    """Rates between the ends of a gap were compared as if they had been read, and refused."""
    case = Case("two_imus", {}, {"time": 20.0}, grade="mems")
    simulation = made(case, 4)
    log, lost = simulation.log, lambda x: np.flatnonzero((x.time < x.time[0] + 7) |
                                                         (x.time >= x.time[0] + 13))  # fmt: skip
    if which == "master":
        log = replace(log, master=log.master[lost(log.master)])
    else:
        log = replace(log[lost(log)], master=log.master)
    result = solved_case(case, log)
    e, cov = found_errors(result, simulation, result.coefficients.names)
    assert e @ np.linalg.solve(cov, e) < chi_square_limits(len(e))[1]


def test_noise_is_told_where_one_of_them_is_alone() -> None:
    """What the spline takes was shared evenly among all readings: noise looked 4 % too small.

    Offsets of windows were compared across the gap, and stamps were said to jump.
    """
    case, square, told = Case("two_imus", {}, {"time": 20.0}, grade="mems"), [], set()
    for seed in (20_000, 20_005, 20_006, 20_019):
        log = made(case, seed).log
        since = log.master.time - log.master.time[0]
        result = solved_case(case, replace(log, master=log.master[(since < 6) | (since > 14)]))
        square += [[c.value**2 for c in result.checks if c.name.startswith("noise of")]]
        told |= set(codes(result))
    dof = 3.0 * len(log) * len(square)
    low, high = np.array(chi_square_limits(dof, tests=2)) / dof
    assert (low < np.mean(square, axis=0)).all() and (np.mean(square, axis=0) < high).all()
    assert "imus.stamps" not in told


def slipped(log, k):
    C = Rotation.from_rotvec([0.0, 3e-3, 0.0]).as_matrix()
    return {
        w: np.vstack([x[:k], x[k:] @ C.T]) for w in ("gyro", "accel") for x in (getattr(log, w),)
    }


SOME = {  # from a sample on
    "the biases of the gyros of the second IMU": lambda log, k: {
        "gyro": log.gyro + (np.arange(len(log)) >= k)[:, None] * [1e-3, 0, 0]},
    "how the second IMU is turned": slipped,
    "the offset of the clock of the second IMU": lambda log, k: {
        "time": log.time[:-1], **{w: np.delete(getattr(log, w), k, axis=0)
                                  for w in ("gyro", "accel")}},
}  # fmt: skip


@pytest.mark.parametrize("what", [
    pytest.param(what, marks=[pytest.mark.thorough] * (k > 0)) for k, what in enumerate(SOME)
])  # fmt: skip
def test_what_changes_half_way_is_named_with_its_time(what):
    log, truths = session(3)
    k = len(log) // 2
    result = solved(replace(log, **SOME[what](log, k)))
    (told,) = [f for f in result.findings if f.code == "imus.changed"]
    assert f"by the clock of the first IMU {what}" in told.message
    when = log.time[k] + truths[0]["tau"]
    assert float(told.message.split()[2]) == pytest.approx(when, abs=1.1)
    assert result.verdict.level is Level.DOUBTFUL


def gyros(change):
    return lambda log: replace(log, gyro=log.gyro @ np.array(change, float).T)


def forces(change):
    return lambda log: replace(log, accel=log.accel @ np.array(change, float).T)


CYCLIC = np.roll(np.eye(3), 1, axis=0)
MISTAKES = {
    "left-handed": ("imus.mirror", gyros(np.diag([1, 1, -1]))),
    "gyro cyclic": ("imus.force_axes", gyros(CYCLIC)),
    "accel cyclic": ("imus.force_axes", forces(CYCLIC)),
    "deg": ("imus.gyro_unit", gyros(np.degrees(np.eye(3)))),
    "g": ("imus.accel_unit", forces(np.eye(3) / 9.80665)),
    "gravity": ("imus.force_axes", forces(-np.eye(3))),
    "other plate": ("imus.apart", lambda log: replace(log, master=session(9)[0].master)),
    "short": ("imus.short", lambda log: replace(log, time=1e-3 * log.time)),
    "no master": ("imus.no_master", lambda log: replace(log, master=None)),
    "no gyros": ("imus.no_triad", lambda log: replace(log, gyro=None)),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name):
    code, spoil = MISTAKES[name]
    with refuses(code):
        solved(spoil(session()[0]))


def test_a_swing_tells_no_offset():
    t = np.arange(0.0, 30.0, 0.005)
    rate = 2.0 * np.sin(2 * np.pi * t)[:, None] * [0.3, 0.5, 0.8]
    one = Log(t, rate, np.broadcast_to([0.0, 0.0, 9.80665], rate.shape).copy())
    with refuses("imus.periodic"):
        solved(ImuLogs.of(one, one))


def test_declared_noise_is_judged():
    log, _ = session(3)
    assert solved(log, noise=NOISE).verdict.level is Level.PASS
    much = ImuNoise(TriadNoise(white=4e-3), TriadNoise(white=3.2e-4))
    assert solved(log, noise=much).verdict.level is not Level.PASS


@pytest.mark.thorough
def test_three_on_a_plate_by_the_command_line(tmp_path):
    """What is simulated of three is found jointly: from files that [log] and [master] name."""
    example = (Path(__file__).parents[2] / "examples" / "two_imus.toml").read_text()
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(example.replace('time = "30 s"', 'time = "12 s"\nimus = 3\nbetter = 1'))
    of_session = tmp_path / "s" / "campaign.toml"
    for words in (["simulate", campaign, "-o", tmp_path / "s"],
                  ["calibrate", of_session, "-o", tmp_path / "c"]):  # fmt: skip
        run(*words, "-q", code=0)
    assert 'others = ["third.csv"]' in of_session.read_text()
    found = load_result(tmp_path / "c").coefficients
    assert set(found.names) == set(layout_of(2).names)
    # What both have in common through the first is in the covariance: of equal ones, half of it.
    both = [found.names.index(f"{k}.lever.x") for k in ("second", "third")]
    P = found.cov[np.ix_(both, both)]
    assert P[0, 1] / np.sqrt(P[0, 0] * P[1, 1]) == pytest.approx(0.5, abs=0.1)


def test_names_are_known_once():
    assert len(set(LAYOUT.names)) == len(LAYOUT.names)
    assert set(layout_of(3).names) == set(LAYOUT.names)


REAL = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[3] / "shared" / "data"))
PAIR = REAL / "mpu9150_hand_rotated"


@pytest.mark.thorough
@pytest.mark.skipif(not PAIR.is_dir(), reason=f"real logs are not here: set FOUCAULT_DATA ({PAIR})")
@pytest.mark.parametrize("first", [0, 1])
def test_two_boards_that_lost_samples_are_doubtful_for_their_stamps(first):
    """No column of time, samples lost: offsets leave a line by 0.4 samples, by 2380 ppm drift."""
    pair = []
    for k in (first, 1 - first):
        x = np.loadtxt(PAIR / f"imu{k}.log")
        pair.append(Log(np.arange(len(x)) / 100.0, x[:, 3:], x[:, :3]))
    result = two_imus.calibrate(ImuLogs.of(pair[1], pair[0]), site=Site.at(np.radians(45.0)))
    assert result.verdict.level is Level.DOUBTFUL
    assert any("stamps do not hold" in reason for reason in result.verdict.reasons)
    assert {"imus.stamps", "imus.clock"} <= {f.code for f in result.findings}
    assert result.diagnostics["imus"]["jumps"][0] == pytest.approx(0.4, abs=0.1)
    c = result.coefficients
    assert abs(c.value("second.clock")) == pytest.approx(2.38e-3, abs=5e-5)
    turned = np.degrees(c["second.rotation"].values) * (1 - 2 * first)
    assert turned == pytest.approx([0.0, 91.0, -105.0], abs=1.0)
    assert np.abs(c["second.lever"].values / c["second.lever"].sd).max() < 5.0
    assert c["second.lever"].sd.min() > 1e-3  # nothing of it is to be trusted by millimetres
