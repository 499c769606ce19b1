"""Applying a result block by block: the same numbers, flat memory, and what is noticed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.export import Applied, calibrate_log
from foucault.logs import follow, read, write
from foucault.logs.description import LogDescription
from foucault.result import Level, Result
from foucault.run_folder import save
from foucault.tables import Log
from make_terms import with_terms
from refusals import refuses


def a_log(n: int = 1000, seed: int = 3, **changes: Any) -> Log:
    rng = np.random.default_rng(seed)
    accel = rng.normal((0, 0, 5), 3, (n, 3))
    log = Log(np.arange(n) / 100.0, rng.normal(0, 0.5, (n, 3)), accel, "rate",
              rng.uniform(290, 300, n))  # fmt: skip
    return replace(log, **changes)


def describe(name: str, **more: Any) -> LogDescription:
    return LogDescription.model_validate({"file": name, **more})


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a few hundred rows be many blocks."""
    from foucault.logs import formats, text

    for module in (follow, formats):
        monkeypatch.setattr(module, "BLOCK_ROWS", 300)
    monkeypatch.setattr(text, "BLOCK_BYTES", 1 << 13)


TEXT = {
    "time": {"column": 0, "unit": "s"},
    "gyro": {"columns": [1, 2, 3], "unit": "rad/s"},
    "accel": {"columns": [4, 5, 6], "unit": "m/s^2"},
}


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet", ".npz", ".bin", ".mat"])
@pytest.mark.usefixtures("small_blocks")
def test_blocks_are_the_log(suffix: str, tmp_path: Path) -> None:
    log, name = a_log(), f"log{suffix}"
    table = np.column_stack([log.time, log.gyro, log.accel])
    more: dict[str, Any] = {}
    if suffix == ".bin":
        table.astype("<f8").tofile(tmp_path / name)
        more = {**TEXT, "record": {"type": "float64", "columns": 7}}
    elif suffix == ".mat":
        from scipy.io import savemat

        savemat(tmp_path / name, {"data": table})
        more = {**TEXT, "variable": "data"}
    else:
        write(log, tmp_path / name)
    whole = read(describe(name, **more), tmp_path)
    parts = list(follow.blocks(describe(name, **more), tmp_path))
    assert len(parts) > 2
    for key in ("time", "gyro", "accel", "temperature"):
        want = getattr(whole, key)
        if want is not None:
            np.testing.assert_array_equal(np.concatenate([getattr(p, key) for p in parts]), want)


@pytest.mark.usefixtures("small_blocks")
def test_increments_and_files_side_by_side(tmp_path: Path) -> None:
    log = a_log()
    for name, block in (("g.txt", log.gyro), ("a.txt", log.accel)):
        np.savetxt(tmp_path / name, np.column_stack([log.time, block * 0.01]), fmt="%.17g")
    wanted = LogDescription.model_validate(
        {
            "time": {"column": 0, "unit": "s"},
            "gyro": {"file": "g.txt", "columns": [1, 2, 3], "unit": "rad", "kind": "increment"},
            "accel": {"file": "a.txt", "columns": [1, 2, 3], "unit": "m/s", "kind": "increment"},
        }
    )
    whole = read(wanted, tmp_path)
    parts = list(follow.blocks(wanted, tmp_path))
    assert len(parts) > 2
    np.testing.assert_array_equal(np.concatenate([p.gyro for p in parts]), whole.gyro)
    alone = wanted.model_copy(update={"accel": None})
    parts = list(follow.blocks(alone, tmp_path))
    assert len(parts) > 2
    # The nominal interval of the first block differs from that of the log by rounding only.
    got = np.concatenate([p.gyro for p in parts])
    np.testing.assert_allclose(got, read(alone, tmp_path).gyro, rtol=1e-12)
    assert {p.sampled for p in parts} == {"increment"}


@pytest.mark.usefixtures("small_blocks")
def test_rows_are_numbered_in_the_whole_log(tmp_path: Path) -> None:
    log = a_log()
    accel = log.accel.copy()
    accel[[700, 950], 1] = np.nan
    write(replace(log, accel=accel), tmp_path / "nan.parquet")
    with pytest.raises(FoucaultError, match="row 700"):
        list(follow.blocks(describe("nan.parquet"), tmp_path))
    parts = list(follow.blocks(describe("nan.parquet", missing="drop"), tmp_path))
    assert sum(map(len, parts)) == 998
    (told,) = (f for f in follow.merged(p.findings for p in parts) if f.code == "log.dropped")
    assert told.message.endswith("The like is found in 1 later parts of the log.")
    time = log.time.copy()
    time[600:] -= 0.5  # exactly between two blocks
    write(replace(log, time=time), tmp_path / "back.parquet")
    with refuses("log.time_backward", "row 600"):
        list(follow.blocks(describe("back.parquet"), tmp_path))


def test_a_log_of_one_block_is_checked_as_when_it_is_read(tmp_path: Path) -> None:
    log = a_log()
    gyro = log.gyro.copy()
    gyro[200:600, 1] = 0.25
    write(replace(log, gyro=gyro), tmp_path / "stuck.csv")
    (part,) = follow.blocks(describe("stuck.csv"), tmp_path)
    assert part.findings == read(describe("stuck.csv"), tmp_path).findings
    assert "log.stuck" in {f.code for f in part.findings}


def test_an_empty_log(tmp_path: Path) -> None:
    write(a_log()[:0], tmp_path / "empty.parquet")
    with refuses("log.empty"):
        list(follow.blocks(describe("empty.parquet"), tmp_path))


# -- applying ---------------------------------------------------------------------------------


def apply(result: Result, folder: Path, log: Log, out: str = "out.parquet", **how: Any) -> Applied:
    write(log, folder / "log.csv")
    return calibrate_log(result, describe("log.csv"), folder, folder / out, **how)


@pytest.mark.parametrize("out", ["out.csv", "out.csv.gz", "out.parquet", "out.npz"])
@pytest.mark.usefixtures("small_blocks")
def test_the_numbers_are_those_of_apply(out: str, full: Result, tmp_path: Path) -> None:
    log = a_log()
    done = apply(full, tmp_path, log, out, sha256="abc")
    assert done.samples == 1000
    got, want = read(describe(out), tmp_path), full.apply(log)
    # Newton's method stops when a whole block has settled: a last step of rounding may differ.
    np.testing.assert_allclose(got.accel, want.accel, rtol=0, atol=1e-13)
    np.testing.assert_allclose(got.gyro, want.gyro, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(got.temperature, log.temperature)


@pytest.mark.parametrize("sampled", ["rate", "increment"])
@pytest.mark.parametrize("gap", [0, 299, 300, 301])
@pytest.mark.usefixtures("small_blocks")
def test_lever_arms_and_delay_know_nothing_of_blocks(
    sampled: str, gap: int, apart: Result, tmp_path: Path
) -> None:
    log = a_log(sampled=sampled)
    log.time[gap:] += 0.1 if gap else 0.0
    done = apply(apart, tmp_path, log)
    assert done.samples == 1000
    got, want = read(describe("out.parquet"), tmp_path), apart.apply(log)
    np.testing.assert_allclose(got.accel, want.accel, rtol=0, atol=1e-11)
    np.testing.assert_allclose(got.gyro, want.gyro, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(got.temperature, log.temperature)
    assert np.abs(want.accel - apart.model.apply(log).accel).max() > 1.0


def test_the_file_says_which_result_made_it(linear: Result, tmp_path: Path) -> None:
    from pyarrow import parquet

    apply(linear, tmp_path, a_log(), sha256="abc")
    metadata = parquet.read_schema(tmp_path / "out.parquet").metadata
    said = json.loads(metadata[b"foucault.calibrated_by"])
    assert said["sha256"] == "abc"
    assert said["instrument"]["serial"] == "0180-2214"
    assert said["verdict"] == "pass"
    apply(linear, tmp_path, a_log(), "out.csv", sha256="abc")
    first, second = (tmp_path / "out.csv").read_text().splitlines()[:2]
    assert first == "# foucault imu log v1, sampled=rate, SI units, calibrated"
    assert json.loads(second.removeprefix("# foucault.calibrated_by: ")) == said


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_a_calibrated_log_is_not_calibrated_again(
    suffix: str, linear: Result, tmp_path: Path
) -> None:
    apply(linear, tmp_path, a_log(), f"once{suffix}")
    again = describe(f"once{suffix}")
    with refuses("apply.again", "take the errors off twice"):
        calibrate_log(linear, again, tmp_path, tmp_path / "twice.csv")
    assert not (tmp_path / "twice.csv").exists()
    calibrate_log(linear, again, tmp_path, tmp_path / "twice.csv", force=True)


def outside(done: Applied) -> str:
    told = [f for f in done.findings if f.code == "apply.outside"]
    assert len(told) <= 1
    return told[0].message if told else ""


def test_one_finding_tells_how_much_is_outside(linear: Result, tmp_path: Path) -> None:
    n = 2000
    log = a_log(n)
    accel, gyro, temperature = log.accel.copy(), log.gyro.copy(), np.full(n, 298.15)
    accel[:] = [0, 0, 9.8]
    accel[:100, 0] = 30.0
    gyro[:] = 0.0
    gyro[5, 2] = -4.0
    temperature[-400:] = 308.15
    validity = {"accel": [-9.8, 9.8], "gyro": [-1.0, 1.0], "temperature": [293.15, 300.15]}
    result = with_terms("accel.bias", "gyro.bias", validity=validity)
    zero = result.coefficients.with_values(dict.fromkeys(result.coefficients.names, 0.0))
    result = replace(result, coefficients=zero)
    hard = replace(log, accel=accel, gyro=gyro, temperature=temperature)
    assert outside(apply(result, tmp_path, hard)) == (
        "The specific force is outside -9.8 to 9.8 m/s^2 in 5 % of the samples, at the furthest "
        "30 m/s^2; the angular rate is outside -57.3 to 57.3 deg/s in 0.05 % of the samples, at "
        "the furthest -229.2 deg/s; the temperature is outside 20 to 27 degC in 20 % of the "
        "samples, at the furthest 35 degC: more than the calibration covered."
    )
    soft = replace(hard, accel=accel[100:], gyro=gyro[100:], time=log.time[100:],
                   temperature=np.full(n - 100, 300.5))  # fmt: skip
    assert outside(apply(result, tmp_path, soft)) == ""
    nothing = replace(result, validity={})
    assert outside(apply(nothing, tmp_path, hard)) == ""


def test_a_triad_without_coefficients_is_told(tmp_path: Path) -> None:
    result = with_terms("accel.bias")
    log = a_log()
    done = apply(result, tmp_path, log)
    assert [f.message for f in done.findings if f.code == "apply.untouched"] == [
        "The result has no gyro coefficients: the gyro columns are written as they were read."
    ]
    np.testing.assert_array_equal(read(describe("out.parquet"), tmp_path).gyro, log.gyro)


def refused(code: str, result: Result, folder: Path, log: Log, **how: Any) -> FoucaultError:
    with refuses(code) as caught:
        apply(result, folder, log, **how)
    assert not (folder / "out.parquet").exists()
    assert not list(folder.glob(".partial*"))
    return caught.value


def test_another_instrument(linear: Result, tmp_path: Path) -> None:
    other = {"name": "MTi-28", "serial": "0180-9999"}
    problem = refused("apply.instrument", linear, tmp_path, a_log(), instrument=other)
    assert str(problem) == (
        "The result is for serial number '0180-2214', the log says serial number '0180-9999'. "
        "Use the result of this instrument; --force applies the other one all the same."
    )
    refused("apply.instrument", linear, tmp_path, a_log(), instrument={"name": "VN-100"})
    for fine in ({"name": "mti 28", "serial": "0180-2214 "}, {"serial": ""}, {}, None):
        apply(linear, tmp_path, a_log(), instrument=fine)
    apply(linear, tmp_path, a_log(), instrument=other, force=True)


def test_another_count_scale(linear: Result, tmp_path: Path) -> None:
    def counts(scale: Any) -> dict[str, Any]:
        return {
            **TEXT, "accel": {"columns": [4, 5, 6], "unit": "count", "scale": scale},
        }  # fmt: skip

    write(a_log(), tmp_path / "log.csv")
    one, two = "415 count/(m/s^2)", "416 count/(m/s^2)"
    was = {"input": {"description": counts([one] * 3)}}
    result = replace(linear, provenance=was)
    calibrate_log(result, describe("log.csv", **counts(one)), tmp_path, tmp_path / "a.csv")
    with refuses("apply.scale", "this one with '416 count"):
        calibrate_log(result, describe("log.csv", **counts(two)), tmp_path, tmp_path / "b.csv")
    assert not (tmp_path / "b.csv").exists()


def test_an_unusable_result(tmp_path: Path) -> None:
    result = with_terms("accel.bias", level=Level.UNUSABLE)
    problem = refused("apply.unusable", result, tmp_path, a_log())
    assert "7 rests cannot determine 9" in problem.message
    apply(result, tmp_path, a_log(), force=True)


def test_g_sensitivity_without_accelerometers(full: Result, tmp_path: Path) -> None:
    problem = refused("apply.needs_accel", full, tmp_path, a_log(accel=None))
    assert problem.message.startswith("log.csv has no accelerometer columns")


def test_lever_arms_without_gyros(apart: Result, tmp_path: Path) -> None:
    problem = refused("apply.needs_gyro", apart, tmp_path, a_log(gyro=None))
    assert problem.message.startswith("log.csv has no gyro columns, but the result corrects")
    assert "lever_arms = false" in problem.cure


def test_onto_itself_and_nowhere(linear: Result, tmp_path: Path) -> None:
    with refuses("apply.onto_itself", "is the log itself"):
        apply(linear, tmp_path, a_log(), "log.csv")
    assert "calibrated" not in (tmp_path / "log.csv").read_text()
    with pytest.raises(FoucaultError, match="cannot be written"):
        apply(linear, tmp_path, a_log(), "missing/out.csv")
    with pytest.raises(FoucaultError, match="logs are written as"):
        apply(linear, tmp_path, a_log(), "out.docx")


def test_a_fault_late_in_the_log_leaves_what_was_there(
    linear: Result, tmp_path: Path, small_blocks: None
) -> None:
    log = a_log()
    accel = log.accel.copy()
    accel[900] = np.nan
    apply(linear, tmp_path, log)
    before = (tmp_path / "out.parquet").read_bytes()
    with pytest.raises(FoucaultError, match="row 900"):
        apply(linear, tmp_path, replace(log, accel=accel))
    assert (tmp_path / "out.parquet").read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "out.parquet"]


@pytest.mark.parametrize("name", ["flight.csv", "flight.csv.gz", "flight.parquet", "flight.npz"])
def test_a_recorded_log_is_not_written_over(linear: Result, tmp_path: Path, name: str) -> None:
    write(a_log(), tmp_path / name)
    before = (tmp_path / name).read_bytes()
    with refuses("output.other", "no earlier output of this command"):
        apply(linear, tmp_path, a_log(), name)
    assert (tmp_path / name).read_bytes() == before
    apply(linear, tmp_path, a_log(), name, force=True)
    calibrated = (tmp_path / name).read_bytes()
    assert calibrated != before
    apply(linear, tmp_path, a_log(), name)  # its own, again
    assert (tmp_path / name).read_bytes() == calibrated


# What is freed goes back at once: the peak is what was held, not what a pool kept.
POOL = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "1"}

PEAK = """
import json, sys
import pyarrow.csv, pyarrow.parquet, pydantic
from foucault.cli import app
from foucault.export import calibrate_log
from foucault.logs import LogDescription
from foucault.run_folder import load_result
def peak():
    with open("/proc/self/status") as lines:
        return next(1024 * int(l.split()[1]) for l in lines if l.startswith("VmHWM"))
folder, log, out = sys.argv[1:]
result = load_result(folder)
before = peak()
done = calibrate_log(result, LogDescription(file=log), folder, f"{folder}/{out}")
print(json.dumps([done.samples, peak() - before]))
"""


def memory(folder: Path, suffix: str, rows: int) -> int:
    """Return the memory that applying to `rows` rows takes in a process of its own [byte]."""
    write(a_log(rows), folder / f"log{suffix}")
    command = [sys.executable, "-c", PEAK, str(folder), f"log{suffix}", f"out{suffix}"]
    given = os.environ | POOL
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=given)
    got, used = json.loads(done.stdout)
    assert got == rows
    return int(used)


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
@pytest.mark.parametrize(
    ("suffix", "short", "long"),  # with the short one every buffer has its full size
    [(".csv", 400_000, 700_000), (".parquet", 1_500_000, 2_500_000)],
)
def test_memory_does_not_grow_with_the_log(
    suffix: str, short: int, long: int, linear: Result, tmp_path: Path
) -> None:
    save(linear, tmp_path)
    table = (long - short) * 8 * 8
    grown = memory(tmp_path, suffix, long) - memory(tmp_path, suffix, short)
    # Held whole, readings and result together are two tables.
    assert grown < table
