"""A workbench that is served: its folder, its workers, and the server."""

from __future__ import annotations

import ipaddress
import os
import re
import socket
import subprocess
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import uvicorn

from foucault.errors import error
from foucault.files import make_folder
from foucault.workbench.asked import OFFERS, Option
from foucault.workbench.bench import templates
from foucault.workbench.people import People
from foucault.workbench.store import Store
from foucault.workbench.web import Bench, application

RECORDS = "records.sqlite"

OFTEN = 0.5
"""Workers are looked after every so many seconds [s]."""


def made(folder: Path) -> Path:
    """Return the folder of a workbench, made where it is not there."""
    where = make_folder(folder).resolve()
    for name in ("logs", "runs"):
        make_folder(where / name)
    return where


def add_account(folder: Path, name: str, role: str, password: str, database: str | None) -> None:
    """Make an account, or change one; the journal of the records says who did."""
    bench = Bench(Store(folder), database or str(folder / RECORDS), lambda _: [])
    bench.people.add(name, role, password, bench.told(""))


def loopback(host: str) -> bool:
    """Tell whether an address can be reached from this computer alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Crew:
    """Workers that are started again when they die, and end with this process."""

    def __init__(self, command: Sequence[str], count: int) -> None:
        """Start `count`: so many [1] processes by a command."""
        self.command, self.ending = list(command), threading.Event()
        self.there = [self._begun() for _ in range(count)]
        self.watch = threading.Thread(target=self._look_after, daemon=True)
        self.watch.start()

    def _begun(self) -> subprocess.Popen[bytes]:
        # A worker ends when its standard input does, which the system closes with this process.
        return subprocess.Popen(
            self.command, stdin=subprocess.PIPE, start_new_session=True,
            env={**os.environ, "FOUCAULT_WORKER": "yes"},
        )  # fmt: skip

    def _look_after(self) -> None:
        while not self.ending.wait(OFTEN):
            for k, one in enumerate(self.there):
                if one.poll() is not None and not self.ending.is_set():
                    self.there[k] = self._begun()

    def end(self) -> None:
        """End the workers; what they were at is begun again by the next."""
        self.ending.set()
        self.watch.join()
        for one in self.there:
            one.terminate()
        for one in self.there:
            with suppress(subprocess.TimeoutExpired):
                one.wait(5)
            one.kill()


def _ahead(bench: Bench) -> None:
    """Load what pages need when they are opened first: nobody then waits for it."""
    from foucault.procedures import PROCEDURES, load

    for name in ("foucault.records.history", "foucault.records.shown", "scipy.optimize",
                 "scipy.stats", "foucault.result_document", "foucault.report.page",
                 "foucault.campaign.tables"):  # fmt: skip
        import_module(name)
    for name in PROCEDURES:
        load(name)
    for name in OFFERS:
        bench.options(name)
    for name in templates().list_templates():
        templates().get_template(name)


def serve(
    folder: Path, host: str, port: int, database: str | None, workers: int,
    worker: Sequence[str], options: Callable[[str], list[Option]],
    say: Callable[[str], None], prefix: str = "",
) -> None:  # fmt: skip
    """Serve a workbench until it is interrupted.

    `port`: to listen at [1]; `workers`: jobs at a time [1]; `prefix`: of the paths of its pages,
    which a proxy takes off. Raises ``workbench.accounts``, ``workbench.port``,
    ``workbench.prefix``.
    """
    below = "/" + prefix.strip("/") if prefix.strip("/") else ""
    if not re.fullmatch(r"(/\w[\w.-]*)*", below, re.ASCII):
        raise error("workbench.prefix", given=prefix)
    store = Store(folder)
    open_to_others = not loopback(host)
    if open_to_others and not People(store).any():
        raise error("workbench.accounts", host=host, folder=folder)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(2048)  # whoever comes before all is loaded waits and is not refused
    except OSError as problem:
        listening.close()
        raise error("workbench.port", host=host, port=port, reason=problem.strerror) from None
    bench = Bench(store, database or str(folder / RECORDS), options, open_to_others,
                  below)  # fmt: skip
    crew = Crew(worker, workers)
    threading.Thread(target=_ahead, args=(bench,), daemon=True).start()
    shown = f"[{host}]" if ":" in host else host
    say(f"The workbench is at http://{shown}:{listening.getsockname()[1]}/ until Ctrl-C.")
    try:
        config = uvicorn.Config(
            application(bench), log_level="warning", server_header=False, timeout_keep_alive=30,
            proxy_headers=True, timeout_graceful_shutdown=3,
            forwarded_allow_ips=os.environ.get("FORWARDED_ALLOW_IPS", "127.0.0.1"),
        )  # fmt: skip
        uvicorn.Server(config).run(sockets=[listening])
    finally:
        crew.end()
        listening.close()
