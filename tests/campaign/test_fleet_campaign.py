"""The same campaign over many instruments, from the files to the folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from foucault import campaign, run_folder
from foucault.campaign import fleet, tolerance
from foucault.diagnose.study import nees
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs.reading import by_serial
from foucault.procedures import fleet as on_table_batch
from foucault.procedures import norm_observation, on_table
from refusals import refuses

LINEAR = '[procedure]\nname = "norm_observation"\nsolution = "linear"\n'


def bench(folder: Path, n: int, *, extra: str = "", procedure: str = LINEAR, seed: int = 3):
    """Simulate a fleet and return its campaign."""
    text = campaign.template("norm_observation")
    head, _, rest = text.partition("[procedure]")
    tail = rest[rest.index("\n# Left out, the noise"):]  # fmt: skip
    described = campaign.parse(head + procedure + extra + tail, folder / "campaign.toml")
    made = fleet.simulated(described, n, seed)
    return campaign.load(fleet.save_simulated(described, made, folder, seed))


def columns(path: Path) -> dict[str, np.ndarray]:
    table = pq.read_table(path)
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}


def spoil(folder: Path, change) -> None:
    data = columns(folder / "means.parquet")
    out = change(data)
    pq.write_table(pa.table(out or data), folder / "means.parquet")


def rows_of(data, serial):
    return np.flatnonzero(data["serial"] == serial)


@pytest.mark.thorough
def test_a_fleet_is_solved_in_one_batch_and_each_has_a_result(tmp_path):
    described = bench(tmp_path / "bench", 40, extra='[noise]\ngrade = "mems"\n')
    told = []
    table = fleet.run(described, tmp_path / "out", progress=lambda f, w: told.append((f, w)))
    assert table.counts() == {"pass": 40, "doubtful": 0, "unusable": 0, "broken": 0}
    about = run_folder.about_of(tmp_path / "out", "fleet")
    assert about["solved_in_batch"] == 40 and about["instruments"] == 40
    assert about["schema"] == "foucault.fleet/1" and about["tolerance"] is None
    assert told[-1][1] == "writing 40 of 40" and all(0 <= f <= 1 for f, _ in told)
    truth = columns(tmp_path / "bench" / "truth.parquet")
    saved = columns(tmp_path / "out" / "fleet.parquet")
    assert saved["serial"].tolist() == truth["serial"].tolist()
    scores = []
    for k, serial in enumerate(truth["serial"]):
        result = run_folder.load_result(tmp_path / "out" / "instruments" / serial)
        assert result.instrument["serial"] == serial
        names = result.coefficients.names
        true = np.array([truth[n][k] for n in names])
        error = (result.coefficients.values - true)[None]
        scores.append(float(nees(error, result.coefficients.cov)[0]))
        for name in names:
            assert saved[name][k] == result.coefficients.value(name)
        assert set(result.tables["readings"]) >= {"norm_after", "rate_after", "residual"}
        np.testing.assert_allclose(
            saved["lever_arm.y"][k], result.tables["rig"]["value"][1], rtol=1e-12
        )
    low, high = chi_square_limits(21 * 40)
    assert low < sum(scores) < high


@pytest.mark.thorough
def test_the_batch_is_the_linear_solution_of_calibrate(tmp_path):
    described = bench(tmp_path, 3, extra='plan = "dodecahedron 20"\n')
    log = dict(by_serial(described.log, described.folder))["SN002"]
    task = norm_observation.task_of(described.settings)
    readings = on_table.read_positions(log, task, described.noise)
    plan = on_table_batch.plan_of(described.settings)
    arranged = on_table_batch.arranged(readings, plan)
    batch = on_table_batch.solve([arranged], described.settings, described.site)
    want, lever_arm = norm_observation.solve(described.settings, readings, described.site)
    values = want.coefficients(batch.estimate.coefficients(0).names).values
    sd = batch.estimate.sd[0]
    assert np.max(np.abs(batch.estimate.values[0] - values) / sd) < 1e-3
    np.testing.assert_allclose(batch.estimate.lever_arm[0], lever_arm, atol=1e-6)


@pytest.mark.thorough
def test_the_order_of_the_positions_does_not_matter(tmp_path):
    described = bench(tmp_path / "bench", 3)
    one = fleet.run(described, tmp_path / "one")

    def shuffle(data):
        rows = np.concatenate([np.r_[20:24, 0:20], np.r_[24:72]])
        time = data["time"].copy()
        out = {k: v[rows] for k, v in data.items()}
        return out | {"time": time}

    spoil(tmp_path / "bench", shuffle)
    two = fleet.run(described, tmp_path / "two")
    assert not two.problems
    np.testing.assert_allclose(two.values, one.values, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_broken_instruments_are_listed_and_the_others_go_on(tmp_path):
    described = bench(tmp_path / "bench", 12)
    before = fleet.run(described, tmp_path / "out")
    assert not before.problems

    def change(data):
        for a in "xyz":
            data[f"gyro_{a}"] = data[f"gyro_{a}"].copy()
            data[f"accel_{a}"] = data[f"accel_{a}"].copy()
        data["accel_y"][rows_of(data, "SN003")[4]] = np.nan
        keep = np.ones(len(data["serial"]), bool)
        keep[rows_of(data, "SN005")[7]] = False
        keep[rows_of(data, "SN007")[2:]] = False
        return {k: v[keep] for k, v in data.items()}

    spoil(tmp_path / "bench", change)
    table = fleet.run(described, tmp_path / "out")
    codes = {serial: p.code for serial, p in table.problems.items()}
    assert set(codes) == {"SN003", "SN005", "SN007"}
    assert codes["SN005"] == "fleet.positions"
    assert "missing number 8 of 24" in table.problems["SN005"].message
    good = [r.serial for r in table.rows if r.problem is None]
    want = [r.serial for r in before.rows if r.serial not in codes]
    assert good == want
    listed = {
        row["serial"]: row for row in run_folder.about_of(tmp_path / "out", "fleet")["broken"]
    }
    assert set(listed) == set(codes) and all(row["cure"] for row in listed.values())
    # What they had before is no longer their result.
    for serial in codes:
        assert not (tmp_path / "out" / "instruments" / serial).exists()
    kept = [before.values[int(s[2:]) - 1] for s in good]
    np.testing.assert_allclose(table.values[table.good], kept, rtol=0, atol=1e-12)
    saved = columns(tmp_path / "out" / "fleet.parquet")
    assert saved["outcome"].tolist().count("broken") == 3
    assert saved["code"][-1] in codes.values() and np.isnan(saved["gyro.bias.x"][-1])


def test_a_fleet_without_a_result_says_why(tmp_path):
    described = bench(tmp_path / "bench", 2)

    def change(data):
        keep = data["position"] != 3
        return {k: v[keep] for k, v in data.items()}

    spoil(tmp_path / "bench", change)
    with refuses("fleet.nothing", "SN001", match="None of 2 instruments"):
        fleet.run(described, tmp_path / "out")


def test_an_instrument_that_does_not_respond_is_unsolved(tmp_path):
    described = bench(tmp_path / "bench", 4)
    log = dict(by_serial(described.log, described.folder))
    plan = on_table_batch.plan_of(described.settings)
    task = norm_observation.task_of(described.settings)
    readings = [
        on_table_batch.arranged(on_table.read_positions(x, task, None), plan) for x in log.values()
    ]
    readings[1].gyro[:] = readings[1].gyro[0]
    batch = on_table_batch.solve(readings, described.settings, described.site)
    problems = [batch.problem(i) for i in range(4)]
    assert [p is None for p in problems] == [True, False, True, True]
    assert problems[1].code == "fleet.unsolved" and "do not determine" in problems[1].message


@pytest.mark.thorough
def test_a_noisy_instrument_is_doubtful_and_its_uncertainty_knows_it(tmp_path):
    described = bench(tmp_path / "bench", 20, extra='plan = "dodecahedron 20"\n')
    quiet = fleet.run(described, tmp_path / "one")

    def change(data):
        data["accel_x"] = data["accel_x"].copy()
        data["accel_x"][rows_of(data, "SN004")[5]] += 0.02

    spoil(tmp_path / "bench", change)
    table = fleet.run(described, tmp_path / "two")
    assert [r.serial for r in table.rows if r.verdict == "doubtful"] == ["SN004"]
    assert "a reading is wrong, or the instrument is noisier" in table.rows[3].reasons[0]
    assert [(o.index, o.name) for o in table.outlying() if o.name.startswith("noise")] == [
        (3, "noise of the accelerometers")
    ]
    ratio = table.sd[3, 0] / quiet.sd[3, 0]
    assert ratio > 5
    assert table.ratio[3, 0] == pytest.approx(ratio, rel=0.3)
    np.testing.assert_allclose(table.sd[4], quiet.sd[4], rtol=0.1)


@pytest.mark.thorough
def test_tolerance_decides_pass_fail_and_undecided(tmp_path):
    described = bench(tmp_path / "bench", 30)
    limits = tolerance.parse('"accel.bias" = "40 mg"\n"gyro.scale" = { limit = "9 %", sd = "1 %" }')
    table = fleet.run(described, tmp_path / "out", tolerance=limits)
    counts = table.counts()
    assert list(counts) == ["pass", "fail", "undecided", "broken"]
    size = np.abs(table.values[:, :3]).max(axis=1)
    outcomes = np.array(table.outcomes)
    assert (size[outcomes == "pass"] < 0.040 * 9.80665).all() and counts["pass"] > 5
    assert (size[outcomes == "fail"] > 0.040 * 9.80665).all() and counts["fail"] > 5
    said = json.loads((tmp_path / "out" / "fleet.json").read_text())["tolerance"]
    assert said["limits"]["gyro.scale"] == pytest.approx({"limit": 0.09, "sd": 0.01})
    i = outcomes.tolist().index("fail")
    assert all(name.startswith("accel.bias") and word == "fail" for name, word in table.misses(i))
    saved = columns(tmp_path / "out" / "fleet.parquet")
    assert saved["pass"].tolist() == [o == "pass" for o in table.outcomes]
    bad = tolerance.parse('"accel.quadratic" = "1 ug/g^2"')
    with pytest.raises(FoucaultError, match="does not estimate it"):
        fleet.run(described, tmp_path / "out", tolerance=bad)


@pytest.mark.thorough
def test_one_by_one_where_the_batch_does_not_solve_what_was_asked(tmp_path):
    likelihood = '[procedure]\nname = "norm_observation"\n'
    described = bench(tmp_path / "bench", 3, procedure=likelihood)
    table = fleet.run(described, tmp_path / "out", workers=2)
    assert run_folder.about_of(tmp_path / "out", "fleet")["solved_in_batch"] == 0
    log = dict(by_serial(described.log, described.folder))["SN002"]
    alone = norm_observation.calibrate(log, site=described.site, settings=described.settings)
    np.testing.assert_array_equal(table.values[1], alone.coefficients.values)
    np.testing.assert_array_equal(table.sd[1], alone.coefficients.sd)
    assert table.rows[1].verdict == str(alone.verdict.level)


def test_a_noise_that_nobody_knows_needs_redundant_readings(tmp_path):
    table = fleet.run(bench(tmp_path / "few", 2), tmp_path / "a")
    assert [r.verdict for r in table.rows] == ["doubtful"] * 2  # twice three
    assert "only 6 readings are redundant" in table.rows[0].reasons[0]
    table = fleet.run(bench(tmp_path / "more", 3), tmp_path / "b")
    assert [r.verdict for r in table.rows] == ["pass"] * 3


def test_readings_that_do_not_belong_together_are_unusable(tmp_path):
    described = bench(tmp_path / "bench", 10, extra='plan = "dodecahedron 20"\n')

    def change(data):
        rows = rows_of(data, "SN004")[:20]
        noise = np.random.default_rng(1).normal(size=len(rows))
        data["accel_x"] = data["accel_x"].copy()
        data["accel_x"][rows] += 0.3 * noise

    spoil(tmp_path / "bench", change)
    table = fleet.run(
        described, tmp_path / "out", tolerance=tolerance.parse('"gyro.bias" = "9 deg/s"')
    )
    assert table.rows[3].verdict == "unusable" and "do not belong together" in str(
        table.rows[3].reasons
    )
    assert table.outcomes[3] == "undecided" and table.outcomes.count("pass") == 9


@pytest.mark.parametrize(
    "key",
    [
        "accel_quadratic = true",
        'rate_sd = "10 ppm"',
        'unification = "four positions"',
        "g_sensitivity = true",
        'plan = "6 faces"',
    ],
)
def test_the_batch_is_left_where_more_is_asked(tmp_path, key):
    text = campaign.template("norm_observation")
    head, _, rest = text.partition("[procedure]")
    tail = rest[rest.index("\n# Left out, the noise"):]  # fmt: skip
    c = campaign.parse(head + LINEAR + key + "\n" + tail, tmp_path / "campaign.toml")
    assert not on_table_batch.suits(c.settings, c.site, c.prior)
    plain = campaign.parse(head + LINEAR + tail, tmp_path / "campaign.toml")
    assert on_table_batch.suits(plain.settings, plain.site, plain.prior)
    assert not on_table_batch.suits(plain.settings, plain.site, {"accel.bias": (0.0, 1.0)})


def test_a_pattern_of_files(tmp_path):
    described = bench(tmp_path, 3)
    data = columns(tmp_path / "means.parquet")
    (tmp_path / "logs").mkdir()
    for serial in ("SN001", "SN002", "SN003"):
        rows = rows_of(data, serial)
        part = {k: v[rows] for k, v in data.items() if k != "serial"}
        pq.write_table(pa.table(part), tmp_path / "logs" / f"{serial}.parquet")
    whole = fleet.run(described, tmp_path / "one")
    text = described.text.replace("means.parquet", "logs/*.parquet")
    text = "\n".join(line for line in text.splitlines() if not line.startswith('serial = "serial'))
    many = campaign.parse(text, tmp_path / "campaign.toml")
    (tmp_path / "logs" / "SN004.parquet").write_bytes(b"not a log")
    copy = (tmp_path / "logs" / "SN002.parquet").read_bytes()
    (tmp_path / "logs" / "SN005.parquet").write_bytes(copy)
    table = fleet.run(many, tmp_path / "two")
    assert [r.serial for r in table.rows] == ["SN001", "SN002", "SN003", "SN004", "SN005"]
    assert list(table.problems) == ["SN004", "SN005"]
    assert table.problems["SN005"].code == "fleet.same_log"
    assert "byte for byte that of instrument 'SN002'" in table.problems["SN005"].message
    np.testing.assert_array_equal(table.values[:3], whole.values)
    (tmp_path / "logs" / "SN001.csv").write_text("")
    again = campaign.parse(text.replace("*.parquet", "*"), tmp_path / "campaign.toml")
    with refuses("fleet.serial_twice", r"'SN001' is that of two logs"):
        fleet.run(again, tmp_path / "three")
    none = campaign.parse(text.replace("logs/*", "log/*"), tmp_path / "campaign.toml")
    with refuses("fleet.no_files", "No file fits"):
        fleet.run(none, tmp_path / "three")


def test_columns_in_several_files_are_refused(tmp_path):
    described = bench(tmp_path, 2)
    text = described.text.replace(
        'columns = ["gyro_x", ', 'file = "gyro.parquet", columns = ["gyro_x", '
    )
    two = campaign.parse(text, tmp_path / "campaign.toml")
    with refuses("fleet.files", "are in 2 files"):
        fleet.run(two, tmp_path / "out")


@pytest.mark.parametrize(
    "serial", ["../../etc", "/tmp/x", "..", ".", "", "a/b", "a\\b", "CON:", "é", "x" * 300, "a b"]
)
def test_a_serial_number_cannot_leave_its_folder(serial):
    name = fleet.folder_name(serial)
    assert name and Path(name).name == name and name not in (".", "..")
    assert len(name) < 100 and name.isascii() and "\\" not in name and ":" not in name


def test_different_serial_numbers_have_different_folders():
    serials = ["a/b", "a_b", "a b", "a:b", "é", "è", "x" * 300, "x" * 301, "SN-1.2", "."]
    assert len({fleet.folder_name(s) for s in serials}) == len(serials)
    assert fleet.folder_name("SN-1.2") == "SN-1.2"


def test_upper_and_lower_case_do_not_share_a_folder(tmp_path):
    described = bench(tmp_path / "bench", 2)

    def change(data):
        names = np.where(data["serial"] == "SN001", "unit", "UNIT")
        return data | {"serial": names}

    spoil(tmp_path / "bench", change)
    table = fleet.run(described, tmp_path / "out")
    folders = [r.folder for r in table.rows]
    assert folders[0] == "instruments/unit" and folders[1].startswith("instruments/UNIT-")
    for row, folder in zip(table.rows, folders, strict=True):
        result = run_folder.load_result(tmp_path / "out" / folder)
        assert result.instrument["serial"] == row.serial


def test_a_fleet_can_be_simulated_on_a_table_only(tmp_path):
    described = campaign.parse(campaign.template("hand_rotated"), tmp_path / "campaign.toml")
    with refuses("fleet.simulate", "norm_observation", match="not for hand_rotated"):
        fleet.simulated(described, 3)
    text = campaign.template("norm_observation")
    text += 'errors = { "gyro.bias.x" = "30 deg/h" }\n'
    given = campaign.parse(text, tmp_path / "campaign.toml")
    a, b = (fleet.simulated(given, 3, 5) for _ in range(2))
    np.testing.assert_array_equal(a.accel, b.accel)
    bias = a.fleet.values(["gyro.bias.x", "gyro.bias.y"])
    np.testing.assert_allclose(bias[:, 0], np.radians(30 / 3600), rtol=1e-12)
    assert np.ptp(bias[:, 1]) > 0
