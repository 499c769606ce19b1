"""Torquing plans that are searched for: what is allowed, and how good they are said to be."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from foucault import campaign
from foucault.campaign.optimisation import space_of
from foucault.errors import FoucaultError
from foucault.estimate.tumble import Prior, State, Tumble, look
from foucault.models.cluster import angles_of, attitude_of
from foucault.models.earth import earth_rate_n
from foucault.models.rotation import exp
from foucault.plans.tumble import Allowed, nominal
from make_cluster import G, make_cluster
from make_tumble import campaign_text
from refusals import refuses

FAST = 'rate_limit = "0.2 deg/s"'
RESTING = 'steps = [{ rate = ["0 deg/s", "0 deg/s", "0 deg/s"], time = "5400 s" }]'
LOCKED = 'middle_limit = "1 deg"\ncable_limit = "1 deg"'


def allowed(**changes):
    usual = {"rates": (np.radians(0.2),), "axes": "xyz", "together": False, "total": 5400.0,
             "shortest": 60.0, "start": np.zeros(3)}  # fmt: skip
    return Allowed(**usual | changes)


def space(procedure=FAST, wanted="", latitude_sd="0 deg", latitudes="[]"):
    # Latitude and gravity known for sure: what is stated then is the bound.
    procedure = f'{procedure}\nlatitude_sd = "{latitude_sd}"'
    text = campaign_text(procedure).replace("# gravity_sd = ", 'gravity_sd = "0 m/s^2"  # ')
    text += f"\n[optimise]\ntruths = 1\nlatitudes = {latitudes}\n{wanted}\n"
    return space_of(campaign.parse(text))


@pytest.fixture(scope="module")
def usual():
    return space()


def test_what_may_be_turned():
    assert len(allowed().turns) == 6
    assert len(allowed(together=True).turns) == 26
    assert len(allowed(axes="xz", together=True).turns) == 8
    assert len(allowed(axes="y", rates=(0.001, 0.002)).turns) == 4
    assert np.abs(allowed(axes="y", rates=(0.001, 0.002)).turns[:, [0, 2]]).max() == 0


def test_a_slot_turns_by_no_more_than_six_degrees():
    assert allowed().slot == pytest.approx(30.0)
    assert allowed(together=True).slot * np.radians(0.2) * np.sqrt(3) <= np.radians(6.0) + 1e-12


def test_plans_keep_the_time_and_the_shortest_segment(usual):
    rng = np.random.default_rng(1)
    plan = usual.draw(rng)
    for k in range(3000):
        plan = usual.moved(plan, rng, 1.0 - k / 3000) if k % 20 else usual.draw(rng)
        turns, slots = np.array(plan).T
        assert slots.sum() == usual.allowed.slots
        assert slots.min() >= usual.allowed.least == 2
        assert (turns[1:] != turns[:-1]).all()


def test_the_fast_bound_is_that_of_the_filter_that_solves_readings(usual):
    """`estimate.tumble.look` solves by NumPy: the same plan as a log of means over slots."""
    latitude, start = 0.7, np.array([0.3, -0.2, 0.5])
    conditions = replace(
        usual.conditions, w_ie_n=earth_rate_n(latitude), constants=make_cluster(1).packed(G),
        prior_sd=np.full(46, 1e-3), arms=np.diag([0.05, 0.05, 0.05]), gravity=G,
        C_np=np.ascontiguousarray((exp(np.array([0.03, 0.01, -0.02])) @ attitude_of(start)).T),
        gyro_psd=1e-13, accel_psd=1.5e-9,
    )  # fmt: skip
    tried = replace(usual, allowed=allowed(start=start, together=True), conditions=conditions)
    n, slot = tried.allowed.slots, tried.allowed.slot
    assert (n, slot) == (360, 15.0)
    plan = ((0, 100), (4, 7), (21, 93), (12, 160))
    log = Tumble(
        np.full(n, slot), nominal(tried.done(plan), latitude, slot).command,
        np.zeros((n, 3)), np.ones(n, bool), conditions.w_ie_n, G, 1e-13, 1e-10,
        conditions.arms, mean=True,
    )  # fmt: skip
    prior_sd = np.append(conditions.prior_sd[:45], 0.0)  # the delay is known
    at = State(conditions.C_np, conditions.constants)
    expected = np.sqrt(np.diag(look(log, Prior(at, prior_sd), at).cov))[3:45]
    assert expected.max() > 0.1  # not all is seen well: the prior matters too
    np.testing.assert_allclose(tried.bound(plan), expected, rtol=1e-6)


def test_the_fast_bound_is_that_of_the_whole_motion(usual):
    """A slot of 6 deg stands for readings five times a second: a few per cent, never less."""
    rng = np.random.default_rng(2)
    for _ in range(4):
        plan = min((usual.draw(rng) for _ in range(60)), key=usual.cost)
        prior = usual.conditions.prior_sd[3:45]
        fast = usual.bound(plan) * prior
        whole = usual.stated(usual.done(plan), "the site") * _packed(usual)
        ratio = fast / whole
        assert ratio.min() > 0.99
        assert ratio.max() < 1.15
        assert abs(np.log(ratio).mean()) < 0.05


def _packed(space):
    from foucault.models.cluster import normalised

    return normalised(space.conditions.gravity)


def test_what_noise_and_prior_do_not_say_is_stated_too(usual):
    """A latitude that is not known moves drifts, and a plan can be worse by that alone."""
    plan = usual.draw(np.random.default_rng(7))
    unsure = space(latitude_sd="0.02 deg")
    before, after = usual.sd(plan, "the site"), unsure.sd(plan, "the site")
    assert (after >= before * (1 - 1e-9)).all()
    assert (after / before).max() > 2
    assert unsure.exact_cost(plan) != pytest.approx(usual.exact_cost(plan), abs=1e-3)
    assert unsure.cost(plan) == pytest.approx(usual.cost(plan), abs=1e-12)


@pytest.mark.thorough
def test_the_plan_that_is_taken_keeps_limits_everywhere():
    """Between the points where the search looks, too: judged each second."""
    kept = space(f'{FAST}\nmiddle_limit = "60 deg"')
    rng = np.random.default_rng(8)
    plans = [kept.draw(rng) for _ in range(30)]
    for plan in plans:
        needed = {limit.name: limit for limit in kept.needs(plan)}["middle angle"]
        assert (kept.exact_cost(plan) < inf) == (needed.needed <= np.radians(60.0) * (1 + 1e-9))
        if kept.fits(plan):
            assert needed.needed < np.radians(61.0)


@pytest.mark.thorough
def test_gimbals_keep_their_limits():
    kept = space(f'{FAST}\nmiddle_limit = "30 deg"\ncable_limit = "200 deg"')
    rng = np.random.default_rng(3)
    plans = [kept.draw(rng) for _ in range(100)]
    finite = [plan for plan in plans if kept.cost(plan) < inf]
    assert 0 < len(finite) < len(plans)
    for plan in finite:
        angles = angles_of(nominal(kept.done(plan), 0.0).C_pn)
        turned = np.unwrap(angles[:, [0, 2]], axis=0)
        assert np.degrees(np.abs(angles[:, 1]).max()) < 30.0 + 0.5  # looked at once per degree
        assert np.degrees(np.abs(turned).max()) < 200.0 + 1.0


def test_changes_make_the_campaign_do_the_plan(usual):
    plan = usual.draw(np.random.default_rng(5))
    table = usual.changes(plan)["procedure"]
    lines = [
        f"{{ rate = {list(s['rate'])}, time = '{s['time']}' }}".replace('"', "'")
        for s in table["steps"]
    ]
    read = campaign.parse(campaign_text(f"{FAST}\nsteps = [{', '.join(lines)}]"))
    made, meant = read.settings.torquing, usual.done(plan)
    np.testing.assert_allclose(made.rates, meant.rates, rtol=1e-11)
    np.testing.assert_array_equal(made.ends, meant.ends)

    assert table["plan"] is None


def test_a_ramp_takes_its_time(usual):
    plan = usual.draw(np.random.default_rng(5))
    ramped = space(f'{FAST}\nramp = "60 s"')
    assert usual.duration(plan) == 5400.0
    assert ramped.duration(plan) == 5460.0
    assert ramped.done(plan).ramp == 60.0


def test_the_published_plan_keeps_the_rate_of_the_rig():
    slow = space('rate_limit = "0.05 deg/s"')
    assert np.degrees(slow.reference.rates).min() == pytest.approx(-0.05)
    assert slow.allowed.total == pytest.approx(10800.0)


@pytest.mark.thorough
def test_tilt_is_kept():
    """Azimuth is free: up moves in the cluster by no more than allowed."""
    kept = space(f'{FAST}\ntilt_limit = "50 deg"')
    rng = np.random.default_rng(4)
    plans = [p for p in (kept.draw(rng) for _ in range(40)) if kept.cost(p) < inf]
    assert plans
    for plan in plans:
        up = nominal(kept.done(plan), 0.0).C_pn[..., 2]
        assert np.degrees(np.arccos(up @ up[0]).max()) < 50.5


@pytest.mark.thorough
def test_narrow_limits_are_gone_to_and_fro_between():
    narrow = space(f'{FAST}\nmiddle_limit = "40 deg"\ncable_limit = "40 deg"')
    assert narrow.allowed.most > 50
    assert np.isfinite(narrow.cost(narrow.draw(np.random.default_rng(0))))


def test_what_a_plan_hardly_shows_is_named(usual):
    one_axis = ((0, usual.allowed.slots),)
    left = dict(zip(usual.names, usual.bound(one_axis), strict=True))
    assert set(usual.hardly(one_axis)) == {name for name, v in left.items() if v > 0.5}
    assert len(usual.hardly(one_axis)) > 10
    rng = np.random.default_rng(6)
    assert not usual.hardly(min((usual.draw(rng) for _ in range(50)), key=usual.cost))


def test_segments_that_just_fit():
    tight = space(wanted='total = "5370 s"\nshortest = "1340 s"')
    assert len(tight.draw(np.random.default_rng(0))) <= 4


def test_latitudes_are_read_before_the_search():
    for text, said in (('["40"]', "optimise.latitudes"), ('["95 deg"]', "a latitude of 95 deg")):
        with pytest.raises(FoucaultError, match=said):
            space(latitudes=text)
    assert space(latitudes='["3 deg", "3 deg"]').cases == (
        "the site",
        "latitude 3 deg",
        "cluster 1",
    )


def test_one_axis_leaves_coefficients_unseen():
    with refuses("optimise.unseen", "No plan that is allowed shows") as caught:
        space(wanted='axes = "x"')
    assert "turns about x, one at a time, at 0.2 deg/s for 5400 s" in caught.value.message


def test_what_does_not_count_may_be_unseen():
    with pytest.raises(FoucaultError) as caught:
        space(wanted='axes = "x"')
    names = caught.value.message.split("that count: ")[1].split(". Allowed")[0].split(", ")
    weights = ", ".join(f'"{name}" = 0' for name in names)
    assert set(space(wanted=f'axes = "x"\nweights = {{ {weights} }}').unseen) == set(names)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("procedure", "wanted", "code", "said"),
    [
        (FAST, 'total = "1000 s"', "optimise.time", "turn the cluster through 200 deg"),
        (FAST, 'shortest = "1500 s"', "optimise.segment", "fit only 3 times into 5400 s"),
        (FAST, 'rates = ["0.3 deg/s"]', "optimise.rate", "asks for 0.3 deg/s"),
        (RESTING, "", "optimise.rate", "asks for 0 deg/s"),
        (FAST, 'rates = ["0 deg/s"]', "optimise.rate", "asks for 0 deg/s"),
        (f"{FAST}\n{LOCKED}", "", "optimise.limits", "cable limit 1 deg"),
        (FAST, 'weights = { "gyro.bias" = 2.0 }', "optimise.weight_name", "'gyro.bias'"),
    ],
)
def test_refuses(procedure, wanted, code, said):
    with refuses(code, match=said):
        space(procedure, wanted)
