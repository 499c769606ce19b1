"""The command optimise: what it prints and writes, how it goes on, and how it ends."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from commands import run
from foucault.campaign import optimisation, reading

EXAMPLE = Path(__file__).parents[2] / "examples/platform_tumble.toml"
BRIEF = "latitudes = []\ntruths = 1\n"
FASTER = f'[optimise]\nrates = ["0.2 deg/s"]\n{BRIEF}'
SIZE = ("--restarts", 3, "--evaluations", 60, "--round", 2, "--workers", 1)


def write_campaign(folder: Path, optimise: str = FASTER, procedure: str = "") -> Path:
    """Return a campaign file with this table [optimise] and lines in [procedure]."""
    before, _, _ = EXAMPLE.read_text(encoding="utf-8").partition("[optimise]")
    text = f"{before}\n{optimise}"
    text = text.replace('rate_limit = "0.2 deg/s"', f'rate_limit = "0.2 deg/s"\n{procedure}')
    file = folder / "campaign.toml"
    file.write_text(text, encoding="utf-8")
    return file


def said_of(result: Result) -> dict:
    """Return the one JSON document on standard output, which holds no NaN."""
    return json.loads(result.stdout, parse_constant=lambda name: pytest.fail(name))


@pytest.fixture(scope="module")
def search(tmp_path_factory) -> tuple[Path, Path, Result]:
    """A campaign, the folder of a search for it, and what the command said."""
    campaign = write_campaign(tmp_path_factory.mktemp("laboratory"))
    folder = campaign.parent / "search"
    return campaign, folder, run("optimise", campaign, "-o", folder, *SIZE)


# -- a search --------------------------------------------------------------------------------------


def test_a_better_plan_is_told_and_written(search):
    campaign, folder, result = search
    assert result.exit_code == 0
    found = optimisation.load(folder)
    assert found.gained and found.complete and found.geometric_mean[0] < 0.9
    for words in (
        "with the plan found over that with published", "Dot: the site.", "geometric mean",
        "gyro.drift_input_spin.x", "cluster 1", f"{found.geometric_mean[0]:.3f}",
        "180 plans, 3 restarts, seed 0", f"Plan: {folder / 'campaign.toml'}",
        f"Report: {folder / 'report.html'}",
    ):  # fmt: skip
        assert words in result.output
    assert "No allowed plan shows" not in result.output and "Went on from" not in result.output
    assert "BROKEN" not in result.output
    names = {p.name for p in folder.iterdir()}
    assert names == {"asked.toml", "campaign.toml", "found.json", "optimise.json", "parts",
                     "report.html", "restarts.parquet"}  # fmt: skip
    assert (folder / "asked.toml").read_text() == campaign.read_text()


def test_the_plan_that_was_found_is_the_plan_of_the_campaign_that_was_written(search):
    _, folder, _ = search
    found = optimisation.load(folder)
    plan = reading.load(folder / "campaign.toml").settings.planned
    assert plan.motion[-1][1] == pytest.approx(found.duration) == 5400
    assert len(plan.motion) == len(found.motion) == len(found.steps) - 1
    for (a, b, rate), (start, end, turned) in zip(plan.motion, found.motion, strict=True):
        assert (a, b) == pytest.approx((start, end))
        np.testing.assert_allclose(rate, turned, atol=1e-12)
    assert max(abs(v) for *_, rate in found.motion for v in rate) == pytest.approx(
        math.radians(0.2)
    )
    needs, before = ({n.name: n for n in some} for some in (found.needs, found.reference_needs))
    rate = needs["rate about an axis"]
    assert rate.kept and rate.needed == pytest.approx(math.radians(0.2))
    assert before["middle angle"].needed == pytest.approx(0, abs=1e-9)
    assert needs["middle angle"].needed > 0.01


@pytest.mark.thorough
def test_json_is_what_the_folder_holds(search):
    campaign, folder, _ = search
    said = said_of(run("optimise", campaign, "-o", folder, *SIZE, "--json"))
    kept = json.loads((folder / "found.json").read_text())
    places = ("folder", "report", "complete")
    assert {k: v for k, v in said.items() if k not in places} == kept
    assert said["complete"] is True and Path(said["report"]).is_file()
    assert said["names"][0] == "gyro.drift.x" and len(said["restarts"]) == 3


def test_the_report_can_be_written_again(search):
    _, folder, _ = search
    page = folder / "report.html"
    before = page.read_bytes()
    page.unlink()
    assert run("report", folder).exit_code == 0
    assert page.read_bytes() == before


@pytest.mark.thorough
def test_a_search_keeps_what_is_set(tmp_path):
    """Another key makes another search, and the plan that is written says it."""
    campaign, folder = write_campaign(tmp_path), tmp_path / "search"
    few = ("--restarts", 1, "--evaluations", 20, "--round", 2, "--workers", 1)
    said = run(
        "optimise", campaign, "-o", folder, *few, "--set", "procedure.rate_limit = 0.3 deg/s"
    )
    assert said.exit_code in (0, 3), said.output
    assert 'rate_limit = "0.3 deg/s"' in (folder / "campaign.toml").read_text(encoding="utf-8")
    assert run("optimise", campaign, "-o", folder, *few).exit_code == 1


# -- a search that goes on -------------------------------------------------------------------------


@pytest.mark.thorough
def test_the_same_command_computes_nothing_again(search):
    campaign, folder, result = search
    times = {p: p.stat().st_mtime_ns for p in (folder / "parts").iterdir()}
    again = run("optimise", campaign, "-o", folder, *SIZE)
    told = "Went on from 3 of these restarts, which were in the folder.\n"
    assert len(times) == 3 and told in again.output
    assert again.output.replace(told, "") == result.output
    assert times == {p: p.stat().st_mtime_ns for p in (folder / "parts").iterdir()}


@pytest.mark.thorough
def test_another_seed_finds_another_plan(search, tmp_path):
    campaign, folder, _ = search
    result = run("optimise", campaign, "-o", tmp_path / "s", *SIZE, "--seed", 1)
    assert "seed 1" in result.output
    assert optimisation.load(tmp_path / "s").motion != optimisation.load(folder).motion


@pytest.mark.thorough
def test_a_time_limit_lets_one_restart_end(search, tmp_path):
    campaign, folder, _ = search
    size = ("--evaluations", 60, "--round", 2, "--workers", 1)
    result = run(
        "optimise", campaign, "-o", tmp_path / "s", "--restarts", 3, *size,
        "--time-limit", "1 us",
    )  # fmt: skip
    found = optimisation.load(tmp_path / "s")
    assert result.exit_code in (0, 3) and len(found.restarts) == 1
    assert found.restarts[0] == optimisation.load(folder).restarts[0]
    run("optimise", campaign, "-o", tmp_path / "s", "--restarts", 3, *size)
    assert optimisation.load(tmp_path / "s") == optimisation.load(folder)


@pytest.mark.thorough
def test_an_unfinished_search_has_no_report(search, tmp_path):
    campaign, _, _ = search
    run("optimise", campaign, "-o", tmp_path / "s", "--restarts", 2, "--evaluations", 60)
    file = tmp_path / "s" / "found.json"
    for text in (None, "{", "[]", '{"procedure": "platform_tumble"}'):
        file.unlink(missing_ok=True) if text is None else file.write_text(text)
        result = run("--json", "report", tmp_path / "s", code=1)
        assert said_of(result)["error"]["code"] == "optimise.missing"


# -- searches that end otherwise -------------------------------------------------------------------


@pytest.mark.thorough
def test_no_gain_ends_with_3_and_says_so(tmp_path):
    """In a third of the time a handful of random plans are worse."""
    campaign = write_campaign(tmp_path, f'{FASTER}total = "1801 s"\nworst = 100.0\n')
    words = ("--restarts", 1, "--evaluations", 3)
    result = run("optimise", campaign, "-o", tmp_path / "s", *words)
    assert result.exit_code == 3 and "warning: After " in result.output
    page = (tmp_path / "s" / "report.html").read_text(encoding="utf-8")
    assert "Nothing better was found" in page and "Search longer" in page
    said = said_of(run("optimise", campaign, "-o", tmp_path / "s", *words, "--json"))
    assert "optimise.no_gain" in [f["code"] for f in said["findings"]]


@pytest.mark.thorough
def test_a_plan_to_beat_that_the_rig_cannot_do(tmp_path):
    """What is found may be worse, and is of use all the same."""
    limits = 'cable_limit = "300 deg"'
    campaign = write_campaign(tmp_path, f'{FASTER}total = "1801 s"\nworst = 100.0\n', limits)
    result = run("optimise", campaign, "-o", tmp_path / "s", "--restarts", 1, "--evaluations", 3)
    found = optimisation.load(tmp_path / "s")
    assert not found.gained and found.complete and result.exit_code == 0
    codes = [f.code for f in found.findings]
    assert "optimise.reference_limits" in codes and "optimise.no_gain" not in codes
    assert "published, the plan to beat, breaks limits of the rig: " in result.output
    assert " deg of 300 deg. The plan found keeps them all" in result.output
    assert "keep that plan" not in result.output
    assert result.output.count("BROKEN") == 1


@pytest.mark.thorough
def test_what_no_allowed_plan_shows_must_not_count(tmp_path):
    one_axis = f'[optimise]\naxes = "x"\nrates = ["0.2 deg/s"]\n{BRIEF}'
    campaign = write_campaign(tmp_path, one_axis)
    result = run("--json", "optimise", campaign, "-o", tmp_path / "s", *SIZE)
    problem = said_of(result)["error"]
    assert result.exit_code == 1 and problem["code"] == "optimise.unseen"
    assert "accel.quadratic.x" in problem["message"] and "turns about x" in problem["message"]
    assert not (tmp_path / "s").exists()
    names = problem["message"].partition("that count: ")[2].partition(". Allowed")[0].split(", ")
    assert len(names) < 42
    nothing = ", ".join(f'"{name}" = 0.0' for name in names)
    write_campaign(tmp_path, f"{one_axis}weights = {{ {nothing} }}\n")
    result = run("optimise", campaign, "-o", tmp_path / "s", *SIZE, code=3)
    assert f"No allowed plan shows: {', '.join(names)}." in result.output
    found = optimisation.load(tmp_path / "s")
    assert set(found.unseen) == set(names)
    assert all(w == (n not in names) for n, w in zip(found.names, found.weights, strict=True))
    assert "No allowed plan shows" in (tmp_path / "s" / "report.html").read_text(encoding="utf-8")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("optimise", "procedure", "code", "text"),
    [
        ('weights = { "gyro.drfit" = 2.0 }', "", "optimise.weight_name", "gyro.drift"),
        ('weights = { "gyro.drift" = -2.0 }', "", "optimise.weight", "the weight -2"),
        ("weights = { gyro = 0.0, accel = 0.0 }", "", "optimise.weightless", "weight 0"),
        ('total = "1700 s"', "", "optimise.time", "At 0.2 deg/s, 1700 s turn the cluster"),
        ('shortest = "1500 s"', "", "optimise.segment", "fit only 3 times"),
        ('rates = ["0.3 deg/s"]', "", "optimise.rate", "the rig allows up to 0.2 deg/s"),
        ("", 'middle_limit = "0.1 deg"\ncable_limit = "0.1 deg"', "optimise.limits", "keeps"),
        ('axis = "x"', "", "campaign.key", "axis"),
        ('total = "90"', "", "unit.missing", "no unit"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_before_the_folder_is_made(
    tmp_path, optimise, procedure, code, text
):
    campaign = write_campaign(tmp_path, f"[optimise]\n{optimise}\n", procedure)
    result = run("--json", "optimise", campaign, "-o", tmp_path / "s", *SIZE)
    problem = said_of(result)["error"]
    assert (result.exit_code, problem["code"]) == (1, code)
    assert text in problem["message"] + problem["cure"]
    assert result.stderr.count("error:") == 1 and not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        ("60", "no unit"),
        ("soon", "no unit"),
        ("60 deg", "'deg'"),
        ("-5 s", "should be 0 or more"),
    ],
)
def test_a_malformed_time_limit_is_refused(search, tmp_path, limit, text):
    campaign, _, _ = search
    result = run("optimise", campaign, "-o", tmp_path / "s", "--time-limit", limit)
    assert result.exit_code == 1 and text in result.stderr
    assert not (tmp_path / "s").exists()


@pytest.mark.thorough
def test_the_folder_of_another_search_is_refused(search, tmp_path):
    campaign, folder, _ = search
    other = write_campaign(tmp_path, f'[optimise]\nrates = ["0.15 deg/s"]\n{BRIEF}')
    before = (folder / "found.json").read_bytes()
    for words, what in (
        ((other, "-o", folder, *SIZE), "campaign_sha256"),
        ((campaign, "-o", folder, *SIZE, "--seed", 4), "seed"),
        ((campaign, "-o", folder, "--restarts", 3, "--evaluations", 61, "--round", 2), "evaluat"),
        ((campaign, "-o", folder, "--restarts", 3, "--evaluations", 60, "--round", 3), "round"),
    ):
        result = run("optimise", *words, code=1)
        assert "holds another search" in result.stderr and what in result.stderr
    assert (folder / "found.json").read_bytes() == before


def test_the_folder_of_a_study_is_refused(search, tmp_path):
    campaign, _, _ = search
    (tmp_path / "study" / "parts").mkdir(parents=True)
    (tmp_path / "study" / "parts" / "0000000-0000009.parquet").write_bytes(b"trials")
    result = run("optimise", campaign, "-o", tmp_path / "study", *SIZE)
    assert result.exit_code == 1 and "Restore optimise.json" in result.stderr


def test_a_procedure_without_plans_and_wrong_usage(tmp_path):
    result = run("optimise", "hand_rotated", "-o", tmp_path / "s")
    assert result.exit_code == 1 and "Plans can be searched for" in result.stderr
    assert "platform_tumble" in result.stderr
    assert run("optimise", EXAMPLE).exit_code == 2
    assert run("optimise", EXAMPLE, "-o", tmp_path / "s", "--restarts", 0).exit_code == 2
    assert run("optimise", EXAMPLE, "-o", tmp_path / "s", "--round", 1).exit_code == 2
    both = ("--workers", 2, "--local-cluster", 2)
    assert run("optimise", EXAMPLE, "-o", tmp_path / "s", *both).exit_code == 1
    (tmp_path / "file").write_text("")
    result = run("optimise", EXAMPLE, "-o", tmp_path / "file", *SIZE)
    assert result.exit_code == 1 and result.stderr.count("error:") == 1
