"""The guide on a table: positions are ticked as they come, in any order, and none is forgotten."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign
from foucault.capture import ways
from foucault.capture.said import Words
from foucault.logs.description import LogDescription
from foucault.plans.directions import positions
from foucault.tables import Log

USED = LogDescription.model_validate({
    "file": "live", "time": {"column": 0, "unit": "s"},
    "gyro": {"columns": [1, 2, 3], "unit": "rad/s"},
    "accel": {"columns": [4, 5, 6], "unit": "m/s^2"},
})  # fmt: skip


def told(name: str = "norm_observation", **settings) -> campaign.Campaign:
    out = campaign.parse(campaign.template(name), f"{name}.toml")
    session = out.session.model_copy(update={"rest_time": 12.0, "turns": 1})
    chosen = out.settings.model_copy(update={"spin_rate": np.radians(20.0)} | settings)
    return replace(out, session=session, settings=chosen)


def made(name: str = "norm_observation", seed: int = 3, **settings) -> Log:
    """A session of the table, without its angles: what an instrument alone sends."""
    return replace(campaign.simulate(told(name, **settings), seed).simulation.log, table=None)


def guided(name: str, log: Log, want: dict[str, str] | None = None, **settings):
    guide, said, tasks = ways.guide_of(ways.Asked(told(name, **settings), want=want), USED), [], []
    words = Words.of()
    assert guide.done == (0, len(guide.way.plan))
    for k in range(0, len(log), 20):
        guide.add(log[k : k + 20])
        said.append(guide.done[0])
        tasks.append(words.task(guide))
        if guide.stopped:
            break
    return guide, said, tasks


@pytest.mark.thorough
@pytest.mark.parametrize("name", [
    "norm_observation", "multi_position", "turntable",
])  # fmt: skip
def test_positions_are_ticked_to_the_verdict(name):
    guide, said, tasks = guided(name, made(name))
    assert guide.done == (24, 24) and guide.stopped == "enough"
    assert said == sorted(said) and set(said) == set(range(25))
    assert tasks[0].startswith("Position 1 (30, 0, -31.72 deg)") and "0 of 24 done" in tasks[0]
    assert any(t.startswith("Spin in position 13") for t in tasks)
    assert guide.result is not None and str(guide.result.verdict.level) == "pass"
    # What the plan foresees is what the calibration then states.
    ratio = guide.result.coefficients.sd / guide.way.wanted.sd
    assert (ratio < 1.6).all() and (ratio > 0.4).all(), ratio
    assert not guide.mistakes


@pytest.mark.thorough
def test_in_another_order_with_one_forgotten_and_one_of_no_list():
    angles = positions("icosahedron 12")[1]
    other = angles[[5, 3, 0, 8, 11, 1, 2, 10, 9, 7, 6]]  # without the fifth
    other = np.insert(other, 4, [0.0, np.radians(90.0), 0.0], axis=0)
    other = [[f"{np.degrees(a):.9f} deg" for a in row] for row in other]
    guide, said, tasks = guided("norm_observation", made(positions=other))
    assert guide.done == (22, 24) and not guide.stopped
    assert guide.step.name.startswith("5 ") and guide.step.kind == "rest"
    left = [k for k in range(24) if not guide.way.ticked[k]]
    assert left == [4, 16]
    assert {m.key for m in guide.mistakes} == {"unlisted"} and len(guide.mistakes) == 2
    assert "none of the list" in Words.of().wrong(guide.mistakes[0])
    assert said[-1] == 22 and "22 of 24 done" in tasks[-1]


def test_it_stops_when_enough_is_known():
    want = {"accel.scale": "2 percent", "accel.bias": "0.1 m/s^2"}
    guide, said, _ = guided("norm_observation", made(), want)
    assert guide.stopped == "enough" and 4 < said[-1] < 24


@pytest.mark.thorough
def test_accelerometers_alone_have_no_spins():
    log = made()
    used = LogDescription.model_validate({
        "file": "live", "time": {"column": 0, "unit": "s"},
        "accel": {"columns": [4, 5, 6], "unit": "m/s^2"},
    })  # fmt: skip
    guide = ways.guide_of(ways.Asked(told()), used)
    for k in range(0, len(log), 20):
        guide.add(replace(log[k : k + 20], gyro=None))
        if guide.stopped:
            break
    assert guide.done == (12, 12) and guide.stopped in ("enough", "list")
