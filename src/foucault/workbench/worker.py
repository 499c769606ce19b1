"""A worker: takes jobs from the queue and runs the program with their words, each in a fork.

What a log does to its reader it does to the fork alone. The libraries are loaded once, before, so
that a job begins at once.
"""

from __future__ import annotations

import ctypes
import os
import secrets
import select
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from foucault.errors import error
from foucault.kernels.ahead import LATER
from foucault.workbench.store import Job, Number, Store, hold

Tell = Callable[[float, str], None]
Run = Callable[[Sequence[str], Tell], int]
"""Run the program with these words; return how it ends."""

PAUSE = 0.05
"""Between two looks at the queue [s]."""

OFTEN = 0.25
"""How far a job is, is told no more often than every so many seconds [s]."""

MEMORY = 0.75
"""A job may have this part of the memory of the computer, that it ends no other program [1]."""

DONE = (0, 3, 4)
"""Ways in which a command ends that has done what it was asked to."""

LONGEST = 1 << 20
"""What a job says is kept up to here [byte]."""

_FIRST = (
    *LATER, "scipy.signal", "scipy.stats", "pandas", "pyarrow.csv",
    "foucault.campaign.recognised", "foucault.campaign.running",
    "foucault.procedures.hand_rotated", "foucault.diagnose.live", "foucault.report.calibration",
    "foucault.report.noise", "foucault.report.uncertainty", "foucault.workbench.look",
    "foucault.campaign.vehicle",
)  # fmt: skip
"""What most jobs load."""


def _load() -> None:
    """Load what most jobs need, compiled code and templates too: a fork has it at once."""
    for module in _FIRST:
        import_module(module)
    import numpy as np

    from foucault.kernels.moving import moving_moments
    from foucault.kernels.rotation import integrate_turns
    from foucault.report import ready

    few, none = np.zeros((4, 3)), np.empty(0, np.int64)
    moving_moments(few, 1)
    integrate_turns(np.arange(4.0), few, few, np.zeros((3, 3)), none, none, False)
    ready()


def work(folder: Path, run: Run, look: Run) -> None:
    """Work until whoever started this is gone, which ends its standard input."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    store = Store(folder)
    name = secrets.token_hex(8)
    lock = hold(folder, name)
    os.chdir(folder)
    _load()
    looked = 0.0
    try:
        while not _left_alone():
            job = store.claim(name)
            if job is not None:
                _one(store, job, look if job.command == "look" else run)
                continue
            if time.monotonic() - looked > 1.0:
                looked = time.monotonic()
                store.recover()
            select.select([sys.stdin], [], [], PAUSE)
    finally:
        with suppress(OSError):
            (folder / "workers" / name).unlink()
        os.close(lock)


def _left_alone() -> bool:
    """Tell whether standard input has come to its end."""
    ready, _, _ = select.select([sys.stdin], [], [], 0)
    return bool(ready) and not os.read(sys.stdin.fileno(), 1)


def _one(store: Store, job: Job, run: Run) -> None:
    """Run a job in a fork and keep how it ended."""
    (store.folder / "runs").mkdir(exist_ok=True)
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = _in_the_fork(store, job, run)
        finally:
            os._exit(code)
    while True:
        _until_ended(child, PAUSE)
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if store.job(job.number).state != "running":
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return
    if os.WIFSIGNALED(status):
        store.give_back(job)
        return
    code = os.WEXITSTATUS(status)
    store.end(job, "done" if code in DONE else "failed", code)


def _until_ended(child: int, most: float) -> None:
    """Wait until a process has ended, but not longer than `most` [s]."""
    try:
        held = os.pidfd_open(child)
    except (AttributeError, OSError):  # where there is no such call
        time.sleep(most)
        return
    try:
        select.select([held], [], [], most)
    finally:
        os.close(held)


def _in_the_fork(store: Store, job: Job, run: Run) -> int:
    """Run the program with what it says kept in a file; ends with its parent."""
    with suppress(OSError, AttributeError):  # where there is such a call
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    out = os.open(f"runs/{job.number}.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for number, to in ((0, nothing), (1, out), (2, out)):
        os.dup2(to, number)
    sys.stdout = os.fdopen(1, "w", encoding="utf-8", errors="replace", closefd=False)
    sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="replace", closefd=False)
    if "-o" in job.words:
        Path(job.words[job.words.index("-o") + 1]).parent.mkdir(parents=True, exist_ok=True)
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        limit = int(MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    told = [0.0]

    def tell(part: float, doing: str) -> None:
        if time.monotonic() - told[0] > OFTEN:
            told[0] = time.monotonic()
            store.tell(job, part, doing)

    try:
        code = run(job.words, tell)
    except MemoryError:
        problem = error("workbench.memory")
        print(f"error: {problem.message}\n  {problem.cure}")
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    return code


def said(folder: Path, number: Number) -> str:
    """Return what a job has said."""
    try:
        with (folder / "runs" / f"{number}.txt").open("rb") as stream:
            return stream.read(LONGEST).decode(errors="replace")
    except OSError:
        return ""
