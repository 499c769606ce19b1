"""Attitudes by the gyros alone: what the delay of a sensor does to a vector that stands still."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.turning import Cells, Turning
from make_magnetometer import draw, free, session


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_the_slope_by_the_delay_is_that_of_differences(sampled: str) -> None:
    rng = np.random.default_rng(1)
    log = session(free(rng, 20.0), draw(rng), rng)
    assert log.gyro is not None
    turning = Turning(log.time, log.gyro, sampled)
    cells, v = Cells(np.arange(100, 900), np.arange(0, 800, 20)), np.array([0.3, -0.4, 0.8])
    still = np.zeros(3), np.zeros((3, 3))
    late, early = (turning.chain(0.01 + d, *still).seen(cells, v) for d in (1e-4, -1e-4))
    slope = turning.chain(0.01, *still).seen_later(cells, v)
    np.testing.assert_allclose(slope, (late - early) / 2e-4, atol=2e-3 * np.abs(slope).max())
