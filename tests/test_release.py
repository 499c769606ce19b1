"""What is released: a wheel, installed where nothing of the repository is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

import foucault

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Build it from a copy: a build leaves folders of its own in the tree."""
    copy = tmp_path_factory.mktemp("tree")
    shutil.copytree(
        ROOT / "src", copy / "src", ignore=shutil.ignore_patterns("*.egg-info", "*.pyc")
    )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", "dist", "."]
    subprocess.run(command, cwd=copy, check=True)
    (built,) = (copy / "dist").glob("*.whl")
    return built


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert f"foucault-{foucault.__version__}.dist-info/METADATA" in names
    source = ROOT / "src" / "foucault"
    wanted = {
        f"foucault/{p.relative_to(source).as_posix()}"
        for p in source.rglob("*")
        if p.is_file() and p.suffix != ".pyc"
    }
    assert wanted == {n for n in names if ".dist-info/" not in n}


def test_the_demo_runs_from_the_wheel(wheel, tmp_path):
    """The packages it requires are lent from here; `make release` has them installed too."""
    venv.create(tmp_path / "empty")
    paths = sysconfig.get_paths("venv", {"base": str(tmp_path / "empty")})
    Path(paths["purelib"], "lent.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    python = Path(paths["scripts"]) / Path(sys.executable).name
    install = ["install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", "--python", str(python), *install], check=True)
    alone = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    where = subprocess.run([python, "-c", "import foucault; print(foucault.__file__)"], check=True,
                           cwd=tmp_path, env=alone, capture_output=True, text=True)  # fmt: skip
    assert Path(where.stdout.strip()).is_relative_to(tmp_path / "empty")
    command = [Path(paths["scripts"]) / "foucault", "demo", "-o", "demo"]
    subprocess.run(command, cwd=tmp_path, env=alone, check=True, capture_output=True)
    assert (tmp_path / "demo" / "run" / "report.html").stat().st_size > 100_000
