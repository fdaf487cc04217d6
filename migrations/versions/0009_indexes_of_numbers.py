"""Adds columns, indexes and documents of facts, by which solutions, jobs and sweeps are asked for."""

import json
import math
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any
from urllib.parse import quote

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import JSONB

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

_SORTED = ("created_at", "A", "C", "period", "energy", "error")
_ASKED = ("B", "lambda_", "drift", "trace", "seconds")
_WORDS = ("stability", "aperiodic")
_FACTS = sa.JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql")
_BATCH = 1000


def upgrade() -> None:
    for name in _ASKED:
        op.add_column("solutions", sa.Column(name, sa.Double(), nullable=True))
    for name in _WORDS:
        op.add_column("solutions", sa.Column(name, sa.String(length=16), nullable=True))
    for table in ("solutions", "jobs", "sweeps"):
        op.add_column(table, sa.Column("facts", _FACTS, nullable=True))
    _fill("solutions", ("problem", "summary"), lambda row: _of_solution(row[1], row[2]))
    _fill("jobs", ("problem",), lambda row: {"facts": _facts(row[1])}, sa.text("kind = 'solve'"))
    _fill("sweeps", ("document",), lambda row: {"facts": _facts(row[1].get("base", {}))})
    op.drop_index("ix_solutions_filters", table_name="solutions")
    filters = ["family", "method", "tier", *_SORTED, *_ASKED, *_WORDS, "id"]
    op.create_index("ix_solutions_filters", "solutions", filters)
    for name in _ASKED:
        op.create_index(f"ix_solutions_{name}_id", "solutions", [name, "id"])


def _fill(table: str, read: tuple[str, ...], values: Any, *conditions: Any) -> None:
    """Write what is new in the rows that there are, some at a time."""
    made = ("facts", *_ASKED, *_WORDS) if table == "solutions" else ("facts",)
    types: dict[str, Any] = {"facts": _FACTS, **dict.fromkeys(_ASKED, sa.Double())}
    rows = sa.table(
        table,
        sa.column("id", sa.Uuid(as_uuid=False)),
        *(sa.column(name, sa.JSON()) for name in read),
        *(sa.column(name, types.get(name, sa.String())) for name in made),
    )
    change = sa.update(rows).where(rows.c.id == sa.bindparam("row"))
    change = change.values({name: sa.bindparam(f"new_{name}", type_=rows.c[name].type) for name in made})
    connection, last = op.get_bind(), None
    while True:
        after = [] if last is None else [rows.c.id > last]
        page = sa.select(rows.c.id, *(rows.c[name] for name in read)).where(*conditions, *after)
        found = connection.execute(page.order_by(rows.c.id).limit(_BATCH)).all()
        if not found:
            return
        connection.execute(
            change,
            [
                {"row": row[0], **{f"new_{name}": value for name, value in values(row).items()}}
                for row in found
            ],
        )
        last = found[-1][0]


def _of_solution(problem: Any, summary: Any) -> dict[str, object]:
    drifts = [_number(_at(each, "drift")) for each in (_at(summary, "invariants") or {}).values()]
    return {
        "facts": _facts(problem),
        "B": _number(_at(problem, "body", "B")),
        "lambda_": _number(_at(problem, "motion", "lambda")),
        "drift": max((drift for drift in drifts if drift is not None), default=None),
        "trace": _number(_at(summary, "stability", "trace")),
        "seconds": _number(_at(summary, "cost", "compute_seconds")),
        "stability": _at(summary, "stability", "verdict"),
        "aperiodic": _at(summary, "aperiodic"),
    }


def _facts(problem: Any) -> dict[str, object]:
    """Return the family and the first 64 numbers of a problem by JSON pointer."""
    found: dict[str, object] = {}
    family = _at(problem, "potential", "type")
    if isinstance(family, str):
        found["family"] = family
    for pointer, value in _leaves(problem, ""):
        number = _number(value)
        if len(found) > 64:
            break
        if number is not None and len(pointer) <= 128 and not re.search(r"[\x00\ud800-\udfff]", pointer):
            found[quote(pointer, safe="/~")] = number
    return found


def _leaves(value: Any, pointer: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _leaves(part, f"{pointer}/{name.replace('~', '~0').replace('/', '~1')}")
    elif isinstance(value, list):
        if len(value) <= 16:
            for index, part in enumerate(value):
                yield from _leaves(part, f"{pointer}/{index}")
    else:
        yield pointer, value


def _at(document: Any, *keys: str) -> Any:
    for key in keys:
        if not isinstance(document, Mapping):
            return None
        document = document.get(key)
    return document


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(Fraction(value if isinstance(value, str) else json.dumps(value)))
    except (ValueError, OverflowError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None


def downgrade() -> None:
    for name in _ASKED:
        op.drop_index(f"ix_solutions_{name}_id", table_name="solutions")
    op.drop_index("ix_solutions_filters", table_name="solutions")
    op.create_index("ix_solutions_filters", "solutions", ["family", "method", "tier", *_SORTED, "id"])
    for table in ("solutions", "jobs", "sweeps"):
        op.drop_column(table, "facts")
    for name in (*_ASKED, *_WORDS):
        op.drop_column("solutions", name)
