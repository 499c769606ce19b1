"""Time the workbench: a log to its verdict, many runs, many users, kills; write WORKBENCH.md.

Every part serves `foucault serve` as it is, by processes of its own. CPU is that of the server, its
workers and their forks; wall time means something only on a machine that does nothing else, so the
load is printed with it.

Run: python benchmarks/workbench.py [drop | runs | users | kills] [COUNT]
"""

from __future__ import annotations

import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2 as httpx
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import make_kills
from make_workbench import children

HERE = Path(__file__).parent
COMMAND = [sys.executable, "-m", "foucault"]


class Served:
    """A workbench of its own."""

    def __init__(self, folder: Path, workers: int = 2) -> None:
        self.folder, self.workers, self.cpu = folder, workers, 0.0
        self.begin()

    def begin(self) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, "serve", str(self.folder), "--port", "0", "--workers", str(self.workers)],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        self.address = re.search(r"http://[\w.:]+", self.process.stdout.readline())[0]

    def end(self, how: int = signal.SIGTERM) -> None:
        self.process.send_signal(how)
        self.process.wait(30)
        self.process.stdout.close()

    def api(self, method: str, path: str, **more: Any) -> Any:
        return httpx.request(method, f"{self.address}/api{path}", timeout=120, **more).json()

    def ended(self, number: int) -> dict[str, Any]:
        while True:
            try:
                job = self.api("GET", f"/jobs/{number}")
            except (httpx.HTTPError, OSError):
                time.sleep(0.1)
                continue
            if job["state"] in ("done", "failed", "stopped"):
                return job
            time.sleep(0.03)

    def used(self) -> float:
        """CPU of the server and all its children so far, those that have ended too [s]."""
        tick, total = os.sysconf("SC_CLK_TCK"), 0
        for pid in (self.process.pid, *children(self.process.pid)):
            try:
                parts = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            total += sum(map(int, parts[11:15]))
        return total / tick


def log_of(rows: int, folder: Path) -> Path:
    """Write a log of hand-held rests and turns with so many rows, as a telephone does."""
    file = folder / f"walk_{rows}.csv"
    if file.exists():
        return file
    campaign = folder / "hand.toml"
    subprocess.run([*COMMAND, "-q", "init", "hand_rotated", "-o", str(campaign)], check=True)
    text = campaign.read_text()
    count = 40 if rows > 20_000 else 14
    per = rows / 100.0 / count  # a rest and a turn [s]
    said = {"rests": str(count), "rest_time": f'"{per - 2:.2f} s"', "rate": '"100 Hz"'}
    for key, value in said.items():
        text = re.sub(rf"(?m)^#? ?{key} = .*$", f"{key} = {value}", text)
    campaign.write_text(text)
    subprocess.run([*COMMAND, "-q", "simulate", str(campaign), "-o", str(folder / "session")],
                   check=True)  # fmt: skip
    import pandas as pd

    table = pd.read_csv(folder / "session" / "log.csv", comment="#").to_numpy()[:, :7]
    while len(table) < rows:  # the end at rest goes on
        more = table[-min(len(table), rows - len(table)) :].copy()
        more[:, 0] += table[-1, 0] - more[0, 0] + 0.01
        table = np.vstack([table, more])
    head = "Time (s)," + ",".join(
        f"{what} {axis} ({unit})" for what, unit in (("Gyroscope", "rad/s"),
                                                     ("Acceleration", "m/s^2")) for axis in "xyz"
    )  # fmt: skip
    np.savetxt(file, table[:rows], fmt="%.9e", delimiter=",", header=head, comments="")
    return file


def drop(count: int = 5) -> list[str]:
    """From the drop to the verdict of a log of 50,000 rows; at most 4 s are asked."""
    with tempfile.TemporaryDirectory() as home:
        file = log_of(50_000, Path(home))
        served = Served(Path(home) / "bench", 1)
        walls, cpus = [], []
        for k in range(count + 1):  # the first one warms the reader
            data = file.read_bytes() + b"\n" * k  # another log each time
            before, began = served.used(), time.perf_counter()
            browser = httpx.Client(base_url=served.address, timeout=120, follow_redirects=True)
            mark = re.search(r'name="mark" value="(\w+)"', browser.get("/").text)[1]
            page = browser.post("/logs", data={"mark": mark}, files={"file": ("walk.csv", data)})
            while "What it was taken for" not in page.text:
                assert "could not be looked at" not in page.text, page.text
                time.sleep(0.05)
                page = browser.get(page.url.path)
            looked = time.perf_counter() - began
            asked = {"mark": mark, "log": page.url.path.split("/")[-1], "--latitude": "47.3 deg"}
            page = browser.post("/do/calibrate", data=asked)
            while "Keep in the records" not in page.text:
                assert '"big">Failed' not in page.text, page.text
                time.sleep(0.05)
                page = browser.get(page.url.path)
            walls.append((time.perf_counter() - began, looked))
            cpus.append(served.used() - before)
        served.end()
    best = min(walls[1:])
    return [
        f"| drop to verdict, 50,000 rows | 4 s | {best[0]:.2f} s wall ({best[1]:.2f} s of it to "
        f"what it was taken for), {min(cpus[1:]):.2f} s CPU; first one {walls[0][0]:.2f} s wall, "
        f"{cpus[0]:.2f} s CPU |"
    ]


def many_runs(home: Path, count: int, instruments: int) -> None:
    """Write run folders of instruments, by one result with other serials, values and days."""
    words = ["calibrate", str(log_of(6_000, home)), "--latitude", "47.3 deg"]
    subprocess.run([*COMMAND, "-q", *words, "-o", str(home / "first")], check=False)
    whole = json.loads((home / "first" / "result.json").read_text())
    rng = np.random.default_rng(1)
    values = [(c["value"], c["sd"] or 0.0) for c in whole["coefficients"]]
    for k in range(count):
        of = k % instruments
        whole["instrument"] = {"name": "IMU", "serial": f"{of:04d}"}
        day = np.datetime64("2015-01-01") + (k // instruments) * (3650 // (count // instruments))
        whole["provenance"]["created"] = f"{day}T00:00:{k % 60:02d}+00:00"
        whole["provenance"]["input"]["sha256"] = f"{k:064x}"
        for c, (value, sd) in zip(whole["coefficients"], values, strict=True):
            c["value"] = value + sd * float(rng.normal())
        folder = home / "bench" / "archive" / f"{k:05d}"
        folder.mkdir(parents=True)
        (folder / "result.json").write_text(json.dumps(whole))


def runs(count: int = 10_000) -> list[str]:
    """Index many runs and look at an instrument; .3 s a page are asked."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        many_runs(home, count, 500)
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run([*COMMAND, "-q", "records", "add", "--below", "archive", "--database",
                        "records.sqlite"], cwd=home / "bench", check=True)  # fmt: skip
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        out = [f"| {count:,} runs indexed | | {wall:.1f} s wall, {cpu:.1f} s CPU |"]
        served = Served(home / "bench", 1)
        for what, path, asked in (("page of an instrument, never opened",
                                   "/instrument?name=IMU+{:04d}", ".3 s"),
                                  ("page of an instrument, again", "/instrument?name=IMU+0000",
                                   ".3 s"),
                                  ("page of all instruments", "/instruments", ""),
                                  ("page of what is due", "/due", "")):  # fmt: skip
            taken = []
            for k in range(12):
                used, began = served.used(), time.perf_counter()
                answer = httpx.get(served.address + path.format(k), timeout=60)
                assert answer.status_code == 200
                taken.append((time.perf_counter() - began, served.used() - used))
            best = min(taken[1:])
            cpu = min(t[1] for t in taken[1:])
            out.append(f"| {what}, {count:,} runs | {asked} | {best[0]:.2f} s wall, {cpu:.2f} s "
                       f"CPU; first {taken[0][0]:.2f} s |")  # fmt: skip
        served.end()
    return out


def users(count: int = 50) -> list[str]:
    """Let many users click through the pages for half a minute: 99 % under 1 s are asked."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        many_runs(home, 200, 20)
        subprocess.run([*COMMAND, "-q", "records", "add", "--below", "archive", "--database",
                        "records.sqlite"], cwd=home / "bench", check=True)  # fmt: skip
        served = Served(home / "bench", 2)
        file = log_of(6_000, home)
        log = served.api("POST", "/logs", files={"file": file.read_bytes()})["log"]
        job = {"command": "calibrate", "log": log, "options": {"latitude": "47.3 deg"}}
        served.ended(served.api("POST", "/jobs", json=job)["number"])
        paths = ["/", "/jobs", "/jobs/1", "/instruments", "/instrument?name=IMU+0007", "/due",
                 "/plan", f"/logs/{log}", f"/do/calibrate?log={log}", "/journal"]  # fmt: skip
        taken: list[float] = []
        wrong: list[str] = []
        # A client takes a while to make, which is no time of the server's.
        browsers = [httpx.Client(base_url=served.address, timeout=60, verify=False)
                    for _ in range(count)]  # fmt: skip

        def one(seed: int) -> None:
            rng = random.Random(seed)
            with browsers[seed] as browser:
                while time.monotonic() < until:
                    path, began = rng.choice(paths), time.perf_counter()
                    status = browser.get(path).status_code
                    taken.append(time.perf_counter() - began)
                    if status != 200:
                        wrong.append(f"{path} {status}")
                    time.sleep(rng.uniform(1.0, 5.0))  # somebody reads

        used, until = served.used(), time.monotonic() + 30.0
        threads = [threading.Thread(target=one, args=(k,)) for k in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        cpu = served.used() - used
        served.end()
    some = np.percentile(taken, [50, 99])
    return [
        f"| {count} users clicking for 30 s, {len(taken)} pages | 99 % under 1 s, no error | half "
        f"in {some[0]:.2f} s, 99 % in {some[1]:.2f} s, the slowest {max(taken):.2f} s; "
        f"{len(wrong)} errors; {1000 * cpu / len(taken):.0f} ms CPU a page |"
    ]


def kills(count: int = 200) -> list[str]:
    """Kill server, worker or fork at random moments while runs are calibrated and kept."""
    rng = random.Random(7)
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        file = log_of(6_000, home)
        served = Served(home / "bench", 2)
        log = served.api("POST", "/logs", files={"file": file.read_bytes()})["log"]
        job = {"command": "calibrate", "log": log, "options": {"latitude": "47.3 deg"}}
        first = served.api("POST", "/jobs", json=job)["number"]
        served.ended(first)
        served.api("POST", f"/jobs/{first}/keep", json={"instrument": "IMU", "date": "2026-01-01"})
        answered: list[int] = []
        said: dict[str, int] = {"server": 0, "worker": 0, "fork": 0, "records": 0}
        named: set[str] = set()
        for k in range(count):
            if len(answered) < max(5, count // 5) and rng.random() < 0.6:
                answered.append(served.api("POST", "/jobs", json=job)["number"])
            time.sleep(rng.uniform(0.0, 0.4))
            what = rng.choice(["server", "worker", "fork", "records"])
            if what == "server":
                served.end(signal.SIGKILL)
                served.begin()
            elif what == "records":  # who writes into the database is killed in the middle of it
                writer = make_kills.Writer(home / "bench" / "records.sqlite", f"w{k}")
                time.sleep(rng.uniform(0.0, 0.05))
                named |= writer.ended()[0]
            else:
                own = children(served.process.pid)
                workers = [p for p in own if children(p)] if what == "fork" else own
                pool = [f for w in workers for f in children(w)] if what == "fork" else own
                try:
                    os.kill(rng.choice(pool or own), signal.SIGKILL)
                except (ProcessLookupError, IndexError):
                    continue
            said[what] += 1
        from foucault.records import Records
        from foucault.workbench.store import Store

        store = Store(home / "bench")
        with store.writing() as db:  # killed three times, they were not at fault
            again = db.execute("UPDATE job SET state = 'waiting', tries = 0 WHERE state = 'failed' "
                               "AND code IS NULL").rowcount  # fmt: skip
        for number in answered:
            ended = served.ended(number)
            assert ended["state"] == "done" and ended["verdict"], ended
            whole = json.loads((home / "bench" / "runs" / str(number) / "result.json").read_text())
            assert whole["verdict"]["level"] == ended["verdict"]
        with store.reading() as db:
            assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        records = Records(home / "bench" / "records.sqlite")
        assert not records.audit() and named <= set(records.references())
        records.close()
        served.end()
    kinds = ", ".join(f"{n} of {what}" for what, n in said.items())
    return [
        f"| {sum(said.values())} kills ({kinds}) | nothing lost | {len(answered)} jobs that were "
        f"answered all done and whole ({again} had been killed three times), {len(named)} entries "
        "that were answered all there, audit without a fault |",
        *database_kills(count),
    ]


def database_kills(count: int) -> list[str]:
    """Kill writers in the middle of commits, and the server of PostgreSQL under them."""
    with tempfile.TemporaryDirectory() as name:
        wrote = make_kills.writers_killed(Path(name) / "records.sqlite", count)
    with tempfile.TemporaryDirectory() as name, make_kills.postgres(Path(name) / "pg") as served:
        some = max(2, count // 8)
        told = make_kills.servers_killed(served, some)
    return [
        f"| {count} writers into a file killed in the middle of commits of "
        f"{1e3 * wrote['commit']:.0f} ms | nothing lost | {wrote['answered']} entries that were "
        f"answered all there, {wrote['unanswered']} more that were kept and not yet answered, "
        "audit after each without a fault |",
        f"| {some} kills of a PostgreSQL server under two writers | nothing lost | "
        f"{told['answered']} entries that were answered all there, {told['words']} of {2 * some} "
        "writers told in words, audit after each without a fault |",
    ]


PARTS: dict[str, Callable[..., list[str]]] = {
    "drop": drop, "runs": runs, "users": users, "kills": kills,
}  # fmt: skip


def main() -> None:
    """Write the table, or print the rows of one part."""
    load = os.getloadavg()[0]
    if sys.argv[1:]:
        print("\n".join(PARTS[sys.argv[1]](*map(int, sys.argv[2:3]))))
        print(f"load {load:.1f} before, {os.getloadavg()[0]:.1f} after, {os.cpu_count()} cores")
        return
    rows = [line for part in PARTS.values() for line in part()]
    text = (
        "# Speed of the workbench\n\nBy `python benchmarks/workbench.py`; load "
        f"{load:.1f} before and {os.getloadavg()[0]:.1f} after, on {os.cpu_count()} cores.\n\n"
        "| what | asked | measured |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    )
    (HERE / "WORKBENCH.md").write_text(text)


if __name__ == "__main__":
    main()
