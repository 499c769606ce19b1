"""Exported code as a user has it: compiled by a C compiler that warns of all, or imported."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

MAIN = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    double a[3], g[3], f[3], w[3];
    while (scanf("%lf %lf %lf %lf %lf %lf", a, a + 1, a + 2, g, g + 1, g + 2) == 6) {
        FUNCTION(a, g, f, w);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\n", f[0], f[1], f[2], w[0], w[1], w[2]);
    }
    return 0;
}
"""
WARNED = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2")


def run_c(folder: Path, main: str, rows: np.ndarray, *flags: str) -> np.ndarray:
    """Compile a program beside its header, and return what it makes of rows of numbers."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler on this machine")
    (folder / "main.c").write_text(main)
    built = [compiler, *WARNED, *flags, "main.c", "-o", "program", "-lm"]
    subprocess.run(built, cwd=folder, check=True)
    lines = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    program = [folder / "program"]
    out = subprocess.run(program, input=lines, capture_output=True, text=True, check=True).stdout
    return np.array([line.split() for line in out.splitlines()], float)


def load(path: Path) -> Any:
    """Import exported Python."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
