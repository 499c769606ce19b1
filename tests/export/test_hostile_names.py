"""Whatever a person writes stays a name: no target runs, computes or draws anything of it."""

from __future__ import annotations

import ast
import csv
import json
import shutil
import subprocess
import sys
import tokenize
import tomllib
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest

from foucault import escape
from foucault.campaign.tables import dotted
from foucault.campaign.writing import _text
from foucault.export import write
from foucault.export.request import FAMILIES as CAN
from foucault.export.syntax import SYNTAXES
from foucault.export.table import found_in, receivers
from foucault.logs.description import LogDescription
from foucault.models.cluster import LAYOUT as CLUSTER
from foucault.plans.sequence_file import parse_sequence, write_steps
from foucault.report import html
from foucault.result import Result
from make_result import make_result
from make_terms import LOUD, with_terms

HOSTILE = (
    "*/ int evil(void){return 1;} /*",
    "/* */ *\\\n/ int evil;",
    "*??/\n/ int evil;",
    "x\nopen('evil', 'w')",
    "x\ropen('evil', 'w')",
    "x\x0copen('evil', 'w')",
    "x\x85open('evil', 'w')",
    "x\u2028open('evil', 'w')",
    "coding: utf-7 +AAo-open('evil', 'w')",
    "-*- coding=utf-7 -*-",
    '"""\nopen("evil", "w")\n"""',
    "</script><script>evil()</script>",
    "<img src=x onerror=evil()>",
    "SN1\tjavascript:evil()",
    '" onmouseover="evil()',
    '<a href="javascript:evil()">SN</a>',
    "{{ 7 * 7 }}{% raw %}",
    "`<b>",
    "=HYPERLINK(\"http://evil\")",
    "a,=cmd|' /C calc'!A0",
    'a,"=1+1"',
    "+1+cmd|x",
    "-1+cmd|x",
    "@SUM(1)",
    "\t=1+1",
    "evil: true\n- evil",
    'x"\n[evil]\ny = "',
    "\x1b]0;evil\x07\x1b[2J",
    "\u202eevil\u202c",
    "\x00",
    "${IFS}$(touch evil)`touch evil`; touch evil",
    "%{x}<extra>evil</extra>",
    "",
)  # fmt: skip


def hostile_result(name: str, result: Result) -> Result:
    """Put `name` wherever a person can write."""
    about = dict.fromkeys(("name", "serial", "operator", "due", "note", "more"), name)
    verdict = replace(result.verdict, reasons=(name,))
    made = result.provenance | {
        "created": name, "inputs": [{"file": name}], "campaign": name,
        "versions": {"foucault": name},
    }  # fmt: skip
    return replace(
        result, instrument=about, provenance=made, verdict=verdict, procedure=name, equation=name,
        gauge=name, frame=name, site=result.site | {"gravity_source": name},
    )  # fmt: skip


def counted(name: str) -> LogDescription:
    """Return a log in counts whose columns are called so."""
    block = {"columns": [name + "1", name + "2", name + "3"], "unit": "count"}
    return LogDescription.model_validate({
        "file": "log.csv", "rate": "100 Hz",
        "accel": block | {"scale": "415 count/(m/s^2)"},
        "gyro": block | {"scale": "4778 count/(rad/s)"},
    })  # fmt: skip


@cache
def known(receiver: str) -> Result:
    """Return a result with what a receiver takes."""
    own = receivers().get(receiver)
    return with_terms(*(CAN if own is None else own.takes or ("accel.bias",)))


def written(receiver: str, name: str, path: Path) -> Path:
    result = hostile_result(name, known(receiver))
    return write(result, receiver, path, log=counted(name), noise=LOUD)


def names_in(code: str) -> set[str]:
    """Return the functions and names that a module holds."""
    return {
        getattr(node, "name", None) or getattr(node, "id", None) or ""
        for node in ast.walk(ast.parse(code))
    }


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_c(tmp_path: Path) -> None:
    headers = [str(written("c", name, tmp_path / f"{k}.h")) for k, name in enumerate(HOSTILE)]
    gcc = ["gcc", "-E", "-P", "-std=c99", "-x", "c", *headers]
    done = subprocess.run(gcc, capture_output=True, text=True, check=True)
    assert "compensate" in done.stdout and "evil" not in done.stdout
    done = subprocess.run(
        ["gcc", "-std=c99", "-Wall", "-Werror", "-Wno-unused", "-fsyntax-only", "-x", "c",
         *headers], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_python(tmp_path: Path) -> None:
    plain = names_in(written("python", "plain", tmp_path / "plain.py").read_text())
    for name in HOSTILE:
        module = written("python", name, tmp_path / "calibration.py")
        with module.open("rb") as stream:
            assert tokenize.detect_encoding(stream.readline)[0] == "utf-8", name
        assert names_in(module.read_text()) == plain, name


@pytest.mark.thorough
def test_python_runs_nothing(tmp_path: Path) -> None:
    for k, name in enumerate(HOSTILE):
        written("python", name, tmp_path / f"m{k}.py")
    program = (
        "import sys, importlib, pathlib\n"
        "def hook(event, args):\n"
        "    bad = event == 'open' and 'evil' in str(args[0])\n"
        "    if bad or event.startswith(('os.system', 'subprocess')): raise SystemExit(event)\n"
        "sys.addaudithook(hook)\n"
        f"for k in range({len(HOSTILE)}):\n"
        "    module = importlib.import_module(f'm{k}')\n"
        "    assert not hasattr(module, 'evil')\n"
        "    f, w = module.compensate([0.0] * 3, [0.0] * 3)\n"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path[:0] = ['.']\n{program}"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "evil").exists()


@pytest.mark.parametrize("receiver", ["kalibr", "ros2", "lio-sam", "kf-gins"])
def test_yaml(receiver: str, tmp_path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    want = yaml.safe_load(written(receiver, "plain", tmp_path / "plain.yaml").read_text("utf-8"))
    for name in HOSTILE:
        got = yaml.safe_load(written(receiver, name, tmp_path / "out.yaml").read_text("utf-8"))
        assert got == want, name


@pytest.mark.parametrize("receiver", ["json", "imucal", "basalt"])
def test_json(receiver: str, tmp_path: Path) -> None:
    want = json.loads(written(receiver, "plain", tmp_path / "plain.json").read_text("utf-8"))
    for name in HOSTILE:
        got = json.loads(written(receiver, name, tmp_path / "out.json").read_text("utf-8"))
        assert got.keys() == want.keys(), name


def test_px4(tmp_path: Path) -> None:
    for name in HOSTILE:
        lines = written("px4", name, tmp_path / "out").read_text("utf-8").splitlines()
        assert all(line.startswith(("#", "param set CAL_", "param save")) for line in lines), name


OTHERS = {
    "msckf-vio": ("<!--", "<launch>", "  <param name=", "</launch>"),
    "rovio": (";", "Prediction", "  PredictionNoise", "{", "}", "  {", "  }", "    "),
    "ardupilot": ("#", "INS_"),
    "gtsam-cpp": ("//", "#pragma once", "#include <gtsam", "inline auto", "  ", "}"),
    "psins": ("%", *(f"{key} = " for key in (
        "eb", "db", "web", "wdb", "sqrtR0G", "TauG", "sqrtR0A", "TauA", "dKGii", "dKAii", "dKGij",
        "dKAij", "imuerr"))),
    "gtsam": ("#", "import numpy", "from gtsam import", "params", "if hasattr", "    params"),
    "vins-mono": ("%YAML:1.0", "#", "acc_", "gyr_", "g_norm"),
}  # fmt: skip


@pytest.mark.parametrize("receiver", list(OTHERS))
def test_other_receivers(receiver: str, tmp_path: Path) -> None:
    """Nothing begins a line but a comment and what the writer means, and nothing is read else."""
    own = receivers()[receiver]
    plain = found_in(own, written(receiver, "plain", tmp_path / "plain").read_text("utf-8"))
    assert plain
    for name in HOSTILE:
        text = written(receiver, name, tmp_path / "out").read_text("utf-8")
        assert all(line.startswith(OTHERS[receiver]) for line in text.splitlines() if line), name
        assert found_in(own, text) == plain, name
        if receiver == "msckf-vio":
            import xml.etree.ElementTree as ET

            assert "--" not in text.replace("<!--", "").replace("-->", ""), name
            ET.fromstring(text.partition("<launch>")[1] + text.partition("<launch>")[2])
        if receiver == "gtsam-cpp":
            assert not [line for line in text.splitlines() if line.endswith("\\")], name


def formulas(path: Path) -> list[str]:
    """Return the cells that a spreadsheet would compute, whatever it takes to part them."""
    out = []
    for part in ",;\t":
        for row in csv.reader(path.read_text("utf-8").splitlines(), delimiter=part):
            for cell in row:
                try:
                    float(cell)
                except ValueError:
                    cell = cell.strip().strip("'\"" if cell.startswith('"') else "")
                    out += [cell] if cell.startswith(("=", "+", "-", "@")) else []
    return out


def test_csv(tmp_path: Path) -> None:
    for name in HOSTILE:
        path = written("csv", name, tmp_path / "out.csv")
        assert formulas(path) == [], name
        lines = path.read_text("utf-8").splitlines()
        assert not [line for line in lines if line.startswith("evil")], name


@pytest.mark.parametrize("receiver", ["c", "python", "json"])
def test_cluster(receiver: str, tmp_path: Path) -> None:
    from foucault.coefficients import CoefficientVector

    vector = CoefficientVector.zeros(CLUSTER)
    plain = replace(make_result(), coefficients=vector, tables={})
    for name in HOSTILE:
        result = hostile_result(name, plain)
        text = write(result, receiver, tmp_path / "out").read_text("utf-8")
        if receiver == "json":
            json.loads(text)
        elif receiver == "python":
            assert "evil" not in names_in(text), name
        else:
            assert text.count("/*") == text.count("*/"), name


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_toml(name: str, tmp_path: Path) -> None:
    value = {name: [name, {name: name}]}
    text = "\n".join(f"{dotted((k,))} = {_text(v)}" for k, v in value.items())
    assert tomllib.loads(text) == value
    plain = parse_sequence(SEQUENCE)
    first = replace(plain.actions[0], label=name)
    sequence = replace(plain, name=name, actions=(first, *plain.actions[1:]))
    write_steps(sequence, tmp_path / "plan.toml")
    again = tomllib.loads((tmp_path / "plan.toml").read_text("utf-8"))
    assert again["name"] == name
    assert again["action"][0].get("label", "") == name
    write_steps(sequence, tmp_path / "plan.csv")
    # Where an axis points is our own word, and reads again as it is.
    assert set(formulas(tmp_path / "plan.csv")) <= {"-E", "-N", "-U"}
    assert tomllib.loads(escape.commented([name], "#")) == {}


SEQUENCE = """
name = "short"
start = ["up", "east", "north"]
[[action]]
rest = "2 min"
label = "first"
[[action]]
turn = "-90 deg"
about = "y"
rate = "20 deg/s"
"""


class Tags(HTMLParser):
    """What a page is made of: elements with the names of their attributes, and its links."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.seen: list[tuple[str, tuple[str, ...]]] = []
        self.links: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, tuple(name for name, _ in attrs)))
        self.links += [value or "" for name, value in attrs if name in ("href", "src")]


@cache
def plain_tags() -> set[str]:
    return {tag for tag, _ in Tags(html(make_result())).seen}


@pytest.mark.parametrize("name", [name for name in HOSTILE if set(name) & set('<>"{`')])
def test_page(name: str) -> None:
    page = html(hostile_result(name, make_result()))
    tags = Tags(page)
    assert {tag for tag, _ in tags.seen} <= plain_tags() | {"code", "sub", "sup", "b", "i"}
    assert not [a for _, attrs in tags.seen for a in attrs if a.startswith("on")]
    assert all(link.startswith("#s") for link in tags.links)


def test_screen_and_figures_and_links() -> None:
    for name in HOSTILE:
        assert not set(escape.screen(name)) & {"\x1b", "\x07", "\x00", "\r", "\x85"}, name
        drawn = str(escape.figure({"data": [{"y": [name], "name": name}]}))
        assert not [tag for tag in ("<a", "<img", "<script") if tag in drawn], name
        assert not escape.address(name).startswith("/"), name
        assert not set(escape.address(name)) & set(':\\"<>\t'), name
        assert json.loads(escape.json_remark({"name": name})) == {"name": name}


def test_texts_that_harm_nobody_stay_as_they_are() -> None:
    for text in ("MTi-28 no. 0180-2214", "a = b - c, (-1.5, -2e-3) m/s^2", "Müller & Söhne, 北"):
        assert escape.c_comment(text) == escape.hash_comment(text) == text
        assert escape.csv_comment(text) == text
        assert escape.csv_cell(text) == escape.screen(text) == text
    assert escape.csv_cell("-30.5") == "-30.5"
    assert {receivers()[name].syntax for name in receivers()} == set(SYNTAXES)
