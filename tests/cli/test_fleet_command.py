"""The command fleet: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from commands import run


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    made = run("simulate", "norm_observation", "-o", tmp_path, "--instruments", 10, "--seed", 4)
    assert made.exit_code == 0 and "10 instruments in 24 positions" in made.output
    file = tmp_path / "campaign.toml"
    text = file.read_text()
    assert 'serial = "serial"' in text and "seed = 4" in text
    file.write_text(text.replace('solution = "likelihood"', 'solution = "linear"'))
    return file


@pytest.mark.thorough
def test_all_pass(bench: Path, tmp_path: Path) -> None:
    result = run("fleet", bench, "-o", tmp_path / "out", "--reports", code=0)
    assert "10 of 10 instruments have a result, 10 solved in one batch." in result.output
    page = (tmp_path / "out" / "report.html").read_text()
    assert 'href="instruments/SN010/report.html"' in page
    assert (tmp_path / "out" / "instruments" / "SN010" / "report.html").is_file()


@pytest.mark.thorough
def test_json_with_a_tolerance_and_a_broken_instrument(bench: Path, tmp_path: Path) -> None:
    means = tmp_path / "means.parquet"
    table = pq.read_table(means)
    keep = pc.invert(pc.and_(pc.equal(table["serial"], "SN006"), pc.equal(table["position"], 2)))
    pq.write_table(pa.table(table.filter(keep)), means)
    limits = tmp_path / "limits.toml"
    limits.write_text('"accel.bias" = "500 mg"\n')
    result = run("fleet", bench, "-o", tmp_path / "out", "--tolerance", limits, "--json", code=3)
    said = json.loads(result.stdout)
    assert said["counts"] == {"pass": 9, "fail": 0, "undecided": 0, "broken": 1}
    assert said["broken"][0]["serial"] == "SN006"
    assert said["broken"][0]["code"] == "fleet.positions"
    assert Path(said["report"]).is_file() and said["tolerance"]["file"] == "limits.toml"
    shown = run("fleet", bench, "-o", tmp_path / "out", code=3)
    assert "SN006: Its readings are not in the positions" in shown.output


@pytest.mark.thorough
def test_its_page_is_made_again_from_the_folder_alone(bench: Path, tmp_path: Path) -> None:
    means, out = tmp_path / "means.parquet", tmp_path / "out"
    table = pq.read_table(means)
    keep = pc.invert(pc.and_(pc.equal(table["serial"], "SN006"), pc.equal(table["position"], 2)))
    pq.write_table(pa.table(table.filter(keep)), means)
    limits = tmp_path / "limits.toml"
    limits.write_text('"accel.bias" = "5 mg"\n"gyro.scale.x" = { limit = "1 %", sd = "1 ppm" }\n')
    run("fleet", bench, "-o", out, "--tolerance", limits)
    before = (out / "report.html").read_text()
    assert "1 broken" in before and "undecided" in before
    for given in (out / "report.html", bench, means, limits):
        given.unlink()
    assert run("report", out).exit_code == 0
    assert (out / "report.html").read_text() == before
    # A report of one instrument, made later, is linked.
    assert run("report", out / "instruments" / "SN003").exit_code == 0
    assert run("report", out).exit_code == 0
    assert 'href="instruments/SN003/report.html"' in (out / "report.html").read_text()
    (out / "fleet.parquet").write_bytes(b"")
    again = run("report", out)
    assert again.exit_code == 1 and "fleet.parquet" in again.output
    assert (out / "report.html").is_file()


def test_a_wrong_tolerance_ends_before_the_work(bench: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text('"accel.bais" = "5 mg"\n')
    result = run("fleet", bench, "-o", tmp_path / "out", "--tolerance", limits)
    assert result.exit_code == 1 and not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_any_number_of_threads_finds_the_same(tmp_path: Path) -> None:
    run("simulate", "norm_observation", "-o", tmp_path, "--instruments", 3, "--seed", 4)
    made = []  # one by one, as the solution of the template is: a batch is not divided
    for workers in (1, 3):
        out = tmp_path / str(workers)
        run("fleet", tmp_path / "campaign.toml", "-o", out, "--workers", workers)
        made.append(pq.read_table(out / "fleet.parquet"))
    assert made[0].equals(made[1]) and len(made[0]) == 3


def test_a_table_only(bench: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("fleet", bench, "-o", out, "--table-only")
    assert "solved in one batch" in result.output
    assert sorted(p.name for p in out.iterdir()) == [
        "campaign.toml", "fleet.json", "fleet.parquet", "report.html",
    ]  # fmt: skip
    page = (out / "report.html").read_text(encoding="utf-8")
    run("report", out)
    assert (out / "report.html").read_text(encoding="utf-8") == page
