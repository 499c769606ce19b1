"""A workbench in a folder: served by a process of its own, or as an application in this one."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import chdir, suppress
from functools import partial
from pathlib import Path
from typing import Any

import httpx2 as httpx
import typer.main
from starlette.testclient import TestClient

import commands
import make_bare
from foucault.cli.app import app
from foucault.cli.serve import options_of, run
from foucault.workbench import worker
from foucault.workbench.bench import Bench
from foucault.workbench.look import look
from foucault.workbench.serving import made
from foucault.workbench.store import Job, Store
from foucault.workbench.web import application

PROGRAM: Any = typer.main.get_command(app)

PASSWORD = "quiet granite bench 7"


def make_bench(folder: Path, **more: Any) -> Bench:
    """Return a workbench in a folder."""
    options = partial(options_of, PROGRAM)
    return Bench(Store(made(folder)), str(folder / "records.sqlite"), options, **more)


def children(of: int) -> list[int]:
    """Return the processes that a process has begun, and theirs."""
    out = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, ValueError):
                continue
            if parent == of:
                out += [int(entry.name), *children(int(entry.name))]
    return out


def client(bench: Bench) -> TestClient:
    """Return a browser without a script, on this computer."""
    return TestClient(application(bench), base_url="http://127.0.0.1:8400")


def mark(browser: Any, page: str = "/login") -> str:
    """Return what a form of a page holds to be one of ours."""
    return re.search(r'name="mark" value="(\w+)"', browser.get(page).text)[1]


def post(browser: Any, to: str, data: dict[str, Any] | None = None, **more: Any) -> Any:
    """Send a form as its page would."""
    return browser.post(to, data={"mark": mark(browser), **(data or {})}, **more)


def log_text(seed: int = 1) -> bytes:
    """Return a log of a telephone that is turned by hand."""
    return make_bare.phyphox(make_bare.Columns.of(make_bare.truth(seed))).encode()


def work_off(bench: Bench) -> list[Job]:
    """Do the jobs that wait, in this process as a worker would; returns them as they ended."""
    before, done = Path.cwd(), []
    os.chdir(bench.folder)
    name = "here"
    lock = worker.hold(bench.folder, name)
    try:
        while (job := bench.store.claim(name)) is not None:
            worker._one(bench.store, job, look if job.command == "look" else partial(run, PROGRAM))
            done.append(bench.store.job(job.number))
    finally:
        os.close(lock)
        os.chdir(before)
    return done


def by_itself(words: Iterable[str], folder: Path) -> None:
    """Run a line of the command line in a folder, without the workbench."""
    with chdir(folder):
        commands.run(*words, code=0)


class Served:
    """A workbench that `foucault serve` serves."""

    def __init__(self, folder: Path, *words: str) -> None:
        """Start it and wait until it answers."""
        self.folder, self.words = folder, words
        self.begin()

    def begin(self) -> None:
        line = [sys.executable, "-m", "foucault", "serve", str(self.folder), "--port", "0"]
        self.process = subprocess.Popen(
            [*line, *self.words], stdout=subprocess.PIPE, text=True, start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        said = self.process.stdout.readline()
        self.address = re.search(r"http://[\w.:]+", said)[0]
        host, port = self.address.removeprefix("http://").split(":")
        for _ in range(600):  # what pages need is loaded after the address is said
            with suppress(OSError), socket.create_connection((host, int(port))):
                return
            time.sleep(0.05)
        raise AssertionError(f"{self.address} does not answer")

    def end(self, how: int = signal.SIGTERM) -> None:
        self.process.send_signal(how)
        self.process.wait(20)
        self.process.stdout.close()

    def api(self, method: str, path: str, **more: Any) -> Any:
        return httpx.request(method, f"{self.address}/api{path}", timeout=30, **more).json()

    def ended(self, number: int, within: float = 60.0) -> dict[str, Any]:
        """Wait until a job is over."""
        limit = time.monotonic() + within
        while time.monotonic() < limit:
            job = self.api("GET", f"/jobs/{number}")
            if job["state"] in ("done", "failed", "stopped"):
                return job
            time.sleep(0.05)
        raise AssertionError(f"job {number} is {job}")
