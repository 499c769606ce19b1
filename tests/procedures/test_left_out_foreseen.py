"""What is not estimated: before a session, in a simulated instrument, and where nobody says."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import stdtrit

from foucault import procedures
from foucault.campaign import calibrate, load, parse, save_session, simulate, study, template
from foucault.campaign.running import with_nothing_else
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.mixed import DRAWS
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import ByNoise, grade_of, sizes_of, told
from foucault.models.noise import grade
from foucault.procedures import ferraris, hand_rotated, rate_table, silent, six_position
from foucault.procedures.record import Beforehand
from refusals import refuses
from sessions import Case, made

SITE = Site.at(np.radians(48.8462), 60.0)
NOISE = grade("mems").noise
SIZES = sizes_of("consumer MEMS")
TILTED = {"placement_sd": np.radians(0.05)}
SENSES = ("20 deg/s", "-20 deg/s", "60 deg/s", "-60 deg/s")
TURNED = {"table_rate_sd": 5e-6, "fixture_sd": np.radians(1 / 60)}
STEPS = {"step_time": 18.0, "rows": "means"}
PLANS = {
    "hand_rotated": (
        hand_rotated.Settings(), hand_rotated.Session(rests=16, rest_time=2.0, turn_time=1.5)
    ),
    "six_position": (six_position.Settings(**TILTED), six_position.Session(rest_time=4.0)),
    "ferraris": (
        ferraris.Settings(**TILTED, angle_sd=np.radians(0.2)),
        ferraris.Session(rest_time=4.0, turn_time=3.0),
    ),
    "rate_table": (rate_table.Settings(**TURNED), rate_table.Session(rates=SENSES, **STEPS)),
}  # fmt: skip


@cache
def foreseen(name, sizes=True, **session):
    settings, planned = PLANS[name]
    asked = Beforehand(
        settings,
        planned.model_copy(update=session),
        SITE,
        NOISE,
        sizes=SIZES if sizes else None,
        seed=5,
    )
    return procedures.load(name).foreseen(asked)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.thorough] * (name == "hand_rotated")) for name in PLANS
])  # fmt: skip
def test_preflight_says_what_a_calibration_states(name) -> None:
    procedure, (settings, session) = procedures.load(name), PLANS[name]
    sim = procedure.simulate(
        session, settings=settings, model=procedure.draw_errors("mems", 5), noise=NOISE,
        site=SITE, seed=5,
    )  # fmt: skip
    came = procedure.trial(sim.log, site=SITE, settings=settings, noise=NOISE, sizes=SIZES)
    found = foreseen(name)
    np.testing.assert_allclose(came.coefficients.sd, found.sd, rtol=0.05)
    assert list(found.left_out["group"]) == [
        g for g in came.tables["left_out"]["group"] if g in set(found.left_out["group"])
    ]
    assert (found.sd > foreseen(name, sizes=False).sd * 0.999).all()
    assert foreseen(name, sizes=False).left_out is None


def test_preflight_says_what_the_plan_cannot_show_and_what_would() -> None:
    rows = {str(r["group"]): r for r in foreseen("ferraris").as_dict()["left_out"]}
    assert rows["gyro.cubic"]["needed"] is None
    assert "second rate" in rows["gyro.cubic"]["shown_by"]
    bought = {e.what: e for e in foreseen("ferraris").more}
    assert bought["local gravity known to 0.00004 m/s^2"].time == 0
    again = foreseen("ferraris", repeated=1)
    extra = bought["the first face again at the end"]
    assert extra.time == pytest.approx(again.duration - foreseen("ferraris").duration)
    name, ratio = extra.best[0]
    k = again.names.index(name)
    assert ratio == pytest.approx(again.sd[k] / foreseen("ferraris").sd[k], rel=1e-9)


def test_the_other_sense_is_worth_much_where_the_asymmetry_is_not_estimated() -> None:
    settings = rate_table.Settings(asymmetry=False, cubic=False, **TURNED)
    session = rate_table.Session(rates=("20 deg/s", "60 deg/s"), **STEPS)
    asked = Beforehand(settings, session, SITE, NOISE, sizes=SIZES)
    found = rate_table.PROCEDURE.foreseen(asked)
    other = next(e for e in found.more if e.what == "each rate in the other sense too")
    name, ratio = other.best[0]
    assert name.startswith("gyro.") and ratio < 0.8


# -- the grade that the noise tells ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "expected"),
    [("mems", "consumer MEMS"), ("tactical", "tactical MEMS"), ("navigation", "navigation RLG")],
)
def test_noise_tells_the_grade(name, expected) -> None:
    noise = grade(name).noise
    assert grade_of("accel", noise.accel.white) == expected
    assert grade_of("gyro", noise.gyro.white) == expected


def test_each_triad_has_the_grade_of_its_own_noise_and_what_is_declared_stays() -> None:
    coarse, fine = NOISE.accel.white, grade("tactical").noise.gyro.white
    found = told(ByNoise({"gyro.cubic": (1.0, "said")}), coarse, fine)
    assert found["accel.cross"][0] == SIZES["accel.cross"][0]
    assert found["gyro.bias drift"][0] == sizes_of("tactical MEMS")["gyro.bias drift"][0]
    assert "told by noise (judgement)" in found["accel.cross"][1]
    assert found["gyro.cubic"] == (1.0, "said")
    assert told(ByNoise(), np.nan, np.nan) is None
    assert (
        told(ByNoise(), np.nan, fine)["accel.cross"][0]
        == sizes_of("tactical MEMS")["accel.cross"][0]
    )
    assert told(SIZES, np.nan, np.nan) is SIZES


# -- campaigns -------------------------------------------------------------------------------------

SHORT = ("rests = 24", "rests = 16"), ('rest_time = "4 s"', 'rest_time = "2 s"')


def campaign(lines=""):
    text = template("hand_rotated").replace("[instrument]", f"[instrument]\n{lines}", 1)
    for pair in SHORT:
        assert text.count(pair[0]) == 1
        text = text.replace(*pair)
    return parse(text)


def test_without_a_word_the_noise_says_how_large_what_is_not_estimated_is(tmp_path) -> None:
    session = simulate(campaign(), 3)
    assert session.sizes is None
    made = load(save_session(session, tmp_path / "s"))
    assert made.sizes is None and "left_out = false" in made.text
    assert "left_out" not in calibrate(made).tables
    usual = calibrate(replace(made, sizes=campaign().sizes))
    assert set(usual.tables["left_out"]["group"]) > {"accel.cross", "gyro.cubic"}
    assert "told by noise" in usual.diagnostics["left_out"]["accel.cross"]["basis"]


def test_a_declared_instrument_is_simulated_with_what_is_not_estimated(tmp_path) -> None:
    declared = campaign('grade = "consumer MEMS"')
    session, plain = simulate(declared, 3), simulate(campaign(), 3)
    more = session.simulation.model.coefficients().values
    less = plain.simulation.model.coefficients().values
    names = session.simulation.model.coefficients().names
    drawn = {n.rpartition(".")[0] for n, a, b in zip(names, more, less, strict=True) if a != b}
    assert drawn == {g for g in SIZES if g.startswith(("accel.", "gyro.")) and "drift" not in g}
    made = load(save_session(session, tmp_path / "s"))
    assert made.sizes == SIZES and "\nleft_out" not in made.text
    # Drifts are in the samples: the mean of the ramp is nothing, its ends are.
    off = (session.simulation.log.gyro - plain.simulation.log.gyro)[[0, -1]]
    assert np.abs(off[1] - off[0]).max() > 0


def test_a_magnetometer_is_simulated_bent_and_with_iron_that_drifts() -> None:
    said = template("magnetometer")
    grade_said = said.replace("[instrument]", '[instrument]\ngrade = "consumer MEMS"', 1)
    held, plain = (simulate(parse(text), 3).simulation.log for text in (grade_said, said))
    ramp = (held.time - held.time[0]) / np.ptp(held.time) - 0.5
    for x, off in zip(plain.mag.T / 50e-6, (held.mag - plain.mag).T, strict=True):
        columns = np.stack([50e-6 * x**2, 50e-6 * x**3, ramp], axis=1)
        found, left, *_ = np.linalg.lstsq(columns, off, rcond=None)
        assert left[0] < 1e-18 * np.sum(off**2)
        assert (np.abs(found) < 4 * np.array([500e-6, 250e-6, 50e-9])).all() and found.all()


@pytest.mark.thorough
def test_a_study_of_a_declared_instrument_draws_and_judges_with_it(tmp_path) -> None:
    declared = campaign('grade = "consumer MEMS"')
    found = study.run(declared, 6, tmp_path / "a", workers=1)
    alone = study.run(campaign(), 2, tmp_path / "b", workers=1)
    k = found.names.index("accel.bias.x")
    assert np.median(found.sd[:, k]) > 3 * np.median(alone.sd[:, k])
    low, high = chi_square_limits(6 * len(found.names), 0.01)
    assert low <= found.nees.sum() <= high
    assert "drawn at the sizes" in study.load(tmp_path / "a")[1]["left_out"]
    assert "declares no grade" in study.load(tmp_path / "b")[1]["left_out"]


def test_off_beside_a_size_is_refused() -> None:
    with refuses("left_out.off", "left_out = false"):
        campaign('left_out = false\ngrade = "consumer MEMS"')
    assert campaign("left_out = false").sizes is None


def test_the_switch_is_written_where_there_is_no_table() -> None:
    assert parse(with_nothing_else(campaign().text)).sizes is None
    bare = '[procedure]\nname = "hand_rotated"\n'
    assert with_nothing_else(bare).count("[instrument]\nleft_out = false") == 1


COUNTING = (
    "hand_rotated", "turntable", "norm_observation", "multi_position", "transfer_alignment",
    "systematic", "platform_tumble", "north_seeking", "magnetometer",
)  # fmt: skip


@pytest.mark.parametrize("name", ["hand_rotated_published"])
def test_where_no_grade_is_told_by_noise_nothing_said_is_nothing_declared(name) -> None:
    procedure = procedures.load(name)
    for sizes, given in ((ByNoise(), None), (ByNoise(SIZES), SIZES), (None, None)):
        assert procedure._given(SITE, None, None, None, silent, sizes).sizes == given
    for usual in map(procedures.load, COUNTING):
        assert usual._given(SITE, None, None, None, silent, ByNoise()).sizes == ByNoise()
        assert usual.counted


@pytest.mark.thorough
@pytest.mark.parametrize("sizes", [ByNoise(), SIZES], ids=["told by noise", "declared"])
def test_preflight_of_a_table_says_what_a_calibration_states(sizes) -> None:
    """Where noise is measured a session finds scatter by chance, or none: foretold is the mean.

    The moves between positions take their time too, in which what drifts goes on.
    """
    case = Case("norm_observation", {}, {"rows": "samples", "rest_time": 10.0})
    site = replace(case.site, gravity_sd=4e-4)
    plan = replace(case.beforehand, sizes=sizes, noise=None, typical=case.sensors, site=site)
    seen = case.record.foreseen(plan)
    found = [
        case.record.trial(made(case, seed).log, site=site, settings=case.stated, sizes=sizes)
        for seed in range(MANY)
    ]
    var = np.array([r.coefficients.sd**2 for r in found]) / seen.sd**2
    error = var.std(axis=0, ddof=1) / np.sqrt(MANY)
    limit = stdtrit(MANY - 1, 1 - 0.005 / len(seen.sd))
    sure = case.record.foreseen(replace(plan, noise=case.sensors))
    chance = 1 - np.minimum(sure.sd / seen.sd, 1.0) ** 2
    assert chance.max() > 0.3
    # What is drawn of chance scatters too, and terms act at the errors of each instrument.
    drawn = 3 * chance * np.sqrt(2 / DRAWS)
    assert (np.abs(var.mean(axis=0) - 1) < limit * error + drawn + 0.05).all()
    nothing = case.record.foreseen(replace(plan, sizes=None))
    assert (seen.sd > 1.5 * nothing.sd).any()
    assert set(seen.left_out["group"]) == set(found[0].tables["left_out"]["group"])
    assert not seen.findings


MANY = 16
"""Sessions whose variances are compared with what was foretold [1]."""


@pytest.mark.parametrize("rows", ["samples", "means"])
@pytest.mark.parametrize("name", [
    "norm_observation", *(pytest.param(n, marks=pytest.mark.thorough)
                          for n in ("multi_position", "turntable")),
])  # fmt: skip
def test_with_declared_noise_preflight_of_a_table_is_exact_with_all_sizes(name, rows) -> None:
    perfect = dict.fromkeys(("plumb_sd", "orthogonality_sd", "zero_sd", "position_sd"), 0.0)
    session = {"rows": rows, "rest_time": 10.0} | (perfect if name == "multi_position" else {})
    case = Case(name, {}, session, grade="mems")
    seen = case.record.foreseen(replace(case.beforehand, sizes=SIZES))
    log = made(case, 3, errors=ImuModel()).log
    came = case.record.trial(log, site=case.site, settings=case.stated, noise=case.sensors,
                             sizes=SIZES).coefficients  # fmt: skip
    np.testing.assert_allclose(seen.sd, came.sd, rtol=0.03)


@pytest.mark.parametrize(("name", "drawn"), [
    ("hand_rotated", True), ("six_position", False),
    pytest.param("continuous_spin", True, marks=pytest.mark.thorough),
])  # fmt: skip
def test_other_draws_of_a_motion_by_hand_are_told(name: str, drawn: bool) -> None:
    """Of a table each session is the same; what a hand does is not, and its sds are not."""
    record = procedures.load(name)
    made = record.Session()
    if name == "continuous_spin":
        made = made.model_copy(update={"rates": ("290 deg/s", "-460 deg/s"), "spin_time": 5.0})
    b = Beforehand(record.Settings(), made, SITE, grade("tactical").noise)
    told = [f for f in record.foreseen(b).findings if f.code == "preflight.by_hand"]
    assert bool(told) is drawn
    if drawn:
        said = re.search(r"are (\S+) to (\S+) times", told[0].message)
        low, high = (float(x) for x in said.groups())
        assert low < 0.9 and high > 1.1
        other = record.foreseen(replace(b, seed=2), more=False)
        ratio = other.sd / record.foreseen(b, more=False).sd
        assert low * 0.99 <= ratio.min() and ratio.max() <= high * 1.01
        assert not [f for f in other.findings if f.code == "preflight.by_hand"]
