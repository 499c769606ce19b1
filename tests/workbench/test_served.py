"""A workbench that is served by processes of its own: killed at any moment, it loses nothing."""

from __future__ import annotations

import json
import os
import random
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx2 as httpx
import pytest

from foucault.workbench.store import Store
from make_workbench import Served, children, log_text

KILLS = int(os.environ.get("FOUCAULT_KILLS", "8"))


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    made = Served(tmp_path, "--workers", "2")
    yield made
    made.end()


@pytest.mark.thorough  # the browser's tests begin with the same
def test_from_a_log_to_its_result_over_http(served: Served) -> None:
    log = served.api("POST", "/logs", files={"file": ("x.csv", log_text())})["log"]
    asked = {"command": "calibrate", "log": log, "options": {"latitude": "47.3 deg"}}
    number = served.api("POST", "/jobs", json=asked)["number"]
    job = served.ended(number)
    assert (job["state"], job["verdict"]) == ("done", "pass"), job["said"]
    assert {"result.json", "report.html", "campaign.toml"} <= set(job["files"])
    assert served.api("GET", f"/jobs/{number}/files/result.json")["procedure"] == "hand_rotated"
    kept = served.api("POST", f"/jobs/{number}/keep", json={"instrument": "IMU 7"})
    assert kept["instrument"] == "IMU 7"


@pytest.mark.thorough
def test_two_logs_at_once_and_two_servers_in_one_folder(served: Served) -> None:
    other = Served(served.folder, "--workers", "1")
    try:
        with ThreadPoolExecutor(6) as at_once:
            sent = [
                at_once.submit(httpx.post, f"{s.address}/api/logs", timeout=30,
                               files={"file": (f"{i % 3}.csv", b"t,a\n0,%d\n" % (i % 3))})
                for i, s in enumerate([served, other] * 6)
            ]  # fmt: skip
            answers = [one.result() for one in sent]
        assert {a.status_code for a in answers} == {201}
        assert len({a.json()["log"] for a in answers}) == 3
        log = answers[0].json()["log"]
        asked = {"command": "calibrate", "log": log}
        numbers = [s.api("POST", "/jobs", json=asked)["number"] for s in (served, other) * 2]
        assert len(set(numbers)) == 4
        assert {served.ended(n)["state"] for n in numbers} == {"failed"}  # they hold no readings
        assert {Store(served.folder).job(n).tries for n in numbers} == {1}
    finally:
        other.end()


@pytest.mark.thorough
def test_killed_at_random_moments_nothing_is_lost(tmp_path: Path) -> None:
    """Server, worker or fork, by SIGKILL: what was answered is there, what is done is whole."""
    rng = random.Random(5)
    served = Served(tmp_path, "--workers", "2")
    log = served.api("POST", "/logs", files={"file": ("x.csv", log_text())})["log"]
    numbers: list[int] = []
    try:
        for _ in range(KILLS):
            asked = {"command": "calibrate", "log": log, "options": {"latitude": "47.3 deg"}}
            if len(numbers) < max(4, KILLS // 10):
                numbers.append(served.api("POST", "/jobs", json=asked)["number"])
            time.sleep(rng.uniform(0.0, 0.5))
            there = [served.process.pid, *children(served.process.pid)]
            victim = rng.choice(there)
            if victim == served.process.pid:
                served.end(signal.SIGKILL)
                served.begin()
            else:
                try:
                    os.kill(victim, signal.SIGKILL)
                except ProcessLookupError:  # it had just ended
                    continue
        store = Store(tmp_path)
        with store.writing() as db:  # those that were killed three times were not at fault
            db.execute("UPDATE job SET state = 'waiting', tries = 0 WHERE state = 'failed' AND "
                       "code IS NULL")  # fmt: skip
        for number in numbers:
            job = served.ended(number)
            assert (job["state"], job["verdict"]) == ("done", "pass"), job
            said = json.loads((tmp_path / "runs" / str(number) / "result.json").read_text())
            assert said["verdict"]["level"] == "pass"
        with store.reading() as db:
            assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
    finally:
        served.end()
