"""The page of a navigation says how far off, what the calibration is worth, and why."""

from __future__ import annotations

import json
import re
from html import unescape

import numpy as np
import pytest

from foucault import run_folder
from foucault.campaign import navigation
from foucault.plans.manoeuvres import Rest
from foucault.procedures.navigation import navigate_log
from foucault.procedures.navigation.start import Settings
from foucault.report import chart, render
from foucault.report import navigation as pages
from foucault.report.navigation import metres, minutes, number
from foucault.run_folder import Record
from make_navigation import (
    DRIVE,
    LONGITUDE,
    NOISE,
    SITE,
    calibration,
    errors,
    logged,
    reference_of,
)
from pages import figures, titles

TRUE, FOUND = errors()
PLACE = {"site": SITE, "longitude": LONGITUDE, "noise": NOISE}


def page_of(record):
    return render(pages.document(record))


@pytest.fixture(scope="module")
def parked():
    log = logged([Rest(1500.0)], TRUE).log
    return navigation.record(navigate_log(log, calibration=calibration(FOUND), **PLACE))


@pytest.fixture(scope="module")
def drive():
    run = logged(DRIVE, TRUE)
    test = navigate_log(run.log, calibration=calibration(FOUND), reference=reference_of(run),
                        noise=NOISE)  # fmt: skip
    return navigation.record(test)


ALWAYS = ["Where the predicted error comes from", "Velocity and attitude", "Start"]
END = ["Checks", "What was known before", "Provenance"]


def test_a_parked_log(parked):
    page = unescape(page_of(parked))
    with_, without = (run["growth"][-1]["horizontal"] for run in parked.about["runs"])
    head = f"<h1>{metres(with_)} off after 20 min, {metres(without)} without calibration</h1>"
    assert head in page
    assert titles(page) == [
        "Where it went", "Growth of the error", "Schuler and heading terms",
        "What each coefficient is worth", *ALWAYS, "Findings", *END,
    ]  # fmt: skip
    assert "The Schuler period is 84.5 min; in 20 min of it some terms look alike" in page
    assert "It stood still: what is drawn is error" in page and "height held" in page
    assert "the two runs differ by" in page and "They do not agree" not in page


def test_the_map_has_equal_axes_and_the_ellipse_its_covariance(parked):
    map_ = figures(page_of(parked))[0]
    assert map_["layout"]["yaxis"]["scaleanchor"] == "x"
    ellipse = next(t for t in map_["data"] if t["name"] == "±2 sd, predicted")
    cov = np.array(parked.about["predicted"]["all"]["covariance"])
    scale = 1000.0 if "km" in map_["layout"]["xaxis"]["title"]["text"] else 1.0
    x = np.array([ellipse["x"], ellipse["y"]]) * scale
    square = np.einsum("in,ij,jn->n", x, np.linalg.inv(cov), x)
    assert square == pytest.approx(4.0, rel=1e-3)
    path = next(t for t in map_["data"] if t["name"] == "with calibration")
    end = parked.about["runs"][0]["end"]
    assert [path["x"][-1], path["y"][-1]] == pytest.approx([end["east"], end["north"]], rel=1e-2)


def test_the_terms_drawn_add_up(parked):
    pages = figures(page_of(parked))
    found = [f for f in pages if any(t.get("name") == "all terms" for t in f["data"])]
    assert len(found) == 2
    for figure in found:
        names = [t["name"] for t in figure["data"]]
        assert names[:3] == ["sensor noise, ±2 sd", "error", "all terms"]
        lines = [[np.array(figure["data"][k][axis], float) for axis in "xy"] for k in range(3)]
        # The band goes out along its upper edge and back along its lower one.
        edges, back = lines[0], int(np.argmax(lines[0][0]))
        t = lines[1][0]
        error, total = lines[1][1], np.interp(t, *lines[2])
        high = np.interp(t, edges[0][: back + 1], edges[1][: back + 1])
        half = (high - np.interp(t, edges[0][:back:-1], edges[1][:back:-1])) / 4
        assert np.all(np.abs(error - total) < 4 * half + 0.02 * np.abs(error).max())


def test_a_drive_shows_reference_and_error(drive):
    page = unescape(page_of(drive))
    assert "Schuler and heading terms" not in titles(page)
    map_, errors_ = figures(page)[:2]
    names = [t.get("name") for t in map_["data"]]
    assert "reference" in names and names.count("±2 sd, predicted") == pages.ELLIPSES
    assert errors_["layout"]["xaxis"]["title"]["text"].startswith("error east")
    assert "heading [arcmin]" in page and "heading at the last epoch" in page.lower()


def test_no_reference_no_growth():
    record = navigation.record(navigate_log(logged(DRIVE, TRUE).log, **PLACE))
    page = unescape(page_of(record))
    assert re.search(r"<h1>Navigated for 3(\.\d+)? min</h1>", page)
    assert titles(page)[:3] == ["Where it went", *ALWAYS[:2]]
    assert "The instrument moved and no reference was given" in page
    assert "height [m]" in json.dumps(figures(page))


def test_no_calibration_says_what_the_bands_lack():
    log = logged([Rest(300.0)], TRUE).log
    record = navigation.record(navigate_log(log, **PLACE))
    page = unescape(page_of(record))
    assert "errors of the sensors are not calibrated" in page
    assert "What each coefficient is worth" not in titles(page)
    assert '"±2 sd, predicted"' not in json.dumps(figures(page), ensure_ascii=False)
    assert "noise and alignment alone, half of all runs [m]" in page and "Not judged" in page
    assert "vertical [m]" not in page and "heading [arcmin]" not in page


def test_contributions_that_do_not_add_up_are_told(parked):
    about = dict(parked.about) | {"difference": [1e4, 1e4]}
    page = unescape(page_of(Record(about, parked.tables)))
    assert "They do not agree: the errors are too large to act one by one" in page


def test_a_fit_worse_than_noise_is_told(parked):
    runs = [dict(run) for run in parked.about["runs"]]
    runs[0]["terms"] = runs[0]["terms"] | {"chi_square": 1e4}
    about = dict(parked.about) | {"runs": runs}
    page = unescape(page_of(Record(about, parked.tables)))
    assert "times the variance that sensor noise explains: biases that wander, or motion" in page


def test_a_name_cannot_break_the_page():
    log = logged([Rest(300.0)], TRUE).log
    test = navigate_log(log, instrument={"name": "<b>A & 'x'"}, **PLACE)
    page = page_of(navigation.record(test))
    assert "<b>A" not in page and "&lt;b&gt;A" in page


def test_units_follow_the_size():
    assert metres(12345.0) == "12.3 km" and metres(0.0123) == "12.3 mm" and metres(-80.0) == "-80 m"
    assert minutes(45) == "45 s" and minutes(60) == "1 min" and minutes(36000) == "10 h"
    assert number(None) == "" and number(float("nan")) == "" and number(-1.5) == "−1.5"
    assert number(5.3e-6) == "< 0.001" and number(0.0) == "0"
    assert chart.thinned(10_000)[-1] == 9999 and len(chart.thinned(10_000)) <= chart.POINTS
    reach = chart.ellipse(np.diag([4.0, 1.0]), 2.0)
    assert np.abs(reach).max(axis=1) == pytest.approx([4.0, 2.0], rel=1e-2)


def test_an_axis_is_in_the_unit_of_all_that_is_drawn_on_it():
    """Millimetres of a path within an ellipse of 20 m are not drawn as 20 000 mm."""
    path = ("path", np.array([0.0, 0.01]), np.array([0.0, 0.02]), chart.FIRST, "solid")
    for cov, unit in ((1e-6, "mm"), (100.0, "m"), (1e8, "km")):
        drawn = chart.paths([path], [(0.0, 0.0, cov * np.eye(2))], [], "")
        assert f"[{unit}]" in str(drawn)


def test_folder_and_record_are_the_same(tmp_path):
    log = logged([Rest(300.0)], TRUE).log
    test = navigate_log(
        log, calibration=calibration(FOUND), settings=Settings(align=150.0), **PLACE
    )
    saved = navigation.record(test).save(tmp_path / "run")
    loaded = run_folder.read(tmp_path / "run", "navigation")
    assert json.loads(json.dumps(saved.about)) == loaded.about
    assert saved.tables.keys() == loaded.tables.keys()
    for name, table in saved.tables.items():
        for column, values in table.items():
            np.testing.assert_array_equal(np.asarray(values, float), loaded.tables[name][column])
