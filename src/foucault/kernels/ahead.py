"""Compile on two cores what a procedure is about to call, while its log is being read.

Numba compiles one function after the other in a process, so that a second core needs a process of
its own. What it compiles is in the cache when the first call looks there. Nothing hangs on it: what
is missing from `ahead.toml`, or is wrong there, is compiled by the call. ``tests/make_ahead.py``
writes the table from what a session of each procedure compiled.
"""

from __future__ import annotations

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
from numba.core.sigutils import normalize_signature

from foucault.kernels import cache_folder

TABLE = Path(__file__).with_name("ahead.toml")
ROOT = Path(__file__).resolve().parents[2]


def table() -> dict[str, Any]:
    """Return two lists of kernels for each procedure, `lanes`, and their `signatures`."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def missing(lane: list[str], folder: Path) -> bool:
    """Say whether a kernel of a lane is not in the cache of this Python."""
    python = f".py{sys.version_info[0]}{sys.version_info[1]}.nbi"
    there = {file.name.split("-")[0] for file in folder.rglob("*" + python)}
    return not there.issuperset(lane)


@contextmanager
def compiling(procedure: str, tell: Callable[[float, str], None]) -> Iterator[None]:
    """Compile the kernels of `procedure`, where the cache has not got them, during the block.

    It ends when they are compiled: both at it would be twice the work. `tell` is told so.
    """
    lanes = [] if numba.config.DISABLE_JIT else table()["lanes"].get(procedure, [])
    folder = cache_folder()
    started = []
    if lanes and (os.cpu_count() or 1) > 1 and any(missing(lane, folder) for lane in lanes):
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        for at in range(len(lanes)):
            command = [sys.executable, "-P", "-m", "foucault.kernels.ahead", procedure, str(at)]
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
    try:
        yield
        if started:
            tell(1.0, "compiling, this first time only")
        for process in started:
            process.wait()
    finally:
        for process in started:
            process.kill()
            process.wait()


def compile_lane(procedure: str, at: int) -> None:
    """Compile one lane of kernels for `procedure`; `at`: number of the lane [1]."""
    gc.disable()  # a tenth of the time, in a process that ends with this
    found = table()
    for name in found["lanes"][procedure][at]:
        module, function = name.split(".")
        kernel = getattr(importlib.import_module(f"foucault.kernels.{module}"), function)
        for signature in found["signatures"][name]:
            kernel.compile(normalize_signature(signature)[0])


if __name__ == "__main__":
    compile_lane(sys.argv[1], int(sys.argv[2]))
