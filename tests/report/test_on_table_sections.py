"""Sections of a session on a table: norms, residuals, orientations, control, rig, certificate."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from foucault import report
from foucault.report import evidence
from foucault.report.calibration import certificate, sections
from foucault.report.page import Figure, Items, Table, Text
from foucault.result import Check
from make_result import GRAVITY, make_result

MICRO_G = 9.80665e-6
DEGREE_PER_HOUR = np.pi / 180 / 3600
ARCSEC = np.pi / 648000


def readings(rests: int = 4, spins: int = 3) -> dict[str, np.ndarray]:
    """Rests, then spins; the numbers are made up so that every one of them can be told."""
    n = rests + spins
    k = np.arange(n)
    spin = k >= rests
    up = np.column_stack([np.cos(k), np.sin(k), np.zeros(n)])
    nothing = np.where(spin, 1.0, np.nan)
    true = 0.175
    return {
        "start": 100.0 * k,
        "end": 100.0 * k + 60,
        "time": np.full(n, 60.0),
        "rate": np.where(spin, 0.1745329, 0.0),
        "turns": np.where(spin, 4.0, 0.0),
        "outer": np.zeros(n),
        "middle": np.radians(10.0 * k),
        "inner": np.zeros(n),
        **{f"up_{a}": up[:, i] for i, a in enumerate("xyz")},
        "norm_before": GRAVITY + 1e-2 * (1 + k),
        "norm_after": GRAVITY + MICRO_G * (1 + k),
        "norm_sd": np.full(n, 10 * MICRO_G),
        "rate_before": nothing * (true + 500 * DEGREE_PER_HOUR * (1 + k)),
        "rate_after": nothing * (true + 0.5 * DEGREE_PER_HOUR * (1 + k)),
        "rate_true": nothing * true,
        "rate_sd": nothing * 3 * DEGREE_PER_HOUR,
        "residual": 0.5 + 0.1 * k,
        "accel_residual": 0.5 + 0.1 * k,
        "gyro_residual": np.where(spin, 1.5, 0.0),
        "weight": np.ones(n),
        "accel_weight": np.ones(n),
        "gyro_weight": np.ones(n),
        "detectable": np.full(n, 80 * MICRO_G),
    }


def rig_table(*rows: tuple[str, str, float, float, float]) -> dict[str, np.ndarray]:
    names, kinds, value, sd, prior = zip(*rows, strict=True)
    return {
        "name": np.array(names),
        "meaning": np.array([f"meaning of {n}" for n in names]),
        "kind": np.array(kinds),
        "value": np.array(value),
        "sd": np.array(sd),
        "prior_sd": np.array(prior),
    }


def made(table=None, rig=None, **changes):
    tables = {"readings": readings() if table is None else table}
    if rig is not None:
        tables["rig"] = rig
    diagnostics = {
        "gravity": GRAVITY,
        "plan": "icosahedron 12",
        "chi_square": {"accel at rest": [3.0, 1.0, 9.0, 4.0], "gyro in spins": [30.0, 1.0, 9.0, 4]},
    }
    return make_result(tables=tables, diagnostics=diagnostics | changes.pop("more", {}), **changes)


def figures(section) -> list[Figure]:
    return [block for block in section.blocks if isinstance(block, Figure)]


def traces(figure: Figure, name: str, ref: str = "x") -> list[dict]:
    return [t for t in figure.data if t["name"] == name and t.get("xaxis", "x") == ref]


def outlier(table, j=1, after=500 * MICRO_G):
    table["norm_after"][j] = GRAVITY + after
    table["weight"][j] = table["accel_weight"][j] = 1e-6
    table["accel_residual"][j] = 30.0
    return table


def test_norms_of_rests_and_spins_stand_side_by_side():
    force, rate = figures(evidence.norms_of_readings(made()))
    (rests,), (spins,) = traces(force, "after", "x"), traces(force, "after", "x2")
    assert rests["x"] == [1, 2, 3, 4] and spins["x"] == [1, 2, 3]
    np.testing.assert_allclose(rests["y"], [1, 2, 3, 4], rtol=1e-5)  # µg
    np.testing.assert_allclose(spins["y"], [5, 6, 7], rtol=1e-5)
    (before,) = traces(force, "before", "x")
    np.testing.assert_allclose(before["y"], np.array([1, 2, 3, 4]) * 1e-2 / 9.80665e-3, rtol=1e-5)
    assert force.layout["yaxis"]["title"]["text"] == "after [µg]"
    assert force.layout["yaxis2"]["title"]["text"] == "before [mg]"
    (after,) = traces(rate, "after")
    np.testing.assert_allclose(after["y"], [2.5, 3.0, 3.5], rtol=1e-5)  # deg/h, spins only
    assert rate.layout["xaxis"]["title"]["text"] == "spin"


def test_the_band_is_two_predicted_sd():
    force, rate = figures(evidence.norms_of_readings(made()))
    for figure, sd in ((force, 10.0), (rate, 3.0)):
        band = traces(figure, "±2 sd")[0]["y"]
        assert max(v for v in band if v is not None) == pytest.approx(2 * sd, rel=1e-5)
        assert min(v for v in band if v is not None) == pytest.approx(-2 * sd, rel=1e-5)


def test_a_reading_left_out_is_named_and_does_not_set_the_scale():
    force, _ = figures(evidence.norms_of_readings(made(outlier(readings()))))
    (rests,) = traces(force, "after", "x")
    assert rests["x"] == [1, 3, 4]
    top = force.layout["yaxis"]["range"][1]
    assert top == pytest.approx(1.2 * 20.0, rel=1e-5)  # the band, not the outlier
    before, after = traces(force, "left out", "x")
    assert after["text"] == ["rest 2: 500 µg"] and before["text"] == ["rest 2"]
    assert after["customdata"] == pytest.approx([500.0], rel=1e-4)
    assert 0 < after["y"][0] < top
    assert after["marker"]["symbol"] == ["triangle-up"]
    assert [before["showlegend"], after["showlegend"]] == [True, False]


def test_a_reading_left_out_that_fits_the_scale_is_a_cross_where_it_is():
    force, _ = figures(evidence.norms_of_readings(made(outlier(readings(), after=-15 * MICRO_G))))
    after = traces(force, "left out", "x")[1]
    assert after["y"] == pytest.approx([-15.0], rel=1e-4)
    assert after["marker"]["symbol"] == ["x"] and after["text"] == ["rest 2"]


def test_residuals_say_which_was_left_out_and_how_large_it_is():
    accel, gyro = figures(evidence.residuals_of_readings(made(outlier(readings()))))
    (left,) = traces(accel, "left out")
    assert left["x"] == [2] and left["text"] == ["30"]
    assert left["y"][0] == pytest.approx(1.6 * 3.0)  # cut at the top of the scale
    (used,) = traces(accel, "used", "x")
    assert used["x"] == [1, 3, 4]
    np.testing.assert_allclose(used["y"], [0.5, 0.7, 0.8])
    assert accel.layout["shapes"][1]["y0"] == 3.0
    assert [t["name"] for t in gyro.data] == ["used"] and gyro.data[0]["x"] == [1, 2, 3]


def test_the_weight_of_one_triad_does_not_mark_the_other():
    table = readings()
    table["weight"][5] = table["accel_weight"][5] = 1e-6  # specific force of spin 2
    accel, gyro = figures(evidence.residuals_of_readings(made(table)))
    assert traces(accel, "left out", "x2")[0]["x"] == [2]
    assert traces(gyro, "left out") == []


def test_chi_square_of_every_kind_of_reading():
    section = evidence.residuals_of_readings(made())
    (items,) = [b for b in section.blocks if isinstance(b, Items)]
    assert items.items == [
        ("good", "Specific force at rest: chi-square 3, inside 1 to 9 (4 degrees of freedom)."),
        (
            "warning",
            "Angular rate in spins, across the axis: chi-square 30, outside 1 to 9 (4 degrees of "
            "freedom).",
        ),
    ]


def on_faces() -> dict[str, np.ndarray]:
    """Readings without a table: signed residuals, turns that are fitted exactly."""
    table = readings()
    for name in list(table):
        if name.startswith(("accel_", "gyro_")) or name in ("outer", "middle", "inner", "rate_sd"):
            del table[name]
    table["residual"] = np.array([-1.0, 1.0, 0.5, -0.5, 1e-7, 0.0, -1e-7])
    return table


def test_without_table_angles_a_spin_is_a_turn_and_one_residual_serves_both():
    result = made(on_faces())
    (accel,) = figures(evidence.residuals_of_readings(result))  # nothing tests the turns
    np.testing.assert_allclose(accel.data[0]["y"], [-1.0, 1.0, 0.5, -0.5])
    assert accel.layout["yaxis"]["range"][0] < -3.0
    section = evidence.norms_of_readings(result)
    assert figures(section)[1].layout["xaxis"]["title"]["text"] == "turn"
    texts = [b.text for b in section.blocks if isinstance(b, Text)]
    assert texts[1].endswith("just enough readings, so that nothing is left.")
    assert "of the table" not in section.lead


def test_orientations_show_rests_and_spins():
    missing = {"missing": [{"direction": [0.0, 0.0, 1.0], "words": "+z up"}], "largest_gap": 0.7}
    section = evidence.orientations(made(more={"coverage": missing}))
    ball, flat = figures(section)
    counts = {t["name"]: len(t["x"]) for t in ball.data if t.get("showlegend", True)}
    assert counts == {"spin": 3, "rest": 4, "missing": 1}
    assert next(t["text"] for t in flat.data if t["name"] == "rest")[0] == "rest 1"
    assert "40° away" in section.lead and "Rings" in section.lead
    assert section.blocks[-1].items == [("warning", "Missing: +z up.")]


def test_control_says_what_could_not_be_seen():
    table = readings()
    table["detectable"][2] = np.inf
    check = Check("control of the rests", 0.5, None, None, True, "It could not be seen.")
    section = evidence.control(made(table, checks=(check,)))
    (figure,) = figures(section)
    (seen,), (blind,) = traces(figure, "controlled", "x"), traces(figure, "not controlled", "x")
    np.testing.assert_allclose(seen["y"], 80.0, rtol=1e-5)
    assert blind["x"] == [3] and blind["text"] == ["∞"]
    assert section.blocks[-1].items == [("warning", "It could not be seen.")]


def test_the_rig_beside_what_was_believed():
    rig = rig_table(
        ("lever_arm.x", "length", 0.0123, 0.0011, np.inf),
        ("table.plumb.x", "angle", 12 * ARCSEC, 4 * ARCSEC, 30 * ARCSEC),
        ("table.plumb.y", "angle", 95 * ARCSEC, 4 * ARCSEC, 30 * ARCSEC),
        ("table.zero.inner", "angle", 0.0, 9.9 * ARCSEC, 10 * ARCSEC),
    )
    section = evidence.rig(made(rig=rig))
    assert section.title == "The table and the mounting"
    (table,) = [b for b in section.blocks if isinstance(b, Table)]
    rows = {row[0]: row[1:-1] for row in table.rows if len(row) > 1}
    assert rows["lever_arm.x"] == ["12.3", "1.1", "nothing", "mm"]
    # A family shares the unit that its largest member asks for.
    assert rows["table.plumb.x"] == ["0.200", "0.067", "± 0.50", "arcmin"]
    assert rows["table.plumb.y"] == ["1.583", "0.067", "± 0.50", "arcmin"]
    assert rows["table.zero.inner"] == ["0.0", "9.9", "± 10", "arcsec"]
    assert section.blocks[-1].items == [
        ("plain", "Known hardly better than before: `table.zero.inner`.")
    ]


def test_a_lever_arm_alone_has_its_own_title_and_no_beliefs():
    section = evidence.rig(made(rig=rig_table(("lever_arm.x", "length", -0.05, 0.01, np.inf))))
    assert section.title == "Lever arm" and section.lead.startswith("From the centre")
    (table,) = section.blocks
    assert [c.heading for c in table.columns] == ["quantity", "value", "± sd", "unit", "meaning"]
    assert table.rows[0][1] == "−50"


@pytest.mark.parametrize(
    ("gone", "title"),
    [
        (["norm_after", "rate_after"], "Norms before and after"),
        (["residual"], "Residuals"),
        (["up_x"], "Orientations visited"),
        (["detectable"], "What a wrong position would have done"),
    ],
)
def test_a_section_without_its_columns_is_left_out(gone, title):
    assert title in [s.title for s in sections(made())]
    table = {name: column for name, column in readings().items() if name not in gone}
    assert title not in [s.title for s in sections(made(table))]


def test_rests_alone_make_one_panel():
    table = {name: column[:4] for name, column in readings().items()}
    force, *others = figures(evidence.norms_of_readings(made(table)))
    assert others == [] and "xaxis2" not in force.layout
    assert "centripetal" not in evidence.norms_of_readings(made(table)).lead


def test_certificate_counts_what_was_done():
    facts = dict(certificate(made()).blocks[0].pairs)
    assert facts["positions"] == "icosahedron 12"
    assert facts["readings"] == "4 rests, 3 spins of 4 turns at 10 °/s"
    assert "readings" not in dict(certificate(make_result()).blocks[0].pairs)


def test_certificate_gives_no_range_of_what_was_not_calibrated():
    result = made(validity={"accel": [-9.8, 9.8], "gyro": [-1.0, 1.0]})
    assert "rates covered" in dict(certificate(result).blocks[0].pairs)
    alone = dataclasses.replace(result, coefficients=result.coefficients["accel"])
    facts = dict(certificate(alone).blocks[0].pairs)
    assert "rates covered" not in facts and "specific force covered" in facts


def test_the_page_writes_micro_g_as_people_do():
    check = Check("control of the rests", 0.5, None, None, True, "Noticed from 76 ug on.")
    page = report.html(made(checks=(check,)))
    assert "Noticed from 76\N{NO-BREAK SPACE}µg on." in page and "76 ug" not in page


def test_numbers_that_are_all_missing_still_make_a_page():
    table = {
        name: column if name in ("start", "end", "rate", "turns") else np.full(len(column), np.nan)
        for name, column in readings().items()
    }
    assert report.html(made(table)).startswith("<!doctype html>")
