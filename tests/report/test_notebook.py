"""In a notebook things show themselves, and the notebooks of the examples run."""

from __future__ import annotations

import ast
import json
import re
import sys
import types
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from foucault import Log, display
from foucault.report import notebook
from foucault.report.page import Figure
from make_result import make_result
from refusals import refuses

NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples" / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def result():
    return make_result()


def whole(html: str) -> str:
    """Return the text of HTML in which every element is closed."""
    opened: list[str] = []
    words: list[str] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, _):
            opened.extend([tag] if tag not in ("br", "path") else [])

        def handle_endtag(self, tag):
            if tag != "path":
                assert opened.pop() == tag

        def handle_data(self, data):
            words.append(data)

    Reader().feed(html)
    assert opened == []
    return " ".join(" ".join(words).split())


def test_a_result_shows_verdict_coefficients_checks_and_findings(result):
    said = whole(result._repr_html_())
    assert "MTi-28" in said and "Pass" in said
    for row in result.coefficients.rows():
        assert row["name"] in said and row["meaning"] in said
    assert all(check.sentence in said for check in result.checks)
    assert all(found.message in said for found in result.findings)


def test_parts_of_a_result_show_themselves(result):
    assert "gyro.bias.x" in whole(result.coefficients["gyro.bias"]._repr_html_())
    assert "accel.bias" not in whole(result.coefficients["gyro.bias"]._repr_html_())
    assert result.checks[0].name in whole(result.checks[0]._repr_html_())
    assert whole(result.verdict._repr_html_()).endswith("Pass")


def test_what_is_written_by_hand_stays_text():
    shown = make_result(instrument={"name": "<script>x</script>"})._repr_html_()
    assert "<script" not in shown


def test_a_log_shows_its_axes():
    accel = np.tile([0.0, 0.0, 9.80665], (101, 1)) + np.linspace(-1, 1, 101)[:, None]
    said = whole(Log(np.arange(101) / 50, None, accel)._repr_html_())
    assert "101 samples, 50 Hz, 2 s" in said
    assert re.search(r"accel z 9.807 0.5831 8.807 10.81 m/s²", said), said
    assert "gyro" not in said


def test_figures_by_name(result):
    known = notebook.figures(result)
    assert {"norms", "residuals", "budget", "correlation"} <= set(known)
    figure = result.plot("residuals")
    assert isinstance(figure, Figure) and "<svg" in figure._repr_html_()
    whole(figure._repr_html_())
    with refuses(
        "result.no_figure", "budget", match=r"no figure 'residual'. Did you mean 'residuals'"
    ):
        result.plot("residual")


def test_tables_are_frames_with_units(result):
    frame = result.dataframe("coefficients")
    assert frame.attrs["units"]["gyro.bias.x"] == "rad/s"
    assert frame.loc["gyro.bias.x", "value"] == result.coefficients.value("gyro.bias.x")
    rests = result.dataframe("rests")
    assert rests.attrs["units"]["start"] == "s" and len(rests) == 24
    np.testing.assert_array_equal(rests["start"], result.tables["rests"]["start"])
    with refuses("result.no_table", match=r"no table 'rest'. Did you mean 'rests'"):
        result.dataframe("rest")


def test_progress_is_a_bar_in_a_notebook_and_silent_elsewhere(monkeypatch, capsys):
    display._display.cache_clear()
    display.progress()(0.5, "reading")
    assert capsys.readouterr() == ("", "")
    bars = []

    class Handle:
        update = bars.append

    fake = types.SimpleNamespace(HTML=str, display=lambda text, **_: bars.append(text) or Handle)
    monkeypatch.setitem(sys.modules, "ipykernel", types.ModuleType("ipykernel"))
    monkeypatch.setitem(sys.modules, "IPython.display", fake)
    display._display.cache_clear()
    tell = display.progress()
    for fraction, words in ((0.2, "reading"), (0.6, "solving"), (1.0, "done")):
        tell(fraction, words)
    display._display.cache_clear()
    assert ["0.200" in bars[0], "solving" in bars[1], bars[2]] == [True, True, ""]


def test_there_are_three_notebooks():
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_its_cells_end_with(path):
    """Cell by cell, the last expression of each shown as a kernel would."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    space: dict[str, object] = {}
    drawn = 0
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == []
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, path.name, "exec"), space)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), path.name, "eval"), space)
            if hasattr(value, "_repr_html_"):
                shown = value._repr_html_()
                drawn += "<svg" in shown
                assert shown
    assert drawn >= 1
