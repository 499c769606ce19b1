"""Still figures: what a page without a script shows lies where the numbers say."""

from __future__ import annotations

import base64
import gzip
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from foucault import report
from foucault.report import still
from foucault.report.chart import area, axis, bars, dots, draw, line, titled
from foucault.report.page import Figure
from foucault.report.scales import axis_of, ticks, written
from make_browser import WITHOUT, chromium, driven, watched
from make_result import make_result

PAIR = r"M(-?[\d.]+) (-?[\d.]+)"


def made(*data, **more) -> Figure:
    return draw("chart.residuals", data, **more)


def paths(figure: Figure) -> list[tuple[str, str]]:
    root = ElementTree.fromstring(still.svg(figure))
    return [(e.attrib["style"], e.attrib["d"]) for e in root.iter("path")]


def words(figure: Figure) -> list[str]:
    root = ElementTree.fromstring(still.svg(figure))
    return ["".join(e.itertext()) for e in root.iter("text")]


def points(figure: Figure, colour: str) -> np.ndarray:
    d = "".join(d for style, d in paths(figure) if colour in style)
    return np.array(re.findall(PAIR, d), float)


def test_dots_lie_on_straight_scales_and_up_is_up():
    x, y = np.array([0.0, 1.0, 4.0]), np.array([-2.0, 6.0, 0.0])
    at = points(made(dots("a", x, y, "var(--bad)")), "var(--bad)")
    np.testing.assert_allclose(np.diff(at[:, 0]) / np.diff(x), np.diff(at[:2, 0])[0], atol=0.1)
    scale = np.diff(at[:, 1]) / np.diff(y)
    np.testing.assert_allclose(scale, scale[0], atol=0.1)
    assert scale[0] < 0


def test_a_logarithmic_axis_gives_each_decade_the_same_room():
    look = axis("t", type="log", dtick=1)
    figure = made(dots("a", np.array([1.0, 10.0, 1000.0]), np.ones(3), "var(--bad)"), x=look)
    first, second, third = points(figure, "var(--bad)")[:, 0]
    assert third - second == pytest.approx(2 * (second - first), abs=0.2)
    assert {"1", "10", "100", "1000"} <= set(words(figure))


def test_words_beside_a_point_stand_on_the_side_that_is_asked_for():
    x = np.array([1.0, 1.0, 1.0])
    sides = ["middle right", "middle left", "top center"]
    dot = dots("a", x, np.arange(3.0), "var(--bad)", mode="markers+text", text=["r", "l", "t"],
               textposition=sides)  # fmt: skip
    figure = made(dot)
    root = ElementTree.fromstring(still.svg(figure))
    said = {e.text: e.attrib for e in root.iter("text") if e.text in ("r", "l", "t")}
    at = points(figure, "var(--bad)")[0, 0]
    assert float(said["r"]["x"]) > at > float(said["l"]["x"])
    assert (said["r"]["text-anchor"], said["l"]["text-anchor"]) == ("start", "end")
    assert float(said["t"]["x"]) == pytest.approx(at, abs=8)


def test_a_line_breaks_where_nothing_is_known():
    figure = made(line("a", np.arange(5.0), [0.0, 1.0, None, 1.0, 0.0], "var(--bad)"))
    (d,) = [d for style, d in paths(figure) if "var(--bad)" in style]
    assert d.count("M") == 2 and d.count("l") == 2


def test_bars_side_by_side_and_on_top_of_one_another():
    some = [bars(n, ["p", "q"], [1.0, 3.0], c, None) for n, c in (("a", "red"), ("b", "blue"))]

    def boxes(mode: str) -> dict[str, list[list[float]]]:
        figure = made(*some, barmode=mode, x=axis("", type="category"), y=axis("size"))
        return {
            colour: [
                [float(v) for v in box]
                for style, d in paths(figure)
                if f"fill:{colour}" in style
                for box in re.findall(rf"{PAIR}H([\d.]+)V([\d.]+)", d)
            ][:2]
            for colour in ("red", "blue")
        }

    side = boxes("group")
    assert side["red"][0][2] <= side["blue"][0][0] + 0.2  # where one ends the other begins
    assert side["red"][0][1] == side["blue"][0][1]
    stacked = boxes("stack")
    for red, blue in zip(stacked["red"], stacked["blue"], strict=True):
        assert red[0] == blue[0] and red[3] == pytest.approx(blue[1], abs=0.1)


def test_only_the_first_of_several_choices_is_drawn():
    data = [
        dots("", np.arange(3.0), np.arange(3.0), colour, meta=name)
        for name, colour in (("one", "red"), ("two", "blue"))
    ]
    figure = made(*data, meta={"choices": ["one", "two"], "choose": "which"})
    assert len(points(figure, "stroke:red")) == 3 and len(points(figure, "stroke:blue")) == 0


def test_what_a_person_wrote_stays_text():
    bad = '<b>"a" & <script>alert(1)</script></b>'
    text = still.svg(made(line(bad, [0.0, 1.0], [0.0, 1.0]), notes=[titled(bad)], legend=True))
    root = ElementTree.fromstring(text)
    assert "<script" not in text
    assert not [e for e in root.iter() if e.tag not in ("svg", "path", "text", "tspan")]


def test_areas_need_no_points_and_empty_figures_no_range():
    assert paths(made(area("a", [0.0, 1.0, 1.0], [0.0, 0.0, 1.0])))
    assert still.svg(made(line("a", [], [])))


@pytest.mark.parametrize(
    ("span", "most", "said"),
    [
        ((0, 10), 5, ["0", "2", "4", "6", "8", "10"]),
        ((-0.031, 0.029), 6, ["−0.03", "−0.02", "−0.01", "0", "0.01", "0.02"]),
        ((0, 3e-7), 3, ["0", "1×10⁻⁷", "2×10⁻⁷", "3×10⁻⁷"]),
    ],
)
def test_ticks_are_round(span, most, said):
    look = {"range": list(span), "nticks": most}
    assert [text for _, text in ticks(axis_of("x", look, [], {}))] == said


def test_numbers_are_written_for_people():
    assert [written(v) for v in (0.1 + 0.2, -1500, 2e6, "x")] == ["0.3", "−1500", "2×10⁶", "x"]


def test_every_flat_figure_of_a_page_is_there_without_a_script():
    page = report.html(make_result())
    boxes = re.findall(r'<div class="plot".*?</div>', page, flags=re.DOTALL)
    flat = [box for box in boxes if '"scene"' not in box]
    assert len(boxes) == len(flat) + 1
    assert all('<svg class="still"' in box for box in flat)
    for box in flat:
        svg = box[box.index("<svg") : box.index("</svg>") + 6]
        assert "nan" not in re.sub(r"<text.*?</text>", "", svg)
        ElementTree.fromstring(svg)


@pytest.mark.skipif(chromium() is None, reason=WITHOUT)
def test_still_figures_remain_where_the_library_of_figures_does_not_run():
    page = report.html(make_result())
    held = re.search(r'id="plotly">([^<]+)<', page)
    nothing = base64.b64encode(gzip.compress(b"")).decode()
    with driven() as browser:
        opened = browser.new_page()
        opened.set_content(page)
        opened.wait_for_function("!document.querySelector('svg.still')")  # drawn over
        opened = browser.new_page()
        said = watched(opened)
        opened.set_content(page.replace(held[1], nothing))
        opened.wait_for_function("!document.getElementById('plotly')")  # unpacked, and run
        opened.wait_for_timeout(300)
        assert opened.query_selector("svg.still") is not None
        assert said == []
