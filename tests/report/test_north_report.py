"""The page of north says where it is, how sure, and what would make it surer."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from foucault.campaign import north
from foucault.campaign.tables import Said
from foucault.report import north as drawn
from foucault.report import render
from foucault.report.north import Setup, common, own, twice
from foucault.report.page import angle, grouped
from foucault.run_folder import Record
from foucault.simulate.north import Placement
from make_north import ACCEL_WHITE, GYRO_WHITE, LATITUDE, ONE, many, write_readings
from pages import figures, titles

WHITE = {"gyro_noise": GYRO_WHITE, "accel_noise": ACCEL_WHITE}
SAID = Said(latitude=LATITUDE, **WHITE)


def page_of(record):
    return render(drawn.document(record))


def made(folder, setups, said=SAID, settings=None, **words):
    write_readings(folder / "r.csv", setups, **words)
    return north.record(north.run(folder / "r.csv", said, settings))


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    return made(tmp_path_factory.mktemp("one"), ONE, reference=True)


@pytest.fixture(scope="module")
def twelve(tmp_path_factory):
    return made(tmp_path_factory.mktemp("many"), many(12), settings={"accuracy": np.radians(0.02)})


def test_one_set_up(one):
    page = unescape(page_of(one))
    setup = one.about["setups"][0]
    value, sd = np.degrees(setup["heading"]["value"]), np.degrees(setup["heading"]["sd"])
    assert f"<h1>Heading {value:.3f}° ± {2 * sd:.3f}°</h1>" in page
    assert titles(page) == [
        "Where north is", "Fit over the index angle", "Residuals", "Uncertainty budget", "Checks",
        "Findings", "How it was measured", "Left out: what it costs in the headings",
        "What was known before", "Calibration", "Provenance",
    ]  # fmt: skip
    assert "heading minus reference" in page and "latitude (given)" in page
    assert "0, 180, 90, 270, 270, 90, 180, 0°" in page
    assert "None was used: bias, scale factors and coupling count as zero" in page


def test_the_needle_points_where_the_heading_is(one):
    rose = figures(page_of(one))[0]
    heading = np.degrees(one.about["setups"][0]["heading"]["value"])
    needle = next(t for t in rose["data"] if t["name"] == "heading")
    assert needle["theta"][1] == pytest.approx(heading, abs=1e-3)
    angular = rose["layout"]["polar"]["angularaxis"]
    assert angular["direction"] == "clockwise" and angular["rotation"] == 90
    assert angular["ticktext"][angular["tickvals"].index(90)] == "E"
    reference = next(t for t in rose["data"] if t["name"] == "reference")
    assert reference["theta"][1] == pytest.approx(123.456)


@pytest.mark.parametrize(("sd", "wider"), [(3.0, 1), (0.9, 10), (0.05, 100), (1e-4, 10**4)])
def test_the_wedge_is_magnified_by_powers_of_ten(sd, wider):
    assert drawn.magnified(sd) == wider
    angle = {"value": np.radians(100.0), "sd": np.radians(sd)}
    about = {"setups": [{"name": "A", "verdict": "pass", "heading": angle}]}
    figure = drawn.rose([Setup(Record(about, {}), 0)])
    wedge = figure.data[0]["theta"]
    assert wedge[1] == pytest.approx(100.0 - 2 * sd * wider)
    assert ("drawn" in figure.caption) == (wider > 1)


def test_another_solution_is_a_faint_needle(tmp_path):
    said, unknown = Said(gravity=9.79, **WHITE), {"unknown_latitude": True}
    tilted = Placement("A", np.pi, *np.radians([-1.5, -7.3]))
    record = made(tmp_path, [tilted], said, unknown, latitude=np.radians(4.0), seed=0)
    setup = record.about["setups"][0]
    assert setup["ambiguous"]
    page = page_of(record)
    other = next(t for t in figures(page)[0]["data"] if t["name"] == "other solution")
    assert other["theta"][1] == pytest.approx(np.degrees(setup["other"]["heading"]), abs=1e-3)
    assert "other solution [°]" in unescape(page)


def test_the_fit_goes_through_the_readings(one):
    drawn = figures(page_of(one))
    gyro = next(f for f in drawn if any(t.get("name") == "gyro ±2 sd" for t in f["data"]))
    curve, dots, left = gyro["data"]
    at = np.interp(dots["x"], curve["x"], curve["y"])
    bars = np.array(dots["error_y"]["array"])
    assert np.all(np.abs(np.array(dots["y"]) - at) < 2.5 * bars)
    assert np.all(np.abs(left["y"]) < 2.5 * bars) and np.any(np.abs(left["y"]) > 0.01 * bars)


def test_many_set_ups(twelve):
    page = unescape(page_of(twelve))
    assert "North at 12 set-ups" in page and "0 of 12 pass" in page
    found = titles(page)
    assert found[:2] == ["Headings", "All set-ups"]
    assert sum(t.startswith("Set-up M") for t in found) == drawn.DETAILED
    needles = sum(len([x for x in t["theta"] if x is None]) for t in figures(page)[0]["data"])
    assert needles == 12
    assert page.count("0.02 deg was wanted") < 30  # said once for each, not twice


def test_a_name_cannot_break_the_page(tmp_path):
    from dataclasses import replace

    record = made(tmp_path, [replace(ONE[0], name="<b>A & 'x'")])
    page = page_of(record)
    assert "<b>A" not in page and "&lt;b&gt;A" in page


def test_what_would_halve_the_uncertainty(one):
    text = twice(Setup(one, 0))
    assert re.search(r"`gyro noise` must come down from 3\.\d arcmin to 1\.\d arcmin", text)
    assert re.search(r"measure 4(\.[0-4])? times as long", text)


def test_many_findings_of_a_kind_are_counted():
    one_kind = [{"code": "a", "severity": "note", "message": str(i), "cure": "."} for i in range(9)]
    found = grouped([*one_kind, {"code": "b", "severity": "note", "message": "z", "cure": "c"}])
    assert [f["message"] for f in found] == ["0", "1", "2", "z"]
    assert found[2]["cure"] == ". The same in 6 more set-ups."


def test_what_all_set_ups_share_is_said_once(tmp_path):
    """Declared too quiet by a factor of ten, all readings scatter too much."""
    quiet = SAID.model_copy(update={"gyro_noise": GYRO_WHITE / 10})
    record = made(tmp_path, many(12), quiet)
    setups = [Setup(record, i) for i in range(12)]
    (shared,) = common(setups)
    assert shared.startswith("The residuals of the gyro over all set-ups are")
    assert all(shared in s.said["warnings"] and shared not in own(s, [shared]) for s in setups)
    assert any(own(s, [shared]) for s in setups) and common(setups[:1]) == []
    page = unescape(page_of(record))
    head, table = page.split("<table")[:2]
    assert head.count(shared) == 1 and shared not in table.split("</table>")[0]


def test_a_rounded_zero_has_no_sign(one):
    north_json = json.loads(json.dumps(dict(one.about)))
    north_json["setups"][0]["roll"] |= {"value": -1e-9, "sd": 1e-6}
    assert Setup(replace(one, about=north_json), 0).text("roll").strip("0.") == ""


def test_units_follow_the_size():
    assert angle(0.5) == "30 arcmin"
    assert angle(2.0) == "2°"
    assert angle(1e-3) == "3.6 arcsec"


def test_the_calibration_is_named(one):
    used = {"instrument": {"name": "Seeker", "serial": "SN 4", "note": ""}, "verdict": "pass",
            "created": "2026-01-02T03:04:05+00:00", "site": {"latitude": 0.5}}  # fmt: skip
    row = {"value": 1.5e-7, "sd": 1e-8, "unit": "rad/s"}
    about = dict(one.about) | {"calibration": used, "coefficients": {"gyro.bias.x": row}}
    page = unescape(page_of(Record(about, one.tables)))
    assert "Seeker SN 4" in page and "2 January 2026, 03:04 UTC" in page and "28.6479° N" in page
    assert "0.0309" in page  # deg/h
