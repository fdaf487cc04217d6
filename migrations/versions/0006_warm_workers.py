"""Adds to the row of a worker whether it has loaded its compiled code and takes jobs."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # The workers of earlier versions took jobs from the first moment.
    op.add_column("workers", sa.Column("is_warm", sa.Boolean(), server_default=sa.true(), nullable=False))


def downgrade() -> None:
    op.drop_column("workers", "is_warm")
