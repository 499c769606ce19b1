"""An earlier result as prior, and results merged, over procedures; what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import campaign, procedures, run_folder, units
from foucault.campaign import earlier, optimisation
from foucault.coefficients import CoefficientVector
from foucault.diagnose.comparable import comparable, gravity_errors
from foucault.models.layouts import BESIDE, EVERY, gravity_slope
from foucault.procedures.merged import Earlier, merged, with_prior
from foucault.result import Level, Verdict
from make_compare import make_entries
from make_result import make_result
from refusals import refuses

QUICK = ("six_position", "norm_observation", "platform_tumble", "north_seeking", "ferraris")


def calibrated(path, output):
    one = campaign.load(path)
    result = campaign.calibrate(one)
    run_folder.save(result, output, campaign.resolved(one, output))
    return result


def two_sessions(name, folder):
    """Two sessions of the same instrument; the campaigns they are in."""
    described = campaign.parse(campaign.template(name), f"{name}.toml")
    # One place has one gravity: a simulation draws another for every seed.
    described = replace(described, site=replace(described.site, gravity_sd=0.0))
    first = campaign.simulate(described, seed=3)
    # The errors the first drew are given to the second, which draws other noise.
    drawn = procedures.load(name).draw_errors(described.simulate.grade, 3).coefficients()
    units = [c.unit for c in drawn.layout.coefficients]
    errors = {n: f"{v!r} {u}".strip() for n, v, u in zip(drawn.names, drawn.values.tolist(), units,
                                                        strict=True)}  # fmt: skip
    table = described.simulate.model_copy(update={"errors": errors})
    second = campaign.simulate(replace(described, simulate=table), seed=4)
    return (campaign.save_session(first, folder / "one"),
            campaign.save_session(replace(second, campaign=described), folder / "two"))  # fmt: skip


def with_from(path: Path, said: str) -> Path:
    text = path.read_text().replace("# [prior]", "# prior") + f"\n[prior]\n{said}\n"
    new = path.with_name("from.toml")
    new.write_text(text)
    return new


@pytest.mark.thorough
@pytest.mark.parametrize("name", QUICK)
def test_a_prior_is_what_merging_gives(name, tmp_path):
    one, two = two_sessions(name, tmp_path)
    a, b = calibrated(one, tmp_path / "a"), calibrated(two, tmp_path / "b")
    both = calibrated(with_from(two, 'from = "../a"'), tmp_path / "both")
    merged_ = earlier.merge([tmp_path / "a", tmp_path / "b"])
    names = merged_.coefficients.names
    assert not [n for n in names if n in BESIDE]
    got, want = both.coefficients.chosen(names), merged_.coefficients
    assert (np.abs(got.values - want.values) < 1e-3 * want.sd).all()
    np.testing.assert_allclose(got.sd, want.sd, rtol=1e-3)
    for result in (a, b):
        sd = result.coefficients.chosen(names).sd
        assert (want.sd <= sd * (1 + 1e-3)).all()
    check = both.checks[-1]
    assert check.passed, check.sentence
    assert both.provenance["prior"]["from"] == "../a"
    assert both.diagnostics["without_earlier"].keys() == set(b.coefficients.names)
    # The copy in the run folder gives the same again.
    again = campaign.calibrate(campaign.load(tmp_path / "both" / "campaign.toml"))
    np.testing.assert_array_equal(again.coefficients.values, both.coefficients.values)
    for path, text in ((one, 'from = "../a"'), (two, 'from = "../both"')):
        with refuses("merge.same_log"):
            campaign.calibrate(campaign.load(with_from(path, text)))


@pytest.fixture
def runs(tmp_path):
    """Two results of one instrument that agree, saved."""

    def inputs(letter):
        return {"inputs": [{"file": f"{letter}.csv", "sha256": letter * 64}]}

    rng = np.random.default_rng(1)
    first = make_result(diagnostics={})
    vector = first.coefficients
    vector = replace(vector, prior_sd=np.full(len(vector), np.inf))
    step = np.linalg.cholesky(2 * vector.cov) @ rng.standard_normal(len(vector))
    first = replace(first, coefficients=vector, provenance=inputs("a"), tables={})
    second = replace(first, provenance=inputs("b"),
                     coefficients=replace(vector, values=vector.values + step))  # fmt: skip
    for name, result in (("a", first), ("b", second)):
        run_folder.save(result, tmp_path / name)
    return first, second, tmp_path


def test_the_command(runs):
    first, second, folder = runs
    done = run("--json", "merge", folder / "a", folder / "b", "-o", folder / "m", code=0)
    assert json.loads(done.stdout)["verdict"] == "pass"
    result = run_folder.load_result(folder / "m")
    mean = 0.5 * (first.coefficients.values + second.coefficients.values)
    np.testing.assert_allclose(result.coefficients.values, mean, rtol=1e-9)
    np.testing.assert_allclose(result.coefficients.cov, 0.5 * first.coefficients.cov, rtol=1e-6,
                               atol=1e-12 * first.coefficients.cov.max())  # fmt: skip
    assert [i["sha256"][0] for i in result.provenance["inputs"]] == ["a", "b"]
    assert set(result.tables["merged"]["result"]) == {
        str(folder / "a"),
        str(folder / "b"),
        "merged",
    }
    page = (folder / "m" / "report.html").read_text()
    assert "Sessions merged" in page
    assert str(folder / "b") in page


def test_a_change_is_noticed(runs):
    first, second, _ = runs
    vector = second.coefficients
    moved = vector.values + 8 * vector.sd * (np.arange(len(vector)) == 4)
    second = replace(second, coefficients=replace(vector, values=moved))
    result = merged([("a", "1", first), ("b", "2", second)])
    assert result.verdict.level is Level.DOUBTFUL
    assert vector.names[4] in result.verdict.reasons[0]
    both = with_prior(second, Earlier("a", "1", first, {}), {})
    assert both.verdict.level is Level.DOUBTFUL
    # What may have grown so much since says nothing against it.
    grown = Earlier("a", "1", first, {vector.names[4]: 20 * vector.sd[4]})
    assert with_prior(second, grown, {}).verdict.level is Level.PASS
    assert with_prior(second, Earlier("a", "1", first, {}, 10.0), {}).verdict.level is Level.PASS


def session(letter, place=None, seed=1, prior=None):
    """A result of its own log, at a place whose gravity is known to 0.1 %, of one instrument."""
    made = make_result(diagnostics={})
    vector = made.coefficients
    rng = np.random.default_rng(seed)
    values = vector.values + np.linalg.cholesky(vector.cov) @ rng.standard_normal(len(vector))
    vector = replace(vector, values=values, prior_sd=np.full(len(vector), np.inf))
    for name, (mean, size) in (prior or {}).items():
        k = vector.layout.index(name)
        gain = vector.cov[k] / (vector.cov[k, k] + size**2)
        vector = replace(vector, values=vector.values + gain * (mean - vector.values[k]),
                         cov=vector.cov - np.outer(gain, vector.cov[k]))  # fmt: skip
        vector.prior_sd[k] = size
    given = {name: list(said) for name, said in (prior or {}).items()}
    site, facts = {}, {}
    if place is not None:
        L = 1e-3 * gravity_slope(vector)
        vector = replace(vector, cov=vector.cov + np.outer(L, L))
        site = {"gravity": 9.81, "gravity_sd": 9.81e-3, "latitude": place, "height": 0.0}
        facts = {"budget": {"local gravity": (L**2).tolist()}, "bound": vector.sd.tolist()}
    made_of = {"input": {"sha256": letter * 64}, "prior": {"given": given}}
    return replace(made, coefficients=vector, provenance=made_of, site=site, diagnostics=facts,
                   tables={})  # fmt: skip


def test_a_gravity_that_all_were_given_counts_once_however_they_are_merged():
    some = [(c, c, session(c, 0.5, k)) for k, c in enumerate("abcd")]
    at_once = merged(some).coefficients
    one_by_one = some[0]
    for k, other in enumerate(some[1:]):
        one_by_one = ("m", f"m{k}", merged([one_by_one, other]))
    np.testing.assert_allclose(one_by_one[2].coefficients.sd, at_once.sd, rtol=1e-5)
    own = np.sqrt(np.diag(make_result().coefficients.cov))[at_once.layout.index("accel.scale.x")]
    assert at_once["accel.scale"].sd[0] == pytest.approx(np.hypot(1e-3, own / 2), rel=0.01)
    # A prior is the same: the session cannot make its own gravity better known.
    earlier_ = Earlier("m", "m", merged(some[:3]), {})
    both = with_prior(some[3][2], earlier_, {})
    np.testing.assert_allclose(both.coefficients.sd, at_once.sd, rtol=1e-5)
    assert not {"budget", "bound"} & set(both.diagnostics)  # of the session alone
    # Another place has another error.
    two = merged([*some[:2], ("e", "e", session("e", 0.7, 9))]).coefficients
    assert two["accel.scale"].sd[0] == pytest.approx(1e-3 / np.sqrt(2), rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["norm_observation", "ferraris", "platform_tumble", "systematic"])
def test_what_a_result_owes_to_gravity_is_what_another_gravity_makes(name, tmp_path):
    """However a procedure uses gravity, its results say by how much each coefficient follows it."""
    described = campaign.parse(campaign.template(name), f"{name}.toml")
    one = campaign.load(campaign.save_session(campaign.simulate(described, seed=3), tmp_path))
    site = replace(one.site, gravity=one.site.gravity + one.site.gravity_sd)
    result, other = (campaign.calibrate(c) for c in (one, replace(one, site=site)))
    vector = result.coefficients
    sure = [i for i, n in enumerate(vector.names) if "quadratic" not in n]
    step = (other.coefficients.values - vector.values)[sure]
    (error,) = gravity_errors(result, vector).values()
    np.testing.assert_allclose(step / vector.sd[sure], error[sure] / vector.sd[sure], atol=0.05)
    scale = vector.layout.index("accel.scale.x")
    assert error[scale] == pytest.approx(-one.site.gravity_sd / one.site.gravity, rel=0.05)


def test_the_prior_of_a_prior_is_remembered():
    first, second, third = (session(c, seed=k) for k, c in enumerate("abc"))
    second = with_prior(second, Earlier("a", "1", first, {}), {})
    third = with_prior(third, Earlier("b", "2", second, {}), {})
    with refuses("merge.same_log"):
        merged([("c", "3", third), ("a", "1", first)])
    with refuses("merge.same_log"):
        with_prior(first, Earlier("c", "3", third, {}), {})
    with refuses("compare.took_prior"):
        comparable(make_entries([first, third]))


def test_the_mean_of_a_prior_is_remembered_by_a_result_that_takes_it():
    """A prior of the first session counts once and with its mean, in whichever order."""
    prior = {"gyro.bias.x": (-1.8e-3, 3e-5)}
    first = session("a", seed=1, prior=prior)
    second = with_prior(session("b", seed=2), Earlier("a", "1", first, {}), {})
    third = session("c", seed=3, prior=prior)
    one, other = (
        merged(order).coefficients
        for order in (
            [("b", "2", second), ("c", "3", third)],
            [("c", "3", third), ("b", "2", second)],
        )
    )
    np.testing.assert_allclose(one.values, other.values, atol=1e-6 * one.sd.min())
    np.testing.assert_allclose(one.sd, other.sd, rtol=1e-6)


def test_an_entry_of_its_own_takes_the_place_of_the_earlier_result(runs):
    first, second, _ = runs
    name = "gyro.bias.x"
    one = Earlier("a", "1", first, {})
    assert name not in one.known(without=["gyro.bias"]).vector.names
    assert name in one.known().vector.names
    both = with_prior(second, one, {"gyro.bias": (0.0, 1.0)})
    assert both.coefficients.chosen([name]).sd[0] < second.coefficients.chosen([name]).sd[0]


def test_coefficients_that_only_one_has(runs):
    first, second, _ = runs
    names = [n for n in second.coefficients.names if not n.startswith("gyro.scale")]
    fewer = replace(second, coefficients=second.coefficients.chosen(names))
    result = merged([("a", "1", first), ("b", "2", fewer)])
    assert [f.code for f in result.findings] == ["merge.only_some"]
    both = with_prior(fewer, Earlier("a", "1", first, {}), {})
    assert both.coefficients.names == fewer.coefficients.names
    assert "gyro.scale.x" in next(f for f in both.findings if f.code == "prior.left").message
    triads = [second.coefficients[t] for t in ("accel", "gyro")]
    halves = [replace(r, coefficients=v) for r, v in zip((first, second), triads, strict=True)]
    assert merged([("a", "1", halves[0]), ("b", "2", halves[1])]).findings == ()


def mistaken(code, change, runs, sha="2"):
    first, second, _ = runs
    with refuses(code, "'b'"):
        merged([("a", "1", first), ("b", sha, replace(second, **change(second)))])


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("merge.instrument", lambda r: {"instrument": {"serial": "other"}}),
        ("merge.gauge", lambda r: {"gauge": "upper"}),
        ("merge.same_log", lambda r: {"provenance": {"input": {"sha256": "x + " + "a" * 64}}}),
        ("merge.took_prior", lambda r: {"provenance": {"prior": {"sha256": "1"}}}),
        ("merge.unusable", lambda r: {"verdict": Verdict(Level.UNUSABLE, ("bad",))}),
        ("merge.nothing", lambda r: {"coefficients": CoefficientVector(
            r.coefficients.layout, r.coefficients.values)}),
        ("merge.models", lambda r: {"coefficients": CoefficientVector.zeros(
            EVERY.subset(["gyro.torquer_scale.x"]))}),
    ],
)  # fmt: skip
def test_what_cannot_be_merged(code, change, runs):
    mistaken(code, change, runs)


def test_one_result_is_not_merged(runs):
    with refuses("merge.one"):
        merged([("a", "1", runs[0])])
    mistaken("merge.same_log", lambda r: {}, runs, sha="1")


def test_results_over_temperature_are_not_merged(runs):
    mistaken("merge.temperature", lambda r: {"temperature": object()}, runs)


TOML = """
log.file = "log.csv"
site.latitude = "48 deg"
procedure.name = "six_position"
[prior]
"""


@pytest.mark.parametrize(
    ("said", "code", "words"),
    [
        ("inflate = 2", "prior.alone", "inflate"),
        ('from = "run"\ninflate = 0', "prior.growth", "prior.inflate"),
        ('from = "run"\ninflate = nan', "prior.growth", "prior.inflate"),
        ('from = 3', "campaign.value", "prior.from"),
        ('from = "run"\ngrowth = {"gyro.bias" = 3}', "campaign.value", 'prior.growth."gyro.bias"'),
    ],
)  # fmt: skip
def test_mistakes_in_the_campaign(said, code, words):
    with refuses(code) as caught:
        campaign.parse(TOML + said)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("said", "code"),
    [
        ('growth = {"gyro.bais" = "1 deg/h"}', "coefficient.unknown"),
        ('growth = {"gyro.bias" = "1 mg"}', "unit.kind"),
        ('growth = {"gyro.bias" = "-1 deg/h"}', "prior.growth"),
        ('growth = {"gyro" = "1 deg/h"}', "prior.kind"),
        ("", "result.missing"),
    ],
)
def test_mistakes_that_show_when_it_is_read(said, code, tmp_path):
    table = campaign.parse(TOML + f'from = "none"\n{said}').earlier
    with refuses(code):
        earlier.read(table, tmp_path)


def test_commands_that_have_no_use_for_it():
    described = campaign.parse(TOML + 'from = "run"')
    with refuses("prior.not_here"):
        earlier.refuse(described, "a plan")
    with refuses("prior.not_here"):
        optimisation.beforehand(described)


@pytest.mark.thorough
@pytest.mark.parametrize("loose", ["", 'growth = {"gyro.bias" = "50 deg/h"}\n', "inflate = 1000.0"])
def test_a_plan_is_judged_with_what_is_known(loose, tmp_path):
    result = make_result()
    run_folder.save(result, tmp_path / "run")
    path = tmp_path / "campaign.toml"
    alone = optimisation.foresee(campaign.parse(campaign.template("hand_rotated"), path))
    text = campaign.template("hand_rotated") + f'\n[prior]\nfrom = "run"\n{loose}\n'
    found = optimisation.foresee(campaign.parse(text, path))
    names = [n for n in found.names if n in result.coefficients.layout]
    both = found.coefficients.chosen(names)
    plan, before = alone.coefficients.chosen(names), result.coefficients.chosen(names)
    assert (both.sd <= plan.sd * (1 + 1e-9)).all()
    if "growth" not in loose:
        scale = 1000.0 if "inflate" in loose else 1.0
        whole = np.linalg.inv(np.linalg.inv(plan.cov) + np.linalg.inv(before.cov) / scale**2)
        np.testing.assert_allclose(both.cov, whole, rtol=1e-4, atol=1e-6 * np.abs(whole).min())
        np.testing.assert_allclose(both.prior_sd, scale * before.sd)
    else:
        at = found.names.index("gyro.bias.x")
        grown = np.hypot(
            result.coefficients["gyro.bias.x"].sd[0], units.parse("50 deg/h", "angular rate")
        )
        assert found.prior_sd[at] == pytest.approx(grown)


def bent(folder, seed, sequence, errors):
    """A session of an instrument whose gyros bend, by `sequence`; the file of its campaign."""
    text = campaign.template("systematic")
    for old, new in (
        ('deflection = "none"', 'deflection = "coupled6"'), ('["19 positions"]', sequence),
        ('# rest_time = "60 s"', 'rest_time = "40 s"'), ('rate = "50 Hz"', 'rate = "20 Hz"'),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    one = campaign.parse(text, "systematic.toml")
    one = replace(one, site=replace(one.site, gravity_sd=0.0))
    one = replace(one, simulate=one.simulate.model_copy(update={"errors": errors}))
    return campaign.save_session(campaign.simulate(one, seed=seed), folder)


@pytest.mark.thorough
def test_a_result_with_deflection_is_a_prior(tmp_path):
    drawn = procedures.load("hand_rotated").draw_errors("navigation", 3).coefficients()
    estimated = ("bias", "scale", "misalignment")
    errors = {
        c.name: f"{v if c.name.split('.')[1] in estimated else 0.0!r} {c.unit}".strip()
        for c, v in zip(drawn.layout.coefficients, drawn.values.tolist(), strict=True)
    }
    errors |= {"gyro.deflection.xyy": "1 arcsec/g", "gyro.deflection.xzy": "1 arcsec/g"}
    first = bent(tmp_path / "one", 3, '["19 positions", "spins, simple 6"]', errors)
    a = calibrated(first, tmp_path / "a")
    # Without spins it cannot tell how they bend, and is refused: the earlier result says it.
    second = bent(tmp_path / "two", 4, '["19 positions"]', errors)
    with refuses("systematic.deflection_unseen"):
        campaign.calibrate(campaign.load(second))
    both = campaign.calibrate(campaign.load(with_from(second, 'from = "../a"')))
    names = [n for n in both.coefficients.names if n.startswith("gyro.deflection")]
    assert len(names) == 12
    assert both.checks[-1].passed, both.checks[-1].sentence
    got, before = both.coefficients.chosen(names), a.coefficients.chosen(names)
    assert (got.sd <= before.sd * (1 + 1e-6)).all()
    assert (got.sd > 0.9 * before.sd).all()
    assert (np.abs(got.values - before.values) < before.sd).all()
    seen = optimisation.foresee(campaign.load(second.with_name("from.toml"))).coefficients
    np.testing.assert_allclose(seen.chosen(names).sd, got.sd, rtol=0.05)
    other = second.with_name("other.toml")
    other.write_text(
        second.with_name("from.toml").read_text().replace("coupled6", "lateral3+axial6")
    )
    with refuses("systematic.deflection_unseen"):
        campaign.calibrate(campaign.load(other))
