"""Sessions over temperature that were all given the same local gravity are wrong by it together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.comparable import gravity_errors
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.layouts import gravity_slope
from foucault.procedures.temperature import Session, Settings, calibrate
from foucault.result import Result
from make_temperature import ROOM, sessions, truth

DEGREES = (-15, 5, 25, 45, 65)
SHARE = 3e-4
"""Standard deviation of gravity, so many times that of a scale factor's own [1]."""

SETTINGS = Settings(orders={"accel.bias": 2, "gyro.bias": 2, "": 1}, scatter={"": 0.0})
TRUTH = truth()[0]


def misled(seed: int, error: float, places: tuple[float, ...] = (0.5,)) -> list[Session]:
    """Sessions whose gravity was wrong by `error` standard deviations."""
    out = []
    for k, one in enumerate(sessions(DEGREES, seed)):
        vector = one.result.coefficients
        L = SHARE * gravity_slope(vector)
        vector = replace(vector, values=vector.values + error * L)
        L = SHARE * gravity_slope(vector)  # as who does not know the truth computes it
        vector = replace(vector, cov=vector.cov + np.outer(L, L))
        site = {"gravity": 9.81, "gravity_sd": SHARE * 9.81, "height": 0.0,
                "latitude": places[k % len(places)]}  # fmt: skip
        facts = {"budget": {"local gravity": (L**2).tolist()}}
        out.append(replace(one, result=replace(one.result, coefficients=vector, site=site,
                                               diagnostics=facts)))  # fmt: skip
    return out


def scales(result: Result, temperature: float) -> tuple[np.ndarray, np.ndarray]:
    """Scale factors of the accelerometers, estimate minus truth and sd."""
    model = result.temperature
    assert model is not None
    at = [model.layout.index(f"accel.scale.{a}") for a in "xyz"]
    error = model.values(temperature)[at] - TRUTH.values(temperature)[at]
    return error, model.at(temperature).sd[at]


@pytest.mark.thorough
@pytest.mark.parametrize("knots", [(), (ROOM - 40, ROOM, ROOM + 40)])
def test_more_sessions_do_not_make_gravity_better_known(knots: tuple[float, ...]) -> None:
    settings = replace(SETTINGS, orders={}, knots=knots) if knots else SETTINGS
    rng, runs, total = np.random.default_rng(1), 40, 0.0
    for seed in range(runs):
        result = calibrate(misled(seed, rng.standard_normal()), settings)
        error, sd = scales(result, ROOM + 10)
        assert (sd > 0.99 * SHARE).all() and (sd < 1.05 * SHARE).all()
        total += float((error[0] / sd[0]) ** 2)
    low, high = chi_square_limits(runs, tests=2)
    assert low < total < high
    # What is left of the sessions is their own, and as large as they say; lines bend at no square.
    assert next(c for c in result.checks if c.name == "chi-square").passed == (not knots)
    (kept,) = gravity_errors(result, result.coefficients).values()
    at = result.coefficients.layout.index("accel.scale.x")
    assert kept[at] == pytest.approx(-SHARE, rel=0.02)


def test_sessions_at_different_places_have_different_errors() -> None:
    apart = calibrate(misled(1, 0.0, (0.1, 0.2, 0.3, 0.4, 0.5)), SETTINGS)
    assert (scales(apart, ROOM)[1] < 0.7 * SHARE).all()
    assert gravity_errors(apart, apart.coefficients) == {}
