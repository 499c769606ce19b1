"""Compile on two cores what a procedure is about to call, while its log is being read.

Numba compiles one function after the other in a process, so that a second core needs a process of
its own: a copy of one that has loaded all that numba needs, where the system makes copies. What is
compiled is in the cache when the first call looks there. Nothing hangs on it: what is missing from
`ahead.toml`, or is wrong there, is compiled by the call. ``tests/make_ahead.py`` writes the table
from what a session of each procedure compiled.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
from numba.core.registry import cpu_target
from numba.core.sigutils import normalize_signature

from foucault.kernels import cache_folder

TABLE = Path(__file__).with_name("ahead.toml")
ROOT = Path(__file__).resolve().parents[2]

NORTH = "north"
"""What finds north of set-ups, in the table beside the procedures."""

LATER = (
    "scipy.optimize", "scipy.special", "scipy.fft", "scipy.linalg", "pyarrow.parquet",
    "rich.console", "rich.table", "jinja2", "foucault.result_document", "foucault.report",
    "foucault.report.evidence", "foucault.report.seen", "foucault.report.still",
)  # fmt: skip
"""What every calibration loads after its log: there is time for it while others compile."""

_begun: dict[str, list[subprocess.Popen[bytes]]] = {}


def table() -> dict[str, Any]:
    """Return two lists of kernels for each procedure, `lanes`, and their `signatures`."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def missing(lane: list[str], folder: Path) -> bool:
    """Say whether a kernel of a lane is not in the cache of this Python."""
    python = f".py{sys.version_info[0]}{sys.version_info[1]}.nbi"
    there = {file.name.split("-")[0] for file in folder.rglob("*" + python)}
    return not there.issuperset(lane)


def begin(campaign: Path) -> None:
    """Start to compile for what seems to be a campaign's file, before it is read in earnest."""
    try:
        procedure = str(tomllib.loads(campaign.read_text(encoding="utf-8"))["procedure"]["name"])
    except (OSError, ValueError, LookupError, TypeError, RecursionError):  # its reader says so
        return
    _begun[procedure] = started = _start(procedure)
    atexit.register(_end, started)  # should nothing be calibrated


def _end(started: list[subprocess.Popen[bytes]]) -> None:
    for process in started:
        process.kill()
        process.wait()


def _start(procedure: str) -> list[subprocess.Popen[bytes]]:
    """Start what compiles for `procedure` that the cache has not got."""
    lanes = [] if numba.config.DISABLE_JIT else table()["lanes"].get(procedure, [])
    folder = cache_folder()
    started: list[subprocess.Popen[bytes]] = []
    if lanes and (os.cpu_count() or 1) > 1 and any(missing(lane, folder) for lane in lanes):
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        numbers = [str(at) for at in range(len(lanes))]
        for some in [numbers] if hasattr(os, "fork") else [[at] for at in numbers]:
            command = [sys.executable, "-P", "-m", "foucault.kernels.ahead", procedure, *some]
            try:
                started.append(
                    subprocess.Popen(
                        command,
                        env=os.environ | {"PYTHONPATH": path},
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.DEVNULL,
                    )
                )
            except OSError:  # no further process here: the call compiles
                break
    return started


@contextmanager
def compiling(procedure: str, tell: Callable[[float, str], None]) -> Iterator[None]:
    """Compile the kernels of `procedure`, where the cache has not got them, during the block.

    It ends when they are compiled: both at it would be twice the work. `tell` is told so.
    """
    started = _begun.pop(procedure) if procedure in _begun else _start(procedure)
    try:
        yield
        if started:
            tell(1.0, "compiling, this first time only")
            for module in LATER:
                importlib.import_module(module)
        for process in started:
            process.wait()
    finally:
        _end(started)


def compile_lanes(procedure: str, numbers: list[int]) -> None:
    """Compile one lane of kernels for `procedure`, or two: the second in a copy of this process.

    What numba loads in order to compile is loaded once so. `numbers`: of the lanes [1].
    """
    gc.disable()  # a tenth of the time, in a process that ends with this
    found = table()
    lanes = [found["lanes"][procedure][at] for at in numbers]
    kernels = {}
    for name in (name for lane in lanes for name in lane):
        module, function = name.split(".")
        kernels[name] = getattr(importlib.import_module(f"foucault.kernels.{module}"), function)
    original, copy = os.getpid(), None
    if len(lanes) > 1:
        cpu_target.target_context.refresh()
        copy = os.fork()
    for name in lanes[-1 if copy == 0 else 0]:
        if copy == 0 and os.getppid() != original:  # that was stopped
            return
        for signature in found["signatures"][name]:
            kernels[name].compile(normalize_signature(signature)[0])
    if copy:
        os.waitpid(copy, 0)


if __name__ == "__main__":
    compile_lanes(sys.argv[1], [int(at) for at in sys.argv[2:]])
