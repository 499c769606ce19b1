"""Rows of a long log that do not belong to the others for a moment."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.infer.snooping import mishaps, uneven


def made(seed, rows=400, unknowns=12, scale=1.0):
    """Return white residuals, slopes and what was known beforehand: noise is `scale` times it."""
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((rows, 3, unknowns))
    residuals = scale * rng.standard_normal((rows, 3)) + slopes @ rng.standard_normal(unknowns)
    return residuals, slopes, np.eye(unknowns), np.zeros(unknowns)


@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0])
def test_noise_of_any_size_is_even(scale):
    assert sum(len(mishaps(*made(seed, scale=scale))) for seed in range(100)) == 0


@pytest.mark.parametrize("at", [[0], [250], [395], [40, 300]])
def test_places_are_found_where_they_begin(at):
    residuals, *rest = made(1)
    for k in at:
        residuals[k : k + 5] += 100.0
    assert mishaps(residuals, *rest).tolist() == at


def test_what_is_everywhere_or_lasts_is_none():
    residuals, *rest = made(1)
    often, long = residuals.copy(), residuals.copy()
    often[::40] += 100.0
    long[150:350] += 100.0
    assert len(mishaps(often, *rest)) == 0
    assert len(mishaps(long, *rest)) == 0


def test_squares_of_noise_are_seldom_uneven():
    """Fewer than 1 in 1,000 of 300 rows, as `UNEVEN` says 1 in 10,000."""
    squares = np.random.default_rng(2).chisquare(3, (3000, 300))
    assert sum(uneven(square, 3)[0] for square in squares) <= 3
