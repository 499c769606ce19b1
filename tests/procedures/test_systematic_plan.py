"""A planned systematic calibration: what is foretold comes true, and better plans are found."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foucault import campaign
from foucault.campaign import optimisation
from foucault.campaign.optimisation import foresee
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import FoucaultError
from foucault.models import imu
from foucault.models.earth import Site
from foucault.plans import optimise
from foucault.plans.manoeuvres import Rotate
from foucault.plans.optimise import descend
from foucault.plans.sequence import (
    CalibrationSequence,
    action_sequences,
    nine_positions,
    quarter_turns,
)
from foucault.procedures import systematic
from foucault.procedures.record import Beforehand
from foucault.procedures.systematic import plan as systematic_plan
from foucault.procedures.systematic.plan import HERE, bound, foreseen, shown, without_prior
from foucault.procedures.systematic.quick import Quick
from foucault.procedures.systematic.settings import Session, Settings
from make_sequence import ARCSEC, DEG, NOISE
from sessions import codes

SITE = Site.at(40 * DEG, 100.0)
ARCSEC_G = ARCSEC / 9.80665
TEXT = """
[instrument]
left_out = false
[site]
latitude = "40 deg"
height = "100 m"
[log]
file = "log.csv"
[procedure]
name = "systematic"
{procedure}
[noise.accel]
white = "5 ug/sqrt(Hz)"
[noise.gyro]
white = "0.0007 deg/sqrt(h)"
[simulate]
rest_time = "40 s"
rate = "20 Hz"
[optimise]
{wanted}
"""
NINE = 'sequence = ["9 positions"]'
BENDING = 'sequence = ["9 positions", "spins, icosahedral 6"]\ndeflection = "coupled6"'
FAST = BENDING + '\nrate_limit = "90 deg/s"'


def planned(procedure=NINE, wanted=""):
    return campaign.parse(TEXT.format(procedure=procedure, wanted=wanted))


# -- preflight -------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("more", ["", "\naccel_quadratic = true", "\nlever_arms = true"])
def test_what_is_foretold_of_time_and_of_longer_rests(more):
    told = foresee(planned(NINE + more))
    assert told.complete == ("quadratic" not in more) and told.duration == pytest.approx(481.0)
    assert [m.what for m in told.more] == ["rests 1.83 times as long"]
    assert told.more[0].ratio < 0.9


def test_what_is_not_estimated_counts_in_preflight_and_in_the_search():
    alone = planned()
    whole = campaign.parse(alone.text.replace("left_out = false", ""))
    told, less = foresee(whole), foresee(alone)
    assert less.left_out is None and (told.sd > 0.99 * less.sd).all()
    share = dict(zip(told.left_out["group"], told.left_out["share"], strict=True))
    assert share["accel.cross"] > 0.3 and share["local gravity"] > 0.9
    assert any("products of two axes" in m.what and m.ratio < 0.9 for m in told.more)
    # Rests buy less where more than noise counts.
    assert told.more[-1].ratio > less.more[-1].ratio
    b = replace(optimisation.beforehand(whole)[0], wanted=systematic.PROCEDURE.Wanted())
    space = systematic.PROCEDURE.space(b)
    near, stated = space.bound(space.reference), space.sd(space.reference, space.cases[0])
    # A drift is constant in each rest there, of which there are few.
    np.testing.assert_allclose(near, stated, rtol=0.08)
    assert (near > 0.99 * space.alone(space.reference)).all()


def test_what_is_wanted_is_held_against_the_plan():
    wanted = (
        'total = "20 min"\naccuracy = { "gyro.bias" = "0.02 deg/h", "gyro.bias.x" = "1e-4 deg/h" }'
    )
    told = foresee(planned(wanted=wanted))
    kept = {limit.name: limit.kept for limit in told.limits}
    assert kept == {"highest rate": True, "time": True, "largest sd of gyro.bias": True,
                    "largest sd of gyro.bias.x": False}  # fmt: skip
    assert not told.complete


def test_the_table_is_held_against_the_plan():
    told = foresee(planned(BENDING + '\nrate_limit = "15 deg/s"\nangle_step = "45 deg"'))
    broken = [limit.name for limit in told.limits if not limit.kept]
    assert broken == ["highest rate", "angles off the steps"]
    assert told.fastest == pytest.approx(18 * DEG) and not told.complete


@pytest.mark.thorough
def test_a_model_that_is_not_seen_is_named_before():
    told = foresee(planned(BENDING.replace("coupled6", "direct12")))
    assert "systematic.deflection_planned" in codes(told)
    said = next(f for f in told.findings if f.code == "systematic.deflection_planned")
    assert "12 parameters" in said.message and "will refuse" in said.message
    assert not told.complete
    assert codes(foresee(planned(BENDING))) == ["systematic.stands_for"]
    some = foresee(planned(NINE + '\ndeflection = "coupled6"'))
    assert "systematic.unseen" in codes(some) and some.rank < some.states == 30


def test_noise_that_is_not_said_is_typical():
    text = TEXT.format(procedure=NINE, wanted="")
    before, _, after = text.partition("[noise.accel]")
    asked = campaign.parse(before + after[after.index("[simulate]") :])
    assert codes(foresee(asked)) == ["preflight.typical", "systematic.stands_for"]


# -- the bound -------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_result_has_the_bound_beside_its_uncertainty():
    asked = planned(BENDING + "\npasses = 2")
    made = campaign.simulate(asked, seed=5)
    result = systematic.calibrate(made.simulation.log, site=asked.site, settings=asked.settings,
                                  noise=asked.noise)  # fmt: skip
    limit = np.array(result.diagnostics["bound"])
    ratio = result.coefficients.sd / limit
    assert limit.shape == ratio.shape and ratio.min() > 1.0
    some = [k for k, n in enumerate(result.coefficients.names) if not n.startswith("accel.scale")]
    assert ratio[some].max() < 2.5


def test_the_bound_needs_no_prior_and_knows_what_is_not_seen():
    settings = Settings(sequence=())
    sequence = quarter_turns("two", "ENU", "+x", rest=60.0)
    found = foreseen(sequence, Beforehand(settings, Session(rate=20.0), SITE, NOISE))
    limit = bound(found.problem, found.solution, settings)["bound"]
    names = systematic.public(found.solution, settings).names
    unseen = [n for n, v in zip(names, limit, strict=True) if v is None]
    assert "accel.scale.x" in unseen and len(unseen) < len(names)


def test_what_is_known_well_does_not_blur_what_is_hardly_known():
    layout = Layout(imu.LAYOUT.coefficients[:4])
    V = np.linalg.qr(np.random.default_rng(2).normal(size=(4, 4)))[0]
    told = np.array([1e11, 1e5, 1e-2, 0.0])
    states = CoefficientVector(layout, np.zeros(4), V / (1 + told) @ V.T, prior_sd=np.ones(4))
    _, found, directions = np.linalg.svd(without_prior(states).root)
    np.testing.assert_allclose(found[2] ** 2, 1e-2, rtol=1e-6)
    assert abs(directions[2] @ V[:, 2]) > 1 - 1e-12


# -- the quick covariance --------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("more", [{}, {"decorrelate": False}, {"lever_arms": True}])
def test_quick_uncertainties_are_nearly_those_stated(more):
    settings = Settings(sequence=(), deflection="coupled6", **more)
    spins = action_sequences("icosahedral 6", turns=5, spin_rate=90 * DEG, before=20, rest=40)
    sequence = nine_positions(rest=60.0).then(spins)
    found = foreseen(sequence, Beforehand(settings, Session(rate=50.0), SITE, NOISE))
    p = found.problem
    quick = Quick(SITE, settings.sensors, NOISE, p.at_rest, p.start_cov())
    np.testing.assert_allclose(quick.sd(sequence), found.states.sd, rtol=0.03)
    first = quick.sd(sequence)
    np.testing.assert_array_equal(quick.sd(sequence), first)  # from what it has kept


@pytest.mark.thorough
def test_what_the_sequences_show():
    both = nine_positions().then(action_sequences("simple 6"))
    (seen, count), models = shown(both, SITE, NOISE)
    assert (seen, count) == (24, 24)
    assert models["coupled6"] == (6, 6) and models["general18"][0] < models["general18"][1] == 18
    assert shown(nine_positions(), SITE, NOISE)[1]["coupled6"][0] < 6


# -- the search ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def space():
    return optimisation.space_of(
        planned(FAST, 'total = "25 min"\nweights = { gyro = 0.0, accel = 0.0 }')
    )


def test_plans_fill_the_time_and_keep_the_limits(space):
    rng = np.random.default_rng(0)
    plan = space.draw(rng)
    for _ in range(60):
        plan = space.moved(plan, rng, float(rng.random()))
        s = space.allowed.sequence(plan)
        assert plan.rate <= 90.0 and 1 <= plan.turns <= 40 and len(plan.poses) == 6
        assert max(a.rate for a in s.actions if hasattr(a, "rate")) <= 90 * DEG * (1 + 1e-12)
        if space.fits(plan):
            assert 25 * 60 - len(plan.rests) - 1e-6 <= s.duration <= 25 * 60
            assert min(plan.rests) >= 20 and plan.rests[0] >= 30


@pytest.mark.thorough
def test_a_descent_beats_the_known_plan_and_is_the_same_again(space, monkeypatch):
    monkeypatch.setattr(optimise, "PROBED", 12)
    best = descend(space, np.random.default_rng(1), 20)
    again = descend(space, np.random.default_rng(1), 20)
    assert best == again
    assert best.cost < -0.5 and space.exact_cost(best.plan) == pytest.approx(best.cost, abs=0.03)
    done = space.allowed.sequence(best.plan)
    changes = space.changes(best.plan)
    text = tomllib.loads(TEXT.format(procedure=FAST, wanted=""))
    del text["procedure"]["sequence"], text["simulate"]["rest_time"]
    plan = Settings.model_validate(
        {k: v for k, v in (text["procedure"] | changes["procedure"]).items()
         if k != "name" and v is not None}
    ).plan  # fmt: skip
    assert isinstance(plan, CalibrationSequence) and len(plan) == len(done)
    np.testing.assert_allclose(plan.attitudes, done.attitudes, atol=1e-9)
    np.testing.assert_allclose(plan.times, done.times, rtol=1e-12)


def test_without_spins_the_quarter_turns_are_open():
    """Axes, senses and order in the same time; closed, there is one plan only."""
    nineteen = 'sequence = ["19 positions"]'
    space = optimisation.space_of(planned(nineteen))
    best = descend(space, np.random.default_rng(0), 40)
    assert best.cost < -0.1 and "quarter and half turns" in space.limits
    done, known = space.done(best.plan), space.reference
    assert len(done) == len(known) and done.duration <= known.duration
    quarters = [a.angle / (np.pi / 2) for a in done.actions if isinstance(a, Rotate)]
    assert {abs(round(k, 9)) for k in quarters} <= {1.0, 2.0}
    assert space.from_json(space.as_json(best.plan)) == best.plan
    plan = campaign.parse(TEXT.format(procedure=nineteen, wanted="open_turns = false"))
    closed = optimisation.space_of(plan)
    rng = np.random.default_rng(0)
    first, second = closed.draw(rng), closed.draw(rng)
    assert first == second == closed.moved(first, rng, 1.0) and not first.quarters


def test_quarter_turns_may_be_open_beside_spins():
    space = optimisation.space_of(planned(FAST, "open_turns = true"))
    rng = np.random.default_rng(2)
    plan = space.draw(rng)
    for _ in range(40):
        new = space.moved(plan, rng, 1.0)
        changed = [key for key in ("quarters", "poses") if getattr(new, key) != getattr(plan, key)]
        assert len(changed) <= 1
        plan = new
    # Spins begin where both gimbals are at zero, wherever the quarter turns have led.
    done = space.done(plan)
    back = [k for k, a in enumerate(done.actions) if a.label == "to the start"]
    np.testing.assert_allclose(done.attitudes[back[-1] + 1], np.eye(3), atol=1e-9)


@pytest.mark.thorough
def test_a_search_in_a_folder_for_the_shortest(tmp_path, monkeypatch):
    monkeypatch.setattr(systematic_plan, "OTHERS", systematic_plan.OTHERS[3:])
    wanted = 'accuracy = { "deflection" = "0.06 arcsec/g" }\nmost_turns = 12'
    asked = planned(FAST, wanted)
    found = optimisation.run(asked, tmp_path / "a", restarts=1, evaluations=120, size=2)
    assert found.aim == "time" and found.gained and found.complete
    wanted_of = {n.name: n for n in found.needs}["largest sd of deflection"]
    assert wanted_of.kept and wanted_of.needed < 0.06 * ARCSEC_G
    done = campaign.load(tmp_path / "a/campaign.toml")
    assert done.settings.plan.duration == pytest.approx(found.duration)
    told = foresee(done)
    assert told.complete and told.duration == pytest.approx(found.duration)
    more = optimisation.run(asked, tmp_path / "a", restarts=2, evaluations=120, size=2)
    assert len(more.restarts) == 2 and more.duration <= found.duration


@pytest.mark.thorough
def test_a_search_that_can_only_be_longer_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(systematic_plan, "OTHERS", ())
    wanted = 'accuracy = { "gyro.bias" = "0.1 deg/h" }\nfirst = "19 positions"'
    found = optimisation.run(planned(NINE, wanted), tmp_path, restarts=1, evaluations=5, size=2)
    assert "optimise.no_time" in codes(found) and not found.complete


@pytest.mark.thorough
def test_angles_in_steps():
    space = optimisation.space_of(planned(FAST + '\nangle_step = "45 deg"', 'total = "25 min"'))
    rng = np.random.default_rng(0)
    plan = space.moved(space.draw(rng), rng, 0.5)
    assert not np.any(np.remainder(np.array(plan.poses) + 1e-9, 45.0) > 1e-6)
    assert space.sd(space.reference, HERE).shape == (30,)


@pytest.mark.parametrize(
    ("procedure", "wanted", "code"),
    [
        (NINE, 'accuracy = { "gyro.bias" = "0 deg/h" }', "systematic.accuracy"),
        (NINE, 'accuracy = { "gyro" = "1 deg/h" }', "systematic.accuracy"),
        (NINE, 'accuracy = { "deflection" = "1 arcsec/g" }', "systematic.accuracy_unknown"),
        (BENDING + '\nsteps = "published"', "", "systematic.search_published"),
        ("sequence = []", "", "systematic.no_sequence"),
        (NINE, 'first = "8 positions"', "sequence.unknown"),
        (NINE, "weights = { gyros = 1.0 }", "optimise.weight_name"),
    ],
)
def test_what_cannot_be_searched(procedure, wanted, code):
    with pytest.raises(FoucaultError) as caught:
        optimisation.space_of(planned(procedure, wanted))
    if caught.value.code.startswith("campaign."):  # a mistake in the file, with its key
        assert code.partition(".")[0] in ("systematic", "sequence") and "optimise" in str(
            caught.value
        )
    else:
        assert caught.value.code == code


@pytest.mark.parametrize("rest_time", [5.0, 20.0])
def test_a_session_that_cannot_be_aligned_is_refused_before_it_is_made(rest_time):
    described = campaign.parse(campaign.template("systematic"), Path("campaign.toml"))
    session = described.session.model_copy(update={"rest_time": rest_time})
    for what in (campaign.simulate, foresee):
        with pytest.raises(FoucaultError, match=r"first rest lasts \d+ s.* 20.5 s or more"):
            what(replace(described, session=session), *([1] if what is campaign.simulate else []))


@pytest.mark.thorough
def test_the_shortest_first_rest_that_is_planned_is_calibrated():
    settings = Settings(sequence=("9 positions",))
    made = systematic.simulate(
        Session(rest_time=20.5, rate=20.0), settings=settings, noise=NOISE, site=SITE, seed=1,
        model=systematic.draw_errors("navigation", 1),
    )  # fmt: skip
    result = systematic.trial(made.log, site=SITE, settings=settings, noise=NOISE)
    assert result.coefficients.cov is not None
