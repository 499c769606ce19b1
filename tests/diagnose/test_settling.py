"""What settles or jumps in a record at rest is told from noise, and taken off."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import binom

from foucault.diagnose import allan
from foucault.diagnose.settling import calmed
from foucault.tables import Log
from make_noise import draw

NOISES = ((0, 1, 0, 0, 0), (0, 0, 1, 0, 0), (0, 0, 0, 1, 0), (0, 1, 0.3, 0, 0), (0, 1, 0, 1e-3, 0),
          (1, 0.01, 0, 0, 0), (0, 1, 0.1, 1e-4, 1e-5))  # fmt: skip
DRAWS = 24
SAMPLES = 16384


def test_noise_alone_settles_and_jumps_in_one_record_of_500_or_fewer():
    rng = np.random.default_rng(1)
    found = sum(bool(calmed(draw(1024, p, rng))[1]) for p in NOISES for _ in range(100))
    assert found <= binom.ppf(0.99, 100 * len(NOISES), 1 / 500)


def _warming(rng: np.random.Generator) -> np.ndarray:
    return draw(SAMPLES, (0, 1, 0, 0, 0), rng) + 4.0 * np.exp(-np.arange(SAMPLES) / 2000)


def test_noise_beside_warming_up_is_inside_its_interval():
    """White noise alone: no random walk is seen, and the intervals hold as often as they say."""
    held = {"white": 0, "random_walk": 0}
    for seed in range(DRAWS):
        kept, events = calmed(_warming(np.random.default_rng(seed)))
        assert [e.kind for e in events] == ["settles"]
        assert events[0].change == pytest.approx(-4.0, abs=0.4)
        assert events[0].time == pytest.approx(2000, rel=0.2)
        channel = allan.measure(kept, 1.0)
        for name, truth in (("white", 1.0), ("random_walk", 0.0)):
            noise = channel.noise(name)
            held[name] += noise.low <= truth <= noise.high
    least = binom.ppf(0.005, DRAWS, 0.95)
    assert min(held.values()) >= least, held
    raw = [allan.measure(_warming(np.random.default_rng(s)), 1.0) for s in range(DRAWS)]
    assert sum(not c.noise("random_walk").seen for c in raw) < least  # what it was without


def test_a_jump_is_found_where_it_is():
    rate = draw(SAMPLES, (0, 1, 0, 0, 0), np.random.default_rng(2))
    rate[5000:] -= 3.0
    kept, (event,) = calmed(rate)
    assert event.kind == "jumps" and event.time == pytest.approx(5000, abs=5)
    assert event.change == pytest.approx(-3.0, abs=0.2)
    assert not allan.measure(kept, 1.0).noise("random_walk").seen


def test_a_constant_and_a_ramp_have_no_event():
    assert calmed(np.full(1000, 0.3))[1] == []
    ramp = np.arange(1000.0) + draw(1000, (0, 1, 0, 0, 0), np.random.default_rng(3))
    assert calmed(ramp)[1] == []


def test_a_log_that_warms_up_or_jumps_is_told():
    rng = np.random.default_rng(4)
    gyro = rng.normal(0, 1e-3, (SAMPLES, 3))
    gyro[:, 0] += 3e-3 * np.exp(-np.arange(SAMPLES) / 2000)
    gyro[9000:, 2] += 1e-3
    told = allan.measure_log(Log(time=np.arange(SAMPLES) / 10, gyro=gyro, accel=None)).findings
    said = {f.code: f.message for f in told}
    assert "gyro.x settles: it changes by -" in said["allan.settles"]
    jumps = re.search(r"gyro.z jumps by \d+ deg/h at ([\d.]+) s and", said["allan.jumps"])
    assert jumps and float(jumps[1]) == pytest.approx(900, abs=1)
