"""The command plans: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault.errors import FoucaultError
from foucault.plans.directions import DIRECTIONS, named_angles, read_positions
from refusals import refuses


def test_all_plans_in_a_table() -> None:
    result = run("plans", code=0)
    lines = {line.strip()[:20].strip(): line for line in result.output.splitlines()}
    for name in DIRECTIONS:
        assert name[:20].strip() in lines
    assert "0.944" in lines["24 on great circles"] and "15" in lines["24 on great circles"]
    assert "but not which one it is" in lines["icosahedron 12"]
    assert "noticed and named" in lines["dodecahedron 20"]
    refused = "refused: accel.scale.x, accel.scale.y and accel.scale.z cannot be told apart"
    assert "singular" in lines["8 corners"] and refused in lines["8 corners"]
    assert "fibonacci N" in result.output


def test_all_plans_as_json() -> None:
    found = json.loads(run("--json", "plans", "--model", "accel quadratic").output)
    assert found["model"] == "accel quadratic"
    plans = {p["name"]: p for p in found["plans"]}
    assert list(plans) == [*DIRECTIONS, "fibonacci 24"]
    assert plans["12 edges"]["singular"] and plans["12 edges"]["log10_det"] is None
    assert plans["12 edges"]["sd"]["accel.bias.x"] is None
    assert plans["icosahedron 12"]["redundant"] == 0 and not plans["icosahedron 12"]["noticed"]
    assert plans["dodecahedron 20"]["named"]


def test_one_plan_and_its_file(tmp_path: Path) -> None:
    file = tmp_path / "angles.csv"
    result = run("plans", "ico12", "-o", file, code=0)
    for word in ("icosahedron 12: 12 positions, 12 equations for 9", "0.707 ppm", "211.717474",
                 "noticed from 8.3 times", str(file)):  # fmt: skip
        assert word in result.output
    lines = file.read_text().splitlines()
    assert lines[0] == "outer,middle,inner" and len(lines) == 13
    assert lines[1] == "30.000000000,0.000000000,-31.717474411"
    np.testing.assert_allclose(read_positions(file), named_angles("ico12"), rtol=0, atol=1e-11)
    again = json.loads(run("plans", file, "--json", "--model", "accel table").output)
    assert again["name"] == "angles.csv" and again["equations"] == 36
    np.testing.assert_allclose(again["angles"], named_angles("ico12"), rtol=0, atol=1e-11)
    assert "211.717474" not in run("plans", "ico12", "--no-angles").output


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["8 corners"], "accel.scale.x, accel.scale.y and accel.scale.z cannot be told apart"),
        (["6 faces"], "6 equations for 9 coefficients"),
        (["12 edges", "--model", "accel quadratic"], "do not determine all coefficients"),
        (["icosahedrn 12"], "Did you mean 'icosahedron 12'?"),
        (["--model", "acel"], "Did you mean 'accel'?"),
        (["-o", "file.csv"], "all plans are asked for"),
        (["nothing.csv"], "'nothing.csv' is not a list of positions: No such file"),
    ],
)
def test_mistakes_end_with_1_and_one_sentence(words: list[str], text: str) -> None:
    result = run("plans", *words, code=1)
    assert text in result.stderr and result.stderr.count("error:") == 1


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "first line is not"),
        ("a,b,c\n1,2,3\n", "first line is not"),
        ("outer,middle,inner\n", "no position"),
        ("outer,middle,inner\n1,2,3\n1,2\n", "line 3 is not three angles"),
        ("outer,middle,inner\n1,two,3\n", "line 2 is not three angles"),
        ("outer,middle,inner\n1,nan,3\n", "line 2 is not three angles"),
    ],
)
def test_files_that_are_no_positions(text: str, why: str, tmp_path: Path) -> None:
    file = tmp_path / "angles.csv"
    file.write_text(text)
    with refuses("plan.file", match=why):
        read_positions(file)


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    file = tmp_path / "angles.csv"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FoucaultError, match="its first line is not `outer,middle,inner`"):
        read_positions(file)


def test_poses_for_deflection(tmp_path):
    result = run("plans", "--model", "deflection", code=0)
    assert "icosahedral 6" in result.output and "1.658" in result.output
    assert "optimised 6" in result.output and "1.438" in result.output
    file = tmp_path / "poses.csv"
    result = run("plans", "--model", "deflection", "simple 6", "-o", str(file))
    assert result.exit_code == 0 and "-90.000000" in result.output
    assert file.read_text().splitlines()[0] == "about_z,about_east"
    found = json.loads(run("--json", "plans", "--model", "deflection", "simple 6").output)
    (only,) = found["poses"]
    assert only["condition"] == pytest.approx(7.05, abs=0.01) and len(only["sd"]) == 6
    assert run("plans", "--model", "deflection", "simple").exit_code == 1
    assert run("plans", "--model", "deflection", "-o", str(file)).exit_code == 1
