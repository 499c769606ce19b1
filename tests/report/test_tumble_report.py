"""The report of a tumble: alignment, motion, what it shows, course, residuals, sensitivities."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign, report, run_folder
from foucault.models.cluster import CONSTANTS, LAYOUT, attitude_of
from foucault.report import tumble
from foucault.report.calibration import sections
from foucault.report.uncertainty import coefficients

UG = 1e-6 * 9.80665
WEIGHED = ("prior", "white noise of accelerometers", "white noise of gyros")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One session of 5400 s, sampled once a second, calibrated into a run folder."""
    where = tmp_path_factory.mktemp("tumble")
    text = campaign.template("platform_tumble")
    text = re.sub(r'^interval = "0.2 s"', 'interval = "1 s"', text, flags=re.MULTILINE)
    # Known exactly, latitude adds nothing to what the bound counts.
    text = re.sub(r'^latitude_sd = ".*"', 'latitude_sd = "0 deg"', text, flags=re.MULTILINE)
    session = campaign.simulate(campaign.parse(text, where / "campaign.toml"), 3)
    campaign.save_session(session, where)
    result = campaign.calibrate(where / "campaign.toml")
    run_folder.save(result, where / "run")
    return where


@pytest.fixture(scope="module")
def result(folder):
    return run_folder.load_result(folder / "run")


def words_of(section):
    items = [w for b in section.blocks if b.kind == "items" for _, w in b.items]
    return "\n".join([section.lead, *(b.text for b in section.blocks if b.kind == "text"), *items])


def figures_of(section):
    return [b for b in section.blocks if b.kind == "figure"]


def table_of(section, which=0):
    return [b for b in section.blocks if b.kind == "table"][which]


def test_residuals_with_slow_noise_have_no_upper_limit(result):
    chi = {"accel": [950.0, 900.0, None, 1000.0]}  # as result.json says infinity
    slow = replace(result, diagnostics=result.diagnostics | {"chi_square": chi})
    said = words_of(tumble.residuals(slow))
    assert "chi-square 950, inside 900 and above (1000 degrees of freedom)" in said
    chi = {"accel": [850.0, 900.0, None, 1000.0]}
    low = replace(result, diagnostics=result.diagnostics | {"chi_square": chi})
    assert "chi-square 850, outside 900 and above" in words_of(tumble.residuals(low))


def test_the_sections_and_their_order(result):
    assert [s.title for s in sections(result)] == [
        "Alignment", "Coefficients", "Motion", "What the motion shows",
        "Estimates in the course of time", "Residuals", "Sensitivity", "What could not be seen",
        "Uncertainty budget",
        "Correlation", "Findings", "Checks",
        "How to apply it", "Certificate", "Provenance",
    ]  # fmt: skip


def test_only_the_attitude_is_left_of_a_trial(result):
    made = sections(replace(result, tables={}, diagnostics={**result.diagnostics}))
    assert "Alignment" in [s.title for s in made]
    bare = {k: v for k, v in result.diagnostics.items() if k != "observability"}
    made = [s.title for s in sections(replace(result, diagnostics=bare))]
    assert {"Motion", "Residuals", "Sensitivity"} <= set(made)
    assert "What the motion shows" not in made


def test_the_page_is_whole_and_not_too_large(folder):
    page = report.write(folder / "run").read_text(encoding="utf-8")
    assert 1e6 < len(page.encode()) < 1.5e6
    assert "<script src" not in page and "NaN" not in page.split("<script>/**")[0]


def test_the_alignment_says_angles_and_directions(result):
    section = tumble.alignment(result)
    angles, axes = table_of(section), table_of(section, 1)
    for row, word in zip(angles.rows, ("outer", "middle", "inner"), strict=True):
        assert row[0] == word
        value = float(row[1].rstrip("°").replace("−", "-"))
        assert value == pytest.approx(
            np.degrees(result.coefficients.value(f"attitude.{word}")), abs=1e-3
        )
    C_pn = attitude_of(np.array([result.coefficients.value(n) for n in LAYOUT.names[42:]]))
    for row, (east, north, up) in zip(axes.rows, C_pn, strict=True):
        azimuth, elevation, *parts = (float(c.rstrip("°").replace("−", "-")) for c in row[1:])
        assert azimuth == pytest.approx(np.degrees(np.arctan2(east, north)) % 360, abs=1e-3)
        assert elevation == pytest.approx(np.degrees(np.arcsin(up)), abs=1e-3)
        assert parts == pytest.approx([east, north, up], abs=1e-5)
    facts = dict(next(b.pairs for b in section.blocks if b.kind == "facts"))
    assert facts["attitude at the start known to"].endswith("about East, North and Up")
    assert facts["delay of the readings"].endswith("tested: none seen")


@pytest.mark.parametrize(
    ("delay", "words"),
    [
        ({"value": 0.01, "sd": 1e-3, "estimated": True}, "10.0 ± 1.0 ms, estimated with the rest"),
        ({"value": 0.01, "sd": 1e-3, "estimated": False}, "10.0 ± 1.0 ms, tested: NOT taken off"),
        ({"value": -1e-9, "sd": 1e-3, "estimated": False}, "0.0 ± 1.0 ms, tested: none seen"),
        ({"value": 0.0, "sd": 0.0, "estimated": False}, "not tested"),
        ({"value": 0.0, "sd": None, "estimated": False}, "not tested"),
    ],
)
def test_the_delay_in_words(delay, words, result):
    facts = tumble.alignment(replace(result, diagnostics=result.diagnostics | {"delay": delay}))
    assert dict(facts.blocks[-1].pairs)["delay of the readings"] == words


def test_all_coefficients_in_their_groups(result):
    table = table_of(coefficients(result))
    assert [row[0] for row in table.rows if len(row) == 1] == [
        "Gyros",
        "Accelerometers",
        "Attitude",
    ]
    rows = [row for row in table.rows if len(row) > 1]
    assert [row[0] for row in rows] == list(LAYOUT.names)
    headings = [c.heading for c in table.columns]
    ratio = np.array([float(row[headings.index("sd / bound")]) for row in rows])
    scale = [LAYOUT.index(f"accel.scale.{a}") for a in "xyz"]
    budget = result.diagnostics["budget"]
    noise = np.sqrt(np.sum([budget[row] for row in WEIGHED], axis=0))
    np.testing.assert_allclose(noise / result.diagnostics["bound"], 1.0, rtol=1e-9)
    np.testing.assert_allclose(ratio, result.coefficients.sd / noise, rtol=0.006)  # two decimals
    # Gravity touches what is per g, too, but hardly.
    assert np.all(np.delete(ratio, scale) < 1.1)
    assert np.all(ratio[scale] > 100)  # gravity is known to 40 mGal
    assert rows[LAYOUT.index("gyro.drift_input_spin.x")][headings.index("unit")] == "°/h/g²"


def test_the_legs_are_those_of_the_plan(result):
    section = tumble.motion(result)
    rows = table_of(section).rows
    assert [row[1:3] for row in rows] == [
        ["0", "1800"], ["1800", "2700"], ["2700", "4500"], ["4500", "5400"],
    ]  # fmt: skip
    turned = np.array([[float(c.replace("−", "-")) for c in row[3:6]] for row in rows])
    assert np.argmax(np.abs(turned), axis=1).tolist() == [0, 2, 1, 2]
    assert np.sign(turned[np.arange(4), [0, 2, 1, 2]]).tolist() == [-1, -1, -1, 1]
    ranks = [int(row[6]) for row in rows]
    assert ranks == sorted(ranks) and ranks[-1] == 45 and ranks[0] < 45
    assert [int(row[7]) for row in rows][-1] == 45


def test_the_paths_end_where_the_attitude_says(result):
    space, flat, angles = figures_of(tumble.motion(result))
    found = {t["name"]: t for t in space.data if t.get("mode") == "lines" and "name" in t}
    C_pn = np.array(result.diagnostics["attitude"]["C_pn"])
    for row, axis in zip(C_pn, "xyz", strict=True):
        tip = np.array([found[axis][c] for c in "xyz"], float)
        np.testing.assert_allclose(np.linalg.norm(tip, axis=0), 1.0, atol=1e-5)
        np.testing.assert_allclose(tip[:, -1], row, atol=1e-3)
    for trace in flat.data:
        drawn = [v for v in trace["x"] if v is not None]
        assert np.all(np.abs(drawn) <= 1.0001)
    # Every point of a path is on one of the halves.
    ways = [t for t in flat.data if t["mode"] == "lines" and t["name"] == "z"]
    assert all(
        a is not None or b is not None for a, b in zip(ways[0]["x"], ways[1]["x"], strict=True)
    )
    assert [t["name"] for t in angles.data] == ["outer", "middle", "inner"]
    assert len([s for s in angles.layout["shapes"] if s["x0"] == s["x1"]]) == 3


def test_what_the_motion_shows(result):
    section = tumble.observability(result)
    words = words_of(section)
    assert "Rank 45 of 45" in words and "Not seen" not in words
    assert "known to 0.1" in words and "`gyro.drift_input_spin.x`" in words
    assert "`accel.bias.x` and `accel.quadratic.x` (−0.98)" in words
    growth, drifts, others = figures_of(section)
    rank, alone = (t["y"] for t in growth.data)
    assert rank[0] == 0 and rank[-1] == 45 and np.all(np.diff(rank) >= 0)
    assert np.all(np.asarray(alone) <= np.asarray(rank))
    dots = [f.data[1] for f in (drifts, others)]
    assert [len(d["x"]) for d in dots] == [21, 24]
    at = dots[0]["y"].index("d<sub>Ox</sub>")
    k = LAYOUT.index("gyro.drift_output.x")
    noise = np.sqrt(sum(result.diagnostics["budget"][row][k] for row in WEIGHED))
    assert dots[0]["x"][at] == pytest.approx(noise / result.coefficients.prior_sd[k], rel=1e-3)


def test_what_is_not_seen_is_a_warning(result):
    seen = result.diagnostics["observability"]
    unseen = ["+0.71 gyro.drift.x -0.71 gyro.drift.y: not seen at all"]
    poor = seen | {"rank": 44, "unseen": unseen, "smallest": 1e-6}
    poor["growth"] = seen["growth"] | {"rank": [min(r, 44) for r in seen["growth"]["rank"]]}
    section = tumble.observability(replace(result, diagnostics={"observability": poor}))
    assert section.title == "What the motion shows, and what not"
    warnings = [
        w for b in section.blocks if b.kind == "items" for s, w in b.items if s == "warning"
    ]
    assert warnings == ["Not seen: +0.71 `gyro.drift.x` −0.71 `gyro.drift.y`."]
    words = words_of(section)
    assert "1 combination of" in words and "Only the prior" in words
    assert "Remains least" not in words
    many = replace(result, diagnostics={"observability": poor | {"unseen": 15 * unseen}})
    assert "Not seen: 3 more combinations." in words_of(tumble.observability(many))


def test_every_estimate_ends_at_zero_within_its_band(result):
    drawn = figures_of(tumble.course(result))
    assert len(drawn) == 15
    names = []
    for figure in drawn:
        assert len(figure.data) == 6
        family = re.match("<b>(.*)</b>", figure.layout["annotations"][0]["text"]).group(1)
        for band, line, note in zip(
            figure.data[::2], figure.data[1::2], figure.layout["annotations"][1:], strict=True
        ):
            n = len(line["x"])
            upper, y = np.array(band["y"][:n]), np.array(line["y"])
            assert upper[0] > upper[-1] > 0
            if family != "attitude":
                names.append(f"{family}.{note['text']}")
                k = LAYOUT.index(names[-1])
                assert abs(y[-1]) < 1e-3
                last = line["customdata"][-1][1]
                assert last == pytest.approx(
                    3 * result.tables["course"][f"{names[-1]}.sd"][-1]
                    / figures_size(LAYOUT.coefficients[k].kind), rel=0.01,
                )  # fmt: skip
                assert np.mean(np.abs(y) <= upper) > 0.9
    assert sorted(names) == sorted(CONSTANTS.names)


def figures_size(kind):
    from foucault import units

    return units.factor(units.KINDS[kind].display[0], kind)


@pytest.mark.parametrize(("unit", "top"), [(1e-4, 3.0), (0.3, 300.0), (1.0, 2.0), (1e-9, 1e-7)])
def test_marks_stand_apart_and_on_the_axis(unit, top):
    values, words = tumble._symmetric(unit, top)
    assert values[0] == 0 and len(values) == len(words) == 1 + 2 * (len(values) // 2)
    assert np.all(np.abs(values) <= top)
    plain = [re.sub("10<sup>(.*)</sup>", r"1e\1", w.replace("−", "-")) for w in words]
    np.testing.assert_allclose([float(w) for w in plain], values)


def test_residuals_keep_every_outlier(result):
    section = tumble.residuals(result)
    (figure,) = figures_of(section)
    for trace, axis in zip(figure.data, "xyz", strict=True):
        white = result.tables["residuals"][axis]
        assert len(trace["x"]) < len(white) / 4
        assert np.sum(np.abs(trace["y"]) > 3) == np.sum(np.abs(white) > 3)
    assert re.search(
        r"of 16\d\d\d residuals \d+ lie outside, where 4\d would by chance", section.lead
    )
    words = words_of(section)
    assert "Readings of the accelerometers: chi-square 1" in words and "e+" not in words
    assert "Neighbouring residuals are unrelated." in words


def test_sensitivities_in_readable_units(result):
    *four, _ = figures_of(tumble.sensitivity(result))
    assert len(four) == 4
    own = {t["name"]: np.array(t["y"]) for t in four[3].data}
    np.testing.assert_allclose(own["bias"], 1.0)  # ug per ug
    g = result.diagnostics["gravity"] / 9.80665
    assert np.abs(own["scale"]).max() == pytest.approx(g, rel=2e-3)  # ppm of 1 g
    assert own["quadratic"].max() == pytest.approx(g**2, rel=4e-3) and own["quadratic"].min() >= 0
    arcsec = np.radians(1 / 3600) * result.diagnostics["gravity"] / UG
    assert np.abs(own["yx"]).max() == pytest.approx(arcsec, rel=0.01)
    assert {t["yaxis"] for t in four[3].data} == {"y"}  # it alone answers
    drift = [t for t in four[0].data if t["name"] == "x"]
    assert len(drift) == 3 and max(np.abs(t["y"]).max() for t in drift) > 1000  # ug per deg/h


def test_every_family_can_be_chosen(result):
    explorer = figures_of(tumble.sensitivity(result))[-1]
    choices = explorer.layout["meta"]["choices"]
    assert len(choices) == len(set(choices)) == 14
    assert {t["meta"] for t in explorer.data} == set(choices)
    assert len(explorer.data) == 3 * 45
    assert "gyro.torquer_scale [µg per ppm]" in choices and explorer.on == "screen"


def test_a_course_that_leads_nowhere_is_drawn(result):
    course = dict(result.tables["course"])
    course["attitude.x"] = np.full_like(course["attitude.x"], np.nan)
    course["gyro.drift.x"] = 1e9 * course["gyro.drift.x"]
    page = report.html(replace(result, tables=result.tables | {"course": course}))
    assert "Estimates in the course of time" in page
