"""Transfer alignment of a slave with the errors that are not in its result, and noise declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.models.imu import ImuModel
from foucault.models.left_out import sizes_of
from foucault.procedures import transfer_alignment
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment.counted import Counted
from foucault.procedures.transfer_alignment.session import draw_errors
from foucault.result import Level
from make_transfer_campaign import described, faultless
from refusals import refuses
from sessions import codes, failed

DEG_H, G = np.pi / 180 / 3600, 9.80665
TACTICAL = {"gyro.misalignment": 1e-3, "accel.misalignment": 1e-3, "accel.scale": 5e-4,
            "gyro.g_sensitivity": DEG_H / G}  # fmt: skip
LARGEST = 2.0
"""Of a mean over four flights of 13 numbers each: 52 of 1 +- 0.2, and what they share."""


def flown(c, seed: int, noise=None, **sizes):
    """Calibrate a flight of a slave with more errors; return the result and its NEES a number."""
    model = draw_errors("tactical", seed)
    vector, rng = model.coefficients(), np.random.default_rng([seed, 5])
    for group, size in sizes.items():
        at = vector.layout.group(group.replace("__", "."))
        vector.values[at] = size * rng.choice([-1.0, 1.0], len(at))
    model, noise = ImuModel.from_coefficients(vector), noise or c.noise
    made = transfer_alignment.simulate(c.session, settings=c.settings, model=model, noise=noise,
                                       site=c.site, seed=seed)  # fmt: skip
    result = transfer_alignment.trial(made.log, site=c.site, settings=c.settings, noise=noise,
                                      prior=c.prior)  # fmt: skip
    found = result.coefficients
    err = found.values - vector.with_others(made.beside).chosen(found.names).values
    return result, float(err @ np.linalg.solve(found.cov, err)) / len(err)


def mean_of(c, runs: int = 4, **more) -> float:
    found = [flown(c, seed, **more) for seed in range(runs)]
    assert all(r.verdict.level is Level.PASS for r, _ in found)
    return float(np.mean([score for _, score in found]))


def test_what_has_no_size_is_no_state():
    c = described()
    usual = sizes_of("tactical MEMS")
    for group in ("accel.quadratic", "gyro.asymmetry", "accel.cross"):
        zero = {**usual, group: (0.0, "said")}
        without = {k: v for k, v in usual.items() if k != group}
        have, want = (Counted.of(c.settings, s, c.site, placed=True) for s in (zero, without))
        assert have.sensors.layout.names == want.sensors.layout.names
        assert dict(have.groups) == dict(want.groups)
        assert np.isfinite(have.prior(c.settings, {}).prior_sd).all()


def test_a_delay_longer_than_any_message_has_is_refused():
    with refuses("campaign.value", "less than or equal to 60 s"):
        described(longest_delay='"1e15 ms"')


@pytest.mark.thorough
def test_an_ordinary_slave_is_no_surer_than_it_is_right():
    """Axes 60 ppm off: told as none, the errors are 2.7 times their uncertainties."""
    crossed = {"gyro__misalignment": 60e-6, "accel__misalignment": 60e-6}
    assert mean_of(described(), **crossed) < LARGEST
    assert mean_of(described()) < LARGEST
    sure = [flown(faultless(), seed, **crossed)[1] for seed in range(3)]
    assert np.mean(sure) > 4.0


@pytest.mark.thorough
def test_gyros_that_feel_force_and_all_at_once():
    assert mean_of(described(), gyro__g_sensitivity=DEG_H / G) < LARGEST
    every = {group.replace(".", "__"): size for group, size in TACTICAL.items()}
    assert mean_of(described(), **every) < LARGEST


@pytest.mark.thorough
def test_gravity_off_by_as_much_as_in_mountains():
    c = described()
    site = replace(c.site, gravity=c.site.gravity + 1e-3, gravity_sd=4e-4)
    assert mean_of(replace(c, site=site)) < LARGEST


@pytest.mark.thorough
def test_errors_far_beyond_their_size_are_named():
    """Ten times what is counted with: the uncertainties know nothing of that."""
    c = described()
    result, _ = flown(c, 1, gyro__misalignment=10e-3)
    assert result.verdict.level is Level.DOUBTFUL
    (said,) = [f for f in result.findings if f.code == "transfer.prior"]
    assert said.message.startswith("gyro.misalignment")
    assert 'Write "gyro.misalignment" with sd' in said.cure


@pytest.mark.thorough
def test_the_result_is_the_same_coefficients_with_what_is_left_out_beside():
    c, plain = described(), faultless()
    result, _ = flown(c, 2)
    sure, _ = flown(plain, 2)
    assert result.coefficients.names == sure.coefficients.names
    assert (result.coefficients.sd > 0.99 * sure.coefficients.sd).all()
    beside = result.diagnostics["filter"]["left_out"]
    assert {r["name"].rpartition(".")[0] for r in beside} == set(TACTICAL)
    assert sure.diagnostics["filter"]["left_out"] == []
    assert "taken as none (left_out)" in " ".join(sure.diagnostics["unseen"])
    assert "[prior]" in " ".join(result.diagnostics["unseen"])
    # What is declared narrows it again.
    known = {group: (0.0, 1e-3 * size) for group, size in TACTICAL.items()}
    declared, _ = flown(replace(c, prior=known), 2)
    np.testing.assert_allclose(declared.coefficients.sd, sure.coefficients.sd, rtol=0.01)


@pytest.mark.thorough
def test_bias_instability_that_is_declared_is_counted_with():
    c = faultless()
    gyro = replace(c.noise.gyro, bias_instability=1.0 * DEG_H, correlation_time=100.0)
    accel = replace(c.noise.accel, bias_instability=50e-6 * G, correlation_time=100.0)
    noise = replace(c.noise, gyro=gyro, accel=accel)
    scores = [flown(c, seed, noise=noise) for seed in range(4)]
    assert 0.4 < np.mean([score for _, score in scores]) < 1.6
    assert all(not failed(r) and not codes(r) for r, _ in scores)
    told = transfer_alignment.foresee(
        Beforehand(c.settings, session=c.session, site=c.site, noise=noise)
    )
    sd = scores[0][0].coefficients
    for group in ("gyro.bias", "accel.bias"):
        np.testing.assert_allclose(told.coefficients[group].sd, sd[group].sd, rtol=0.15)
    quiet = transfer_alignment.foresee(
        Beforehand(c.settings, session=c.session, site=c.site, noise=c.noise)
    )
    assert (told.coefficients["gyro.bias"].sd > 2 * quiet.coefficients["gyro.bias"].sd).all()


@pytest.mark.thorough
def test_a_coefficient_that_only_left_out_errors_hide_is_told_and_is_no_doubt():
    c = described(profile='"ship"', rate='"20 Hz"', message_rate='"1 Hz"')
    result, _ = flown(c, 1)
    (said,) = [f for f in result.findings if f.code == "transfer.hidden"]
    assert said.message.startswith(
        "The motion shows accel.bias.x, accel.bias.y, but what is not in"
    )
    assert 'such as "gyro.misalignment" with sd = "0.1 mrad"' in said.cure
    assert not any("accel.bias" in words for words in result.verdict.reasons)
    foreseen = transfer_alignment.foresee(
        Beforehand(c.settings, session=c.session, site=c.site, noise=c.noise)
    )
    assert not any(name.startswith("accel.bias") for name in foreseen.hardly)
