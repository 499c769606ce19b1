"""A motion before a hand-over that shows more."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

from foucault import campaign
from foucault.campaign import optimisation
from foucault.errors import FoucaultError
from foucault.models.earth import Site
from foucault.plans.transfer import Step
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment import Session, Settings, Wanted, foresee, space

SITE = Site.at(np.radians(32.0), 1000.0)


def made(wanted=None, **session):
    session = Session(**{"profile": "straight", "message_rate": 2.0, **session})
    perfect = Settings(left_out=False)
    return space(
        Beforehand(
            perfect, wanted=wanted or Wanted(), session=session, site=SITE, noise=None, prior={}
        )
    )


@pytest.fixture(scope="module")
def found():
    return made()


def test_what_a_search_reckons_with_is_nearly_what_would_be_stated(found):
    """Fewer samples, and messages each as good as those it stands for."""
    often = made(message_rate=10.0)
    plan = (Step("s_turn", 20, 60), Step("accelerate", 80, 20))
    motion = often.allowed.profile(plan)
    np.testing.assert_allclose(often.quick(motion), often.stated(motion, "the site"), rtol=0.15)


def test_manoeuvres_cost_less_than_straight_on_and_each_shows_what_it_should(found):
    straight, turn = (Step("straight", 0, 100),), (Step("s_turn", 20, 60),)
    assert found.cost(straight) == pytest.approx(0.0, abs=1e-9)
    assert found.cost(turn) < -0.5
    gain = found.quick(found.allowed.profile(turn)) / found.quick(found.allowed.profile(straight))
    at = dict(zip(found.names, gain, strict=True))
    assert at["gyro.scale.z"] < 0.3 and at["accel.bias.x"] < 0.5
    assert at["position after the outage"] < 0.9


def test_aim_at_the_position_counts_it_alone():
    aimed = made(Wanted(aim="position"))
    assert aimed.weights.tolist() == [0.0] * (len(aimed.names) - 1) + [1.0]
    assert aimed.kinds[-1] == "length" and aimed.unseen == ()


def test_limits_that_leave_nothing_are_refused():
    with pytest.raises(FoucaultError, match="begins at 75 m/s cannot keep to 20 to 30 m/s"):
        made(Wanted(slowest=20.0, fastest=30.0))
    with pytest.raises(FoucaultError, match="60 s are too short for 8 manoeuvres of 8 s"):
        made(Wanted(total=60.0))


@pytest.mark.thorough
def test_own_manoeuvres_are_foretold():
    """A straight run of one's own is the straight run that is built in."""
    own = Session.model_validate({
        "profile": "straight", "manoeuvres": [{"straight": "240 s"}], "message_rate": "2 Hz",
    })  # fmt: skip
    assert own.motion.name == "own manoeuvres" and own.motion.outage
    built = foresee(
        Beforehand(Settings(), session=Session(profile="straight", message_rate=2.0), site=SITE)
    )
    told = foresee(Beforehand(Settings(), session=own, site=SITE))
    np.testing.assert_array_equal(told.coefficients.cov, built.coefficients.cov)
    faster = own.model_copy(update={"speed": 60.0, "heading": 1.0})
    assert (faster.motion.start.speed, faster.motion.start.heading) == (60.0, 1.0)


@pytest.mark.thorough
def test_a_search_finds_a_motion_that_the_campaign_then_does(tmp_path):
    file = tmp_path / "campaign.toml"
    text = campaign.template("transfer_alignment")
    file.write_text(text + '[optimise]\ntotal = "100 s"\nmost = 4\n')
    asked = campaign.load(file)
    best = optimisation.run(asked, tmp_path / "search", restarts=1, evaluations=40, workers=1)
    assert best.duration == 100.0 and not any("BROKEN" in n.words for n in best.needs)
    plan = tomllib.loads((tmp_path / "search" / "campaign.toml").read_text())
    assert plan["simulate"]["manoeuvres"]
    then = campaign.load(tmp_path / "search" / "campaign.toml")
    assert then.session.motion.hand_over == 100.0
    again = optimisation.run(asked, tmp_path / "again", restarts=1, evaluations=40, workers=1)
    assert json.dumps(again.sd) == json.dumps(best.sd) and again.steps == best.steps
