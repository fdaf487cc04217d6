"""Adds audits, which compare a stored solution with one computed anew, and the seconds of examinations."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("jobs", sa.Column("examined_seconds", sa.Double(), nullable=True))
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
    op.drop_column("jobs", "examined_seconds")
