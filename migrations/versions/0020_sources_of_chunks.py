"""Adds where each chunk of a sweep was computed: its host, and which of its sweep's provenances it has."""

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("sweeps", sa.Column("provenances", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("sweep_chunks", sa.Column("host", sa.String(length=255), nullable=True))
    op.add_column("sweep_chunks", sa.Column("provenance", sa.SmallInteger(), nullable=True))


def downgrade() -> None:
    raise NotImplementedError("migrations go forward only; restore a backup instead")
