"""What is released: an sdist that holds the source, and a wheel that runs where nothing else is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

import foucault

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.thorough
FOLDERS = ("benchmarks", "design", "docs", "examples", "src", "tests", "validation")
FILES = ("CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "MANIFEST.in", "Makefile",
         "README.md", "SECURITY.md", "constraints.txt", "pyproject.toml")  # fmt: skip
MADE = shutil.ignore_patterns("*.egg-info", "*.py[co]", "__pycache__", ".*")
BUILD = "import sys, setuptools.build_meta as b; b.build_sdist('dist'); b.build_wheel('dist')"


@pytest.fixture(scope="module")
def dist(tmp_path_factory) -> Path:
    """Build both from a copy: a build leaves folders of its own in the tree."""
    copy = tmp_path_factory.mktemp("tree")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, copy / name, ignore=MADE)
    for name in FILES:
        shutil.copy(ROOT / name, copy)
    subprocess.run([sys.executable, "-c", BUILD], cwd=copy, check=True, capture_output=True)
    return copy / "dist"


@pytest.fixture(scope="module")
def wheel(dist) -> Path:
    """Find the wheel."""
    (built,) = dist.glob("*.whl")
    return built


def test_the_sdist_holds_the_source_and_no_large_file(dist):
    with tarfile.open(dist / f"foucault-{foucault.__version__}.tar.gz") as packed:
        held = {m.name.partition("/")[2]: m.size for m in packed if m.isfile()}
    wanted = {
        str(p.relative_to(dist.parent).as_posix())
        for name in FOLDERS
        for p in (dist.parent / name).rglob("*")
        if p.is_file() and ".egg-info" not in str(p)
    }
    made = {name for name in held if "egg-info" in name} | {"PKG-INFO", "setup.cfg"}
    assert set(held) - made == wanted | set(FILES)
    assert max(held.values()) < 1_000_000


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        about = packed.read(f"foucault-{foucault.__version__}.dist-info/METADATA").decode()
    source = ROOT / "src" / "foucault"
    wanted = {
        f"foucault/{p.relative_to(source).as_posix()}"
        for p in source.rglob("*")
        if p.is_file() and p.suffix != ".pyc"
    }
    assert wanted == {n for n in names if ".dist-info/" not in n}
    assert "foucault/py.typed" in names
    kept = {n.split(".dist-info/licenses/")[1] for n in names if ".dist-info/licenses/" in n}
    schemas = "src/foucault/certificate/schemas"
    assert kept >= {"LICENSE", "src/foucault/workbench/static/htmx.LICENSE"}
    assert any(n.startswith(f"{schemas}/COPYING") for n in kept)
    assert f"\nVersion: {foucault.__version__}\n" in about
    assert "\nLicense-Expression: Apache-2.0 AND LGPL-3.0-only AND 0BSD AND MIT\n" in about
    assert about.endswith((ROOT / "README.md").read_text(encoding="utf-8"))


def test_the_demo_runs_from_the_wheel(wheel, tmp_path):
    """The packages it requires are lent from here; `make release` has them installed too."""
    venv.create(tmp_path / "empty")
    paths = sysconfig.get_paths("venv", {"base": str(tmp_path / "empty")})
    python = Path(paths["scripts"]) / Path(sys.executable).name
    alone = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    install = ["install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", "--python", str(python), *install], check=True,
                   env=alone)  # fmt: skip
    Path(paths["purelib"], "lent.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    where = subprocess.run([python, "-c", "import foucault; print(foucault.__file__)"], check=True,
                           cwd=tmp_path, env=alone, capture_output=True, text=True)  # fmt: skip
    assert Path(where.stdout.strip()).is_relative_to(tmp_path / "empty")
    command = [Path(paths["scripts"]) / "foucault", "demo", "-o", "demo"]
    subprocess.run(command, cwd=tmp_path, env=alone, check=True, capture_output=True)
    assert (tmp_path / "demo" / "run" / "report.html").stat().st_size > 100_000
