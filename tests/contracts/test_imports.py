"""What importing costs, and what the package promises to offer."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import foucault

HEAVY = ("numba", "pandas", "pint", "scipy", "dask", "pydantic", "pyarrow", "rich")


def _modules_after(code: str) -> set[str]:
    out = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
        env=dict(os.environ),
    )
    return {name.partition(".")[0] for name in out.stdout.split()}


@pytest.mark.parametrize(
    "code",
    [
        "import foucault",
        "import foucault; foucault.Log, foucault.Result, foucault.ImuModel, foucault.Site",
        "import foucault; foucault.FoucaultError, foucault.CoefficientVector, foucault.Verdict",
        "import foucault; dir(foucault)",
    ],
)
def test_importing_loads_nothing_heavy(code: str) -> None:
    assert not _modules_after(code) & set(HEAVY)


def test_help_loads_no_numerical_library() -> None:
    heavy = set(HEAVY) - {"rich"}
    assert not _modules_after("import foucault.cli") & heavy


def test_every_public_name_is_there() -> None:
    assert set(foucault.__all__) == set(foucault._HOMES)
    for name in foucault.__all__:
        assert getattr(foucault, name) is not None
        assert name in dir(foucault)


def test_public_names_are_the_things_themselves() -> None:
    from foucault.run_folder import load_result
    from foucault.tables import Log

    assert foucault.Log is Log
    assert foucault.load_result is load_result


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'lod_result'"):
        importlib.import_module("foucault").lod_result  # noqa: B018


def test_versions_agree() -> None:
    from importlib.metadata import version

    assert foucault.__version__ == version("foucault")


NEWER = re.compile(r"(?<!pd)\.(mT|matrix_transpose|vecdot|matvec|vecmat|concat|unstack)\b")
"""Names of NumPy that its oldest promised version has not: every call of them fails there."""


def test_nothing_asks_for_a_newer_numpy_than_is_promised() -> None:
    files = Path(foucault.__file__).parent.rglob("*.py")
    found = {file.name: NEWER.findall(file.read_text(encoding="utf-8")) for file in files}
    assert not {name: some for name, some in found.items() if some}
