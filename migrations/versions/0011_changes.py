"""Adds to jobs and sweeps when they last changed, by which streams of events find what is new."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    for table in ("jobs", "sweeps"):
        op.add_column(table, sa.Column("changed_at", sa.Double(), server_default="0", nullable=False))
        op.execute(f"UPDATE {table} SET changed_at = coalesce(finished_at, started_at, created_at)")
    solved = sa.text("kind = 'solve'")
    op.create_index(
        "ix_jobs_changed", "jobs", ["changed_at", "id"], sqlite_where=solved, postgresql_where=solved
    )
    op.create_index("ix_sweeps_changed", "sweeps", ["changed_at", "id"])


def downgrade() -> None:
    op.drop_index("ix_jobs_changed", table_name="jobs")
    op.drop_index("ix_sweeps_changed", table_name="sweeps")
    for table in ("jobs", "sweeps"):
        op.drop_column(table, "changed_at")
