"""The report of a Monte Carlo study says whether the uncertainties were right."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.diagnose.study import Study
from foucault.infer.gauss_newton import chi_square_density
from foucault.models.imu import LINEAR_LOWER
from foucault.report import render
from foucault.report import study as study_report
from pages import figures, titles

ABOUT = {"procedure": "hand_rotated", "n": 80, "seed": 4, "version": "0.1.0"}


def make_study(factor: float = 1.0, failures: int = 0, n: int = 80, bound: bool = True) -> Study:
    """Return trials whose true errors are `factor` times what they were predicted to be."""
    rng = np.random.default_rng(8)
    names = LINEAR_LOWER
    sd = np.tile(np.geomspace(1e-5, 1e-3, len(names)), (n, 1))
    unit = factor * rng.normal(size=sd.shape)
    status = {"converged": n} | ({"not converged": failures} if failures else {})
    limit = sd / 1.1 if bound else np.full(sd.shape, np.nan)
    return Study(names, unit * sd, sd, limit, np.sum(unit**2, axis=1), status)


def test_a_study_that_is_right_passes():
    page = render(study_report.document(make_study(), ABOUT))
    assert '<p class="word">Pass</p>' in page
    assert "Monte Carlo study of hand_rotated" in page and "80 trials" in page
    assert titles(page) == [
        "Checks",
        "Error of every coefficient",
        "Errors against predicted uncertainty",
        "NEES",
        "Coverage",
        "How the trials ended",
        "Provenance",
    ]


def test_a_halved_covariance_is_doubtful_and_says_why():
    page = render(study_report.document(make_study(factor=np.sqrt(2)), ABOUT))
    assert '<p class="word">Doubtful</p>' in page
    assert "the uncertainties are too small" in page


def test_figures_show_the_numbers_of_the_study():
    study = make_study()
    rows = study.rows()
    ratio, mean, nees, coverage = figures(render(study_report.document(study, ABOUT)))
    np.testing.assert_allclose(ratio["data"][0]["x"], [r["ratio"] for r in rows], rtol=1e-5)
    band = ratio["layout"]["shapes"][0]
    assert (band["x0"], band["x1"]) == (rows[0]["ratio_low"], rows[0]["ratio_high"])
    np.testing.assert_allclose(mean["data"][0]["x"], [r["mean_z"] for r in rows], rtol=1e-5)
    bars = nees["data"][0]
    inside = [np.sum(np.abs(study.nees - x) < bars["width"] / 2) for x in bars["x"]]
    shown = np.array(inside) / (len(study.nees) * bars["width"])
    np.testing.assert_allclose(bars["y"], shown, rtol=1e-2, atol=1e-9)
    assert sum(inside) == len(study.nees)
    x, density = (np.array(nees["data"][1][k]) for k in "xy")
    assert float(np.diff(x) @ (density[1:] + density[:-1])) / 2 == pytest.approx(1, abs=2e-3)
    np.testing.assert_allclose(
        coverage["data"][0]["x"], [100 * r["coverage_68"] for r in rows], rtol=1e-5
    )


def test_coefficients_outside_their_limits_stand_out():
    study = make_study()
    study.error[:, 2] *= 3
    ratio = figures(render(study_report.document(study, ABOUT)))[0]
    outside = next(t for t in ratio["data"] if t["name"] == "outside")
    assert outside["y"] == [study.names[2]]
    assert outside["marker"]["symbol"] != ratio["data"][0]["marker"]["symbol"]


def test_failures_are_counted_by_status():
    page = render(study_report.document(make_study(failures=20), ABOUT))
    assert '<p class="word">Doubtful</p>' in page
    assert "not converged" in page and "20.0\N{NO-BREAK SPACE}%" in page


def test_without_a_bound_its_column_is_left_out():
    assert "RMS / bound" in render(study_report.document(make_study(), ABOUT))
    assert "RMS / bound" not in render(study_report.document(make_study(bound=False), ABOUT))


def test_a_study_without_estimates_is_still_a_page():
    empty = np.empty((0, len(LINEAR_LOWER)))
    study = Study(LINEAR_LOWER, empty, empty, empty, np.empty(0), {"rests.too_few": 40})
    page = render(study_report.document(study, ABOUT))
    assert '<p class="word">Unusable</p>' in page
    assert titles(page) == ["Checks", "How the trials ended", "Provenance"]
    assert "rests.too_few" in page


def test_density_is_that_of_chi_square():
    from scipy.stats import chi2

    x = np.linspace(0, 60, 31)
    for dof in (1.0, 2.0, 21.0):
        expected = chi2.pdf(x[1:], dof)
        np.testing.assert_allclose(chi_square_density(x, dof)[1:], expected, rtol=1e-12)
    assert chi_square_density(np.zeros(1), 2.0) == pytest.approx(0.5)
