"""Adds audits: jobs that solve the problem of a stored solution again, and the comparison of the two."""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "audits",
        sa.Column("job_id", sa.Uuid(as_uuid=False), nullable=False),
        sa.Column("solution_id", sa.Uuid(as_uuid=False), nullable=False),
        sa.Column("comparison", sa.JSON(), nullable=True),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_audits_job_id"), ondelete="CASCADE"),
        sa.ForeignKeyConstraint(
            ["solution_id"], ["solutions.id"], name=op.f("fk_audits_solution_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("job_id", name=op.f("pk_audits")),
    )
    op.create_index(op.f("ix_audits_solution_id"), "audits", ["solution_id"])


def downgrade() -> None:
    op.drop_table("audits")
