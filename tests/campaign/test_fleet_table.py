"""A fleet as one table: the same outcomes as with a folder for each instrument."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from test_fleet_campaign import bench, columns, rows_of, spoil

from foucault.campaign import bench as as_columns
from foucault.campaign import fleet
from foucault.report.fleet import document
from refusals import refuses

DECLARED = '[noise]\ngrade = "mems"\n'


def odd(data) -> None:
    """Spoil instruments in ways that are found in the readings alone, or in the table alone."""
    for name in data:
        data[name] = data[name].copy()

    def change(serial, name, row, by):
        data[name][rows_of(data, serial)[row]] += by

    for name in ("accel_x", "accel_y", "accel_z"):  # noisy
        data[name][rows_of(data, "SN003")[4]] *= 1.01
    change("SN004", "accel_z", 2, np.nan)
    for name in data:  # two positions measured in another order
        rows = rows_of(data, "SN005")[[0, 1]]
        if name not in ("time", "serial"):
            data[name][rows] = data[name][rows[::-1]]
    for name in ("accel_x", "accel_y", "accel_z"):  # where it was told to be, it was not
        rows = rows_of(data, "SN006")[[0, 2]]
        data[name][rows] = data[name][rows[::-1]]
    data["accel_y"][rows_of(data, "SN007")] = 9.0  # does not respond
    for name in ("gyro_x", "gyro_y", "gyro_z"):
        data[name][rows_of(data, "SN008")] *= 57.3  # another unit
    change("SN009", "averaged", 3, -10.0)


def less(data):
    odd(data)
    keep = np.ones(len(data["time"]), bool)
    keep[rows_of(data, "SN010")[5]] = False
    return {name: values[keep] for name, values in data.items()}


def mixed(data):
    order = np.random.default_rng(2).permutation(len(data["time"]))
    return {name: values[order[np.argsort(data["time"][order])]] for name, values in data.items()}


def told(folder) -> dict[str, dict[str, object]]:
    saved = columns(folder / "fleet.parquet")
    return {s: {n: v[i] for n, v in saved.items()} for i, s in enumerate(saved["serial"])}


@pytest.mark.parametrize("change", [
    pytest.param(less, id="spoiled", marks=pytest.mark.thorough),
    pytest.param(mixed, id="rows mixed"),
])  # fmt: skip
def test_the_table_is_that_of_the_folders(tmp_path, change) -> None:
    described = bench(tmp_path / "bench", 14, extra=DECLARED)
    spoil(tmp_path / "bench", change)
    whole = fleet.run(described, tmp_path / "whole")
    table = fleet.run(described, tmp_path / "table", table_only=True)
    assert table.counts() == whole.counts()
    found = whole.counts()
    assert (found["broken"] >= 4) == (found["doubtful"] >= 1) == (change is less)
    assert not (tmp_path / "table" / "instruments").exists()
    one, other = told(tmp_path / "whole"), told(tmp_path / "table")
    assert one.keys() == other.keys()
    for serial, said in one.items():
        for name, value in said.items():
            found = other[serial][name]
            if name == "folder":
                assert found == ""
            elif isinstance(value, float) and np.isfinite(value):
                assert found == pytest.approx(value, rel=1e-12), (serial, name)
            else:
                assert found == value or (value != value and found != found), (serial, name)


def test_those_that_are_alike_are_never_read_alone(tmp_path, monkeypatch) -> None:
    described = bench(tmp_path / "bench", 30)
    read = []
    own = as_columns.arranged

    def watched(many, alone):
        return own(many, lambda serial, log: read.append(serial) or alone(serial, log))

    monkeypatch.setattr(as_columns, "arranged", watched)
    table = fleet.run(described, tmp_path / "out", table_only=True)
    assert read == ["SN001"] and table.counts()["pass"] == 30


@pytest.mark.thorough
def test_a_table_is_read_back_and_has_its_page(tmp_path) -> None:
    described = bench(tmp_path / "bench", 12, extra=DECLARED)
    spoil(tmp_path / "bench", less)
    table = fleet.run(described, tmp_path / "out", table_only=True, workers=1)
    fleet.run(described, tmp_path / "four", table_only=True, workers=4)
    one, four = ((tmp_path / name / "fleet.parquet").read_bytes() for name in ("out", "four"))
    assert one == four
    again, about = fleet.load(tmp_path / "out")
    assert again.counts() == table.counts() and about["instruments"] == 12
    np.testing.assert_array_equal(again.values, table.values)
    assert next(r.reasons[:1] for r in again.rows if r.serial == "SN003")
    assert document(again, about).sections


def test_a_table_beside_folders_is_refused(tmp_path) -> None:
    described = bench(tmp_path / "bench", 10, extra=DECLARED)
    fleet.run(described, tmp_path / "out")
    with refuses("fleet.folders", "leave out `--table-only`"):
        fleet.run(described, tmp_path / "out", table_only=True)
    with refuses("fleet.no_reports", "Leave out `--reports`"):
        fleet.run(described, tmp_path / "new", table_only=True, report=lambda folder: folder)


def test_one_by_one_without_folders_too(tmp_path) -> None:
    described = bench(tmp_path / "bench", 3, procedure='[procedure]\nname = "norm_observation"\n')
    table = fleet.run(described, tmp_path / "out", table_only=True)
    assert len(table) == 3 and not (tmp_path / "out" / "instruments").exists()
    assert [r.folder for r in table.rows] == ["", "", ""]


def test_a_fleet_that_was_calibrated_again_and_cut_short_is_not_mixed(tmp_path) -> None:
    described = bench(tmp_path / "bench", 3)
    fleet.run(described, tmp_path / "out")
    assert len(fleet.load(tmp_path / "out")[0]) == 3
    heavier = dataclasses.replace(described.site, gravity=1.0001 * described.site.gravity)
    fleet.run(dataclasses.replace(described, site=heavier), tmp_path / "again")
    where = Path("instruments/SN002")
    shutil.rmtree(tmp_path / "out" / where)
    shutil.copytree(tmp_path / "again" / where, tmp_path / "out" / where)
    with refuses("fleet.mixed", "SN002 than the table"):
        fleet.load(tmp_path / "out")
