"""Takes the lists of words out of the checks of tables: a later word needs no migration then.

The models refuse other words when they write (:class:`service.storage.tables.base.Word`), and
``polhode doctor`` finds them.
"""

import re

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None

_CHECKS = {
    "api_keys": ("ck_api_keys_role",),
    "attempts": ("ck_attempts_outcome",),
    "jobs": ("ck_jobs_kind", "ck_jobs_state"),
    "sweeps": ("ck_sweeps_state",),
}


def upgrade() -> None:
    connection = op.get_bind()
    for table, names in _CHECKS.items():
        if connection.dialect.name == "sqlite":
            _copy_without(connection, table, names)
        else:
            for name in names:
                op.drop_constraint(op.f(name), table, type_="check")


def _copy_without(connection: sa.Connection, table: str, names: tuple[str, ...]) -> None:
    """Put a copy without these checks in the place of the table: SQLite changes no check of a table.

    Its own SQL is used, which has all columns, other checks and indexes as they are.
    """
    parts = connection.execute(
        sa.text("SELECT type, sql FROM sqlite_master WHERE tbl_name = :table AND sql IS NOT NULL"),
        {"table": table},
    ).all()
    (sql,) = (sql for kind, sql in parts if kind == "table")
    begin, columns = sql.split("(", 1)
    if begin.replace('"', "").split() != ["CREATE", "TABLE", table]:
        raise RuntimeError(f"the table {table} is not that of 0015: {sql}")
    for name in names:
        columns, count = re.subn(rf",\s*CONSTRAINT {name} CHECK \(\w+ IN \([^()]*\)\)", "", columns)
        if count != 1:
            raise RuntimeError(f"the table {table} is not that of 0015: {sql}")
    connection.exec_driver_sql(f"CREATE TABLE {table}_0016 ({columns}")
    connection.exec_driver_sql(f"INSERT INTO {table}_0016 SELECT * FROM {table}")
    connection.exec_driver_sql(f"DROP TABLE {table}")
    connection.exec_driver_sql(f"ALTER TABLE {table}_0016 RENAME TO {table}")
    for kind, index in parts:
        if kind == "index":
            connection.exec_driver_sql(index)


def downgrade() -> None:
    raise NotImplementedError("earlier versions refuse later words; restore a backup instead")
