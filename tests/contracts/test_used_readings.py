"""What was lost in readings that were used lowers the verdict; what was not used does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foucault import campaign
from foucault.result import Level, Result
from make_guard import ACCEL, GYRO, Session, session


def calibrated(made: Session, folder: Path) -> Result:
    return campaign.calibrate(made.write(folder))


def limited(made: Session, names: tuple[str, ...], part: float) -> Session:
    """Limit the range to `part` of the largest reading."""
    most = part * max(float(np.max(np.abs(made.columns[n]))) for n in names)
    return made.with_columns(**{n: np.clip(made.columns[n], -most, most) for n in names})


def severities(result: Result) -> set[str]:
    return {f.severity for f in result.findings if f.code == "log.saturated"}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("method", "names"),
    [("ferraris", GYRO), ("ferraris", ACCEL), ("six_position", ACCEL), ("hand_rotated", GYRO)],
)
def test_turns_and_faces_that_reach_the_end_of_the_range_are_no_pass(method, names, tmp_path):
    """By 2 %: scale factors and biases are 95 to 400 standard deviations off, no check fails."""
    result = calibrated(limited(session(method), names, 0.98), tmp_path)
    assert all(check.passed for check in result.checks)
    assert result.verdict.level is Level.DOUBTFUL
    assert "is saturated; samples at the limit" in result.verdict.reasons[0]
    assert severities(result) == {"warning"}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("method", "names"),
    [
        ("six_position", GYRO),
        ("turntable", GYRO),
        ("turntable", ACCEL),
        ("norm_observation", GYRO),
        ("rate_table", ACCEL),
        ("hand_rotated", ACCEL),
    ],
)
def test_moves_that_reach_the_end_of_the_range_are_a_note(method, names, tmp_path):
    """What lies between rests and spins is not used."""
    result = calibrated(limited(session(method), names, 0.98), tmp_path)
    assert result.verdict.level is Level.PASS
    assert severities(result) == {"note"}


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["ferraris", "hand_rotated", "six_position", "turntable"])
def test_a_rest_with_rows_that_repeat_is_no_pass(method, tmp_path):
    made = session(method)
    time = made.columns["time"]
    rows = round(1.6 / float(np.median(np.diff(time))))
    rates = np.array([made.columns[name] for name in GYRO])
    power = np.sum((rates - np.median(rates, axis=1, keepdims=True)) ** 2, axis=0)
    first = int(np.argmin(np.convolve(power, np.ones(rows), "valid")))
    lost = {name: made.columns[name].astype(float) for name in ("accel_x", "gyro_x")}
    for x in lost.values():
        x[first : first + rows] = x[first]
    result = calibrated(made.with_columns(**lost), tmp_path)
    assert result.verdict.level is Level.DOUBTFUL
    assert "x repeats one reading from" in result.verdict.reasons[0]
