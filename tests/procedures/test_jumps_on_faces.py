"""What jumps between rests on faces is told from what drifts; a table taken for exact is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.models.left_out import ByNoise
from sessions import ARCMIN, Case, made

DEG = np.radians(1.0)
PLACED = {"placement_sd": 3 * ARCMIN, "level_sd": 3 * ARCMIN, "angle_sd": 12 * ARCMIN}
CASES = {
    "six_position": Case(
        "six_position", {"placement_sd": 3 * ARCMIN},
        {"placement_sd": 3 * ARCMIN, "repeated": 6}, grade="mems",
    ),
    "ferraris": Case("ferraris", PLACED, PLACED, grade="mems"),
}  # fmt: skip


def calibrated(case, log, counted):
    return case.record.calibrate(
        log, site=case.site, settings=case.stated, sizes=ByNoise() if counted else None
    )


@pytest.mark.parametrize("counted", [False, True])
@pytest.mark.parametrize("which", CASES)
def test_a_jump_is_told_from_a_drift_with_its_time(which, counted):
    case = CASES[which]
    log = made(case, 3).log
    t = log.time - log.time[0]
    shapes = {"jump": t > 0.4 * t[-1], "ramp": t / t[-1], "decay": np.exp(-5 * t / t[-1])}
    for what, shape in shapes.items():
        gyro = log.gyro + 0.04 * DEG * shape[:, None] * np.array([0.0, 1.0, 0.0])
        r = calibrated(case, replace(log, gyro=gyro), counted)
        told = [c for c in r.checks if c.name == "jump" and not c.passed]
        assert bool(told) == (what == "jump")
        if told:
            words = told[0].sentence
            assert "gyro.bias.y had jumped by" in words
            at = float(words.partition(" at ")[2].partition(" s:")[0]) - log.time[0]
            assert abs(at - 0.4 * t[-1]) < 12.0  # between two rests
            assert not any("warm up" in reason for reason in r.verdict.reasons)


def test_angles_taken_as_exact_are_named():
    """Angles off by 1 arcsec are several times the noise of a good instrument."""
    doubted = Case("multi_position", grade="navigation")
    believed = replace(doubted, said={"angle_sd": ARCMIN / 60})
    for case in (doubted, believed):
        reasons = calibrated(case, made(case, 1).log, counted=False).verdict.reasons
        assert any("angle_sd" in words for words in reasons) == (case is doubted)
