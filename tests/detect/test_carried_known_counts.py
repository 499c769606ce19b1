"""White noise of an instrument that counts, from rests of a few seconds."""

import numpy as np

from foucault.detect.noise import white_and_carried

COUNT, INTERVAL = 1.0, 0.2


def short_rests(seed, white):
    """Means over `INTERVAL` of rests of 1.6 s at rates of some pulses a second."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(16):
        moves = rng.uniform(20, 400, 3) * INTERVAL + white * INTERVAL**0.5 * rng.normal(size=(8, 3))
        angle = rng.uniform(0, COUNT, 3) + np.cumsum(np.vstack([np.zeros(3), moves]), axis=0)
        parts.append(np.diff(COUNT * np.floor(angle / COUNT), axis=0) / INTERVAL)
    return parts


def test_counts_of_known_size_are_not_taken_for_white_noise_in_short_rests():
    least = np.full(3, COUNT**2 / 12)
    white = 0.3 * COUNT
    freely, known = (
        np.mean([white_and_carried(short_rests(s, white), INTERVAL, v)[0] for s in range(40)])
        for v in (None, least)
    )
    assert abs(known - white**2) < 0.6 * abs(freely - white**2)


def test_rounding_that_stands_in_few_lines_leaves_white_noise_what_it_is():
    rng = np.random.default_rng(1)
    white, parts = 0.02, []
    for _ in range(16):
        moves = 10.5 * INTERVAL + white * INTERVAL**0.5 * rng.normal(size=(400, 3))
        parts.append(moves / INTERVAL)  # no rounding at all between its lines
    found = white_and_carried(parts, INTERVAL, np.full(3, COUNT**2 / 12))[0]
    np.testing.assert_allclose(found, white**2, rtol=0.2)
