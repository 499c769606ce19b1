"""Coefficients beside prior and bound, the budget, what was not seen, and the certificate."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from foucault import units
from foucault.report.calibration import certificate
from foucault.report.chart import shares
from foucault.report.page import Facts, Items, Table, shown
from foucault.report.uncertainty import budget, coefficients, unseen
from make_result import make_result


def table_of(section, which=0) -> tuple[list[str], dict[str, list[str]]]:
    """Headings, and the rows by their first cell, of a section's table."""
    table = [block for block in section.blocks if isinstance(block, Table)][which]
    rows = {row[0]: row for row in table.rows if len(row) > 1}
    return [column.heading for column in table.columns], rows


def test_uncertainty_beside_expanded_prior_and_bound():
    result = make_result()
    heads, rows = table_of(coefficients(result))
    assert heads == [
        "coefficient", "symbol", "value", "± sd", "± U (k=2)", "unit", "prior sd", "sd / bound",
        "meaning",
    ]  # fmt: skip
    for row in result.coefficients.rows():
        cells = dict(zip(heads, rows[row["name"]], strict=True))
        assert float(cells["± sd"]) == pytest.approx(row["display_sd"], rel=0.05)
        assert float(cells["± U (k=2)"]) == pytest.approx(2 * row["display_sd"], rel=0.05)
        assert cells["sd / bound"] == "1.25"
        assert bool(cells["prior sd"]) == row["name"].startswith("gyro.bias")


def test_a_triad_in_two_places_keeps_its_own_bounds():
    """As a delay of the accelerometers after the gyros: of each row the bound is its own."""
    result = make_result()
    names = result.coefficients.names
    order = [*range(1, len(names)), 0]
    c = result.coefficients.chosen(names[i] for i in order)
    moved = {"bound": [result.diagnostics["bound"][i] / (1 + (i == 0)) for i in order]}
    _, rows = table_of(coefficients(dataclasses.replace(result, coefficients=c, diagnostics=moved)))
    at = table_of(coefficients(result))[0].index("sd / bound")
    assert {name: rows[name][at] for name in names} == dict.fromkeys(names, "1.25") | {
        names[0]: "2.50"
    }


def test_only_the_expanded_uncertainty_waits_to_be_asked_for():
    table = coefficients(make_result()).blocks[0]
    assert [c.heading for c in table.columns if c.optional] == ["± U (k=2)"]
    assert "U = 2 sd" in table.option


@pytest.mark.parametrize("bound", [None, [1.0, 2.0]])
def test_without_a_bound_for_every_coefficient_there_is_no_column(bound):
    result = make_result(diagnostics={} if bound is None else {"bound": bound})
    heads, _ = table_of(coefficients(result))
    assert "sd / bound" not in heads


def test_a_coefficient_the_noise_cannot_bound_has_an_empty_cell():
    result = make_result()
    bound = [None, *result.diagnostics["bound"][1:]]
    heads, rows = table_of(coefficients(dataclasses.replace(result, diagnostics={"bound": bound})))
    column = heads.index("sd / bound")
    assert rows["accel.bias.x"][column] == "" and rows["accel.bias.y"][column] == "1.25"


def test_budget_names_type_and_basis_and_adds_up():
    result = make_result()
    section = budget(result)
    _, sources = table_of(section)
    kinds = {"accelerometer noise": "A", "gyro noise": "A", "local gravity": "B"}
    assert {source: row[1] for source, row in sources.items()} == kinds
    assert sources["local gravity"][4] == "60.0\x20%"
    heads, rows = table_of(section, which=1)
    assert heads[-2:] == ["combined", "unit"]
    for row in result.coefficients.rows():
        parts = np.array([0.0 if v == "–" else float(v) for v in rows[row["name"]][1:-2]])
        combined = float(rows[row["name"]][-2])
        rounding = 0.5 * 10.0 ** -len(rows[row["name"]][-2].partition(".")[2])
        assert combined == pytest.approx(row["display_sd"], abs=rounding)
        assert abs(np.hypot.reduce(parts) - combined) <= rounding * (1 + len(parts))


def test_declared_noise_is_type_b():
    result = make_result()
    noise = result.diagnostics["noise"] | {"source": "declared"}
    declared = dataclasses.replace(result, diagnostics=result.diagnostics | {"noise": noise})
    _, sources = table_of(budget(declared))
    assert sources["gyro noise"][1:3] == ["B", "noise as declared in the campaign"]


@pytest.mark.parametrize("given", [{}, {"noise": [1.0]}, {"noise": [None] * 21}])
def test_no_budget_no_section(given):
    assert budget(make_result(diagnostics={"budget": given})) is None


def test_what_could_not_be_seen():
    result = make_result()
    vector = result.coefficients
    free = np.ones(len(vector), bool)
    free[3] = False
    prior = vector.prior_sd.copy()
    prior[0] = vector.sd[0]  # nothing was added to what was known
    held = dataclasses.replace(vector, free=free, prior_sd=prior)
    section = unseen(dataclasses.replace(result, coefficients=held))
    (block,) = section.blocks
    assert isinstance(block, Items)
    texts = [text for _, text in block.items]
    assert texts == [
        f"Seen badly: {result.diagnostics['weakest'][0]}.",
        "No rest near: y down.",
        "No rest near: y down, tilted to +x and -z.",
        "Known hardly better than beforehand: `accel.bias.x`.",
        "Held at their values, not estimated: `accel.scale.x`.",
        "A wrong local gravity: 1 ppm of g is 1 ppm in all scale factors.",
    ]
    assert [state for state, _ in block.items] == ["warning"] * 4 + ["plain"] * 2


def test_nothing_unseen_no_section():
    assert unseen(make_result(diagnostics={})) is None


@pytest.mark.parametrize(
    ("unit", "sign"),
    [("ug", "µg"), ("deg/h", "°/h"), ("percent", "%"), ("ug/g^2", "µg/g²"), ("mg", "mg")],
)
def test_units_are_written_as_people_write_them(unit, sign):
    assert shown(unit) == sign


def test_every_sign_is_understood_when_copied_back():
    assert units.factor(shown("ug"), "specific force") == units.factor("ug", "specific force")
    assert units.factor(shown("deg/h"), "angular rate") == units.factor("deg/h", "angular rate")
    percent = units.factor("percent", "scale factor error")
    assert units.factor(shown("percent"), "scale factor error") == percent


def test_certificate_fills_what_is_known_and_leaves_lines_for_the_rest():
    block, told = certificate(make_result()).blocks
    assert "were taken for nothing" in told.text
    assert isinstance(block, Facts)
    facts = dict(block.pairs)
    assert facts["instrument"] == "MTi-28" and facts["serial number"] == "0180-2214"
    assert facts["date"] == "14 March 2025, 09:26 UTC+01:00"
    assert facts["temperature"] == "23.0 to 26.2 °C"
    assert facts["place"] == "45.4100° N, 31 m"
    assert facts["local gravity"] == "9.81744 ± 0.00002 m/s² (given)"
    assert facts["software"] == "Foucault 0.1.0"
    assert facts["log"] == "session.csv, SHA-256 9f2c9f2c9f2c…"
    blank = [what for what, value in block.pairs if not value]
    assert blank == ["operator", "next calibration due", "signature"]


def test_certificate_says_when_it_is_due():
    result = make_result(
        instrument={"due": "2026-03-14", "note": "after repair"},
        validity={"temperature": [296.0, 297.0], "temperature_mean": 296.5, "gyro": [-2.0, 2.0]},
    )
    facts = dict(certificate(result).blocks[0].pairs)
    assert facts["next calibration due"] == "2026-03-14"
    assert facts["note"] == "after repair"
    assert facts["temperature"] == "22.9 to 23.9 °C, mean 23.4 °C"
    assert facts["rates covered"] == "−115 to 115 °/s"
    slow = make_result(validity={"gyro": [-5e-5, 4.8481368e-5]})
    assert dict(certificate(slow).blocks[0].pairs)["rates covered"] == "−10.3 to 10 °/h"


def test_the_certificate_lists_what_is_not_estimated_as_type_b():
    some = {
        "what": ["quadratic terms", "local gravity"], "size": ["500 ug/g^2", "0.0004 m/s^2"],
        "basis": ["judgement", "declared"], "share": [0.2, 0.7], "times": [3.0, np.nan],
    }  # fmt: skip
    result = make_result()
    left = {k: np.array(v, object if k in ("what", "size", "basis") else float)
            for k, v in some.items()}  # fmt: skip
    with_it = dataclasses.replace(result, tables={**result.tables, "left_out": left})
    _, told, table = certificate(with_it).blocks
    assert "bounded by their size" in told.text
    heads, rows = table_of(certificate(with_it))
    assert list(rows) == ["local gravity", "quadratic terms"]  # the costliest first
    one = dict(zip(heads, rows["quadratic terms"], strict=True))
    assert (one["size (1 sd)"], one["type"], one["evaluated from"]) == (
        "500 ug/g^2", "B", "judgement",
    )  # fmt: skip
    assert one["largest share of a variance"] == "20.0 %"
    assert one["readings"] == "3 times its size"
    assert dict(zip(heads, rows["local gravity"], strict=True))["readings"] == "agree"
    assert table in certificate(with_it).blocks


@pytest.mark.parametrize(("labels", "sources"), [(13, 12), (4, 11), (21, 2)])
def test_shares_of_many_sources_have_room_for_their_names_and_are_told_apart(labels, sources):
    share = {f"source {k}": np.full(labels, 100 / sources) for k in range(sources)}
    drawn = shares([f"c{k}" for k in range(labels)], share, "shares")
    narrow = drawn.layout["meta"]["narrow"]["height"]
    # The legend of a narrow figure takes a row of 20 px for each source, and at most half of it.
    assert narrow >= 2 * 20 * sources and narrow >= drawn.layout["height"] + 20 * sources
    looks = [(t["marker"]["color"], t["marker"].get("opacity", 1)) for t in drawn.data]
    assert len(set(looks)) == sources
