"""Many stored solutions: a few hundred are computed, and each is stored many times with its numbers varied.

A potential times k and all times divided by the root of k is the same motion: so the rows of one answer keep
what belongs together. Its λ, errors and times of computing are varied beside that.
"""

import json
import math
import random
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any  # documents

from sqlalchemy import func, insert, select

from service.schemas.query.terms import facts_of
from service.storage.codecs.summary import summary_columns
from service.storage.database.database import Database
from service.storage.database.rows import new_id
from service.storage.tables.base import table_of
from service.storage.tables.solutions import SolutionRow, insertion, triggers
from tests.support.serving import serving
from tests.support.waiting import wait_until

BATCH = 5000
SEED = 7
PATIENCE = 600.0
_OUTPUTS = ["gamma", "omega", "invariants"]
_FAMILIES: tuple[tuple[dict[str, Any], dict[str, Any]], ...] = (
    ({"A": 2, "B": "3/2", "C": 1}, {"type": "gravity", "a": -1}),
    (
        {"A": 2, "B": "17/10", "C": 1},
        {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    ),
    (
        {"A": 2, "B": "17/10", "C": 1},
        {"type": "rational", "a": [-2, "1/20", "1/200"], "b": ["1/50", "1/500"], "c": ["1/5", "1/10"]},
    ),
    (
        {"A": 3, "B": "5/2", "C": 1},
        {"type": "homogeneous", "A": ["-1/2", "0", "1"], "B": ["-1/3"], "C": ["1/200"]},
    ),
    (
        {"A": "17/10", "B": "7/5", "C": 1},
        {"type": "general", "F": "k*exp(-w)", "G": "k*(-3*(6/10 - g2^2) + 3/10*g2)", "parameters": {"k": 1}},
    ),
)


def problems() -> Iterator[dict[str, Any]]:
    """Yield what is computed: some have no motion."""
    for body, potential in _FAMILIES:
        for place, tier in enumerate(("draft", "standard", "high")):
            for step in range(20):
                common = {"body": body, "potential": potential, "accuracy": {"tier": tier}}
                motion = {"type": "planar", "lambda": f"{20 + 9 * step + place}/100"}
                outputs = [*_OUTPUTS, "stability"] if step % 2 else _OUTPUTS
                spans = {"periods": 1, "samples": 51}, {"stop": 10, "samples": 101}
                yield {**common, "motion": motion, "time": spans[step % 4 // 2], "outputs": outputs}
    for step in range(12):
        yield {
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {"type": "gravity", "a": 1, "c": "-1/2"},
            "motion": {"type": "state", "omega": ["2/5", "1/10", f"{step}/10"], "gamma": ["3/5", 0, "4/5"]},
            "time": {"stop": 20, "samples": 51},
            "outputs": _OUTPUTS,
        }


def answers(folder: Path) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return the problems that have a solution, each with its summary, as a service stores them."""
    kept = folder / "answers.json"
    if not kept.exists():
        with serving(folder, workers=2, POLHODE_DATABASE_URL="sqlite:///computed.db") as service:
            service.call("POST", "/v1/jobs", list(problems()))
            states = "queued", "running"
            wait_until(
                lambda: (
                    not any(
                        service.call("GET", f"/v1/jobs?state={state}&limit=1").document["total"]
                        for state in states
                    )
                ),
                PATIENCE,
            )
        database = Database(f"sqlite:///{folder / 'computed.db'}")
        with database.read() as session:
            found = session.execute(select(SolutionRow.problem, SolutionRow.summary).order_by(SolutionRow.id))
            kept.write_text(json.dumps([tuple(row) for row in found]))
        database.close()
    return [(problem, summary) for problem, summary in json.loads(kept.read_text())]


def rows(found: Sequence[tuple[dict[str, Any], dict[str, Any]]], count: int) -> Iterator[dict[str, Any]]:
    """Yield rows of the table of solutions; the first ones of a greater count are the same, but their age."""
    draw = random.Random(SEED)
    now = time.time()
    for place in range(count):
        problem, summary = _varied(*draw.choice(found), draw)
        yield {
            "id": new_id(),
            "job_id": new_id(),
            "digest": f"{place:064x}",
            "created_at": now - count + place,
            "problem": problem,
            "summary": summary,
            **summary_columns(problem, summary),
            "facts": facts_of(problem),
        }


def _varied(
    problem: dict[str, Any], summary: dict[str, Any], draw: random.Random
) -> tuple[dict[str, Any], dict[str, Any]]:
    k = math.exp(draw.gauss(0.0, 1.0))
    numbers = {
        name: _times(part, k) for name, part in problem["potential"].items() if name != "reference_angle"
    }
    motion = dict(problem["motion"])
    if "lambda" in motion:
        motion["lambda"] = _number(motion["lambda"]) * math.exp(draw.gauss(0.0, 0.1))
    problem = {**problem, "potential": numbers, "motion": motion}
    if "stop" in problem["time"]:
        problem["time"] = {**problem["time"], "stop": _number(problem["time"]["stop"]) / math.sqrt(k)}
    summary = {**summary, "problem": problem} if "problem" in summary else dict(summary)
    for name, factor in (("period", 1 / math.sqrt(k)), ("energy", k)):
        if summary.get(name) is not None:
            summary[name] = {part: number * factor for part, number in summary[name].items()}
    if summary.get("stability") is not None:
        trace = summary["stability"]["trace"] * math.exp(draw.gauss(0.0, 0.1))
        summary["stability"] = {**summary["stability"], "trace": trace}
    summary["invariants"] = {
        name: {**each, "drift": each["drift"] * 10.0 ** draw.uniform(-1, 1)}
        for name, each in summary["invariants"].items()
    }
    summary["error"] *= 10.0 ** draw.uniform(-1, 1)
    seconds = summary["cost"]["compute_seconds"] * math.exp(draw.gauss(0.0, 1.0))
    summary["cost"] = {**summary["cost"], "compute_seconds": seconds}
    return problem, summary


def _times(part: Any, k: float) -> Any:  # noqa: ANN401
    """Return the numbers of a potential times k; its words and formulas as they are."""
    if isinstance(part, Mapping):
        return {name: _times(each, k) for name, each in part.items()}
    if isinstance(part, list):
        return [_times(each, k) for each in part]
    try:
        return _number(part) * k
    except ValueError:
        return part


def _number(value: object) -> float:
    above, _, below = str(value).partition("/")
    return float(above) / float(below or 1)


def fill(database: Database, found: Sequence[tuple[dict[str, Any], dict[str, Any]]], count: int) -> None:
    """Store ``count`` solutions, unless the database has some; indexes and numbers are made afterwards."""
    with database.read() as session:
        if session.scalar(select(func.count()).select_from(SolutionRow)):
            return
    table, dialect = table_of(SolutionRow), database.engine.dialect.name
    made = next(each for each in triggers(dialect) if each.startswith("CREATE TRIGGER solution_numbers_made"))
    on_table = "" if dialect == "sqlite" else " ON solutions"
    with database.write_rows() as connection:
        connection.exec_driver_sql(f"DROP TRIGGER solution_numbers_made{on_table}")
        for index in table.indexes:
            index.drop(connection)
    batch: list[dict[str, Any]] = []
    for row in rows(found, count):
        batch.append(row)
        if len(batch) == BATCH:
            _store(database, batch)
            batch = []
    if batch:
        _store(database, batch)
    with database.write_rows() as connection:
        for index in table.indexes:
            index.create(connection)
        # In their order, as a migration makes them; then Postgres needs not look at rows for what is current.
        connection.exec_driver_sql(f"{insertion(dialect, 'solutions', 'solutions, ')} ORDER BY 1, 2, 3")
        connection.exec_driver_sql(made)
    if dialect == "postgresql":
        with database.engine.execution_options(isolation_level="AUTOCOMMIT").connect() as connection:
            connection.exec_driver_sql("VACUUM ANALYZE")


def _store(database: Database, batch: list[dict[str, Any]]) -> None:
    with database.write_rows() as connection:
        connection.execute(insert(table_of(SolutionRow)), batch)
