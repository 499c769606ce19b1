"""What every procedure says of itself, and what is done alike for all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import procedures
from foucault.errors import FoucaultError
from foucault.models.earth import Site
from refusals import refuses

SITE = Site(9.81, 0.8)


class SeenError(Exception):
    """Ends a calibration where it has been seen what it is given."""


def given(name, how="calibrate", **told):
    """What `solve` of a procedure is given."""
    seen = []

    def solve(log, given):
        seen.append(given)
        raise SeenError

    with pytest.raises(SeenError):
        getattr(replace(procedures.load(name), solve=solve), how)(None, site=SITE, **told)
    return seen[0]


@pytest.mark.parametrize("name", procedures.PROCEDURES)
def test_a_record_is_whole(name):
    p = procedures.load(name)
    assert p.name == name
    assert p.summary.startswith("Calibrate")
    assert (p.space is None) == (p.Wanted is None)
    assert (p.Master is None) == (p.with_master is None)
    names = p.names(p.Settings(), p.Session())
    assert names and len(set(names)) == len(names)
    assert set(names) <= set(p.layout.names)


@pytest.mark.parametrize("name", procedures.PROCEDURES)
def test_a_trial_is_not_shown_and_given_the_same(name):
    p, prior = procedures.load(name), {"gyro.bias": (0.0, 1.0)}
    whole, trial = given(name, prior=prior), given(name, "trial", prior=prior)
    assert whole.settings == trial.settings == p.Settings()
    assert whole.prior == trial.prior == prior
    assert (whole.shown, trial.shown) == (True, False)


def test_where_the_earth_is_not_to_turn_the_latitude_is_not_known():
    settings = procedures.load("hand_rotated").Settings
    assert given("hand_rotated").site == SITE
    assert given("hand_rotated", settings=settings(earth_rate=False)).site.latitude is None


@pytest.mark.parametrize("how", ["calibrate", "trial"])
def test_equations_that_cannot_be_solved_are_named(how):
    def solve(log, given):
        raise np.linalg.LinAlgError("Singular matrix")

    singular = replace(procedures.load("hand_rotated"), solve=solve)
    with refuses("solution.singular", "Singular matrix"):
        getattr(singular, how)(None, site=SITE)


def test_an_unknown_procedure_is_refused_with_the_nearest():
    with pytest.raises(FoucaultError, match="hand_rotated"):
        procedures.load("hand_rotatd")
