"""The command preflight: what it foretells comes true, what it prints, and how it ends."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import procedures, units
from foucault.campaign import optimisation, parse, simulate, template
from foucault.campaign.running import with_nothing_else
from foucault.errors import FoucaultError
from foucault.models.cluster import CONSTANTS, LAYOUT
from foucault.models.noise import ImuNoise
from foucault.plans.limit import Limit, said
from foucault.procedures import platform_tumble
from foucault.procedures.platform_tumble import NOISE, foresight
from foucault.procedures.platform_tumble.foresight import planned
from foucault.procedures.platform_tumble.settings import draw_printed
from foucault.procedures.record import Beforehand
from foucault.result import Level
from make_cluster import DEG_H, UG
from make_tumble import SLOW, calibrate, campaign_of, tumble
from refusals import refuses

EXAMPLE = Path(__file__).parents[2] / "examples/platform_tumble.toml"
TEMPLATE = "platform_tumble"
CONSTANT = slice(0, len(CONSTANTS))
WITHIN = 0.03


@cache
def foreseen(procedure="", simulate="", **other):
    return optimisation.foresee(campaign_of(procedure, simulate, **other))


def parts(made):
    """Return what a procedure is told of a campaign."""
    said = (made.settings, made.session, made.site, made.noise, made.prior)
    return dict(zip(("settings", "session", "site", "noise", "prior"), said, strict=True))


@pytest.fixture
def no_more(monkeypatch):
    """Leave out what more would buy: it takes most of the time."""
    monkeypatch.setattr(foresight, "more", lambda *_: ())


# -- what is foretold comes true -------------------------------------------------------------------


@pytest.mark.thorough
def test_a_calibration_has_the_uncertainties_that_were_foretold(monkeypatch, seed=1):
    """The published plan, with errors about the usual ones, another attitude and other noise.

    Outer and inner angle at the end take up azimuth by the tilt there, which drawn errors change.
    """
    printed = replace(platform_tumble.PROCEDURE, draw_errors=lambda _grade, k: draw_printed(k))
    monkeypatch.setattr(platform_tumble, "PROCEDURE", printed)
    made, session = tumble("", seed=seed)
    came = calibrate(made, session.simulation.log, trial=True).coefficients
    found = foreseen()
    assert found.names == came.names == LAYOUT.names
    np.testing.assert_allclose(found.sd[CONSTANT], came.sd[CONSTANT], rtol=WITHIN)
    middle = LAYOUT.index("attitude.middle")
    assert found.sd[middle] == pytest.approx(came.sd[middle], rel=WITHIN)
    np.testing.assert_array_equal(found.prior_sd, came.prior_sd)


SHORT = 'plan = "-x -z -y +z"\nrate = "0.4 deg/s"\nsegment = "400 s"\naverage = "5 s"'
WANDERING = ImuNoise(
    replace(NOISE.accel, random_walk=0.2 * UG / 60), replace(NOISE.gyro, random_walk=DEG_H / 6e3)
)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("procedure", "simulate", "noise"),
    [
        ("", "", NOISE),
        (SHORT, "", WANDERING),
        (SLOW, "", NOISE),
        ('delay_sd = "0.1 s"\nlatitude_sd = "0.01 deg"', 'kind = "increment"', NOISE),
    ],
    ids=["published", "slow noise", "slow", "delay and latitude"],
)
def test_with_the_errors_that_were_thought_usual_all_45_come_true(
    procedure, simulate, noise, no_more
):
    """Uncertain gravity, latitude and slow noise too: every term of a result is foretold."""
    made = campaign_of(procedure, simulate)
    asked = Beforehand(**(parts(made) | {"noise": noise}))
    found = platform_tumble.PROCEDURE.foresee(asked)
    log = platform_tumble.simulate(
        made.session.model_copy(update={"attitude_sd": 0.0}),
        settings=made.settings.model_copy(update={"latitude_sd": 0.0, "delay_sd": 0.0}),
        model=planned(asked).simulation.model, noise=made.noise, site=made.site, seed=11,
    ).log  # fmt: skip
    came = calibrate(made, log, trial=True, noise=noise).coefficients
    assert made.site.gravity_sd > 0
    np.testing.assert_allclose(found.sd, came.sd, rtol=WITHIN)
    if noise is WANDERING:
        assert found.sd[0] > 2 * calibrate(made, log, trial=True).coefficients.sd[0]


def test_noise_and_prior_decide(no_more):
    """Twice the noise of everything is twice the sd, as far as the prior does not hold it."""
    made = campaign_of('latitude_sd = "0 deg"')
    noise = made.noise
    louder = ImuNoise(*(replace(n, white=2 * n.white) for n in (noise.accel, noise.gyro)))
    said = parts(made) | {"site": replace(made.site, gravity_sd=0.0)}
    one, two = (
        platform_tumble.PROCEDURE.foresee(Beforehand(**(said | {"noise": n})))
        for n in (noise, louder)
    )
    free = one.share < 0.01
    assert free.sum() > 25
    np.testing.assert_allclose(two.sd[free], 2 * one.sd[free], rtol=0.02)
    assert (two.sd[CONSTANT] > one.sd[CONSTANT]).all()
    k = CONSTANTS.index("accel.bias.x")
    held = platform_tumble.PROCEDURE.foresee(
        Beforehand(**(said | {"prior": {"accel.bias.x": (30 * UG, 0.01 * UG)}}))
    )
    assert held.sd[k] < 0.01 * UG < 0.05 * UG < one.sd[k]
    assert held.prior_sd[k] == pytest.approx(0.01 * UG)
    assert held.coefficients.values[k] == pytest.approx(30 * UG)
    assert "means in [prior]" in held.linearised_at


# -- a plan that does not show everything ----------------------------------------------------------


@pytest.mark.thorough
def test_turns_about_one_axis_do_not_show_everything():
    found = foreseen('plan = "-x"')
    scale = [f"gyro.torquer_scale.{a}" for a in "xyz"]
    assert {*scale, "gyro.misalignment.yx", "accel.quadratic.x"} <= set(found.hardly)
    assert not {"accel.bias.y", "accel.quadratic.y", "gyro.drift_input.y"} & set(found.hardly)
    assert found.rank < found.states == 45 and not found.complete
    assert len(found.unseen) == found.states - found.rank
    assert all("not seen at all" in words for words in found.unseen)
    assert foreseen().complete and not foreseen().hardly and not foreseen().unseen
    # Its calibration ends as badly as the cure warns.
    made, session = tumble('plan = "-x"', seed=11)
    came = calibrate(made, session.simulation.log, trial=True)
    assert came.verdict.level is not Level.PASS
    assert "tumble.unseen" in [f.code for f in came.findings]


def test_the_rank_grows_leg_by_leg():
    found = foreseen()
    assert [leg.end for leg in found.legs] == [1800, 2700, 4500, 5400]
    ranks = [leg.rank for leg in found.legs]
    assert ranks == sorted(ranks) and ranks[0] < 45 == ranks[1] == found.rank
    assert found.legs[0].alone < 42 < found.legs[-1].alone == 45
    assert np.degrees(found.legs[1].rate[2]) == pytest.approx(-0.1, abs=0.005)
    assert found.duration == 5400 and np.degrees(found.fastest) == pytest.approx(0.1)


def test_an_end_where_the_angles_are_no_measure_is_foretold():
    level = 'attitude = ["0 deg", "0 deg", "0 deg"]'
    steps = '[{ rate = ["0 deg/s", "0.1 deg/s", "0 deg/s"], time = "900 s" }]'
    found = foreseen(f"steps = {steps}", level)
    assert found.singular and "tumble.singular" in [f.code for f in found.findings]
    assert not foreseen().singular


# -- what it is told -------------------------------------------------------------------------------


def test_noise_that_is_not_declared_is_assumed_and_told():
    said = parts(campaign_of(""))
    found = platform_tumble.PROCEDURE.foresee(Beforehand(**(said | {"noise": None})))
    codes = [f.code for f in found.findings]
    assert {"preflight.noise", "tumble.noise"} <= set(codes)
    assert "0.447 ug/sqrt(Hz) was taken" in found.findings[codes.index("preflight.noise")].message
    np.testing.assert_allclose(found.sd, foreseen().sd, rtol=1e-4)
    assert "preflight.noise" not in [f.code for f in foreseen().findings]


def test_a_published_filter_is_not_what_is_foretold():
    found = foreseen('filter = "published"')
    told = next(f for f in found.findings if f.code == "preflight.filter")
    assert "those that the published filter states are smaller" in told.message
    np.testing.assert_array_equal(found.sd, foreseen().sd)
    with pytest.raises(FoucaultError, match="delay is not among the states"):
        optimisation.foresee(campaign_of('filter = "published"\ndelay_sd = "0.1 s"'))


@pytest.mark.thorough
def test_another_plan_takes_the_place_of_the_one_in_the_file(monkeypatch):
    published = foreseen()
    monkeypatch.setattr(foresight, "more", lambda *_: ())
    made = campaign_of('plan = "-x -z"\nrate = "0.2 deg/s"\nsegment = "300 s"')
    assert optimisation.foresee(made).duration == 600
    found = optimisation.foresee(made, {"plan": "published"})
    assert (found.plan, found.duration) == ("published", 5400)
    np.testing.assert_array_equal(found.sd, published.sd)
    listed = campaign_of('steps = [{ rate = ["0.1 deg/s", "0 deg/s", "0 deg/s"], time = "9 min" }]')
    assert optimisation.foresee(listed).duration == 540
    assert optimisation.foresee(listed, {"plan": "published"}).duration == 5400
    faster = optimisation.foresee(made, {"rate": "0.4 deg/s"})
    assert np.degrees(faster.fastest) == pytest.approx(0.4) and faster.duration == 600


@pytest.mark.thorough
@pytest.mark.parametrize("latitude_sd", ["0 deg", "0.02 deg"])
def test_more_is_worth_what_the_longer_plan_shows(latitude_sd):
    """What is not noise is in it: an unknown latitude moves drifts however long it takes."""
    plan = 'plan = "-x -z -y"\nrate = "0.2 deg/s"\nsegment = "900 s"'
    base = f'average = "5 s"\nlatitude_sd = "{latitude_sd}"'
    now = foreseen(f"{base}\n{plan}")
    turned, rested = now.more
    assert turned.what.startswith("five more minutes about")
    axis = turned.what.split()[4]
    rate = [f"{(axis[1] == a) * float(axis[0] + '0.2')} deg/s" for a in "xyz"]
    rates = [[f"{-0.2 * (a == b)} deg/s" for b in "xyz"] for a in "xzy"]
    steps = [{"rate": step, "time": "900 s"} for step in rates]
    for extra, last in ((turned, rate), (rested, ["0 deg/s"] * 3)):
        longer = optimisation.foresee(
            campaign_of(f"{base}\n{plan}"),
            {"steps": [*steps, {"rate": last, "time": "300 s"}], "plan": None, "rate": None,
             "segment": None},
        )  # fmt: skip
        ratio = longer.sd[CONSTANT] / now.sd[CONSTANT]
        assert extra.ratio == pytest.approx(np.exp(np.log(ratio).mean()), rel=1e-6)
        assert extra.best[0][1] == pytest.approx(ratio.min(), rel=1e-6)


def test_more_keeps_the_limits_of_the_rig():
    plan = 'plan = "-x"\nrate = "0.2 deg/s"\nsegment = "600 s"\naverage = "5 s"'
    free, held = foreseen(plan), foreseen(f'{plan}\ntilt_limit = "125 deg"')
    assert len(free.more) == len(held.more) == 2
    locked = foreseen(f'{plan}\ntilt_limit = "100 deg"')
    assert not locked.complete
    assert [e.what for e in locked.more] == [e.what for e in free.more]  # it cannot be done anyway
    needed = {limit.name: limit for limit in held.limits}["tilt from the start"]
    assert np.degrees(needed.needed) == pytest.approx(120.0, abs=0.1)
    assert "-x" not in held.more[0].what


def test_a_cluster_that_stands_still_shows_nothing():
    with refuses("tumble.still"):
        optimisation.foresee(campaign_of('plan = "x"\nrate = "0.001 deg/h"'))


# -- the command -----------------------------------------------------------------------------------


@pytest.mark.thorough
def test_the_words_and_the_table(tmp_path):
    file = tmp_path / "expected.csv"
    result = run("preflight", TEMPLATE, "-o", file, code=0)
    for words in ("gyro.drift_input_spin.x", "deg/h/g^2", "Rank 45 of 45", "Plan: published, 5400",
                  "Remains least known", "known to 0.13 of the prior", "times less certain",
                  "accel.bias.x and accel.quadratic.x (-0.98)", f"Table: {file}"):  # fmt: skip
        assert words in result.output
    assert "Seen by no leg" not in result.output
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == optimisation.HEADINGS
    assert [r["coefficient"] for r in rows] == list(LAYOUT.names)
    bias = rows[LAYOUT.index("accel.bias.x")]
    assert (bias["unit"], bias["prior_sd"]) == ("ug", "100")
    whole = optimisation.foresee(parse(template(TEMPLATE)))  # with what is not estimated
    sd = whole.sd[LAYOUT.index("accel.bias.x")]
    assert sd > 50 * foreseen().sd[LAYOUT.index("accel.bias.x")]
    assert float(bias["sd"]) == pytest.approx(sd / UG, rel=1e-4)
    assert float(bias["of_prior"]) == pytest.approx(float(bias["sd"]) / 100, rel=1e-4)
    assert rows[-1]["prior_sd"] == rows[-1]["of_prior"] == "" and float(rows[-1]["sd"]) > 0


@pytest.mark.thorough
def test_a_bad_plan_ends_with_3_and_names_what_it_does_not_see():
    result = run("preflight", TEMPLATE, "--plan", "-x", code=3)
    warned = next(line for line in result.output.splitlines() if "hardly better" in line)
    for name in foreseen('plan = "-x"').hardly:
        assert name in warned
    assert "Turn through more orientations" in result.output
    assert "Seen by no leg\n+0.9" in result.output


@pytest.mark.thorough
def test_the_list_for_the_operator_and_keys_that_say_something_else(tmp_path, no_more):
    file = tmp_path / "operator.html"
    words = ("preflight", EXAMPLE, "--set", "procedure.rate_limit = 0.05 deg/s", "--steps", file)
    result = run(*words, code=0)
    assert f"List for the operator: {file}" in result.output
    page = file.read_text(encoding="utf-8")
    assert "platform_tumble" in page and page.count('type="checkbox"') == 4
    assert "-0.05°/s" in page and "http" not in page.replace("http-equiv", "")
    assert json.loads(run("--json", *words).output)["list"] == str(file)
    refused = run("preflight", EXAMPLE, "--set", "rate_limit = 0.05 deg/s", code=1)
    assert "names no table" in refused.output and "procedure.rate_limit" in refused.output
    table = run("preflight", EXAMPLE, "--set", "procedure = x", code=1).output
    assert "procedure names a table and no key" in table
    assert "Write its table and a dot before the key, such as procedure.key." in table
    assert "procedure.x" in run("preflight", EXAMPLE, "--set", "procedure.x = 3", code=1).output
    other = run("preflight", EXAMPLE, "--plan", "-x", "--steps", file, code=3)
    assert "Seen by no leg" in other.output
    assert file.read_text(encoding="utf-8").count('type="checkbox"') == 1


def test_the_document():
    found = json.loads(
        run("--json", "preflight", EXAMPLE, "--plan", "-x -z -y +z", "--rate", "0.2 deg/s",
            "--segment", "300 s").output
    )  # fmt: skip
    assert found["procedure"] == TEMPLATE and found["file"] is None
    assert (found["plan"], found["duration"]) == ("-x -z -y +z", 1200)
    assert found["rate_limit"] == pytest.approx(np.radians(0.2)) == pytest.approx(found["fastest"])
    assert (found["rank"], found["states"]) == (45, 45) and len(found["legs"]) == 4
    by_name = {row["name"]: row for row in found["coefficients"]}
    assert list(by_name) == list(LAYOUT.names)
    drift = by_name["gyro.drift.x"]
    assert (drift["unit"], drift["display_unit"]) == ("rad/s", "deg/h")
    assert drift["sd"] == pytest.approx(drift["display_sd"] * DEG_H)
    assert drift["of_prior"] == pytest.approx(drift["sd"] / drift["prior_sd"])
    assert by_name["attitude.outer"]["of_prior"] is None
    assert len(found["remaining"]) == 6 and found["correlated"]
    assert "an attitude (2 deg, 3 deg, 5 deg) from `start`" in found["linearised_at"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["hand_rotated", "--plan", "x"], "procedure.plan is not a key of a campaign file"),
        (["turntable", "--rate", "1 deg/s"], "procedure.rate is not a key of a campaign file"),
        (["turntable", "--plan", "icosahedral"], "There is no plan 'icosahedral' for a table"),
        (["nothing.toml"], "'nothing.toml' does not exist"),
        ([TEMPLATE, "--plan", "x q"], "'q' is neither an axis"),
        ([TEMPLATE, "--plan", "x", "--rate", "0.2"], "procedure.rate: '0.2' has no unit"),
        ([TEMPLATE, "--rate", "0.2 deg/s"], "`rate` has no place where no plan is given"),
        ([TEMPLATE, "--plan", "published", "--segment", "1 s"], "the plan is 'published'"),
        ([EXAMPLE, "--rate", "0.3 deg/s"], "the limit is 0.2 deg/s"),
    ],
)
def test_mistakes_end_with_1_and_one_sentence(words, text):
    result = run("preflight", *words, code=1)
    assert text in result.stderr and result.stderr.count("error:") == 1


@pytest.mark.thorough
def test_limits_are_read_side_by_side(no_more):
    """One unit for a kind, and what only rounding made is nothing."""
    by_rounding = Limit("middle angle", "angle", -2.2e-16, np.radians(70.0))
    assert (said(by_rounding.needed, "angle"), by_rounding.words) == (
        "0 deg", "middle angle 0 deg of 70 deg",
    )  # fmt: skip
    slow, fast = 1.2 * DEG_H, np.radians(0.2)
    assert [said(w, "angular rate") for w in (slow, fast)] == ["0.0003333 deg/s", "0.2 deg/s"]
    output = run("preflight", EXAMPLE).output.partition("Limits of the rig")[2]
    limits = output.partition("Not estimated")[0]
    assert "0.2 deg/s" in limits and "deg/h" not in limits
    assert "-0 " not in output and "e-" not in limits


def test_one_unit_for_a_kind():
    rows = foreseen().rows()
    kinds = {c.name: c.kind for c in foreseen().coefficients.layout.coefficients}
    shown = {(kinds[row["name"]], row["display_unit"]) for row in rows}
    assert len(shown) == len({kind for kind, _ in shown}) == len(set(kinds.values()))
    sd = [row["sd"] for row in rows]
    assert [row["display_unit"] for row in rows] == list(
        units.display_units([kinds[row["name"]] for row in rows], sd)
    )


# -- other procedures ------------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_session_on_a_table_is_foretold_with_limits_and_what_more_would_buy(tmp_path):
    file = tmp_path / "campaign.toml"
    text = (EXAMPLE.parent / "norm_observation.toml").read_text()
    file.write_text(
        text.replace("[procedure]", '[procedure]\nmiddle_range = ["-90 deg", "90 deg"]')
    )
    result = run("preflight", file, code=0)
    assert "Limits of the rig" in result.output and "largest middle angle" in result.output
    assert "one more position" in result.output and "rests of 35 s" in result.output
    assert "rate about x, y, z" not in result.output and "about an axis" not in result.output
    found = json.loads(run("--json", "preflight", file, "--plan", "icosahedron 12").output)
    assert found["plan"] == "icosahedron 12" and found["legs"] == []
    assert {limit["kept"] for limit in found["limits"]} == {True, False}
    assert [f["code"] for f in found["findings"]] == ["preflight.typical"]
    assert run("preflight", file, "--plan", "icosahedron 12").exit_code == 3
    broken = run("preflight", file, "--plan", "icosahedron 12").output
    assert "!!" in broken and "verdict: the rig cannot do it\n  largest middle angle" in broken


def test_a_plan_takes_the_place_of_listed_positions():
    text = (EXAMPLE.parent / "norm_observation.toml").read_text()
    listed = '[["0 deg", "0 deg", "0 deg"]]'
    made = parse(text.replace("[procedure]", f"[procedure]\npositions = {listed}"))
    assert optimisation.foresee(made).plan == "own positions"
    assert optimisation.foresee(made, {"plan": "dodecahedron 20"}).plan == "dodecahedron 20"


def came_of(made):
    """The session that `foucault simulate` makes, and what a calibration makes of it."""
    log = simulate(made).simulation.log
    calibrated = procedures.load(made.procedure).calibrate
    found = calibrated(log, site=made.site, settings=made.settings, sizes=made.sizes)
    return log, found.coefficients


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["hand_rotated", "rate_table"])
def test_a_session_is_foretold_by_the_model_that_its_procedure_states(name):
    """A template declares no noise: that of its class is near what the log will show."""
    made = parse(template(name))
    found, (log, came) = optimisation.foresee(made), came_of(made)
    np.testing.assert_allclose(found.sd, came.sd, rtol=0.1)
    assert found.complete and not found.legs
    assert found.duration == pytest.approx(np.ptp(log.time))
    by_hand = ["preflight.by_hand"] if name == "hand_rotated" else []
    assert [f.code for f in found.findings] == ["preflight.typical", *by_hand]


def test_what_a_session_does_not_show_is_told_with_the_motion_it_lacks():
    """All steps about an axis one way: an asymmetry is not told from a scale factor."""
    made = parse(template("rate_table"))
    one_way = {"rates": ("10 deg/s", "25 deg/s", "50 deg/s"), "axes": ("x up", "y up", "z up")}
    found = optimisation.foresee(replace(made, session=made.session.model_copy(update=one_way)))
    lost = [f"gyro.{what}.{a}" for what in ("scale", "asymmetry") for a in "xyz"]
    assert np.isinf(found.sd[[found.names.index(n) for n in lost]]).all()
    assert found.rank == found.states - 3 == found.states - len(found.unseen)
    assert not found.complete
    told = next(f for f in found.findings if f.code == "preflight.not_shown")
    assert f"The session in [simulate] does not show {', '.join(lost)}; " in told.message
    assert "about x all steps turn the same way" in told.message
    seen = np.isfinite(found.sd)
    np.testing.assert_array_less(found.bound[seen], found.sd[seen] * (1 + 1e-9))


def test_what_is_hardly_separated_is_not_shown_either():
    """Both senses of one speed, but for the Earth's rate: a calibration would refuse it."""
    made = parse(template("rate_table"))
    one = made.session.model_copy(update={"rates": ("40 deg/s", "-40 deg/s")})
    found = optimisation.foresee(replace(made, session=one))
    told = next(f for f in found.findings if f.code == "preflight.not_shown")
    assert "about z all steps have the same speed" in told.message
    assert {"gyro.scale.z", "gyro.cubic.z"} <= set(found.hardly) and not found.complete
    with refuses("rate_table.undetermined"):
        came_of(replace(made, session=one))


def test_the_budget_says_what_to_improve(tmp_path):
    file = tmp_path / "campaign.toml"
    text = template("six_position")
    file.write_text(text.replace("[procedure]\n", '[procedure]\nplacement_sd = "5 arcmin"\n'))
    printed = run("preflight", file).output
    assert "mostly from" in printed and "placement 100 %" in printed
    found = json.loads(run("--json", "preflight", file).output)
    rows = {row["name"]: row for row in found["coefficients"]}
    assert rows["accel.misalignment.yx"]["mostly"] == "placement"
    assert rows["accel.bias.x"]["mostly"] == "accel.quadratic"
    assert "Not estimated" in printed
    file.write_text(with_nothing_else(file.read_text()))
    alone = json.loads(run("--json", "preflight", file).output)
    rows_alone = {row["name"]: row for row in alone["coefficients"]}
    assert rows_alone["accel.bias.x"]["mostly"] == "accelerometer noise"
    assert "left_out" not in alone
    total = np.sum(list(found["budget"].values()), axis=0)
    np.testing.assert_allclose(total, [row["sd"] ** 2 for row in rows.values()], rtol=1e-6)


@pytest.mark.thorough
def test_where_no_likelihood_is_stated_one_session_is_calibrated():
    """What it says is the covariance of the session that `foucault simulate` makes."""
    made = parse(template("hand_rotated_published"))
    found, (log, came) = optimisation.foresee(made), came_of(made)
    np.testing.assert_array_equal(found.sd, came.sd)
    assert found.duration == pytest.approx(np.ptp(log.time))
    assert found.findings[0].code == "preflight.simulated"
    said = "hand_rotated_published states no likelihood that could be foreseen"
    assert said in found.findings[0].message
