"""Validations do their jobs side by side, in any number of processes and of runs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

VALIDATION = Path(__file__).parents[1] / "validation"


def halved(job: tuple[str, int]) -> float:
    """Note that a job was done; refuse zero while the folder has no `allowed`."""
    folder, k = Path(job[0]), job[1]
    if k == 0 and not (folder / "allowed").exists():
        raise ValueError(k)
    with (folder / "done").open("a") as out:
        out.write(f"{k} ")
    return k / 2


@pytest.mark.thorough
def test_results_do_not_hang_on_workers_and_a_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(VALIDATION))
    from common import each

    monkeypatch.setenv("FOUCAULT_KEEP", str(tmp_path / "kept"))
    jobs = [(str(tmp_path), k) for k in (3, 2, 1, 0)]
    with pytest.raises(ValueError, match="0"):
        list(each(halved, jobs, 1))
    (tmp_path / "allowed").touch()
    assert list(each(halved, jobs, 2)) == [1.5, 1.0, 0.5, 0.0]
    assert sorted((tmp_path / "done").read_text().split()) == ["0", "1", "2", "3"]
    sys.modules.pop("common")
