"""Labels and notes of jobs, solutions and sweeps."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

_OWNERS = {"jobs": "job", "solutions": "solution", "sweeps": "sweep"}


def upgrade() -> None:
    for table, name in _OWNERS.items():
        op.add_column(table, sa.Column("note", sa.String(length=2000), nullable=True))
        labels, owner = f"{name}_labels", f"{name}_id"
        op.create_table(
            labels,
            sa.Column(owner, sa.Uuid(as_uuid=False), nullable=False),
            sa.Column("key", sa.String(length=63), nullable=False),
            sa.Column("value", sa.String(length=128), nullable=False),
            sa.Column("created_at", sa.Double(), nullable=False),
            sa.ForeignKeyConstraint(
                [owner], [f"{table}.id"], name=op.f(f"fk_{labels}_{owner}"), ondelete="CASCADE"
            ),
            sa.PrimaryKeyConstraint(owner, "key", name=op.f(f"pk_{labels}")),
        )
        op.create_index(f"ix_{labels}_key_value", labels, ["key", "value", "created_at", owner])
        op.create_index(f"ix_{labels}_key_value_id", labels, ["key", "value", owner])


def downgrade() -> None:
    for table, name in _OWNERS.items():
        op.drop_table(f"{name}_labels")
        op.drop_column(table, "note")
