"""A mount that bends: how far and how slowly is found in the innovations, and said."""

from __future__ import annotations

import re

import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.procedures.transfer_alignment.settings import Settings
from foucault.result import Level
from make_transfer_campaign import faultless, made, missed, trial
from sessions import codes, failed

ARCMIN = 2.9088820866572e-4


@pytest.mark.thorough
def test_a_mount_that_bends_is_told_with_the_numbers_to_write():
    c = faultless(flexure='"1 arcmin"', flexure_memory='"5 s"')
    session = made(c, 1)
    result = trial(c, session.simulation.log)
    assert result.verdict.level is Level.DOUBTFUL and "whiteness" in failed(result)
    (said,) = [f for f in result.findings if f.code == "transfer.flexure"]
    assert "innovations are then as they should be" in said.message
    sd, time, noise = map(float, re.findall(r'= "([\d.]+) (?:arcmin|s)"', said.cure))
    assert 0.8 < sd < 1.25 and 3.5 < time < 7.0 and 0.95 < noise < 1.05
    assert "transfer.spread" not in codes(result)
    right = c.settings.model_copy(update={
        "flexure_sd": sd * ARCMIN, "flexure_time": time, "attitude_sd": noise * ARCMIN,
    })  # fmt: skip
    written = trial(c, session.simulation.log, settings=right)
    assert written.verdict.level is Level.PASS and codes(written) == []


@pytest.mark.thorough
def test_flexure_that_is_estimated_leaves_errors_as_large_as_told():
    c, runs, total = faultless(flexure='"2 arcmin"', flexure_memory='"3 s"'), 3, 0.0
    settings = c.settings.model_copy(update={"estimate_flexure": True})
    for seed in range(runs):
        session = made(c, seed)
        result = trial(c, session.simulation.log, settings=settings)
        assert result.verdict.level is Level.PASS, result.verdict.reasons
        found = result.diagnostics["filter"]
        assert found["flexure_sd"] == pytest.approx(2 * ARCMIN, rel=0.3)
        assert found["flexure_time"] == pytest.approx(3.0, rel=0.4)
        total += missed(result, session)[1]
    low, high = chi_square_limits(13 * runs)
    assert low < total < high


@pytest.mark.thorough
def test_a_stiff_mount_has_no_flexure_to_estimate():
    c = faultless()
    result = trial(c, made(c, 3).simulation.log,
                   settings=c.settings.model_copy(update={"estimate_flexure": True}))  # fmt: skip
    assert result.diagnostics["filter"]["flexure_sd"] == 0.0
    assert result.diagnostics["filter"]["attitude_sd"] == Settings().attitude_sd
    assert result.verdict.level is Level.PASS
