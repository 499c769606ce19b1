"""The command delay: two files, what they hold told by their titles or described."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault.logs import master, own
from foucault.plans.manoeuvres import Climb, Start, Straight, STurn
from foucault.plans.transfer import TransferProfile
from foucault.simulate.transfer import Link, TransferSimulation, draw_slave, simulate_transfer
from foucault.tables import Log
from make_alignment import REAL, real
from make_transfer import DEG

START = Start(45 * DEG, 9 * DEG, 800.0, heading=-20 * DEG, speed=45.0)
FLIGHT = TransferProfile(
    "short", START, (STurn(50 * DEG, 14.0), Climb(6.0, angle=8 * DEG), STurn(-40 * DEG, 14.0)),
    (Straight(1.0),),
)  # fmt: skip


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, TransferSimulation]:
    """A slave and the messages of its master, 83 ms late."""
    folder = tmp_path_factory.mktemp("delay")
    made = simulate_transfer(FLIGHT, rate=100.0, slave=draw_slave(np.random.default_rng(1)),
                             link=Link(delay=0.083), seed=6)  # fmt: skip
    own.write(made.log, folder / "imu.csv")
    master.write(made.master, folder / "navigation.csv")
    return folder, made


def test_a_delay_with_its_deviation(flight: tuple[Path, TransferSimulation]) -> None:
    folder, _ = flight
    words = ("delay", folder / "imu.csv", folder / "navigation.csv")
    shown = run(*words)
    assert shown.exit_code == 0 and "verdict: pass" in shown.output
    assert "Delay: 8" in shown.output and "Gyro bias of the slave" in shown.output
    about = json.loads(run(*words, "--json").output)
    assert about["delay"] == pytest.approx(0.083, abs=5 * about["delay_sd"])
    assert about["delay_sd"] < 1e-3 and about["seen"] and about["messages"]
    assert len(about["parts"]) == 4 and about["verdict"] == "pass"
    assert about["rivals"] == [] and about["transport"] is None
    near = run(*words, "--mounting", "0 deg, 0 deg, 0 deg", "--bracket", "0 s to 0.2 s", "--json")
    assert json.loads(near.output)["delay"] == pytest.approx(about["delay"], abs=1e-5)


def test_a_campaign_says_where_it_is_and_its_clock_counts_from_1970(
    flight: tuple[Path, TransferSimulation],
) -> None:
    folder, made = flight
    start = 1754380800.0
    own.write(replace(made.log, time=made.log.time + start), folder / "stamped.csv")
    keep = np.arange(len(made.master)) % 50 > 0
    rows = np.column_stack([made.master.time + start, made.master.velocity_n, made.master.angles])
    np.savetxt(folder / "stamped.txt", rows[keep], fmt="%.9f")
    (folder / "stamped.toml").write_text(
        '[site]\nlatitude = "45 deg"\n[log]\nfile = "stamped.csv"\n'
        '[master]\nfile = "stamped.txt"\ntime = { column = 0, unit = "s" }\n'
        'velocity = { columns = [1, 2, 3], unit = "m/s" }\n'
        'attitude = { columns = [4, 5, 6], unit = "rad" }\n'
        '[procedure]\nname = "transfer_alignment"\n'
    )
    shown = run("delay", folder / "stamped.toml")
    said = " ".join(shown.output.split())
    assert shown.exit_code == 0, said
    assert "Times count from 1754380800 s" in said
    assert said.count("17543808") == 1
    assert said.count("messages are missing") == 1
    assert "says no latitude" not in said


@pytest.mark.thorough
def test_a_log_has_no_offset_from_itself(flight: tuple[Path, TransferSimulation]) -> None:
    folder, _ = flight
    (folder / "copy.csv").write_bytes((folder / "imu.csv").read_bytes())
    for other in ("imu.csv", "copy.csv"):
        refused = run("delay", folder / "imu.csv", folder / other, "--json")
        assert refused.exit_code == 1 and "delay.same_log" in refused.output


def test_a_second_imu(flight: tuple[Path, TransferSimulation]) -> None:
    folder, made = flight
    half = Log(made.log.time[::2] + 12.5, made.log.gyro[::2], made.log.accel[::2], "rate")
    own.write(half, folder / "other.csv")
    words = ("delay", folder / "imu.csv", folder / "other.csv")
    apart = run(*words)
    assert apart.exit_code == 4 and "--bracket any" in " ".join(apart.output.split())
    about = json.loads(run(*words, "--bracket", "any", "--json").output)
    assert about["delay"] == pytest.approx(12.5, abs=0.01) and not about["messages"]


def test_a_master_that_is_described(flight: tuple[Path, TransferSimulation]) -> None:
    folder, made = flight
    rows = np.column_stack([made.master.time, made.master.velocity_n,
                            made.master.angles * [-1, 1, 1]])  # fmt: skip
    np.savetxt(folder / "bare.txt", rows)
    (folder / "master.toml").write_text(
        '[master]\nfile = "bare.txt"\ntime = { column = 0, unit = "s" }\n'
        'velocity = { columns = [1, 2, 3], unit = "m/s" }\n'
        'attitude = { columns = [4, 5, 6], unit = "rad", sense = "counter-clockwise" }\n'
    )
    result = run("delay", folder / "imu.csv", folder / "master.toml", "--json")
    about = json.loads(result.output)
    assert about["delay"] == pytest.approx(0.083, abs=1e-3)
    assert [f["code"] for f in about["findings"]] == ["delay.earth"]
    (folder / "wrong.toml").write_text('[master]\nfile = "bare.txt"\nvelocty = 1\n')
    wrong = run("delay", folder / "imu.csv", folder / "wrong.toml")
    assert wrong.exit_code == 1 and "velocity" in wrong.stderr


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--bracket", "0.2 s"), "does not say between which offsets"),
        (("--bracket", "1 s to 0 s"), "does not say between which offsets"),
        (("--bracket", "0 to 1"), "--bracket"),
        (("--mounting", "10 deg"), "does not say heading, pitch and roll"),
        (("--mounting", "10, 0, 0"), "--mounting"),
    ],
)
def test_what_is_not_understood(
    flight: tuple[Path, TransferSimulation], words: tuple[str, ...], text: str
) -> None:
    folder, _ = flight
    result = run("delay", folder / "imu.csv", folder / "navigation.csv", *words)
    assert result.exit_code == 1 and text in " ".join(result.stderr.split())


def test_one_log_alone(flight: tuple[Path, TransferSimulation]) -> None:
    result = run("delay", flight[0] / "imu.csv")
    assert result.exit_code == 1 and "imu.csv describes one log only." in result.stderr
    assert "[master]" in result.stderr


def test_a_real_vehicle(tmp_path: Path) -> None:
    """Slave and master of one MATLAB file, described in one campaign and one [master]."""
    made = real("fog_mems_transfer", {
        "file": "transfer_align_fog_mems.mat", "variable": "mimu",
        "time": {"column": 6, "unit": "s"},
        "gyro": {"columns": [0, 1, 2], "unit": "rad", "kind": "increment"},
        "accel": {"columns": [3, 4, 5], "unit": "m/s", "kind": "increment"},
    })  # fmt: skip
    own.write(made, tmp_path / "imu.parquet")
    file = (REAL / "fog_mems_transfer" / "transfer_align_fog_mems.mat").resolve()
    (tmp_path / "master.toml").write_text(
        f'[master]\nfile = "{file.as_posix()}"\nvariable = "fogavp"\n'
        'time = { column = 9, unit = "s" }\n'
        'velocity = { columns = [3, 4, 5], unit = "m/s" }\n'
        'attitude = { columns = [2, 0, 1], unit = "rad", sense = "counter-clockwise" }\n'
        'position = { columns = [6, 7, 8], unit = "rad" }\n'
    )
    result = run("delay", tmp_path / "imu.parquet", tmp_path / "master.toml", "--json")
    about = json.loads(result.output)
    assert about["delay"] == pytest.approx(0.0155, abs=3e-4)
    assert [f["code"] for f in about["findings"]] == ["delay.drift"] and result.exit_code == 3
    about_z, about_x = np.radians(17.65 / 60), np.radians(-4.17 / 60)
    C_ms = np.array(about["C_ms"])
    assert C_ms[0, 1] == pytest.approx(about_z, abs=3e-4)
    assert C_ms[2, 1] == pytest.approx(about_x, abs=3e-4)
