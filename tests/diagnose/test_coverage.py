"""Which orientations are there, and which are missing, in words."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.detect.coverage import coverage, direction_words
from foucault.plans.directions import spread_directions

SIX = np.concatenate([np.eye(3), -np.eye(3)])


def test_even_coverage_misses_nothing():
    seen = coverage(spread_directions(24))
    assert seen.missing == ()
    assert seen.half_space < -0.5
    assert seen.flatness == pytest.approx(1.0, abs=0.05)


def test_six_faces_leave_the_corners():
    seen = coverage(SIX)
    assert seen.largest_gap == pytest.approx(np.arccos(1 / np.sqrt(3)), abs=0.01)
    assert all(words.count("x") == words.count("y") == words.count("z") == 1
               for _, words in seen.missing)  # fmt: skip


def test_one_missing_face_is_named_first():
    up_b = spread_directions(60)
    seen = coverage(up_b[up_b[:, 2] > -0.5])
    direction, words = seen.missing[0]
    assert words == "-z up"
    assert direction == pytest.approx([0, 0, -1])
    assert seen.half_space < 0


def test_a_half_space_and_a_plane():
    up_b = spread_directions(60)
    assert coverage(up_b[up_b[:, 0] > 0.05]).half_space > 0
    a = np.linspace(0, 6, 20)
    flat = coverage(np.stack([np.cos(a), np.sin(a), 0 * a], 1))
    assert flat.flatness == pytest.approx(0, abs=1e-12)
    assert {"+z up", "-z up"} <= {words for _, words in flat.missing}
    assert coverage(SIX[:2]).flatness == 0.0


@pytest.mark.parametrize(
    ("up_b", "words"),
    [
        ([0, 0, 1], "+z up"),
        ([0.05, -0.99, 0.05], "-y up"),
        ([0.7, 0, -0.71], "between -z and +x up"),
        ([0.6, 0.58, -0.56], "between +x, +y and -z up"),
    ],
)
def test_words_for_directions(up_b, words):
    assert direction_words(np.array(up_b, float)) == words
