"""Every report begins and ends alike."""

from __future__ import annotations

from foucault.errors import finding
from foucault.report import page
from foucault.report.page import Items, Table


def test_findings_are_the_same_as_objects_and_as_documents():
    noticed = [finding("compare.unnamed"), finding("study.missing", folder="x")]
    made = page.findings(noticed, "results")
    again = page.findings([f.as_dict() for f in noticed], "results")
    assert made == again
    assert made.lead == "Noticed in the results; the work went on."
    (items,) = made.blocks
    assert isinstance(items, Items)
    assert items.items[0][1] == f"{noticed[0].message} {noticed[0].cure}"
    assert items.items[1][0] == "bad"
    assert page.findings([]) is None


def test_what_is_not_known_is_left_out_of_the_provenance():
    (table,) = page.provenance([("seed", "4"), ("tolerance", "")]).blocks
    assert isinstance(table, Table)
    assert table.rows == [["seed", "4"]]


def test_values_are_written_for_people():
    value = {"a": 1 / 3, "b": [1, None]}
    assert page.words(value) == "a 0.333333; b 1, unknown"
