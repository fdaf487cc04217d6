"""Keeps verdicts and windows, and lets a job name the windows of its curve."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "examinations",
        sa.Column("key", sa.String(64), nullable=False),
        sa.Column("version", sa.String(128), nullable=False),
        sa.Column("content", sa.LargeBinary(), nullable=False),
        sa.Column("seal", sa.String(64), nullable=False),
        sa.Column("used_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_examinations")),
    )
    op.create_index("ix_examinations_used_at", "examinations", ["used_at"])
    op.add_column("jobs", sa.Column("examination", sa.String(64), nullable=True))


def downgrade() -> None:
    raise NotImplementedError("earlier versions do not know this table; restore the backup instead")
