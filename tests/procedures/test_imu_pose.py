"""An IMU beside poses: by a simulator of its own, mistakes that people make, and real runs."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import make_pose
from foucault import campaign
from foucault.estimate import imu_pose as engine
from foucault.estimate.imu_pose import NAMES
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.imu import Gauge
from foucault.models.left_out import sizes_of
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.pose import READINGS, PoseTable
from foucault.models.rotation import matrix_of
from foucault.procedures import imu_pose
from foucault.procedures.imu_pose import PoseLog, Settings
from foucault.result import Level
from foucault.tables import Log
from refusals import refuses
from sessions import Case, made
from sessions import solved as solved_case

SITE = replace(Site.at(np.radians(48.0)), gravity=9.80665, gravity_sd=0.0)
NOISE = ImuNoise(TriadNoise(white=2e-3), TriadNoise(white=1.6e-4))


@cache
def session(seed=1, **how):
    imu, (t, p, C), truth = make_pose.session(seed, **({"duration": 30.0, "vigour": 0.4} | how))
    return Log(*imu), PoseTable(t, p, make_pose.quaternion(C)), truth


def solved(log, table, *, noise=NOISE, **settings):
    return imu_pose.trial(
        PoseLog.of(log, table), site=SITE, settings=Settings(**settings), noise=noise
    )


def off(result, truth):
    c = result.coefficients
    true = dict(zip(NAMES, make_pose.values(truth), strict=True))
    return c.values - np.array([true[n] for n in c.names]), c.cov


@pytest.mark.thorough
def test_terms_that_are_not_estimated_are_counted():
    """Of their size they make wrong numbers that pass; with it the numbers are what is said."""
    sizes, found = sizes_of("consumer MEMS"), []
    for seed in (0, 7):  # in 7 a cubic term is .07 rad/s, and no small change
        log, table, truth = session(seed, vigour=1.0)
        some = PoseLog.of(make_pose.with_terms(log, truth, seed), table)
        bare, told = (imu_pose.calibrate(some, site=SITE, noise=NOISE, sizes=x)
                      for x in (None, sizes))  # fmt: skip
        found.append([off(result, truth) for result in (bare, told)])
        assert "left_out" in told.tables and told.verdict.level is Level.PASS
        assert {"gyro.g_sensitivity", "earth rate"} <= told.diagnostics["budget"].keys()
        total = np.sum(list(told.diagnostics["budget"].values()), axis=0)
        np.testing.assert_allclose(total, told.coefficients.sd**2, rtol=1e-6)
    wrong, right = (
        sum(float(e @ np.linalg.solve(P, e)) for e, P in one) for one in zip(*found, strict=True)
    )
    low, high = chi_square_limits(sum(len(told[0]) for _, told in found), 0.01)
    assert low < right < high < wrong / 2


@pytest.mark.thorough
def test_terms_that_are_not_found_are_said(monkeypatch):
    """One look is not enough where terms are no small change: what it gives is wrong."""
    log, table, truth = session(7, vigour=1.5)
    monkeypatch.setattr("foucault.procedures.counted.ROUNDS", 1)
    some = PoseLog.of(make_pose.with_terms(log, truth, 7), table)
    told = imu_pose.calibrate(some, site=SITE, noise=NOISE, sizes=sizes_of("consumer MEMS"))
    error, cov = off(told, truth)
    assert error @ np.linalg.solve(cov, error) > chi_square_limits(len(error), 0.01)[1]
    assert told.verdict.level is Level.DOUBTFUL
    assert "too large for so violent a motion" in told.verdict.reasons[0]


@pytest.mark.thorough
def test_the_uncertainty_of_gravity_is_counted():
    """What it moves is what the calibration with another gravity says; the rest stays as it was."""
    log, table, _ = session()
    sd = 0.03
    known = solved(log, table).coefficients
    placed = replace(SITE, gravity_sd=sd)
    unsure = imu_pose.calibrate(PoseLog.of(log, table), site=placed, noise=NOISE)
    heavier = imu_pose.calibrate(
        PoseLog.of(log, table), site=replace(SITE, gravity=SITE.gravity + sd), noise=NOISE
    )
    moved = heavier.coefficients.values - known.values
    stated = unsure.diagnostics["gravity_errors"][0]["error"]
    assert moved / known.sd == pytest.approx(
        [stated[n] / s for n, s in zip(known.names, known.sd, strict=True)], abs=0.05
    )
    assert np.abs(moved / known.sd).max() > 3  # a scale of .3 %, of which .006 % was said
    unit = np.outer(known.sd, known.sd)
    expected = known.cov + np.outer(moved, moved)
    np.testing.assert_allclose(unsure.coefficients.cov / unit, expected / unit, atol=0.3, rtol=0.03)
    total = sum(np.array(v) for v in unsure.diagnostics["budget"].values())
    np.testing.assert_allclose(total, unsure.coefficients.sd**2, rtol=1e-6)


def as_sure_as_stated(result, truth, tests=4, without=()):
    """Tell whether all errors together, but of names that begin so, are those that are stated."""
    e, cov = off(result, truth)
    k = [i for i, n in enumerate(result.coefficients.names) if not n.startswith(tuple(without))]
    low, high = chi_square_limits(len(k), tests=tests)
    return low < e[k] @ np.linalg.solve(cov[np.ix_(k, k)], e[k]) < high


@pytest.mark.parametrize("how", [
    pytest.param({}, marks=pytest.mark.thorough),
    pytest.param({"late": 1.5e-3}, marks=pytest.mark.thorough),
    {"pose_rate": 30.0, "sd": (5e-3, 3e-3)},
])  # fmt: skip
def test_it_finds_what_another_simulator_put_in(how):
    log, table, truth = session(3, **how)
    result = solved(log, table)
    assert as_sure_as_stated(result, truth)
    assert result.verdict.level is Level.PASS
    assert result.coefficients["pose.lever"].sd.max() < (2e-4 if "sd" not in how else 2e-3)


@pytest.mark.thorough
def test_positions_alone_tell_all_but_the_rotation():
    log, table, truth = session(4)
    result = solved(log, replace(table, quaternion=None))
    assert as_sure_as_stated(result, truth)
    assert not [n for n in result.coefficients.names if n.startswith("pose.rotation")]


@pytest.mark.thorough
def test_two_percent_of_outliers_and_lost_seconds_do_no_harm():
    log, table, truth = session(5)
    rng = np.random.default_rng(2)
    wild = rng.uniform(size=len(table)) < 0.02
    position = table.position + 0.05 * wild[:, None] * rng.standard_normal((len(table), 3))
    kept = ~((table.time - table.time[0]) % 7.0 < 1.0)
    spoilt = replace(table, position=position)[kept]
    e, cov = off(solved(log, spoilt), truth)
    low, high = chi_square_limits(len(e), tests=4)
    assert low < e @ np.linalg.solve(cov, e) < high
    all_count = off(solved(log, spoilt, loss="squares", position_sd=5e-4), truth)[0]
    levers = [np.linalg.norm(x[-7:-4]) for x in (e, all_count)]
    assert levers[1] > 2 * levers[0]


@pytest.mark.thorough
@pytest.mark.parametrize(("how", "rms"), [
    ({"duration": 60.0, "vigour": 1.0}, (0.39, 0.046, 10.0)),
    ({"duration": 15.0, "vigour": 1.0}, (0.92, 0.12, 16.0)),
])  # fmt: skip
def test_errors_are_those_that_are_promised(how, rms):
    """NEES inside two-sided limits over 20 sessions, and the accuracy that was asked for.

    Standard deviations wrong by a factor of 1.2 are found out in 99 %. Of all, and of what the
    body is fixed by: rotation, lever arm, offset and level each.
    """
    total, found, n = 0.0, [], 20
    groups = dict.fromkeys(("rotation", "lever", "delay", "level"), 0.0)
    for seed in range(n):
        log, table, truth = session(50 + seed, **how)
        result = solved(log, table)
        e, cov = off(result, truth)
        total += e @ np.linalg.solve(cov, e)
        for name in groups:
            k = np.arange(len(e))[result.coefficients.layout.group(f"pose.{name}")]
            groups[name] += e[k] @ np.linalg.solve(cov[np.ix_(k, k)], e[k])
        at = {n: k for k, n in enumerate(result.coefficients.names)}
        found.append([*(e[[at[f"pose.{what}.{a}"] for a in "xyz"]] for what in
                        ("rotation", "lever")), np.repeat(e[at["pose.delay"]], 3)])  # fmt: skip
    low, high = chi_square_limits(n * len(e), tests=2)
    assert low < total < high
    assert not low < 1.5 * total < high
    for name, of_group in groups.items():
        low, high = chi_square_limits(n * {"delay": 1, "level": 2}.get(name, 3), tests=8)
        assert low < of_group < high, name
    size = np.sqrt(np.mean(np.square(found), axis=(0, 2))) * [60 * np.degrees(1), 1e3, 1e6]
    assert (size < 1.1 * np.array(rms)).all()


def of_motion(motion, seed, time=20.0):
    """Return the result of a session that the program simulates, errors, and what is not seen."""
    from sessions import Case, made
    from sessions import solved as calibrated

    case = Case("imu_pose", {}, {"time": time, "motion": motion}, grade="mems")
    session = made(case, seed)
    result = calibrated(case, session.log)
    c = result.coefficients
    imu = session.model.in_gauge(Gauge.LOWER)[0]
    own = imu.coefficients([n for n in c.names if n.startswith(("gyro.", "accel.")) and n != LATE])
    truth = dict(zip(own.names, own.values, strict=True)) | {LATE: 0.0}
    truth |= dict(zip(session.beside.names, session.beside.values, strict=True))
    return result, c.values - np.array([truth[n] for n in c.names])


LATE = "accel.delay"
NOT_SEEN = {
    # Turned about the accelerometers themselves, the angle about the axis is not seen either.
    "one axis": {"pose.lever.x", "pose.lever.y", "pose.lever.z", "pose.rotation.z"},
    "planar": {"pose.lever.z", "gyro.scale.x", "gyro.misalignment.xz"},
}


@pytest.mark.thorough
@pytest.mark.parametrize("motion", NOT_SEEN)
def test_what_the_motion_does_not_show_is_said_and_the_rest_is_honest(motion):
    """Noise that looks like information would make both of it wrong by thousands of sd."""
    sure, seen, n = 0.0, 0.0, 3
    for seed in range(n):
        result, e = of_motion(motion, seed)
        c, unseen = result.coefficients, result.diagnostics["unseen"]
        assert set(unseen) >= NOT_SEEN[motion]
        assert result.verdict.level is not Level.PASS
        assert np.abs(e / c.sd).max() < 5.0
        k = [i for i, name in enumerate(c.names) if name not in unseen]
        seen += e[k] @ np.linalg.solve(c.cov[np.ix_(k, k)], e[k]) / len(k)
        # What a prior has no part in.
        k = [i for i, name in enumerate(c.names) if name.startswith(SURELY)]
        sure += e[k] @ np.linalg.solve(c.cov[np.ix_(k, k)], e[k])
    low, high = chi_square_limits(n * len(k), tests=4)
    assert low < sure < high
    assert seen / n < chi_square_limits(n * 11, tests=4)[1] / (n * 11)


SURELY = ("gyro.bias", "pose.delay", "pose.clock", "pose.level")


def test_preflight_says_the_motion_to_make():
    from sessions import Case

    case = Case("imu_pose", {}, {"time": 20.0, "motion": "one axis"}, grade="mems")
    told = case.record.foreseen(case.beforehand).findings[0]
    assert "turn about at least two axes, with starts and stops" in told.message


# -- what people do wrong --------------------------------------------------------------------------


@pytest.mark.parametrize("reading", [
    pytest.param(reading, marks=[pytest.mark.thorough] * (k > 0))
    for k, reading in enumerate(READINGS)
])  # fmt: skip
def test_order_and_direction_of_a_quaternion_are_told_by_the_data(reading):
    log, table, truth = session()
    order, sign = READINGS[reading]
    numbers = np.empty_like(table.quaternion)
    numbers[:, order] = table.quaternion * [1.0, sign, sign, sign]
    result = solved(log, replace(table, quaternion=numbers))
    assert result.diagnostics["pose"]["reading"] == reading
    assert as_sure_as_stated(result, truth)


@pytest.mark.thorough
def test_a_world_whose_y_axis_is_up_is_no_error():
    log, table, truth = session()
    C = Rotation.from_euler("x", -90, degrees=True)
    q = (C * Rotation.from_quat(table.quaternion[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
    result = solved(log, replace(table, position=C.apply(table.position), quaternion=q))
    assert result.verdict.level is Level.PASS
    level = np.linalg.norm(result.coefficients["pose.level"].values)
    assert np.degrees(level) == pytest.approx(90.0, abs=5.0)
    assert "pose.upright" in {f.code for f in result.findings}
    assert as_sure_as_stated(result, truth, without=["pose.level"])


def gyros(change):
    return lambda log, q: (replace(log, gyro=log.gyro @ np.array(change, float).T), q)


def forces(change):
    return lambda log, q: (replace(log, accel=log.accel @ np.array(change, float).T), q)


CYCLIC = np.roll(np.eye(3), 1, axis=0)
MISTAKES = {
    "left-handed": ("pose.mirror", gyros(np.diag([1, 1, -1]))),
    "gyro cyclic": ("pose.force_axes", gyros(CYCLIC)),
    "accel cyclic": ("pose.force_axes", forces(CYCLIC)),
    "deg": ("pose.gyro_unit", gyros(np.degrees(np.eye(3)))),
    "g": ("pose.accel_unit", forces(np.eye(3) / 9.80665)),
    "gravity": ("pose.position_unit", forces(-np.eye(3))),
    "mm": ("pose.position_unit", lambda log, q: (log, replace(q, position=1e3 * q.position))),
    "apart": ("pose.two_times", lambda log, q: (
        log, replace(q[:-24], quaternion=q.quaternion[24:]))),
    "other body": ("pose.apart", lambda log, q: (log, session(9)[1])),
    "few": ("pose.few", lambda log, q: (log, q[:40])),
    "ms": ("pose.short", lambda log, q: (log, replace(q, time=1e-3 * q.time))),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name):
    code, spoil = MISTAKES[name]
    log, table, _ = session()
    with refuses(code):
        solved(*spoil(log, table))


SOME = {  # from a pose of the body, and from the sample of its IMU, on; turned about the vertical
    "the biases of the gyros": lambda log, p, C, k, n, up: log.gyro[n:].__iadd__([1e-2, 0, 0]),
    "the lever arm": lambda log, p, C, k, n, up: p[k:].__iadd__(C[k:] @ [1e-3, 0, 0]),
    "how the tracked body is turned": lambda log, p, C, k, n, up: C[k:].__setitem__(
        ..., C[k:] @ Rotation.from_rotvec([0, 5e-3, 0]).as_matrix()),
    "the world of the poses": lambda log, p, C, k, n, up: (
        C[k:].__setitem__(..., up.as_matrix() @ C[k:]), p[k:].__setitem__(..., up.apply(p[k:]))),
    "the offset of the clocks": lambda log, p, C, k, n, up: log.time[n:].__iadd__(0.02),
}  # fmt: skip


def changed(what, seed=1):
    """Return a log and poses in which something changes in the middle, and when [s]."""
    imu, (t, p, C), truth = make_pose.session(seed, duration=30.0)
    log, k = Log(*imu), len(t) // 2
    up = Rotation.from_rotvec([*truth["level"], 0]) * Rotation.from_rotvec([0, 0, 0.02])
    up = up * Rotation.from_rotvec([*truth["level"], 0]).inv()
    SOME[what](log, p, C, k, np.searchsorted(log.time, t[k] + truth["tau"]), up)
    return log, PoseTable(t, p, make_pose.quaternion(C)), t[k]


@pytest.mark.parametrize("what", [
    pytest.param(what, marks=[pytest.mark.thorough] * (k > 0)) for k, what in enumerate(SOME)
])  # fmt: skip
def test_what_changes_half_way_is_named_with_its_time(what):
    log, table, middle = changed(what)
    result = solved(log, table)
    (told,) = [f for f in result.findings if f.code == "pose.changed"]
    assert f"by the clock of the poses {what}" in told.message
    assert float(told.message.split()[2]) == pytest.approx(middle, abs=1.1)
    assert result.verdict.level is Level.DOUBTFUL


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [502, 512])
def test_stamps_that_jump_by_an_eighth_of_an_interval_are_named(seed):
    """The step within the interval of the jump scatters besides: less than half is the delay's."""
    case = Case("imu_pose", {}, {"time": 20.0}, grade="mems")
    log = made(case, seed).log
    time = log.time + np.where(np.arange(len(log.time)) < len(log.time) // 2, 0.0, 1.3717e-3)
    result = solved_case(case, replace(log, time=time), whole=True)
    (told,) = [f for f in result.findings if f.code == "pose.changed"]
    assert "the offset of the clocks (stamps jumped)" in told.message
    assert result.verdict.level is Level.DOUBTFUL


@pytest.mark.parametrize("seed", [68, pytest.param(214, marks=pytest.mark.thorough)])
def test_lost_poses_are_no_rates_of_nothing(seed):
    """Seconds without a pose were taken for rest: one session in ten was of another body."""
    case = Case("imu_pose", {}, {"time": 30.0, "outliers": 0.02, "lost": 0.1}, grade="mems")
    assert solved_case(case, made(case, seed).log).verdict.level is Level.PASS


@pytest.mark.thorough
def test_a_world_that_turns_costs_what_poses_apart_gain():
    """The score of a jump of the motion is what the fit is better by where nothing leads over."""
    log, table, middle = changed("the world of the poses")
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "changes", lambda s, of=engine.changes: found.append(s) or of(s))
        solved(log, table)
    (s,) = found
    jump = engine.changes(s)["motion"]
    assert jump.time == pytest.approx(middle, abs=0.02)
    later = s.readings.stamp >= jump.time
    apart = replace(s.readings, jumped=s.readings.jumped + later)
    costs = [np.sum(engine.one_pass(r, s.point, s.noise, s.hold).nu ** 2)
             for r in (s.readings, apart)]  # fmt: skip
    assert jump.shock.square == pytest.approx(costs[0] - costs[1], rel=1e-3)


@pytest.mark.thorough
def test_positions_of_another_scale_are_named_and_do_no_harm():
    log, table, truth = session(2, vigour=1.0)
    wide = replace(table, position=1.01 * table.position)
    bare = solved(log, wide)
    assert "pose.scale" in {f.code for f in bare.findings}
    sizes = sizes_of("consumer MEMS")
    told = imu_pose.calibrate(PoseLog.of(log, wide), site=SITE, noise=NOISE, sizes=sizes)
    assert {c.name for c in told.checks if not c.passed} == {"size of pose scale"}
    (wrong, P), (right, Q) = off(bare, truth), off(told, truth)
    high = chi_square_limits(len(right), tests=2)[1]
    assert right @ np.linalg.solve(Q, right) < high < wrong @ np.linalg.solve(P, wrong) / 2
    known = imu_pose.calibrate(
        PoseLog.of(log, table), site=SITE, noise=NOISE, sizes=sizes, settings=Settings(scale_sd=0)
    )
    small = replace(table, position=1.0005 * table.position)
    free = imu_pose.calibrate(PoseLog.of(log, small), site=SITE, noise=NOISE, sizes=sizes)
    assert known.verdict.level is free.verdict.level is Level.PASS
    assert (np.abs(free.coefficients.values - known.coefficients.values)
            < 3 * free.coefficients.sd).all()  # fmt: skip
    assert (free.coefficients.sd > 0.99 * known.coefficients.sd).all()


def test_a_swing_tells_no_offset():
    t = np.arange(0.0, 30.0, 0.005)
    rate = 2.0 * np.sin(2 * np.pi * t)[:, None] * [0.3, 0.5, 0.8]
    angle = -np.cos(2 * np.pi * t)[:, None] / np.pi * [0.3, 0.5, 0.8]
    C = Rotation.from_rotvec(angle)
    log = Log(t, rate, C.inv().apply([0.0, 0.0, 9.80665]))
    q = PoseTable(t[::2], np.zeros((len(t[::2]), 3)), C[::2].as_quat()[:, [3, 0, 1, 2]])
    with refuses("pose.periodic"):
        solved(log, q)


def test_a_log_needs_poses_and_both_triads():
    log, table, _ = session()
    with refuses("pose.no_table"):
        imu_pose.calibrate(log, site=SITE)
    with refuses("pose.no_triad"):
        solved(replace(log, accel=None), table)


def coloured(seed, rho):
    """Return a session whose poses have noise like the last one's, with the same size as ever."""
    log, table, truth = session(200 + seed, sd=(2e-4, 1e-4))
    rng = np.random.default_rng(seed)

    def slow(sd):
        white = rng.standard_normal((len(table) + 500, 3))
        return sd * np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], white, axis=0)[500:]

    C = Rotation.from_quat(table.quaternion[:, [1, 2, 3, 0]]) * Rotation.from_rotvec(slow(1.7e-3))
    position, q = table.position + slow(5e-4), C.as_quat()[:, [3, 0, 1, 2]]
    return log, replace(table, position=position, quaternion=q), truth


@pytest.mark.thorough
def test_coloured_noise_widens_what_is_stated():
    total, n = 0.0, 10
    for seed in range(n):
        log, table, truth = coloured(seed, 0.9)
        result = solved(log, table)
        assert min(result.diagnostics["pose"]["lag_one"]) > 0.7
        e, cov = off(result, truth)
        assert result.diagnostics["pose"]["colour"] < 1.4  # rows are white
        total += e @ np.linalg.solve(cov, e)
    low, high = chi_square_limits(n * len(e), tests=2)
    assert low < total < high
    assert not low < 2.0 * total < high


# -- real runs -------------------------------------------------------------------------------------

REAL = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[3] / "shared" / "data"))
HAND, VEHICLE = REAL / "broad_hand_motion", REAL / "fog_mems_transfer"
THERE = pytest.mark.skipif(
    not HAND.is_dir(), reason=f"real logs are not here: set FOUCAULT_DATA ({HAND})"
)


@cache
def broad(run):
    """The calibration of a run by hand."""
    from pyarrow import parquet

    a, b = (np.column_stack(parquet.read_table(HAND / f"{run}_{what}.parquet").columns)
            for what in ("imu", "pose"))  # fmt: skip
    return solved(Log(a[:, 0], a[:, 1:4], a[:, 4:7]), PoseTable(b[:, 0], b[:, 5:8], b[:, 1:5]))


@THERE
@pytest.mark.thorough
def test_five_runs_of_one_mounting_agree():
    runs = [broad(run) for run in ("32", "33", "34", "35", "36")]
    found = [run.coefficients for run in runs]
    lever = 1e3 * np.array([c["pose.lever"].values for c in found])
    late = 1e3 * np.array([c.value(LATE) for c in found])
    # 0.1 mm is asked for and 0.09, 0.11, 0.14 are found: as much as is stated, by chi-square.
    sd = 1e3 * np.array([c["pose.lever"].sd for c in found])
    # What passes is as sure as was asked for; halves that differ widen a run, and it is doubtful.
    passed = np.array([run.verdict.level == "pass" for run in runs])
    assert passed.sum() >= 3 and sd[passed].max() < 0.2
    assert max(run.diagnostics["pose"]["halves"] for run in runs) < 1.5
    low, high = chi_square_limits(12)
    assert low < np.sum(((lever - lever.mean(axis=0)) / sd) ** 2) < high
    assert np.abs(lever.mean(axis=0) - [1.9, -0.6, -7.4]).max() < 0.15
    assert late.mean() == pytest.approx(-1.45, abs=0.1)


@THERE
@pytest.mark.thorough
def test_the_delay_of_accelerometers_is_the_same_in_all_runs():
    runs = ("03", "05", "07", "09", "21", "32", "33", "34", "35", "36")
    late = [1e3 * broad(run).coefficients.value(LATE) for run in runs]
    assert np.std(late, ddof=1) < 0.1


@pytest.mark.thorough
@pytest.mark.skipif(not VEHICLE.is_dir(), reason=f"real logs are not here: {VEHICLE}")
def test_an_imu_beside_another_solution_on_a_vehicle():
    """Delay by rate matching, drift by heading closure: 15.5 ms and 75.4 deg/h."""
    from scipy.io import loadmat

    told = loadmat(VEHICLE / "transfer_align_fog_mems.mat")
    imu, (pitch, roll, yaw, _, _, _, lat, lon, h, t) = told["mimu"], told["fogavp"].T
    place = 6.378e6 * np.column_stack([(lon - lon[0]) * np.cos(lat[0]), lat - lat[0]])
    C = matrix_of(-yaw, pitch, roll)
    table = PoseTable(t, np.column_stack([place, h - h[0]]), make_pose.quaternion(C))
    log = Log(imu[:, 6], 100 * imu[:, :3], 100 * imu[:, 3:6], sampled="increment")
    site = Site.at(lat[0])
    c = imu_pose.calibrate(PoseLog.of(log, table), site=site).coefficients
    assert 1e3 * c.value("pose.delay") == pytest.approx(-15.5, abs=0.5)
    vertical = np.degrees(7.292e-5) * 3600 * np.sin(lat[0])
    drift = np.degrees(c["gyro.bias"].values) * 3600 - [0, 0, vertical]
    assert drift == pytest.approx([-214.0, 170.0, 75.4], abs=4.0)


@pytest.mark.parametrize(("rate", "code"), [("1e-20", "program.few"), ("1e15", "program.samples")])
def test_a_rate_that_no_tracking_system_has_is_refused(rate, code):
    given = campaign.template("imu_pose")
    text = given.replace('pose_rate = "100 Hz"', f'pose_rate = "{rate} Hz"')
    assert text != given
    with refuses(code):
        campaign.simulate(campaign.parse(text))
