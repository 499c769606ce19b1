"""The database: SQLite in a file, or PostgreSQL by its address, with the same tables.

`entry` is the chain and the truth; a trigger refuses to change or remove a row. The other tables
are an index that `store` makes of it and of the run folders. Schemas are changed by Alembic alone
(`migrations`); a database of an older one is brought up to date where it is opened to be written.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from foucault.errors import FoucaultError, error

try:
    import sqlalchemy as sa
    from sqlalchemy.exc import (
        ArgumentError,
        DBAPIError,
        NoSuchModuleError,
        OperationalError,
        ProgrammingError,
    )
except ImportError:
    raise error("records.library") from None

HEAD = "0001"
"""The newest schema."""

VARIABLE = "FOUCAULT_DATABASE"
"""Environment variable that names the database."""

DEFAULT = "records.sqlite"

PATIENCE = 30.0
"""So long somebody waits for another who writes [s]."""

meta = sa.MetaData()


def _texts(names: str, **more: Any) -> list[sa.Column[str]]:
    """Return columns of text, none of them ever null."""
    return [sa.Column(name, sa.Text, nullable=False, **more) for name in names.split()]


entry = sa.Table(
    "entry", meta,
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
    *_texts("made who kind body hash version"),
)  # fmt: skip

run = sa.Table(
    "run", meta,
    # the number of its entry
    sa.Column("number", sa.Integer, sa.ForeignKey("entry.number"), primary_key=True,
              autoincrement=False),
    *_texts("sha256", unique=True), *_texts("folder"), *_texts("instrument", index=True),
    # of the program that calibrated: version
    *_texts("procedure verdict reasons operator version equation gauge computed"),
    *_texts("holds", index=True),
    *_texts("dated again decision"),  # of the last review: decision; empty: none
    sa.Column("covariance", sa.LargeBinary),  # of its coefficients in order, little-endian doubles
)  # fmt: skip

coefficient = sa.Table(
    "coefficient", meta,
    sa.Column("run", sa.Integer, sa.ForeignKey("run.number"), primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("name", sa.Text, nullable=False, index=True),
    sa.Column("unit", sa.Text, nullable=False),
    sa.Column("value", sa.Double),
    sa.Column("sd", sa.Double),
    sa.Column("free", sa.Boolean, nullable=False),
)  # fmt: skip

log = sa.Table(
    "log", meta,
    sa.Column("run", sa.Integer, sa.ForeignKey("run.number"), primary_key=True),
    sa.Column("sha256", sa.Text, primary_key=True),
    sa.Column("file", sa.Text, nullable=False),
)  # fmt: skip

used = sa.Table(
    "used", meta,
    sa.Column("run", sa.Integer, sa.ForeignKey("run.number"), primary_key=True),
    sa.Column("reference", sa.Text, primary_key=True),
)  # fmt: skip

INDEX = (used, log, coefficient, run)
"""Tables that are made of the others, those first that refer to another."""


class Database:
    """A connection to the records; the schema is looked at when it is opened."""

    def __init__(self, where: str | Path | None = None, *, make: bool = False) -> None:
        """Open a file of SQLite or an address such as postgresql://host/name.

        `where`: None for that of the environment, or `DEFAULT` in this folder; `make`: whether one
        that is not there is made, and one of an older schema brought up to date. Raises
        ``records.*``.
        """
        said = str(where or os.environ.get(VARIABLE, "") or DEFAULT)
        self.file = None if "://" in said else Path(said)
        self.shown = said if self.file is not None else _without_password(said)
        if self.file is not None and not make and not self.file.is_file():
            raise error("records.none", path=self.file)
        try:
            self.engine = _engine_of(said, self.file)
        except (ArgumentError, NoSuchModuleError, ImportError, ValueError) as problem:
            raise error("records.address", given=self.shown, reason=problem) from None
        with self._said():
            self._up_to_date(make)

    @property
    def home(self) -> Path:
        """The folder as seen from which run folders are named."""
        return Path.cwd() if self.file is None else self.file.absolute().parent

    def close(self) -> None:
        """Let go of it."""
        self.engine.dispose()

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """Yield a connection that reads one state of it."""
        with self._said(), self.engine.connect() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """Yield a connection that nobody else writes beside; all of the block is kept, or none."""
        with self._said(), self.engine.connect() as connection, connection.begin():
            if self.engine.dialect.name == "postgresql":
                connection.execute(sa.text("LOCK TABLE entry IN EXCLUSIVE MODE"))
            elif self.engine.dialect.name == "sqlite":
                connection.exec_driver_sql("BEGIN IMMEDIATE")
            yield connection

    @contextmanager
    def _said(self) -> Iterator[None]:
        """Say in words what the database could not do."""
        try:
            yield
        except DBAPIError as problem:
            raise _in_words(self.shown, problem) from problem

    def _up_to_date(self, make: bool) -> None:
        with suppress(ProgrammingError, OperationalError), self.engine.connect() as connection:
            if connection.scalar(sa.text("SELECT version_num FROM alembic_version")) == HEAD:
                return
        with self.engine.connect() as connection:
            names = sa.inspect(connection).get_table_names()
            there: str | None = None
            if "alembic_version" in names:
                there = connection.scalar(sa.text("SELECT version_num FROM alembic_version"))
        if there == HEAD:
            return
        if there is None and names:
            raise error("records.other", path=self.shown, names=", ".join(sorted(names)[:4]))
        if there is not None and there > HEAD:
            raise error("records.newer", path=self.shown, there=there, known=HEAD)
        if not make:
            raise error("records.older", path=self.shown, there=there or "none", known=HEAD)
        migrate(self.engine)


def _without_password(address: str) -> str:
    try:
        return sa.engine.make_url(address).render_as_string()
    except (ArgumentError, ValueError):
        return "What was given"


def migrate(engine: sa.Engine, to: str = "head") -> None:
    """Bring a database to a schema, whole or not at all."""
    from alembic.config import Config
    from alembic.runtime.environment import EnvironmentContext
    from alembic.script import ScriptDirectory

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    config.set_main_option("path_separator", "os")
    scripts = ScriptDirectory.from_config(config)

    def steps(there: Any, _context: Any) -> Any:
        return scripts._upgrade_revs(to, there)

    with (
        engine.connect() as connection,
        EnvironmentContext(config, scripts, fn=steps, destination_rev=to) as environment,
    ):
        if engine.dialect.name == "sqlite":
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        environment.configure(connection=connection, transactional_ddl=True)
        with environment.begin_transaction():
            environment.run_migrations()
        connection.commit()


def _engine_of(said: str, file: Path | None) -> sa.Engine:
    """Return an engine, shared by all that open the same: what it has compiled serves them too.

    A file that takes the place of another is another, and a fork shares nothing.
    """
    if file is None:
        return _engine(said) if said == "sqlite://" else _shared(said, os.getpid())
    address = f"sqlite:///{file.absolute()}"
    if not file.is_file():
        return _engine(address)
    there = file.stat()
    return _shared(address, os.getpid(), there.st_dev, there.st_ino)


@lru_cache(maxsize=8)
def _shared(address: str, *which: int) -> sa.Engine:
    del which
    return _engine(address)


def _engine(address: str) -> sa.Engine:
    """Return an engine; SQLite gets its log, foreign keys and transactions that begin when told."""
    url = sa.engine.make_url(address)
    if url.drivername == "postgresql":
        url = url.set(drivername="postgresql+psycopg")
    if url.get_backend_name() not in ("sqlite", "postgresql"):
        raise ArgumentError("only SQLite and PostgreSQL are known")
    more: dict[str, Any] = {}
    if address != "sqlite://":
        more["max_overflow"] = -1  # nobody waits for a connection of another
    if url.get_backend_name() == "sqlite":
        more["connect_args"] = {"timeout": PATIENCE}
    engine = sa.create_engine(url, **more)
    if url.get_backend_name() == "sqlite":

        @sa.event.listens_for(engine, "connect")
        def prepared(connection: Any, _record: Any) -> None:
            connection.isolation_level = None  # `writing` begins transactions itself
            for line in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
                connection.execute(f"PRAGMA {line}")

    return engine


def _in_words(where: str, problem: DBAPIError) -> FoucaultError:
    said = str(problem.orig).strip().splitlines()[0] if problem.orig else str(problem)
    if "locked" in said or "timeout" in said.lower():
        return error("records.locked", path=where, seconds=f"{PATIENCE:.0f}")
    if "readonly" in said or "read-only" in said:
        return error("records.read_only", path=where)
    if ("disk" in said and "full" in said) or "No space left" in said:
        return error("records.full", path=where)
    return error("records.database", path=where, reason=said)
