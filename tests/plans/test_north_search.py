"""Search for stops of a north seeker: its quick bound, its limits, and what it finds."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf, isfinite, log, sqrt

import numpy as np
import pytest

from foucault import units
from foucault.campaign import north as north_campaign
from foucault.campaign import reading, running
from foucault.detect.dwells import find_dwells
from foucault.errors import FoucaultError
from foucault.estimate.north import Known as Told
from foucault.estimate.north import solve
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import turned
from foucault.plans import north_orders as orders
from foucault.plans.north import Known, NorthSpace, Rig, Schedule, schedule
from foucault.plans.north_stops import Conditions
from foucault.plans.optimise import Descent, compare, descend
from foucault.procedures import north_seeking
from foucault.procedures.record import Beforehand
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    SeekerErrors,
    Stops,
    simulate_north,
)
from refusals import refuses

LATITUDE = np.radians(30.0)
ARW = units.parse("0.003 deg/sqrt(h)", "angle random walk")
SLOW = units.parse("0.03 deg/h", "angular rate")
DRIFT = units.parse("0.01 deg/h", "angular rate") / 75.0
ACCEL = TriadNoise(white=units.parse("5 ug/sqrt(Hz)", "velocity random walk"))
FLOOR = ARW / sqrt(300.0) / (EARTH_RATE * np.cos(LATITUDE))
"""Of the heading, if all of 300 s is spent on east and west [rad]."""


def space(slow=0.0, order=orders.PUBLISHED, rig=None, offset_sd=inf, **known):
    rig = rig or Rig(total=300.0, move=0.0, shortest=5.0)
    noise = ImuNoise(ACCEL, TriadNoise(white=ARW, bias_instability=slow))
    told = Known(Conditions(LATITUDE, noise, offset_sd=offset_sd), **known)
    return NorthSpace.of(rig, told, schedule(order.index, order.share, rig), order.name)


def searched(one: NorthSpace, evaluations=1200, restarts=1) -> Descent:
    found = [descend(one, np.random.default_rng(k), evaluations) for k in range(restarts)]
    return min((d for d in found if d is not None), key=lambda d: d.cost)


CASES = {
    "white": space(),
    "slow": space(SLOW),
    "moves": space(SLOW, rig=Rig(total=400.0, move=10.0, shortest=5.0, settle=1.0)),
    "drift ignored": space(drift=DRIFT, solved="none"),
    "drift free": space(SLOW, drift=DRIFT, solved="linear"),
    "drift weighed": space(drift_sd=DRIFT),
    "auto, palindrome": space(order=orders.PALINDROME, drift=DRIFT),
    "offset known": space(SLOW, order=orders.positions(3), offset_sd=1e-7),
    "on the case": space(on_case=True),
    "from north": space(SLOW, order=orders.PAIR, rough_sd=np.radians(3.0), on_case=True),
}


@pytest.mark.parametrize("case", CASES)
def test_the_quick_bound_is_what_the_solution_states(case):
    one = CASES[case]
    rng = np.random.default_rng(3)
    for plan in (one.reference, *(one.draw(rng) for _ in range(4))):
        quick = one.bound(plan)
        if isfinite(quick):
            # Beside the heading the solution weighs a latitude and tilts that are not quite known.
            assert one.sd(plan, "level")[0] == pytest.approx(quick, rel=2e-3)


def test_plans_keep_to_the_rig_and_fill_the_time():
    rig = Rig(
        total=400.0, move=10.0, shortest=12.0, settle=1.0, most=9, index_limit=np.radians(135.0),
        index_step=np.radians(45.0),
    )  # fmt: skip
    one = space(SLOW, rig=rig)
    rng = np.random.default_rng(1)
    plan, costs = one.draw(rng), []
    for k in range(400):
        assert isinstance(plan, Schedule) and 2 <= len(plan) <= 9
        assert set(plan.index) <= {n * 45_000 for n in range(-3, 4)} - {0}  # 0 has no opposite
        assert min(plan.dwell) >= 130
        assert all(a != b for a, b in zip(plan.index, plan.index[1:], strict=False))
        assert one.duration(plan) == pytest.approx(400.0, abs=1e-9)
        costs.append(one.cost(plan))
        plan = one.moved(plan, rng, 1.0 - k / 400)
    assert np.isfinite(costs).any()
    # What the base cannot do is told apart.
    assert one.cost(one.reference) == inf
    assert one.cost(Schedule((90_000, -90_000, 45_000), (1270, 1270, 1260))) == inf
    lone = space(rig=Rig(total=300.0, move=0.0, shortest=5.0, opposite=False))
    assert isfinite(lone.cost(Schedule((90_000, -90_000, 45_000), (1000, 1000, 1000))))


def test_the_table_and_the_changes_say_the_same():
    one = space(rig=Rig(total=330.0, move=10.0, shortest=5.0))
    plan = one.reference
    assert one.steps(plan)[0] == ("start (s)", "index (deg)", "dwell (s)")
    assert one.steps(plan)[2] == ("85", "180", "75")
    assert one.changes(plan)["simulate"]["order"][1] == {"index": "180 deg", "dwell": "75 s"}
    assert one.cost(plan) == 0.0


@pytest.mark.thorough
def test_white_noise_is_not_beaten_and_four_positions_are_found():
    one = CASES["white"]
    found = searched(one, 4000)
    sd = one.sd(found.plan, "level")[0]
    bound = FLOOR * sqrt(2.0)
    assert bound * (1 - 1e-6) < sd < bound * 1.002
    assert len(found.plan) <= 6  # of plans that are alike the simpler


@pytest.mark.thorough
def test_a_drift_that_is_ignored_cancels_in_fewer_stops_than_the_palindrome_has():
    one = space(drift=DRIFT, solved="none", rig=Rig(total=300.0, move=0.0, shortest=5.0, most=6))
    found = searched(one, 2000)
    still = space(solved="none")
    # All of the error is noise, and no more of it than four positions have.
    noise = still.bound(found.plan)
    drift = sqrt(max(one.bound(found.plan) ** 2 - noise**2, 0.0))
    assert noise < FLOOR * sqrt(2.0) * 1.01
    assert drift < 0.1 * sqrt(one.bound(one.reference) ** 2 - still.bound(one.reference) ** 2)
    assert len(found.plan) <= 6 < len(orders.PALINDROME)


@pytest.mark.thorough
def test_slow_noise_is_beaten_by_more_stops_as_far_as_moves_allow():
    one = CASES["slow"]
    found = searched(one)
    table = compare(one, found.plan)
    assert table.cases == ("level", "tilted by up to 10 deg", "at latitude 60 deg")
    white = FLOOR * sqrt(2.0)
    at, best = table.reference_sd[0, 0], table.sd[0, 0]
    assert best**2 - white**2 < 0.2 * (at**2 - white**2)
    assert (table.geometric_mean < 0.95).all()
    moving = CASES["moves"]
    fewer = best_moving()
    assert len(fewer) < len(found.plan)
    named = (
        orders.PALINDROME,
        orders.PUBLISHED.repeated(2),
        orders.SEQUENTIAL,
        orders.positions(6),
    )
    for order in named:
        named_plan = schedule(order.index, order.share, moving.allowed)
        assert moving.bound(fewer) <= moving.bound(named_plan) * 1.001


@pytest.mark.thorough
def test_a_rough_heading_gains_the_root_of_two():
    one = space(rough_sd=np.radians(2.0), on_case=True)
    found = searched(one)
    assert one.sd(found.plan, "level")[0] < FLOOR * 1.003
    assert {abs(a) for a in found.plan.index} <= set(range(85_000, 96_000))
    # One accelerometer on the base sees no tilt by stops that are opposite.
    base = space(rough_sd=np.radians(2.0))
    assert base.cost(found.plan) == inf
    seen = searched(base)
    assert FLOOR < base.sd(seen.plan, "level")[0] < 1.1 * FLOOR


@cache
def best_moving() -> Schedule:
    return searched(CASES["moves"]).plan


@cache
def drawn(found: bool):
    """Errors of 2400 set-ups with slow noise, found stops or the published order."""
    one = CASES["moves"]
    plan = best_moving() if found else one.reference
    index, _, dwell = one.allowed.times(plan)
    headings = np.arange(2400) * np.radians(30.0) + np.radians(15.0)
    setups = tuple(Placement(str(i), float(h)) for i, h in enumerate(headings))
    noise = one.known.conditions.noise
    site = Site.at(LATITUDE)
    made = simulate_north(
        NorthPlan(setups, Stops(index, dwell, 11.0), 1e5), model=ImuModel(), noise=noise,
        site=site, errors=SeekerErrors(gyro_offset=1e-6), reference=False, seed=4,
    )  # fmt: skip
    drift = {"drift_sd": inf} if one.sd(plan, "level")[0] and len(plan) > 4 else {}
    pairs = reduce(find_dwells(made.log), noise, Nuisance(**drift))
    fixes = solve(pairs, Told(site.gravity, site.latitude))
    return turned(fixes.angles[:, 0] - headings), one.sd(plan, "level")[0]


@pytest.mark.thorough
def test_set_ups_err_as_was_predicted():
    for found in (True, False):
        error, sd = drawn(found)
        low, high = chi_square_limits(len(error), tests=2)
        assert low < np.sum(error**2) / sd**2 < high
    better, worse = (np.mean(drawn(f)[0] ** 2) for f in (True, False))
    # Where the errors are independent, the log of the ratio has variance 4 / n.
    assert log(better / worse) < -2.33 * sqrt(4 / 2400)


CAMPAIGN = """
[site]
latitude = "30 deg"
[log]
file = "log.csv"
setup = "setup"
time = { column = "time", unit = "s" }
index = { column = "index", unit = "rad" }
gyro = { column = "gyro", unit = "rad/s" }
accel = { columns = ["ax", "ay"], unit = "m/s^2", reads = "specific force" }
heading = { column = "heading", unit = "rad" }
averaged = { column = "dwell", unit = "s" }
[procedure]
name = "north_seeking"
index_limit = "180 deg"
MORE
[noise.gyro]
white = "0.003 deg/sqrt(h)"
bias_instability = "0.03 deg/h"
[noise.accel]
white = "5 ug/sqrt(Hz)"
[simulate]
dwell = "60 s"
move = "5 s"
accelerometers = "case"
"""


def campaign_space(more="", **wanted):
    campaign = reading.parse(CAMPAIGN.replace("MORE", more))
    return north_seeking.space(Beforehand(
        campaign.settings, campaign.session, campaign.site, campaign.noise, campaign.prior,
        wanted=north_seeking.Wanted.model_validate(wanted),
    ))  # fmt: skip


def written(changes) -> str:
    """The campaign with what a plan changes, as in the file."""
    order = ", ".join(
        f'{{ index = "{s["index"]}", dwell = "{s["dwell"]}" }}'
        for s in changes["simulate"]["order"]
    )
    text = CAMPAIGN + f"order = [{order}]\n"
    if "headings" in changes["simulate"]:
        text += f"headings = {changes['simulate']['headings']}\n"
    more = "".join(f'{k} = "{v}"\n' for k, v in changes.get("procedure", {}).items())
    return text.replace("MORE", more)


def test_a_found_plan_runs_as_a_campaign(tmp_path):
    one = campaign_space()
    assert one.reference_name == "published order" and one.duration(one.reference) == 255.0
    assert isfinite(one.cost(one.reference))  # 270 deg is -90 deg to a cable of 180 deg
    plan = searched(one, 400).plan
    session = running.simulate(reading.parse(written(one.changes(plan)), tmp_path / "c.toml"), 5)
    log = session.simulation.log
    assert len(log.time) == 12 * len(plan)
    assert np.abs(log.index).max() <= np.pi
    result = north_seeking.calibrate(log, site=session.campaign.site,
                                     settings=session.campaign.settings,
                                     noise=session.campaign.noise)  # fmt: skip
    assert result.verdict.level == "pass"
    again = reading.parse(written(one.changes(plan))).session
    assert again.called == "stops of the campaign"
    assert again.motion().length == pytest.approx(255.0)


def test_a_plan_from_north_is_for_a_fix(tmp_path):
    one = campaign_space(rough_sd="2 deg")
    plan = searched(one, 400).plan
    assert one.steps(plan)[0][1] == "index from north (deg)"
    path = tmp_path / "campaign.toml"
    path.write_text(written(one.changes(plan)))
    made = running.simulate(reading.load(path), 3)
    folder = tmp_path / "made"
    running.save_session(made, folder)
    survey = north_campaign.run(folder / "campaign.toml")
    sd = float(survey.fixes.sd[0, 0])
    assert sd == pytest.approx(one.sd(plan, "level")[0], rel=0.01)
    assert abs(turned(survey.fixes.angles[:, 0])[0]) < 4 * sd + np.radians(0.2)


def test_what_is_wanted_is_checked():
    for words, said in (
        ({"weights": {"headin": 1.0}}, "optimise.weight_name"),
        ({"time": "12 s"}, "north_search.too_short"),
    ):
        with refuses(said):
            campaign_space(**words)
    with pytest.raises(FoucaultError, match="No plan that is allowed shows 1 of the"):
        campaign_space('index_step = "50 deg"\n')
    with pytest.raises(FoucaultError, match="direction, and that is a heading only where the lat"):
        campaign_space("unknown_latitude = true\n", rough_sd="2 deg")
    campaign = reading.parse(CAMPAIGN.replace("MORE", ""))
    with pytest.raises(FoucaultError, match="does not say how noisy the gyro is, and the best"):
        north_seeking.space(Beforehand(
            campaign.settings, wanted=north_seeking.Wanted(), session=campaign.session,
            site=campaign.site, noise=None, prior={},
        ))  # fmt: skip


def test_a_search_that_is_not_told_the_noise_of_the_accelerometers_says_so():
    campaign = reading.parse(CAMPAIGN.replace("MORE", ""))
    gyro_only = replace(campaign.noise, accel=TriadNoise())
    for noise, codes in ((campaign.noise, []), (gyro_only, ["preflight.accel_noise"])):
        made = north_seeking.space(Beforehand(
            campaign.settings, wanted=north_seeking.Wanted(), session=campaign.session,
            site=campaign.site, noise=noise, prior={},
        ))  # fmt: skip
        assert [f.code for f in made.findings] == codes
