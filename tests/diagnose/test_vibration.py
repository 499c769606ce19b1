"""Vibration on the move is told from the noise at rest, and slow motion is not taken for it."""

from __future__ import annotations

import json
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import run
from foucault.diagnose.vibration import findings, vibration
from foucault.logs import write
from foucault.tables import Log

RATE, REST, N = 200.0, 60.0, 40_000


def a_log(gyro_sd: float = 0.0, accel_sd: float = 0.0, seed: int = 1) -> Log:
    """Return a minute of rest, then turns of 1 rad/s at 2 Hz with vibration at 57 Hz on top."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) / RATE
    gyro, accel = rng.normal(0, 2e-3, (N, 3)), rng.normal([0, 0, 9.8], 2e-2, (N, 3))
    moving = t > REST
    gyro[moving] += np.sin(2 * np.pi * 2.0 * t[moving])[:, None]
    shake = np.sqrt(2) * np.sin(2 * np.pi * 57.0 * t[moving])
    gyro[moving, 0] += gyro_sd * shake
    accel[moving, 2] += 2 * np.sin(2 * np.pi * 2.0 * t[moving]) + accel_sd * shake
    return Log(t, gyro, accel, "rate")


ALIKE = comb(24, 12) / comb(12, 6) ** 2
"""Samples of white noise that its sixth differences make alike [1]."""

CHANCE = 3.5 * np.sqrt(2 * ALIKE / (REST * RATE))
"""How far a density of the rest is from the truth at most; each by 0.05 %, of ten [1]."""


def response() -> float:
    """Power of sixth differences of the vibration over that of white noise of the same sd."""
    return (2 * np.sin(np.pi * 57.0 / RATE)) ** 12 / 924


def test_the_sd_of_a_vibration_is_found() -> None:
    seen = {v.axis: v for v in vibration(a_log(0.02, 0.5), 0.0, REST)}
    scale = np.sqrt(response())
    assert seen["gyro.x"].sd == pytest.approx(0.02 * scale, rel=0.03)
    assert seen["accel.z"].sd == pytest.approx(0.5 * scale, rel=0.03)
    assert seen["gyro.x"].share > 0.99
    for axis in ("gyro.y", "gyro.z", "accel.x", "accel.y"):
        assert seen[axis].moving == pytest.approx(seen[axis].rest, rel=1.5 * CHANCE)
    assert seen["gyro.y"].rest == pytest.approx(2e-3**2 / RATE, rel=CHANCE)
    (told,) = findings(tuple(seen.values()))
    assert told.code == "allan.vibration"
    assert "gyro.x" in told.message and "accel.z" in told.message
    assert "gyro.y" not in told.message


def test_motion_alone_is_calm_and_rest_alone_tells_nothing() -> None:
    assert [f.code for f in findings(vibration(a_log(), 0.0, REST))] == ["allan.calm"]
    log = a_log()
    for start, end in ((0.0, N / RATE), (1e3, 2e3)):
        assert [f.code for f in findings(vibration(log, start, end))] == ["allan.not_moving"]


def test_the_command_says_it(tmp_path: Path) -> None:
    write(a_log(0.02, 0.5), tmp_path / "drive.parquet")

    def said(*words: Any) -> Any:
        return json.loads(run(*words, code=0).stdout)

    drive = tmp_path / "drive.parquet"
    plain = said("allan", drive, "--json")
    moving = said("allan", drive, "--moving", "--json")
    assert "vibration" not in plain
    assert {v["axis"] for v in moving["vibration"]} == set(moving["channels"])
    assert moving["channels"] == plain["channels"]  # the noise is that of the rest
    assert any(f["code"] == "allan.vibration" for f in moving["findings"])
