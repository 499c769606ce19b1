"""A reference with another clock, or on another course, is told from a navigation that drifts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.navigation import clock, clock_offset, course, error_of
from foucault.models.rotation import matrix_of
from foucault.navigate.increments import increments_of
from foucault.navigate.strapdown import navigate
from make_navigation import DRIVE, START, errors, logged, reference_of

TRUE, _ = errors()


@pytest.fixture(scope="module")
def drive():
    """A drive with a heading that is off and sensors that err, and its reference."""
    run = logged(DRIVE, TRUE)
    state = run.truth.state(2400)
    off = replace(state, C_nb=matrix_of(START.heading + 0.01, START.pitch, START.roll))
    return reference_of(run), navigate(increments_of(run.log), off, first=2400)


@pytest.mark.parametrize("late", [-3.0, -0.2, 0.2, 1.0, 5.0])
def test_a_clock_that_is_off_is_found(drive, late: float) -> None:
    known, trajectory = drive
    shifted = replace(known, time=known.time + late)
    found = error_of(trajectory, shifted)
    seen, speed = clock_offset(found, shifted)
    assert seen == pytest.approx(late, rel=0.1, abs=0.03) and 5 < speed < 20
    (said,) = clock(found, shifted)
    assert said.code == "navigate.clock"
    assert ("late" if late > 0 else "early") in said.message and "Compare the clocks" in said.cure


def test_drift_and_a_wrong_heading_are_no_clock(drive) -> None:
    known, trajectory = drive
    found = error_of(trajectory, known)
    assert found.horizontal[-1] > 1
    assert clock(found, known) == () and course(found, known) == ()


def test_another_course_is_named(drive) -> None:
    known, _ = drive
    run = logged(DRIVE, noise=None)
    state = run.truth.state(2400)
    turned = matrix_of(START.heading + np.radians(30), START.pitch, START.roll)
    start = replace(state, C_nb=turned)
    trajectory = navigate(increments_of(run.log), start, first=2400, vertical="held")
    (said,) = course(error_of(trajectory, known), known)
    assert said.code == "navigate.course" and "30 deg apart" in said.message
    assert "one sign wrong in both triads" in said.cure


def test_what_cannot_show_it_says_nothing(drive) -> None:
    known, trajectory = drive
    fast = replace(known, position=None)
    found = error_of(trajectory, fast)
    assert clock(found, fast) == () and course(found, fast) == ()
    names = ("time", "position", "velocity_n", "angles")
    few = error_of(trajectory, replace(known, **{k: getattr(known, k)[::20] for k in names}))
    assert np.isnan(clock_offset(few, known)[0])
