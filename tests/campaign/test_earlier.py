"""An earlier result as prior, and results merged, over procedures; what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from foucault import campaign, procedures, run_folder
from foucault.campaign import earlier, preflight
from foucault.cli import app
from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.models.layouts import BESIDE, EVERY
from foucault.procedures.merged import Earlier, merged, with_prior
from foucault.result import Level, Verdict
from make_result import make_result

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
    module = procedures.load(name)
    draw = getattr(module, "draw_errors", campaign.running.draw_errors)
    drawn = draw(described.simulate.grade, 3).coefficients()
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
        with pytest.raises(FoucaultError) as caught:
            campaign.calibrate(campaign.load(with_from(path, text)))
        assert caught.value.code == "merge.same_log"


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
    said = ["--json", "merge", str(folder / "a"), str(folder / "b"), "-o", str(folder / "m")]
    done = CliRunner().invoke(app, said)
    assert done.exit_code == 0, done.output
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
    with pytest.raises(FoucaultError) as caught:
        merged([("a", "1", first), ("b", sha, replace(second, **change(second)))])
    assert caught.value.code == code
    assert "'b'" in str(caught.value)


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
    with pytest.raises(FoucaultError) as caught:
        merged([("a", "1", runs[0])])
    assert caught.value.code == "merge.one"
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
    with pytest.raises(FoucaultError) as caught:
        campaign.parse(TOML + said)
    assert caught.value.code == code
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("said", "code"),
    [
        ('growth = {"gyro.bais" = "1 deg/h"}', "coefficient.unknown"),
        ('growth = {"gyro.bias" = "1 mg"}', "unit.kind"),
        ('growth = {"gyro.bias" = "-1 deg/h"}', "prior.growth"),
        ("", "result.missing"),
    ],
)
def test_mistakes_that_show_when_it_is_read(said, code, tmp_path):
    table = campaign.parse(TOML + f'from = "none"\n{said}').earlier
    with pytest.raises(FoucaultError) as caught:
        earlier.read(table, tmp_path)
    assert caught.value.code == code


def test_commands_that_have_no_use_for_it():
    described = campaign.parse(TOML + 'from = "run"')
    with pytest.raises(FoucaultError) as caught:
        earlier.refuse(described, "a plan")
    assert caught.value.code == "prior.not_here"
    with pytest.raises(FoucaultError) as caught:
        preflight.foresee(described)
    assert caught.value.code == "prior.not_here"
