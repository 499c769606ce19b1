"""Sources recorded together: a chamber, a table and several IMUs on one clock."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import run
from foucault import campaign
from foucault.capture import recording, several
from foucault.capture.clock import on_host
from foucault.capture.frame import parsed, text_of
from foucault.capture.recording import Plug
from foucault.plans.directions import hand_plan
from make_frames import kermit
from make_live import frames
from refusals import refuses

SBG = text_of("sbg_imu_short")

CHAMBER = """\
words = "a chamber and the table in it"
source = "this test"
line = { separator = "," }
fields = [
  { name = "time", at = 0, type = "u32", unit = "ms" },
  { name = "temperature", at = 1, unit = "degF" },
  { name = "outer", at = 2, unit = "deg" },
  { name = "position", at = 3 },
]
"""

NUMBERED = """\
words = "an IMU that says its number"
source = "this test"
line = { separator = " " }
fields = [
  { name = "time", at = 0, type = "u32", unit = "ms" },
  { name = "serial", at = 1 },
  { name = "accel", at = 2, count = 3, unit = "m/s^2" },
  { name = "gyro", at = 5, count = 3, unit = "deg/s" },
]
"""

LASTS = 4.0
"""Of a session [s]."""


class Clocked:
    """Bytes that come when they are due, late by up to `late` [s]."""

    def __init__(self, name: str, due: list[tuple[float, bytes]]) -> None:
        self.name, self.due, self.ended, self.begun = name, due, not due, time.monotonic()

    def read(self, wait: float) -> bytes:
        now, out = time.monotonic() - self.begun, b""
        while self.due and self.due[0][0] <= now:
            out += self.due.pop(0)[1]
        self.ended = not self.due
        if not out:
            time.sleep(min(wait, 0.005))
        return out

    def close(self) -> None:
        pass


def sbg(k: int, f: Any, w: Any) -> bytes:
    body = struct.pack("<BBHIH3i3ih", 44, 0, 32, round(1e4 * k), 0,
                       *np.round(np.asarray(f) * 1048576).astype(int).tolist(),
                       *np.round(np.asarray(w) * 67108864).astype(int).tolist(), 6400)  # fmt: skip
    return b"\xff\x5a" + body + kermit(body) + b"\x33"


def ramp(scale: float, begun: float = 0.0) -> list[tuple[float, bytes]]:
    """Return frames at 100 Hz whose accelerations say when they were made, with an own clock."""
    return [(0.01 * k, sbg(k, (scale * 0.01 * k, 0, 9.81), (0, 0, 0)))
            for k in range(int(100 * LASTS))]  # fmt: skip


def chamber() -> list[tuple[float, bytes]]:
    return [(0.1 * k, f"{5000 + 100 * k},{68 + 1.8 * 0.1 * k:.4f},{(350 + k) % 360},{k // 10}\n"
             .encode()) for k in range(int(10 * LASTS))]  # fmt: skip


def numbered(serial: int) -> list[tuple[float, bytes]]:
    return [(0.01 * k, f"{10 * k} {serial} 0 0 9.81 0 0 {k % 3}\n".encode())
            for k in range(int(100 * LASTS))]  # fmt: skip


def plug(name: str, due: list[tuple[float, bytes]], text: str) -> Plug:
    return Plug(Clocked(name, due), parsed(text, name), text)


def test_a_chamber_and_a_table_are_joined_by_time(tmp_path: Path):
    said = several.record([plug("imu", ramp(1.0), SBG), plug("chamber", chamber(), CHAMBER)],
                          tmp_path / "s")  # fmt: skip
    assert list(said["imus"]) == ["1"] and not said["left_out"]
    log = campaign.read_log(campaign.load(tmp_path / "s" / recording.CAMPAIGN))
    assert log.clock.source == "host" and said["imus"]["1"] == len(log) > 350
    # The acceleration says when each row was made; the chamber warms by a tenth of it.
    made = log.accel[:, 0]
    assert log.table is not None and log.table.position is not None
    own = log.temperature is not None
    assert own  # the frames of this IMU have a temperature of their own, which stays
    turned = np.degrees(log.table.angles[:, 0])
    np.testing.assert_allclose(turned, 350 + 10 * made, atol=0.5)
    assert set(np.diff(log.table.position)) <= {0, 1}
    aside = (tmp_path / "s" / "beside" / "2.csv").read_text().splitlines()
    assert aside[0] == "time (s),temperature (degF),outer (deg),position"
    assert len(aside) == 1 + int(10 * LASTS)


def test_an_imu_without_a_thermometer_gets_that_of_the_chamber(tmp_path: Path):
    said = several.record(
        [plug("chamber", chamber(), CHAMBER), plug("imu", numbered(7), NUMBERED)],
        tmp_path / "s",
    )
    log = campaign.read_log(campaign.load(tmp_path / "s" / recording.CAMPAIGN))
    assert list(said["imus"]) == ["7"] and log.temperature is not None
    rising = np.polyfit(log.time, log.temperature, 1)[0]
    assert rising == pytest.approx(1.0, abs=0.01)
    assert log.temperature[0] == pytest.approx(293.15, abs=0.1)


def test_two_imus_with_one_number_are_told_while_it_happens(tmp_path: Path):
    heard: list[int | None] = []
    said = several.record(
        [plug("one", numbered(7), NUMBERED), plug("two", numbered(7), NUMBERED)],
        tmp_path / "s", tell=lambda now: heard.append(several.twins([one for one, _ in now])),
    )  # fmt: skip
    assert heard[0] is None and 7 in heard[: len(heard) // 2]
    assert list(said["imus"]) == ["7", "7-2"]


def test_one_session_calibrates_all_sensors_on_a_plate(tmp_path: Path):
    """Two files that were written together, read again: a fleet of two."""
    from foucault.models.earth import Site
    from foucault.models.noise import grade
    from foucault.simulate.hand_rotated import draw_errors, simulate

    plan = hand_plan(16, 4.0, seed=4)
    for k, seed in enumerate((1, 2)):
        made = simulate(plan, model=draw_errors("mems", seed), noise=grade("mems").noise,
                        site=Site.at(0.82), rate=50.0, seed=seed)  # fmt: skip
        (tmp_path / f"{k}.bin").write_bytes(b"".join(frames(made.log)))
    out = tmp_path / "s"
    run("capture", tmp_path / "0.bin", tmp_path / "1.bin", "--frames", "sbg_imu_short",
        "--serial", "A-1", "--serial", "A-2", "--silence", "0.5 s", "-o", out)  # fmt: skip
    assert sorted(p.name for p in (out / "imus").iterdir()) == ["A-1.parquet", "A-2.parquet"]
    seen = run("fleet", out / "campaign.toml", "-o", tmp_path / "run", "--json", code=None)
    assert seen.exit_code in (0, 3), seen.output
    assert (tmp_path / "run" / "instruments" / "A-2" / "result.json").is_file()


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("a.bin", "a.bin", "--frames", "sbg_imu_short"), "named twice"),
        (("a.bin", "b.bin", "c.bin", "--frames", "sbg_imu_short", "--frames", "adis16470_burst"),
         "2 --frames were given for 3 sources"),
        (("a.bin", "b.bin", "--frames", "sbg_imu_short", "--serial", "1", "--serial", "1"),
         "was given to two instruments"),
        (("a.bin", "--frames", "chamber.toml"), "has accelerometers or gyros"),
    ],
)  # fmt: skip
def test_what_cannot_be_recorded_together(words: Any, code: str, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("chamber.toml").write_text(CHAMBER)
    for name in "abc":
        Path(f"{name}.bin").touch()
    made = run("capture", *words, "-o", "s", "--silence", "0.2 s", code=1)
    assert code in made.output.replace("\n", " ") and not (tmp_path / "s").exists()


def test_nothing_is_recorded_over_several(tmp_path: Path):
    for k in range(2):
        plugs = [plug("one", numbered(1)[:50], NUMBERED), plug("two", numbered(2)[:50], NUMBERED)]
        if not k:
            several.record(plugs, tmp_path)
            continue
        with refuses("capture.there"):
            several.record(plugs, tmp_path)


ENDLESS = """
import sys, time
from pathlib import Path
from foucault.capture import several
from foucault.capture.recording import Plug
from foucault.capture.frame import parsed
from test_several import CHAMBER, NUMBERED, Clocked, chamber, numbered
plugs = [Plug(Clocked(n, due), parsed(text, n), text) for n, due, text in
         (("imu", numbered(7), NUMBERED), ("chamber", chamber(), CHAMBER))]
several.record(plugs, Path(sys.argv[1]))
"""


@pytest.mark.thorough
def test_killed_both_are_there_up_to_the_last_second(tmp_path: Path):
    folder = tmp_path / "s"
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    killed = subprocess.Popen([sys.executable, "-c", ENDLESS, str(folder)], env=paths)
    while not (folder / "2" / recording.RAW).exists() and killed.poll() is None:
        time.sleep(0.01)
    time.sleep(2.5)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    made = run("capture", "--again", folder, "--json")
    log = campaign.read_log(campaign.load(folder / recording.CAMPAIGN))
    assert log.duration > 1.0 and log.temperature is not None, made.output


def test_a_clock_that_stood_and_one_that_began_anew():
    own = np.arange(0, 20, 0.01)
    late = np.abs(np.random.default_rng(1).normal(0, 0.002, len(own)))
    awake = (own < 12) | (own > 15)  # the computer slept for 3 s, and its clock stood
    own, late = own[awake], late[awake]
    host = 5.0 + own - np.where(own > 12, 3.0, 0.0)
    found = on_host(host + late, own)
    assert np.abs(found - host).max() < 0.002
    began = np.where(own > 12, own - 12, own)
    assert np.abs(on_host(5.0 + own + late, began) - 5.0 - own).max() < 0.002
