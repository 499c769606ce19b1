"""Whether a wrong clock is known: its error of every procedure, against the log stamped anew."""

import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import make_guard
import sessions
from foucault import campaign, load_result, procedures, run_folder
from foucault.cli.app import app
from foucault.logs.checks import timing
from foucault.logs.description import LogDescription
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.layouts import clock_slope
from foucault.models.noise import grade
from foucault.procedures import hand_rotated
from foucault.procedures.merged import merged
from foucault.report import html
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import CLOCKS, Clock, evened, gaps, usual_step

FAST = 1e-3


def calibrated(made, **log):
    made = made.with_keys(log=log) if log else made
    with TemporaryDirectory() as folder:
        return campaign.calibrate(made.write(Path(folder)))


def stamped_fast(made):
    time = made.with_columns(time=made.columns["time"] * (1 + FAST))
    key = next((k for k in made.master if k.startswith("time")), None)
    return replace(time, master={**made.master, key: made.master[key] * (1 + FAST)} if key else {})


def as_increments(made):
    return made if 'kind = "increment"' in made.text else make_guard._as_increments(made)


def worst(made, of=1.0):
    """Farthest shift from the one predicted, and the largest predicted, in standard deviations."""
    right, wrong = calibrated(made), calibrated(stamped_fast(made))
    names, sd = right.coefficients.names, right.coefficients.sd
    shift = wrong.coefficients.values - right.coefficients.values
    said = right.clock.of(names) * FAST / right.clock.sd
    return np.nanmax(np.abs(shift - said) / sd), np.nanmax(np.abs(said) / sd)


@pytest.mark.thorough
@pytest.mark.parametrize("increments", [False, True])
@pytest.mark.parametrize(
    "name", ["hand_rotated", "six_position", "ferraris", "norm_observation", "turntable",
             "rate_table"],
)  # fmt: skip
def test_stamps_that_are_fast_shift_what_the_time_base_says(name, increments):
    made = make_guard.session(name)
    if name == "ferraris":  # what lies askew makes scale factors too uncertain to show it
        exact = dict.fromkeys(("placement_sd", "angle_sd", "level_sd"), "0 arcmin")
        made = make_guard.another(name, **exact)
    if name == "six_position":  # a size that is found from six numbers moves with every edge
        made = made.with_keys(procedure={"placement_sd": "1 arcmin"})
    off, said = worst(as_increments(made) if increments else made)
    assert off < 0.4  # an edge of a rest may move by a sample
    still = (name, increments) in (("six_position", False), ("rate_table", True))
    assert said == 0 if name == "six_position" and not increments else said > (0.5 if still else 10)


@pytest.mark.thorough
def test_a_flight_knows_by_trial_what_its_clock_does():
    # What is left out hides half of it: a slave without such errors shows it all.
    made = make_guard.session("transfer_alignment").with_keys(procedure={"left_out": False})
    off, said = worst(made)
    assert off < 0.1 and said > 10


@pytest.mark.parametrize("increments", [False, True])
@pytest.mark.parametrize("name", ["imu_pose", "two_imus"])
def test_beside_another_body_delays_and_lever_arms_hang_on_the_clock(name, increments):
    """Rates of two IMUs are of one time, those of poses are not: no rule of a single triad says it.

    Each coefficient by itself; the derivative of a rate is smoothed, and shows a part too little.
    """
    case = sessions.Case(name, {}, {"time": 20.0}, grade="mems")
    log = sessions.made(case, 1).log

    def stamped(x, fast):
        x = replace(x, time=log.time[0] + (x.time - log.time[0]) * fast)
        if increments and hasattr(x, "sampled"):
            x = replace(x, sampled="increment", gyro=x.gyro / fast, accel=x.accel / fast)
        return x

    beside = "poses" if name == "imu_pose" else "master"
    logs = (
        replace(stamped(log, fast), **{beside: stamped(getattr(log, beside), fast)})
        for fast in (1.0, 1 + FAST)
    )
    right, wrong = (sessions.solved(case, log, whole=True) for log in logs)
    c, said = right.coefficients, right.clock.of(right.coefficients.names) * FAST / right.clock.sd
    off = (wrong.coefficients.values - c.values - said) / c.sd
    delay = c.names.index("pose.delay" if name == "imu_pose" else "second.delay")
    assert abs(said[delay]) == pytest.approx(FAST * abs(c.values[delay]), rel=0.05)
    assert (np.abs(off) < 0.1 * np.abs(said / c.sd) + 0.15).all()
    assert (np.abs(said / c.sd) > 1).sum() >= 4


def test_a_clock_scales_what_is_compared_with_angles_and_what_is_divided_by_time():
    rng = np.random.default_rng(1)
    vector = ImuModel().coefficients()
    vector = vector.with_values(
        dict(zip(vector.names, 1e-3 * rng.standard_normal(len(vector)), strict=True))
    )
    f, w, e = rng.standard_normal((50, 3)) * 9.8, rng.standard_normal((50, 3)), 1e-6
    accel, gyro = ImuModel.from_coefficients(vector).measure(f, w)
    for turned in (False, True):
        for summed in (False, True):
            slope = clock_slope(vector, turned=turned, summed=summed)
            assert np.array_equal(vector.names, LAYOUT.names)
            other = ImuModel.from_coefficients(replace(vector, values=vector.values + e * slope))
            # What the instrument of that result would say of what the reference would claim.
            a, g = other.measure(f, w / (1 + turned * e))
            said = 1 + summed * e
            assert np.allclose(a, accel / said, atol=1e-10)
            assert np.allclose(g, gyro / said, atol=1e-10)


def small(seed=3, clock=None, fast=0.0):
    site = Site.at(0.8)
    made = hand_rotated.simulate(
        hand_rotated.Session(rests=14, rest_time=2, turn_time=1.5, rate=50),
        model=draw_errors("mems", seed), noise=grade("mems", "grade").noise, site=site, seed=seed,
    )  # fmt: skip
    log = replace(made.log, time=made.log.time * (1 + fast))
    if clock:
        log = replace(log, clock=clock)
    return hand_rotated.calibrate(log, site=site)


def test_a_result_gives_the_sd_in_log_time_and_in_seconds():
    result = small(clock=Clock.of("sensor"))
    scale = result.coefficients.layout.index("gyro.scale.x")
    own, seconds = result.coefficients.sd, result.in_seconds.sd
    assert own[scale] < 2e-4 and abs(seconds[scale] - 0.01) < 2e-4
    cov = result.in_seconds.cov
    y = result.coefficients.layout.index("gyro.scale.y")
    assert cov[scale, y] / (seconds[scale] * seconds[y]) > 0.999  # one cause, common to all gyros
    bias = result.coefficients.layout.index("accel.bias.x")
    assert seconds[bias] == own[bias]
    assert any("time base" in words and "1e+04 ppm" in words
               for words in result.diagnostics["unseen"])  # fmt: skip
    page = html(result)
    assert "sd in seconds" in page and "clock of the log" in page and "time base" in page


def test_a_clock_within_its_sd_is_inside_in_seconds_and_declared_too_small_is_not():
    exact = small()
    for clock, inside in ((Clock.of("sensor"), True), (Clock.of("host", 1e-4), False)):
        wrong = small(clock=clock, fast=1e-3)
        off = wrong.coefficients.values - exact.coefficients.values
        z = np.abs(off / wrong.in_seconds.sd)
        assert (z.max() < 1) == inside


def test_the_folder_keeps_both_and_old_results_load(tmp_path):
    result = small()
    run_folder.save(result, tmp_path / "run")
    again = load_result(tmp_path / "run")
    assert again.clock == result.clock
    assert np.array_equal(again.in_seconds.cov, result.in_seconds.cov)
    import json

    file = tmp_path / "run" / "result.json"
    document = json.loads(file.read_text())
    row = next(r for r in document["coefficients"] if r["name"] == "gyro.scale.x")
    assert row["sd_seconds"] > row["sd"]
    del document["clock"]
    for row in document["coefficients"]:
        del row["sd_seconds"], row["display_sd_seconds"]
    file.write_text(json.dumps(document))
    old = load_result(tmp_path / "run")
    assert old.clock is None and np.array_equal(old.in_seconds.cov, old.coefficients.cov)


LOG = {"file": "log.csv", "gyro": {"unit": "rad/s"}, "accel": {"unit": "g"}}


@pytest.mark.parametrize(
    ("keys", "source", "sd"),
    [
        ({"rate": "100 Hz"}, "sensor", 1e-2),
        ({"time": {"unit": "s"}}, "host", 1e-4),
        ({"time": {"unit": "s"}, "clock": "disciplined"}, "disciplined", 1e-6),
        ({"time": {"unit": "s"}, "clock": "sensor"}, "sensor", 1e-2),
        ({"rate": "100 Hz", "clock": "host", "clock_sd": "20 ppm"}, "host", 2e-5),
        ({"rate": "100 Hz", "clock_sd": "0.5 %"}, "sensor", 5e-3),
    ],
)
def test_the_source_of_the_time_says_how_far_it_is_trusted(keys, source, sd):
    base = LogDescription.model_validate({**LOG, **keys}).time_base
    assert (base.source, base.declared) == (source, "clock_sd" in keys)
    assert base.sd == pytest.approx(sd)


def test_every_source_has_a_size():
    assert CLOCKS == {"sensor": 1e-2, "host": 1e-4, "disciplined": 1e-6}


def hashed(name, result):
    return name, name, replace(result, provenance={"input": {"sha256": name}})


def test_sessions_of_one_kind_of_clock_merge_in_its_time_and_others_in_seconds():
    one, two = small(3), replace(small(3), clock=None)
    both = merged([hashed("a", one), hashed("b", one)])
    without = merged([hashed("a", two), hashed("b", two)])
    assert np.allclose(both.coefficients.cov, without.coefficients.cov, rtol=1e-9)
    assert both.clock.source == "host"
    apart = merged([hashed("a", one), hashed("b", small(3, Clock.of("sensor")))])
    scale = apart.coefficients.layout.index("gyro.scale.x")
    assert apart.clock.source == "several"
    assert apart.coefficients.sd[scale] == pytest.approx(1e-4, rel=0.3)  # the better clock
    assert all(c.passed for c in apart.checks if c.name.startswith("agreement"))


def test_two_loggers_that_differ_by_their_clocks_agree():
    one, other = small(3), small(3, fast=3e-4)
    checks = merged([hashed("a", one), hashed("b", other)]).checks
    assert all(c.passed for c in checks if c.name.startswith("agreement"))
    one, other = replace(one, clock=None), replace(other, clock=None)
    alone = merged([hashed("a", one), hashed("b", other)])
    assert not all(c.passed for c in alone.checks if c.name.startswith("agreement"))


def test_the_command_line_says_which_sd_it_prints(tmp_path):
    from typer.testing import CliRunner

    path = make_guard.session("hand_rotated").write(tmp_path)
    said = CliRunner().invoke(app, ["calibrate", str(path), "-o", str(tmp_path / "run")]).output
    assert (
        "sd in the log's own time; in seconds the crystal of a host or logger adds 100 ppm" in said
    )


def test_increments_over_a_wrong_interval_are_told_by_scales_alike():
    made = make_guard._as_increments(make_guard.another("six_position", grade="navigation"))
    slow = made.with_columns(time=made.columns["time"] * 1.01)
    wrong = calibrated(slow)
    findings = {f.code: f for f in wrong.findings}
    said = findings["log.alike"]
    assert wrong.verdict.level is Level.DOUBTFUL and said.message in " ".join(wrong.verdict.reasons)
    assert re.search(r"scale factors are -(0.9|1.0)\d* %, alike\. Increments divided", said.message)
    assert "Check the rate or the time column of [log]" in said.cure
    assert "log.alike" not in {f.code for f in calibrated(made).findings}


# -- stamps that are rounded, or late ----------------------------------------------------------


def test_the_usual_step_is_that_of_the_samples():
    rng = np.random.default_rng(3)
    true = np.arange(5000) / 104
    kept = np.ones(5000, bool)
    kept[np.r_[700:705, 2500:2501, 3100:3400]] = False
    late = rng.uniform(0, 0.9 / 104, 5000) * (rng.random(5000) < 0.2)
    for time in (true, np.round(true, 3), true + rng.uniform(-0.2, 0.2, 5000) / 104, true + late):
        step = np.diff(time[kept])
        assert abs(usual_step(step) * 104 - 1) < 5e-4
        # One lost row after a stamp that came late is none.
        found = set(np.flatnonzero(gaps(step)).tolist())
        assert {699, 3093} <= found <= {699, 2494, 3093}
    assert np.isnan(usual_step(np.zeros(0)))


@pytest.mark.parametrize("step, usual, wide", [
    ([0.05], 0.05, []), ([0.01, 0.05], 0.03, []), ([0.05, 0.01, 0.01], 0.01, [0]),
    ([0.01, 0.01, 0.05], 0.01, [2]), ([0.01, 0.01, 0.05, 0.01], 0.01, [2]),
])  # fmt: skip
def test_a_log_of_a_few_samples_has_an_interval(step, usual, wide):
    """Of two neither is the usual one: which is a gap is not told."""
    assert usual_step(np.array(step)) == pytest.approx(usual)
    assert np.flatnonzero(gaps(np.array(step))).tolist() == wide


def test_rounded_stamps_of_an_even_clock_are_evened_and_no_others():
    true = 12.3 + np.arange(4000) / 104
    lost = np.delete(true, np.r_[700:705, 2500:2501])
    for time in (true, lost):
        for rounded in (np.round(time, 3), np.floor(time * 1e3) / 1e3):
            off = evened(rounded) - time
            assert np.ptp(off) < 1e-5 and abs(off.mean()) < 6e-4
    rng = np.random.default_rng(3)
    late = true + rng.uniform(0, 5e-3, 4000) * (rng.random(4000) < 0.1)
    drifted = true + 5e-6 * (true - true.mean()) ** 2
    for time in (true, late, np.round(late, 3), np.round(drifted, 3), true[:1], true[:0]):
        assert evened(time) is time


def test_a_late_stamp_is_no_gap_of_a_log():
    time = np.arange(400) / 100
    time[200] += 0.007
    assert timing(time) == ()
    (found,) = timing(np.delete(time, [300, 301]))
    assert found.code == "log.gap" and "2 samples" in found.message


@pytest.mark.parametrize("name, most", [
    ("ferraris", 0.01), ("six_position", 0.01), ("hand_rotated", 0.1), ("rate_table", 1.0),
    pytest.param("two_imus", 0.2, marks=pytest.mark.thorough),
    pytest.param("imu_pose", 0.05, marks=pytest.mark.thorough),
])  # fmt: skip
def test_stamps_rounded_to_milliseconds_shift_nothing(name, most):
    """Of 104 Hz, their median is 4 % off. What a step of a table begins with is rounded all the
    same."""
    head, mark, tail = campaign.template(name).partition("# [optimise]")[0].partition("[simulate]")
    tail, count = re.subn(r'^(# ?)?rate = "[\d.]+ Hz"', 'rate = "104 Hz"', tail, flags=re.M)
    told = campaign.parse(head + mark + tail)
    log = campaign.simulate(told, 1).simulation.log
    solve = procedures.load(name).calibrate
    right, rounded = (
        solve(replace(log, time=time), site=told.site, settings=told.settings, noise=told.noise,
              sizes=told.sizes)
        for time in (log.time, np.round(log.time, 3))
    )  # fmt: skip
    off = (rounded.coefficients.values - right.coefficients.values) / right.coefficients.sd
    assert count == 1 and np.nanmax(np.abs(off)) < most
