"""Creates indexes that serve any page of a list in its order, and the count of matching rows."""

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_SORTED = ("created_at", "A", "C", "period", "energy", "error")
_ALONE = ("created_at", "energy", "family", "period")
_FILTERS = ["family", "method", "tier", "created_at", "A", "C", "period", "energy", "error", "id"]


def upgrade() -> None:
    for name in _ALONE:
        op.drop_index(f"ix_solutions_{name}", table_name="solutions")
    for name in _SORTED:
        op.create_index(f"ix_solutions_{name}_id", "solutions", [name, "id"])
    op.create_index("ix_solutions_filters", "solutions", _FILTERS)
    op.drop_index("ix_jobs_state_id", table_name="jobs")
    op.create_index("ix_jobs_state_id_kind", "jobs", ["state", "id", "kind"])
    op.create_index("ix_jobs_kind_id", "jobs", ["kind", "id"])


def downgrade() -> None:
    op.drop_index("ix_jobs_kind_id", table_name="jobs")
    op.drop_index("ix_jobs_state_id_kind", table_name="jobs")
    op.create_index("ix_jobs_state_id", "jobs", ["state", "id"])
    op.drop_index("ix_solutions_filters", table_name="solutions")
    for name in _SORTED:
        op.drop_index(f"ix_solutions_{name}_id", table_name="solutions")
    for name in _ALONE:
        op.create_index(f"ix_solutions_{name}", "solutions", [name])
