"""An accelerometer worn for days: its rests, and what they are worth."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

from foucault import campaign
from foucault.campaign import running
from foucault.detect import worn
from foucault.logs import LogDescription
from foucault.logs.follow import OnDisk
from refusals import refuses

RATE, G = 50, 9.80665
TRUE = {"accel.bias.x": 0.3, "accel.bias.y": -0.2, "accel.bias.z": 0.4,
        "accel.scale.x": 0.012, "accel.scale.y": -0.008, "accel.scale.z": 0.015}  # fmt: skip
TABLE = {
    "file": "log.parquet", "time": {"column": "time", "unit": "s"},
    "accel": {"columns": ["x", "y", "z"], "unit": "m/s^2"},
}  # fmt: skip


def worn_log(folder, ups, *, rest=60.0, between=20.0, shake=1.5, suffix="parquet", seed=4):
    """Write a log of rests with `ups` (k, 3) as up, moves between; return when each rest began."""
    rng = np.random.default_rng(seed)
    parts, begun, rows = [], [], 0
    for up in ups:
        k, m = int(rest * RATE), int(between * RATE)
        begun.append(rows / RATE)
        still = np.tile(np.asarray(up) / np.linalg.norm(up) * G, (k, 1))
        parts += [still, np.array([0, 0, G]) + rng.normal(0, shake, (m, 3))]
        rows += k + m
    f = np.concatenate(parts)
    scale = np.diag([1 + TRUE[f"accel.scale.{a}"] for a in "xyz"])
    f = f @ scale + [TRUE[f"accel.bias.{a}"] for a in "xyz"] + rng.normal(0, 0.03, f.shape)
    time = np.round(np.arange(rows) / RATE, 2)
    table = pa.table({"time": time, **{a: f[:, i] for i, a in enumerate("xyz")}})
    if suffix == "parquet":
        pq.write_table(table, folder / "log.parquet")
    else:
        with pa.CompressedOutputStream(folder / "log.csv.gz", "gzip") as stream:
            csv.write_csv(table, stream)
    return np.array(begun)


def everywhere(n=40, seed=1):
    return np.random.default_rng(seed).normal(size=(n, 3))


def on_disk(folder, file="log.parquet"):
    return OnDisk(LogDescription.model_validate(TABLE | {"file": file}), folder)


def test_each_rest_is_found_once_where_it_was(tmp_path):
    begun = worn_log(tmp_path, everywhere(12))
    found = worn.rests(on_disk(tmp_path))
    assert len(found) == 12 and found.gyro is None
    assert (np.abs(found.time - begun) <= worn.WINDOW).all()
    assert (found.averaged >= 40.0).all() and (found.averaged <= 60.0).all()


def test_a_rest_that_goes_on_in_another_attitude_is_another(tmp_path):
    ups = everywhere(10)
    worn_log(tmp_path, ups, between=0.0)
    found = worn.rests(on_disk(tmp_path))
    assert len(found) == 10


def test_of_one_attitude_the_longest_few_are_kept(tmp_path):
    worn_log(tmp_path, [*np.tile([0.0, 0.0, 1.0], (9, 1)), [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = worn.rests(on_disk(tmp_path))
    assert len(found) == worn.OF_A_CELL + 2


def test_a_window_with_missing_samples_is_left_out(tmp_path):
    worn_log(tmp_path, everywhere(12))
    table = pq.read_table(tmp_path / "log.parquet")
    time = table["time"].to_numpy()
    hole = (time > 25.0) & (time < 40.0)
    pq.write_table(table.filter(pa.array(~hole)), tmp_path / "log.parquet")
    found = worn.rests(on_disk(tmp_path))
    first = found.time < 80.0
    assert first.sum() == 2 and found.averaged[first].sum() <= 40.0
    assert "log.gap" in [f.code for f in found.findings]


@pytest.mark.parametrize("suffix", ["parquet", pytest.param("csv.gz", marks=pytest.mark.thorough)])
def test_the_campaign_calibrates_it_block_by_block(tmp_path, monkeypatch, suffix):
    worn_log(tmp_path, everywhere(), suffix=suffix)
    monkeypatch.setattr(running, "STREAMED", 1)
    monkeypatch.setattr(running, "read_log", lambda *_: pytest.fail("it was read as a whole"))
    text = f"""
    [instrument]
    left_out = false
    [site]
    gravity = "{G} m/s^2"
    gravity_sd = "1e-6 m/s^2"
    [log]
    file = "log.{suffix}"
    time = {{ column = "time", unit = "s" }}
    accel = {{ columns = ["x", "y", "z"], unit = "m/s^2" }}
    [procedure]
    name = "hand_rotated"
    """
    result = running.calibrate(campaign.parse(text, tmp_path / "campaign.toml"))
    assert str(result.verdict.level) == "pass"
    c = result.coefficients
    z = [(c.value(n) - true) / c.sd[c.names.index(n)] for n, true in TRUE.items()]
    assert np.sum(np.square(z)) < 25.0  # chi-square of 6: once in 3000
    assert max(c.sd[c.names.index(f"accel.bias.{a}")] for a in "xyz") < 2e-3


def test_never_turned_is_told_and_nothing_is_calibrated(tmp_path):
    worn_log(tmp_path, np.array([0.1, 0.2, 1.0]) + 0.1 * everywhere(30))
    with refuses("worn.never_turned", "of one direction", "several of its sides"):
        worn.rests(on_disk(tmp_path))


def test_what_never_rests_is_told(tmp_path):
    worn_log(tmp_path, everywhere(10), rest=0.0, between=60.0)
    with refuses("worn.no_rest", "In no window of 10 s"):
        worn.rests(on_disk(tmp_path))
