"""Adds the cluster on which a worker computes. Rows of workers are made anew by these, within seconds."""

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None

_OPTIONAL = sa.JSON(none_as_null=True)


def upgrade() -> None:
    op.drop_table("workers")
    op.create_table(
        "workers",
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("host", sa.String(length=255), nullable=False),
        sa.Column("engine", sa.String(length=32), nullable=False),
        sa.Column("slots", sa.Integer(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("seen_at", sa.Double(), nullable=False),
        sa.Column("is_warm", sa.Boolean(), server_default=sa.true(), nullable=False),
        sa.Column("kernels", _OPTIONAL, nullable=True),
        sa.Column("cluster", _OPTIONAL, nullable=True),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_workers")),
    )


def downgrade() -> None:
    raise NotImplementedError("migrations go forward only; restore a backup instead")
