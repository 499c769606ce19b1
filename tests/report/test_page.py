"""The page itself: readable by all, on screen and on paper, whatever it shows."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from foucault import report
from foucault.errors import finding
from foucault.report.page import counted_once, shown, signs
from foucault.units import KINDS, factor
from make_result import make_result

CSS = "".join(
    (Path(report.__file__).parent / name).read_text(encoding="utf-8")
    for name in ("colours.css", "page.css")
)


@pytest.fixture(scope="module")
def page() -> str:
    whole = report.html(make_result())
    return re.sub(r'<script type="text/plain" id="plotly">.*?</script>', "", whole)


def tags(page: str) -> list[tuple[str, dict[str, str | None]]]:
    found = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attributes):
            found.append((tag, dict(attributes)))

    Reader().feed(page)
    return found


def test_every_element_is_closed(page):
    void = {"meta", "input", "wbr", "br", "path", "circle"}
    open_tags = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, _):
            if tag not in void:
                open_tags.append(tag)

        def handle_endtag(self, tag):
            if tag not in void:
                assert open_tags.pop() == tag

    Reader().feed(page)
    assert open_tags == []


def test_language_title_and_width_are_declared(page):
    found = tags(page)
    assert ("html", {"lang": "en", "class": "flat"}) in found
    assert "<title>Calibration of MTi-28 0180-2214</title>" in page
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in [
        attributes for tag, attributes in found if tag == "meta"
    ]


def test_every_figure_and_icon_says_what_it_is(page):
    found = tags(page)
    plots = [a for t, a in found if t == "div" and a.get("class") == "plot"]
    icons = [a for t, a in found if t == "svg"]
    assert len(plots) == 11 and icons
    for attributes in plots + icons:
        assert attributes["role"] == "img" and len(attributes["aria-label"] or "") > 3
    assert len({a["aria-label"] for a in plots}) == len(plots)


def test_every_table_has_headings_in_words(page):
    heads = re.findall(r"<th scope=\"(\w+)\"[^>]*>(.*?)</th>", page)
    assert {scope for scope, _ in heads} == {"col", "row", "colgroup"}
    for _, text in heads:
        assert re.sub(r"<[^>]*>", "", text).strip()
    assert page.count("<th ") == len(heads)


def test_every_switch_has_its_label(page):
    found = tags(page)
    switches = {a["id"] for t, a in found if t == "input"}
    assert switches == {a["for"] for t, a in found if t == "label"} and len(switches) == 1


def test_each_kind_of_finding_is_said_once_the_gravest_first():
    noticed = [
        *(finding("allan.longest_rest", start=str(k), end="9") for k in range(3)),
        finding("allan.moves", start="1", end="2"),
    ]
    once = counted_once(noticed)
    assert [one["severity"] for one in once] == ["warning", "note"]
    assert once[1]["message"].endswith("(and 2 more like it)")
    assert once[1]["message"].startswith(noticed[0].message)


def test_links_lead_to_sections(page):
    found = tags(page)
    targets = {a["id"] for t, a in found if t == "section"}
    assert {(a["href"] or "")[1:] for t, a in found if t == "a"} == targets
    ids = [a["id"] for _, a in found if "id" in a]
    assert len(ids) == len(set(ids))


def test_paper_gets_the_flat_map_all_columns_and_no_buttons():
    paper = CSS[CSS.index("@media print") :]
    assert "size: A4" in CSS
    assert "figure.screen { display: none; }" in paper
    assert ".optional { display: table-cell; }" in paper
    assert ".code button" in paper
    assert "break-inside: avoid" in paper


def colours(theme: str) -> dict[str, str]:
    start = CSS.index("prefers-color-scheme: dark") if theme == "dark" else 0
    block = CSS[start : CSS.index("}", start)]
    light = dict(re.findall(r"(--[\w-]+): (#[0-9a-f]{6});", CSS[: CSS.index("}")]))
    return light | dict(re.findall(r"(--[\w-]+): (#[0-9a-f]{6});", block))


def luminance(colour: str) -> float:
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    r, g, b = (c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(one: str, other: str) -> float:
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_text_and_marks_stand_out(theme):
    """Contrast of WCAG 2.1, level AA: 4.5 for text, 3 for marks."""
    c = colours(theme)
    text = [(ink, paper) for ink in ("--ink", "--soft") for paper in ("--card", "--paper")]
    text += [(f"--{state}", f"--{state}-paper") for state in ("good", "warning", "bad")]
    text += [("--ink", "--code"), ("--ink", "--good-paper"), ("--ink", "--bad-paper")]
    for ink, paper in text:
        assert contrast(c[ink], c[paper]) >= 4.5, (ink, paper)
    marks = ("--first", "--second", "--third", "--fourth", "--fifth", "--sixth", "--bad", "--good")
    for mark in marks:
        assert contrast(c[mark], c["--card"]) >= 3.0, mark


@pytest.mark.parametrize(
    ("plain", "written"),
    [
        ("within 40 deg of y", "within 40° of y"),
        ("+17.1 +- 1.9 deg/h", "+17.1 ± 1.9\N{NO-BREAK SPACE}°/h"),
        ("24 ug at 60.0 degC", "24\N{NO-BREAK SPACE}µg at 60.0\N{NO-BREAK SPACE}°C"),
        ('write "47 deg" there', 'write "47 deg" there'),
        (
            "off by 3 ug/g^2, or 2 ppb/(deg/s)^2",
            "off by 3\N{NO-BREAK SPACE}µg/g², or 2\N{NO-BREAK SPACE}ppb/(°/s)²",
        ),
        ("0.06 deg/sqrt(h)", "0.06\N{NO-BREAK SPACE}°/√h"),
        ("by -1.3 percent", "by \N{MINUS SIGN}1.3\N{NO-BREAK SPACE}%"),
        ("on 2025-03-01, from 1e-9 on", "on 2025-03-01, from 1e-9 on"),
        ("degrees of freedom", "degrees of freedom"),
    ],
)
def test_units_are_written_with_signs_but_what_is_to_be_copied_is_not(plain, written):
    assert signs(plain) == written


@pytest.mark.parametrize("unit", sorted({u for kind in KINDS.values() for u in kind.display}))
def test_a_sentence_writes_a_unit_as_a_table_does(unit: str) -> None:
    written = signs(f"It is off by 3 {unit} (sd 1 {unit}), and less.")
    space = "\N{NO-BREAK SPACE}" * (shown(unit) not in (unit, "°")) or " " * (shown(unit) != "°")
    assert written == f"It is off by 3{space}{shown(unit)} (sd 1{space}{shown(unit)}), and less."
    assert factor(shown(unit), next(k for k, v in KINDS.items() if unit in v.display)) > 0
