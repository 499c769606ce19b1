"""The first schema."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

_NO = "entries are never changed or removed"


def upgrade() -> None:
    """Make the tables, and the triggers that keep entries as they are."""
    op.create_table(
        "entry",
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        *(
            sa.Column(name, sa.Text, nullable=False)
            for name in ("made", "who", "kind", "body", "hash", "version")
        ),
    )
    texts = (
        "sha256 folder instrument procedure verdict reasons operator version equation gauge "
        "computed holds dated again decision"
    )
    op.create_table(
        "run",
        sa.Column("number", sa.Integer, sa.ForeignKey("entry.number"), primary_key=True,
                  autoincrement=False),
        *(sa.Column(n, sa.Text, nullable=False, unique=n == "sha256") for n in texts.split()),
        sa.Column("covariance", sa.LargeBinary),
    )  # fmt: skip
    op.create_table(
        "coefficient",
        sa.Column("run", sa.Integer, sa.ForeignKey("run.number"), primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("unit", sa.Text, nullable=False),
        sa.Column("value", sa.Double),
        sa.Column("sd", sa.Double),
        sa.Column("free", sa.Boolean, nullable=False),
    )
    op.create_table(
        "log",
        sa.Column("run", sa.Integer, sa.ForeignKey("run.number"), primary_key=True),
        sa.Column("sha256", sa.Text, primary_key=True),
        sa.Column("file", sa.Text, nullable=False),
    )
    op.create_table(
        "used",
        sa.Column("run", sa.Integer, sa.ForeignKey("run.number"), primary_key=True),
        sa.Column("reference", sa.Text, primary_key=True),
    )
    op.create_index("ix_run_instrument", "run", ["instrument"])
    op.create_index("ix_run_holds", "run", ["holds"])
    op.create_index("ix_coefficient_name", "coefficient", ["name"])
    if op.get_bind().dialect.name == "sqlite":
        for what in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER entry_no_{what.lower()} BEFORE {what} ON entry "
                f"BEGIN SELECT RAISE(ABORT, '{_NO}'); END"
            )
        return
    op.execute(
        "CREATE FUNCTION entry_kept() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{_NO}'; END $$"
    )
    op.execute(
        "CREATE TRIGGER entry_kept BEFORE UPDATE OR DELETE OR TRUNCATE ON entry "
        "FOR EACH STATEMENT EXECUTE FUNCTION entry_kept()"
    )
