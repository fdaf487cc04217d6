"""Adds lanes and turns: single jobs before batches, and a fair order between keys."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

_QUEUED = sa.text("state = 'queued'")


def upgrade() -> None:
    # As SQL, the same for both databases: SQLite adds a column with its check, Alembic would copy the table.
    op.execute(
        "ALTER TABLE jobs ADD COLUMN lane SMALLINT DEFAULT 0 NOT NULL "
        "CONSTRAINT ck_jobs_lane CHECK (lane IN (0, 1, 2))"
    )
    op.add_column("jobs", sa.Column("turn", sa.Double(), server_default="0", nullable=False))
    op.execute("UPDATE jobs SET lane = 2 WHERE kind = 'chunk'")
    # What waits already is shared out like what comes: by age within each key. What runs may come back to
    # the queue. Which single jobs were sent in lists nobody knows.
    op.execute(
        "UPDATE jobs SET turn = placed.turn FROM ("
        " SELECT id, row_number() OVER (PARTITION BY key_id, lane, priority ORDER BY id) AS turn"
        " FROM jobs WHERE state IN ('queued', 'running')"
        ") AS placed WHERE placed.id = jobs.id"
    )
    op.drop_index("ix_jobs_queue", "jobs")
    op.drop_index("ix_jobs_of_key", "jobs")
    op.create_index(
        "ix_jobs_queue",
        "jobs",
        ["state", sa.desc("priority"), "lane", "turn", "key_id", "id"],
        sqlite_where=_QUEUED,
        postgresql_where=_QUEUED,
    )
    op.create_index("ix_jobs_lanes", "jobs", ["state", "lane", sa.desc("priority"), "turn", "key_id", "id"])
    op.create_index("ix_jobs_of_key", "jobs", ["key_id", "state", "lane", "priority", "turn"])


def downgrade() -> None:
    raise NotImplementedError(
        "earlier versions do not know the order of the queue; restore the backup instead"
    )
