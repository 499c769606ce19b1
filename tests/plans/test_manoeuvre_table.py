"""Manoeuvres of a campaign file."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from foucault.plans.manoeuvres import (
    Accelerate,
    Climb,
    ManoeuvreTable,
    Straight,
    STurn,
    Sway,
    Turn,
    plain_manoeuvre,
)

SAID = [
    ({"straight": "20 s"}, Straight(20.0)),
    ({"turn": "-90 deg", "time": "12 s"}, Turn(-np.pi / 2, 12.0)),
    ({"turn": "90 deg", "time": "12 s", "flat": True}, Turn(np.pi / 2, 12.0, banked=False)),
    ({"s_turn": "25 deg", "time": "40 s"}, STurn(np.radians(25.0), 40.0)),
    ({"accelerate": "85 m/s", "time": "15 s"}, Accelerate(85.0, 15.0)),
    ({"climb": "-50 m", "time": "14 s"}, Climb(14.0, height=-50.0)),
]


@pytest.mark.parametrize(("said", "segment"), SAID)
def test_what_is_said_is_done_and_written_as_it_was_said(said, segment):
    assert ManoeuvreTable.model_validate(said).segment() == segment
    assert plain_manoeuvre(segment) == said


def test_two_sways_are_not_the_same_one():
    table = ManoeuvreTable.model_validate(
        {"sway": ["0 deg", "1 deg", "5 deg"], "period": "9 s", "time": "60 s"}
    )
    one, other = table.segment(0), table.segment(1)
    assert isinstance(one, Sway) and one.angles == (0.0, np.radians(1.0), np.radians(5.0))
    assert one != other


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({}, "and has none of them"),
        ({"turn": "9 deg", "climb": "9 m", "time": "9 s"}, "has turn and climb"),
        ({"turn": "9 deg"}, "turn needs `time`"),
        ({"straight": "9 s", "time": "9 s"}, "straight says how long by itself"),
        ({"sway": ["1 deg"] * 3, "time": "9 s"}, "a sway with a `period`"),
        ({"turn": "9 deg", "time": "9 s", "period": "9 s"}, "`period` goes with a sway"),
        ({"climb": "9 m", "time": "9 s", "flat": True}, "`flat` goes with turn and s_turn"),
        ({"straight": "-9 s"}, "greater than 0"),
    ],
)
def test_what_cannot_be_is_refused(said, told):
    with pytest.raises(ValidationError, match=told):
        ManoeuvreTable.model_validate(said)
