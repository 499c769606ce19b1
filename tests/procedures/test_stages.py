"""What an operator is told: stages of every plan lead where the plan leads."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from foucault import campaign
from foucault.models.rotation import exp
from foucault.models.turntable import chain
from foucault.plans.directions import RestPlan, face_plan
from foucault.plans.sequence import quarter_turns
from foucault.plans.tumble import nominal, sequence
from foucault.procedures import PROCEDURES, load
from foucault.procedures.stages import Stage, lasting, stages, stands
from foucault.report import operator


def staged(name: str, *changes: str) -> tuple[Any, tuple[Stage, ...]]:
    """Return the campaign of a template, and its stages."""
    from foucault.campaign.recognised import with_keys

    c = campaign.parse(campaign.template(name), f"{name}.toml")
    c = with_keys(c, changes) if changes else c
    return c, load(name).stages(c.settings, c.session, c.site)


@pytest.mark.parametrize("name", PROCEDURES)
def test_every_procedure_tells_its_operator_what_to_do(name: str) -> None:
    _, found = staged(name)
    assert found
    for one in found:
        assert one.set and one.acts and one.time > 0 and one.move >= 0
        for act in one.acts:
            assert act.words and act.time > 0 and np.isfinite(act.w_b).all()
            assert np.allclose(act.C_nb.T @ act.C_nb, np.eye(3), atol=1e-9)
            assert np.linalg.det(act.C_nb) > 0
    text = operator.page(name, ["a plan"], found)
    assert text.count('role="img"') == len(found) == text.count('type="checkbox"')


@pytest.mark.parametrize("name", ["systematic", "platform_tumble"])
def test_a_stage_ends_where_the_next_begins(name: str) -> None:
    """Of what goes on without a break: each act leads to the attitude of the one after it."""
    acts = [act for one in staged(name)[1] for act in one.acts]
    for act, after in pairwise(acts):
        assert np.allclose(act.C_nb @ exp(act.w_b * act.time), after.C_nb, atol=1e-9)


def test_a_tumble_goes_where_its_commands_lead() -> None:
    plan = sequence("-x +y", float(np.radians(0.5)))
    last = stages(plan)[-1].acts[-1]
    C_np = last.C_nb @ exp(last.w_b * last.time)
    assert np.allclose(C_np, nominal(plan, 0.7).C_pn[-1].T, atol=1e-9)


def test_faces_lie_as_they_are_called_and_turns_are_told() -> None:
    plan = face_plan(angle=2 * np.pi)
    found = stages(plan)
    assert isinstance(plan, RestPlan) and len(found) == 9
    rests = [one.set for one in found if "turned" not in one.set]
    assert rests == ["z up", "z down", "x up", "x down", "y up", "y down"]
    turned = [one for one in found if "turned" in one.set]
    assert [act.words for one in turned for act in one.acts] == [
        "turn 360° about z", "rest", "turn 360° about x", "rest", "turn 360° about y", "rest"
    ]  # fmt: skip
    assert sum(one.time for one in found) == pytest.approx(plan.duration)
    for one, C in zip(found, plan.C_nb, strict=True):
        assert np.allclose(one.shown[2], C[2], atol=1e-9)  # where up is


def test_what_lies_askew_in_a_simulation_is_not_asked_for() -> None:
    told = ["simulate.placement_sd = 2 deg"]
    assert [s.set for s in staged("six_position", *told)[1]] == [
        s.set for s in staged("six_position")[1]
    ]


def test_a_table_is_told_its_angles_and_spins() -> None:
    c, found = staged("norm_observation", "procedure.both_senses = true")
    angles = np.radians([[30.0, 0.0, -31.717474411461]])
    assert found[0].set == "outer 30°, middle 0°, inner -31.7175°"
    assert np.allclose(found[0].shown, chain(angles).C_tk[0], atol=1e-9)
    spun = next(one for one in found if one.turns.any())
    assert [act.words for act in spun.acts] == ["+10°/s, 4 turns", "-10°/s, 4 turns"]
    up = spun.acts[0].C_nb @ spun.acts[0].w_b
    assert np.allclose(up, [0.0, 0.0, c.settings.spin_rate], atol=1e-9)


def test_an_index_turns_clockwise_seen_from_above() -> None:
    _, found = staged("north_seeking", "simulate.headings = 2")
    assert [one.set for one in found][:2] == ["set-up 0, index 0°", "set-up 0, index 180°"]
    quarter = next(one for one in found if one.set == "set-up 0, index 90°")
    assert np.allclose(quarter.shown[:, 1], [1.0, 0.0, 0.0], atol=1e-9)  # y points east
    turning = staged("rate_table")[1][0].acts[0]
    assert turning.w_b @ turning.C_nb[2] > 0


def test_a_spin_is_about_a_level_axis_of_the_mounting() -> None:
    _, found = staged("continuous_spin", 'simulate.mountings = ["x", "-y", "skew"]')
    assert [one.set for one in found] == [
        "x along the spin axis", "-y along the spin axis", "skew to all axes",
    ]  # fmt: skip
    for one in found:
        axis = one.acts[0].C_nb @ one.acts[0].w_b
        assert np.allclose(axis / np.linalg.norm(axis), [1.0, 0.0, 0.0], atol=1e-9)


def test_a_sequence_turns_before_it_rests() -> None:
    plan = quarter_turns("own", ("U", "E", "N"), "+y +z", rest=60.0)
    first, second, third = stages(plan)
    assert [act.words for act in first.acts] == ["rest"]
    assert second.acts[0].words.startswith("turn 90° about y") and second.acts[1].words == "rest"
    assert np.allclose(third.shown, plan.attitudes[-1])


def test_how_it_stands_is_said_by_its_axes() -> None:
    assert stands(np.eye(3)) == "z up"
    assert stands(np.diag([1.0, -1.0, -1.0])) == "z down"
    turned = exp(np.array([np.radians(40.0), 0.0, 0.0]))
    assert stands(turned) == "x level, y 40° up, z 50° up"
    assert [lasting(t) for t in (4.25, 119.0, 150.0, 3600.0)] == [
        "4.25 s", "119 s", "2 min 30 s", "60 min"
    ]  # fmt: skip


def test_a_picture_shows_three_faces_and_where_it_turns() -> None:
    drawn = operator.picture(np.eye(3), np.zeros(3))
    assert drawn.count("<polygon") == 4 and drawn.count("<text") == 5  # the ground too; N and E
    assert 'class="axis3"' in drawn and 'class="axis3 back"' not in drawn  # z is seen from above
    assert "turned" not in drawn and "turned" in operator.picture(np.eye(3), np.ones(3))


def test_a_page_is_laid_out_by_what_it_holds() -> None:
    def kind(name: str, *changes: str) -> str:
        text = operator.page(name, ["<b>"], staged(name, *changes)[1])
        assert "<b>" not in text.partition("<ol>")[0].replace("<body", "")
        return text.partition('<body class="')[2].partition('"')[0]

    assert kind("six_position") == "few" and kind("hand_rotated") == "some"
    assert kind("hand_rotated", "simulate.rests = 40") == "many"
    text = operator.page("", [], staged("hand_rotated", "simulate.rests = 700")[1])
    assert text.count('type="checkbox"') == operator.MOST and "and 200 more" in text
    assert "700 positions" in text


def test_known_angles_are_told_axis_by_axis() -> None:
    told = 'procedure.angle = ["360 deg", "720 deg", "90 deg"]'
    words = [act.words for one in staged("ferraris", told)[1] for act in one.acts]
    assert [w for w in words if "turn" in w] == [
        "turn 90° about z", "turn 360° about x", "turn 720° about y"
    ]  # fmt: skip
