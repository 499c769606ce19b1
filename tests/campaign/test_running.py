"""What is said of a result by the log that it is from."""

from __future__ import annotations

import dataclasses

from foucault.campaign.running import _stuck_first
from foucault.errors import finding
from foucault.result import Level, Verdict
from make_result import make_result

STUCK = finding("log.stuck", triad="gyro", axis="y", start="0", end="153.32")


def test_an_axis_that_did_not_move_is_the_first_reason():
    bad = Verdict(Level.UNUSABLE, ("A gyro scale factor error of -100 % is a wrong unit.",))
    result = dataclasses.replace(make_result(), verdict=bad, findings=(STUCK,))
    first, second = _stuck_first(result).verdict.reasons
    assert first.startswith("gyro y repeats one reading") and second == bad.reasons[0]
    good = dataclasses.replace(make_result(), findings=(STUCK,))
    assert _stuck_first(good).verdict.reasons == (f"{STUCK.message} {STUCK.cure}",)
    assert _stuck_first(make_result()).verdict == make_result().verdict
