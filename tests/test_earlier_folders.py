"""Folders of every kind that version 1.0 has written stay readable."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from foucault.cli import screen
from foucault.cli.screen import found_in
from foucault.errors import FoucaultError
from foucault.run_folder import KINDS, kind_of, read

OLD = Path(__file__).parent / "data" / "folders_v1.zip"
"""One small folder of each kind, without its page."""

RECORDED = [kind for kind in KINDS if kind != "result"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("old")
    with zipfile.ZipFile(OLD) as archive:
        archive.extractall(folder)
    return folder


@pytest.mark.parametrize("kind", RECORDED)
def test_its_kind_is_told_and_its_page_is_made(folders: Path, kind: str) -> None:
    folder = folders / kind
    assert kind_of(folder) == kind
    assert json.loads((folder / KINDS[kind].file).read_text())["schema"] == KINDS[kind].schema
    assert found_in(folder).page().read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize("kind", RECORDED)
def test_every_table_is_held_against_its_hash(folders: Path, kind: str) -> None:
    held = read(folders / kind, kind)
    listed = [name for name in held.about.get("files", {}) if name.endswith(".parquet")]
    assert sorted(held.tables) == sorted(Path(name).stem for name in listed)
    for name in listed:
        file = folders / kind / name
        whole = file.read_bytes()
        file.write_bytes(whole[:-1])
        with pytest.raises(FoucaultError, match=f"Table '{file.stem}'.* is not the one"):
            read(folders / kind, kind)
        file.write_bytes(whole)


def test_a_folder_that_tells_nothing_is_to_hold_a_result(tmp_path: Path) -> None:
    assert set(screen.KINDS) == set(KINDS)
    assert kind_of(tmp_path) == "result"
