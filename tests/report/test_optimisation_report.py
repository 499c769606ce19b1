"""The report of a search for a plan says what is gained, where, and how sure that is."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foucault.campaign.optimisation import Found
from foucault.errors import finding
from foucault.plans.limit import Limit
from foucault.report import optimisation as report
from foucault.report import render, save
from pages import figures, titles

FOLDER = Path("search folder")
NAMES = ("gyro.drift.x", "gyro.drift.y", "gyro.drift.z", "accel.bias.x")
CASES = ("the site", "latitude 0 deg", "cluster 1")
RATIO = np.array([[0.5, 0.4, 0.25, 0.8], [0.55, 0.4, 0.25, 0.8], [0.5, 0.38, 0.25, 0.9]])
BEFORE = np.array([2e-4, 3e-4, 4e-4, 0.1])
HEADINGS = ("from (s)", "to (s)", "x (deg/s)", "turn (deg)")
RATE = math.radians(0.1)


def restart(number: int, costs: list[float], continued: bool = False) -> dict:
    at = [32 * 4**k for k in range(len(costs))]
    return {
        "restart": number, "cost": costs[-1], "evaluations": at[-1], "continued": continued,
        "trace": tuple(zip(at, costs, strict=True)),
    }  # fmt: skip


RESTARTS = (
    restart(0, [-0.3, -0.7, -0.8]),
    restart(1, [-0.2, -0.79]),
    restart(2, [-0.1, -0.5]),
    restart(3, [-0.8, -0.85], continued=True),
)


def make_found(ratio: np.ndarray = RATIO, **other: object) -> Found:
    """Return what a search of made-up numbers found."""
    weights = np.asarray(other.pop("weights", np.ones(ratio.shape[1])), float)
    before = np.asarray(other.pop("before", BEFORE), float)
    share = np.where(np.isfinite(ratio), weights, 0)
    logs = np.log(np.where(np.isfinite(ratio), ratio, 1))
    made = Found(
        procedure="platform_tumble",
        aim="sd",
        reference="published",
        steps=(HEADINGS, ("0", "300", "-0.1", "30"), ("300", "900", "0", "60")),
        reference_steps=(HEADINGS, ("0", "900", "0.1", "90")),
        duration=900.0,
        reference_duration=900.0,
        motion=((0.0, 300.0, (-RATE, 0.0, 0.0)), (300.0, 900.0, (0.0, RATE, RATE))),
        reference_motion=((0.0, 900.0, (RATE, 0.0, 0.0)),),
        needs=(Limit("middle angle", "angle", math.radians(61.0), math.radians(70.0)),),
        reference_needs=(Limit("middle angle", "angle", 0.0, math.radians(70.0)),),
        names=NAMES,
        units=("deg/h",) * 3 + ("ug",),
        weights=tuple(weights),
        unseen=(),
        cases=CASES,
        sd=tuple(tuple(row) for row in (ratio * before).tolist()),
        reference_sd=(tuple(before.tolist()),) * len(ratio),
        ratio=tuple(tuple(row) for row in ratio.tolist()),
        geometric_mean=tuple(np.exp((share * logs).sum(1) / share.sum(1)).tolist()),
        worst=tuple(np.nanmax(np.where(weights > 0, ratio, np.nan), axis=1).tolist()),
        restarts=RESTARTS,
        evaluations=3000,
        seed=5,
        version="9.8.7",
        allowed="turns about x, y, z at 0.1 deg/s for 900 s",
        findings=(),
    )
    return replace(made, **other)


def page_of(found: Found) -> str:
    return render(report.document(found, FOLDER))


def words_of(page: str) -> str:
    """Return a page as plain text."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", "", page[page.index("<header>") :]))


def rows_of(page: str, table: int) -> list[list[str]]:
    """Return the words of every row of one of the tables."""
    text = re.findall(r"<tbody>(.*?)</tbody>", page, re.DOTALL)[table]
    return [
        [words.strip() for words in re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL)]
        for row in re.findall(r"<tr.*?</tr>", text, re.DOTALL)
    ]


# -- the verdict -----------------------------------------------------------------------------------


def test_better_everywhere():
    found = make_found()
    page = page_of(found)
    assert '<div class="verdict good">' in page and '<p class="word">Better</p>' in page
    words = words_of(page)
    mean = (0.5 * 0.4 * 0.25 * 0.8) ** 0.25
    assert found.geometric_mean[0] == pytest.approx(mean)
    assert f"of the 4 coefficients that count are {mean:.3f} times those of published" in words
    low, high = min(found.geometric_mean), max(found.geometric_mean)
    assert f"{low:.3f} to {high:.3f} times in all 3 cases" in words
    assert "least is gained for accel.bias.x: 0.900 at most (cluster 1)" in words
    assert "It takes 900 s, as long as published" in words
    assert titles(page) == [
        "Every coefficient",
        "Case by case",
        "The plan, and what it needs of the rig",
        "How to use it",
        "How sure the search is",
        "Provenance",
    ]


def test_a_coefficient_that_is_worse_in_one_case_is_named():
    ratio = RATIO.copy()
    ratio[2, 1] = 1.4
    page = page_of(make_found(ratio, duration=1200.0))
    assert '<div class="verdict warning">' in page and "Better, with exceptions" in page
    words = words_of(page)
    assert "Worse in at least one case, by at most so many times: gyro.drift.y (1.40)." in words
    assert "It takes 1200 s; published takes 900 s." in words
    assert "Ochre diamond: worse in some case" in words and "Red diamond" not in words
    traces = {t.get("name"): t for t in figures(page)[0]["data"]}
    assert traces["worse in some case"]["y"] == ["gyro.drift.y"]
    assert traces["worse in some case"]["marker"]["symbol"] == "diamond"
    assert "icon warning" in rows_of(page, 0)[1][0] and "icon good" in rows_of(page, 0)[0][0]


def test_worse_at_the_site_is_red():
    ratio = RATIO.copy()
    ratio[:, 0] = 1.2
    page = page_of(make_found(ratio))
    traces = {t.get("name"): t for t in figures(page)[0]["data"]}
    assert traces["worse"]["y"] == ["gyro.drift.x"] and "Red diamond: worse." in words_of(page)
    assert "icon bad" in rows_of(page, 0)[0][0]


def test_nothing_better():
    told = finding("optimise.no_gain", evaluations=3000, ratio=1.0)
    page = page_of(make_found(np.ones((3, 4)), findings=(told,)))
    assert '<p class="word">Nothing better was found</p>' in page
    assert "and so in all 3 cases" in words_of(page)
    assert "Findings" in titles(page) and "After 3000 plans the best is 1.000" in page


CABLE = Limit("turn of the outer and inner gimbal", "angle", math.radians(360), math.radians(300))
SHORT = replace(CABLE, needed=math.radians(250.0))


def test_a_plan_to_beat_that_the_rig_cannot_do_is_said_and_marked():
    found = make_found(needs=(SHORT,), reference_needs=(CABLE,))
    page = page_of(found)
    words = words_of(page)
    sentence = "The rig cannot do published: turn of the outer and inner gimbal 360° of 300°; the "
    assert sentence + "plan found keeps all limits." in words
    assert '<p class="word">Better</p>' in page and found.complete
    needs = {row[0]: row[1:] for row in rows_of(page, 2)}
    assert needs[CABLE.name] == ["360°, BROKEN", "250°", "300°"]
    worse = make_found(np.full((3, 4), 1.27), needs=(SHORT,), reference_needs=(CABLE,))
    page = page_of(worse)
    assert '<p class="word">Less well seen, but the rig can do it</p>' in page
    assert "1.270 times those of" in words_of(page) and worse.complete
    neither = make_found(needs=(CABLE,), reference_needs=(CABLE,))
    assert not neither.complete and "keeps all limits" not in words_of(page_of(neither))
    assert "BROKEN" not in page_of(make_found()) and "cannot do" not in page_of(make_found())


def test_what_is_unseen_or_seen_anew_or_no_more_is_named():
    ratio, before = RATIO.copy(), BEFORE.copy()
    ratio[:, 0], before[0] = np.nan, np.inf
    ratio[:, 1] = np.inf
    found = make_found(
        ratio, before=before, weights=[1, 1, 1, 0], unseen=("accel.bias.x",),
        sd=((1e-4, math.inf, 1e-4, 0.08),) * 3,
    )  # fmt: skip
    page = page_of(found)
    words = words_of(page)
    assert "published does not show at all, this plan does: gyro.drift.x." in words
    assert "No allowed plan shows: accel.bias.x." in words
    assert "gyro.drift.y (not seen)" in words and "with exceptions" in words
    cells = rows_of(page, 0)
    assert cells[0][2] == "new" and cells[0][4] == "not seen"
    assert cells[1][2] == "lost" and cells[1][5] == "not seen"
    assert "NaN" not in page[: page.index('id="plotly"')]


def test_what_has_no_weight_is_a_ring_and_never_the_worst():
    ratio = RATIO.copy()
    ratio[:, 3] = 3.0
    page = page_of(make_found(ratio, weights=[2, 1, 1, 0]))
    assert '<p class="word">Better</p>' in page and "Ring: of weight 0." in page
    traces = {t.get("name"): t for t in figures(page)[0]["data"]}
    assert traces["not counted"]["marker"]["symbol"] == "circle-open"
    assert rows_of(page, 0)[0][-1] == "2" and rows_of(page, 0)[3][-1] == "0"
    assert rows_of(page, 1)[0][4] == "<code>gyro.<wbr>drift.x</code>"
    assert "gyro.drift.x 2, accel.bias.x 0" in words_of(page)


def test_one_number_is_shown_case_by_case():
    found = make_found(
        RATIO[:, :1], before=[2.0], names=("heading",), units=("arcmin",), motion=(),
        reference_motion=(), needs=(), reference_needs=(),
    )  # fmt: skip
    page = page_of(found)
    assert "The standard deviation of the heading is 0.500 times that of published" in words_of(
        page
    )
    assert titles(page)[0] == "Standard deviation of the heading"
    assert rows_of(page, 0)[1] == ["latitude 0°", "2", "1.1", "arcmin", "0.550"]


# -- numbers ---------------------------------------------------------------------------------------


def test_the_figure_of_ratios_shows_site_and_range():
    ranges, dots = figures(page_of(make_found()))[0]["data"]
    assert dots["y"] == list(NAMES)
    np.testing.assert_allclose(dots["x"], RATIO[0])
    ends = np.array([v for v in ranges["x"] if v is not None]).reshape(-1, 2)
    np.testing.assert_allclose(ends, np.column_stack([RATIO.min(0), RATIO.max(0)]))


def test_many_coefficients_stand_side_by_side_on_one_scale():
    names = tuple(f"{g}.{a}" for g in ("gyro.a", "gyro.b", "gyro.c", "accel.d") for a in "uvwxyz")
    ratio = np.tile(np.geomspace(0.1, 0.9, 24), (3, 1))
    found = make_found(ratio, before=np.ones(24), names=names, units=("deg/h",) * 24)
    left, right = figures(page_of(found))[:2]
    assert left["data"][1]["y"] + right["data"][1]["y"] == list(names)
    assert left["data"][1]["y"][-1] == "gyro.b.z"
    assert left["layout"]["xaxis"]["range"] == right["layout"]["xaxis"]["range"]


def test_tables_say_the_numbers():
    page = page_of(make_found())
    first = rows_of(page, 0)[0]
    assert first[2:] == ["0.500", "0.500 to 0.550", "0.0002", "0.0001", "°/h"]
    case = rows_of(page, 1)[2]
    assert case[1] == "cluster 1" and case[3] == "0.900" and case[5] == "0 of 4"
    assert "accel" in case[4]


def test_the_motion_of_both_plans():
    page = page_of(make_found())
    before, after = figures(page)[1:3]
    for figure, x in ((before, 90.0), (after, -30.0)):
        bars = figure["data"][0]
        assert np.dot(bars["y"], bars["width"]) == pytest.approx(x)
    assert after["data"][2]["x"] == [600.0] and after["data"][2]["width"] == [600.0]
    assert before["layout"]["yaxis"]["range"] == after["layout"]["yaxis"]["range"]
    needs = {row[0]: row[1:] for row in rows_of(page, 2)}
    assert needs["middle angle"] == ["0°", "61°", "70°"]
    assert needs["turned about x in all"][:2] == ["90°", "30°"]
    assert needs["shortest step"][:2] == ["900 s", "300 s"]
    steps = rows_of(page, 3)
    assert steps[0] == ["found"] and steps[1] == ["1", "0", "300", "−0.1", "30"]
    assert steps[3] == ["published"] and "x [°/s]" in page


def test_without_rates_only_the_steps_are_shown():
    headings = ("position", "outer (deg)")
    page = page_of(
        make_found(
            motion=(), reference_motion=(), needs=(), reference_needs=(),
            steps=(headings, ("1", "-30"), ("2", "45")),
            reference_steps=(headings, ("1", "0")),
        )
    )  # fmt: skip
    assert len(figures(page)) == 3
    assert rows_of(page, 3) == [["found"], ["1", "−30"], ["2", "45"], ["published"], ["1", "0"]]


def test_the_course_of_the_restarts():
    page = page_of(make_found())
    courses, ends = figures(page)[-2:]
    lines = {t["name"]: t for t in courses["data"]}
    assert lines["best: restart 3"]["y"][:-1] == pytest.approx(np.exp([-0.8, -0.85]), rel=1e-5)
    assert lines["random beginning"]["y"].count(None) == 3
    np.testing.assert_allclose(ends["data"][-1]["y"], np.exp([-0.8, -0.8, -0.8, -0.85]), rtol=1e-5)
    words = words_of(page)
    assert "0 of 3 restarts from random plans ended within 2" in words
    gained = 100 * (1 - math.exp(-0.05))
    assert f"had come to {math.exp(-0.8):.4f}; the other 2 gained {gained:.1f}" in words
    assert "--restarts 8 -o 'search folder'" in words.replace("&#39;", "'")


def test_restarts_that_agree_are_a_good_sign_and_those_without_a_plan_are_told():
    some = (restart(0, [-0.8]), restart(1, [-0.795]), restart(2, [math.inf]))
    page = page_of(make_found(restarts=some))
    words = words_of(page)
    assert "2 of 2 restarts from random plans" in words
    assert "1 restart met no plan that is allowed" in words
    one = page_of(make_found(restarts=some[:1]))
    assert "1 of 1 restart from random plans" in words_of(one) and "had come" not in one


@pytest.mark.parametrize(
    "ends", [(0.1, 1.1), (0.9, 1.2), (0.99, 1.0), (1e-4, 1.0), (0.3, 0.45), (1.0, 1.0), (0.5, 700)]
)
def test_marks_of_the_axis_of_ratios(ends):
    axis = report.ratio_axis(ends, "ratio")
    low, high = (10**v for v in axis["range"])
    assert low < min(ends) and max(ends) < high
    assert 3 <= len(axis["tickvals"]) <= 13
    assert all(low <= v <= high for v in axis["tickvals"])
    assert [float(t) for t in axis["ticktext"]] == pytest.approx(axis["tickvals"])


@pytest.mark.parametrize("judged", [80, 143, 900, 20_000])
def test_the_axis_of_plans_has_marks_where_it_spans_no_decade(judged):
    trace = [(79, 0.1), (judged, 0.05)]
    one = make_found().restarts[0] | {"trace": trace, "evaluations": judged}
    axis = report._courses([one]).layout["xaxis"]
    low, high = (10**v for v in axis["range"])
    assert 2 <= len(axis["tickvals"]) <= 13 and all(
        low <= 1.001 * v and 0.999 * v <= high for v in axis["tickvals"]
    )


# -- the page --------------------------------------------------------------------------------------


def test_commands_to_copy():
    page = page_of(make_found()).replace("&#39;", "'")
    plan = "'search folder/campaign.toml'"
    for command in ("preflight", "simulate", "montecarlo", "calibrate"):
        assert f"foucault {command} {plan}" in page


def test_names_cannot_break_the_page():
    page = page_of(make_found(reference="<script>alert(1)</script>"))
    assert "<script>alert" not in page


def test_written_whole_and_self_contained(tmp_path):
    file = save(report.document(make_found(), tmp_path), tmp_path / "report.html")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    page = file.read_text(encoding="utf-8")
    assert page.count('id="plotly"') == 1 and "9.8.7" in page and "seed 5" in page
    rest = re.sub(r'<script type="text/plain" id="plotly">.*?</script>', "", page)
    assert re.findall(r"https?:|<(?:link|img|iframe|base)|@import|url\(", rest) == []
