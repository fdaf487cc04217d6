"""Adds atlases as a kind of job, and the table of those that were drawn."""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

_OLD, _NEW = "kind IN ('solve', 'chunk')", "kind IN ('solve', 'chunk', 'atlas')"


def upgrade() -> None:
    if op.get_bind().dialect.name == "sqlite":
        _copy_jobs(op.get_bind())
    else:
        op.drop_constraint(op.f("ck_jobs_kind"), "jobs", type_="check")
        op.create_check_constraint(op.f("ck_jobs_kind"), "jobs", _NEW)
    op.create_table(
        "atlases",
        sa.Column("job_id", sa.Uuid(as_uuid=False), nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_atlases_job_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_id", name=op.f("pk_atlases")),
    )


def _copy_jobs(connection: sa.Connection) -> None:
    """Put a copy with the new check in the place of the table: SQLite changes no check of a table.

    Its own SQL is used, which has all columns, checks and indexes as they are.
    """
    parts = connection.exec_driver_sql(
        "SELECT type, sql FROM sqlite_master WHERE tbl_name = 'jobs' AND sql IS NOT NULL"
    ).all()
    (table,) = (sql for kind, sql in parts if kind == "table")
    name, columns = table.split("(", 1)
    if name.split() != ["CREATE", "TABLE", '"jobs"'] or columns.count(_OLD) != 1:
        raise RuntimeError(f"the table of jobs is not that of 0012: {table}")
    connection.exec_driver_sql(f"CREATE TABLE jobs_0013 ({columns.replace(_OLD, _NEW)}")
    connection.exec_driver_sql("INSERT INTO jobs_0013 SELECT * FROM jobs")
    connection.exec_driver_sql("DROP TABLE jobs")
    connection.exec_driver_sql("ALTER TABLE jobs_0013 RENAME TO jobs")
    for kind, sql in parts:
        if kind == "index":
            connection.exec_driver_sql(sql)


def downgrade() -> None:
    raise NotImplementedError("earlier versions know no jobs that draw atlases; restore the backup instead")
