"""Most of an hour beside the master: a free run so long would be hundreds of kilometres away."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.procedures.transfer_alignment import (
    Session,
    Settings,
    calibrate,
    draw_errors,
    simulate,
)
from foucault.procedures.transfer_alignment.settings import NOISE

SWELL = {"sway": ["0.7 deg", "1.5 deg", "5 deg"], "period": "9 s", "time": "100 s"}
LEGS = [SWELL, {"turn": "40 deg", "time": "50 s", "flat": True}, SWELL,
        {"turn": "-70 deg", "time": "50 s", "flat": True}]  # fmt: skip


@pytest.mark.thorough
def test_errors_are_as_large_as_told_after_fifty_minutes():
    session = Session.model_validate({
        "profile": "ship", "manoeuvres": LEGS * 10, "rate": "20 Hz", "message_rate": "1 Hz",
        "with_outage": False,
    })  # fmt: skip
    site = Site.at(np.radians(43.0), 50.0)
    made = simulate(session, model=draw_errors("tactical", 1), noise=NOISE, site=site, seed=1)
    whole = calibrate(made.log, site=site, noise=NOISE)
    assert whole.verdict.level.value == "pass", whole.verdict.reasons
    assert [f.code for f in whole.findings] == ["transfer.hidden"]  # biases, by misalignments
    result = calibrate(made.log, site=site, noise=NOISE, settings=Settings(left_out=False))
    assert result.verdict.level.value == "pass", result.verdict.reasons
    found = result.coefficients
    true = made.model.coefficients()
    truth = [(true if name in true.layout else made.beside).value(name) for name in found.names]
    err = found.values - truth
    low, high = chi_square_limits(len(found), 0.01)
    assert low < err @ np.linalg.solve(found.cov, err) < high
