"""The sections of a systematic calibration: what they draw, and that a run folder is enough."""

from __future__ import annotations

import numpy as np
import pytest

from foucault import run_folder
from foucault.models.earth import Site
from foucault.procedures import systematic
from foucault.report import html
from foucault.report import systematic as report
from foucault.report.page import Figure, Table, shown
from make_sequence import DEG, NOISE

SITE = Site.at(40 * DEG, 100.0)


@pytest.fixture(scope="module")
def result():
    settings = systematic.Settings(lever_arms=True, delay=True)
    made = systematic.simulate(
        systematic.Session(rest_time=30.0, arms=0.02), settings=settings, noise=NOISE, site=SITE,
        model=systematic.draw_errors("navigation", 2), seed=2,
    )  # fmt: skip
    return systematic.calibrate(made.log, site=SITE, settings=settings, noise=NOISE)


def figures(section):
    return [b for b in section.blocks if isinstance(b, Figure)]


def test_velocities_before_and_after(result):
    section = report.velocities(result)
    (figure,) = figures(section)
    before = [t for t in figure.data if t["yaxis"] == "y2"]
    after = [t for t in figure.data if t["yaxis"] == "y"]
    assert [t["name"] for t in before] == ["east", "north", "up"] == [t["name"] for t in after]
    assert all(len(t["y"]) == 18 for t in figure.data)
    worst = max(abs(y) for t in before for y in t["y"])
    assert f"{worst:.3g} mm/s without" in section.lead
    for trace, way in zip(after, ("east", "north", "up"), strict=True):
        sd = result.tables["velocities"][f"sd_{way}"]
        np.testing.assert_allclose(trace["error_y"]["array"], 2e3 * sd, rtol=1e-5)


def test_large_velocities_are_in_metres(result):
    table = dict(result.tables["velocities"])
    table["before_east"] = 1e3 * table["before_east"]
    figure = report.velocity_figure(table)
    assert figure.layout["yaxis2"]["title"]["text"] == "before [m/s]"
    assert figure.layout["yaxis"]["title"]["text"] == "after [mm/s]"
    east = next(t for t in figure.data if t["yaxis"] == "y2" and t["name"] == "east")
    np.testing.assert_allclose(east["y"], table["before_east"], rtol=1e-5)


def test_the_sequence_is_drawn_as_it_was(result):
    section = report.sequence(result)
    words = {
        (x, y): text
        for t in figures(section)[0].data
        for x, y, text in zip(t["x"], t["y"], t["text"], strict=True)
    }
    assert len(words) == 3 * 19
    # The published table of the nineteen positions: P1 x up, y east, z north; P2; P8; P11.
    assert [words[1, way] for way in ("up", "east", "north")] == ["+x", "+y", "+z"]
    assert [words[2, way] for way in ("up", "east", "north")] == ["+z", "+y", "−x"]
    assert [words[8, way] for way in ("up", "east", "north")] == ["−y", "+x", "+z"]
    assert [words[11, way] for way in ("up", "east", "north")] == ["−z", "+x", "−y"]
    bars = figures(section)[1].data[0]
    table = result.tables["innovations"]
    np.testing.assert_allclose(bars["y"], np.sqrt(table["square"] / table["count"]), rtol=1e-5)
    assert bars["customdata"][0] == "P1"
    assert "Passes through the session: 3." in section.blocks[-1].text
    # Narrow screens scroll it: no name of an axis lies over the next.
    assert figures(section)[0].layout["meta"]["least"] > 25 * 19


def test_navigation_with_it_and_without(result):
    section = report.navigation(result)
    tilts, speeds = figures(section)[:2], figures(section)[2:]
    assert [f.caption for f in tilts] == ["Tilt, spin about east.", "Tilt, spin about north."]
    for figure in (*tilts, *speeds):
        assert [(t["name"], t["line"]["dash"], t["showlegend"]) for t in figure.data] == [
            (part, dash, dash == "solid") for dash in ("dot", "solid") for part in ("east", "north")
        ]
    assert section.lead.endswith("Dotted: as it is; solid: compensated.")
    table = next(b for b in section.blocks if isinstance(b, Table))
    assert [row[:2] for row in table.rows] == [
        [about, way] for about in ("east", "north") for way in ("as it is", "compensated")
    ]
    before, after = result.diagnostics["navigation"][:2]
    end = before["velocity"][0]
    assert float(table.rows[0][5].replace("−", "-")) == pytest.approx(end, abs=1e-4)
    assert speeds[0].data[0]["y"][-1] == pytest.approx(end, rel=1e-4)
    spun = np.searchsorted(tilts[0].data[0]["x"], 200.0)
    tilt = before["shift"][0] * 3600 / DEG
    assert tilts[0].data[0]["y"][spun] == pytest.approx(tilt, abs=0.02 * abs(tilt))
    assert [row[4] == "" for row in table.rows] == [True, False, True, False]
    less = 100 * (1 - np.hypot(*after["shift"][:2]) / np.hypot(*before["shift"][:2]))
    assert table.rows[1][4] == f"{less:.1f} %".replace("-", "−")


def test_places_in_units_that_people_use(result):
    rows = {row["name"]: row for row in result.coefficients.rows()}
    assert rows["accel.lever.xy"]["display_unit"] == "mm"
    assert rows["accel.delay"]["display_unit"] in ("us", "ms")
    page = html(result).replace("<wbr>", "")
    assert "accel.lever.xy" in page and "accel.delay" in page
    assert shown("us") == "µs"


def test_the_report_is_made_from_the_run_folder(result, tmp_path):
    run_folder.save(result, tmp_path)
    assert html(run_folder.load_result(tmp_path)) == html(result)
