"""Orders of faces that are sought: every one calibrates, and what drifts makes faces repeat."""

from __future__ import annotations

import json
import re
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from foucault import campaign
from foucault.campaign import optimisation
from foucault.plans.optimise import descend
from foucault.procedures import ferraris, load, six_position
from foucault.procedures.on_faces import FACE_NAMES, FACES, FaceSpace


@cache
def space_of(name: str, wanted: str = "", placed: str = "") -> FaceSpace:
    text, _, _ = campaign.template(name).partition("# [optimise]")
    if placed:
        text = text.replace('# placement_sd = "5 arcmin"', f'placement_sd = "{placed}"', 1)
    return optimisation.space_of(campaign.parse(f"{text}\n[optimise]\n{wanted}\n"))


def test_every_plan_rests_on_each_face_in_the_time_there_is() -> None:
    bench = space_of("ferraris", 'time = "3 min"\nrests = 12\nrest_time = "4 s"').allowed
    rng, plan, kept, turned = np.random.default_rng(2), None, 0, set()
    for _ in range(400):
        plan = bench.draw(rng) if plan is None else bench.moved(plan, rng, 0.5)
        if plan is None:
            continue
        kept += 1
        rest, faces, back = plan
        assert set(faces) == set(FACES) and len(faces) <= 12 and rest >= 4
        assert all(a != b for a, b in pairwise(faces))
        done = bench.steps(plan)
        assert 180 - 0.1 * len(done.rest_time) <= done.duration <= 180 + 1e-6
        # A turn about each axis, whatever repeats, and one back.
        assert len(done.rest_time) == len(faces) + 3 * (1 + bool(back))
        turned |= {back}
    assert kept > 100 and turned == {None, 5.0, 10.0}


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["six_position", "ferraris"])
def test_faces_are_rested_on_again_where_that_shows_more(name: str) -> None:
    # Placements that nobody declares may hide behind what counts: more of them is what they want.
    space = space_of(name, placed="1 arcmin")
    found = descend(space, np.random.default_rng(0), 25)
    rest, faces, back = found.plan
    assert space.reference[1] == FACE_NAMES and len(faces) > len(FACE_NAMES) and found.cost < -0.02
    assert all(limit.kept for limit in space.needs(found.plan))
    # The file does what was judged.
    told = space.changes(found.plan)["simulate"]
    turned = {"back_time": told["back_time"]} if back else {}
    given = {"order": told["order"], "rest_time": rest} | turned
    session = load(name).Session.model_validate(given)
    assert session.faces == faces
    # Both senses, at two rates: with one of each a scale that hangs on them is not seen.
    assert (back == 10.0) is (name == "ferraris")
    assert session.plan(load(name).Settings(), 0).duration == pytest.approx(
        space.duration(found.plan)
    )


def test_only_sizes_of_what_drifts_ask_for_faces_again() -> None:
    """With white noise alone a rest again costs the time of a move and shows nothing."""
    text, _, _ = campaign.template("six_position").partition("# [optimise]")
    text = text.replace("[instrument]\n", "[instrument]\nleft_out = false\n")
    text = text.replace('# placement_sd = "5 arcmin"', 'placement_sd = "0 arcmin"')
    space = optimisation.space_of(campaign.parse(f"{text}\n[optimise]\n"))
    again = space.allowed.filled([*FACE_NAMES, *FACE_NAMES])
    assert space.cost(again) > -0.01
    assert space_of("six_position").cost(again) < -0.1


@pytest.mark.parametrize("name", ["six_position", "ferraris"])
def test_a_session_that_begins_on_another_face_is_calibrated_as_it_is_written(name, tmp_path):
    """`simulate` and `calibrate` of a plan that was found, with the file between them."""
    order = ["x_a", "z_a", "z_p", "y_p", "z_a", "y_a", "x_p", "z_a", "x_a"]
    text, _, _ = campaign.template(name).partition("# [optimise]")
    text = re.sub(r"^order = .*$", f"order = {order}", text, flags=re.MULTILINE)
    file = campaign.save_session(campaign.simulate(campaign.parse(text), 5), tmp_path)
    result = campaign.calibrate(campaign.load(file))
    assert 'first_rest = "x down"' in file.read_text() and result.verdict.level != "unusable"
    truth = json.loads((tmp_path / "truth.json").read_text())["coefficients"]
    true = {row["name"]: row["value"] for row in truth}
    c = result.coefficients
    off = (c.values - [true[n] for n in c.names]) / c.sd
    assert np.abs(off).max() < 5


@pytest.mark.parametrize("module", [six_position, ferraris])
def test_an_order_without_a_face_or_with_one_twice_in_turn_is_refused(module) -> None:
    with pytest.raises(ValidationError, match="y_a is missing"):
        module.Session(order=("z_p", "z_a", "x_p", "x_a", "y_p"))
    with pytest.raises(ValidationError, match="z_p twice in turn"):
        module.Session(order=("z_p", "z_p", "z_a", "x_p", "x_a", "y_p", "y_a"))
