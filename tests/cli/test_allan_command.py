"""The command allan: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import campaign
from foucault.logs import write
from foucault.tables import Log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(1)
    n = 5000
    accel = 0.01 * rng.normal(size=(n, 3)) + [0.0, 0.0, 9.81]
    file = tmp_path_factory.mktemp("allan") / "static.parquet"
    write(Log(np.arange(n) / 100, 1e-3 * rng.normal(size=(n, 3)), accel), file)
    return file


def test_it_prints_a_table_and_writes_a_folder(log: Path, tmp_path: Path) -> None:
    result = run("allan", log, "-o", tmp_path / "noise", code=0)
    out = result.output
    for word in ("gyro.x", "Angle random walk", "accel.z", "velocity random walk", "N   B   K"):
        assert word in out
    assert out.count("Not seen, in a record that tells up to") == 1
    assert {p.name for p in (tmp_path / "noise").iterdir()} == {
        "report.html", "noise.toml", "allan.csv", "allan.json",
    }  # fmt: skip
    block = (tmp_path / "noise" / "noise.toml").read_text()
    noise = campaign.parse(campaign.template("hand_rotated") + "\n" + block).noise
    assert noise is not None
    assert noise.gyro.white == pytest.approx(1e-4, rel=0.05)
    assert noise.accel.white == pytest.approx(1e-3, rel=0.05)
    page = (tmp_path / "noise" / "report.html").read_text()
    assert page.count("Plotly.react") >= 1 and "[noise.gyro]" in page and "http-equiv" not in page
    assert ">Provenance</h2>" in page and "static.parquet" in page
    rows = (tmp_path / "noise" / "allan.csv").read_text().splitlines()
    assert rows[0].startswith("axis,kind,tau,deviation") and len(rows) == 1 + 6 * 11


def test_one_axis_of_another_kind_as_json(log: Path) -> None:
    result = run("--json", "allan", log, "--axis", "gyro.z", "--kind", "hadamard")
    found = json.loads(result.output)
    assert list(found["channels"]) == ["gyro.z"]
    channel = found["channels"]["gyro.z"]
    assert channel["kind"] == "hadamard"
    assert channel["noises"]["white"]["seen"] is True
    assert channel["deviation"][0] == pytest.approx(1e-3, rel=0.1)


def test_a_part_at_rest(log: Path) -> None:
    result = run("allan", log, "--axis", "x", "--rest", "10 s to 30 s")
    assert "At rest, 10.00 s to 30.00 s" in result.output


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--axis", "gyro.w"], "The log has no axis 'gyro.w'."),
        (["--kind", "modifed"], "is no kind of Allan variance. Did you mean 'modified'?"),
        (["--rest", "1 s to 2 s"], "There are 101 samples (1 s) at rest"),
    ],
)
def test_mistakes_end_with_1_and_one_sentence(log: Path, words: list[str], text: str) -> None:
    result = run("allan", log, *words, code=1)
    assert text in result.stderr and result.stderr.count("error:") == 1


def test_a_folder_that_cannot_be_written(log: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = run("allan", log, "--axis", "gyro.x", "-o", tmp_path / "file")
    assert result.exit_code == 1 and "cannot be written" in result.stderr


@pytest.mark.parametrize("command", ["allan", "inspect"])
def test_what_only_looks_at_a_log_needs_no_place(command: str, log: Path, tmp_path: Path) -> None:
    file = tmp_path / "described.toml"
    file.write_text(f'[log]\nfile = "{log}"\n')
    result = run(command, file, code=0)
    assert "samples" in result.output or "At rest, 0.00 s to 49.99 s" in result.output


COLUMNS = ['"rate"', '["rate"]', '["", "", "rate"]']


@pytest.mark.parametrize("columns", COLUMNS)
@pytest.mark.parametrize(
    ("triad", "unit", "white"), [("gyro", "rad/s", 1e-5), ("accel", "m/s^2", 1e-4)]
)
def test_a_log_of_one_axis_is_shown_as_this_axis_alone(
    triad: str, unit: str, white: float, columns: str, tmp_path: Path
) -> None:
    file = one_axis(tmp_path, triad, unit, columns, white)
    axis = "z" if "," in columns else "x"
    done = run("allan", file, "-o", tmp_path / "o", "--json", code=0)
    said = json.loads(done.stdout)
    ((name, seen),) = said["channels"].items()
    assert name == f"{triad}.{axis}" and len(seen["noises"]) == 5
    assert not [f for f in said["findings"] if f["severity"] != "note"]
    found = next(iter(n for n in seen["noises"].values() if n["seen"]))
    assert found["value"] == pytest.approx(white, rel=0.05)
    assert "on 1 of 1 axes" in (tmp_path / "o" / "noise.toml").read_text()
    done = run("inspect", file, "--json")
    mean = json.loads(done.stdout)[triad]["mean"]
    assert [x is None for x in mean] == [a != axis for a in "xyz"]


def one_axis(folder: Path, triad: str, unit: str, columns: str, white: float) -> Path:
    time = np.arange(20_000) * 0.01
    x = white / 0.1 * np.random.default_rng(1).normal(size=len(time))
    np.savetxt(folder / "one.csv", np.column_stack([time, x]), delimiter=",", header="time,rate",
               comments="")  # fmt: skip
    file = folder / "one.toml"
    file.write_text(
        '[site]\nlatitude = "48 deg"\n[procedure]\nname = "hand_rotated"\n'
        '[log]\nfile = "one.csv"\ntime = { column = "time", unit = "s" }\n'
        f'{triad} = {{ columns = {columns}, unit = "{unit}" }}\n'
    )
    return file


@pytest.mark.parametrize(
    ("title", "axis"),
    [("gyro_z (deg/s)", "gyro.z"), ("rate (deg/h)", "gyro.x"), ("acc_y [g]", "accel.y")],
)
def test_a_bare_log_of_one_axis_needs_no_description(title: str, axis: str, tmp_path: Path) -> None:
    x = np.random.default_rng(2).normal(size=2000)
    np.savetxt(tmp_path / "one.csv", np.column_stack([np.arange(2000) * 0.01, x]), delimiter=",",
               header=f"time (s),{title}", comments="")  # fmt: skip
    done = run("allan", tmp_path / "one.csv", "--json")
    assert done.exit_code == 0 and list(json.loads(done.stdout)["channels"]) == [axis]
    assert run("inspect", tmp_path / "one.csv", "--plots", tmp_path / "q.html").exit_code == 0


@pytest.mark.parametrize("command", ["calibrate", "align", "navigate", "preflight", "watch"])
def test_one_axis_is_refused_where_three_are_needed(command: str, tmp_path: Path) -> None:
    file = one_axis(tmp_path, "gyro", "rad/s", '["", "", "rate"]', 1e-5)
    out = ["-o", tmp_path / "o"] if command == "calibrate" else []
    done = run(command, file, *out)
    assert done.exit_code != 0
    said = " ".join(done.output.split())
    assert "[log.gyro] names a column for z only; x, y and z are needed." in said
    assert "`foucault allan` and `foucault inspect`" in said


def test_any_columns_with_a_unit_need_no_description(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    rows = rng.normal(0, 0.5, (3000, 4)) * [1.0, 1.0, 2.0, 3.0]
    file = tmp_path / "bench.csv"
    np.savetxt(file, rows, delimiter=",", header="drift,omega,tilt,q", comments="")
    both = ["--column", "omega", "--column", "2", "--unit", "deg/h", "--rate", "10 Hz"]
    found = json.loads(run("allan", file, *both, "--json").stdout)["channels"]
    assert list(found) == ["gyro.x", "gyro.y"]
    for name, sd in (("gyro.x", 0.5), ("gyro.y", 1.0)):  # white noise: its sd at one interval
        first = found[name]["deviation"][0]
        assert first == pytest.approx(np.radians(sd) / 3600, rel=0.05)
    found = json.loads(run("allan", file, "--column", "q", "--unit", "m/s", "--rate", "10 Hz",
                           "--json").stdout)  # fmt: skip
    assert list(found["channels"]) == ["accel.x"]
    assert found["channels"]["accel.x"]["deviation"][0] == pytest.approx(15.0, rel=0.1)


def test_the_time_column_says_the_rate_of_any_column(tmp_path: Path) -> None:
    rows = np.column_stack([np.arange(3000) * 20.0, np.random.default_rng(5).normal(size=3000)])
    file = tmp_path / "bench.csv"
    np.savetxt(file, rows, delimiter=",", header="time (ms),x9", comments="")
    found = json.loads(run("allan", file, "--column", "x9", "--unit", "mg", "--json").stdout)
    assert found["channels"]["accel.x"]["interval"] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--column", "a", "--unit", "deg/s"], "No column of 'bench.csv' is titled as time"),
        (["--rate", "100 Hz"], "--rate describes the columns of --column, and there is none"),
        (["--column", "a", "--unit", "kg", "--rate", "1 Hz"], "is no unit of a gyro or an"),
        (["--column", "a"] * 4 + ["--unit", "mg"], "4 columns were named with --column"),
    ],
)
def test_columns_that_cannot_be_read(words: list[str], text: str, tmp_path: Path) -> None:
    (tmp_path / "bench.csv").write_text("a,b\n1,2\n2,3\n")
    done = run("allan", tmp_path / "bench.csv", *words)
    assert done.exit_code == 1 and text in " ".join(done.output.split())
