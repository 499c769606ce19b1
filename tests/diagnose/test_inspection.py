"""A first look at a log: spins on a table are no rests, and means are no samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign
from foucault.campaign.running import read_any
from foucault.cli import sessions
from foucault.detect.live import LiveRests
from foucault.diagnose.live import inspect
from foucault.procedures import PROCEDURES
from foucault.report import noise, save
from foucault.tables import Log, TableColumns

RATE = np.radians(10.0)
BIAS = np.radians([2.0, -1.0, 0.5])


def tables(seen):
    """Return rows of what is said of a log, by the key of the section."""
    blocks = ((s.key, b) for s in noise.inspected(seen).sections for b in s.blocks)
    return {key.removeprefix("log."): b.rows for key, b in blocks if b.kind == "table"}


def table_log(spins=6, bias=BIAS):
    """Rests and spins of 10 s about each axis in turn, both ways, with brisk moves between."""
    rng, gyro, table = np.random.default_rng(1), [], []
    for k in range(spins):
        turn = np.sign(0.5 - k % 2) * RATE * np.eye(3)[k // 2 % 3]
        for w in (np.zeros(3), turn):
            gyro += [np.tile(w, (500, 1)), 0.3 * rng.normal(size=(100, 3))]
            table += [np.full(500, np.linalg.norm(w)), np.full(100, 0.3)]
    gyro = np.concatenate(gyro) + bias
    gyro = gyro + 1e-4 * rng.normal(size=gyro.shape)
    up = np.tile([0.0, 0.0, 9.81], (len(gyro), 1)) + 1e-3 * rng.normal(size=gyro.shape)
    return Log(0.02 * np.arange(len(gyro)), gyro, up), np.concatenate(table)


@pytest.mark.parametrize("told", [False, True])
def test_steady_spins_are_turning_and_no_rests(told):
    log, rate = table_log()
    if told:
        log = replace(log, table=TableColumns(np.full((len(log), 3), np.nan), rate))
    seen = inspect(log)
    assert len(seen.rests) == 12
    assert seen.turning.tolist() == [False, True] * 6
    said = tables(seen)
    assert [row[6] for row in said["rests"][:4]] == ["rest", "turning"] * 2
    overview = dict(said["overview"])
    assert overview["rests found"].startswith("6 ")
    assert overview["steady turns"].startswith("6,")


def test_means_have_a_row_each_and_no_noise(tmp_path):
    angles = np.radians([[0.0, 90.0, np.nan], [0.0, 0.0, np.nan], [0.0, 0.0, np.nan]])
    log = Log(
        np.array([0.0, 40.0, 80.0]), np.array([[0.0, 0, 0], [0, 0, 1e-4], [0, 0, 1.0]]),
        np.array([[0.0, 9.8, 0], [0, 0, 9.8], [0, 0, 9.8]]),
        averaged=np.array([30.0, 30.0, 10.0]), table=TableColumns(angles, np.array([0, 0, 1.0])),
    )  # fmt: skip
    seen = inspect(log)
    said = tables(seen)
    assert dict(said["overview"]) == {"means": "3, each over 10 s to 30 s"}
    (means,) = (s for s in noise.inspected(seen).sections if s.key == "log.means")
    heads = [column.heading for column in means.blocks[0].columns]
    assert heads[7:] == ["outer (deg)", "middle (deg)", "table (deg/s)"]
    rows = said["means"]
    assert rows[0][1:3] == ["0.00 s", "30.00 s"]
    assert [row[6] for row in rows] == ["rest", "rest", "turning"]
    assert rows[0][7:] == ["0.000", "90.000", "0.000"]
    assert rows[2][-1] == f"{np.degrees(1.0):.3f}"
    assert not any("sqrt" in word for row in said["readings"] for word in row)
    document = sessions._document(tmp_path, seen, 0.0)
    assert "gaps" not in document
    assert "noise" not in document["accel"]
    assert list(document["averaged"]) == [30.0, 30.0, 10.0]
    save(noise.inspected(seen), tmp_path / "quick.html")
    assert "3 means" in (tmp_path / "quick.html").read_text()


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=() if n in ("norm_observation", "two_imus") else pytest.mark.thorough)
    for n in PROCEDURES if n != "north_seeking"  # whose log has one gyro, and is refused
])  # fmt: skip
def test_a_session_of_any_procedure_can_be_looked_at_and_warns_of_nothing(name, tmp_path):
    session = campaign.simulate(campaign.parse(campaign.template(name)))
    log, _ = read_any(campaign.save_session(session, tmp_path), lambda *_: None)
    seen = inspect(log)
    document = noise.glance(seen)
    assert not [s for s in document.sections if s.key == "findings"]
    assert not [w for rows in tables(seen).values() for row in rows for w in row if "nan" in w]


def test_a_whole_turn_is_a_spin_and_what_only_creeps_is_named():
    rng = np.random.default_rng(1)
    rates = np.radians([0.0, 0.0, 0.0, 50.0, 0.0, 0.0, 5.0, 0.0])  # 500 deg, and 50 deg
    gyro = np.concatenate(
        [x for w in rates for x in (np.tile([0, 0, w], (500, 1)), 0.3 * rng.normal(size=(100, 3)))]
    ) + 1e-4 * rng.normal(size=(4800, 3))
    up = np.tile([0.0, 0.0, 9.81], (4800, 1)) + 1e-3 * rng.normal(size=(4800, 3))
    seen = inspect(Log(0.02 * np.arange(4800), gyro, up))
    assert seen.turning.tolist() == [False, False, False, True, False, False, False]
    assert [f.code for f in seen.findings] == ["rest.moving"]
    assert seen.findings[0].message.startswith("The quiet time 72")


def test_slow_torquing_and_slow_spins_are_no_rests() -> None:
    """Gravity swings, or a rate along up makes whole turns; a bias alone does neither."""
    rng = np.random.default_rng(2)
    force, gyro = [], []
    # Direction of up, and how it turns [deg/s]: rests, a slow spin either way, slow torquing.
    for up, rate, seconds in [
        ([0, 0, 1], [0, 0, 0], 60), ([0, 1, 0], [0, 0, 0], 60), ([1, 0, 0], [0, 0, 0], 60),
        ([0, 0, 1], [0, 0, 0.3], 1300), ([0, 0, -1], [0, 0, 0.3], 1300),
        ([0, 0, -1], [0, 0, 0], 60), ([1, 0, 0], [0, 0.1, 0], 300), ([0, -1, 0], [0, 0, 0], 60),
    ]:  # fmt: skip
        t = np.arange(seconds * 10)[:, None] / 10
        w = np.radians(rate)
        force.append(9.81 * (up + np.cross(up, w) * t))  # straight does for small angles
        gyro.append(np.tile(w, (len(t), 1)))
        force.append(np.tile([0, 0, 9.81], (20, 1)) + rng.normal(size=(20, 3)))
        gyro.append(0.3 * rng.normal(size=(20, 3)))
    f, w = (np.concatenate(x) for x in (force, gyro))
    f += 5e-3 * rng.normal(size=f.shape)
    w += [0.02, 0, 0.01] + 1e-3 * rng.normal(size=w.shape)
    log = Log(0.1 * np.arange(len(f)), w, f)
    slow = [False, False, False, True, True, False, True, False]
    assert inspect(log).turning.tolist() == slow
    live = LiveRests()
    for a in range(0, len(log), 300):
        live.add(log[a : a + 300])
    live.finish()
    assert live.rests()[2].tolist() == slow
