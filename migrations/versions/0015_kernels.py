"""Adds to a worker how far its kernels are, and to a sweep on which way its points are computed."""

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("workers", sa.Column("kernels", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("sweeps", sa.Column("way", sa.String(16), nullable=True))


def downgrade() -> None:
    op.drop_column("sweeps", "way")
    op.drop_column("workers", "kernels")
