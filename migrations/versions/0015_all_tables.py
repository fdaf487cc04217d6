"""Makes all tables, as the databases have them that the versions before this one brought here.

New databases are made from the models: :mod:`service.storage.database.migration`. This states where later
migrations begin, and lets tests prove that both ways lead to one schema.
"""

from typing import Any

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import JSONB

revision = "0015"
down_revision = None
branch_labels = None
depends_on = None

_ID = sa.Uuid(as_uuid=False)
_OPTIONAL = sa.JSON(none_as_null=True)
_FACTS = _OPTIONAL.with_variant(JSONB(none_as_null=True), "postgresql")
_NUMBERS = ("created_at", "A", "C", "period", "energy", "error", "B", "lambda_", "drift", "trace", "seconds")


def _where(condition: str) -> dict[str, Any]:
    return {f"{dialect}_where": sa.text(condition) for dialect in ("sqlite", "postgresql")}


def upgrade() -> None:
    op.create_table(
        "api_keys",
        sa.Column("id", _ID, nullable=False),
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
        "calibrations",
        sa.Column("id", _ID, nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_calibrations")),
    )
    op.create_index(op.f("ix_calibrations_created_at"), "calibrations", ["created_at"])
    op.create_table(
        "examinations",
        sa.Column("key", sa.String(length=64), nullable=False),
        sa.Column("version", sa.String(length=128), nullable=False),
        sa.Column("content", sa.LargeBinary(), nullable=False),
        sa.Column("seal", sa.String(length=64), nullable=False),
        sa.Column("used_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_examinations")),
    )
    op.create_index(op.f("ix_examinations_used_at"), "examinations", ["used_at"])
    op.create_table(
        "idempotency_keys",
        sa.Column("principal", sa.String(length=64), nullable=False),
        sa.Column("key", sa.String(length=255), nullable=False),
        sa.Column("fingerprint", sa.String(length=64), nullable=False),
        sa.Column("status", sa.Integer(), nullable=False),
        sa.Column("headers", sa.JSON(), nullable=False),
        sa.Column("body", sa.LargeBinary(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("principal", "key", name=op.f("pk_idempotency_keys")),
    )
    op.create_index(op.f("ix_idempotency_keys_created_at"), "idempotency_keys", ["created_at"])
    op.create_table(
        "solutions",
        sa.Column("id", _ID, nullable=False),
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("problem", sa.JSON(), nullable=False),
        sa.Column("summary", sa.JSON(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("family", sa.String(length=32), nullable=True),
        sa.Column("method", sa.String(length=32), nullable=True),
        sa.Column("tier", sa.String(length=32), nullable=True),
        sa.Column("A", sa.Double(), nullable=True),
        sa.Column("C", sa.Double(), nullable=True),
        sa.Column("period", sa.Double(), nullable=True),
        sa.Column("energy", sa.Double(), nullable=True),
        sa.Column("error", sa.Double(), nullable=True),
        sa.Column("B", sa.Double(), nullable=True),
        sa.Column("lambda_", sa.Double(), nullable=True),
        sa.Column("drift", sa.Double(), nullable=True),
        sa.Column("trace", sa.Double(), nullable=True),
        sa.Column("seconds", sa.Double(), nullable=True),
        sa.Column("stability", sa.String(length=16), nullable=True),
        sa.Column("aperiodic", sa.String(length=16), nullable=True),
        sa.Column("facts", _FACTS, nullable=True),
        sa.Column("note", sa.String(length=2000), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_solutions")),
        sa.UniqueConstraint("job_id", name=op.f("uq_solutions_job_id")),
    )
    op.create_index(op.f("ix_solutions_digest"), "solutions", ["digest"])
    for name in _NUMBERS:
        op.create_index(f"ix_solutions_{name}_id", "solutions", [name, "id"])
    op.create_index(
        "ix_solutions_filters",
        "solutions",
        ["family", "method", "tier", *_NUMBERS, "stability", "aperiodic", "id"],
    )
    op.create_table(
        "sweeps",
        sa.Column("id", _ID, nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("document", sa.JSON(), nullable=False),
        sa.Column("facts", _FACTS, nullable=True),
        sa.Column("points", sa.BigInteger(), nullable=False),
        sa.Column("next_index", sa.BigInteger(), nullable=False),
        sa.Column("done", sa.BigInteger(), nullable=False),
        sa.Column("refused", sa.BigInteger(), nullable=False),
        sa.Column("chunk_points", sa.Integer(), nullable=False),
        sa.Column("point_seconds", sa.Double(), nullable=True),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("key_id", _ID, nullable=True),
        sa.Column("error", _OPTIONAL, nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("finished_at", sa.Double(), nullable=True),
        sa.Column("way", sa.String(length=16), nullable=True),
        sa.Column("note", sa.String(length=2000), nullable=True),
        sa.Column("changed_at", sa.Double(), server_default="0", nullable=False),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name=op.f("ck_sweeps_state")
        ),
        sa.CheckConstraint("done <= next_index AND next_index <= points", name=op.f("ck_sweeps_progress")),
        sa.CheckConstraint("refused <= done", name=op.f("ck_sweeps_refused")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_sweeps")),
    )
    op.create_index("ix_sweeps_changed", "sweeps", ["changed_at", "id"])
    op.create_index(op.f("ix_sweeps_key_id"), "sweeps", ["key_id"])
    op.create_index("ix_sweeps_state_id", "sweeps", ["state", "id"])
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
        sa.PrimaryKeyConstraint("name", name=op.f("pk_workers")),
    )
    op.create_table(
        "dense_outputs",
        sa.Column("solution_id", _ID, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["solution_id"], ["solutions.id"], name=op.f("fk_dense_outputs_solution_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("solution_id", name=op.f("pk_dense_outputs")),
    )
    op.create_table(
        "jobs",
        sa.Column("id", _ID, nullable=False),
        sa.Column("kind", sa.String(length=16), server_default="solve", nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("priority", sa.Integer(), server_default="0", nullable=False),
        sa.Column("lane", sa.SmallInteger(), server_default="0", nullable=False),
        sa.Column("turn", sa.Double(), server_default="0", nullable=False),
        sa.Column("ready_at", sa.Double(), server_default="0", nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("alone", sa.Boolean(), server_default=sa.false(), nullable=False),
        sa.Column("progress", sa.Double(), nullable=False),
        sa.Column("error", _OPTIONAL, nullable=True),
        sa.Column("reused", sa.Boolean(), nullable=False),
        sa.Column("solution_id", _ID, nullable=True),
        sa.Column("sweep_id", _ID, nullable=True),
        sa.Column("key_id", _ID, nullable=True),
        sa.Column("problem", sa.JSON(), nullable=False),
        sa.Column("examination", sa.String(length=64), nullable=True),
        sa.Column("examined_seconds", sa.Double(), nullable=True),
        sa.Column("facts", _FACTS, nullable=True),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=128), nullable=True),
        sa.Column("lease_until", sa.Double(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("finished_at", sa.Double(), nullable=True),
        sa.Column("note", sa.String(length=2000), nullable=True),
        sa.Column("changed_at", sa.Double(), server_default="0", nullable=False),
        sa.CheckConstraint("(kind = 'chunk') = (sweep_id IS NOT NULL)", name=op.f("ck_jobs_sweep")),
        sa.CheckConstraint("(state = 'running') = (lease_until IS NOT NULL)", name=op.f("ck_jobs_lease")),
        sa.CheckConstraint("(state = 'running') = (owner IS NOT NULL)", name=op.f("ck_jobs_owner")),
        sa.CheckConstraint(
            "(state = 'succeeded' AND kind = 'solve') = (solution_id IS NOT NULL)",
            name=op.f("ck_jobs_solution"),
        ),
        sa.CheckConstraint("kind IN ('solve', 'chunk', 'atlas')", name=op.f("ck_jobs_kind")),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name=op.f("ck_jobs_state")
        ),
        sa.CheckConstraint("lane IN (0, 1, 2)", name=op.f("ck_jobs_lane")),
        sa.ForeignKeyConstraint(["solution_id"], ["solutions.id"], name=op.f("fk_jobs_solution_id")),
        sa.ForeignKeyConstraint(
            ["sweep_id"], ["sweeps.id"], name=op.f("fk_jobs_sweep_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_jobs")),
    )
    op.create_index("ix_jobs_changed", "jobs", ["changed_at", "id"], **_where("kind = 'solve'"))
    op.create_index("ix_jobs_kind_id", "jobs", ["kind", "id"])
    op.create_index(
        "ix_jobs_queue",
        "jobs",
        ["state", sa.desc("priority"), "lane", "turn", "key_id", "id"],
        **_where("state = 'queued'"),
    )
    op.create_index("ix_jobs_lanes", "jobs", ["state", "lane", sa.desc("priority"), "turn", "key_id", "id"])
    op.create_index("ix_jobs_leases", "jobs", ["state", "lease_until"])
    op.create_index("ix_jobs_of_key", "jobs", ["key_id", "state", "lane", "priority", "turn"])
    op.create_index(op.f("ix_jobs_solution_id"), "jobs", ["solution_id"])
    op.create_index("ix_jobs_state_id_kind", "jobs", ["state", "id", "kind"])
    op.create_index(op.f("ix_jobs_sweep_id"), "jobs", ["sweep_id"])
    op.create_table(
        "samples",
        sa.Column("solution_id", _ID, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["solution_id"], ["solutions.id"], name=op.f("fk_samples_solution_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("solution_id", name=op.f("pk_samples")),
    )

    op.create_table(
        "sweep_chunks",
        sa.Column("sweep_id", _ID, nullable=False),
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
    op.create_table(
        "atlases",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_atlases_job_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_id", name=op.f("pk_atlases")),
    )
    op.create_table(
        "attempts",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("worker", sa.String(length=128), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("ended_at", sa.Double(), nullable=True),
        sa.Column("outcome", sa.String(length=16), nullable=True),
        sa.Column("detail", sa.String(length=512), nullable=True),
        sa.CheckConstraint(
            "outcome IN ('succeeded', 'failed', 'lost', 'returned', 'cancelled')",
            name=op.f("ck_attempts_outcome"),
        ),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_attempts_job_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("job_id", "number", name=op.f("pk_attempts")),
    )
    op.create_index("ix_attempts_ended_at", "attempts", ["ended_at"])
    op.create_table(
        "audits",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("solution_id", _ID, nullable=False),
        sa.Column("comparison", _OPTIONAL, nullable=True),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name=op.f("fk_audits_job_id"), ondelete="CASCADE"),
        sa.ForeignKeyConstraint(
            ["solution_id"], ["solutions.id"], name=op.f("fk_audits_solution_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("job_id", name=op.f("pk_audits")),
    )
    op.create_index(op.f("ix_audits_solution_id"), "audits", ["solution_id"])
    for thing in ("job", "solution", "sweep"):
        own = f"{thing}_id"
        op.create_table(
            f"{thing}_labels",
            sa.Column(own, _ID, nullable=False),
            sa.Column("key", sa.String(length=63), nullable=False),
            sa.Column("value", sa.String(length=128), nullable=False),
            sa.Column("created_at", sa.Double(), nullable=False),
            sa.ForeignKeyConstraint(
                [own], [f"{thing}s.id"], name=op.f(f"fk_{thing}_labels_{own}"), ondelete="CASCADE"
            ),
            sa.PrimaryKeyConstraint(own, "key", name=op.f(f"pk_{thing}_labels")),
        )
        for name, columns in {
            "key_value": ["key", "value", "created_at", own],
            "key_value_id": ["key", "value", own],
        }.items():
            op.create_index(f"ix_{thing}_labels_{name}", f"{thing}_labels", columns)


def downgrade() -> None:
    raise NotImplementedError("nothing is before this schema; restore a backup instead")
