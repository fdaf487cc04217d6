"""Adds the numbers of problems with an index, and all that is asked for to every index of solutions."""

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None

_NUMBERS = ("created_at", "A", "B", "C", "lambda_", "period", "energy", "error", "drift", "trace", "seconds")
_WORDS = ("family", "method", "tier", "stability", "aperiodic")
_WITH_COLUMNS = "'/body/A', '/body/B', '/body/C', '/motion/lambda'"
_SQLITE = (
    f"SELECT key, value, {{0}}.id FROM {{1}}json_each({{0}}.facts) WHERE type IN ('integer', 'real')"
    f" AND key NOT IN ({_WITH_COLUMNS})"
)
_POSTGRES = (
    f"SELECT key, value::float8, {{0}}.id FROM {{1}}jsonb_each({{0}}.facts)"
    f" WHERE jsonb_typeof(value) = 'number' AND key NOT IN ({_WITH_COLUMNS})"
)
_INSERT = "INSERT INTO solution_numbers (name, value, solution_id) "
_DELETE = "DELETE FROM solution_numbers WHERE (name, value, solution_id) IN "


def upgrade() -> None:
    op.create_table(
        "solution_numbers",
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("value", sa.Double(), nullable=False),
        sa.Column("solution_id", sa.Uuid(as_uuid=False), nullable=False),
        sa.PrimaryKeyConstraint("name", "value", "solution_id", name=op.f("pk_solution_numbers")),
        sqlite_with_rowid=False,
    )
    is_sqlite = op.get_bind().dialect.name == "sqlite"
    numbers = _SQLITE if is_sqlite else _POSTGRES
    # In their order, so that the pages of the index are filled one after the other.
    op.execute(_INSERT + numbers.format("solutions", "solutions, ") + " ORDER BY 1, 2, 3")
    made, gone = _INSERT + numbers.format("NEW", ""), f"{_DELETE}({numbers.format('OLD', '')})"
    for name, when, statement in (("made", "INSERT", made), ("gone", "DELETE", gone)):
        if is_sqlite:
            op.execute(
                f"CREATE TRIGGER solution_numbers_{name} AFTER {when} ON solutions BEGIN {statement}; END"
            )
        else:
            op.execute(
                f"CREATE OR REPLACE FUNCTION solution_numbers_{name}() RETURNS trigger LANGUAGE plpgsql"
                f" AS $$ BEGIN {statement}; RETURN NULL; END $$"
            )
            op.execute(
                f"CREATE TRIGGER solution_numbers_{name} AFTER {when} ON solutions"
                f" FOR EACH ROW EXECUTE FUNCTION solution_numbers_{name}()"
            )
    op.drop_index("ix_solutions_filters", table_name="solutions")
    for name in _NUMBERS:
        op.drop_index(f"ix_solutions_{name}_id", table_name="solutions")
    for name in (*_WORDS, *_NUMBERS):
        others = (each for each in (*_WORDS, *_NUMBERS) if each != name)
        op.create_index(f"ix_solutions_{name}_id", "solutions", [name, "id", *others])


def downgrade() -> None:
    raise NotImplementedError("migrations go forward only; restore a backup instead")
