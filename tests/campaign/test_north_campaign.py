"""Readings in, a survey out; its folder says the same when it is read back."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from foucault import run_folder
from foucault.campaign import north
from foucault.campaign.tables import Said
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.result import Level
from make_north import ACCEL_WHITE, GYRO_WHITE, LATITUDE, many, write_readings
from refusals import refuses

WHITE = {"gyro_noise": GYRO_WHITE, "accel_noise": ACCEL_WHITE}
SAID = Said(latitude=LATITUDE, **WHITE)


@pytest.fixture(scope="module")
def readings(tmp_path_factory):
    file = tmp_path_factory.mktemp("north") / "readings.csv"
    made = write_readings(file, many(8), reference=True)
    return file, made


@pytest.fixture(scope="module")
def survey(readings):
    return north.run(readings[0], SAID)


def test_headings_are_found_to_their_uncertainty(survey, readings):
    true = np.array([p.heading for p in readings[1].plan.setups])
    off = (survey.fixes.angles[:, 0] - true + np.pi) % (2 * np.pi) - np.pi
    z = off / survey.fixes.sd[:, 0]
    assert 1.34 < z @ z < 21.95  # chi-square of 8, 0.5 % on either side
    assert survey.provenance["settings"]["unknown_latitude"] is False
    assert survey.provenance["input"]["file"] == "readings.csv"


def test_the_folder_reads_back_what_was_saved(survey, tmp_path):
    saved = north.record(survey).save(tmp_path / "out")
    read = run_folder.read(tmp_path / "out", "north")
    assert read.about == json.loads(json.dumps(saved.about))
    assert read.about["schema"] == "foucault.north/1"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "dwells.parquet", "fixes.csv", "fixes.parquet", "north.json",
    ]  # fmt: skip
    for name, column in saved.tables["dwells"].items():
        np.testing.assert_array_equal(read.tables["dwells"][name], column)
    first = read.about["setups"][0]
    assert first["heading"]["value"] == survey.fixes.angles[0, 0]
    np.testing.assert_array_equal(first["covariance"], survey.fixes.cov[0])
    assert read.about["provenance"]["input"]["sha256"]


def test_the_budget_adds_up_to_the_variance(survey):
    for setup in north.record(survey).about["setups"]:
        for angle in ("heading", "pitch", "roll"):
            parts = [source[angle] for source in setup["budget"].values()]
            total = sum(v * abs(v) for v in parts)
            assert total == pytest.approx(setup[angle]["sd"] ** 2, rel=1e-3)


def test_the_tables_say_the_same_in_their_units(survey, tmp_path):
    north.record(survey).save(tmp_path)
    rows = list(csv.DictReader((tmp_path / "fixes.csv").read_text("utf-8").splitlines()))
    fixes = pq.read_table(tmp_path / "fixes.parquet")
    assert fixes.schema.field("heading_sd").metadata == {b"unit": b"rad"}
    said = np.array([float(r["heading (deg)"]) for r in rows])
    np.testing.assert_allclose(said, np.degrees(fixes["heading"].to_numpy()), atol=1e-6)
    np.testing.assert_allclose(
        fixes["covariance_heading_pitch"].to_numpy(), survey.fixes.cov[:, 1, 0], rtol=1e-12
    )
    assert [r["verdict"] for r in rows] == [str(v.level) for v in survey.verdicts]
    dwells = pq.read_table(tmp_path / "dwells.parquet")
    left = dwells["gyro"].to_numpy() - dwells["gyro_fit"].to_numpy()
    assert np.abs(left / dwells["gyro_sd"].to_numpy()).max() < 5
    assert dwells.num_rows == 64 and dwells["name"][63].as_py() == "M8"


def test_of_many_set_ups_the_worst_are_kept_with_their_evidence(survey, tmp_path, monkeypatch):
    from foucault.report.north import document

    every = north.record(survey)
    monkeypatch.setattr(north, "KEPT", 3)
    saved = north.record(survey).save(tmp_path / "out")
    about = saved.about
    assert about["of"]["setups"] == 8 and sum(about["of"]["verdicts"].values()) == 8
    names = [s["name"] for s in about["setups"]]
    rows = every.about["setups"]
    worst = sorted(rows, key=lambda s: (s["verdict"] == "pass", -s["heading"]["sd"]))[:3]
    assert names == [s["name"] for s in rows if s in worst]
    fixes = pq.read_table(tmp_path / "out" / "fixes.parquet")
    for name in ("heading", "heading_sd", "verdict", "measured"):
        assert fixes[name].to_pylist() == list(every.tables["fixes"][name])
    dwells = saved.tables["dwells"]
    assert list(dwells["name"]) == [n for n in every.tables["dwells"]["name"] if n in names]
    assert set(dwells["setup"]) == {0, 1, 2}  # of those that are kept
    page = document(run_folder.read(tmp_path / "out", "north"))
    assert page.heading.title == "North at 8 set-ups"
    lost = replace(survey.fixes, cov=np.full_like(survey.fixes.cov, np.nan))
    north.record(replace(survey, fixes=lost)).save(tmp_path / "lost")
    document(run_folder.read(tmp_path / "lost", "north"))  # no heading has an uncertainty


def test_the_levels_of_all_are_those_of_each(survey):
    order = list(Level)
    assert [order[k] for k in survey.levels] == [v.level for v in survey.verdicts]


def test_a_set_up_near_the_equator_tells_what_its_uncertainty_covers(tmp_path):
    write_readings(tmp_path / "r.csv", many(6, 8.0), latitude=np.radians(4.0))
    said = Said(gravity=9.79, **WHITE)
    survey = north.run(tmp_path / "r.csv", said, {"unknown_latitude": True})
    about = north.record(survey).save(tmp_path / "out").about
    lost = [s for s in about["setups"] if north.UNRESOLVED in s["budget"]]
    assert lost and len(lost) < 6
    fixes = pq.read_table(tmp_path / "out" / "fixes.parquet")
    part = fixes[f"heading_sd.{north.UNRESOLVED}"].to_numpy()
    assert np.isnan(part).sum() == 6 - len(lost)


def test_an_earlier_report_does_not_outlive_its_survey(survey, tmp_path):
    (tmp_path / "report.html").write_text("old")
    north.record(survey).save(tmp_path)
    assert not (tmp_path / "report.html").exists()


def refused(code, function, *words, **more):
    with refuses(code) as caught:
        function(*words, **more)
    return str(caught.value)


def test_a_folder_with_a_calibration_is_left_alone(survey, tmp_path):
    (tmp_path / "result.json").write_text("{}")
    text = refused("output.kind", north.record(survey).save, tmp_path)
    assert "already holds result.json" in text
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_a_folder_that_was_changed_is_refused(survey, tmp_path):
    north.record(survey).save(tmp_path)
    (tmp_path / "dwells.parquet").write_bytes(b"else")
    refused("result.table_changed", run_folder.read, tmp_path, "north")
    (tmp_path / "dwells.parquet").unlink()
    refused("result.table_missing", run_folder.read, tmp_path, "north")
    (tmp_path / "north.json").write_text('{"schema": "foucault.north/9"}')
    refused("result.schema", run_folder.read, tmp_path, "north")
    (tmp_path / "north.json").write_text("{")
    refused("result.not_json", run_folder.read, tmp_path, "north")


def test_what_is_missing_is_said(readings):
    file = readings[0]
    refused("north.fix_latitude", north.run, file, Said())
    unknown = {"unknown_latitude": True}
    text = refused("north.fix_gravity", north.run, file, Said(), unknown)
    assert '--gravity "9.81 m/s^2"' in text
    text = refused("north.noise_half", north.run, file, Said(**SAID.site, gyro_noise=GYRO_WHITE))
    assert "The noise of the gyro is given, that of the accelerometers is not." in text
    text = refused("north.noise_half", north.run, file, Said(**SAID.site, accel_noise=ACCEL_WHITE))
    assert "that of the gyro is not" in text
    refused("north.latitude", north.run, file, Said(latitude=np.radians(89.5)))


def test_noise_of_the_gyro_is_enough_without_accelerometers(tmp_path):
    write_readings(tmp_path / "r.csv", accel=None)
    said = Said(**SAID.site, gyro_noise=GYRO_WHITE)
    survey = north.run(tmp_path / "r.csv", said, {"level_sd": 1e-4})
    assert survey.noise == ImuNoise(TriadNoise(), TriadNoise(white=GYRO_WHITE))
    about = north.record(survey).about
    assert "tilt: level" in about["setups"][0]["budget"]
