"""An IMU beside two antennas: by a simulator of its own, and mistakes that people make."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import make_pose
from foucault import campaign
from foucault.campaign.writing import changed
from foucault.estimate.imu_pose import OF_ANTENNAS
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs import pose
from foucault.logs.pose import PoseDescription
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.pose import PoseTable, Second
from foucault.procedures import imu_pose
from foucault.procedures.imu_pose import PoseLog, Settings
from foucault.result import Level
from foucault.tables import Log
from refusals import refuses

SITE = replace(Site.at(np.radians(48.0)), gravity=9.80665, gravity_sd=0.0)
NOISE = ImuNoise(TriadNoise(white=2e-3), TriadNoise(white=1.6e-4))
BASE = (0.1, 0.79, -0.05)
LENGTH = float(np.linalg.norm(BASE))
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
NEU = NED * [1.0, 1.0, -1.0]


@cache
def session(seed=1, told="position", **how):
    """Return log, poses, truth of fixed carrier phases: 10 Hz and 8 mm."""
    usual = {"duration": 30.0, "vigour": 0.5, "pose_rate": 10.0, "sd": (1e-3, 8e-3)}
    imu, (t, p, _), truth = make_pose.session(seed, base=BASE, **usual | how)
    base = truth["measured"]
    place = {"position": truth["second"], "base": base,
             "direction": base / np.linalg.norm(base, axis=1)[:, None]}[told]  # fmt: skip
    return Log(*imu), PoseTable(t, p, second=Second(place, told)), truth


def solved(log, table, *, prior=None, **settings):
    return imu_pose.trial(
        PoseLog.of(log, table), site=SITE, settings=Settings(**settings), noise=NOISE,
        prior=prior or {},
    )  # fmt: skip


def square(result, truth):
    c = result.coefficients
    true = dict(zip(OF_ANTENNAS, make_pose.values(truth), strict=True))
    e = c.values - np.array([true[n] for n in c.names])
    return float(e @ np.linalg.solve(c.cov, e)), len(e)


@pytest.mark.parametrize("told", [
    "position", *(pytest.param(x, marks=pytest.mark.thorough) for x in ("base", "direction")),
])  # fmt: skip
def test_it_finds_what_another_simulator_put_in(told):
    log, table, truth = session(3, told)
    result = solved(log, table, base_length=LENGTH)
    chi, n = square(result, truth)
    low, high = chi_square_limits(n, tests=3)
    assert low < chi < high
    assert result.verdict.level is Level.PASS
    assert result.coefficients["pose.base"].sd.max() < 4e-3
    assert not [n for n in result.coefficients.names if n.startswith("pose.rotation")]


@pytest.mark.thorough
def test_uncertainties_are_those_of_the_errors_and_not_half_of_it():
    total, n = 0.0, 20
    for seed in range(n):
        log, table, truth = session(30 + seed)
        chi, k = square(solved(log, table), truth)
        total += chi
    low, high = chi_square_limits(n * k)
    assert low < total < high
    assert not low < 1.5 * total < high


@pytest.mark.thorough
def test_a_known_length_holds_the_base_and_what_hangs_on_it():
    """By as much as independent knowledge does; a bound of the rest stays as it was."""
    log, table, _ = session(5)
    free, known = solved(log, table), solved(log, table, base_length=LENGTH, base_length_sd=1e-5)

    def along(result):
        c = result.coefficients
        k = [c.names.index(f"pose.base.{a}") for a in "xyz"]
        e = c.values[k] / np.linalg.norm(c.values[k])
        return float(np.sqrt(e @ c.cov[np.ix_(k, k)] @ e))

    assert along(known) < 2e-5 < 1e-4 < along(free)
    assert (known.coefficients.sd <= 1.001 * free.coefficients.sd).all()


# -- what people do wrong --------------------------------------------------------------------------


def second(table, change):
    return replace(table, second=replace(table.second, place=change(table.second.place)))


def exchanged(log, table):
    return log, replace(table, position=table.second.place, second=Second(table.position))


def lost(x, part=1.0):
    gone = np.random.default_rng(3).uniform(size=len(x) // 20 + 1) < part
    out = x.copy()
    out[np.repeat(gone, 20)[: len(x)]] = np.nan
    return out


DECLARED = {f"pose.base.{a}": (v, 0.02) for a, v in zip("xyz", BASE, strict=True)}
MISTAKES = {
    "exchanged": ("pose.swapped", exchanged, {"prior": DECLARED}),
    "base the other way": (
        "pose.swapped", lambda log, q: (log, second(q, lambda x: -x)),
        {"prior": DECLARED, "told": "base"}),
    "length": ("pose.base_length", lambda log, q: (log, q), {"base_length": LENGTH + 0.03}),
    "no length": ("pose.no_length", lambda log, q: (log, q), {"told": "direction"}),
    "one place": ("pose.base_size", lambda log, q: (log, second(q, lambda x: q.position)), {}),
    "second in mm": ("pose.base_size", lambda log, q: (log, second(q, lambda x: 1e3 * x)), {}),
    "second lost": ("pose.second_few", lambda log, q: (log, second(q, lost)), {}),
    "another world": (
        "pose.base_varies",
        lambda log, q: (log, second(q, lambda x: x + 5 * np.sin(q.time)[:, None])), {}),
    "not turning": (
        "pose.base_turns",
        lambda log, q: (log, second(q, lambda x: q.position + np.eye(3)[1])), {}),
    "a minute apart": ("pose.base_turns", lambda log, q: (log, replace(q, time=q.time + 12.0)), {}),
    "heading anticlockwise": (
        "pose.base_axes", lambda log, q: (log, second(q, lambda x: x * [-1.0, 1.0, 1.0])),
        {"told": "direction", "base_length": LENGTH}),
    "base in north, east, down": (
        "pose.base_axes", lambda log, q: (log, second(q, lambda x: x @ NED)), {"told": "base"}),
    "second in north, east, up": (
        "pose.base_axes", lambda log, q: (log, second(q, lambda x: x @ NEU)), {}),
    "all in north, east, up": (
        "pose.world_mirrored",
        lambda log, q: (log, second(replace(q, position=q.position @ NEU), lambda x: x @ NEU)), {}),
    "gravity": ("pose.world_mirrored", lambda log, q: (replace(log, accel=-log.accel), q), {}),
    "g": ("pose.accel_unit", lambda log, q: (replace(log, accel=log.accel / 9.80665), q), {}),
}  # fmt: skip
SLOW = {"gravity", "second in north, east, up", "heading anticlockwise",
        "base in north, east, down", "not turning", "all in north, east, up", "g", "exchanged",
        "base the other way"}  # fmt: skip


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.thorough] * (name in SLOW)) for name in MISTAKES
])  # fmt: skip
def test_a_mistake_is_named(name):
    code, spoil, how = MISTAKES[name]
    log, table, _ = session(1, how.get("told", "position"))
    with refuses(code):
        solved(*spoil(log, table), **{k: v for k, v in how.items() if k != "told"})


@pytest.mark.thorough
def test_a_world_of_north_east_down_is_no_mistake():
    log, table, _ = session()
    turned = second(replace(table, position=table.position @ NED), lambda x: x @ NED)
    result = solved(log, turned)
    assert result.verdict.level is Level.PASS
    assert "pose.upright" in {f.code for f in result.findings}


@pytest.mark.thorough
@pytest.mark.parametrize("which", ["first", "second"])
def test_an_antenna_lost_half_of_the_time_widens_and_does_no_harm(which):
    log, table, truth = session(6)
    spoilt = second(table, lambda x: lost(x, 0.5))
    if which == "first":
        spoilt = replace(table, position=lost(table.position, 0.5))
    result = solved(log, spoilt)
    chi, n = square(result, truth)
    low, high = chi_square_limits(n, tests=2)
    assert low < chi < high
    whole = solved(log, table).coefficients
    assert (result.coefficients["pose.base"].sd > whole["pose.base"].sd).all()


@pytest.mark.thorough
def test_positions_that_float_are_left_out_and_many_of_them_are_doubtful():
    log, table, truth = session(7)
    rng = np.random.default_rng(4)
    for part, level in ((0.03, Level.PASS), (0.3, Level.DOUBTFUL)):
        off = rng.uniform(size=(len(table), 1)) < part
        noise = 0.3 * off * rng.standard_normal((2, len(table), 3))
        spoilt = second(
            replace(table, position=table.position + noise[0]), lambda x, e=noise[1]: x + e
        )
        result = solved(log, spoilt)
        chi, n = square(result, truth)
        low, high = chi_square_limits(n, tests=2)
        assert low < chi < high
        assert result.verdict.level is level


@pytest.mark.thorough
def test_positions_alone_are_told_mirrored_or_in_another_unit():
    imu, (t, p, _), _ = make_pose.session(1, duration=30.0, vigour=0.5)
    log = Log(*imu)
    for code, change in (("pose.world_mirrored", NEU), ("pose.position_unit", 1e3 * np.eye(3))):
        with refuses(code):
            solved(log, PoseTable(t, p @ change))


# -- files -----------------------------------------------------------------------------------------

N = 100
T = np.arange(N) / 10
ONE = np.column_stack([np.sin(T), np.cos(T), 0.1 * T])
TURN = np.column_stack([np.sin(0.7 * T), np.cos(0.7 * T), 0.0 * T])


def written(tmp_path, titles, *columns):
    np.savetxt(tmp_path / "gnss.csv", np.column_stack(columns), delimiter=",", comments="",
               header=titles, fmt="%.9f")  # fmt: skip


def read(tmp_path, **said):
    return pose.read(PoseDescription.model_validate({"file": "gnss.csv"} | said), tmp_path)


def test_a_second_position_is_read_in_its_unit(tmp_path):
    written(tmp_path, "t,e,n,u,e2,n2,u2", T, ONE, 1e3 * (ONE + TURN))
    table = read(tmp_path, position={"columns": ["e", "n", "u"]},
                 second={"columns": ["e2", "n2", "u2"], "unit": "mm"})  # fmt: skip
    assert table.second.told == "position"
    np.testing.assert_allclose(table.second.base(table.position), TURN, atol=1e-8)


def test_a_base_is_read_and_its_heading(tmp_path):
    written(tmp_path, "t,x,y,z,be,bn,bu,h,p", T, ONE, TURN, np.degrees(0.7 * T) % 360, 0 * T)
    base = read(tmp_path, base={"columns": ["be", "bn", "bu"]}).second
    heading = read(tmp_path, heading={"columns": ["h", "p"]}).second
    assert (base.told, heading.told) == ("base", "direction")
    np.testing.assert_allclose(base.place, heading.place, atol=1e-8)


def test_what_is_written_is_read_again(tmp_path):
    pose.write(PoseTable(T, ONE, second=Second(ONE + TURN)), tmp_path / "gnss.csv")
    table = read(tmp_path)
    np.testing.assert_allclose(table.second.place, ONE + TURN, atol=1e-8)
    assert read(tmp_path, position_only=True).second is None


def test_an_antenna_that_is_lost_leaves_the_other_and_float_is_left_out(tmp_path):
    two, quality = ONE + TURN, np.ones(N)
    two[20:40] = two[19]  # a receiver repeats what it had
    quality[60:70] = 2
    written(tmp_path, "t,x,y,z,x2,y2,z2,Q", T, ONE, two, quality)
    table = read(tmp_path, fixed={"column": "Q"})
    assert len(table) == 90 and np.isnan(table.second.place[:, 0]).sum() == 20
    assert [f.code for f in table.findings] == ["pose.antenna_lost", "pose.float"]
    assert "The second antenna has no position in 20 of 100 rows" in table.findings[0].message


def test_two_ways_of_an_attitude_are_one_too_many(tmp_path):
    names = {"columns": ["x2", "y2", "z2"]}
    for more in ({"base": names}, {"position_only": True},
                 {"attitude": {"columns": ["w", "x", "y", "z"]}}):  # fmt: skip
        with refuses("pose.two_ways"):
            read(tmp_path, second=names, **more)
    written(tmp_path, "t,x,y,z", T, ONE)
    with refuses("pose.second_columns"):
        read(tmp_path, second={})


def test_a_campaign_of_two_antennas_simulates_and_calibrates(tmp_path):
    words = {"simulate": {"time": "20 s", "rate": "100 Hz", "pose_rate": "20 Hz",
                          "position_noise": "2 mm", "base": ["0 m", "80 cm", "0 m"]},
             "procedure": {"base_length": "0.8 m", "second_sd": "2 mm"}}  # fmt: skip
    text = changed(campaign.parse(campaign.template("imu_pose")), words, "antennas")
    path = campaign.save_session(campaign.simulate(campaign.parse(text)), tmp_path)
    result = campaign.calibrate(path)
    np.testing.assert_allclose(result.coefficients["pose.base"].values, [0, 0.8, 0], atol=0.03)
    assert "noise of the second antenna" in {check.name for check in result.checks}
