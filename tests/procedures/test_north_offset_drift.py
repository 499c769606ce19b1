"""A gyro whose offset drifts over a calibration of headings: no residual shows it, set-ups do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.result import Level, Result
from sessions import SEEKER, SITE, Case, made, truth

CASE = Case("north_seeking", {}, {"tilts": ["8 deg", "-8 deg", "0 deg"]}, noise=SEEKER)


def calibrated(log, **settings: str) -> Result:
    return CASE.record.calibrate(
        log, site=SITE, settings=CASE.stated.model_copy(update=settings), noise=SEEKER
    )


def test_a_drift_that_set_ups_share_is_told_with_what_it_moves() -> None:
    simulation = made(CASE, 20_000)
    log = simulation.log
    ramp = (log.time - log.time.mean()) / np.ptp(log.time)
    drifting = replace(log, gyro=log.gyro + np.radians(0.03) * ramp)
    plain, cured = calibrated(drifting), calibrated(drifting, drift="linear")
    check = next(c for c in plain.checks if c.name == "offset drift")
    assert plain.verdict.level is Level.DOUBTFUL and not check.passed
    assert 'Set drift = "linear"' in check.sentence
    names = ("gyro.bias.x", "gyro.bias.y")
    x = plain.coefficients
    off = [abs(x.value(n) - truth(simulation, (n,))[0]) / x.sd[x.names.index(n)] for n in names]
    assert check.value == np.clip(check.value, 0.8 * max(off), 1.2 * max(off))  # as far as it says
    assert cured.verdict.level is Level.PASS
    y = cured.coefficients
    error = y.values - truth(simulation, y.names)
    assert np.all(np.abs(error) < 4 * y.sd)


def test_a_steady_offset_passes() -> None:
    result = calibrated(made(CASE, 20_000).log)
    assert next(c for c in result.checks if c.name == "offset drift").passed
    assert result.verdict.level is Level.PASS
