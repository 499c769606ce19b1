"""The report of a comparison shows what changed, over time and against its limits."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from foucault.campaign import comparison, tolerance
from foucault.report import compare, render
from make_compare import make_entries, make_results, moved
from pages import figures, text_of, titles

LIMITS = '"gyro.bias" = { limit = "900 deg/h", change = "60 deg/h", drift_per_year = "80 deg/h" }'


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    results = [moved(r, gyro__bias__x=12.0 * i) for i, r in enumerate(make_results(4, seed=11))]
    entries = make_entries(results)
    named = [dataclasses.replace(entries[0], label="<first>"), *entries[1:]]
    undated = [dataclasses.replace(e, time=float("nan"), dated="") for e in entries]
    two = [*make_entries(results[:2], "A"), *make_entries(make_results(2, seed=9), "B")]
    made = {
        "limits": comparison.of(named, tolerance.parse(LIMITS)),
        "pair": comparison.of(make_entries(make_results(2))),
        "undated": comparison.of(undated),
        "instruments": comparison.of(two),
    }
    # By way of JSON, as `foucault report` has it.
    return {
        name: render(compare.document(comparison.record(found))) for name, found in made.items()
    }


def test_sections(pages):
    page = pages["limits"]
    assert titles(page) == [
        "Results", "Tolerance", "Changes", "Over time", "Each pair", "Findings", "Provenance",
    ]  # fmt: skip
    assert "IMU 7: has it changed?" in page and "Out of tolerance" in page
    assert "<first>" not in page and "&lt;first&gt;" in page
    assert "https://" not in re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    assert titles(pages["pair"])[:3] == ["Results", "Changes", "Over time"]
    assert "Not changed" in pages["pair"]


def test_the_table_of_changes_names_the_one_that_drifts(pages):
    said = text_of(pages["limits"], "Changes")
    assert re.search(r"gyro\. bias\.x [\d.]+ [\d.]+ \+[\d.]+ [\d.]+ ± [\d.]+ °/h drifts", said)
    assert len(re.findall(r"steady", said)) == 20
    assert "per year" not in text_of(pages["pair"], "Changes")


def test_limits_stand_with_what_was_measured_the_worst_first(pages):
    said = text_of(pages["limits"], "Tolerance")
    assert said.index("fail") < said.index("undecided") if "undecided" in said else True
    assert "±60 °/h fail <first> → run 3" in said
    assert "±80 °/h / year pass" in said


def test_every_coefficient_is_drawn_over_time_with_two_sd_and_its_band(pages):
    drawn = [f for f in figures(pages["limits"]) if "title" in f["layout"]]
    assert [f["layout"]["title"]["text"] for f in drawn][9] == "gyro.bias.x" and len(drawn) == 21
    one = drawn[9]
    assert one["layout"]["xaxis"]["type"] == "date" and len(one["data"][0]["x"]) == 4
    assert one["data"][0]["x"][0].startswith("2023-11-14")
    (band,) = [s for s in one["layout"]["shapes"] if s["type"] == "rect"]
    assert band["y1"] - band["y0"] == pytest.approx(60.0)
    y, low, high = np.array(one["data"][0]["y"]), *one["layout"]["yaxis"]["range"]
    error = np.array(one["data"][0]["error_y"]["array"])
    assert low < (y - error).min() and high > (y + error).max()
    assert one["data"][0]["marker"]["color"] != drawn[8]["data"][0]["marker"]["color"]


def test_without_dates_results_are_numbered(pages):
    assert "Result by result" in titles(pages["undated"])
    drawn = [f for f in figures(pages["undated"]) if "title" in f["layout"]]
    assert drawn[0]["data"][0]["x"] == ["no. 1", "no. 2", "no. 3", "no. 4"]


def test_several_instruments_side_by_side(pages):
    page = pages["instruments"]
    assert titles(page)[1:5] == [
        "Between instruments", "Instrument by instrument", "Changes: A", "Over time: A",
    ]  # fmt: skip
    assert "Changes: B" in titles(page) and "Each pair: A" not in titles(page)
    drawn = [f for f in figures(page) if "title" in f["layout"]]
    assert drawn[0]["data"][0]["x"] == ["no. 2", "no. 4"]  # the latest of each
    assert drawn[0]["data"][0]["mode"] == "markers"
    assert text_of(page, "Between instruments").count(" yes") >= 1


def test_pairs_say_what_explains_them(pages):
    said = text_of(pages["limits"], "Each pair")
    assert said.count("run 3") == 3 and "gyro.bias.x" in said
    heat = [f for f in figures(pages["limits"]) if f["data"][0]["type"] == "heatmap"]
    assert heat[0]["data"][0]["x"] == ["1 → 2", "2 → 3", "3 → 4"]


def test_a_coefficient_is_in_one_unit_whatever_its_limits_are():
    wide = '"gyro.bias" = { limit = "2 deg/s", change = "1 deg/h" }'
    results = [moved(r, gyro__bias__x=12.0 * i) for i, r in enumerate(make_results(2, seed=11))]
    found = comparison.of(make_entries(results), tolerance.parse(wide))
    said = text_of(render(compare.document(comparison.record(found))), "Tolerance")
    assert "±2 °/s" in said and "°/h" not in said
    words = next(
        d for d in found.decisions if d.name == "gyro.bias.x" and d.what == "value"
    ).words()
    assert words.count("deg/s") == 2 and "deg/h" not in words
