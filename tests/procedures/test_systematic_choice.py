"""Choice of the model of deflection: whether gyros bend, by which model, and what is said of it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign
from foucault.campaign import study
from foucault.coefficients import CoefficientVector
from foucault.diagnose import deflection
from foucault.diagnose.deflection import GENERAL18, UNIT, Told
from foucault.estimate.systematic import Start, attitude_at_start
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.deflection import deflection_model
from foucault.models.earth import Site
from foucault.procedures import systematic
from foucault.procedures.systematic import choice as procedure
from foucault.procedures.systematic.problem import problem_of
from foucault.procedures.systematic.settings import PRIOR, Settings
from foucault.report import html
from foucault.report import systematic as report
from foucault.result import Level
from make_sequence import DEG, NOISE
from refusals import refuses
from sessions import codes

SITE = Site.at(40 * DEG, 100.0)
SIMPLE = ("19 positions", "spins, simple 6")
BOTH = (*SIMPLE, "spins, icosahedral 6")
PRIORS = {"deflection": PRIOR["deflection"]}
SHORT = systematic.Session(rest_time=30.0, rate=25.0)


def session(truth, theta=None, *, sequence=SIMPLE, seed=1, chirality=-1, rate=25.0):
    """Simulate a session of an instrument that bends by `theta` [arcsec/g], or not at all."""
    settings = Settings(sequence=sequence, deflection="choose")
    T = np.full((3, 3, 3), 1e-30)
    if truth is not None:
        T = deflection_model(truth, chirality).tensor(np.array(theta) * UNIT)
    model = replace(systematic.draw_errors("navigation", seed), deflection=T)
    made = systematic.simulate(
        systematic.Session(rest_time=30.0, rate=rate), settings=settings, model=model, noise=NOISE,
        site=SITE, seed=seed,
    )  # fmt: skip
    return settings, made


def trial(settings, made, **more):
    return systematic.trial(made.log, site=SITE, settings=settings, noise=NOISE, **more)


def said(result):
    return next(c for c in result.checks if c.name == "deflection")


@pytest.fixture(scope="module")
def bending():
    return session("coupled6", [2.0, -1.5, 3.0, 2.5, -2.0, 1.0])


@pytest.fixture(scope="module")
def rigid():
    return session(None, seed=4)


@pytest.fixture(scope="module")
def other_sense():
    """Both sets of spins, and the sense that is not the usual one."""
    return session("coupled6", [2.0, -1.5, 3.0, 2.5, -2.0, 1.0], sequence=BOTH, chirality=1,
                   rate=50.0)  # fmt: skip


# -- the numbers -----------------------------------------------------------------------------------


def told(sd=0.05 * UNIT, T=None, seed=None):
    """What an imagined session says that sees all bendings, each as well."""
    J = np.eye(18) / sd**2
    y = np.zeros(18) if T is None else J @ T
    if seed is not None:
        y = y + np.random.default_rng(seed).standard_normal(18) / sd
    return Told(J, y)


def test_what_was_known_beforehand_is_taken_out():
    """Posterior of a linear measurement of all bendings and of one thing more."""
    rng = np.random.default_rng(1)
    settings = Settings(deflection="general18")
    layout = settings.sensors.layout.subset((*GENERAL18.layout.names, "accel.bias.x"))
    names, n = layout.names, 19
    A, z = rng.normal(size=(40, n)) / UNIT, rng.normal(size=40)
    at = [names.index(name) for name in GENERAL18.layout.names]
    (other,) = set(range(n)) - set(at)
    A[:, other] *= UNIT
    mean, sd = rng.normal(size=n), np.full(n, 5 * UNIT)
    mean[at] *= UNIT
    sd[other] = 2.0
    cov = np.linalg.inv(A.T @ A + np.diag(sd**-2))
    states = CoefficientVector(layout, cov @ (A.T @ z + mean / sd**2), cov, prior_sd=sd)
    found = Told.of(states, mean[at])
    # With the other averaged out the measurements have this covariance.
    V = np.eye(40) + sd[other] ** 2 * np.outer(A[:, other], A[:, other])
    J = A[:, at].T @ np.linalg.solve(V, A[:, at])
    y = A[:, at].T @ np.linalg.solve(V, z - A[:, other] * mean[other])
    np.testing.assert_allclose(found.information, J, rtol=1e-6, atol=1e-9 * J.max())
    np.testing.assert_allclose(found.score, y, rtol=1e-6, atol=1e-9 * np.abs(y).max())


def test_odds_are_those_of_gaussian_measurements():
    """Against densities of an imagined measurement, prior with a mean, seen in part."""
    from scipy.stats import multivariate_normal

    rng = np.random.default_rng(2)
    model = deflection_model("direct6+transverse3")
    A, z = rng.normal(size=(7, 18)) / (0.1 * UNIT), 30 * rng.normal(size=7)  # of nine, seven
    J, y = A.T @ A, A.T @ z
    prior = CoefficientVector(model.layout, rng.normal(size=9) * UNIT,
                              prior_sd=rng.uniform(1, 3, 9) * UNIT)  # fmt: skip
    found = deflection.candidate(Told(J, y), model, prior, sided=False, known=True)
    D = A @ deflection.in_general(model)
    V = np.eye(7) + D @ np.diag(prior.prior_sd**2) @ D.T
    want = multivariate_normal(D @ prior.values, V).logpdf(z) - multivariate_normal(
        np.zeros(7)
    ).logpdf(z)
    assert found.log_odds == pytest.approx(want, rel=1e-9)
    assert found.rank == 7 and not found.whole and np.isinf(found.bound)
    # All that is measured is explained.
    assert found.square == pytest.approx(z @ z, rel=1e-6)


@pytest.mark.thorough
def test_the_gain_is_chi_square_where_nothing_bends():
    """Ten thousand draws of each model; the bound holds as often as it says."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(25, 18)) / UNIT
    J = A.T @ A
    root = np.linalg.cholesky(J)
    prior = CoefficientVector.prior(deflection_model("coupled6").layout, PRIORS)
    model = deflection_model("coupled6")
    theta = np.array([0.5, -1.0, 0.2, 0.0, 2.0, 1.0]) * UNIT
    runs, squares, held, beyond = 2000, 0.0, 0, 0
    for _ in range(runs):
        noise = root @ rng.standard_normal(18)
        found = deflection.candidate(Told(J, noise), model, prior, sided=True, known=False)
        squares += found.square
        beyond += found.chance < 0.01
        bent = Told(J, noise + J @ (deflection.in_general(model) @ theta))
        held += (
            deflection.candidate(bent, model, prior, sided=True, known=False).bound
            > np.abs(theta).max()
        )
    low, high = chi_square_limits(6 * runs)
    assert low < squares < high
    assert 8 <= beyond <= 34  # binomial, 1 %
    assert held > 0.94 * runs


def test_every_model_once_and_both_senses_where_they_differ():
    for first in (-1, 1):
        labels = [(m.name, m.chirality) for m in deflection.candidates(first)]
        assert labels == [
            ("coupled6", first), ("coupled6", -first), ("direct6", first),
            ("direct6+transverse3", first), ("lateral3+axial6", first), ("direct12", first),
            ("general18", first), ("symmetric6", first),
        ]  # fmt: skip


@pytest.mark.thorough
def test_odds_are_what_filters_with_each_model_say(bending):
    """Innovations of a filter with each model, all with the same knowledge of all else."""
    settings, made = bending
    p = problem_of(made.log, SITE, settings, NOISE, {})
    choice, begun, first, base = procedure.choice_of(p, settings, PRIORS)
    run = base.run
    C_nb = attitude_at_start(run, run.trajectory.C_nb[0])
    phi = np.minimum(p.phi_sd, 30 * np.sqrt(np.diag(run.attitude_cov)))

    def log_likelihood(name, chirality=-1):
        one = first.model_copy(update={"deflection": name, "chirality": chirality})
        q = replace(p, sensors=one.sensors)
        prior = CoefficientVector.prior(
            q.sensors.layout, {k: v for k, v in PRIORS.items() if name != "none"}
        )
        values, sd = prior.values.copy(), prior.prior_sd.copy()
        for i, state in enumerate(q.sensors.layout.names):
            if not state.startswith("deflection"):
                at = begun.sensors.layout.index(state)
                values[i] = base.states.values[at]
                sd[i] = min(base.states.prior_sd[at], 30 * base.states.sd[at])
        start = Start(q.first, C_nb, p.start_cov(phi)[:9, :9])
        found = replace(q.model, noise=NOISE).filtered([start], values, sd)
        return -0.5 * np.nansum(found.innovation**2 / found.variance + np.log(found.variance))

    odds = {(c.model.name, c.model.chirality): c.log_odds for c in choice.candidates}
    base_line = log_likelihood("coupled6")
    for name, c in (("coupled6", 1), ("direct6+transverse3", -1), ("general18", -1)):
        gap = odds[name, c] - odds["coupled6", -1]
        assert gap == pytest.approx(log_likelihood(name, c) - base_line, abs=0.3)
    # Without any the errors are so large that nothing is linear any more.
    none = base_line - log_likelihood("none")
    assert odds["coupled6", -1] == pytest.approx(none, rel=0.01)


# -- what is chosen --------------------------------------------------------------------------------


@pytest.mark.thorough
def test_no_deflection_is_seen_where_there_is_none(rigid):
    settings, made = rigid
    result = trial(settings, made)
    assert not [n for n in result.coefficients.names if "deflection" in n]
    assert result.diagnostics["filter"]["deflection"] == "none"
    assert said(result).passed and not result.findings
    assert said(result).sentence.startswith("No deflection is seen: by coupled6, chirality ")
    assert "no coefficient is above 0." in said(result).sentence
    none, *models = result.diagnostics["choice"]["models"]
    assert none["used"] and not any(m["used"] for m in models)
    # The same as without any choice.
    plain = trial(settings.model_copy(update={"deflection": "none"}), made)
    np.testing.assert_array_equal(plain.coefficients.values, result.coefficients.values)


@pytest.mark.thorough
def test_the_model_is_found_and_its_coefficients_are_the_result(bending):
    settings, made = bending
    result = trial(settings, made)
    named = trial(settings.model_copy(update={"deflection": "coupled6"}), made)
    np.testing.assert_array_equal(named.coefficients.values, result.coefficients.values)
    assert result.diagnostics["filter"]["deflection"] == "coupled6"
    assert result.diagnostics["filter"]["chirality"] == -1
    assert said(result).passed
    words = said(result).sentence
    assert words.startswith("The gyros bend: coupled6, chirality -1, 6 coefficients; the ")
    assert "less than 1e-99. Of the others " in words
    assert re.search(r" \(seen in part, \d+ of \d+\) comes next, \S+ times less likely\.$", words)
    ranks = {m["label"]: m["rank"] for m in result.diagnostics["choice"]["models"]}
    assert ranks["coupled6, chirality -1"] == 6 and ranks["general18"] < 18


@pytest.mark.thorough
def test_the_other_sense_is_found_and_solved_anew(other_sense):
    settings, made = other_sense
    result = trial(settings, made)
    assert result.diagnostics["filter"]["chirality"] == 1
    assert not result.findings and result.verdict.level is Level.PASS
    model = deflection_model("coupled6", 1)
    truth = made.model.coefficients(model.names).values
    at = [result.coefficients.layout.index(n) for n in model.names]
    miss = np.abs(result.coefficients.values[at] - truth) / result.coefficients.sd[at]
    assert miss.max() < 4.0
    shares = [m["log_odds"] for m in result.diagnostics["choice"]["models"] if m["used"]]
    assert shares[0] > 10 + max(
        m["log_odds"] for m in result.diagnostics["choice"]["models"] if not m["used"]
    )


@pytest.mark.thorough
def test_a_wrong_sense_that_was_named_is_told_where_it_is_shown(other_sense):
    settings, made = other_sense
    wrong = settings.model_copy(update={"deflection": "coupled6", "chirality": -1})
    quick = trial(wrong, made)
    assert "choice" not in quick.diagnostics  # a study does not pay for it
    result = systematic.calibrate(made.log, site=SITE, settings=wrong, noise=NOISE)
    (found,) = [f for f in result.findings if f.code == "systematic.choice_rival"]
    assert "with the deflection model coupled6, chirality 1 than with coupled6, chirality -1" in (
        found.message
    )
    assert found.cure == 'Set deflection = "coupled6" and chirality = 1.'
    assert not said(result).passed and result.verdict.level is not Level.PASS
    assert ". But coupled6, chirality 1 is e^" in said(result).sentence
    section = report.deflection(result)
    rows = {row[1]: row for row in section.blocks[0].rows}
    assert rows["coupled6, chirality -1"][-1] == "used"
    assert rows["coupled6, chirality 1"][-1] == "better"
    assert rows["none"][-1] == "ruled out"
    assert "Do the gyros bend" in html(result)


@pytest.mark.thorough
def test_the_published_steps_are_compared_too(bending):
    settings, made = bending
    steps = settings.model_copy(update={"steps": "published"})
    found = procedure.decided(made.log, SITE, steps, NOISE, {}, compare=True)
    assert found.settings.steps == "published" and found.settings.deflection == "coupled6"
    named = steps.model_copy(update={"deflection": "coupled6"})
    other = procedure.decided(made.log, SITE, named, NOISE, {}, compare=True)
    assert other.choice.used.label == "coupled6, chirality -1"
    for a, b in zip(found.choice.candidates, other.choice.candidates, strict=True):
        assert a.log_odds == pytest.approx(b.log_odds, abs=1e-6)


@pytest.mark.thorough
def test_a_model_that_is_seen_in_part_warns_or_is_chosen_with_a_prior():
    """Bending along the force alone: six poses see five of its six combinations."""
    settings, made = session("direct6", [4.0, -3.0, 4.0, 5.0, -4.0, 3.0], seed=3)
    result = trial(settings, made)
    assert result.diagnostics["filter"]["deflection"] == "coupled6"
    (found,) = [f for f in result.findings if f.code == "systematic.choice_rival"]
    assert "model direct6 than with coupled6" in found.message
    assert found.cure.startswith("The session does not see it whole: add spins in six other poses")
    assert not said(result).passed
    helped = trial(settings, made, prior={"deflection": (0.0, 4 * UNIT)})
    assert helped.diagnostics["filter"]["deflection"] == "direct6"
    assert said(helped).passed
    assert "systematic.deflection_prior" in codes(helped)


def test_a_session_that_sees_no_model_whole_is_refused():
    settings, made = session(None, sequence=("19 positions",))
    with refuses("systematic.choice_unseen") as caught:
        trial(settings, made)
    assert "coupled6, chirality -1 3 of 6" in caught.value.message
    assert caught.value.cure.startswith("Add spins of ten turns about a level axis in six poses")


# -- what is said ----------------------------------------------------------------------------------


def judged(told, used=None):
    choice = deflection.judged(told, PRIORS)
    one = deflection.chosen(choice) if used is None else next(
        c for c in choice.candidates if c.label == used
    )  # fmt: skip
    return replace(choice, used=one)


def test_models_that_are_not_told_apart_are_named():
    """Their common part bends: both senses say the same but for what is hardly seen."""
    both = [deflection.in_general(deflection_model("coupled6", c)) for c in (-1, 1)]
    common = both[0] + both[1]
    seen = common / np.linalg.norm(common, axis=0)
    J = (seen @ seen.T / 0.05**2 + np.eye(18) / 2.9**2) / UNIT**2
    choice = judged(Told(J, J @ both[0] @ (np.array([2.0, -1.0, 1.5, 1.0, -2.0, 1.2]) * UNIT)))
    assert sum(choice.shares.values()) == pytest.approx(1.0)
    (found,) = deflection.findings(choice, asked=True)
    assert found.code == "systematic.choice_close"
    assert "coupled6, chirality -1 " in found.message and "coupled6, chirality 1 " in found.message
    assert '"spins, icosahedral 6"' in found.cure
    # Who has named a model has chosen.
    assert deflection.findings(choice, asked=False) == []


def test_a_bending_that_no_model_explains_that_is_seen_whole():
    """Of what force along the axes does the session sees one combination, and it is not zero."""
    model = deflection_model("lateral3+axial6")
    axial = deflection.in_general(model)[:, model.layout.names.index("deflection.xyx")]
    coupled = deflection.in_general(deflection_model("coupled6"))
    J = (np.outer(axial, axial) + coupled @ coupled.T) / (0.05 * UNIT) ** 2
    choice = judged(Told(J, J @ axial * UNIT))
    assert choice.used is None and choice.bends
    check = deflection.deflection_check(choice)
    assert not check.passed
    assert re.fullmatch(
        "The gyros bend, but as no model says that this session sees whole; the likeliest is "
        r"\S+, of which it sees \d+ of \d+ combinations\.", check.sentence,
    )  # fmt: skip


def test_a_deflection_that_was_named_and_is_not_there():
    choice = judged(told(seed=5), "coupled6, chirality -1")
    check = deflection.deflection_check(choice)
    assert check.passed
    assert check.sentence.startswith("The deflection does not differ from zero at 1 %: by ")


def test_a_study_needs_a_model_by_name(tmp_path):
    text = campaign.template("systematic").replace('deflection = "none"', 'deflection = "choose"')
    with refuses("systematic.choice_study") as caught:
        study.run(campaign.parse(text), 2, tmp_path)
    assert caught.value.cure == 'Name a model, such as deflection = "coupled6".'


def test_what_is_simulated_for_a_choice_bends():
    settings = Settings(sequence=SIMPLE, deflection="choose", chirality=1)
    made = systematic.simulate(
        SHORT, settings=settings, model=systematic.draw_errors("navigation", 1), noise=NOISE,
        site=SITE, seed=1,
    )  # fmt: skip
    names = deflection_model("coupled6", 1).names
    T = dict(zip(names, made.model.coefficients(names).values, strict=True))
    assert abs(T["gyro.deflection.xyy"]) > 0.1 * UNIT
    assert T["gyro.deflection.xzy"] == pytest.approx(-T["gyro.deflection.xyy"])
