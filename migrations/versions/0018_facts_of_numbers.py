"""Adds all that is asked for often to the index of the numbers of problems."""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None

_WORDS = {"family": 32, "method": 32, "tier": 32, "stability": 16, "aperiodic": 16}
_NUMBERS = ("created_at", "A", "B", "C", "lambda_", "period", "energy", "error", "drift", "trace", "seconds")
_COLUMNS = (*_WORDS, *_NUMBERS)
_WITH_COLUMNS = " AND key NOT IN ('/body/A', '/body/B', '/body/C', '/motion/lambda')"
_SQLITE = "value", "json_each({0}.facts) WHERE type IN ('integer', 'real')"
_POSTGRES = "value::float8", "jsonb_each({0}.facts) WHERE jsonb_typeof(value) = 'number'"


def upgrade() -> None:
    op.drop_table("solution_numbers")
    op.create_table(
        "solution_numbers",
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("value", sa.Double(), nullable=False),
        sa.Column("solution_id", sa.Uuid(as_uuid=False), nullable=False),
        *(sa.Column(name, sa.String(length)) for name, length in _WORDS.items()),
        *(sa.Column(name, sa.Double(), nullable=name != "created_at") for name in _NUMBERS),
        sa.PrimaryKeyConstraint(
            "name", "value", "solution_id",
            name=op.f("pk_solution_numbers"), postgresql_include=list(_COLUMNS),
        ),
        sqlite_with_rowid=False,
    )  # fmt: skip
    is_sqlite = op.get_bind().dialect.name == "sqlite"
    value, numbers = _SQLITE if is_sqlite else _POSTGRES
    columns = ", ".join(["name, value, solution_id", *(f'"{name}"' for name in _COLUMNS)])

    def made(row: str, table: str) -> str:
        asked = "".join(f', {row}."{name}"' for name in _COLUMNS)
        return (
            f"INSERT INTO solution_numbers ({columns})"
            f" SELECT key, {value}, {row}.id{asked} FROM {table}{numbers.format(row)}{_WITH_COLUMNS}"
        )

    # In their order, so that the pages of the index are filled one after the other.
    op.execute(made("solutions", "solutions, ") + " ORDER BY 1, 2, 3")
    if is_sqlite:
        op.execute("DROP TRIGGER solution_numbers_made")
        op.execute(
            f"CREATE TRIGGER solution_numbers_made AFTER INSERT ON solutions BEGIN {made('NEW', '')}; END"
        )
    else:
        op.execute(
            "CREATE OR REPLACE FUNCTION solution_numbers_made() RETURNS trigger LANGUAGE plpgsql"
            f" AS $$ BEGIN {made('NEW', '')}; RETURN NULL; END $$"
        )


def downgrade() -> None:
    raise NotImplementedError("migrations go forward only; restore a backup instead")
