"""Are the uncertainties on faces right? Errors of simulated sessions against their covariance.

`validation/ferraris.py` has the long version.
"""

from __future__ import annotations

import numpy as np
import pytest

from foucault.diagnose.consistency import nees
from foucault.estimate.chi_square import chi_square_limits
from foucault.models.noise import grade
from foucault.procedures import ferraris, six_position
from foucault.simulate.faces import face_plan
from foucault.simulate.faces import simulate as simulate_plan
from foucault.simulate.hand_rotated import draw_errors
from make_faces import SITE, TURN

ARCMIN = np.radians(1 / 60)


def sessions(n, place, given, procedure=ferraris, **words):
    """Sum of the NEES of short sessions and its limits, 1 % for the tests of this file."""
    errors, covs = [], []
    settings = procedure.Settings(placement_sd=given, **words)
    names = procedure.PROCEDURE.names(settings, procedure.Session())
    noise = grade("tactical").noise
    for seed in range(n):
        model = draw_errors("tactical", seed)
        turns = {"angle": TURN} if procedure is ferraris else {}
        plan = face_plan(
            rest_time=2.0, move_time=1.0, turn_time=2.0, placement_sd=place, level_sd=place,
            angle_sd=place, seed=1000 + seed, **turns,
        )  # fmt: skip
        log = simulate_plan(plan, model=model, noise=noise, site=SITE, seed=2000 + seed).log
        result = procedure.calibrate(log, site=SITE, settings=settings, noise=noise)
        errors.append(result.coefficients.values - model.coefficients(names).values)
        covs.append(result.coefficients.cov)
    total = float(nees(np.array(errors), np.array(covs)).sum())
    return total, chi_square_limits(len(names) * n, tests=4), len(names) * n


@pytest.mark.thorough
@pytest.mark.parametrize("procedure", [ferraris, six_position])
@pytest.mark.parametrize("place", [0.0, 5 * ARCMIN])
def test_errors_have_the_size_that_was_promised(procedure, place):
    total, (low, high), _ = sessions(25, place, place, procedure)
    assert low < total < high


@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_a_wrong_placement_shows(factor):
    total, (low, high), _ = sessions(10, 5 * ARCMIN, 5 * ARCMIN * factor)
    assert total > high if factor < 1 else total < low


def test_an_estimated_placement_promises_enough():
    total, (low, _), dof = sessions(15, 5 * ARCMIN, None)
    # Student's, not Gauss's: the mean is right, the limits are wider.
    assert low * 0.7 < total < 1.6 * dof


@pytest.mark.thorough
def test_published_solution_has_its_own_uncertainty():
    total, (low, high), _ = sessions(8, 5 * ARCMIN, 5 * ARCMIN, solution="published")
    assert 0.9 * low < total < 1.1 * high
