"""What a fix of a north seeker does not estimate: right uncertainties, and who is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import ByNoise, sizes_of, terms
from foucault.models.north_seeker import SEEKER
from foucault.procedures.north_seeking import Settings
from foucault.procedures.north_seeking.fix import Survey, find_north
from foucault.procedures.north_seeking.settings import parts
from foucault.result import Level
from foucault.simulate.north import NorthPlan, SeekerErrors, Stops, simulate_north
from make_north import LATITUDE, NOISE, PALINDROME, many

SITE = Site.at(LATITUDE)
FIBRE = sizes_of("tactical FOG")
PERFECT = Settings(accel_bias_sd=0.0, accel_scale_sd=0.0, accel_misalignment_sd=0.0)
"""Accelerometers without errors of their calibration: none are simulated."""
ARCSEC = np.radians(1 / 3600)
SETUPS = many(12, 5.0)
SEQUENTIAL, THREE = (0.0, 90.0, 180.0, 270.0), (0.0, 120.0, 240.0)


def session(stops: tuple[float, ...], seed: int, held: dict[str, float], off: float = 0.0):
    """Twelve set-ups of one gyro that has `held`, at a latitude that is `off` by so much [rad]."""
    values = ImuModel().coefficients(LAYOUT.names).with_values(held)
    base, own = parts(ImuModel.from_coefficients(values))
    errors = SeekerErrors(gyro_offset=2e-6, own=own, index_sd=10 * ARCSEC if held else 0.0)
    plan = NorthPlan(SETUPS, Stops(np.radians(stops), np.full(len(stops), 90.0), 5.0))
    return simulate_north(plan, model=base, noise=NOISE, site=Site.at(LATITUDE + off),
                          errors=errors, reference=False, seed=seed).log  # fmt: skip


def everything(stops: tuple[float, ...], seed: int):
    """All terms at their sizes, drift and place among them."""
    rng = np.random.default_rng([seed, 9])
    own = [t for t in terms(SEEKER.names, SITE, FIBRE) if t.name in LAYOUT]
    held = {t.name: t.size * float(rng.standard_normal()) for t in own}
    log = session(stops, seed, held, FIBRE["latitude"][0] * float(rng.standard_normal()))
    middle = log.time + log.averaged / 2
    ramp = (middle - middle[0]) / max(np.ptp(log.time), 3600.0) - 0.5
    drift = FIBRE["gyro.bias drift"][0] * float(rng.standard_normal())
    return replace(log, gyro=log.gyro + drift * ramp)


def fixed(log, sizes=FIBRE, **settings) -> Survey:
    chosen = PERFECT.model_copy(update=settings)
    return find_north(log, site=SITE, settings=chosen, noise=NOISE, sizes=sizes)


def scores(survey: Survey) -> np.ndarray:
    """Squares of heading errors over their variance, of each set-up [1]."""
    off = survey.fixes.angles[:, 0] - np.array([s.heading for s in SETUPS])
    off = (off + np.pi) % (2 * np.pi) - np.pi
    return off**2 / survey.fixes.cov[:, 0, 0]


@pytest.mark.parametrize("stops", [
    pytest.param(PALINDROME, id="eight", marks=pytest.mark.thorough),
    pytest.param(SEQUENTIAL, id="four", marks=pytest.mark.thorough),
    pytest.param(THREE, id="three"),
])  # fmt: skip
def test_with_every_term_at_its_size_headings_are_as_sure_as_they_say(stops) -> None:
    """Set-ups of a file share the terms: one of them from each of many files is a fair sample."""
    found, without, passed = [], [], 0
    for seed in range(40):
        log = everything(stops, seed)
        survey = fixed(log)
        found.append(scores(survey)[seed % 12])
        without.append(scores(fixed(log, None))[seed % 12])
        passed += survey.verdicts[seed % 12].level is Level.PASS
        assert not survey.left_out.named
    low, high = chi_square_limits(len(found), tests=3)
    assert low < sum(found) < high < sum(without)
    assert passed >= 36


def test_what_is_far_beyond_its_size_is_named_with_all_that_looks_like_it() -> None:
    bent = {"gyro.g_sensitivity.yy": 25 * FIBRE["gyro.g_sensitivity"][0]}
    for held, off in (bent, 0.0), ({}, 0.02):
        survey = fixed(session(PALINDROME, 1, held, off))
        named = set(survey.left_out.named[0])
        assert named & {"gyro.g_sensitivity", "latitude"}
        assert ("latitude" in named) if off else ("gyro.g_sensitivity" in named)
        assert all(v.level is Level.DOUBTFUL for v in survey.verdicts)
        assert "times as large as its size" in " ".join(survey.verdicts[0].reasons)
        assert (scores(survey) < 12).all()  # enlarged, the uncertainties hold it


def test_noise_that_is_declared_too_small_blames_no_term() -> None:
    log = session(PALINDROME, 3, {})
    quiet = replace(NOISE, gyro=replace(NOISE.gyro, white=NOISE.gyro.white / 10))
    survey = find_north(log, site=SITE, settings=PERFECT, noise=quiet, sizes=FIBRE)
    assert not survey.left_out.named
    assert survey.verdicts[0].level is Level.DOUBTFUL  # the residuals of the gyro say so
    assert not any("not estimated" in reason for reason in survey.verdicts[0].reasons)


def test_of_an_unknown_latitude_nothing_is_left_to_test_with() -> None:
    survey = fixed(session(PALINDROME, 2, {}), unknown_latitude=True)
    assert survey.verdicts[0].level is Level.PASS
    assert not survey.left_out.named and "latitude" not in survey.left_out.groups
    assert all(np.isinf(survey.left_out.needed[g]) for g in survey.left_out.groups)


def test_what_is_declared_counts_as_declared_and_the_class_is_that_of_the_noise() -> None:
    log = session(PALINDROME, 2, {})
    told = fixed(log, ByNoise(), latitude_sd=np.radians(0.5), index_sd=60 * ARCSEC)
    assert told.left_out.sizes["latitude"] == (np.radians(0.5), "latitude_sd as given")
    assert told.left_out.sizes["indexing"] == (60 * ARCSEC, "index_sd as given")
    assert "grade told by noise" in told.left_out.sizes["gyro.g_sensitivity"][1]
    usual = fixed(log, ByNoise())
    assert "judgement" in usual.left_out.sizes["latitude"][1]
    assert fixed(log, None).left_out is None
