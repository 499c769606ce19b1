"""What is not estimated, in whole calibrations: its columns, its price, and who is named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import binom

from foucault import run_folder
from foucault.campaign import parse
from foucault.campaign.writing import template
from foucault.detect.stretches import How, find_rests
from foucault.diagnose.checks import reversed_earth_at_rest
from foucault.diagnose.study import nees
from foucault.errors import FoucaultError
from foucault.estimate.hand_rotated import RestsAndTurns, first_guess
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.left_out import NONE, ByNoise, changes, sizes_of, terms
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.models.rests_and_turns import Session as SessionData
from foucault.procedures import ferraris, hand_rotated, left_out, rate_table, six_position
from foucault.procedures.merged import merged
from foucault.report.calibration import sections
from foucault.result import Level
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import Log

SITE = Site.at(np.radians(48.8462), 60.0)
SIZES = sizes_of("consumer MEMS")
HAND = hand_rotated.Session(rests=16, rest_time=2.0, turn_time=1.5, first_rest_time=3.0)
ARCMIN = np.radians(1 / 60)
SQUARE = ferraris.Settings(placement_sd=3 * ARCMIN, angle_sd=np.radians(0.2))
FACES = ferraris.Session(
    rest_time=4.0, turn_time=3.0, placement_sd=3 * ARCMIN, angle_sd=np.radians(0.2)
)


@cache
def hand(seed: int):
    return hand_rotated.simulate(
        HAND, model=draw_errors("mems", seed), noise=grade("mems").noise, site=SITE, seed=seed
    )


def put(sim, group: str, size: float) -> Log:
    """Add a term to the samples by its formula, not by the model that makes the columns."""
    log = sim.log
    f, w = sim.model.compensate(log.accel, log.gyro)
    ramp = ((log.time - log.time[0]) / (log.time[-1] - log.time[0]) - 0.5)[:, None]
    more = {
        "accel.quadratic": (size * f**2, 0.0),
        "accel.bias drift": (size * ramp, 0.0),
        "gyro.g_sensitivity": (0.0, size * f),
        "gyro.cubic": (0.0, size * w**3),
        "gyro.scale drift": (0.0, size * ramp * w),
    }[group]
    return replace(log, accel=log.accel + more[0], gyro=log.gyro + more[1])


GROUPS = ("accel.quadratic", "accel.bias drift", "gyro.g_sensitivity", "gyro.cubic",
          "gyro.scale drift")  # fmt: skip


@pytest.mark.parametrize("group", GROUPS)
def test_a_column_is_what_the_whole_session_reduced_again_says(group) -> None:
    sim = hand(1)
    log, size = sim.log, SIZES[group][0]
    rests = find_rests(log, How(0.5, 1.0, None))
    data = SessionData.reduce(log, rests.first, rests.last, SITE)
    start = first_guess(data)
    names = hand_rotated.Settings().estimated()
    model = RestsAndTurns(data, names, start, hand_rotated._noise(data, rests, None))
    again = hand_rotated.again_of(model)
    instrument, motion = again.motion(start)
    some = terms(names, SITE, {group: SIZES[group]})
    diagonal = [t for t in some if "g_sensitivity" not in group or t.name[-1] == t.name[-2]]
    made = sum(
        again.residuals(start, by) - again.residuals(start, NONE)
        for t, by in zip(some, changes(some, instrument, motion), strict=True)
        if t in diagonal
    )
    other = SessionData.reduce(put(sim, group, size), rests.first, rests.last, SITE)
    wanted = model.predict(start).residuals
    wanted = replace(model, session=other).predict(start).residuals - wanted
    # The column is taken at the first guess of the instrument, which is not the true one.
    assert np.abs(made - wanted).max() < 0.02 * np.abs(wanted).max()


def calibrate(log: Log, **more):
    return hand_rotated.PROCEDURE.trial(log, site=SITE, **more)


def test_without_sizes_nothing_is_said_of_them() -> None:
    plain = calibrate(hand(1).log)
    assert "left_out" not in plain.tables and "left_out" not in plain.diagnostics


def test_with_sizes_the_budget_and_the_result_have_them() -> None:
    plain, result = calibrate(hand(1).log), calibrate(hand(1).log, sizes=SIZES)
    assert (result.coefficients.sd > 0.9 * plain.coefficients.sd).all()
    budget, names = result.diagnostics["budget"], result.coefficients.names
    total = np.sum(list(budget.values()), axis=0)
    np.testing.assert_allclose(total, result.coefficients.sd**2, rtol=1e-6)
    bias = names.index("accel.bias.x")
    assert budget["accel.cross"][bias] > 0.5 * total[bias]
    said = result.diagnostics["sources"]["accel.cross"]
    assert said == ["B", "left out, 250 ug/g^2: consumer MEMS, judgement"]
    row = result.diagnostics["left_out"]["gyro.cubic"]
    assert row["size"] == pytest.approx(600e-6 / np.radians(100) ** 2) and row["dof"] == 3
    # Gravity counts once: what was added after the fit is in it.
    scale = names.index("accel.scale.x")
    assert budget["local gravity"][scale] == pytest.approx((4e-4 / SITE.gravity) ** 2, rel=0.05)
    assert not result.diagnostics["named"]


@pytest.mark.parametrize("group", ["accel.quadratic", "gyro.g_sensitivity", "gyro.scale drift"])
def test_what_is_ten_times_its_size_is_named_and_the_result_stays_honest(group) -> None:
    sim = hand(1)
    result = calibrate(put(sim, group, 10 * SIZES[group][0]), sizes=SIZES)
    first = result.diagnostics["named"][0]
    assert next(iter(first)) == group and 3 < first[group] < 30
    assert result.verdict.level is not Level.PASS
    assert "times as large as its size" in " ".join(result.verdict.reasons)
    c = result.coefficients
    truth = sim.model.coefficients(c.names).values
    assert nees((c.values - truth)[None], c.cov[None])[0] < chi_square_limits(len(truth), 1e-4)[1]


def test_faces_carry_what_no_turn_about_one_rate_can_show() -> None:
    sim = ferraris.simulate(
        FACES, model=draw_errors("mems", 3), noise=grade("mems").noise, site=SITE, seed=3,
        settings=SQUARE,
    )  # fmt: skip
    result = ferraris.PROCEDURE.trial(sim.log, site=SITE, settings=SQUARE, sizes=SIZES)
    assert result.verdict.level is Level.PASS
    rows = result.diagnostics["left_out"]
    assert rows["gyro.cubic"]["needed"] is None and rows["gyro.cubic"]["dof"] == 0
    told = next(c for c in result.checks if c.name == "terms not shown")
    assert "cubic terms of the gyros (60 ppb/(deg/s)^2): a second rate" in told.sentence
    fine = replace(sim.log, gyro=sim.log.gyro + 10 * SIZES["gyro.g_sensitivity"][0] * sim.log.accel)
    named = ferraris.PROCEDURE.trial(fine, site=SITE, settings=SQUARE, sizes=SIZES).diagnostics[
        "named"
    ]
    assert next(iter(named[0])) == "gyro.g_sensitivity"


RATES = rate_table.Session(rates=[f"{s}{r} deg/s" for r in (20, 60, 100) for s in ("", "-")],
                           step_time=18.0, rows="means")  # fmt: skip
TABLE = rate_table.Settings(table_rate_sd=5e-6, fixture_sd=ARCMIN)


def turned(seed: int):
    return rate_table.simulate(
        RATES, settings=TABLE, model=draw_errors("mems", seed), noise=grade("mems").noise,
        site=SITE, seed=seed,
    )  # fmt: skip


def on_rate_table(log: Log, sizes=SIZES):
    noise = grade("mems").noise
    return rate_table.PROCEDURE.trial(log, site=SITE, settings=TABLE, noise=noise, sizes=sizes)


def test_a_rate_table_takes_force_and_rate_from_its_geometry() -> None:
    sim = turned(2)
    plain, result = on_rate_table(sim.log, None), on_rate_table(sim.log)
    assert not result.diagnostics["named"] and "left_out" not in plain.diagnostics
    assert (result.coefficients.sd > 0.9 * plain.coefficients.sd).all()
    up = np.round(sim.log.accel / np.linalg.norm(sim.log.accel, axis=1, keepdims=True))
    # Nine terms of so many sizes each, which up and down tell from a bias.
    felt = 12 * SIZES["gyro.g_sensitivity"][0] * SITE.gravity * up
    wrong = on_rate_table(replace(sim.log, gyro=sim.log.gyro + felt))
    first = wrong.diagnostics["named"][0]
    assert next(iter(first)) == "gyro.g_sensitivity"
    c = wrong.coefficients
    truth = sim.model.coefficients(c.names).values
    assert nees((c.values - truth)[None], c.cov[None])[0] < chi_square_limits(len(truth), 1e-4)[1]


def test_a_run_folder_keeps_them_and_the_page_shows_one_table_of_them(tmp_path) -> None:
    result = hand_rotated.calibrate(hand(1).log, site=SITE, sizes=SIZES)
    run_folder.save(result, tmp_path)
    again = run_folder.load_result(tmp_path)
    assert again.diagnostics["left_out"] == result.diagnostics["left_out"]
    shown = [s for s in sections(again) if s.key == "uncertainty.not_estimated"]
    rows = shown[0].blocks[0].rows
    assert len(rows) == len(result.tables["left_out"]["group"]) == 13
    # What costs most comes first; what no bench shows is said to be never named.
    assert rows[0][:2] == ["products of two axes in the accelerometers", "250 ug/g^2"]
    assert next(row for row in rows if row[0] == "local gravity")[4] == "never"


def test_a_campaign_declares_the_instrument() -> None:
    text = template("hand_rotated")
    assert parse(text).sizes == ByNoise()
    graded = parse(text.replace("[instrument]", '[instrument]\ngrade = "tactical MEMS"', 1))
    assert graded.sizes == sizes_of("tactical MEMS")
    assert set(graded.instrument) == {"name", "serial", "operator", "due", "note"}
    own = parse(text.replace("[instrument]", '[instrument]\naccel_cross = "100 ug/g^2"', 1))
    assert own.sizes == {
        "accel.cross": (pytest.approx(100e-6 / 9.80665), "as given in the campaign")
    }
    with pytest.raises(FoucaultError, match=r"instrument\.grade"):
        parse(text.replace("[instrument]", '[instrument]\ngrade = "tactical"', 1))


def test_a_procedure_that_does_not_count_them_says_so() -> None:
    sim = hand(1)
    rests = zip(sim.first, sim.last, strict=True)
    means = np.array([sim.log.accel[a:b].mean(axis=0) for a, b in rests])
    means = Log(np.arange(16.0), None, means, averaged=np.full(16, 2.0))
    result = hand_rotated.calibrate(means, site=SITE, sizes=SIZES)
    told = next(f for f in result.findings if f.code == "left_out.not_counted")
    assert "but 'hand_rotated' does not count them with such a log" in told.message


@pytest.mark.thorough
def test_sizes_that_are_larger_than_the_terms_make_no_half_of_a_session_suspect() -> None:
    settings = six_position.Settings(placement_sd=3 * ARCMIN)
    session, failed = six_position.Session(placement_sd=3 * ARCMIN), 0
    for seed in range(40):
        sim = six_position.simulate(
            session, model=draw_errors("mems", seed), noise=grade("mems").noise, site=SITE,
            seed=seed, settings=settings,
        )  # fmt: skip
        found = six_position.PROCEDURE.trial(sim.log, site=SITE, settings=settings, sizes=SIZES)
        failed += any(not c.passed for c in found.checks if c.name.startswith("evenness"))
    assert failed <= binom.isf(0.005, 40, 0.02), failed


def test_24_lengths_of_gravity_are_enough_beside_terms_that_count() -> None:
    """Causes of a known size take no redundancy away: a rest that is off is still left out."""
    sim = hand_rotated.simulate(
        hand_rotated.Session(), model=draw_errors("mems", 2), noise=grade("mems").noise,
        site=SITE, seed=2,
    )  # fmt: skip
    alone = replace(sim.log, gyro=None)
    clean = calibrate(alone, sizes=SIZES)
    assert clean.verdict.level is Level.PASS
    assert next(c for c in clean.checks if c.name == "redundancy").value == pytest.approx(15)
    prior = {"accel.bias.x": (0.0, 1.0), "accel.scale.x": (0.0, 0.1)}
    known = calibrate(alone, sizes=SIZES, prior=prior)  # says nothing of a bad rest
    assert next(c for c in known.checks if c.name == "redundancy").value == pytest.approx(15)
    off = alone.accel.copy()
    off[sim.first[7] - 20 : sim.last[7] + 20, 0] += 5e-3 * 9.80665
    found = calibrate(replace(alone, accel=off), sizes=SIZES)
    assert [f.code for f in found.findings].count("session.outlier") == 1
    assert found.verdict.level is Level.PASS
    c = found.coefficients
    truth = sim.model.coefficients(c.names).values
    assert nees((c.values - truth)[None], c.cov[None])[0] < chi_square_limits(len(truth), 1e-4)[1]


def test_what_counts_does_not_hide_placements_that_nobody_declares() -> None:
    """Terms that are not there explain placements of 1 arcmin: those were counted as nothing."""
    session, found = six_position.Session(placement_sd=ARCMIN), []
    for seed in range(8):
        sim = six_position.simulate(
            session, model=draw_errors("mems", seed), noise=grade("mems").noise, site=SITE,
            seed=seed, settings=six_position.Settings(),
        )  # fmt: skip
        result = six_position.PROCEDURE.trial(
            sim.log, site=SITE, settings=six_position.Settings(), sizes=SIZES
        )
        c = result.coefficients
        truth = sim.model.coefficients(c.names).values
        found.append(float(nees((c.values - truth)[None], c.cov[None])[0]) / len(truth))
        assert ARCMIN / 3 < result.diagnostics["placement_sd"] < 5 * ARCMIN
    assert np.mean(found) < 1.5, found


def test_a_term_that_counts_is_no_reason_to_doubt() -> None:
    """It explains nearly all that the gyros read at rest, and is of its size."""
    session = hand_rotated.Session()
    sim = hand_rotated.simulate(
        session, model=draw_errors("mems", 3), noise=grade("mems").noise, site=SITE, seed=3
    )
    f, _ = sim.model.compensate(sim.log.accel, sim.log.gyro)
    matrix = SIZES["gyro.g_sensitivity"][0] * np.array([[1, -1, 1], [1, 1, -1], [-1, 1, 1]])
    log = replace(sim.log, gyro=sim.log.gyro + f @ matrix.T)
    without, counted = (
        hand_rotated.PROCEDURE.trial(log, site=SITE, sizes=sizes) for sizes in (None, SIZES)
    )
    assert "session.g_sensitivity" in [f.code for f in without.findings]
    assert without.verdict.level is Level.DOUBTFUL
    assert "session.g_sensitivity" not in [f.code for f in counted.findings]
    assert counted.verdict.level is Level.PASS


@pytest.mark.parametrize(
    ("beside", "told"), [(0.0, True), (5.8, True), (58.0, False)], ids=["none", "10", "100"]
)
def test_a_g_sensitivity_that_counts_may_hide_the_sign_of_the_earths_rate(beside, told) -> None:
    """Deg/h of all gyros along up: of a reversed sign -22.6; of 100 deg/h/g 58 (1 sd)."""
    hour, rng = np.radians(1 / 3600), np.random.default_rng(4)
    up = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 3, axis=0)
    made = -2 * EARTH_RATE * np.sin(SITE.latitude) * up
    noise = hour * rng.standard_normal(up.shape)
    found = reversed_earth_at_rest(made + noise, up, np.eye(3), SITE, beside=beside * hour)
    assert (found is not None and not found.passed) is told


def test_the_worst_term_is_named_beside_the_factor_of_its_group() -> None:
    sim = hand(1)
    gyro = sim.log.gyro.copy()
    gyro[:, 2] += 12 * SIZES["gyro.g_sensitivity"][0] * sim.log.accel[:, 1]
    result = calibrate(replace(sim.log, gyro=gyro), sizes=SIZES)
    k = result.diagnostics["named"][0]["gyro.g_sensitivity"]
    (reason,) = [r for r in result.verdict.reasons if "times as large" in r]
    assert "most of all gyro.g_sensitivity.zy, about 12 times" in reason
    assert 2 < k < 7  # one of nine: a mean of all


def test_a_drift_that_the_declared_noise_has_already_counts_once() -> None:
    size = SIZES["gyro.bias drift"][0]

    def of(walk: float) -> float:
        slow = ImuNoise(gyro=TriadNoise(random_walk=walk))
        wander = left_out.wander_of(slow, 400.0)
        return left_out.whole(SIZES, SITE, (np.nan, np.nan), wander)["gyro.bias drift"][0]

    assert of(0.0) == size
    # A walk of K has changed by K sqrt(T): both together are the larger one.
    half = 0.5 * size / 20.0
    assert of(half) ** 2 + (0.5 * size) ** 2 == pytest.approx(size**2, rel=2e-3)
    assert of(2 * size / 20.0) == 0.0
    assert "gyro.bias drift" not in {
        t.group for t in terms((), SITE, {"gyro.bias drift": (0.0, "")})
    }


def test_merged_sessions_say_that_they_share_what_is_not_estimated() -> None:
    """Every cross term is the same in both; taken as independent its part falls by sqrt 2."""
    results = [
        replace(calibrate(hand(k).log, sizes=SIZES if counts else None),
                instrument={"serial": "1"}, provenance={"input": {"sha256": str(k)}})
        for k, counts in ((1, True), (2, True), (3, False))
    ]  # fmt: skip
    hashed = [(f"run {k}", str(k), r) for k, r in enumerate(results)]
    both = {f.code: f.message for f in merged(hashed[:2]).findings}
    assert "accel.cross" in both["merge.left_out"] and "merge.left_out_only_some" not in both
    mixed_up = {f.code: f.message for f in merged(hashed).findings}
    assert "run 2" in mixed_up["merge.left_out_only_some"]
    alone = [(a, b, replace(r, diagnostics={})) for a, b, r in hashed[:2]]
    assert not [f for f in merged(alone).findings if f.code.startswith("merge.left")]
