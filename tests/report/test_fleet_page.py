"""The page of a fleet says who passes, how the coefficients lie, and who stands out."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from foucault.campaign.fleet import FleetTable, Row
from foucault.campaign.tolerance import Entry, Tolerance
from foucault.errors import error
from foucault.models.imu import LINEAR_LOWER
from foucault.report import fleet, render
from foucault.report.fleet import ratios
from pages import figures, text_of, titles

MG = 9.80665e-3
ABOUT = {
    "procedure": "norm_observation",
    "solved_in_batch": 60,
    "provenance": {"created": "2026-01-02T03:04:05", "versions": {"foucault": "1"}},
    "campaign": {"sha256": "abc"},
}


def page_of(table, about):
    return render(fleet.document(table, about))


def make_table(n=60, broken=1, reports=True):
    rng = np.random.default_rng(2)
    rows = []
    for i in range(n):
        values = dict(zip(LINEAR_LOWER, 1e-3 * rng.normal(size=21), strict=True))
        values["accel.bias.x"] = MG * (2.0 + 0.5 * rng.normal())
        if i == 7:
            values["accel.bias.x"] = 12 * MG
        sd = dict.fromkeys(LINEAR_LOWER, 1e-5)
        chi = np.array([60.0 if i == 9 else 3.0, 3.0])
        folder = f"instruments/SN{i:03d}"
        report = f"{folder}/report.html" if reports else ""
        rows.append(
            Row(
                f"SN{i:03d}", "converged", "doubtful" if i == 9 else "pass", values, sd, chi,
                np.full(2, 3.0), np.zeros(3), folder, report,
                ("Too noisy; measure again.",) if i == 9 else (),
            )
        )  # fmt: skip
    problem = error("fleet.positions", plan="icosahedron 12", what="missing number 4 of 24")
    rows[3:3] = [Row.broken(f"<BAD>{k}", problem) for k in range(broken)]
    return FleetTable.of(LINEAR_LOWER, rows)


LIMITS = Tolerance((Entry("accel.bias.x", 5 * MG),), "limits.toml")


def test_a_serial_number_makes_no_link_and_no_element():
    for serial in ("SN\tjavascript:evil()", '"><a href="javascript:evil()">', "=1+1<script>"):
        table = make_table(n=12, broken=0)
        rows = [dataclasses.replace(row, serial=f"{serial}{i}") for i, row in enumerate(table.rows)]
        page = page_of(FleetTable.of(LINEAR_LOWER, rows), ABOUT)
        links = re.findall(r'href="([^"]*)"', page.split("<main>")[1].split("</main>")[0])
        assert links
        assert all(link.startswith("instruments/SN0") for link in links)
        assert "<a href=javascript" not in page
        assert "<script>0" not in page
    rows = [dataclasses.replace(row, report="javascript:evil()") for row in make_table().rows]
    page = page_of(FleetTable.of(LINEAR_LOWER, rows), ABOUT)
    assert 'href="javascript%3Aevil%28%29"' in page


def test_what_is_unusable_is_no_part_of_the_distributions():
    table = make_table(12, broken=0)
    rows = list(table.rows)
    absurd = dict.fromkeys(LINEAR_LOWER, 1e20)
    rows[4] = dataclasses.replace(rows[4], values=absurd, verdict="unusable")
    spoiled = FleetTable.of(LINEAR_LOWER, rows)
    assert all(d.count == 11 and d.highest < 1.0 for d in spoiled.distributions())
    assert all(d.count == 12 for d in table.distributions())


def test_counts_and_sections():
    page = page_of(make_table().decided(LIMITS), ABOUT)
    assert '<p class="word">59 of 61 pass</p>' in page
    assert "59 pass, 1 fail, 1 broken." in page and "2 instruments differ" in page
    assert "60 solved in one batch" in page and "2026-01-02" in page
    assert titles(page) == [
        "Outcome", "Did not pass", "Unlike the fleet", "Biases of the accelerometers",
        "Scale factor errors of the accelerometers", "Misalignments of the accelerometers",
        "Biases of the gyros", "Scale factor errors of the gyros", "Misalignments of the gyros",
        "Distributions in numbers", "Residuals", "Tolerance", "Instruments", "Provenance",
    ]  # fmt: skip
    assert "https://" not in re.sub(r"<script>.*?</script>", "", page, flags=re.S)


def test_the_worst_come_first_and_say_why():
    page = page_of(make_table().decided(LIMITS), ABOUT)
    said = text_of(page, "Did not pass")
    assert said.index("<BAD>0") < said.index("SN007")
    assert "missing number 4 of 24. (fleet.positions)" in said
    assert "accel.bias.x fail; unlike the fleet: accel.bias.x" in said
    assert "240 %" in said
    assert "<BAD>" not in page  # escaped
    unlike = text_of(page, "Unlike the fleet")
    assert "SN007: accel.bias.x is 12 mg, z = +" in unlike
    assert "SN009: noise of the accelerometers, 4.5 times that of the fleet." in unlike
    assert 'href="instruments/SN007/report.html"' in page
    assert 'href="instruments' not in page_of(make_table(reports=False), ABOUT)


def test_without_a_tolerance_the_verdicts_are_counted():
    page = page_of(make_table(broken=0), ABOUT)
    assert "59 pass, 1 doubtful." in page and "Tolerance" not in titles(page)
    assert "of limit" not in page
    said = text_of(page, "Did not pass")
    assert "SN009" in said and "Too noisy" in said and "measure again" not in said


def test_histograms_count_every_instrument_once_and_show_the_limits():
    table = make_table().decided(LIMITS)
    first = figures(page_of(table, ABOUT))[0]
    x = table.values[table.good, 0] / MG
    bars = first["data"][0]
    assert sum(bars["y"]) == 59  # the one far out is not drawn, but counted
    assert [a["text"] for a in first["layout"]["annotations"]] == ["1 beyond"]
    lines = [s for s in first["layout"]["shapes"] if s["xref"] == "x"]
    assert [s["x0"] for s in lines if s["line"]["dash"] == "solid"] == [
        pytest.approx(np.median(x), rel=1e-5)
    ]
    assert 5.0 in [s["x0"] for s in lines if s["line"]["dash"] == "dash"]
    # Where there is little room the numbers of the first axis stand for all.
    upward = {k: a for k, a in first["layout"].items() if k.startswith("yaxis")}
    assert len(upward) == 3 and len({tuple(a["range"]) for a in upward.values()}) == 1
    narrow = first["layout"]["meta"]["narrow"]
    assert narrow["xaxis"]["tickfont"]["size"] < 12 and narrow["xaxis"]["nticks"] == 3
    assert "yaxis" not in narrow and narrow["yaxis2"] == {"showticklabels": False}
    assert upward["yaxis"]["range"][1] > max(max(bar["y"]) for bar in first["data"])
    centre, width = np.array(bars["x"]), bars["width"]
    for c, n in zip(centre, bars["y"], strict=True):
        inside = np.sum((x >= c - width / 2 - 1e-9) & (x <= c + width / 2 + 1e-9))
        assert n <= inside


def test_residuals_that_all_are_as_large_as_the_noise_are_one_bar_to_be_seen():
    rng = np.random.default_rng(1)
    rows = [
        dataclasses.replace(r, chi_square=r.redundancy * (1.0 + 1e-12 * rng.normal(size=2)))
        for r in make_table(broken=0).rows
    ]
    for bar in ratios(FleetTable.of(LINEAR_LOWER, rows)).blocks[0].data:
        assert bar["width"] >= 0.01 and max(bar["y"]) == sum(bar["y"]) > 0


def test_the_tolerance_table_counts_decisions():
    said = text_of(page_of(make_table().decided(LIMITS), ABOUT), "Tolerance")
    assert "accel. bias.x 5 mg 59 1 0" in said


@pytest.mark.thorough
def test_ten_thousand_instruments_stay_a_small_page():
    table = make_table(2500).decided(LIMITS)
    page = page_of(table, ABOUT)
    empty = page_of(make_table(20).decided(LIMITS), ABOUT)
    assert len(page) - len(empty) < 400_000
    assert "500 of 2501 are listed; all are in" in text_of(page, "Instruments")


def test_a_fleet_of_one_has_a_page():
    page = page_of(make_table(1, broken=0), ABOUT)
    assert "All pass" in page and "fewer than 8 instruments none can stand out" in page
