"""A real vehicle: what a user gets of its log, and what can be judged without a truth."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.errors import Status
from make_transfer_vehicle import (
    ARCMIN,
    FOLDER,
    FOUND,
    LEVER,
    MS,
    PSINS,
    SHIPPED,
    apart,
    calibrated,
    closure,
    described,
    half,
    in_units,
    logged,
    on_one_clock,
)
from sessions import failed

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"real logs are not here: set FOUCAULT_DATA ({FOLDER})"
)
ALL = "vertical = true"
ANGLES = ("gyro.bias", "accel.bias", "installation")


@pytest.fixture(scope="module")
def log():
    return logged()


@pytest.fixture(scope="module")
def campaign():
    return described(ALL, FOUND, LEVER)


@pytest.fixture(scope="module")
def found(log, campaign):
    return calibrated(campaign, log)


def heading_error(log, groups, delay, begin=0.0):
    _, err = closure(log, *(groups[g] for g in ANGLES), delay, begin)
    return err / ARCMIN


def of(coefficients):
    return {g: coefficients[g].values for g in ANGLES}, float(coefficients.value("master.delay"))


@pytest.mark.thorough
def test_delay_installation_and_biases(found):
    c = found.coefficients
    assert found.status is Status.CONVERGED
    assert c.value("master.delay") == pytest.approx(15.5 * MS, abs=0.5 * MS)
    # Another program's numbers with its own uncertainties, where one is shipped.
    other = {"gyro.bias": (0.74, 0.71, 1.39), "installation": (1.26, 0.89, 1.42)}
    for group, sd in other.items():
        gap = c[group].values - in_units(group, PSINS[group])
        assert (np.abs(gap) < 3 * np.hypot(c[group].sd, in_units(group, sd))).all()


@pytest.mark.thorough
def test_heading_closes_without_messages(log, found):
    mine, delay = of(found.coefficients)
    assert np.abs(heading_error(log, mine, delay)).max() < 1.5
    shipped = {g: in_units(g, SHIPPED[g]) for g in ANGLES}
    assert abs(heading_error(log, shipped, delay)[-1]) == pytest.approx(14.3, abs=0.3)


@pytest.mark.thorough
def test_biases_of_the_first_half_close_the_second(log, campaign):
    first, delay = of(calibrated(campaign, half(log, False)).coefficients)
    err = heading_error(log, first, delay, begin=50.0)
    assert abs(err[-1]) < 1.5
    assert np.abs(err).max() < 2.0


@pytest.mark.thorough
def test_halves_agree_when_the_clocks_do(log, campaign, found):
    drift = found.diagnostics["delay"]["rate_matching"]["drift"]
    assert drift == pytest.approx(-7.8e-6, abs=1.5e-6)
    gaps, chi = apart(campaign, on_one_clock(log, drift))
    assert max(map(abs, gaps.values())) < 3
    assert 3.6 < chi < 29.8
    # Without, the delay alone tells that it shrinks.
    gaps, _ = apart(campaign, log)
    assert {name for name, gap in gaps.items() if abs(gap) > 3} == {"master.delay"}


def test_innovations_are_as_large_as_was_said(found):
    """One number for three axes and two kinds: whiteness fails, and the reasons are known."""
    # What is coloured is told worse by the parts around it than white noise would be.
    assert failed(found) == {"whiteness", "held-out messages"}
    assert found.diagnostics["innovations"]["attitude"]["axes"][2] < 0.7


def test_the_defaults_say_what_is_wrong(log):
    """Gyros of 200 deg/h, held to 2.4 deg/h."""
    result = calibrated(described(priors=""), log)
    assert {"prior", "attitude innovations", "velocity innovations"} <= failed(result)
    assert "transfer.noise" in [f.code for f in result.findings]


def test_a_delay_that_is_ignored_is_told(log):
    result = calibrated(described(f'{ALL}\ndelay = "none"', FOUND, LEVER), log)
    (said,) = [f for f in result.findings if f.code == "transfer.delay_differs"]
    assert "15.3 ± 0.1 ms" in said.message
