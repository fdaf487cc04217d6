"""Creates sweeps, their chunks as a kind of job, priorities, API keys and the list of workers."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def _id() -> sa.Uuid[str]:
    return sa.Uuid(as_uuid=False)


def upgrade() -> None:
    _create_sweeps()
    _create_installation()
    with op.batch_alter_table("jobs", copy_from=_jobs_of_0001()) as jobs:
        jobs.add_column(sa.Column("kind", sa.String(length=16), server_default="solve", nullable=False))
        jobs.add_column(sa.Column("priority", sa.Integer(), server_default="0", nullable=False))
        jobs.add_column(sa.Column("ready_at", sa.Double(), server_default="0", nullable=False))
        jobs.add_column(sa.Column("sweep_id", _id(), nullable=True))
        jobs.add_column(sa.Column("key_id", _id(), nullable=True))
        jobs.create_foreign_key(op.f("fk_jobs_sweep_id"), "sweeps", ["sweep_id"], ["id"], ondelete="CASCADE")
        jobs.drop_constraint(op.f("ck_jobs_solution"), type_="check")
        jobs.create_check_constraint(
            op.f("ck_jobs_solution"),
            "(state = 'succeeded' AND kind = 'solve') = (solution_id IS NOT NULL)",
        )
        jobs.create_check_constraint(op.f("ck_jobs_kind"), "kind IN ('solve', 'chunk')")
        jobs.create_check_constraint(op.f("ck_jobs_sweep"), "(kind = 'chunk') = (sweep_id IS NOT NULL)")
    op.create_index("ix_jobs_sweep_id", "jobs", ["sweep_id"])
    op.create_index("ix_jobs_queue", "jobs", ["state", sa.desc("priority"), "id"])
    op.create_index("ix_jobs_leases", "jobs", ["state", "lease_until"])
    op.create_index("ix_jobs_of_key", "jobs", ["key_id", "state"])
    op.create_index("ix_attempts_ended_at", "attempts", ["ended_at"])


def _create_sweeps() -> None:
    op.create_table(
        "sweeps",
        sa.Column("id", _id(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.Column("points", sa.BigInteger(), nullable=False),
        sa.Column("next_index", sa.BigInteger(), nullable=False),
        sa.Column("done", sa.BigInteger(), nullable=False),
        sa.Column("refused", sa.BigInteger(), nullable=False),
        sa.Column("chunk_points", sa.Integer(), nullable=False),
        sa.Column("point_seconds", sa.Double(), nullable=True),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("key_id", _id(), nullable=True),
        sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("finished_at", sa.Double(), nullable=True),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name=op.f("ck_sweeps_state")
        ),
        sa.CheckConstraint("done <= next_index AND next_index <= points", name=op.f("ck_sweeps_progress")),
        sa.CheckConstraint("refused <= done", name=op.f("ck_sweeps_refused")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_sweeps")),
    )
    op.create_index("ix_sweeps_state_id", "sweeps", ["state", "id"])
    op.create_index("ix_sweeps_key_id", "sweeps", ["key_id"])
    op.create_table(
        "sweep_chunks",
        sa.Column("sweep_id", _id(), nullable=False),
        sa.Column("first", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("count", sa.Integer(), nullable=False),
        sa.Column("refused", sa.Integer(), nullable=False),
        sa.Column("bounds", sa.JSON(), nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.CheckConstraint("count > 0 AND refused <= count", name=op.f("ck_sweep_chunks_count")),
        sa.ForeignKeyConstraint(
            ["sweep_id"], ["sweeps.id"], name=op.f("fk_sweep_chunks_sweep_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("sweep_id", "first", name=op.f("pk_sweep_chunks")),
    )


def _create_installation() -> None:
    op.create_table(
        "api_keys",
        sa.Column("id", _id(), nullable=False),
        sa.Column("prefix", sa.String(length=32), nullable=False),
        sa.Column("hash", sa.LargeBinary(), nullable=False),
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("role", sa.String(length=16), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("expires_at", sa.Double(), nullable=True),
        sa.Column("revoked_at", sa.Double(), nullable=True),
        sa.Column("last_used_at", sa.Double(), nullable=True),
        sa.Column("requests_per_second", sa.Double(), nullable=True),
        sa.Column("max_queued_jobs", sa.Integer(), nullable=True),
        sa.Column("max_stored_bytes", sa.BigInteger(), nullable=True),
        sa.Column("stored_bytes", sa.BigInteger(), nullable=False),
        sa.CheckConstraint("role IN ('read', 'submit', 'operate', 'admin')", name=op.f("ck_api_keys_role")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_api_keys")),
        sa.UniqueConstraint("prefix", name=op.f("uq_api_keys_prefix")),
    )
    op.create_table(
        "workers",
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("host", sa.String(length=255), nullable=False),
        sa.Column("engine", sa.String(length=32), nullable=False),
        sa.Column("slots", sa.Integer(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("seen_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_workers")),
    )


def _jobs_of_0001() -> sa.Table:
    """Return the table as it was: SQLite copies it, and does not tell its checks."""
    return sa.Table(
        "jobs",
        sa.MetaData(),
        sa.Column("id", _id(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("progress", sa.Double(), nullable=False),
        sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("reused", sa.Boolean(), nullable=False),
        sa.Column("solution_id", _id(), nullable=True),
        sa.Column("problem", sa.JSON(), nullable=False),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=128), nullable=True),
        sa.Column("lease_until", sa.Double(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("finished_at", sa.Double(), nullable=True),
        sa.CheckConstraint("(state = 'running') = (lease_until IS NOT NULL)", name="ck_jobs_lease"),
        sa.CheckConstraint("(state = 'running') = (owner IS NOT NULL)", name="ck_jobs_owner"),
        sa.CheckConstraint("(state = 'succeeded') = (solution_id IS NOT NULL)", name="ck_jobs_solution"),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name="ck_jobs_state"
        ),
        sa.ForeignKeyConstraint(["solution_id"], ["solutions.id"], name="fk_jobs_solution_id"),
        sa.PrimaryKeyConstraint("id", name="pk_jobs"),
        sa.Index("ix_jobs_solution_id", "solution_id"),
        sa.Index("ix_jobs_state_id", "state", "id"),
    )


def downgrade() -> None:
    raise NotImplementedError("chunks are jobs that earlier versions do not know; restore the backup instead")
