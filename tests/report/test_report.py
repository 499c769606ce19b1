"""The report: one self-contained page that says what the run folder holds, and nothing else."""

from __future__ import annotations

import base64
import dataclasses
import gzip
import json
import re
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from foucault import report
from foucault.coefficients import CoefficientVector
from foucault.errors import ADVICE, FoucaultError, Status
from foucault.report.calibration import SECTIONS, sections
from foucault.report.page import Figure
from foucault.report.seen import seen
from foucault.result import Level
from foucault.run_folder import save
from make_result import make_result
from pages import figures

LIBRARY = re.compile(
    r'<!-- plotly\.js.*?<script type="text/plain" id="plotly">.*?</script>', re.DOTALL
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    save(make_result(), folder, "procedure = 'hand-rotated'\n")
    report.write(folder)
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def without_plotly(page: str) -> str:
    """The page without the one script that is plotly's."""
    return LIBRARY.sub("", page)


def text_of(page: str) -> str:
    class Reader(HTMLParser):
        words: list[str]

        def __init__(self):
            super().__init__()
            self.words, self.skip = [], 0

        def handle_starttag(self, tag, attrs):
            self.skip += tag in ("script", "style")

        def handle_endtag(self, tag):
            self.skip -= tag in ("script", "style")
            self.words.append(" " if tag in ("td", "th", "p", "li") else "")

        def handle_data(self, data):
            if not self.skip:
                self.words.append(data)

    reader = Reader()
    reader.feed(without_plotly(page))
    return " ".join("".join(reader.words).split())


def test_nothing_is_fetched(page):
    rest = without_plotly(page)
    assert len(rest) < 500_000 < len(page)  # plotly's script was found and taken out
    assert re.findall(r"https?:|//[a-z]", re.sub(r"^\s*//.*$", "", rest, flags=re.M)) == []
    assert re.findall(r"<(?:link|img|iframe|base)|@import|url\(", rest) == []
    assert re.findall(r"<script[^>]* src", page[:2000] + rest) == []


def test_plotly_is_there_once(page):
    (held,) = re.findall(r'id="plotly">([A-Za-z0-9+/=]+)</script>', page)
    code = gzip.decompress(base64.b64decode(held))
    assert code.startswith(b"/**\n* plotly.js v3") and b"MIT license" in code[:200]
    assert b"</script" not in code
    assert len(page.encode()) < 1_500_000


def test_a_page_without_figures_holds_no_library():
    empty = report.page.Document(report.page.Heading("x", [], "good", "Pass", []), [])
    assert "plotly" not in report.render(empty).split("<script>")[0]


def test_every_coefficient_is_there_with_its_numbers(page):
    text = text_of(page)
    vector = make_result().coefficients
    for line in str(vector).splitlines()[1:]:
        name, _, value, *_ = line.replace("-", "−").split()
        assert name in text
        assert f"{value} " in text[text.index(name) :][:80]


@pytest.mark.parametrize(
    ("level", "word", "state"),
    [
        (Level.PASS, "Pass", "good"),
        (Level.DOUBTFUL, "Doubtful", "warning"),
        (Level.UNUSABLE, "Unusable", "bad"),
    ],
)
def test_the_verdict_comes_first_in_word_and_shape(level, word, state):
    result = make_result(level=level)
    page = without_plotly(report.html(result))
    verdict = page[page.index('<div class="verdict') : page.index("<nav")]
    assert f'class="verdict {state}"' in verdict
    assert f'<svg class="icon {state}"' in verdict
    assert f'<p class="word">{word}</p>' in verdict
    for reason in result.verdict.reasons or ("All 5 checks passed.",):
        assert reason.replace("40 deg", "40°") in verdict
    assert page.index("<nav") < page.index("<main>")


def test_a_status_that_failed_gives_its_advice():
    page = report.html(make_result(status=Status.NOT_CONVERGED))
    assert "The iteration did not settle." in ADVICE[Status.NOT_CONVERGED]
    assert "The iteration did not settle." in text_of(page)


def test_sections_of_the_hand_rotated_procedure(page):
    titles = re.findall(r"<h2 id=[^>]*>(.*?)</h2>", page)
    assert titles == [
        "Coefficients",
        "Specific force before and after",
        "Residuals",
        "Orientations visited",
        "What could not be seen",
        "Uncertainty budget",
        "Correlation",
        "Rests left out and predicted",
        "Detection of rests",
        "Findings",
        "Checks",
        "How to apply it",
        "Certificate",
        "Provenance",
    ]
    text = text_of(page)
    assert "Missing: y down, tilted to +x and -z." in text
    assert "3 samples are missing between 211.40 s and 211.44 s." in text
    assert "chi-square 14.8, inside 5.2 to 30.6 (15 degrees of freedom)" in text
    assert "threshold 4.2" in text and "24 rests, 224 s in all" in text
    assert "45.4100° N" in text and "14 March 2025, 09:26" in text


def test_figures_show_the_numbers_of_the_tables(page):
    result = make_result()
    rests, gravity = result.tables["rests"], result.diagnostics["gravity"]
    drawn = figures(page)
    assert len(drawn) == 11
    norms, over_time, _, over_up, over_angle, ball, _, shares, matrix = drawn[:9]
    after = next(t for t in norms["data"] if t["name"] == "after")
    micro_g = (rests["norm_after"] - gravity) / 9.80665e-6
    np.testing.assert_allclose(after["y"], micro_g, rtol=1e-5)
    light = next(t for t in over_time["data"] if t["name"] == "weighted down")
    middle = (rests["start"][11] + rests["end"][11]) / 2
    np.testing.assert_allclose([light["x"], light["y"]], [[middle], [4.1]], rtol=1e-5)
    assert light["customdata"] == [[12, 0.42]]
    along_y = [t for t in over_up["data"] if t["xaxis"] == "x2" and t["name"] == "used in full"]
    full = rests["weight"] == 1
    np.testing.assert_allclose(along_y[0]["x"], rests["up_y"][full], rtol=1e-5)
    error = (rests["norm_after"] - gravity) / rests["norm_sd"]
    np.testing.assert_allclose(along_y[0]["y"], error[full], rtol=1e-5)
    turned = np.rad2deg(result.tables["turns"]["angle"])
    np.testing.assert_allclose(over_angle["data"][0]["x"], turned, rtol=1e-5)
    sphere = next(t for t in ball["data"] if t.get("name") == "visited")
    np.testing.assert_allclose(sphere["z"], rests["up_z"], rtol=1e-5)
    np.testing.assert_allclose(np.sum([t["x"] for t in shares["data"]], axis=0), 100, rtol=1e-5)
    sd, cov = result.coefficients.sd, result.coefficients.cov
    np.testing.assert_allclose(matrix["data"][0]["z"], cov / np.outer(sd, sd), atol=5.1e-4)


def test_the_map_keeps_area_and_halves(page):
    result = make_result()
    rests = result.tables["rests"]
    flat = figures(page)[6]["data"]
    upper, lower = (
        next(t for t in flat if t["name"] == "visited" and t["xaxis"] == a) for a in ("x", "x2")
    )
    assert len(upper["x"]) == np.sum(rests["up_z"] >= 0)
    assert len(upper["x"]) + len(lower["x"]) == 24
    for half, pick in ((upper, rests["up_z"] >= 0), (lower, rests["up_z"] < 0)):
        radius = np.hypot(half["x"], half["y"])
        np.testing.assert_allclose(radius**2, 1 - np.abs(rests["up_z"][pick]), atol=1e-5)


def test_rebuilt_from_the_folder_it_is_the_same(folder):
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    assert report.write(folder) == folder / "report.html"
    assert (folder / "report.html").read_bytes() == before


def test_sections_without_their_table_are_left_out():
    bare = make_result(
        tables={}, diagnostics={}, checks=(), findings=(), site={}, provenance={}, instrument={}
    )
    titles = [s.title for s in sections(bare)]
    assert titles == ["Coefficients", "Correlation", "How to apply it", "Provenance"]
    assert report.html(bare).startswith("<!doctype html>")


@pytest.mark.parametrize("place", [place for place, needs in SECTIONS.items() if needs])
def test_a_section_is_left_out_without_any_of_what_it_needs(place, monkeypatch):
    """Whatever it needs, it is not even asked."""
    result = make_result()
    needs = SECTIONS[place].split()
    tables = {n.rpartition(":")[0] or n: {n.rpartition(":")[2]: np.ones(1)} for n in needs}
    known = {n: {"any": 1} for n in needs if ":" not in n}
    full = dataclasses.replace(result, tables=tables | {"navigation": {"x": np.ones(1)}},
                               procedure=needs[0], diagnostics=known)  # fmt: skip
    module, _, name = place.partition(".")
    asked = []
    monkeypatch.setattr(f"foucault.report.{module}.{name}", asked.append)
    monkeypatch.setattr("foucault.report.calibration.SECTIONS", {place: SECTIONS[place]})
    sections(full)
    assert asked == [full]
    bare = dataclasses.replace(full, tables={}, diagnostics={}, procedure="none")
    sections(bare)
    assert asked == [full]


def test_a_result_that_failed_can_still_be_shown(tmp_path):
    base = make_result(level=Level.UNUSABLE)
    n = len(base.coefficients)
    lost = CoefficientVector(base.coefficients.layout, np.full(n, np.nan), np.full((n, n), np.nan))
    tables = {
        name: {c: np.full(len(v), np.nan) if v.dtype == float else v for c, v in table.items()}
        for name, table in base.tables.items()
    }
    failed = dataclasses.replace(base, coefficients=lost, tables=tables, status=Status.NOT_FINITE)
    save(failed, tmp_path)
    text = text_of(report.write(tmp_path).read_text(encoding="utf-8"))
    assert "accel.bias.x" in text and "unknown" in text
    assert "met a number that is not finite" in text


def test_words_of_the_user_cannot_break_the_page():
    evil = "</script><script>alert(1)</script>"
    page = report.html(
        make_result(
            instrument={"name": evil},
            diagnostics={"coverage": {"missing": [{"direction": [0, 0, 1], "words": evil}]}},
        )
    )
    assert "<script>alert" not in page
    drawn = [json.dumps(f) for f in figures(page)]
    assert any("&lt;/script>&lt;script>alert(1)" in f for f in drawn)  # shown, not obeyed
    assert not any(evil in f for f in drawn)


def test_a_document_says_in_json_what_the_page_says(page):
    said = report.of_result(make_result()).as_dict()
    again = json.loads(json.dumps(said, allow_nan=False))
    titles = re.findall(r"<h2 id=[^>]*>(.*?)</h2>", page)
    assert [section["title"] for section in again["sections"]] == titles
    assert again["heading"]["word"] == "Pass" and again["heading"]["state"] == "good"
    blocks = [block for section in again["sections"] for block in section["blocks"]]
    drawn = [
        {"data": [*seen(Figure(block["data"], block["layout"])).data], "layout": block["layout"]}
        for block in blocks
        if block["kind"] == "figure"
    ]
    assert drawn == figures(page)
    text = text_of(page)
    cells = {c for b in blocks if b["kind"] == "table" for row in b["rows"] for c in row}
    assert all(c in text for c in cells if re.fullmatch(r"[\w ]{6,}", c) and "_" not in c)


@pytest.mark.parametrize("name", ["words.toml", "figures.toml"])
def test_nothing_is_kept_that_is_not_shown(name):
    folder = Path(report.__file__).parent
    source = "".join(file.read_text(encoding="utf-8") for file in folder.glob("*.py"))
    held = tomllib.loads((folder / name).read_text(encoding="utf-8"))
    keys = [f"{module}.{key}" for module, some in held.items() if module != "basis" for key in some]
    assert keys and not [key for key in keys if f'"{key}' not in source]


def test_no_result_no_report(tmp_path):
    with pytest.raises(FoucaultError, match=r"holds no result\.json"):
        report.write(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_a_report_compiles_nothing(folder):
    code = (
        "import sys\n"
        "from foucault.report import write\n"
        f"write({str(folder)!r})\n"
        "print('numba' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
